"""Write ``share.html``, a page with the piece in 3D to send to others, and the parts that the report's page has too.

Both pages are self-contained: they hold the piece as JSON (``page_data``), three.js and the scripts in the folder
``page``. Their content security policy forbids the browser to fetch anything or to run other scripts.
"""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

from .. import MARK
from ..display.drawing import FONT, Drawing, to_svg
from ..extras import registry
from ..fabrication.estimates import format_duration
from ..figures import format_figure
from ..surface.checking.finding import with_count

SHARE = "share.html"
FOLDER = Path(__file__).with_name("page")
# three.js, made by tools/page_library.py, then the page's own scripts, each after the scripts that it needs; the last
# one starts the view
SCRIPTS = ("three.min.js", "packed.js", "turns.js", "skin.js", "scene.js", "view.js")
# names of the plots to show in browsers without 3D, in order of preference
REPLACED_PLOTS = ("shape", "surface", "patches")


def environment() -> Any:
    """Return the Jinja environment for the templates in the folder ``page`` and in the folders of the extras."""
    import jinja2

    loader = jinja2.FileSystemLoader([FOLDER, Path(registry.__file__).parent])
    made = jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    made.globals |= {"font": FONT, "mark": MARK}
    made.filters |= {"duration": format_duration, "figure": format_figure}
    return made


def scripts() -> list[str]:
    """Return the texts of the scripts in ``SCRIPTS``, in this order."""
    found = [(FOLDER / name).read_text(encoding="utf-8") for name in SCRIPTS]
    assert not any("</script" in text or "<!--" in text for text in found)
    return found


def policy(texts: Sequence[str] = ()) -> str:
    """Return a page's Content-Security-Policy; it forbids requests, and all scripts but those with these texts."""
    hashes = "".join(f" 'sha256-{b64encode(sha256(text.encode()).digest()).decode()}'" for text in texts)
    return (
        f"default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; script-src{hashes or ' ' + repr('none')}"
    )


def render_share_page(
    piece: str,
    title: str,
    described: Mapping[str, Any],
    drawn: Mapping[str, Drawing],
    pictures: Sequence[str] = REPLACED_PLOTS,
) -> str:
    """Return the page as HTML text.

    Parameters
    ----------
    piece : data of the 3D view, from ``page_data.to_json``
    title : name of the piece
    described : the report, whose key figures the page shows
    drawn : plots by name
    pictures : names of plots to show in browsers without 3D, in order of preference; the first two that exist are used
    """
    texts = scripts()
    shown = [name for name in pictures if name in drawn][:2]
    return str(
        environment()
        .get_template("share.html.j2")
        .render(
            piece=piece, title=title, scripts=texts, policy=policy(texts), facts=key_figures(described),
            pictures=[to_svg(drawn[name]) for name in shown], steps=steps_in_words(piece),
        )
    )  # fmt: skip


def steps_in_words(piece: str) -> list[str]:
    """Return a sentence for every step of the assembly, for the printed page; piece : from ``page_data.to_json``."""
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


def key_figures(described: Mapping[str, Any]) -> list[str]:
    """Return the piece's key figures as texts: size, panels, spirals, material, distance from the target, mass."""
    found = []
    source, shape, sheets = (described.get(name, {}) for name in ("input", "equilibrium", "sheets"))
    if source:
        found.append(" \N{MULTIPLICATION SIGN} ".join(f"{x:.0f}" for x in source["size_mm"]) + " mm")
    panels, count = described.get("layout", {}).get("patches"), described.get("spirals", {}).get("count")
    if panels and count:
        found.append(f"{with_count(panels, 'panel', 'panels')}, {with_count(count, 'spiral', 'spirals')}")
    settings = described.get("settings", {})
    if settings:
        found.append(", ".join([*([shape["material"]] if shape else []), f"{settings['spiral']['thickness']:g} mm"]))
    if shape:
        found.append(f"{format_figure(shape['rms_percent'])} % RMS from the target")
    if sheets.get("mass_g"):
        found.append(f"{sheets['mass_g']:.0f} g")
    return found
