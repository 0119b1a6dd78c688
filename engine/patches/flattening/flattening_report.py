"""Report on a layout: its block in report.json, and sentences about limits and symmetries that could not be kept."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...params import LayoutParams
from ...surface.checking.finding import with_count
from ...surface.curvature import is_flat
from ...surface.symmetry import Symmetry
from ..joining import panel_numbers
from .flatten import FlatPatches, count_flipped, overlapping_patches, seam_mismatch

# Largest number of patches beyond a limit that are described one by one; chosen by eye. Larger: longer messages.
MAX_REMARKS = 3


def layout_report(flat: FlatPatches) -> dict[str, Any]:
    """Return the ``layout`` block of report.json; energies have no unit, mismatches are shares of edge lengths.

    ``flips`` counts flipped corner triangles, four per quad; ``overlaps`` counts patches that are not proven
    injective; ``remarks`` are sentences for the user.
    """
    layout = flat.layout
    mismatch = seam_mismatch(flat)
    points = (flat.points[:, 0] + 1j * flat.points[:, 1])[layout.flat_corners]
    report: dict[str, object] = {
        "patches": len(layout.patches),
        "cut_edges": int(layout.cut.sum()),
        "energy_max": float(flat.energy.max()),
        "energy_median": float(np.median(flat.energy)),
        "square_max": float(flat.irregularity.max()),
        "square_median": float(np.median(flat.irregularity)),
        "flips": int(count_flipped(points).sum()),
        "overlaps": len(overlapping_patches(flat)),
        "disks": bool(layout.is_flattenable.all()),
        "flat_target": is_flat(layout.mesh),
        "compactness_max": float(layout.compactness.max()),
        "neck_min_quads": int(layout.isthmus_widths(own=False).min()),
        "smallest_patch": min(len(quads) for quads in layout.patches),
        "seam_mismatch_median": float(np.median(mismatch)) if len(mismatch) else 0.0,
        "seam_mismatch_max": float(mismatch.max()) if len(mismatch) else 0.0,
    }
    return report | layout.notes | remarks(layout.notes)


def remarks(notes: Mapping[str, object]) -> dict[str, object]:
    """Return the most important notes of a layout as a list of sentences, under the key ``remarks``; empty if none."""
    said = [str(notes["halved"])] if "halved" in notes else []
    forced = notes.get("forced")
    if isinstance(forced, list):
        said += forced[:MAX_REMARKS]
        if len(forced) > MAX_REMARKS:
            said.append(
                f"{with_count(len(forced) - MAX_REMARKS, 'more panel goes', 'more panels go')} beyond a limit in such a way; the report names them"
            )
    return {"remarks": said} if said else {}


def forced_notes(flat: FlatPatches, params: LayoutParams) -> dict[str, object]:
    """Return sentences about the panels that exceed a limit, under the key ``forced``; an empty dictionary if none does.

    They exceed it because every change of the layout would break another limit.

    Parameters
    ----------
    flat : flat patches
    params : limits of the layout
    """
    layout = flat.layout
    mesh, necks, numbers = layout.mesh, layout.isthmus_widths(own=False), panel_numbers(layout)
    listed = []
    for patch, quads in enumerate(layout.patches):
        reasons = []
        if len(quads) < params.patch_min:
            reasons.append(f"has only {with_count(len(quads), 'quad', 'quads')}")
        if necks[patch] < params.neck_min:
            reasons.append(f"is only {with_count(necks[patch], 'quad', 'quads')} wide at its narrowest")
        if layout.compactness[patch] > params.compactness_limit:
            reasons.append(f"is long or ragged (compactness {layout.compactness[patch]:.1f})")
        if (worst := flat.energy[quads].max()) > params.distortion_limit:
            reasons.append(f"is distorted by {worst:.3f}")
        if reasons:
            x, y, z = (1e3 * mesh.centroids[quads].mean(axis=0)).tolist()
            name = f"Panel {numbers[patch]}" + (f", quad {quads[0]}," if len(quads) == 1 else "")
            listed.append(
                f"{name} at ({x:.0f}, {y:.0f}, {z:.0f}) mm {' and '.join(reasons)}: "
                "joining it with a neighbour or cutting it would break another limit"
            )
    return {"forced": listed} if listed else {}


def symmetry_kept(whole_group: list[Symmetry], kept: list[Symmetry]) -> tuple[dict[str, object], str]:
    """Return how many of the surface's symmetries a layout keeps, as entries of the report and as the start of a sentence.

    Parameters
    ----------
    whole_group, kept : symmetries of the surface, and symmetries of the layout, without the identity
    """
    names = sorted({s.name for s in kept})
    text = f"The layout keeps {1 + len(kept)} of {1 + len(whole_group)} symmetries"
    text += f" ({', '.join(names[:6])}{', ...' if len(names) > 6 else ''})" if names else ""
    return {"symmetries": 1 + len(whole_group), "symmetries_kept": 1 + len(kept)}, text
