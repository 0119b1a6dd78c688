"""First layout: cuts along a motorcycle graph, so that every patch can be laid flat (FlexMaps section 4).

Motorcycles start at irregular vertices and run straight on along lines of edges (parametric lines), all at the same
pace, until they meet an existing line (Eppstein et al. 2008). Patches that are not disks are cut along their shortest
parametric line. If this leaves too small patches, cuts between regions (see ``regions``) replace the lines.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from ...arrays import Bool
from ...errors import FlexMapsError
from ...params import LayoutParams
from ...progress import SILENT, Progress
from ...surface.mesh import QuadMesh
from ...threads import one_thread
from ..flattening.arap import PatchProblem, minimise_max_energy, solve_local_global
from ..flattening.outline import has_simple_outline
from ..layout import PatchLayout, next_straight_side
from .regions import MERGING_SHARE, RegionHalver


@one_thread
def trace_layout(mesh: QuadMesh, params: LayoutParams, progress: Progress = SILENT) -> PatchLayout:
    """Make the first layout, in which every patch can be laid flat within the distortion limit.

    A body that can be laid flat in one piece stays whole. Other bodies are cut along their motorcycle graph, and
    further until every patch is within the limit. If a body's patches then have fewer than ``patch_min`` quads on
    average, it is divided into regions instead. A single quad beyond the limit remains, because it cannot be cut.

    Parameters
    ----------
    mesh : quad mesh, metres
    params : limits of the layout
    progress : called with the fraction done
    """
    progress(0.0, "Tracing parametric lines")
    halving = RegionHalver(mesh, params)
    body = mesh.body_of
    bodies = [np.flatnonzero(body == n) for n in range(int(body.max()) + 1)]
    whole = np.zeros(len(bodies), dtype=bool)
    for number, quads in enumerate(bodies):
        tick = partial(progress, 0.1 * number / len(bodies), "Tracing parametric lines")
        tick()
        whole[number] = halving.is_flattenable(quads, MERGING_SHARE, tick)
    edge_body = body[mesh.edge_quads.max(axis=1)]  # the larger index, because a border edge has -1 in place of one quad
    lines = motorcycles(mesh) & ~whole[edge_body]
    layout = make_disks(PatchLayout(mesh, lines), where=~whole)
    size = np.bincount(body) / np.bincount(body[[quads[0] for quads in layout.patches]])
    shattered = ~whole & (size < params.patch_min)
    traced = _halve_to_limit(layout, params, progress.part(0.2, 0.8), ~whole & ~shattered)
    size = np.bincount(body) / np.bincount(body[[quads[0] for quads in traced.patches]])
    shattered |= ~whole & (size < params.patch_min)
    cut = traced.cut
    if shattered.any():
        parts = halving.region_layout(np.flatnonzero(shattered[body]), progress.part(0.8, 1.0))
        cut = np.where(shattered[edge_body], parts.cut, cut)
    return PatchLayout(mesh, cut, origin="regions" if shattered.any() else "lines")


def _halve_to_limit(layout: PatchLayout, params: LayoutParams, progress: Progress, wanted: np.ndarray) -> PatchLayout:
    """Halve patches of the bodies in the mask ``wanted`` until they are within the distortion limit and injective."""
    mesh = layout.mesh
    good: set[bytes] = set()
    for round_ in range(30):
        cut = layout.cut.copy()
        for number, quads in enumerate(layout.patches):
            tick = partial(progress, round_ / 30, "Flattening the first panels")
            tick()
            key = quads.tobytes()
            if key in good or not wanted[mesh.body_of[quads[0]]]:
                continue
            if _worst_energy(layout, quads, tick) > params.distortion_limit and len(
                line := middle_line(layout, number)
            ):
                cut[line] = True
            else:
                good.add(key)
        if (cut == layout.cut).all():
            return layout
        layout = make_disks(PatchLayout(mesh, cut), where=wanted)
    return layout


def _worst_energy(layout: PatchLayout, quads: np.ndarray, tick: Callable[[], None]) -> float:
    """Return the largest distortion E in a patch after minimax flattening; infinite if the flat patch overlaps itself."""
    corners = np.unique(layout.flat_corners[quads], return_inverse=True)[1].reshape(-1, 4)
    problem = PatchProblem(layout.mesh, quads, corners, tick)
    flat = solve_local_global(problem, tolerance=0.01)
    flat = minimise_max_energy(problem, flat, target=0.01)
    return flat.max_energy if has_simple_outline(flat.points, corners, layout.outline_sides[quads]) else np.inf


def motorcycles(mesh: QuadMesh) -> Bool[np.ndarray, " edges"]:
    """Return a mask of the edges that motorcycles pass; they start at every irregular vertex and pass an edge per step.

    Two motorcycles that meet head-on stop. Two motorcycles that reach a crossing in the same step both continue, to keep
    symmetry.
    """
    cut = np.zeros(len(mesh.edges), dtype=bool)
    edges = np.flatnonzero(~mesh.border)
    quad = mesh.edge_quads[edges].ravel()
    side = mesh.edge_sides[edges].ravel()
    start = mesh.quads[quad, side]
    begins = mesh.irregular[start]
    quad, side = quad[begins], side[begins]
    reached = mesh.irregular | mesh.on_border
    while len(quad):
        cut[mesh.quad_edges[quad, side]] = True
        end = mesh.quads[quad, (side + 1) % 4]
        go = ~reached[end]
        # motorcycles that meet head-on stop below, because the edge ahead of each is already cut
        quad, side, end = quad[go], side[go], end[go]
        quad2, side2, valid = next_straight_side(mesh, quad, side)
        reached[end] = True
        fresh = valid & ~cut[mesh.quad_edges[quad2, side2]]
        quad, side = quad2[fresh], side2[fresh]
    return cut


def make_disks(layout: PatchLayout, where: Bool[np.ndarray, " bodies"] | None = None) -> PatchLayout:
    """Cut patches that cannot be laid flat along their shortest parametric lines, until all patches can be laid flat.

    Parameters
    ----------
    layout : mesh and cuts
    where : mask of the bodies to cut; default is all

    Raises
    ------
    FlexMapsError : the surface could not be cut into disks
    """
    for _ in range(10 * len(layout.mesh.quads)):
        bad = np.flatnonzero(~layout.is_flattenable).tolist()
        if where is not None:
            bad = [patch for patch in bad if where[layout.mesh.body_of[layout.patches[patch][0]]]]
        if not bad:
            return layout
        cut = layout.cut.copy()
        for patch in bad:
            cut[opening_line(layout, patch)] = True
        layout = PatchLayout(layout.mesh, cut)
    raise FlexMapsError("The surface could not be cut into disks; check it for very small or folded parts")


def opening_line(layout: PatchLayout, patch: int) -> np.ndarray:
    """Return the edges of the shortest parametric line of a patch along which a cut brings it nearer to a disk.

    If there is no such line, the shortest of all lines is returned.

    Parameters
    ----------
    layout : mesh and cuts
    patch : number of the patch
    """
    lines = parametric_lines(layout, patch)
    length = layout.mesh.edge_lengths
    keys = [(round(float(length[line].sum()), 12), i) for i, line in enumerate(lines)]
    before = layout.euler_characteristic[patch]
    for _, i in sorted(keys):
        line = lines[i]
        if before == 2 or (line.size and _brings_nearer_to_disk(layout, patch, line)):
            return line
    return lines[sorted(keys)[0][1]]


def _brings_nearer_to_disk(layout: PatchLayout, patch: int, line: np.ndarray) -> bool:
    """Return whether a patch stays connected after a cut along a line; if so, the cut removes a handle or joins outlines."""
    cut = layout.cut.copy()
    cut[line] = True
    after = PatchLayout(layout.mesh, cut)
    return len(np.unique(after.patch_of[layout.patches[patch]])) == 1


def middle_line(layout: PatchLayout, patch: int) -> np.ndarray:
    """Return the edges of the parametric line that halves a patch best: evenly, and with a short cut.

    The result is empty if the patch has no inner edges.

    Parameters
    ----------
    layout : mesh and cuts
    patch : number of the patch
    """
    lines = parametric_lines(layout, patch)
    mesh = layout.mesh
    quads = layout.patches[patch]
    best: tuple[float, int] | None = None
    total = mesh.areas[quads].sum()
    for i, line in enumerate(lines):
        cut = layout.cut.copy()
        cut[line] = True
        parts = PatchLayout(mesh, cut).patch_of[quads]
        area = np.bincount(parts, weights=mesh.areas[quads])
        uneven = area.max() / total
        score = round(float(uneven + 0.1 * mesh.edge_lengths[line].sum() / np.sqrt(total)), 9)
        if best is None or score < best[0]:
            best = (score, i)
    return lines[best[1]] if best is not None else np.zeros(0, dtype=np.int64)


def parametric_lines(layout: PatchLayout, patch: int) -> list[np.ndarray]:
    """Return all parametric lines of a patch: the longest straight lines of uncut edges inside it, as arrays of edges.

    A line ends at a cut, a border or an irregular vertex, or closes on itself.

    Parameters
    ----------
    layout : mesh and cuts
    patch : number of the patch
    """
    mesh = layout.mesh
    inside = np.zeros(len(mesh.edges), dtype=bool)
    inside[layout.uncut_edges[layout.patch_of[mesh.edge_quads[layout.uncut_edges, 0]] == patch]] = True
    edges = np.flatnonzero(inside)
    following = {}
    for way in range(2):
        quad, side = mesh.edge_quads[edges, way], mesh.edge_sides[edges, way]
        vertex = mesh.quads[quad, (side + 1) % 4]
        next_quad, next_side, valid = next_straight_side(mesh, quad, side)
        target = mesh.quad_edges[next_quad, next_side]
        valid &= inside[target] & (layout.cut_degree[vertex] == 0)
        for e, v, t, ok in zip(edges.tolist(), vertex.tolist(), target.tolist(), valid.tolist(), strict=True):
            following[e, v] = t if ok else -1
    lines, seen = [], set()
    for e in edges.tolist():
        if e in seen:
            continue
        line = [e]
        seen.add(e)
        for vertex in mesh.edges[e].tolist():
            edge, v = e, vertex
            while (nxt := following[edge, v]) >= 0 and nxt not in seen:
                seen.add(nxt)
                line.append(nxt)
                a, b = mesh.edges[nxt].tolist()
                edge, v = nxt, (b if v == a else a)
        lines.append(np.sort(np.array(line)))
    return lines
