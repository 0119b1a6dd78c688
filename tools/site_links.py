"""Check of the links in a folder of HTML pages: files, anchors, pictures, scripts. External addresses are only listed."""

from __future__ import annotations

import re
from dataclasses import dataclass
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LOADED = {"src", "poster", "data"}  # attributes whose address a browser asks for by itself
CSS_URL = re.compile(r"url\(\s*['\"]?(?!data:)([^'\")]+)|@import\s+['\"]([^'\"]+)")


@dataclass(frozen=True)
class Found:
    """Links of a folder's pages.

    count : links within the folder; broken : those that lead nowhere, as "page: link"; elsewhere : addresses that a person may follow
    loaded : addresses elsewhere that a browser would ask for by itself
    """

    count: int
    broken: tuple[str, ...]
    elsewhere: tuple[str, ...]
    loaded: tuple[str, ...]


class _Page(HTMLParser):
    """The anchors of a page, its links, and what it loads."""

    def __init__(self, text: str):
        super().__init__()
        self.anchors, self.links, self.loads = {"", "top"}, list[str](), list[str]()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if value is None:
                continue
            if name == "id" or (tag == "a" and name == "name"):
                self.anchors.add(value)
            elif name in LOADED or (tag == "link" and name == "href" and ("rel", "canonical") not in attrs):
                self.loads.append(value)
            elif name == "href":
                self.links.append(value)
            elif name == "srcset":
                self.loads += [part.split()[0] for part in value.split(",")]


def check(folder: Path) -> Found:
    """All links of all pages and style sheets in a folder."""
    pages = {path: _Page(path.read_text(encoding="utf-8")) for path in sorted(folder.rglob("*.html"))}
    count, broken, elsewhere, loaded = 0, list[str](), set[str](), set[str]()
    for path, page in pages.items():
        for link in page.links + page.loads:
            where = urlsplit(link)
            if where.scheme or where.netloc:
                if where.scheme not in ("data", "mailto", "javascript"):
                    (loaded if link in page.loads else elsewhere).add(link)
                continue
            count += 1
            target = (path.parent / unquote(where.path)).resolve() if where.path else path
            target = target / "index.html" if target.is_dir() else target
            anchors = pages[target].anchors if target in pages else None
            lost = anchors is not None and unquote(where.fragment) not in anchors
            if not target.is_file() or not target.is_relative_to(folder.resolve()) or lost:
                broken.append(f"{path.relative_to(folder)}: {link}")
    for path in sorted(folder.rglob("*.css")):
        for one, two in CSS_URL.findall(path.read_text(encoding="utf-8")):
            link = (one or two).strip()
            if urlsplit(link).netloc:
                loaded.add(link)
            elif not link.startswith("#"):
                count += 1
                if not (path.parent / unquote(urlsplit(link).path)).is_file():
                    broken.append(f"{path.relative_to(folder)}: {link}")
    return Found(count, tuple(broken), tuple(sorted(elsewhere)), tuple(sorted(loaded)))
