"""SVG documents put right for svgelements: nothing but shapes in groups, copied to where they are drawn.

Viewports become transforms, references copies, and lengths plain numbers (SVG 2, sections 5, 7, and 8).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from xml.etree.ElementTree import Element, SubElement

# millimetres of the units of CSS (Values 3); em of the initial font
UNITS = {"mm": 1, "cm": 10, "in": 25.4, "pt": 25.4 / 72, "pc": 25.4 / 6, "q": 0.25, "px": 25.4 / 96, "em": 25.4 / 6}
SHAPES = {"rect", "circle", "ellipse", "line", "polyline", "polygon", "path"}
# lengths of shapes, and whether 100 % of one are the viewport's width, height, or diagonal
SIZES = dict(
    zip(
        ["x", "width", "cx", "rx", "x1", "x2", "y", "height", "cy", "ry", "y1", "y2", "r"],
        (0,) * 6 + (1,) * 6 + (2,),
        strict=True,
    )
)
STYLES = {"display", "visibility", "opacity"}  # properties that hide
MOST = 100_000  # elements that are drawn; more come of references that refer to each other only
_LENGTH = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*(mm|cm|in|pt|pc|px|em|q|%)?", re.IGNORECASE)
# properties that decide what is drawn
_DECIDES = re.compile(r"(?<![\w-])(display|visibility|opacity|transform|width|height|[cr]?[xyr])\s*:")
_SELECTORS = re.compile(r"[\w.#*-]+(\s*,\s*[\w.#*-]+)*")  # the selectors of CSS that svgelements knows


class SvgTree:
    """A document put right: its ``root``, and what of it is not read.

    unit : millimetres of a unit of ``root``; unitless : whether that is ``default``, as the drawing's size names none
    outside : names of elements, properties, and selectors that are not read
    """

    def __init__(self, document: Element, default: float):
        given = _given(document)
        units = [_LENGTH.fullmatch(given.get(name, "")) for name in ("width", "height")]
        self.unitless = not any(u and u[2] and u[2] != "%" for u in units)
        self.unit = default if self.unitless else UNITS["px"]
        self.named = {e.get("id"): e for e in document.iter() if e.get("id")}
        self.outside: set[str] = set()
        self.count = 0
        box, size = _box(given), [self._length(given.get(name, "")) for name in ("width", "height")]
        scale = next((s / b for s, b in zip(size, box[2:]) if s), 1.0)  # what is missing follows from the other side
        across = [repr(s or scale * b) for s, b in zip(size, box[2:] or (100.0, 100.0))]
        self.root = Element("svg")
        self.root.extend(self._sheet(e) for e in document.iter() if _tag(e) == "style")
        self._draw(self.root, document, (1.0, 1.0), {"width": across[0], "height": across[1], "x": "0", "y": "0"})

    def _draw(self, parent: Element, element: Element, view: Sequence[float], more: dict[str, str]) -> None:
        """Append an element; ``view`` is the size of its viewport, ``more`` the attributes that a reference gives it."""
        tag, given = _tag(element), _given(element) | more
        self.count += 1
        if self.count > MOST:
            raise RecursionError
        self.outside |= {tag} & {"text", "image", "foreignObject"}
        self.outside |= {name for name in ("clip-path", "mask") if given.get(name, "none") != "none"}
        if tag not in SHAPES | {"svg", "g", "a", "switch", "use", "symbol"} or (tag == "symbol" and "use" not in more):
            return
        whole = (*view, (0.5 * (view[0] ** 2 + view[1] ** 2)) ** 0.5)
        at = {n: self._length(given[n], whole[i]) for n, i in SIZES.items() if _LENGTH.fullmatch(given.get(n, ""))}
        made = SubElement(parent, tag if tag in SHAPES else "g", {k: given[k] for k in ("class", "id") if k in given})
        made.set("style", ";".join(f"{k}:{given[k]}" for k in sorted(STYLES & set(given))))
        made.set("transform", self._moves(given))
        if tag in SHAPES:
            made.attrib |= {n: repr(x) for n, x in at.items()} | {k: given[k] for k in ("d", "points") if k in given}
            return
        children, inner = list(element), {}
        if tag == "use":
            moves = f"translate({at.get('x', 0.0)!r},{at.get('y', 0.0)!r})"
            target = given.get("href", given.get("{http://www.w3.org/1999/xlink}href", "")).removeprefix("#")
            children = [self.named[target]] if target in self.named else []
            if children and _tag(children[0]) in ("svg", "symbol"):
                inner = {"use": ""} | {name: given[name] for name in ("width", "height") if name in given}
        elif tag in ("svg", "symbol"):
            moves, view = _viewport(at, view, _box(given), given.get("preserveAspectRatio", "xMidYMid"))
        else:
            moves = ""
            if tag == "switch":  # the first part whose conditions hold
                fit = (e for e in element if _tag(e) and not e.get("requiredExtensions"))
                children = [e for e in fit if "en" in e.get("systemLanguage", "en")][:1]
        moved = SubElement(made, "g", {"transform": moves})  # apart from what a style sheet may move
        for child in children:
            self._draw(moved, child, view, inner)

    def _length(self, text: str, whole: float = 0.0) -> float:
        """A length in the units of ``root``; ``whole`` is what 100 % are."""
        found = _LENGTH.fullmatch(text)
        unit = (found[2] or "px").lower() if found else ""
        scale = 0.01 * whole if unit == "%" else 1.0 if unit == "px" else UNITS.get(unit, 0.0) / self.unit
        return float(found[1]) * scale if found else 0.0

    def _plain(self, text: str) -> str:
        return _LENGTH.sub(lambda found: repr(self._length(found[0], 1.0)) if found[2] else found[0], text)

    def _moves(self, given: Mapping[str, str]) -> str:
        """The transform about its origin."""
        x, y, *_ = [*map(self._length, given.get("transform-origin", "").split()), 0.0, 0.0]
        return f"translate({x!r},{y!r}) {self._plain(given.get('transform', ''))} translate({-x!r},{-y!r})"

    def _sheet(self, style: Element) -> Element:
        """A style sheet with plain lengths; names selectors that svgelements does not know if they decide what is drawn."""
        made, text = Element("style"), re.sub(r"/\*.*?\*/", "", "".join(style.itertext()), flags=re.DOTALL)
        rules = re.findall(r"([^{}]+)\{([^{}]*)\}", text)
        foreign = {
            rule.strip() for rule, body in rules if _DECIDES.search(body) and not _SELECTORS.fullmatch(rule.strip())
        }
        self.outside |= {f"style of {rule}" for rule in foreign}
        made.text = self._plain(text)
        return made


def _tag(element: Element) -> str:
    """The name of an element of SVG; "" of others."""
    space, _, name = str(element.tag).rpartition("}")
    return name if space in ("", "{http://www.w3.org/2000/svg") else ""


def _given(element: Element) -> dict[str, str]:
    """Attributes, and over them what the element's own style says."""
    pairs = (p.partition(":") for p in element.get("style", "").split(";"))
    given = element.attrib | {k.strip(): v.replace("!important", "") for k, _, v in pairs if v}
    return {k: v.strip() for k, v in given.items()}


def _box(given: Mapping[str, str]) -> list[float]:
    """The viewBox; nothing if it has no area."""
    box = [float(x) for x in re.split(r"[\s,]+", given.get("viewBox", "")) if x]
    return box if len(box) == 4 and box[2] > 0.0 and box[3] > 0.0 else []


def _viewport(
    at: Mapping[str, float], view: Sequence[float], box: Sequence[float], aspect: str
) -> tuple[str, Sequence[float]]:
    """The transform of a drawing within a drawing, and the size of its viewport."""
    from svgelements import Viewbox

    x, y = at.get("x", 0.0), at.get("y", 0.0)
    size = at.get("width", view[0]), at.get("height", view[1])
    if not box:
        return f"translate({x!r},{y!r})", size
    return Viewbox.viewbox_transform(x, y, *size, *box, " ".join(aspect.replace("defer", "").split())), box[2:]
