"""Resolve the attributes and style properties of the elements of an SVG document.

CSS Cascading 4 and Selectors 3; pseudo-classes that depend on user action or on counting are not read.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from xml.etree.ElementTree import Element

# properties that affect which lines are drawn
_AFFECTS_DRAWING = re.compile(
    r"(?<![\w-])(display|visibility|opacity|transform|translate|rotate|scale|width|height|[cr]?[xyr])\s*:"
)
_COMMENT = re.compile(r"/\*.*?\*/|<!--|-->", re.DOTALL)
_COMBINATOR = re.compile(r"\s*([>+~])\s*(?![^\[]*\])|\s+(?![^\[]*\])")
# groups: type, id, class, attribute, its relation, its value, pseudo-class
_SIMPLE = re.compile(
    r"([\w-]+|\*)|#([\w-]+)|\.([\w-]+)|\[\s*([\w:-]+)\s*(?:([~|^$*]?=)\s*[\"']?([^\"'\]]*?)[\"']?\s*)?\]|:(root|first-child|last-child)"
)
_RELATIONS = {
    "=": lambda has, wants: has == wants,
    "~=": lambda has, wants: wants in has.split(),
    "|=": lambda has, wants: has == wants or has.startswith(wants + "-"),
    "^=": lambda has, wants: bool(wants) and has.startswith(wants),
    "$=": lambda has, wants: bool(wants) and has.endswith(wants),
    "*=": lambda has, wants: bool(wants) and wants in has,
}
Property = tuple[bool, str, str]  # important or not, name, value
Weight = tuple[int, int, int]  # specificity of CSS
OWN_STYLE = (9999, 0, 0)  # weight of an element's own style, above that of any selector
Selector = list[str | None]  # compound selectors, alternating with combinators; None stands for a descendant


class Styles:
    """The style sheets of a document.

    unread : rules that affect the lines drawn but are not read
    """

    def __init__(self, document: Element):
        self.above = {child: parent for parent in document.iter() for child in parent}
        self.unread: set[str] = set()
        self.rules: list[tuple[Selector, Weight, list[Property]]] = []
        for style in document.iter():
            if tag_of(style) == "style" and _on_screen(style.get("media", "all")):
                self._read(_COMMENT.sub("", "".join(style.itertext())))

    def given(self, element: Element) -> dict[str, str]:
        """Return an element's attributes overridden by its properties; later in order: weight, own style, importance."""
        found = [
            (important, weight, order, name, value)
            for order, (selector, weight, properties) in enumerate(self.rules)
            if self._matches(element, selector)
            for important, name, value in properties
        ]
        own = [(important, OWN_STYLE, 0, name, value) for important, name, value in _declared(element.get("style", ""))]
        found = sorted(found + own, key=lambda one: one[:3])
        return element.attrib | {name: value for *_, name, value in found}

    def _read(self, text: str) -> None:
        """Add the rules of a style sheet."""
        for head, body in _blocks(text):
            if head.startswith("@media") and _on_screen(head[6:]):
                self._read(body)
            elif head.startswith("@"):
                if head.startswith("@media") and "print" not in head and _AFFECTS_DRAWING.search(body):
                    self.unread.add(head)
            else:
                for text in map(str.strip, head.split(",")):
                    selector = _COMBINATOR.split(text)
                    if all(re.fullmatch(f"(?:{_SIMPLE.pattern})+", part) for part in selector[::2] if part is not None):
                        self.rules.append((selector, _weight(selector), list(_declared(body))))
                    elif _AFFECTS_DRAWING.search(body):
                        self.unread.add(f"style of {text}")

    def _matches(self, element: Element, selector: Selector) -> bool:
        """Return whether an element matches a selector."""
        if not self._matches_compound(element, str(selector[-1])):
            return False
        return len(selector) == 1 or any(
            self._matches(e, selector[:-2]) for e in self._relatives(element, selector[-2])
        )

    def _relatives(self, element: Element, combinator: str | None) -> Iterator[Element]:
        """Yield the elements that a combinator relates to an element."""
        parent = self.above.get(element)
        if parent is None:
            return
        if combinator in ("+", "~"):
            before = list(parent)[: list(parent).index(element)]
            yield from before[-1:] if combinator == "+" else before
            return
        yield parent
        if combinator is None:
            yield from self._relatives(parent, None)

    def _matches_compound(self, element: Element, compound: str) -> bool:
        """Return whether an element matches a compound selector."""
        for kind, name, group, attribute, relation, wants, pseudo in _SIMPLE.findall(compound):
            siblings = list(self.above.get(element, [element]))
            has = element.get(attribute) if attribute else None
            if (
                (kind and kind not in ("*", tag_of(element)))
                or (name and element.get("id") != name)
                or (group and group not in element.get("class", "").split())
                or (attribute and (has is None or (relation and not _RELATIONS[relation](has, wants))))
                or (pseudo == "root" and element in self.above)
                or (pseudo == "first-child" and siblings[0] is not element)
                or (pseudo == "last-child" and siblings[-1] is not element)
            ):
                return False
        return True


def tag_of(element: Element) -> str:
    """Return the local name of an SVG element; "" for other elements."""
    space, _, name = str(element.tag).rpartition("}")
    return name if space in ("", "{http://www.w3.org/2000/svg") else ""


def _on_screen(media: str) -> bool:
    """Return whether a media list applies to screens."""
    return any(one.split() and one.split()[-1] in ("all", "screen") for one in media.lower().split(","))


def _blocks(text: str) -> Iterator[tuple[str, str]]:
    """Yield the head of every rule and the text inside its braces, which may contain rules."""
    start = depth = 0
    head = ""
    for place, sign in enumerate(text):
        if sign == ";" and not depth:
            start = place + 1  # skip statements such as @import
        elif sign == "{":
            depth += 1
            if depth == 1:
                head, start = text[start:place].strip(), place + 1
        elif sign == "}" and depth:
            depth -= 1
            if not depth:
                yield head, text[start:place]
                start = place + 1


def _declared(body: str) -> Iterator[Property]:
    """Yield for every property of a rule whether it is important, its name and its value."""
    for text in _COMMENT.sub("", body).split(";"):
        name, _, value = text.partition(":")
        value, important, _ = value.partition("!")
        if value:
            yield bool(important), name.strip().lower(), value.strip()


def _weight(selector: Selector) -> Weight:
    """Return the specificity: numbers of ids, of classes and attributes, and of types."""
    found = [one for part in selector[::2] for one in _SIMPLE.findall(str(part))]
    return (
        sum(bool(one[1]) for one in found),
        sum(bool(one[2] or one[3] or one[6]) for one in found),
        sum(one[0] not in ("", "*") for one in found),
    )
