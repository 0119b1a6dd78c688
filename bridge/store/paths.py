"""Folders and names of an object's files."""

from __future__ import annotations

import unicodedata
from glob import escape
from itertools import count
from pathlib import Path

import bpy

from ...engine import files
from ...engine.errors import FlexMapsError
from .settings import is_relative_to_unsaved


def resolve_folder(text: str) -> Path:
    """Return the folder named by a setting; raise ``FlexMapsError`` if empty, or relative to an unsaved .blend file."""
    if is_relative_to_unsaved(text):
        raise files.FolderError("Save the .blend file first, or choose a folder that does not begin with //")
    if not text.strip():
        raise files.FolderError("Choose a folder for the files")
    return Path(bpy.path.abspath(text))


def file_name(name: str) -> str:
    """Return a file name for an object that differs from those of all other meshes of this .blend file.

    Two object names can yield the same file name, such as a.b and a_b; on Windows and macOS also names that differ only
    in case or in how an accent is encoded. All but the first such name, in alphabetical order, get a number.
    """
    taken = set[str]()
    for other in sorted({name} | {o.name for o in bpy.data.objects if o.type == "MESH"}):
        numbers = (_safe_name(other) if number == 1 else f"{_safe_name(other)}_{number}" for number in count(1))
        own = next(free for free in numbers if _normalise(free) not in taken)
        if other == name:
            return own
        taken.add(_normalise(own))
    raise AssertionError("the name itself is among them")


def _normalise(name: str) -> str:
    """Normalise the case and the encoding of accents, in which Windows and macOS see no difference."""
    return unicodedata.normalize("NFC", name).casefold()


def _safe_name(name: str) -> str:
    return files.safe_file_name(name) or "flexmaps"


def resolve_picture(text: str, film: bool = False) -> Path:
    """Return the picture file named by a setting, with .png appended where the suffix does not fit.

    Parameters
    ----------
    text : the setting
    film : also accept a name that ends in .mp4

    Raises
    ------
    FlexMapsError if the name is empty, or relative to an unsaved .blend file.
    """
    if is_relative_to_unsaved(text):
        raise FlexMapsError("Save the .blend file first, or choose a file that does not begin with //")
    if not text.strip():
        raise FlexMapsError("Choose a file for the picture")
    path = Path(bpy.path.abspath(text))
    return (
        path if path.suffix.lower() in ({".png", ".mp4"} if film else {".png"}) else path.with_name(f"{path.name}.png")
    )


def list_pictures(path: Path) -> list[Path]:
    """Return the picture or film, followed by existing PNG frames of an earlier film of that name."""
    return [path, *(path.parent.glob(f"{escape(path.stem)}-[0-9]*.png") if path.parent.is_dir() else ())]
