"""Growth of the times of stages, from flat patches to the assembly sheet, with the size of a surface cut along every edge."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
from flexmaps.engine.extras.assembly_sheet import sheet as assembly_sheet
from flexmaps.engine.fabrication import estimates, sheets
from flexmaps.engine.fabrication.connectors import connect as connectors
from flexmaps.engine.fabrication.nesting import nest as nesting
from flexmaps.engine.fabrication.panels import labels
from flexmaps.engine.params import ConnectorParams, LayoutParams, MaterialParams, SheetParams, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.spirals import contacts, fabricable
from flexmaps.engine.surface import curvature
from flexmaps.engine.surface.mesh import QuadMesh
from harness import EDGE, Row, at_most

NAME = "growth"
SIZES = (16, 32, 64)  # quads along the sides of the shells of one-quad panels whose stages are timed
EXPONENT = 1.2  # n log n from 256 to 4,096 quads


def rows(params: SheetParams) -> list[Row]:
    """Seconds of every stage for 4,096 panels of one quad, and the exponent with which they grow from 256 on."""
    seconds: dict[str, list[float]] = {}
    for side in SIZES:
        for stage, spent in _stages(shells(side), params):
            seconds.setdefault(stage, []).append(spent)
    found = []
    for stage, took in seconds.items():
        grown = np.polyfit(np.log([side**2 for side in SIZES]), np.log(np.maximum(took, 1e-3)), 1)[0]
        found += [
            at_most(NAME, f"{stage}, seconds", 10.0, round(took[-1], 2)),
            at_most(NAME, f"{stage}, exponent", EXPONENT, round(float(grown), 2)),
        ]
    return found


def shells(side: int) -> PatchLayout:
    """A shallow shell of side x side quads of 20 mm, cut along every edge."""
    u, v = np.meshgrid(*(np.linspace(-1.0, 1.0, side + 1),) * 2, indexing="ij")
    number = np.arange(u.size).reshape(u.shape)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    points = 0.5 * side * EDGE * np.stack([u, v, np.sqrt(4.0 - u * u - v * v)], axis=-1).reshape(-1, 3)
    mesh = QuadMesh(points, quads)
    return PatchLayout(mesh, ~mesh.border)


def _stages(layout: PatchLayout, params: SheetParams) -> Iterator[tuple[str, float]]:
    """Return the processor seconds of every stage."""
    begin = time.process_time()

    def spent(stage: str) -> tuple[str, float]:
        nonlocal begin
        begin, last = time.process_time(), begin
        return stage, begin - last

    flat = flatten.flatten(layout, LayoutParams())
    spent("flattening")
    spirals = fabricable.design_from_curvature(
        flat, SpiralParams(thickness=0.002), curvature.rms_curvature(layout.mesh)
    )
    yield spent("spirals")
    made = connectors.connect(spirals, ConnectorParams())
    yield spent("connectors")
    contacts.find_contacts(list(made.outlines))
    spirals.measure_slot_and_bridge()
    yield spent("proof")
    labels.make_labels(layout, spirals.arms, spirals.roots, params, made.occupied_lengths)
    yield spent("labels")
    nesting.nest([outline.outer.sample(2e-5) for outline in made.outlines], params)
    yield spent("nesting")
    on_sheets = sheets.make_sheets(spirals, params)
    figures = estimates.estimate(on_sheets, spirals, MaterialParams().chosen)
    spent("again")
    assembly_sheet.draw_pages(spirals, on_sheets, figures, "growth")
    yield spent("assembly sheet")
