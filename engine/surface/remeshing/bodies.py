"""Split a mesh into bodies that are remeshed one by one.

A body is a connected component. Closed bodies that intersect are joined; open parts are cut apart at edges of three or
more faces.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Bool, Float, Int
from ...errors import FlexMapsError
from ...progress import Progress
from ..checking.check import Finding
from ..checking.topology import bodies, corner_fans, non_manifold_vertices, orientation_faults, sides_of
from ..mesh import PolygonMesh
from .mend import TargetSurface, mesh_from_rows
from .tool import RemeshTool

# Small bodies are kept if all kept bodies together need at most this multiple of the wanted number of quads. Larger: more
# small bodies are kept, but a mesh of loose faces, whose vertices should be merged instead, is remeshed too.
BEYOND = 2


def to_triangles(mesh: PolygonMesh, tolerance: float, tool: RemeshTool, progress: Progress) -> PolygonMesh:
    """Return a mesh as triangles, with corners nearer to each other than the tolerance merged.

    Parameters
    ----------
    mesh : mesh with any faces
    tolerance : distance below which corners are merged, in the mesh's units
    tool : remesher that makes the triangles
    progress : may cancel

    Raises
    ------
    FlexMapsError : no face has an area
    """
    triangles = tool.triangles(mesh, tolerance, progress.quiet())
    if triangles is None or not len(triangles.sizes):
        raise FlexMapsError("The faces of the mesh have no area; choose an object whose faces have some")
    return triangles


def find_bodies(
    triangles: PolygonMesh, tool: RemeshTool, progress: Progress
) -> tuple[list[PolygonMesh], list[Finding]]:
    """Return the bodies to remesh one by one, and warnings about bodies that were joined or cut apart.

    Parameters
    ----------
    triangles : the whole mesh, as triangles
    tool : remesher, which finds intersecting bodies
    progress : may cancel

    Raises
    ------
    FlexMapsError : a body has only one side, like a Moebius strip
    """
    whole, found = split_components(triangles), []
    if len(whole) > 1:
        closed = np.array([is_closed(part) for part in whole])
        group_of = np.arange(len(whole))
        for a, b in tool.intersecting_pairs(whole, progress.quiet()):
            if closed[a] and closed[b]:
                group_of[group_of == group_of[b]] = group_of[a]
        groups = [np.flatnonzero(group_of == k) for k in np.unique(group_of)]
        if len(groups) < len(whole):
            found.append(
                make_warning(
                    "bodies-joined",
                    f"{len(whole)} bodies went through each other and became {len(groups)}; to keep them apart, move them away from each other",
                )
            )
        whole = [concatenate_meshes([whole[k] for k in group]) for group in groups]
    parts = []
    for part in whole:
        clean = is_clean(part)
        if not clean and not is_closed(part):
            pieces = split_components(split_non_manifold(part))
            if len(pieces) > 1:
                found.append(
                    make_warning(
                        "bodies-cut",
                        f"Three or more parts of the surface met at an edge; they were cut apart there, and each of the {len(pieces)} bodies is made by itself",
                    )
                )
            parts += pieces
        else:
            parts.append(part)
    if any(is_one_sided(part) for part in parts if not is_closed(part)):
        raise FlexMapsError(
            "A part has only one side, like a Moebius strip: cut it open along a row of edges (V in Blender)"
        )
    return parts, found


def choose_bodies(
    areas: Float[np.ndarray, " bodies"], count: int, fewest: Int[np.ndarray, " bodies"], crumbs: float
) -> tuple[Bool[np.ndarray, " bodies"], list[Finding]]:
    """Decide which bodies get quads and which are left out; report the bodies that are left out.

    Quads are shared out by area. The largest body is kept, and every body whose share reaches its minimum; further
    bodies are kept, the largest first, until at most ``crumbs`` of the area is left out.

    Parameters
    ----------
    areas : area of each body, any unit
    count : total number of quads wanted
    fewest : minimum number of quads of each body
    crumbs : share of the area that may be left out

    Returns
    -------
    mask of bodies to keep; warnings

    Raises
    ------
    FlexMapsError : more than ``crumbs`` of the area would be left out, because the bodies would need more than ``BEYOND``
        times ``count`` quads
    """
    share = areas / areas.sum()
    large = share * count >= np.minimum(fewest, share.max() * count)
    order = np.argsort(-areas, kind="stable")
    needed = np.flatnonzero(1.0 - np.cumsum(share[order]) <= crumbs)
    if len(needed) and fewest[order[: needed[0] + 1]].sum() <= BEYOND * count:
        large[order[: needed[0] + 1]] = True
    if large.all():
        return large, []
    left, many = float(share[~large].sum()), int((~large).sum())
    enough = int(np.ceil((fewest / np.maximum(share, 1e-9)).max() / 10.0) * 10)
    few = " or ".join(str(number) for number in np.unique(fewest[~large]))
    which = (
        f"{many} of {len(areas)} bodies would get fewer than {few} quads of this size: {100 * left:.2g} % of the area"
    )
    if left > crumbs * (1.0 + 1e-9):
        raise FlexMapsError(
            f"{which}. To keep them, ask for {enough} quads (--remesh {enough}); to leave them out, allow that (Left out at most, "
            f"--crumbs {np.ceil(100 * left) / 100:g}); if they should be one body, merge their vertices (Merge by Distance)",
            quads=enough,
        )
    return large, [
        make_warning("bodies-left-out", f"{which}, and they were left out; ask for {enough} quads to keep them")
    ]


def make_warning(code: str, message: str) -> Finding:
    """Return a finding with severity "warning"."""
    return Finding(code, "warning", message)


def split_components(mesh: PolygonMesh) -> list[PolygonMesh]:
    """Split a triangle mesh into its connected components, each with its own vertices and consistent orientation."""
    sides = sides_of(mesh)
    body = bodies(sides, len(mesh.sizes))
    turned, _, _ = orientation_faults(sides, body)
    corners = mesh.corners.reshape(-1, 3).copy()
    corners[turned] = corners[turned][:, ::-1]
    order = np.argsort(body, kind="stable")
    ends = np.cumsum(np.bincount(body))
    return [mesh_from_rows(mesh.vertices, corners[faces]) for faces in np.split(order, ends[:-1])]


def split_non_manifold(mesh: PolygonMesh) -> PolygonMesh:
    """Return a mesh in which every fan of faces has a vertex of its own, which separates edges of three or more faces."""
    fan = corner_fans(sides_of(mesh))
    _, first = np.unique(fan, return_index=True)
    return PolygonMesh(mesh.vertices[mesh.corners[first]], fan.astype(np.int64), mesh.sizes)


def is_one_sided(mesh: PolygonMesh) -> bool:
    """Return whether a body is not orientable, like a Moebius strip."""
    sides = sides_of(mesh)
    return bool(len(orientation_faults(sides, bodies(sides, len(mesh.sizes)))[1]))


def is_closed(mesh: PolygonMesh) -> bool:
    """Return whether every edge has at least two faces."""
    return bool((np.bincount(sides_of(mesh).edge) > 1).all())


def is_clean(mesh: PolygonMesh) -> bool:
    """Return whether a mesh is connected, manifold and consistently oriented."""
    sides = sides_of(mesh)
    if not len(mesh.sizes) or np.bincount(sides.edge).max() > 2 or len(non_manifold_vertices(mesh, sides)):
        return False
    body = bodies(sides, len(mesh.sizes))
    turned, one_sided, _ = orientation_faults(sides, body)
    return body.max() == 0 and not len(turned) and not len(one_sided)


def concatenate_meshes(parts: list[PolygonMesh]) -> PolygonMesh:
    """Concatenate meshes to one mesh without merging vertices."""
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return PolygonMesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.corners + k for part, k in zip(parts, first, strict=False)]),
        np.concatenate([part.sizes for part in parts]),
    )


def target_surface(mesh: PolygonMesh) -> TargetSurface:
    """Triangulate a mesh, each face as a fan from its first corner, into a surface to project onto."""
    rows = [
        np.stack([mesh.corners[mesh.starts[mesh.sizes > k + 1] + j] for j in (0, k, k + 1)], axis=1)
        for k in range(1, int(mesh.sizes.max()) - 1)
    ]
    return TargetSurface(np.ascontiguousarray(mesh.vertices, float), np.concatenate(rows).astype(np.int64))
