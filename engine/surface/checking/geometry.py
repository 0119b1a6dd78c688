"""Geometric checks of any polygon mesh: degenerate faces, and sizes that cannot be fabricated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...arrays import Float
from ...tolerances import SINGLE_TOL
from ..mesh import PolygonMesh
from .finding import REMESH, Finding, list_faces, make_finding, with_count
from .topology import Sides, sides_of

# Ratio of the 99th to the 1st percentile of the faces' mean edge lengths, above which there is an error or a warning.
# Larger: meshes with more uneven quads are accepted.
RATIO_ERROR, RATIO_WARNING = 10.0, 3.0
SIZES = 1e-6, 1e6  # smallest and largest plausible median edge, metres; beyond these the unit must be wrong
# Largest distance of a vertex from the median position of all vertices, as a multiple of the median distance. Larger:
# fewer vertices are reported as stray.
FAR = 1e6
# Cosine between the normals of neighbouring faces, below which they count as lying on each other (within 0.008 degrees).
FOLDED = -1.0 + 1e-8
SMALL = 0.01  # smallest side of a quad without a warning, metres; smaller: spirals too stiff to bend pass unnoticed
STEP = 0.05  # the suggested factor by which a model must grow is rounded up to a multiple of this
# Largest angle between the normals at two neighbouring corners of a quad without a warning, radians. Larger: quads that
# are farther from flat pass.
WARP = np.radians(60.0)
# Smallest breadth of a quad (see ``breadth``) without a warning, in median edges: with edges of 20 mm it leaves arms
# 1.5 mm wide. Smaller: quads pass whose arms are too thin to cut.
THIN = 0.1


def scale_to_unit(polygons: PolygonMesh) -> tuple[PolygonMesh, int]:
    """Return a mesh whose coordinates are scaled to about 1, so that their squares and cubes do not overflow.

    Returns
    -------
    the mesh, scaled by a power of two, 2^-k, which causes no rounding; k
    """
    vertices = np.asarray(polygons.vertices, float)
    largest = float(np.abs(vertices[polygons.corners]).max(initial=0.0))
    power = int(np.frexp(largest)[1]) if np.isfinite(largest) else 0
    with np.errstate(over="ignore"):  # unused vertices may overflow
        return replace(polygons, vertices=np.ldexp(vertices, -power)), power


def edge_lengths(polygons: PolygonMesh, sides: Sides) -> Float[np.ndarray, " edges"]:
    """Return the length of every edge, in the mesh's unit; ``sides`` are the sides of the mesh."""
    a, b = polygons.vertices[sides.edges.T]
    return np.linalg.norm(np.asarray(b, float) - a, axis=1)


def position_findings(polygons: PolygonMesh, face_of: np.ndarray) -> list[Finding]:
    """Report vertices far from all others, or a mesh too far from the origin.

    Parameters
    ----------
    polygons : mesh scaled by ``scale_to_unit``
    face_of : face of every corner
    """
    used = np.unique(polygons.corners)
    p = polygons.vertices[used]
    away = np.abs(p - np.median(p, axis=0)).max(axis=1)
    typical = float(np.median(away))
    far = used[away > FAR * typical] if typical > 0 else used[:0]
    if len(far):
        faces = np.unique(face_of[np.isin(polygons.corners, far)])
        text = f"{with_count(len(far), 'vertex lies', 'vertices lie')} more than {FAR:g} times as far out as the others, at {list_faces(faces)}: move or delete {'it' if len(far) == 1 else 'them'}"
        return [make_finding("far-vertices", text, faces)]
    edge = float(np.median(edge_lengths(polygons, sides_of(polygons))))
    if 0 < edge * SINGLE_TOL < np.abs(p).max() * np.finfo(float).eps:
        text = f"The mesh lies {np.abs(p).max() / edge:.1g} edges away from the origin, so far that its positions are rounded: move it to the origin and export it again"
        return [make_finding("far-from-origin", text)]
    return []


def degeneracy_findings(polygons: PolygonMesh, sides: Sides) -> list[Finding]:
    """Report edges without length, faces without area, and crossed, folded, concave, thin and warped quads.

    Parameters
    ----------
    polygons : mesh scaled by ``scale_to_unit``
    sides : sides of that mesh
    """
    found = []
    lengths = edge_lengths(polygons, sides)
    middle = float(np.median(lengths))
    area_vectors = area_vectors_of(polygons, sides)
    areas = np.linalg.norm(area_vectors, axis=1)
    short = np.flatnonzero(lengths <= SINGLE_TOL * middle)
    if len(short):
        faces = np.unique(sides.face[np.isin(sides.edge, short)])
        text = f"{with_count(len(short), 'edge has', 'edges have')} no length, at {list_faces(faces)}: merge both ends (Merge by Distance)"
        found.append(make_finding("zero-edge", text, faces, short))
    flat = np.flatnonzero(areas <= SINGLE_TOL * middle**2)
    # a crossed quad also has no area, as its two halves cancel each other
    bows = flat[_corner_areas(polygons, sides)[flat] > SINGLE_TOL * middle**2]
    flat = np.setdiff1d(flat, bows)
    if len(flat):
        text = f"{list_faces(flat, 'has', 'have')} no area: dissolve {'it' if len(flat) == 1 else 'them'}"
        found.append(make_finding("zero-area", text, flat))
    quads = np.setdiff1d(np.flatnonzero(polygons.sizes == 4), flat)
    found += _quad_findings(polygons, quads, area_vectors, bows, middle)
    one, two = sides.pairs[sides.forward[sides.pairs[:, 0]] != sides.forward[sides.pairs[:, 1]]].T
    unit = area_vectors / np.maximum(areas, 1e-300)[:, None]
    f, g = sides.face[one], sides.face[two]
    on = np.einsum("di,di->d", unit[f], unit[g]) < FOLDED
    if on.any():
        faces = np.unique([f[on], g[on]])
        text = f"{list_faces(faces, 'is', 'are')} folded back upon a neighbour, so that both lie in one place: delete one of the two, or open the fold"
        found.append(make_finding("folded", text, faces, sides.edge[one[on]]))
    return found


def _corner_areas(polygons: PolygonMesh, sides: Sides) -> Float[np.ndarray, " faces"]:
    """Return, for each face, the area of the largest parallelogram that two of its adjacent sides span."""
    p = polygons.vertices
    side = p[sides.end_vertex] - p[polygons.corners]
    return np.maximum.reduceat(np.linalg.norm(np.cross(side, side[sides.next_side]), axis=1), polygons.starts)


def size_findings(
    polygons: PolygonMesh, sides: Sides, body: np.ndarray, edge: float | None, power: int
) -> list[Finding]:
    """Report sizes that are too small, too large or too uneven, and closed bodies turned inside out.

    Parameters
    ----------
    polygons : mesh divided by 2^``power``, see ``scale_to_unit``
    sides, body : sides of that mesh, and body of each of its faces
    edge : median edge length to which the mesh will be scaled, metres; None to check its present size
    power : exponent k of ``scale_to_unit``
    """
    found = []
    lengths = edge_lengths(polygons, sides)
    middle = float(np.median(lengths))
    area_vectors = area_vectors_of(polygons, sides)
    areas = np.linalg.norm(area_vectors, axis=1)
    ratio = _size_ratio_finding(polygons, sides, lengths)
    if ratio is not None:
        found.append(ratio)
    if edge is None or middle <= 0:
        with np.errstate(over="ignore"):
            scale = float(np.ldexp(1.0, power))
        if middle > 0 and not SIZES[0] <= middle * scale <= SIZES[1]:
            text = f"The edges measure {middle * scale * 1e3:.3g} mm, which cannot be cut: press Scale to quad edge"
            return [*found, make_finding("size", text)]
    else:
        scale = edge / middle
    side = np.sqrt(areas) * scale
    small = np.flatnonzero((side < SMALL * (1 - SINGLE_TOL)) & (areas > SINGLE_TOL * middle**2))
    if len(small):
        least = float(side[small].min())
        text = f"{list_faces(small, 'is', 'are')} under {SMALL * 1e3:g} mm wide (the smallest {least * 1e3:.3g} mm), too small for a spiral that bends easily: make the piece larger, or use fewer quads"
        times = round(STEP * float(np.ceil(SMALL / least / STEP)), 2)
        found.append(replace(make_finding("small-quads", text, small, severity="warning"), growth_factor=times))
    return found + _inside_out_findings(polygons, sides, body, area_vectors)


def area_vectors_of(polygons: PolygonMesh, sides: Sides) -> Float[np.ndarray, "faces 3"]:
    """Return the area vector (area times normal) of every face: half the sum of cross products about a corner.

    Parameters
    ----------
    polygons : mesh
    sides : sides of that mesh
    """
    p = np.asarray(polygons.vertices, float)
    origin = p[polygons.corners[polygons.starts]][sides.face]
    crosses = np.cross(p[polygons.corners] - origin, p[sides.end_vertex] - origin)
    return 0.5 * np.add.reduceat(crosses, polygons.starts, axis=0)


def breadth(corners: Float[np.ndarray, "faces 4 3"]) -> Float[np.ndarray, " faces"]:
    """Return the breadth of quads: the width of the widest arms that fit into them; for a square, its side.

    Straight strips of width w along the two midlines, which cross at the acute angle t, overlap up to
    w / (2 tan(t / 2)) from the quad's middle. At the breadth this overlap reaches the ends of the shorter midline.
    """
    p = np.asarray(corners, float)
    sides = 0.5 * (p + np.roll(p, -1, axis=1))
    one, two = sides[:, 2] - sides[:, 0], sides[:, 3] - sides[:, 1]  # the midlines bisect each other
    across = np.linalg.norm(np.cross(one, two), axis=1)
    shorter = np.minimum(np.linalg.norm(one, axis=1), np.linalg.norm(two, axis=1))
    return shorter * np.tan(0.5 * np.arctan2(across, np.abs(np.einsum("fi,fi->f", one, two))))


def _quad_findings(
    polygons: PolygonMesh, quads: np.ndarray, area_vectors: np.ndarray, bows: np.ndarray, middle: float
) -> list[Finding]:
    """Report crossed, concave, thin and warped quads.

    quads : indices of the quads to check
    area_vectors : area times normal of every face
    bows : quads already known to be crossed, because their two halves cancel each other
    middle : median edge length
    """
    p = np.asarray(polygons.vertices, float)[polygons.corners[polygons.starts[quads][:, None] + np.arange(4)]]
    normals = np.cross(np.roll(p, -1, axis=1) - p, np.roll(p, 1, axis=1) - p)
    inward = (np.einsum("qki,qi->qk", normals, area_vectors[quads]) < 0).sum(axis=1)
    found = []
    crossed, concave = np.union1d(quads[inward > 1], bows), np.setdiff1d(quads[inward == 1], bows)
    if len(crossed):
        text = f"{list_faces(crossed, 'has', 'have')} sides that cross: move the corners, or {REMESH}"
        found.append(make_finding("crossed", text, crossed))
    if len(concave):
        text = f"{list_faces(concave, 'has', 'have')} a corner that points inwards, which leaves little room for a spiral: press Squarer quads, or use more quads"
        found.append(make_finding("concave", text, concave, severity="warning"))
    slim = np.setdiff1d(quads[(breadth(p) < THIN * middle) & (inward < 2)], bows)
    if len(slim):
        text = f"{list_faces(slim, 'is', 'are')} too narrow for a spiral, or pointed like a needle: press Squarer quads, or {REMESH}"
        found.append(make_finding("thin", text, slim, severity="warning"))
    unit = normals / np.maximum(np.linalg.norm(normals, axis=2), 1e-300)[..., None]
    bend = np.arccos(np.clip(np.einsum("qki,qki->qk", unit, np.roll(unit, -1, axis=1)), -1, 1)).max(axis=1)
    warped = np.setdiff1d(quads[(bend > WARP) & (inward == 0)], bows)
    if len(warped):
        worst = np.degrees(bend[inward == 0].max())
        text = f"{list_faces(warped, 'is', 'are')} far from flat, with up to {worst:.0f} degrees between corners, while a spiral is cut flat: press Squarer quads, or use more quads"
        found.append(make_finding("warped", text, warped, severity="warning"))
    return found


def _size_ratio_finding(polygons: PolygonMesh, sides: Sides, lengths: np.ndarray) -> Finding | None:
    """Report uneven face sizes; a face's size is its mean edge length, which hardly depends on its shape."""
    size = np.bincount(sides.face, lengths[sides.edge]) / polygons.sizes
    low, high = np.percentile(size, [1, 99])
    ratio = float(high / low) if low > 0 else float("inf")
    if ratio <= RATIO_WARNING:
        return None
    severe = ratio > RATIO_ERROR
    limit = RATIO_ERROR if severe else RATIO_WARNING
    # list the faces whose size differs from the median by a factor above the square root of the limit
    middle = np.median(size)
    off = np.flatnonzero((size > middle * np.sqrt(limit)) | (size < middle / np.sqrt(limit)))
    text = f"Faces differ too much in size: the largest have edges {ratio:.3g} times as long as the smallest, see {list_faces(off)}"
    if severe:
        text += f"; beyond {RATIO_ERROR:g} times no panels can be made: {REMESH}"
    else:
        text += f"; below {RATIO_WARNING:g} times the piece keeps its shape better: {REMESH}"
    return make_finding("size-ratio", text, off, severity="error" if severe else "warning")


def _inside_out_findings(
    polygons: PolygonMesh, sides: Sides, body: np.ndarray, area_vectors: np.ndarray
) -> list[Finding]:
    """Report closed bodies with a negative volume, whose normals point inwards."""
    origin = np.asarray(polygons.vertices, float)[polygons.corners].mean(axis=0)
    volume = np.bincount(body, np.einsum("fi,fi->f", polygons.centres - origin, area_vectors))
    closed = np.ones(len(volume), dtype=bool)
    uses = np.bincount(sides.edge, minlength=len(sides.edges))
    closed[body[sides.face[uses[sides.edge] == 1]]] = False
    faces = np.flatnonzero((closed & (volume < 0))[body])
    if not len(faces):
        return []
    text = f"{list_faces(faces, 'looks', 'look')} into the body, so that the engraved side comes inside: turn the normals (Recalculate Outside, Shift+N in Edit Mode) unless that is meant"
    return [make_finding("inside-out", text, faces, severity="warning")]
