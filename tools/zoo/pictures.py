"""Small pictures of the results of a job, and a page that shows the pictures of all surfaces side by side."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
from flexmaps.engine.display.drawing import Drawing, FilledShapes, Strokes
from flexmaps.engine.runs import job, report_page
from PIL import Image, ImageDraw

SHOWN = ("surface", "patches", "shape")  # of the plots of a run: patches on the surface, flat, distance to the target
SIZE, FINE, COLOURS = (200, 150), 3, 48  # pixels of a picture, as many for one while it is drawn, colours that are kept
STYLE = """
body { font: 13px system-ui, sans-serif; color: #262b33; margin: 16px }
table { border-collapse: collapse; margin: 8px 0 20px } td, th { padding: 2px 14px 2px 0; text-align: left }
.no { color: #b3261e; font-weight: 600 }
.all { display: flex; flex-wrap: wrap; gap: 10px }
.one { width: 600px; border: 1px solid #d5d9df; border-radius: 6px; padding: 6px 8px; box-sizing: content-box }
.one.bad { border: 2px solid #b3261e } .one img { width: 600px; height: 150px; display: block }
.one b { font-size: 14px } .one p { margin: 2px 0 }
"""


def strip(result: job.Result, distortion: float) -> bytes:
    """A PNG of the plots in ``SHOWN`` beside each other; white where a stage did not run."""
    made = report_page.draw_plots(result, {}, distortion)
    whole = Image.new("RGB", (SIZE[0] * len(SHOWN), SIZE[1]), "white")
    for k, name in enumerate(SHOWN):
        if name in made:
            picture = _drawn(made[name])
            x, y = ((room - taken) // 2 for room, taken in zip(SIZE, picture.size))
            whole.paste(picture, (k * SIZE[0] + x, y))
    stream = io.BytesIO()
    whole.quantize(COLOURS).save(stream, "PNG", optimize=True)
    return stream.getvalue()


def _drawn(drawing: Drawing) -> Image.Image:
    """The shapes and outlines of a drawing, without its words, as large as a picture may be."""
    shapes = [item for item in drawing.items if isinstance(item, FilledShapes | Strokes)]
    points = np.concatenate([(s.points if isinstance(s, FilledShapes) else s.ends).reshape(-1, 2) for s in shapes[:-1]])
    low, high = points.min(axis=0), points.max(axis=0)
    factor = FINE * float(np.min((np.array(SIZE) - 6) / np.maximum(high - low, 1e-9)))
    width, height = np.ceil((high - low) * factor).astype(int) + 2 * FINE
    picture = Image.new("RGB", (int(width), int(height)), "white")
    pen = ImageDraw.Draw(picture)
    for item in shapes:
        if isinstance(item, FilledShapes):
            for outline, fill in zip((item.points - low) * factor + FINE, (255 * item.fills).astype(int).tolist()):
                pen.polygon([tuple(p) for p in outline.tolist()], fill=tuple(fill))
        else:
            for ends in ((item.ends - low) * factor + FINE).tolist():
                pen.line([tuple(p) for p in ends], fill=(38, 43, 51), width=2)
    return picture.resize((max(int(width) // FINE, 1), max(int(height) // FINE, 1)), Image.Resampling.LANCZOS)


def page(rows: Sequence[Mapping[str, Any]], cards: Sequence[tuple[str, str, str, bytes | None]], made: str) -> str:
    """The page: the summary's rows, then a card a surface, those with something wrong first.

    cards : name, figures, what is wrong with it (may be empty), its picture
    """
    lines = [
        "<!doctype html><html lang=en><meta charset=utf-8><title>Zoo</title>",
        f"<style>{STYLE}</style><h1>{len(cards)} surfaces</h1><p>{escape(made)}</p>",
        "<table><tr><th>figure<th>asked<th>measured<th></tr>",
    ]
    for row in rows:
        mark = {True: "yes", False: "<span class=no>no</span>", None: ""}[row["ok"]]
        cells = "".join(f"<td>{escape(str(row[key]))}" for key in ("row", "asked", "measured"))
        lines.append(f"<tr>{cells}<td>{mark}</tr>")
    lines.append("</table><div class=all>")
    for name, figures, wrong, picture in sorted(cards, key=lambda card: not card[2]):
        lines.append(f"<div class='one{' bad' if wrong else ''}'><p><b>{escape(name)}</b> {escape(figures)}</p>")
        if wrong:
            lines.append(f"<p class=no>{escape(wrong)}</p>")
        if picture is not None:
            code = base64.b64encode(picture).decode()
            lines.append(f"<img alt='' src='data:image/png;base64,{code}'>")
        lines.append("</div>")
    return "\n".join([*lines, "</div></html>"]) + "\n"
