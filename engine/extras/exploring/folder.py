"""Store an exploration in a folder: a line for every candidate as it is tried, and at the end a table, a plot and pictures."""

from __future__ import annotations

import csv
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from ... import files
from ...display.drawing import GREY, INK, Dots, Drawing, Text, svg, ticks
from ...display.plots import ACCENT, CURVE, Axes
from ...errors import FlexMapsError
from ...own_files import Guard
from .candidate import Candidate, ExplorationInput
from .explore import Exploration
from .space import MEASURES, SECTIONS, Space

JOURNAL_FILE = "tried.jsonl"  # JSON lines: the first identifies piece and variables, one follows for every candidate
TABLE, REPORT, PLOT = "candidates.csv", "explore.json", "front.svg"
AXIS_MARGIN = 0.08  # free space at both ends of an axis, as a share of its values' range; chosen by eye


class Folder:
    """Folder of an exploration; ``known`` : candidates that are stored in it.

    Parameters
    ----------
    path : made if it does not exist
    base, space : piece and variables, which must be those of an exploration that is already there
    guard : keeps the user's files in the folder

    Raises
    ------
    FlexMapsError : the folder cannot be used, or holds the exploration of another piece or of other variables
    """

    def __init__(self, path: str | Path, base: ExplorationInput, space: Space, guard: Guard | None = None):
        self.path, self.guard = Path(path), guard
        if guard is not None:
            refuse_to_replace(self.path, guard)
        self.known: list[Candidate] = []
        mark = {"of": _fingerprint(base), "varied": [variable.name for variable in space.variables]}
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            lines = (
                (self.path / JOURNAL_FILE).read_text(encoding="utf-8").splitlines()
                if (self.path / JOURNAL_FILE).exists()
                else []
            )
        except (OSError, ValueError) as error:
            raise FlexMapsError(f"{self.path}: {files.describe_error(error)}") from None
        if lines and _parse(lines[0]) != mark:
            raise FlexMapsError(f"Another piece or other variables were explored in {self.path}; give another folder")
        for line in lines[1:]:
            row = _parse(line)
            if isinstance(row, dict) and row.keys() == {"values", "measures", "advice", "fault", "picture"}:
                self.known.append(Candidate(**row))
        try:
            self._stream = (self.path / JOURNAL_FILE).open("a", encoding="utf-8")
        except OSError as error:
            raise FlexMapsError(f"{self.path}: {files.describe_error(error)}") from None
        self._append("" if not lines else "\n")  # ends a line that an earlier run has written by half
        if not lines:
            self._append(json.dumps(mark) + "\n")

    def __enter__(self) -> Folder:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    def add(self, one: Candidate) -> None:
        """Append a candidate to the file."""
        self._append(json.dumps(vars(one)) + "\n")

    def write(self, made: Exploration) -> dict[str, Any]:
        """Write the table, the report, the plot of the front and a picture of every candidate; return the report."""
        described, front = made.report(), made.front
        with files.write_all_atomically(
            self.path.glob("candidate-*.svg"), None if self.guard is None else self.path, self.guard
        ) as new:
            names = [variable.name for variable in made.space.variables]
            with new(self.path / TABLE).open("w", newline="", encoding="utf-8") as stream:
                table = csv.DictWriter(stream, ["number", "front", *names, *MEASURES, "advice", "fault"])
                table.writeheader()
                for number, one in enumerate(made.candidates):
                    row = {"number": number, "front": int(one in front), **one.row()}
                    table.writerow({name: escape_formula(value) for name, value in row.items()})
            new(self.path / REPORT).write_text(json.dumps(described, indent=2) + "\n", encoding="utf-8")
            new(self.path / PLOT).write_text(svg(plot(made)), encoding="utf-8")
            for number, one in enumerate(made.candidates):
                if one.picture:
                    new(self.path / f"candidate-{number:03d}.svg").write_text(one.picture, encoding="utf-8")
        return described

    def _append(self, text: str) -> None:
        """Write text to the end of the file of candidates."""
        try:
            self._stream.write(text)
            self._stream.flush()
        except OSError as error:
            raise FlexMapsError(f"{self.path}: {files.describe_error(error)}") from None


def refuse_to_replace(path: Path, guard: Guard) -> None:
    """Raise FlexMapsError if an exploration in the folder ``path`` would replace files that ``guard`` keeps.

    Parameters
    ----------
    path : folder of the exploration
    guard : knows which files this program wrote
    """
    guard.check([*(path / name for name in (TABLE, REPORT, PLOT)), *path.glob("candidate-*.svg")], path)


def escape_formula(value: Any) -> Any:
    """Return a value for a table; texts that a spreadsheet would run as a formula get an apostrophe (owasp.org, CSV Injection)."""
    return f"'{value}" if isinstance(value, str) and value.startswith(("=", "+", "-", "@", "\t", "\r")) else value


def plot(made: Exploration, size: tuple[float, float] = (620, 420)) -> Drawing:
    """Draw all candidates by the two minimised measures; those of the front are highlighted and numbered. size : pixels"""
    names = made.space.minimised
    drawing = Drawing("Candidates that were tried", *size)
    rows = [one for one in made.sound if set(names) <= one.measures.keys()]
    points = np.array([[one.measures[name] for name in names] for one in rows]).reshape(-1, 2)
    spans = [_axis_range(points[:, k]) for k in range(2)]
    axes = Axes(drawing, spans[0], spans[1])
    axes.frame(MEASURES[names[0]], MEASURES[names[1]], ticks(*spans[0]), ticks(*spans[1]))
    if not rows:
        return drawing
    drawing.add(Dots(axes.at(points[:, 0], points[:, 1]), 3.0, GREY))
    for turn, one in enumerate(made.front):
        here = axes.at(*(np.array([one.measures.get(name, np.inf)]) for name in names))
        if np.isfinite(here).all():
            number = made.candidates.index(one)
            drawing.add(Dots(here, 5.0, ACCENT if number == made.best else CURVE))
            beside = 14 if turn % 2 else -6  # above and below in turn, so that numbers of neighbours do not overlap
            drawing.add(Text((float(here[0, 0]) + 5, float(here[0, 1]) + beside), str(number), 11.5, INK))
    return drawing


def _axis_range(values: np.ndarray) -> tuple[float, float]:
    """Return the ends of an axis for these values."""
    if not len(values):
        return 0.0, 1.0
    low, high = float(values.min()), float(values.max())
    free = AXIS_MARGIN * ((high - low) or abs(high) or 1.0)
    return low - free, high + free


def _fingerprint(base: ExplorationInput) -> str:
    """Return a hash that identifies the piece, its settings and the effort."""
    told = hashlib.sha256(repr([getattr(base.settings, name) for name in SECTIONS] + [base.effort]).encode())
    arrays = [base.supports, base.force]
    for _, start in sorted(base.starts.items()):
        arrays += [start.mesh.vertices, start.mesh.quads, start.cut]
    for array in arrays:
        told.update(b"none" if array is None else np.ascontiguousarray(array).tobytes())
    return told.hexdigest()


def _parse(line: str) -> Any:
    """Return the content of a JSON line; None if it is damaged."""
    try:
        return json.loads(line)
    except ValueError:
        return None
