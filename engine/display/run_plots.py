"""Plots and maps of the stages that have run, by file name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .. import colours
from ..arrays import Bool, Float, Int
from ..figures import format_figure
from ..optimisation import match_limits
from ..optimisation.match_limits import MatchLimits
from ..patches.flattening.flatten import FlatPatches
from ..simulation.simulate import Simulation
from ..spirals.curves.spiral import anisotropy
from ..spirals.design import SpiralDesign
from ..surface.mesh import QuadMesh
from . import arrange, plots
from .drawing import Drawing, format_colours
from .plots import Colouring

PLOT_NAMES = ("surface", "patches", "distortion", "width", "anisotropy", "twist", "history", "objective", "errors", "shape", "distance", "safety",
         "slots", "limits")  # fmt: skip


@dataclass(frozen=True, eq=False)
class MapValues:
    """Values of all quads for maps; None if the stage that computes them has not run.

    mesh : target
    corners, sides, patch : corners of the flat patches side by side, metres; mask of the quads' sides that lie on the
        outline of a patch; patch of each quad
    distortion : distortion E of every quad, see the glossary
    width, anisotropy, twist : mean width of the arms, mm; per cent, see ``spiral.anisotropy``; degrees
    shape, distance : vertices of the simulated shape, metres; distance of each spiral to the target, mm
    strain : strain of the arms, as a share of the strain limit
    slot : narrowest slot in space beside the spiral's arms, mm
    kind : what limits the match at the spiral, index into ``match_limits.REASON_NAMES``
    more : values of optional features (``engine.extras``), by name
    """

    mesh: QuadMesh
    corners: Float[np.ndarray, "quads 4 2"] | None = None
    sides: Bool[np.ndarray, "quads 4"] | None = None
    patch: Int[np.ndarray, " quads"] | None = None
    distortion: Float[np.ndarray, " quads"] | None = None
    width: Float[np.ndarray, " quads"] | None = None
    anisotropy: Float[np.ndarray, " quads"] | None = None
    twist: Float[np.ndarray, " quads"] | None = None
    shape: Float[np.ndarray, "vertices 3"] | None = None
    distance: Float[np.ndarray, " quads"] | None = None
    strain: Float[np.ndarray, " quads"] | None = None
    slot: Float[np.ndarray, " quads"] | None = None
    kind: Int[np.ndarray, " quads"] | None = None
    more: Mapping[str, Float[np.ndarray, " quads"]] = field(default_factory=dict)

    @classmethod
    def from_results(
        cls,
        mesh: QuadMesh,
        flat: FlatPatches | None = None,
        design: SpiralDesign | None = None,
        simulation: Simulation | None = None,
        limits: MatchLimits | None = None,
    ) -> MapValues:
        """Collect the values from the results of the stages.

        Parameters
        ----------
        mesh : target
        flat, design, simulation, limits : results of stages; None if the stage has not run
        """
        values: dict[str, Any] = {}
        if flat is not None:
            layout = flat.layout
            values |= {
                "corners": flat.corners + arrange.arrange_patches(flat)[layout.patch_of][:, None],
                "sides": layout.outline_sides,
                "patch": layout.patch_of,
                "distortion": flat.energy,
            }
        if design is not None:
            width = design.width
            values |= {
                "width": 1e3 * width.mean(axis=1),
                "anisotropy": 100 * anisotropy(width),
                "twist": np.degrees(design.twist),
            }
        if simulation is not None:
            distance = simulation.distance * 1e3
            values |= {"shape": simulation.vertices, "distance": distance, "strain": simulation.strain}
            slots = simulation.slots()
            values["slot"] = None if slots is None else 1e3 * slots.narrowest_per_quad
        if limits is not None:
            values["kind"] = limits.kind
        return cls(mesh, **values)


def make_plots(values: MapValues, report: Mapping[str, Any], distortion: float) -> dict[str, Drawing]:
    """Return the plots and maps for which there are values, by name (see ``PLOT_NAMES``).

    Parameters
    ----------
    values : values of all quads
    report : report of the run (report.json)
    distortion : distortion limit of the layout, up to which the colour scale of the distortion reaches at least
    """
    layout, spirals = _layout_maps(values, distortion), _spiral_maps(values)
    match = _match_plots(values, report)
    return layout | spirals | _history_plots(report) | match


def _layout_maps(m: MapValues, distortion: float) -> dict[str, Drawing]:
    """Return maps of the surface, the patches and their distortion."""
    count = len(m.mesh.quads)
    sides = np.zeros((count, 4), bool) if m.sides is None else m.sides
    if m.patch is None or m.corners is None or m.distortion is None:
        plain = Colouring("Surface", np.full((count, 3), [0.80, 0.86, 0.86]))
        return {"surface": plots.draw_shape_map(m.mesh.vertices, m.mesh.quads, np.ones((count, 4), bool), plain)}
    fills = plots.patch_fills(m.patch)
    high = max(distortion, float(m.distortion.max()))
    bent = Colouring.from_values(
        "Distortion of the flat panels, ARAP energy E", m.distortion, "E", colours.ERROR_SCALE, 0.0, high
    )
    return {
        "surface": plots.draw_shape_map(m.mesh.vertices, m.mesh.quads, sides, Colouring("Surface and panels", fills)),
        "patches": plots.draw_flat_map(m.corners, sides, Colouring("Flat patches", fills)),
        "distortion": plots.draw_flat_map(m.corners, sides, bent),
    }


def _spiral_maps(m: MapValues) -> dict[str, Drawing]:
    """Return maps of the spirals' width, twist and anisotropy."""
    if m.width is None or m.anisotropy is None or m.twist is None or m.corners is None or m.sides is None:
        return {}
    found = {}
    for name, title, values, unit in (
        ("width", "Width of the arms", m.width, "mm"),
        ("twist", "Twist of the spirals", m.twist, "degrees"),
        ("anisotropy", "Anisotropy: how unlike the pairs of opposite arms are", m.anisotropy, "%"),
    ):
        low, high = float(values.min()), float(values.max())
        if name == "anisotropy":
            low, high = 0.0, max(high, colours.LEAST_ANISOTROPY)
        made = Colouring.from_values(title, values, unit, colours.QUANTITY_SCALE, low, high)
        found[name] = plots.draw_flat_map(m.corners, m.sides, made)
    return found


def _history_plots(report: Mapping[str, Any]) -> dict[str, Drawing]:
    """Return plots of the distance to the target and of the objective during the optimisation."""
    block = report.get("optimise")
    if not block or not block["history"]:
        return {}
    rows = block["history"]
    rmse = [block["laplacian_rmse_mm_before"], *(row["rmse_mm"] for row in rows)]
    objective = [row["objective"] for row in rows]
    return {
        "history": plots.plot_history(rmse, "Match while optimising", "RMSE (mm)"),
        "objective": plots.plot_history(objective, "Objective while optimising", "Objective"),
    }


def _match_plots(m: MapValues, report: Mapping[str, Any]) -> dict[str, Drawing]:
    """Return plots and maps of the simulated shape: distance to the target, strain, slots, limits of the match."""
    if m.distance is None or m.corners is None or m.sides is None:
        return {}
    found = {}
    rms = float(np.sqrt((m.distance**2).mean()))
    percent = report.get("equilibrium", {}).get("rms_percent")
    mark = f"RMS {rms:.3g} mm" + ("" if percent is None else f" ({format_figure(percent)} % of the size)")
    found["errors"] = plots.plot_histogram(
        m.distance, "Distance of the spirals to the target", "Distance (mm)", [(rms, mark)]
    )
    high = max(float(m.distance.max()), colours.LEAST_DISTANCE)
    far = Colouring.from_values("Distance to the target", m.distance, "mm", colours.ERROR_SCALE, 0.0, high)
    if m.shape is not None:
        found["shape"] = plots.draw_shape_map(
            m.shape,
            m.mesh.quads,
            m.sides,
            Colouring.from_values("Simulated shape", m.distance, "mm", colours.ERROR_SCALE, 0.0, high),
        )
    found["distance"] = plots.draw_flat_map(m.corners, m.sides, far)
    if m.strain is not None:
        share = 100.0 * m.strain
        high = max(100.0, float(share.max()))
        loaded = Colouring.from_values(
            "Safety: strain of the arms", share, "% of limit", colours.ERROR_SCALE, 0.0, high
        )
        found["safety"] = plots.draw_flat_map(m.corners, m.sides, loaded)
    if m.slot is not None:
        low, high = min(0.0, float(m.slot.min())), max(colours.LEAST_SLOT, float(np.median(m.slot)))
        room = Colouring.from_values("Slots in the simulated shape", m.slot, "mm", colours.ERROR_SCALE[::-1], low, high)
        found["slots"] = plots.draw_flat_map(m.corners, m.sides, room)
    if m.kind is not None:
        looks = [colours.LIMITS[name] for name in match_limits.REASON_NAMES]
        counts = np.bincount(m.kind, minlength=len(looks)).tolist()
        named = zip(format_colours(np.array([colour for colour, _ in looks])), looks, counts)
        rows = tuple((name, f"{text}: {count}") for name, (_, text), count in named if count)
        fills = np.array([colour for colour, _ in looks])[m.kind]
        found["limits"] = plots.draw_flat_map(m.corners, m.sides, Colouring("What limits the match", fills, rows=rows))
    return found
