"""Map every patch of a layout to the plane, and measure the distortion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...arrays import Bool, Complex, Float, Int
from ...params import LayoutParams
from ...progress import SILENT, Progress
from ...threads import one_thread
from ..layout import PatchLayout
from .outline import has_simple_outline
from .seams import EDIT_ROUNDS, LAYOUT_ROUNDS, match_seams
from .triangles import corner_triangles, quad_energy, square_energy


@dataclass(frozen=True, eq=False)
class FlatPatches:
    """Flat shapes of all patches of a layout, without stress.

    layout : mesh and cuts
    points : flat vertices, metres, indexed by ``layout.flat_corners``; each patch has its own frame, with the area
        centroid at the origin and the longest extent along x; quads are counter-clockwise seen from outside
    energy : distortion E of every quad: area-weighted mean over its 4 corner triangles of (s1-1)^2 + (s2-1)^2, with
        s1, s2 the singular values of the map from the surface to the plane
    irregularity : irregularity of every flat quad: the energy of the map from a square of equal area to the quad
    """

    layout: PatchLayout
    points: Float[np.ndarray, "points 2"]
    energy: Float[np.ndarray, " quads"]
    irregularity: Float[np.ndarray, " quads"]

    @property
    def corners(self) -> Float[np.ndarray, "quads 4 2"]:
        """Flat corners of every quad in its patch's frame, metres."""
        return self.points[self.layout.flat_corners]

    @cached_property
    def outlines(self) -> tuple[np.ndarray, ...]:
        """Flat vertices of every patch's outer outline, counter-clockwise; holes are left out."""
        return tuple(outline_vertices(self.layout, patch) for patch in range(len(self.layout.patches)))


@one_thread
def flatten(
    layout: PatchLayout,
    params: LayoutParams,
    progress: Progress = SILENT,
    previous: FlatPatches | None = None,
    start: Complex[np.ndarray, "quads 4"] | None = None,
    moved_quads: Bool[np.ndarray, " quads"] | None = None,
) -> FlatPatches:
    """Flatten every patch of a layout; both sides of seams become equally long as far as the distortion limit allows.

    Parameters
    ----------
    layout : mesh and cuts
    params : limits of the layout
    progress : called with the fraction done
    previous : earlier flat patches of the mesh; patches with the same quads and outline are taken over from it
    start : initial rotations of the corner triangles, unit complex numbers; by default computed for every patch
    moved_quads : mask of quads whose shape changed since ``previous``; their patches are flattened again
    """
    known = _reusable_patches(previous, layout, moved_quads)
    corners = np.zeros((len(layout.mesh.quads), 4), dtype=complex)
    fresh = []
    for quads in layout.patches:
        if previous is not None and _patch_key(layout, quads) in known:
            corners[quads] = previous.corners[quads] @ np.array([1.0, 1.0j])
        else:
            fresh.append(quads)
    rounds = LAYOUT_ROUNDS if not known else EDIT_ROUNDS
    corners = match_seams(layout, fresh, corners, params, progress.part(0.0, 0.95), start, rounds)
    points = np.empty((int(layout.flat_corners.max()) + 1, 2))
    points[layout.flat_corners] = np.stack([corners.real, corners.imag], axis=2)
    for quads in progress.part(0.95, 1.0).each(fresh, "Flattening"):
        own, local = np.unique(layout.flat_corners[quads], return_inverse=True)
        points[own] = align_to_frame(points[own] @ np.array([1.0, 1.0j]), local.reshape(-1, 4))
    return with_energies(layout, points)


def with_energies(layout: PatchLayout, points: Float[np.ndarray, "points 2"]) -> FlatPatches:
    """Return flat patches with given flat points; compute their distortion and irregularity.

    Parameters
    ----------
    layout : mesh and cuts
    points : flat vertices, metres
    """
    u = (points[:, 0] + 1j * points[:, 1])[layout.flat_corners]
    tri = corner_triangles(layout.mesh)
    d = np.roll(u, -1, axis=1) - u
    before = np.roll(d, 1, axis=1)
    a, b = tri.along * d + tri.against * before, tri.along_bar * d + tri.against_bar * before
    return FlatPatches(layout, points, quad_energy(tri, np.abs(a), np.abs(b)), square_energy(u))


def with_corners(layout: PatchLayout, corners: Float[np.ndarray, "quads 4 2"]) -> FlatPatches:
    """Return flat patches with given flat corners of the quads; compute their distortion and irregularity.

    Parameters
    ----------
    layout : mesh and cuts
    corners : flat corners of every quad, metres; neighbours within a patch must agree on common corners
    """
    points = np.empty((int(layout.flat_corners.max()) + 1, 2))
    points[layout.flat_corners] = corners
    return with_energies(layout, points)


def align_to_frame(
    points: Complex[np.ndarray, " vertices"], corners: Int[np.ndarray, "quads 4"]
) -> Float[np.ndarray, "vertices 2"]:
    """Return the points of a patch in its own frame: area centroid at 0, longest extent along x.

    Parameters
    ----------
    points : flat vertices of the patch, complex, metres
    corners : flat vertices of the patch's quads
    """
    u = points[corners]
    area = 0.5 * ((u[:, 2] - u[:, 0]).conj() * (u[:, 3] - u[:, 1])).imag
    centre = u.mean(axis=1)
    origin = (area * centre).sum() / area.sum()
    hull = points - origin
    turn = _longest_direction(hull)
    hull = hull * turn
    return np.stack([hull.real, hull.imag], axis=1)


def _longest_direction(points: np.ndarray) -> complex:
    """Return the rotation that turns the long side of the points' smallest bounding box to the x axis.

    The points and the rotation are complex numbers; the rotation has length 1.
    """
    angles = np.linspace(0.0, np.pi, 180, endpoint=False)
    spun = points[None, :] * np.exp(-1j * angles)[:, None]
    width, height = np.ptp(spun.real, axis=1), np.ptp(spun.imag, axis=1)
    best = int(np.argmin(np.where(width >= height - 1e-12, np.round(width * height, 15), np.inf)))
    return complex(np.exp(-1j * angles[best]))


def _patch_key(layout: PatchLayout, quads: np.ndarray) -> bytes:
    """Return a dictionary key for a patch, made of its quads and their sides on the outline."""
    return quads.tobytes() + np.packbits(layout.outline_sides[quads]).tobytes()


def _reusable_patches(
    previous: FlatPatches | None, layout: PatchLayout, moved_quads: Bool[np.ndarray, " quads"] | None
) -> dict[bytes, int]:
    """Return the patches of ``previous`` that contain no moved quad, as a dictionary from ``_patch_key`` to patch number.

    It is empty if ``previous`` is None or has another mesh.
    """
    if previous is None or previous.layout.mesh is not layout.mesh:
        return {}
    kept = [
        (i, quads)
        for i, quads in enumerate(previous.layout.patches)
        if moved_quads is None or not moved_quads[quads].any()
    ]
    return {_patch_key(previous.layout, quads): i for i, quads in kept}


def outline_vertices(layout: PatchLayout, patch: int) -> Int[np.ndarray, " m"]:
    """Return the flat vertices on the outer outline of a patch, counter-clockwise, the smallest index first.

    Parameters
    ----------
    layout : mesh and cuts
    patch : number of the patch
    """
    quads = layout.patches[patch]
    loop = layout.loop_of[quads]
    outer = np.flatnonzero(layout.loop_patch == patch)
    quad, side = np.nonzero(loop == outer[np.argmax(layout.loop_lengths[outer])])
    corners = layout.flat_corners[quads]
    start, end = corners[quad, side], corners[quad, (side + 1) % 4]
    following = dict(zip(start.tolist(), end.tolist(), strict=True))
    walk = [int(start.min())]
    while (vertex := following[walk[-1]]) != walk[0]:
        walk.append(vertex)
    return np.array(walk)


def seam_mismatch(flat: FlatPatches) -> Float[np.ndarray, " cuts"]:
    """Return how much the two flat sides of every cut edge differ in length, as a share of the edge's length in space."""
    mesh, cut = flat.layout.mesh, np.flatnonzero(flat.layout.cut)
    sides = np.linalg.norm(np.roll(flat.corners, -1, axis=1) - flat.corners, axis=2)
    pair, side = mesh.edge_quads[cut], mesh.edge_sides[cut]
    length = sides[pair, side]
    return np.abs(length[:, 0] - length[:, 1]) / mesh.edge_lengths[cut]


def overlapping_patches(flat: FlatPatches) -> list[int]:
    """Return the patches that may overlap themselves in the plane, because they are not proven injective.

    Such a patch has a flipped corner triangle, a topology that cannot be laid flat, or an outline that is not simple.
    """
    layout = flat.layout
    points = flat.points[:, 0] + 1j * flat.points[:, 1]
    corners = flat.layout.flat_corners
    flipped = np.bincount(layout.patch_of, weights=count_flipped(points[corners]), minlength=len(layout.patches)) > 0
    bad = np.flatnonzero(flipped | ~layout.is_flattenable).tolist()
    sides = layout.outline_sides
    return sorted(
        bad
        + [
            patch
            for patch, quads in enumerate(layout.patches)
            if patch not in bad and not has_simple_outline(points, corners[quads], sides[quads])
        ]
    )


def count_flipped(corners: Complex[np.ndarray, "quads 4"]) -> Int[np.ndarray, " quads"]:
    """Return how many of the four corner triangles of each flat quad are not positively oriented."""
    d = np.roll(corners, -1, axis=1) - corners
    return ((np.roll(d, 1, axis=1).conj() * d).imag <= 0).sum(axis=1)
