"""Store an exploration in a folder: a journal while it runs, and at the end a table, a plot and pictures."""

from __future__ import annotations

import csv
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from ... import files
from ...display.drawing import GREY, INK, Dots, Drawing, Text, tick_values, to_svg
from ...display.plots import ACCENT, CURVE, Axes
from ...errors import FlexMapsError
from ...own_files import Guard
from .candidate import Candidate, ExplorationInput
from .explore import Exploration
from .space import MEASURES, SECTIONS, SearchSpace

JOURNAL_FILE = "tried.jsonl"  # JSON lines: the first identifies piece and variables, then one line per candidate
TABLE, REPORT, PLOT = "candidates.csv", "explore.json", "front.svg"
AXIS_MARGIN = 0.08  # free space at both ends of an axis, as a share of the range of its values


class ExplorationFolder:
    """Folder of an exploration; its attribute ``known`` has the candidates that are stored in it.

    Parameters
    ----------
    path : the folder, which is made if it does not exist
    base, space : piece and variables; they must match an exploration that is already stored there
    guard : protects the user's own files in the folder

    Raises
    ------
    FlexMapsError : the folder cannot be used, or holds the exploration of another piece or of other variables
    """

    def __init__(self, path: str | Path, base: ExplorationInput, space: SearchSpace, guard: Guard | None = None):
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
        if lines and _parse_json_line(lines[0]) != mark:
            raise FlexMapsError(f"Another piece or other variables were explored in {self.path}; give another folder")
        for line in lines[1:]:
            row = _parse_json_line(line)
            if isinstance(row, dict) and row.keys() == {"values", "measures", "advice", "fault", "picture"}:
                self.known.append(Candidate(**row))
        try:
            self._stream = (self.path / JOURNAL_FILE).open("a", encoding="utf-8")
        except OSError as error:
            raise FlexMapsError(f"{self.path}: {files.describe_error(error)}") from None
        self._append("" if not lines else "\n")  # ends a line that an interrupted run may have left incomplete
        if not lines:
            self._append(json.dumps(mark) + "\n")

    def __enter__(self) -> ExplorationFolder:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    def add(self, one: Candidate) -> None:
        """Append a candidate to the journal."""
        self._append(json.dumps(vars(one)) + "\n")

    def write(self, made: Exploration) -> dict[str, Any]:
        """Write the table, the report, the plot of the front and every candidate's picture; return the report."""
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
            new(self.path / PLOT).write_text(to_svg(plot_candidates(made)), encoding="utf-8")
            for number, one in enumerate(made.candidates):
                if one.picture:
                    new(self.path / f"candidate-{number:03d}.svg").write_text(one.picture, encoding="utf-8")
        return described

    def _append(self, text: str) -> None:
        """Append text to the journal and flush it."""
        try:
            self._stream.write(text)
            self._stream.flush()
        except OSError as error:
            raise FlexMapsError(f"{self.path}: {files.describe_error(error)}") from None


def refuse_to_replace(path: Path, guard: Guard) -> None:
    """Raise FlexMapsError if an exploration would replace files of the user in its folder.

    Parameters
    ----------
    path : folder of the exploration
    guard : tells the user's files from those that this program wrote
    """
    guard.check([*(path / name for name in (TABLE, REPORT, PLOT)), *path.glob("candidate-*.svg")], path)


def escape_formula(value: Any) -> Any:
    """Put an apostrophe before a text that a spreadsheet would run as a formula (owasp.org, CSV Injection)."""
    return f"'{value}" if isinstance(value, str) and value.startswith(("=", "+", "-", "@", "\t", "\r")) else value


def plot_candidates(made: Exploration, size: tuple[float, float] = (620, 420)) -> Drawing:
    """Plot all candidates by the two minimised measures; those on the Pareto front are highlighted and numbered.

    Parameters
    ----------
    made : the exploration
    size : width and height, pixels
    """
    names = made.space.minimised
    drawing = Drawing("Candidates that were tried", *size)
    rows = [one for one in made.sound if set(names) <= one.measures.keys()]
    points = np.array([[one.measures[name] for name in names] for one in rows]).reshape(-1, 2)
    spans = [_axis_range(points[:, k]) for k in range(2)]
    axes = Axes(drawing, spans[0], spans[1])
    axes.draw_frame(MEASURES[names[0]], MEASURES[names[1]], tick_values(*spans[0]), tick_values(*spans[1]))
    if not rows:
        return drawing
    drawing.add(Dots(axes.to_pixels(points[:, 0], points[:, 1]), 3.0, GREY))
    for turn, one in enumerate(made.front):
        here = axes.to_pixels(*(np.array([one.measures.get(name, np.inf)]) for name in names))
        if np.isfinite(here).all():
            number = made.candidates.index(one)
            drawing.add(Dots(here, 5.0, ACCENT if number == made.best else CURVE))
            beside = 14 if turn % 2 else -6  # alternately below and above, so that neighbouring numbers do not overlap
            drawing.add(Text((float(here[0, 0]) + 5, float(here[0, 1]) + beside), str(number), 11.5, INK))
    return drawing


def _axis_range(values: np.ndarray) -> tuple[float, float]:
    """Return the ends of a plot axis for these values, with a margin."""
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


def _parse_json_line(line: str) -> Any:
    """Parse a JSON line; return None if it is damaged."""
    try:
        return json.loads(line)
    except ValueError:
        return None
