"""No stage works for long without a word, however large the piece: silences are counted in Python's calls, for clocks differ."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
from flexmaps.engine.extras.assembly_sheet import sheet as assembly_sheet
from flexmaps.engine.fabrication import estimates, sheets
from flexmaps.engine.fabrication.writers import export
from flexmaps.engine.params import CutParams, LayoutParams, MaterialParams, SheetParams, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.progress import Progress
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.surface import curvature
from flexmaps.engine.surface.mesh import QuadMesh

shapes: Any = sys.modules["flexmaps_shapes"]
FEW = 60_000  # calls, some hundredths of a second: ezdxf goes through all that a drawing holds without a word


class Counter:
    """Counts the calls of Python functions between two words of the progress."""

    def __init__(self) -> None:
        self.calls = 0
        self.longest: dict[str, int] = {}
        self.words = ""

    def count(self, frame: FrameType, event: str, argument: Any) -> None:
        self.calls += event in {"call", "c_call"}

    def tell(self, fraction: float, words: str) -> None:
        before = f"{self.words} - {words}"
        self.longest[before] = max(self.longest.get(before, 0), self.calls)
        self.words, self.calls = words, 0

    def of(self, work: Callable[[Progress], Any]) -> Any:
        progress = Progress(self.tell)
        self.words, self.calls = "begin", 0
        with shapes.paused():
            sys.setprofile(self.count)
            try:
                made = work(progress)
            finally:
                sys.setprofile(None)
        self.tell(1.0, "end")
        return made


def strip(quads: int) -> QuadMesh:
    """A bent strip, two quads wide."""
    u, v = np.meshgrid(np.linspace(0.0, 0.01 * quads, quads // 2 + 1), np.linspace(0.0, 0.04, 3), indexing="ij")
    number = np.arange(u.size).reshape(u.shape)
    corners = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    return QuadMesh(np.stack([u, v, 0.02 * np.sin(9.0 * u) + 2.0 * v * v], axis=-1).reshape(-1, 3), corners)


def silences(quads: int, every: bool, folder: Path) -> dict[str, int]:
    """Calls between two words, from the layout to the files; ``every`` edge is cut, or every tenth row."""
    mesh = strip(quads)
    across = np.abs(mesh.vertices[mesh.edges][:, 0, 0] / 0.02 % 10.0 - 5.0) > 4.99
    along = np.ptp(mesh.vertices[mesh.edges][..., 0], axis=1) > 1e-6
    layout = PatchLayout(mesh, ~mesh.border & (np.ones(len(along), dtype=bool) if every else across & ~along))
    counter = Counter()
    flat = counter.of(lambda tell: flatten.flatten(layout, LayoutParams(), tell))
    curved = curvature.rms_curvature(mesh)
    spirals = counter.of(
        lambda tell: fabricable.design_from_curvature(flat, SpiralParams(thickness=0.002), curved, tell)
    )
    cut = CutParams(tabs=2, lead_in=0.002)
    made = counter.of(lambda tell: sheets.make_sheets(spirals, SheetParams(nesting="FAST"), tell, cut=cut))
    counter.of(lambda tell: export.write_sheets(made, folder / f"{quads}", export.FORMATS, progress=tell))
    figures = estimates.estimate(made, spirals, MaterialParams().chosen)
    counter.of(lambda tell: assembly_sheet.draw_pages(spirals, made, figures, "strip", progress=tell))
    return counter.longest


@pytest.mark.parametrize(
    "every", [pytest.param(False, marks=pytest.mark.thorough), True], ids=["a few panels", "a panel a quad"]
)
def test_silences_do_not_grow_with_the_piece(every: bool, tmp_path: Path) -> None:
    small, large = (silences(quads, every, tmp_path) for quads in (8, 24))
    grown = {words: calls for words, calls in large.items() if calls > max(FEW, 2 * small.get(words, 0))}
    assert not grown
