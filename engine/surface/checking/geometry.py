"""Checks of where the vertices of an unchecked polygon mesh lie: degenerate faces, and sizes that cannot be made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...arrays import Float
from ..mesh import PolygonMesh
from .finding import REMESH, Finding, counted, finding, named
from .topology import Sides, sides_of

RATIO_ERROR, RATIO_WARNING = 10.0, 3.0  # 99th to 1st percentile of the faces' mean edge lengths
SIZES = 1e-6, 1e6  # metres: least and largest median edge; beyond these nothing can be cut, whatever the units
FAR = 1e6  # so many times further from the middle than half of all vertices: no mesh of quads has that by intent
ROUNDED = 1e-6  # of the median edge: how far the rounding of double precision may displace a vertex
FOLDED = -1.0 + 1e-8  # cosine between the normals of neighbours (0.008 degrees short of lying on each other)
SMALL = 0.01  # metres: side of the smallest quad that takes a spiral well
STEP = 0.05  # to multiples of which it is rounded how much larger a model would have to be
WARP = np.radians(60.0)  # largest angle between the normals at two neighbouring corners of a quad
# least breadth of a quad, in median edges: of 20 mm it leaves arms of 1.5 mm, of half as much none that can be cut
THIN = 0.1


def in_unit(polygons: PolygonMesh) -> tuple[PolygonMesh, int]:
    """The mesh with coordinates of about 1, whose squares and cubes are numbers too, and the power of two that it was divided by.

    A power of two, so that no digit changes.
    """
    vertices = np.asarray(polygons.vertices, float)
    largest = float(np.abs(vertices[polygons.corners]).max(initial=0.0))
    power = int(np.frexp(largest)[1]) if np.isfinite(largest) else 0
    with np.errstate(over="ignore"):  # of vertices that belong to no face
        return replace(polygons, vertices=np.ldexp(vertices, -power)), power


def lengths_of(polygons: PolygonMesh, sides: Sides) -> Float[np.ndarray, " edges"]:
    """The length of every edge."""
    a, b = polygons.vertices[sides.edges.T]
    return np.linalg.norm(np.asarray(b, float) - a, axis=1)


def far_out(polygons: PolygonMesh, face_of: np.ndarray) -> list[Finding]:
    """Vertices that are nowhere near the others, or a mesh that is nowhere near the origin."""
    used = np.unique(polygons.corners)
    p = polygons.vertices[used]
    away = np.abs(p - np.median(p, axis=0)).max(axis=1)
    typical = float(np.median(away))
    far = used[away > FAR * typical] if typical > 0 else used[:0]
    if len(far):
        faces = np.unique(face_of[np.isin(polygons.corners, far)])
        text = f"{counted(len(far), 'vertex lies', 'vertices lie')} more than {FAR:g} times as far out as the others, at {named(faces)}: move them back or delete them"
        return [finding("far-vertices", text, faces)]
    edge = float(np.median(lengths_of(polygons, sides_of(polygons))))
    if 0 < edge * ROUNDED < np.abs(p).max() * np.finfo(float).eps:
        text = f"The mesh lies {np.abs(p).max() / edge:.1g} edges away from the origin, so far that its positions are rounded: move it to the origin and export it again"
        return [finding("far-from-origin", text)]
    return []


def degenerate(polygons: PolygonMesh, sides: Sides) -> list[Finding]:
    """Edges without length, faces without area, crossed and folded ones; concave and warped quads too."""
    found = []
    lengths = lengths_of(polygons, sides)
    middle = float(np.median(lengths))
    area_vectors = area_vectors_of(polygons, sides)
    areas = np.linalg.norm(area_vectors, axis=1)
    short = np.flatnonzero(lengths <= 1e-6 * middle)
    if len(short):
        faces = np.unique(sides.face[np.isin(sides.edge, short)])
        text = f"{counted(len(short), 'edge has', 'edges have')} no length, at {named(faces)}: use Merge by Distance"
        found.append(finding("zero-edge", text, faces, short))
    flat = np.flatnonzero(areas <= 1e-6 * middle**2)
    bows = flat[_corner_areas(polygons, sides)[flat] > 1e-6 * middle**2]  # two halves of a bow tie cancel out
    flat = np.setdiff1d(flat, bows)
    if len(flat):
        found.append(finding("zero-area", f"{named(flat)} without area: dissolve or collapse them", flat))
    quads = np.setdiff1d(np.flatnonzero(polygons.sizes == 4), flat)
    found += _quads(polygons, quads, area_vectors, bows, middle)
    one, two = sides.pairs[sides.forward[sides.pairs[:, 0]] != sides.forward[sides.pairs[:, 1]]].T
    unit = area_vectors / np.maximum(areas, 1e-300)[:, None]
    f, g = sides.face[one], sides.face[two]
    on = np.einsum("di,di->d", unit[f], unit[g]) < FOLDED
    if on.any():
        faces = np.unique([f[on], g[on]])
        text = f"{named(faces)} folded back upon a neighbour, so that both lie in one place: open the fold, or delete one of the two"
        found.append(finding("folded", text, faces, sides.edge[one[on]]))
    return found


def _corner_areas(polygons: PolygonMesh, sides: Sides) -> Float[np.ndarray, " faces"]:
    """The largest parallelogram at a corner of every face, between the sides that meet there."""
    p = polygons.vertices
    starts = np.cumsum(polygons.sizes) - polygons.sizes
    side = p[sides.following] - p[polygons.corners]
    return np.maximum.reduceat(np.linalg.norm(np.cross(side, side[sides.after]), axis=1), starts)


def sizes(polygons: PolygonMesh, sides: Sides, body: np.ndarray, edge: float | None, power: int) -> list[Finding]:
    """Sizes that cannot be made, of a mesh that was divided by 2^power, or as if scaled to ``edge``, metres; bodies inside out."""
    found = []
    lengths = lengths_of(polygons, sides)
    middle = float(np.median(lengths))
    area_vectors = area_vectors_of(polygons, sides)
    areas = np.linalg.norm(area_vectors, axis=1)
    ratio = _size_ratio(polygons, sides, lengths)
    if ratio is not None:
        found.append(ratio)
    if edge is None or middle <= 0:
        with np.errstate(over="ignore"):
            scale = float(np.ldexp(1.0, power))
        if middle > 0 and not SIZES[0] <= middle * scale <= SIZES[1]:
            text = f"The edges measure {middle * scale * 1e3:.3g} mm, which is no size to cut: scale the mesh to the quad edge that is wanted"
            return [*found, finding("size", text)]
    else:
        scale = edge / middle
    side = np.sqrt(areas) * scale
    small = np.flatnonzero((side < SMALL * (1 - 1e-6)) & (areas > 1e-6 * middle**2))
    if len(small):
        least = float(side[small].min())
        text = f"{named(small)} under {SMALL * 1e3:g} mm (the smallest is {least * 1e3:.3g} mm): make the model larger or remesh coarser"
        times = round(STEP * float(np.ceil(SMALL / least / STEP)), 2)
        found.append(replace(finding("small-quads", text, small, severity="warning"), larger=times))
    return found + _inside_out(polygons, sides, body, area_vectors)


def area_vectors_of(polygons: PolygonMesh, sides: Sides) -> Float[np.ndarray, "faces 3"]:
    """Half the sum of cross products round every face, about its first corner."""
    p = np.asarray(polygons.vertices, float)
    starts = np.cumsum(polygons.sizes) - polygons.sizes
    origin = p[polygons.corners[starts]][sides.face]
    crosses = np.cross(p[polygons.corners] - origin, p[sides.following] - origin)
    return 0.5 * np.add.reduceat(crosses, starts, axis=0)


def breadth(corners: Float[np.ndarray, "faces 4 3"]) -> Float[np.ndarray, " faces"]:
    """How much room quads leave for a cross of arms to the middles of their sides; a square's is its side.

    Arms of the width w whose straight centre lines cross at the acute angle t touch each other up to w / (2 tan(t / 2))
    from the middle of the quad. The breadth is the w at which that is the whole of the shorter arms.
    """
    p = np.asarray(corners, float)
    sides = 0.5 * (p + np.roll(p, -1, axis=1))
    one, two = sides[:, 2] - sides[:, 0], sides[:, 3] - sides[:, 1]  # they halve each other
    across = np.linalg.norm(np.cross(one, two), axis=1)
    shorter = np.minimum(np.linalg.norm(one, axis=1), np.linalg.norm(two, axis=1))
    return shorter * np.tan(0.5 * np.arctan2(across, np.abs(np.einsum("fi,fi->f", one, two))))


def _quads(
    polygons: PolygonMesh, quads: np.ndarray, area_vectors: np.ndarray, bows: np.ndarray, middle: float
) -> list[Finding]:
    """Crossed, concave, thin and warped quads; ``bows`` are known to be crossed, ``middle`` is the median edge."""
    starts = np.cumsum(polygons.sizes) - polygons.sizes
    p = np.asarray(polygons.vertices, float)[polygons.corners[starts[quads][:, None] + np.arange(4)]]
    normals = np.cross(np.roll(p, -1, axis=1) - p, np.roll(p, 1, axis=1) - p)
    inward = (np.einsum("qki,qi->qk", normals, area_vectors[quads]) < 0).sum(axis=1)
    found = []
    crossed, concave = np.union1d(quads[inward > 1], bows), np.setdiff1d(quads[inward == 1], bows)
    if len(crossed):
        text = f"{named(crossed)} whose sides cross or which are folded over: move their corners or {REMESH}"
        found.append(finding("crossed", text, crossed))
    if len(concave):
        text = f"{named(concave)} with a corner beyond 180 degrees: the spiral there will be poor; regularise"
        found.append(finding("concave", text, concave, severity="warning"))
    slim = np.setdiff1d(quads[(breadth(p) < THIN * middle) & (inward < 2)], bows)
    if len(slim):
        text = f"{named(slim)} too thin for a spiral, or pointed like a needle: regularise, collapse them or {REMESH}"
        found.append(finding("thin", text, slim, severity="warning"))
    unit = normals / np.maximum(np.linalg.norm(normals, axis=2), 1e-300)[..., None]
    bend = np.arccos(np.clip(np.einsum("qki,qki->qk", unit, np.roll(unit, -1, axis=1)), -1, 1)).max(axis=1)
    warped = np.setdiff1d(quads[(bend > WARP) & (inward == 0)], bows)
    if len(warped):
        worst = np.degrees(bend[inward == 0].max())
        text = f"{named(warped)} far from flat (up to {worst:.0f} degrees between corners): regularise, or remesh finer there"
        found.append(finding("warped", text, warped, severity="warning"))
    return found


def _size_ratio(polygons: PolygonMesh, sides: Sides, lengths: np.ndarray) -> Finding | None:
    """Sizes are compared face by face, by their mean edge: oblong quads are a matter of regularity, not of size."""
    size = np.bincount(sides.face, lengths[sides.edge]) / polygons.sizes
    low, high = np.percentile(size, [1, 99])
    ratio = float(high / low) if low > 0 else float("inf")
    if ratio <= RATIO_WARNING:
        return None
    severe = ratio > RATIO_ERROR
    limit = RATIO_ERROR if severe else RATIO_WARNING
    # the culprits: faces further from the median than an even spread of the allowed ratio would reach
    middle = np.median(size)
    off = np.flatnonzero((size > middle * np.sqrt(limit)) | (size < middle / np.sqrt(limit)))
    text = f"Face sizes differ too much: the largest are {ratio:.3g} times the smallest (99th to 1st percentile), see {named(off)}"
    if severe:
        text += f"; above {RATIO_ERROR:g} the surface cannot be made: {REMESH}"
    else:
        text += f"; even sizes, below {RATIO_WARNING:g}, hold the shape better"
    return finding("size-ratio", text, off, severity="error" if severe else "warning")


def _inside_out(polygons: PolygonMesh, sides: Sides, body: np.ndarray, area_vectors: np.ndarray) -> list[Finding]:
    """Closed bodies with a negative volume."""
    starts = np.cumsum(polygons.sizes) - polygons.sizes
    p = np.asarray(polygons.vertices, float)
    centre = np.add.reduceat(p[polygons.corners], starts, axis=0) / polygons.sizes[:, None]
    origin = p[polygons.corners].mean(axis=0)
    volume = np.bincount(body, np.einsum("fi,fi->f", centre - origin, area_vectors))
    closed = np.ones(len(volume), dtype=bool)
    uses = np.bincount(sides.edge, minlength=len(sides.edges))
    closed[body[sides.face[uses[sides.edge] == 1]]] = False
    faces = np.flatnonzero((closed & (volume < 0))[body])
    if not len(faces):
        return []
    text = f"The normals of {named(faces)} point inwards: use Recalculate Outside (Shift+N in Blender) unless that is meant"
    return [finding("inside-out", text, faces, severity="warning")]
