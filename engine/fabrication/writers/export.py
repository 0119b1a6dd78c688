"""All the files of the sheets, written together: every format or none."""

from __future__ import annotations

from pathlib import Path

from ...errors import FlexMapsError
from ...files import NewFile, replacing_many
from ...progress import SILENT, Progress
from ..sheets import CutSheets
from . import dxf, pdf, series, svg
from . import solids as solid_files

# R12 is the DXF that every program reads, R2010 the one that knows its units; the solids are large
FLAT = ("svg", "dxf", "dxf-r12", "pdf")
SOLID = ("stl", "3mf")
FORMATS = FLAT + SOLID


def write(
    sheets: CutSheets,
    base: Path,
    formats: tuple[str, ...] = FLAT,
    new: NewFile | None = None,
    progress: Progress = SILENT,
) -> list[Path]:
    """Write every sheet in every format: base out/sheet gives out/sheet-01.svg, out/sheet-01.dxf, out/sheet-r12-01.dxf, ...

    Files of an earlier run with more sheets go. ``new`` comes from ``files.replacing_many`` where the files shall appear
    together with others. Raises ``FlexMapsError`` for an unknown format, for none, or where files cannot be written.
    """
    unknown = set(formats) - set(FORMATS)
    if unknown or not formats:
        wrong = f"There is no format '{min(unknown)}'" if unknown else "No format is chosen"
        raise FlexMapsError(f"{wrong}; choose among {', '.join(FORMATS)}")
    if new is None:
        with replacing_many(stale(base, sheets.count), base.parent) as new:
            return write(sheets, base, formats, new, progress)
    written: list[Path] = []
    wanted = [key for key in FORMATS if key in formats]
    for number, key in enumerate(wanted):
        part, target = progress.part(number / len(wanted), (number + 1) / len(wanted)), _named(base, key)
        if key == "svg":
            written += svg.write(sheets, target, new, part)
        elif key in {"dxf", "dxf-r12"}:
            written += dxf.write(sheets, target, "R12" if key == "dxf-r12" else "R2010", new, part)
        elif key == "pdf":
            written += pdf.write(sheets, target, new, part)
        else:
            written += solid_files.write(sheets, target, new, part)
    return written


def stale(base: Path, count: int) -> list[Path]:
    """The files of an earlier run that had more sheets than ``count``."""
    return [path for key in FORMATS for path in series.numbered_before(_named(base, key), count)]


def _named(base: Path, key: str) -> Path:
    return base.with_name(base.name + "-r12.dxf" if key == "dxf-r12" else f"{base.name}.{key}")
