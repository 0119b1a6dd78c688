"""Outputs that users make by hand: they mark seams, change spirals, or take another proposed layout."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..params import Settings
from ..patches.flattening import flatten
from ..patches.flattening.flatten import FlatPatches
from ..patches.layout import PatchLayout
from ..patches.tracing import trace
from ..progress import SILENT, Progress
from ..spirals.design import SpiralDesign
from ..threads import one_thread
from .outputs import LAYOUTS, DesignVersion, FinalLayout, MergedLayout, TracedLayout, provenance
from .result import Result
from .stages import BY_HAND, STAGES
from .steps import STEPS


@one_thread
def trace_with_seams(result: Result, seams: np.ndarray, settings: Settings, progress: Progress = SILENT) -> Result:
    """Trace the surface, but cut it along the user's seams if there are any.

    Parameters
    ----------
    result : holds the mesh; outputs made from the former layout are dropped
    seams : (E,) bool, edges that the user marked to be cut
    settings : settings of all stages
    progress : called with the fraction done; may cancel
    """
    made = STEPS["trace"](result, STAGES["trace"].readable(settings), progress)
    if not seams.any():
        return made
    chosen, traced = trace.make_disks(PatchLayout(result.mesh, seams)), made.need(TracedLayout)
    if np.array_equal(chosen.cut, traced.layout.cut):
        return made
    return made.with_outputs(replace(traced, layout=chosen))


def flatten_by_hand(
    result: Result,
    cut: np.ndarray,
    settings: Settings,
    progress: Progress = SILENT,
    previous: FlatPatches | None = None,
) -> Result:
    """Flatten the patches between cuts that the user chose, see ``flatten.flatten``.

    Parameters
    ----------
    result : holds the mesh; outputs made from the former layout are dropped
    cut : (E,) bool, edges of the mesh to cut
    settings : settings of all stages
    progress : called with the fraction done; may cancel
    previous : earlier flat patches; patches that have not changed keep their flat shapes
    """
    layout = trace.make_disks(PatchLayout(result.mesh, cut))
    return with_manual_layout(result, flatten.flatten(layout, settings.layout, progress, previous=previous), settings)


def with_manual_layout(result: Result, flat: FlatPatches, settings: Settings) -> Result:
    """Return the result with flat patches made by hand, in place of all earlier layouts.

    Parameters
    ----------
    result : results with a mesh
    flat : the flat patches
    settings : settings of all stages
    """
    bare = result.without(*LAYOUTS)
    merged = bare.with_outputs(MergedLayout(flat, BY_HAND, **provenance("merge", settings, bare.inputs("mesh"))))
    made = provenance("merge", settings, merged.inputs("mesh", "merged"))
    return merged.with_outputs(FinalLayout(flat, BY_HAND, **made))


def with_design(result: Result, design: SpiralDesign, origin: str, settings: Settings) -> Result:
    """Return the result with other spirals in its layout.

    Parameters
    ----------
    result : results with a final layout
    design : the new spirals
    origin : as in ``DesignVersion``
    settings : settings of all stages
    """
    return result.with_outputs(DesignVersion(design, origin, **provenance("spirals", settings, result.inputs("flat"))))
