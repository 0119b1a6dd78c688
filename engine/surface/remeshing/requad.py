"""Quads in the shape of any mesh: every body by itself, by a tool that makes quads of one clean body at a time.

The tool is Blender's (``bridge.hosts.remesh``): QuadriFlow, and a voxel remesh for closed bodies that are not clean. What it
gives is judged and mended here. QuadriFlow works in single precision and refuses or spoils surfaces that are very small
or large, so that it gets every body at one size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ...errors import FlexMapsError
from ...progress import SILENT, Progress
from ..checking.check import Finding, findings
from ..checking.topology import bodies, fans, inconsistent, sides_of, split_vertices
from ..mesh import PolygonMesh
from ..quadrangulation.quadrangulate import quadrangulate
from .mend import FOLDED, POOR, SHARP, USELESS, Target, mended, of_rows
from .quality import quality
from .refine import refined, split

EXTENT = 2.0  # largest extent of what the tool gets; QuadriFlow took every one of 16 surfaces at this size, at 0.16 only some
JOINED = 1e-6  # of the extent: corners nearer than this are one
FEWEST = 6  # quads: a body that would get fewer, as many as a box has, is left out
# what is tried of a body, one after another: QuadriFlow's seed, the share of the wanted count, how often its quads are cut
# into four, and whether it is to keep sharp edges
TRIES = (
    (0, 1.0, 0, False), (0, 1.0, 1, False), (1, 1.0, 1, False), (2, 1.1, 1, False), (0, 1.0, 1, True), (0, 1.0, 0, True),
    (0, 1.0, 2, False), (1, 1.1, 2, True), (1, 1.0, 0, False), (2, 1.1, 0, False), (3, 0.9, 0, False), (4, 1.25, 0, False),
    (5, 0.8, 0, False), (6, 1.6, 0, False),
)  # fmt: skip
# of them are tried whatever the first ones give, and the best taken: over 25 meshes of 1000 quads 680 irregular vertices in
# all instead of 760, in three times the time
CANDIDATES = 8
FLAT = 180.0  # degrees: no fold is as sharp
# degrees from which a fold is followed, how much the quads follow the curvature, and how much the surface is smoothed before:
# what is tried before QuadriFlow; of a body without sharp folds those alone that follow none. On smooth shells 16 halves the
# angle to the curvature, on others it folds the map or brings twice the irregular vertices. Smoothed much, homer gets 34
# irregular vertices instead of QuadriFlow's 62; otherwise there is no map of it
OWN: tuple[tuple[float, float, float], ...] = (
    (SHARP, 16.0, 10.0), (SHARP, 4.0, 10.0), (SHARP, 0.5, 10.0),
    (FLAT, 16.0, 10.0), (FLAT, 4.0, 10.0), (FLAT, 0.5, 10.0), (FLAT, 0.5, 30.0),
)  # fmt: skip
BESIDE = 1  # candidates of QuadriFlow that are tried where one of these has no poor quads
WORTH = 10.0  # so much a share of poor quads costs: with a tenth of them poor, twice as much; not measured
OF_VOXELS = 3  # how many of them a skin of voxels is worth
# voxel sizes in quad edges: fine ones keep detail, coarse ones close what hinders QuadriFlow
VOXELS = (0.35, 0.5, 0.72, 1.0)
ONE_SKIN = 0.95  # share of the voxels' outer skins that the largest must have: nothing but crumbs is lost
ENOUGH = 3  # sound results of which the best is taken, where none is without poor quads
# sizes in quad edges of the polygons that are cut into quads where QuadriFlow finds none; each becomes four or more. Of 5
# letters at 200 to 700 quads that came apart with QuadriFlow, these sizes made 4 whole
CELLS = (2.0, 2.4, 1.6)
MANY = 3  # times the wanted count: so many quads are the small faces of the body itself
LOST = 3  # quad edges that the quads may miss the surface by, one point in twenty apart: thin parts, as a rabbit's ears
# times the surface's area: more has a second skin. A voxel remesh gives an open surface two sides, and of few quads
# QuadriFlow closes it: an open half ball came back with 1.47 to 1.66, all that kept their border with 0.92 to 0.97
DOUBLED = 1.2
# quad edges: a quad fills a hole where all its corners are so near the border, and its middle is off the surface or shows
# its back
AT_BORDER = 0.6
FILLING = 0.1  # quad edges between the middle of a quad and the surface from which on it fills a hole


class Tool(Protocol):
    """Makes quads; every call may take seconds, asks ``progress`` meanwhile, and may come back with nothing."""

    def triangles(self, mesh: PolygonMesh, near: float, progress: Progress) -> PolygonMesh | None:
        """The mesh as triangles, corners nearer than ``near`` joined, nothing without area."""
        ...

    def quads(self, body: PolygonMesh, count: int, seed: int, sharp: bool, progress: Progress) -> PolygonMesh | None:
        """About ``count`` quads of one clean body, along its sharp edges where that is asked for."""
        ...

    def voxels(self, body: PolygonMesh, size: float, progress: Progress) -> PolygonMesh | None:
        """The skin of a closed body as small faces."""
        ...

    def cells(self, body: PolygonMesh, size: float, progress: Progress) -> PolygonMesh | None:
        """A body of large flat faces as polygons of about this size."""
        ...

    def touching(self, parts: list[PolygonMesh], progress: Progress) -> list[tuple[int, int]]:
        """Pairs of bodies whose surfaces cut each other."""
        ...


@dataclass(frozen=True, eq=False)
class Requadded:
    """The quads, and what is to be said of them: parts that were left out or joined."""

    polygons: PolygonMesh
    findings: list[Finding]


def requad(mesh: PolygonMesh, count: int, tool: Tool, progress: Progress = SILENT) -> Requadded:
    """About ``count`` quads in the shape of any mesh; each body gets its share by area.

    Closed bodies that cut each other become one, and so does what is closed but no clean surface. Open parts are cut apart
    where three faces meet. Raises ``FlexMapsError`` where no sound quads are found for a body.
    """
    progress(0.0, "Looking for bodies")
    if not len(mesh.sizes) or not np.isfinite(mesh.vertices[mesh.corners]).all():
        raise FlexMapsError("The mesh has no faces, or corners without a place; give it some, or delete those")
    low, high = mesh.vertices[mesh.corners].min(axis=0), mesh.vertices[mesh.corners].max(axis=0)
    scale = EXTENT / max(float((high - low).max()), 1e-300)
    triangles = tool.triangles(replace(mesh, vertices=(mesh.vertices - low) * scale), JOINED * EXTENT, progress.quiet())
    if triangles is None or not len(triangles.sizes):
        raise FlexMapsError("The faces of the mesh have no area; give it some that have")
    parts, said = _parts(triangles, tool, progress)
    areas = np.array([_target(part).area for part in parts])
    share = count * areas / areas.sum()
    large = share >= min(FEWEST, share.max())
    if not large.all():
        said.append(
            _said(
                "bodies-left-out",
                f"Bodies smaller than {FEWEST} quads of this size were left out: {(~large).sum()} of {len(parts)}, "
                f"{areas[~large].sum() / areas.sum():.2g} of the area; ask for more quads to keep them",
            )
        )
    kept = np.flatnonzero(large)
    made = []
    for done, k in enumerate(kept):
        piece = progress.part(0.05 + 0.95 * done / len(kept), 0.05 + 0.95 * (done + 1) / len(kept))
        name = f" of body {done + 1} of {len(kept)}" if len(kept) > 1 else ""
        made.append(_quads_of(parts[k], max(FEWEST, round(share[k] * count / share[large].sum())), tool, piece, name))
    progress(1.0, "Quads are ready")
    quads = _joined(made)
    return Requadded(replace(quads, vertices=quads.vertices / scale + low), said)


# -- bodies --------------------------------------------------------------------------------------------------------------


def _parts(triangles: PolygonMesh, tool: Tool, progress: Progress) -> tuple[list[PolygonMesh], list[Finding]]:
    """The bodies to be remeshed one by one."""
    whole, said = _apart(triangles), []
    if len(whole) > 1:
        closed = np.array([_is_closed(part) for part in whole])
        joined = np.arange(len(whole))
        for a, b in tool.touching(whole, progress.quiet()):
            if closed[a] and closed[b]:
                joined[joined == joined[b]] = joined[a]
        groups = [np.flatnonzero(joined == k) for k in np.unique(joined)]
        if len(groups) < len(whole):
            said.append(_said("bodies-joined", f"{len(whole)} bodies cut each other and became {len(groups)}"))
        whole = [_joined([whole[k] for k in group]) for group in groups]
    parts = []
    for part in whole:
        clean = _is_clean(part)
        if not clean and not _is_closed(part):
            pieces = _apart(_cut_apart(part))
            if len(pieces) > 1:
                said.append(
                    _said(
                        "bodies-cut",
                        f"Open parts that meet three at an edge were cut apart there, into {len(pieces)} bodies",
                    )
                )
            parts += pieces
        else:
            parts.append(part)
    if any(_has_one_side(part) for part in parts if not _is_closed(part)):
        raise FlexMapsError(
            "A part has only one side, like a Moebius strip: cut it open along a row of edges (V in Blender)"
        )
    return parts, said


def _said(code: str, message: str) -> Finding:
    return Finding(code, "warning", message)


def _apart(mesh: PolygonMesh) -> list[PolygonMesh]:
    """The bodies of a mesh, each with its own vertices and its faces turned the same way."""
    sides = sides_of(mesh)
    body = bodies(sides, len(mesh.sizes))
    turned, _, _ = inconsistent(sides, body)
    corners = mesh.corners.reshape(-1, 3).copy()
    corners[turned] = corners[turned][:, ::-1]
    order = np.argsort(body, kind="stable")
    ends = np.cumsum(np.bincount(body))
    return [of_rows(mesh.vertices, corners[faces]) for faces in np.split(order, ends[:-1])]


def _cut_apart(mesh: PolygonMesh) -> PolygonMesh:
    """Every fan of faces round a vertex gets a vertex of its own; at an edge of three faces or more all part."""
    fan = fans(sides_of(mesh))
    _, first = np.unique(fan, return_index=True)
    return PolygonMesh(mesh.vertices[mesh.corners[first]], fan.astype(np.int64), mesh.sizes)


def _has_one_side(mesh: PolygonMesh) -> bool:
    sides = sides_of(mesh)
    return bool(len(inconsistent(sides, bodies(sides, len(mesh.sizes)))[1]))


def _is_closed(mesh: PolygonMesh) -> bool:
    return bool((np.bincount(sides_of(mesh).edge) > 1).all())


def _is_clean(mesh: PolygonMesh) -> bool:
    """Whether it is one body of two sides, with at most two faces at an edge and one fan at a vertex."""
    sides = sides_of(mesh)
    if not len(mesh.sizes) or np.bincount(sides.edge).max() > 2 or len(split_vertices(mesh, sides)):
        return False
    body = bodies(sides, len(mesh.sizes))
    turned, one_sided, _ = inconsistent(sides, body)
    return body.max() == 0 and not len(turned) and not len(one_sided)


def _joined(parts: list[PolygonMesh]) -> PolygonMesh:
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return PolygonMesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.corners + k for part, k in zip(parts, first, strict=False)]),
        np.concatenate([part.sizes for part in parts]),
    )


def _target(mesh: PolygonMesh) -> Target:
    """A mesh of triangles or quads as the surface that quads are to lie on."""
    starts = np.cumsum(mesh.sizes) - mesh.sizes
    rows = [
        np.stack([mesh.corners[starts[mesh.sizes > k + 1] + j] for j in (0, k, k + 1)], axis=1)
        for k in range(1, int(mesh.sizes.max()) - 1)
    ]
    return Target(np.ascontiguousarray(mesh.vertices, float), np.concatenate(rows).astype(np.int64))


# -- one body ------------------------------------------------------------------------------------------------------------


def _quads_of(body: PolygonMesh, count: int, tool: Tool, progress: Progress, name: str) -> PolygonMesh:
    """About ``count`` sound quads of one body; the best of what is tried."""
    low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
    middle, scale = 0.5 * (low + high), EXTENT / max(float((high - low).max()), 1e-300)
    small = replace(body, vertices=(body.vertices - middle) * scale)
    whole = _target(small)
    found: list[Judged] = []
    tried, last = 0, ""
    for surface in _surfaces(small, whole, count, tool, progress.quiet()):
        for how in OWN if len(_target(surface).sharp) else [one for one in OWN if one[0] == FLAT]:
            progress(1.0 - 0.85**tried, f"Quads along the curvature{name}")
            tried += 1
            judged = _own(surface, whole, count, how, progress.quiet())
            if isinstance(judged, Judged):
                found.append(judged)
        enough = BESIDE if any(not any(one.faults) for one in found) else CANDIDATES
        for number, (seed, factor, times, sharp) in enumerate(TRIES if surface is small else TRIES[:OF_VOXELS], 1):
            tried += 1
            progress(1.0 - 0.85**tried, f"QuadriFlow: try {tried}{name}")
            raw = tool.quads(surface, max(FEWEST, round(factor * count / 4**times)), seed, sharp, progress.quiet())
            if raw is None or not len(raw.sizes):
                last = last or "QuadriFlow finds none"
            elif isinstance(judged := _judged(raw, whole, count, times, sharp), str):
                last = judged
            else:
                found.append(judged)
            sound = [one for one in found if not one.faults[0]]
            if number >= enough and sound and (len(found) >= ENOUGH or not any(sound[0].faults)):
                break
        if found:
            break
    if not found and _is_clean(small) and not _is_closed(small):
        found += _by_cells(small, whole, count, tool, progress.quiet())
    if not found:
        raise FlexMapsError(
            f"No sound quads were found{name}: {last or 'it is no clean surface, neither by itself nor as voxels'}. "
            "Give another quad count; give open parts a thickness, and remove what is inside or folded"
        )
    best = min(found, key=lambda one: (*one.faults[:2], one.cost)).quads
    return replace(best, vertices=best.vertices / scale + middle)


def _own(
    surface: PolygonMesh, whole: Target, count: int, how: tuple[float, float, float], progress: Progress
) -> Judged | str:
    """Quads along the curvature, judged, or why there are none; ``how`` as in ``OWN``."""
    triangles, (fold, alignment, smoothing) = _target(surface), how
    edge = (triangles.area / count) ** 0.5
    given = of_rows(triangles.vertices, triangles.triangles)
    try:
        raw = quadrangulate(given, edge, np.radians(fold), alignment, smoothing, progress)
    except FlexMapsError as error:
        return str(error)
    return _judged(raw, whole, count, 0, fold < FLAT)


def _surfaces(body: PolygonMesh, target: Target, count: int, tool: Tool, progress: Progress) -> Iterator[PolygonMesh]:
    """What QuadriFlow is to work on: the body itself if it is clean, then its skins of voxels, the finest first."""
    if _is_clean(body):
        yield body
    edge = (target.area / count) ** 0.5
    for factor in VOXELS:
        skin = tool.voxels(body, factor * edge, progress)
        if skin is None or not len(skin.sizes):
            continue
        largest = _outer(skin)
        if largest is not None and _is_clean(largest):
            yield largest


def _outer(skin: PolygonMesh) -> PolygonMesh | None:
    """The one outer skin of a voxel remesh, without those round cavities; ``None`` where there are several."""
    if not (skin.sizes == 4).all():
        return None
    rows, body = skin.corners.reshape(-1, 4), bodies(sides_of(skin), len(skin.sizes))
    p = skin.vertices[rows]
    across = 0.5 * np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
    volume = np.bincount(body, np.einsum("fi,fi->f", p.mean(axis=1), across))
    area = np.bincount(body, np.linalg.norm(across, axis=1)) * (volume > 0)
    if not area.any() or area.max() < ONE_SKIN * area.sum():
        return None
    return of_rows(skin.vertices, rows[body == area.argmax()])


def _by_cells(body: PolygonMesh, whole: Target, count: int, tool: Tool, progress: Progress) -> Iterator[Judged]:
    """Sound quads of an open body of large flat faces, as a letter, on which QuadriFlow often comes apart."""
    for factor in CELLS:
        polygons = tool.cells(body, factor * (whole.area / count) ** 0.5, progress)
        if polygons is None or not len(polygons.sizes) or len(polygons.corners) > MANY * count:
            continue
        judged = _judged(split(polygons), whole, count)
        if isinstance(judged, Judged):
            yield judged


@dataclass(frozen=True, eq=False)
class Judged:
    """Sound quads.

    faults : in how many no spiral has room, by how many whole quad edges parts of the surface are missed, how many are poor
    cost : of ``quality.Quality``, and more for poor quads and for other than the wanted count
    """

    quads: PolygonMesh
    faults: tuple[int, int, int]
    cost: float


def _judged(raw: PolygonMesh, whole: Target, count: int, times: int = 0, sharp: bool = False) -> Judged | str:
    """The quads cut into four ``times`` times, mended and judged, or why they are no use."""
    if not (raw.sizes == 4).all():
        return "QuadriFlow left faces that are no quads"
    if not _is_clean(raw):
        return "its quads are no clean surface"
    opened = _opened(raw, whole)
    quads = mended(refined(opened, whole, times) if times or sharp else opened, whole)
    found = findings(quads)
    errors = [f for f in found if f.is_error]
    if errors:
        folded = sum(len(f.faces) for f in errors if f.code in FOLDED)
        return f"{folded} of {len(quads.sizes)} quads are folded" if folded else "its quads differ too much in size"
    made = _target(quads)
    edge = (whole.area / count) ** 0.5
    if made.area > DOUBLED * whole.area:
        return "its open side was closed, or both of its sides were covered"
    missed = int(
        max(np.percentile(made.distances(whole.samples), 95), np.percentile(whole.distances(made.samples), 95)) / edge
    )
    if missed >= LOST:
        return "parts of the surface are lost"
    useless, poor = (sum(len(f.faces) for f in found if f.code in codes) for codes in (USELESS, POOR))
    cost = (
        quality(quads, whole).cost
        * (1.0 + WORTH * poor / len(quads.sizes))
        * (1.0 + abs(len(quads.sizes) / count - 1.0))
    )
    return Judged(quads, (useless, missed, poor), cost)


def _opened(raw: PolygonMesh, whole: Target) -> PolygonMesh:
    """Without the quads that fill holes: QuadriFlow fills every one that has no more than 25 of its edges round it."""
    rows = raw.corners.reshape(-1, 4)
    size = (_target(raw).area / len(rows)) ** 0.5
    at_border = whole.to_border(raw.vertices) < AT_BORDER * size
    corners = raw.vertices[rows]
    middles = corners.mean(axis=1)
    there, normals = whole.nearest(middles)
    across = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    back = np.einsum("fi,fi->f", across, normals) < 0  # over a flat part the filling is its other side
    filling = at_border[rows].all(axis=1) & (back | (np.linalg.norm(there - middles, axis=1) > FILLING * size))
    if not filling.any() or filling.all():
        return raw
    opened = of_rows(raw.vertices, rows[~filling])
    return opened if _is_clean(opened) else raw
