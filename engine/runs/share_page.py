"""The piece in 3D as a page: in the report, and alone as ``share.html``, to be sent to somebody.

Both hold everything that they need: the piece as JSON (``page_data``), three.js, and the scripts of the folder ``page``. The
page forbids its own browser to fetch anything, and to run any script but these.
"""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

from .. import MARK
from ..display.drawing import FONT, Drawing, svg
from ..fabrication.estimates import duration
from ..surface.checking.finding import counted

SHARE = "share.html"
FOLDER = Path(__file__).with_name("page")
# three.js, made by tools/page_library.py, and what is written for the page, in this order: the last one begins
SCRIPTS = ("three.min.js", "packed.js", "turns.js", "skin.js", "scene.js", "view.js")
# the plots that stand for the view where a browser draws none, the best first
INSTEAD = ("shape", "surface", "patches")


def environment() -> Any:
    """The templates of the folder ``page``."""
    import jinja2

    made = jinja2.Environment(
        loader=jinja2.FileSystemLoader(FOLDER), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    made.globals |= {"font": FONT, "mark": MARK}
    made.filters |= {"duration": duration}
    return made


def scripts() -> list[str]:
    """The texts of the scripts."""
    found = [(FOLDER / name).read_text(encoding="utf-8") for name in SCRIPTS]
    assert not any("</script" in text or "<!--" in text for text in found)
    return found


def policy(texts: Sequence[str] = ()) -> str:
    """What a page with these scripts allows its browser, as a Content-Security-Policy: no request, and no other script."""
    hashes = "".join(f" 'sha256-{b64encode(sha256(text.encode()).digest()).decode()}'" for text in texts)
    return (
        f"default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; script-src{hashes or ' ' + repr('none')}"
    )


def page(
    piece: str,
    title: str,
    described: Mapping[str, Any],
    drawn: Mapping[str, Drawing],
    pictures: Sequence[str] = INSTEAD,
) -> str:
    """The page as HTML text.

    piece : from ``page_data.text``; described : the report, for the line of figures; drawn : plots by name, of which some stand in
    where a browser draws no 3D
    """
    texts = scripts()
    shown = [name for name in pictures if name in drawn][:2]
    return str(
        environment()
        .get_template("share.html.j2")
        .render(
            piece=piece, title=title, scripts=texts, policy=policy(texts), facts=facts(described),
            pictures=[svg(drawn[name]) for name in shown], steps=steps_in_words(piece),
        )
    )  # fmt: skip


def steps_in_words(piece: str) -> list[str]:
    """What is done in every step of the assembly, for paper; ``piece`` is from ``page_data.text``."""
    held = json.loads(piece)
    names = {panel["step"]: panel["name"] for panel in held["panels"]}
    found = []
    for step, seams in enumerate(held["seams"]):
        parts = []
        for seam in seams:
            count = len(seam["joints"])
            where = "within the panel" if seam["other"] is None else f"to panel {seam['other']}"
            parts.append(f"{seam['name']} {where} ({count} joint{'s' * (count != 1)})")
        verb = "Add" if any(seam["other"] is not None for seam in seams) else "Take"
        found.append(
            f"{verb} panel {names.get(step, '')}"
            + (f": seam{'s' * (len(parts) > 1)} {', '.join(parts)}" if parts else "")
        )
    return found


def facts(described: Mapping[str, Any]) -> list[str]:
    """A line of figures for somebody who looks at the piece: its size, of how many panels and of what it is made."""
    found = []
    source, shape, sheets = (described.get(name, {}) for name in ("input", "equilibrium", "sheets"))
    if source:
        found.append(" \N{MULTIPLICATION SIGN} ".join(f"{x:.0f}" for x in source["size_mm"]) + " mm")
    panels, count = described.get("layout", {}).get("patches"), described.get("spirals", {}).get("count")
    if panels and count:
        found.append(f"{counted(panels, 'panel', 'panels')}, {counted(count, 'spiral', 'spirals')}")
    settings = described.get("settings", {})
    if settings:
        found.append(", ".join([*([shape["material"]] if shape else []), f"{settings['spiral']['thickness']:g} mm"]))
    if shape:
        found.append(f"{shape['rms_percent']:.2g} % RMS from the target")
    if sheets.get("mass_g"):
        found.append(f"{sheets['mass_g']:.0f} g")
    return found
