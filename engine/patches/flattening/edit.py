"""Manual edits of a layout: cut or join along a run of edges; only changed patches are flattened again."""

from __future__ import annotations

import numpy as np

from ...arrays import Bool
from ...errors import FlexMapsError
from ...params import LayoutParams
from ...progress import SILENT, Progress
from ..layout import PatchLayout
from .flatten import FlatPatches, flatten


def with_cuts(
    flat: FlatPatches, cut: Bool[np.ndarray, " edges"], params: LayoutParams, progress: Progress = SILENT
) -> FlatPatches:
    """Flatten the mesh of some flat patches anew with other cuts; keep the patches that the new cuts do not change.

    Parameters
    ----------
    flat : current flat patches
    cut : new cuts; border edges are ignored
    params : limits of the layout
    progress : called with the fraction done

    Raises
    ------
    FlexMapsError : with the quads and the outline of a patch that cannot be laid flat in one piece
    """
    mesh = flat.layout.mesh
    layout = PatchLayout(mesh, np.asarray(cut, dtype=bool) & ~mesh.border)
    bad = np.flatnonzero(~layout.is_flattenable)
    if len(bad):
        quads = layout.patches[bad[0]]
        raise FlexMapsError(
            f"A panel of {len(quads)} quads would not be one flat piece with a single outline; "
            "leave a cut that opens it, or remove a cut that floats inside it",
            faces=quads,
            edges=np.unique(mesh.quad_edges[quads][layout.outline_sides[quads]]),
        )
    return flatten(layout, params, progress, previous=flat)
