"""Principal curvatures, angle defects and corner angles of a quad mesh."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array

from ..arrays import Float
from .mesh import QuadMesh

# Tikhonov regularisation of the quadric fit, for lengths in quad sizes: makes coefficients zero that the vertices do not
# determine. Any small number will do; larger numbers underestimate curvatures.
REGULARISATION = 1e-4
# Largest thickness of a flat body, as a share of its smaller width: rounding to single precision leaves 1e-7, a visible
# bend 1e-2. Larger: slightly curved bodies count as flat.
MAX_FLAT_THICKNESS = 1e-4
# Smallest relief (see ``relief``) of a surface that counts as curved, as a share of its bounding box's diagonal. With
# less, a flat panel is as near to the target as an optimised one. Larger: more surfaces are made of a flat panel.
LOW_RELIEF = 1e-3


def rms_curvature(mesh: QuadMesh) -> Float[np.ndarray, " quads"]:
    """Return the root mean square of the principal curvatures, sqrt((k1^2 + k2^2) / 2), of every quad, 1/m.

    See ``principal_curvatures``.
    """
    return np.sqrt((principal_curvatures(mesh) ** 2).mean(axis=1))


def is_flat(mesh: QuadMesh) -> bool:
    """Return whether every body of a mesh lies in a plane."""
    for body in range(mesh.body_count):
        points = mesh.vertices[np.unique(mesh.quads[mesh.body_of == body])]
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if spread[2] > MAX_FLAT_THICKNESS * spread[1]:
            return False
    return True


def relief(points: Float[np.ndarray, "points 3"]) -> float:
    """Return the root mean square distance of points from their best-fitting plane, in the unit of the points."""
    return float(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1] / np.sqrt(len(points)))


def principal_curvatures(mesh: QuadMesh) -> Float[np.ndarray, "quads 2"]:
    """Return the largest and smallest normal curvature at the middle of every quad, 1/m.

    A curvature is positive where the surface is concave seen from the side to which the normals point. It comes from
    the shape operator of a quadric z(x, y) over the quad's tangent plane, fitted to the vertices of the quad and of all
    quads round it (16 in a regular mesh), nearer vertices with more weight (Cazals and Pouget 2005). Coefficients that
    the vertices do not determine, as across a strip one quad wide, are zero.
    """
    a, b, c, d, e, f, scale = _fit_quadrics(mesh)
    fitted = _graph_curvatures(b, c, d, e, f)
    # the quadric passes the quad's middle at the height a; the parallel surface through the middle has other curvatures
    lift = np.clip(a[:, None] * fitted, -0.5, 0.5)
    return fitted / (1.0 - lift) / scale[:, None]


def misalignment(mesh: QuadMesh) -> float:
    """Return the mean angle between quad sides and principal directions, degrees, 0 to 45 (22.5 if they are unrelated).

    A quad is weighted by its area times min(1, |k1 - k2| times its size): where the curvatures are equal, no direction
    is better than another. The angle comes from the second fundamental form of the quadric of ``principal_curvatures``,
    whose x axis runs along the quad; the tilt of the quadric against the quad is neglected.
    """
    _, _, _, d, e, f, _ = _fit_quadrics(mesh)
    off = 0.5 * np.abs(np.arctan2(2.0 * e, d - f))
    weight = mesh.areas * np.minimum(np.hypot(d - f, 2.0 * e), 1.0)
    return float(np.degrees((np.minimum(off, 0.5 * np.pi - off) * weight).sum() / max(weight.sum(), 1e-300)))


def _fit_quadrics(mesh: QuadMesh) -> tuple[Float[np.ndarray, " quads"], ...]:
    """Fit z = a + b x + c y + d x^2/2 + e x y + f y^2/2 to the surface round every quad.

    Returns
    -------
    a to f, for lengths in units of the quad's size; the quad's size (root of its area), metres; (quads,) each
    """
    quad, vertex = _neighbourhoods(mesh)
    count = len(mesh.quads)
    normal = _smooth_normals(mesh)
    x_axis = mesh.vertices[mesh.quads[:, 1]] + mesh.vertices[mesh.quads[:, 2]] - 2 * mesh.centroids
    x_axis -= np.einsum("fi,fi->f", x_axis, normal)[:, None] * normal
    x_axis /= np.maximum(np.linalg.norm(x_axis, axis=1), 1e-300)[:, None]
    y_axis = np.cross(normal, x_axis)
    scale = np.sqrt(np.maximum(mesh.areas, 1e-300))
    offset = (mesh.vertices[vertex] - mesh.centroids[quad]) / scale[quad, None]
    x, y, z = (np.einsum("ni,ni->n", offset, axis[quad]) for axis in (x_axis, y_axis, normal))
    # weights are 0.5 at the quad's own corners and about 0.1 at the far corners of its neighbours
    weight = 1.0 / (1.0 + (2.0 * (x**2 + y**2)))
    # squared distances in space, not along the plane: exact for a sphere (d^2 = 2 r z), however coarse its quads
    stretch = 1.0 + z**2 / np.maximum(x**2 + y**2, z**2 + 1e-12)
    columns = np.stack([np.ones_like(x), x, y, 0.5 * stretch * x**2, stretch * x * y, 0.5 * stretch * y**2], axis=1)
    weighted = columns * weight[:, None]
    matrix = np.zeros((count, 6, 6))
    right = np.zeros((count, 6))
    starts = np.flatnonzero(np.diff(quad, prepend=-1))
    matrix[:] = np.add.reduceat(weighted[:, :, None] * columns[:, None, :], starts, axis=0)
    right[:] = np.add.reduceat(weighted * z[:, None], starts, axis=0)
    matrix += REGULARISATION * np.eye(6)
    a, b, c, d, e, f = np.linalg.solve(matrix, right[..., None])[..., 0].T
    return a, b, c, d, e, f, scale


def _graph_curvatures(
    b: np.ndarray, c: np.ndarray, d: np.ndarray, e: np.ndarray, f: np.ndarray
) -> Float[np.ndarray, "points 2"]:
    """Return the principal curvatures of the graph z = b x + c y + d x^2/2 + e x y + f y^2/2 at x = y = 0 (do Carmo 3.3)."""
    first = 1 + b**2 + c**2
    gauss = (d * f - e**2) / first**2
    mean = ((1 + c**2) * d - 2 * b * c * e + (1 + b**2) * f) / (2 * first**1.5)
    spread = np.sqrt(np.maximum(mean**2 - gauss, 0.0))
    return np.stack([mean + spread, mean - spread], axis=1)


def _neighbourhoods(mesh: QuadMesh) -> tuple[np.ndarray, np.ndarray]:
    """Return all pairs of a quad and a vertex near it, sorted by quad, as two arrays.

    Vertices near a quad are the corners of the quad and of all quads that touch it.
    """
    count = len(mesh.quads)
    owner = np.repeat(np.arange(count), 4)
    touch = coo_array((np.ones(4 * count), (owner, mesh.quads.ravel())), shape=(count, len(mesh.vertices))).tocsr()
    ring = (touch @ touch.T @ touch).tocoo()
    order = np.lexsort((ring.col, ring.row))
    return ring.row[order], ring.col[order]


def _smooth_normals(mesh: QuadMesh) -> Float[np.ndarray, "quads 3"]:
    """Return smoothed unit normals: every quad's normal averaged with its neighbours' normals, weighted by area."""
    total = 2 * mesh.area_vectors
    around = np.where((mesh.neighbours >= 0)[..., None], mesh.area_vectors[mesh.neighbours], 0.0)
    # leave out neighbours on the far side of a sharp fold
    facing = np.einsum("fki,fi->fk", around, mesh.normals) > 0
    total += (around * facing[..., None]).sum(axis=1)
    return total / np.maximum(np.linalg.norm(total, axis=1), 1e-300)[:, None]


def angle_defects(mesh: QuadMesh) -> tuple[Float[np.ndarray, " vertices"], Float[np.ndarray, " quads"]]:
    """Return the integral of the Gaussian curvature at every vertex and within every quad, radians.

    At a vertex it is 2 pi minus the sum of the angles round it (0 at the border); in a quad it is the sum of its angles
    minus 2 pi (not 0 if the quad is warped). Together they satisfy the Gauss-Bonnet theorem exactly.
    """
    angle = corner_angles(mesh)
    round_vertex = np.bincount(mesh.quads.ravel(), weights=angle.ravel(), minlength=len(mesh.vertices))
    return np.where(mesh.on_border, 0.0, 2 * np.pi - round_vertex), angle.sum(axis=1) - 2 * np.pi


def corner_angles(mesh: QuadMesh) -> Float[np.ndarray, "quads 4"]:
    """Return the angle between the two sides at every corner of every quad, radians."""
    p = mesh.vertices[mesh.quads]
    forward, backward = np.roll(p, -1, axis=1) - p, np.roll(p, 1, axis=1) - p
    cross = np.linalg.norm(np.cross(forward, backward), axis=2)
    return np.arctan2(cross, np.einsum("fki,fki->fk", forward, backward))
