"""Reduce SVG documents to shapes in groups, copied to where they are drawn, for svgelements.

Viewports become transforms, references become copies, and lengths become plain numbers (SVG 2, sections 5, 7 and 8).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from xml.etree.ElementTree import Element, SubElement

from .svg_style import Styles, tag_of

# mm per unit of CSS (Values 3); em for the initial font
UNITS = {"mm": 1, "cm": 10, "in": 25.4, "pt": 25.4 / 72, "pc": 25.4 / 6, "q": 0.25, "px": 25.4 / 96, "em": 25.4 / 6}
SHAPES = {"rect", "circle", "ellipse", "line", "polyline", "polygon", "path"}
# Attributes with lengths, and whether 100 % refers to the viewport's width (0), height (1) or diagonal (2)
SIZES = dict(
    zip(
        ["x", "width", "cx", "rx", "x1", "x2", "y", "height", "cy", "ry", "y1", "y2", "r"],
        (0,) * 6 + (1,) * 6 + (2,),
        strict=True,
    )
)
STYLES = {"display", "visibility", "opacity"}  # properties that can hide an element
MOST = 100_000  # maximum number of elements; more come only from circular references
_LENGTH = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*(mm|cm|in|pt|pc|px|em|q|%)?", re.IGNORECASE)
# values of transform-origin
_KEYWORDS = {"left": "0%", "top": "0%", "center": "50%", "right": "100%", "bottom": "100%"}


class SvgTree:
    """A document reduced to plain shapes.

    root : the reduced document
    unit : mm per unit of ``root``
    unitless : whether the drawing's size names no unit, so that ``unit`` is the default
    outside : names of elements, properties and selectors that are not read
    """

    def __init__(self, document: Element, default: float):
        self.styles = Styles(document)
        given = self.styles.given(document)
        units = [_LENGTH.fullmatch(given.get(name, "")) for name in ("width", "height")]
        self.unitless = not any(u and u[2] and u[2] != "%" for u in units)
        self.unit = default if self.unitless else UNITS["px"]
        self.named = {e.get("id"): e for e in document.iter() if e.get("id")}
        self.outside = self.styles.unread
        self.count = 0
        box, size = _box(given), [self._length(given.get(name, "")) for name in ("width", "height")]
        scale = next((s / b for s, b in zip(size, box[2:]) if s), 1.0)  # a missing size follows from the other side
        across = [repr(s or scale * b) for s, b in zip(size, box[2:] or (100.0, 100.0))]
        self.root = Element("svg")
        self._draw(self.root, document, (1.0, 1.0), {"width": across[0], "height": across[1], "x": "0", "y": "0"})

    def _draw(self, parent: Element, element: Element, view: Sequence[float], more: dict[str, str]) -> None:
        """Append an element; ``view`` is the size of its viewport, ``more`` are attributes from a reference."""
        tag, given = tag_of(element), self.styles.given(element) | more
        self.count += 1
        if self.count > MOST:
            raise RecursionError
        self.outside |= {tag} & {"text", "image", "foreignObject"}
        self.outside |= {name for name in ("clip-path", "mask") if given.get(name, "none") != "none"}
        if tag not in SHAPES | {"svg", "g", "a", "switch", "use", "symbol"} or (tag == "symbol" and "use" not in more):
            return
        whole = (*view, (0.5 * (view[0] ** 2 + view[1] ** 2)) ** 0.5)
        at = {n: self._length(given[n], whole[i]) for n, i in SIZES.items() if _LENGTH.fullmatch(given.get(n, ""))}
        made = SubElement(parent, tag if tag in SHAPES else "g")
        made.set("style", ";".join(f"{k}:{given[k]}" for k in sorted(STYLES & set(given))))
        made.set("transform", self._moves(given, view))
        if tag in SHAPES:
            made.attrib |= {n: repr(x) for n, x in at.items()} | {k: given[k] for k in ("d", "points") if k in given}
            return
        children, inner = list(element), {}
        if tag == "use":
            moves = f"translate({at.get('x', 0.0)!r},{at.get('y', 0.0)!r})"
            target = given.get("href", given.get("{http://www.w3.org/1999/xlink}href", "")).removeprefix("#")
            children = [self.named[target]] if target in self.named else []
            if children and tag_of(children[0]) in ("svg", "symbol"):
                inner = {"use": ""} | {name: given[name] for name in ("width", "height") if name in given}
        elif tag in ("svg", "symbol"):
            moves, view = _viewport(at, view, _box(given), given.get("preserveAspectRatio", "xMidYMid"))
        else:
            moves = ""
            if tag == "switch":  # draw the first child whose conditions hold
                fit = (e for e in element if tag_of(e) and not e.get("requiredExtensions"))
                children = [e for e in fit if "en" in e.get("systemLanguage", "en")][:1]
        moved = SubElement(made, "g", {"transform": moves})
        for child in children:
            self._draw(moved, child, view, inner)

    def _length(self, text: str, whole: float = 0.0) -> float:
        """Return a length in units of ``root``; ``whole`` is 100 %."""
        found = _LENGTH.fullmatch(text)
        unit = (found[2] or "px").lower() if found else ""
        scale = 0.01 * whole if unit == "%" else 1.0 if unit == "px" else UNITS.get(unit, 0.0) / self.unit
        return float(found[1]) * scale if found else 0.0

    def _plain(self, text: str) -> str:
        """Return a text with every length replaced by a number in units of ``root``."""
        return _LENGTH.sub(lambda found: repr(self._length(found[0], 1.0)) if found[2] else found[0], text)

    def _moves(self, given: Mapping[str, str], view: Sequence[float]) -> str:
        """Return the transform of an element about its origin; ``view`` is the size of the viewport."""
        at = [_KEYWORDS.get(one, one) for one in given.get("transform-origin", "0 0").split()]
        x, y = map(self._length, [*at, "50%"][:2], view)
        own = " ".join(f"{k}({','.join(given[k].split())})" for k in ("translate", "rotate", "scale") if k in given)
        return f"translate({x!r},{y!r}) {self._plain(f'{own} ' + given.get('transform', ''))} translate({-x!r},{-y!r})"


def _box(given: Mapping[str, str]) -> list[float]:
    """Return the viewBox; empty without area."""
    box = [float(x) for x in re.split(r"[\s,]+", given.get("viewBox", "")) if x]
    return box if len(box) == 4 and box[2] > 0.0 and box[3] > 0.0 else []


def _viewport(
    at: Mapping[str, float], view: Sequence[float], box: Sequence[float], aspect: str
) -> tuple[str, Sequence[float]]:
    """Return the transform of a nested drawing and the size of its viewport."""
    from svgelements import Viewbox

    x, y = at.get("x", 0.0), at.get("y", 0.0)
    size = at.get("width", view[0]), at.get("height", view[1])
    if not box:
        return f"translate({x!r},{y!r})", size
    return Viewbox.viewbox_transform(x, y, *size, *box, " ".join(aspect.replace("defer", "").split())), box[2:]
