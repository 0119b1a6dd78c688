"""Write sheets to files in the requested formats: either all files are written, or none."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Collection
from pathlib import Path
from typing import NamedTuple

from ...errors import FlexMapsError
from ...files import NewFile, describe_error, write_all_atomically
from ...params import ExportParams
from ...progress import SILENT, Progress
from ..sheets import CutSheets
from . import dxf, numbered_files, panel_solids, pdf, svg


class Format(NamedTuple):
    """A file format, written as one file per sheet.

    ending : text after the base of the file's name; the number of the sheet is inserted before its last dot
    setting, values : name of a setting of ``ExportParams``, and those of its values that select the format
    write : function that writes a sheet
    is_default : whether scripts and the command line write this format by default
    """

    ending: str
    setting: str
    values: Collection[str | bool]
    write: Callable[[CutSheets, int, Path, Progress], None]
    is_default: bool = False


# DXF is offered twice: every program reads R12, but only R2010 stores its units
FORMAT_TABLE = {
    "svg": Format(".svg", "svg", {True}, svg.write_svg, is_default=True),
    "dxf": Format(".dxf", "dxf", {"R2010", "BOTH"}, dxf.write_dxf, is_default=True),
    "dxf-r12": Format("-r12.dxf", "dxf", {"R12", "BOTH"}, dxf.write_dxf_r12, is_default=True),
    "pdf": Format(".pdf", "pdf", {True}, pdf.write_pdf, is_default=True),
    "stl": Format(".stl", "solids", {"STL", "BOTH"}, panel_solids.write_stl),
    "3mf": Format(".3mf", "solids", {"3MF", "BOTH"}, panel_solids.write_3mf),
}
FORMATS = tuple(FORMAT_TABLE)
DEFAULT_FORMATS = tuple(key for key, kind in FORMAT_TABLE.items() if kind.is_default)


def chosen_formats(params: ExportParams) -> tuple[str, ...]:
    """Return the formats selected by the settings; raises ``FlexMapsError`` if there are none."""
    formats = tuple(key for key, kind in FORMAT_TABLE.items() if getattr(params, kind.setting) in kind.values)
    if not formats:
        raise FlexMapsError("No kind of file is chosen; switch SVG, DXF or PDF on")
    return formats


def write_sheets(
    sheets: CutSheets,
    base: Path,
    formats: tuple[str, ...] = DEFAULT_FORMATS,
    new: NewFile | None = None,
    progress: Progress = SILENT,
) -> list[Path]:
    """Write every sheet in every format: base out/sheet gives out/sheet-01.svg, out/sheet-r12-01.dxf, ...

    Surplus files of an earlier run with more sheets are removed.

    Parameters
    ----------
    sheets : the sheets
    base : path of the files without number and ending
    formats : keys of ``FORMAT_TABLE``
    new : function from ``files.write_all_atomically`` that names a file to write, if these files must appear together
        with others; None if they only appear together with each other
    progress : called with the fraction done; may cancel

    Returns
    -------
    Paths of the written files

    Raises
    ------
    FlexMapsError : a format is unknown, no format is given, or a file cannot be written
    """
    unknown = set(formats) - set(FORMATS)
    if unknown or not formats:
        wrong = f"There is no format '{min(unknown)}'" if unknown else "No format is chosen"
        raise FlexMapsError(f"{wrong}; choose among {', '.join(FORMATS)}")
    if new is None:
        with write_all_atomically(surplus_files(base, sheets.count), base.parent) as new:
            return write_sheets(sheets, base, formats, new, progress)
    wanted = [key for key in FORMATS if key in formats]
    files = [
        (FORMAT_TABLE[key], index, path)
        for key in wanted
        for index, path in enumerate(numbered_files.numbered_paths(_unnumbered_path(base, key), sheets.count))
    ]
    for number, (kind, index, path) in enumerate(files):
        kind.write(sheets, index, new(path), progress.part(number / len(files), (number + 1) / len(files)))
    return [path for _, _, path in files]


def surplus_files(base: Path, count: int) -> list[Path]:
    """Return the surplus files of an earlier run that had more sheets than ``count``, in all formats.

    Parameters
    ----------
    base : path of the files without number and suffix
    count : number of sheets of this run
    """
    return [path for key in FORMATS for path in numbered_files.surplus_paths(_unnumbered_path(base, key), count)]


def existing_files(base: Path, formats: Collection[str]) -> list[Path]:
    """Return existing files that a run with these formats may replace, for any number of sheets.

    Parameters
    ----------
    base : path of the files without number and suffix
    formats : keys of ``FORMAT_TABLE``

    Raises
    ------
    FlexMapsError : the folder cannot be read
    """
    try:
        names = sorted(os.listdir(base.parent))
    except (FileNotFoundError, NotADirectoryError):
        names = []
    except OSError as error:
        raise FlexMapsError(f"Cannot look into the folder {base.parent}: {describe_error(error)}") from None
    found = []
    for key in FORMAT_TABLE.keys() & set(formats):
        series_of = _unnumbered_path(base, key)
        numbers = re.compile(rf"{re.escape(series_of.stem)}-(\d\d+){re.escape(series_of.suffix)}", re.IGNORECASE)
        matches = [match for match in map(numbers.fullmatch, names) if match is not None]
        found += [base.with_name(f"{series_of.stem}-{match[1]}{series_of.suffix}") for match in matches]
    others = [base.with_name(f"{base.name}-{rest}") for rest in ("parts.csv", "assembly.pdf") if formats]
    return [path for path in dict.fromkeys([*found, *others]) if os.path.lexists(path)]


def _unnumbered_path(base: Path, key: str) -> Path:
    """Return the path of the files of a format, without the number of the sheet."""
    return base.with_name(base.name + FORMAT_TABLE[key].ending)
