"""Find reflections and rotations that map a mesh onto itself, so that a symmetric surface gets a symmetric layout."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Bool, Float, Int
from ..progress import SILENT, Progress
from .mesh import QuadMesh

SEARCH = "Looking for symmetries"

_cache: WeakKeyDictionary[QuadMesh, dict[tuple[float, int], list[Symmetry]]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Symmetry:
    """A rigid motion (rotation, reflection or both) that maps a mesh onto itself.

    vertices, quads, edges : index of the image of every vertex, quad and edge
    matrix : orthogonal matrix of the motion about the centre of the mesh
    """

    vertices: Int[np.ndarray, " vertices"]
    quads: Int[np.ndarray, " quads"]
    edges: Int[np.ndarray, " edges"]
    matrix: Float[np.ndarray, "3 3"]

    @property
    def is_mirror(self) -> bool:
        """Whether the motion is a reflection in a plane."""
        return bool(np.linalg.det(self.matrix) < 0.0 and abs(np.trace(self.matrix) - 1.0) < 0.01)

    @property
    def normal(self) -> Float[np.ndarray, " 3"]:
        """Unit normal of the mirror plane, if the motion is a reflection."""
        values, vectors = np.linalg.eigh((self.matrix + self.matrix.T) / 2)
        return vectors[:, int(values.argmin())]

    @property
    def name(self) -> str:
        """Description in words, e.g. "mirror across x" or "turn by 90 degrees about (0, 0, 1)"."""
        m = self.matrix
        mirrored = np.linalg.det(m) < 0
        turn = -m if mirrored else m
        angle = np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
        values, vectors = np.linalg.eig(turn)
        axis = np.real(vectors[:, int(np.argmin(np.abs(values - 1)))])
        axis = axis * np.sign(axis[np.argmax(np.abs(axis))])
        where = _direction(axis)
        if not mirrored:
            return f"turn by {angle:.0f} degrees about {where}"
        if abs(angle - 180) < 1:
            return f"mirror across {where}"
        return "point reflection" if angle < 1 else f"turn by {180 - angle:.0f} degrees about {where} with a mirror"


def _direction(axis: np.ndarray) -> str:
    """Return a direction as text: the name of a coordinate axis, or the vector's components."""
    for name, unit in zip("xyz", np.eye(3), strict=True):
        if axis @ unit > 0.9999:
            return name
    return "(" + ", ".join(f"{round(float(x), 2) + 0.0:g}" for x in axis) + ")"


def symmetries(
    mesh: QuadMesh, tolerance: float = 0.05, max_count: int = 128, progress: Progress = SILENT
) -> list[Symmetry]:
    """Return the rigid motions that map the vertices, edges and quads of a mesh onto each other.

    The result is cached.

    Parameters
    ----------
    mesh : quad mesh
    tolerance : largest distance of a vertex's image from a vertex, as a share of the median edge
    max_count : number of motions after which the search ends; a surface of revolution may have hundreds
    progress : called with the fraction done

    Returns
    -------
    the different motions, without the identity
    """
    known = _cache.setdefault(mesh, {})
    if (tolerance, max_count) not in known:
        known[tolerance, max_count] = _search_symmetries(mesh, tolerance, max_count, progress)
    return list(known[tolerance, max_count])


def _search_symmetries(mesh: QuadMesh, tolerance: float, max_count: int, progress: Progress) -> list[Symmetry]:
    """Search a mesh for its symmetries, see ``symmetries``."""
    centre = mesh.vertices.mean(axis=0)
    points = mesh.vertices - centre
    marks = _rigid_invariants(mesh, points, progress)
    slack = 2 * tolerance * mesh.median_edge
    tree = cKDTree(points)
    # take the quad whose marks (see ``_rigid_invariants``) fewest quads share: it has the fewest possible images
    rounded = np.round(marks / (4 * slack)).astype(np.int64)
    _, group, count = np.unique(rounded, axis=0, return_inverse=True, return_counts=True)
    first = int(np.lexsort((np.arange(len(marks)), count[group.ravel()]))[0])
    alike = np.flatnonzero((np.abs(marks - marks[first]) < slack).all(axis=1))
    found: dict[bytes, Symmetry] = {}
    still = np.arange(len(points)).tobytes()
    for number, quad in enumerate(alike.tolist()):
        progress(number / len(alike), SEARCH)
        for corner in range(4):
            for way in (1, -1):
                order = (corner + way * np.arange(4)) % 4
                one = _symmetry_between_quads(mesh, points, tree, first, quad, order, tolerance * mesh.median_edge)
                if one is not None and one.vertices.tobytes() != still:
                    found.setdefault(one.vertices.tobytes(), one)
        if len(found) > max_count:
            break
    return list(found.values())


def _rigid_invariants(mesh: QuadMesh, points: np.ndarray, progress: Progress) -> Float[np.ndarray, "quads 9"]:
    """Return nine numbers (marks) of every quad, metres, that no symmetry of the mesh changes.

    They are the sorted distances of the quad's corners from the centre of the mesh, the distance of its centroid from
    the centre, and the sorted numbers of edges from its corners to the nearest irregular or border vertex, times the
    median edge.

    points : vertex positions relative to the centre, metres
    """
    away = np.sort(np.linalg.norm(points[mesh.quads], axis=2), axis=1)
    middle = np.linalg.norm(points[mesh.quads].mean(axis=1), axis=1)
    hops = np.where(mesh.irregular | mesh.on_border, 0, len(points))
    a, b = mesh.edges.T
    for _ in range(len(points)):
        progress(0.0, SEARCH)
        before = hops.copy()
        np.minimum.at(hops, a, before[b] + 1)
        np.minimum.at(hops, b, before[a] + 1)
        if (hops == before).all():
            break
    near = np.sort(hops[mesh.quads], axis=1) * mesh.median_edge
    return np.concatenate([away, middle[:, None], near], axis=1)


def _symmetry_between_quads(
    mesh: QuadMesh, points: np.ndarray, tree: cKDTree, first: int, quad: int, order: np.ndarray, slack: float
) -> Symmetry | None:
    """Return the symmetry that maps quad ``first`` to ``quad``; None if there is none.

    points, tree : vertex positions relative to the centre, metres, and a search tree of them
    order : corner of ``quad`` to which each corner of ``first`` is mapped
    slack : largest distance of a vertex's image from a vertex, metres
    """
    way = 1 if (order[1] - order[0]) % 4 == 1 else -1
    source, target = points[mesh.quads[first]], points[mesh.quads[quad][order]]
    lengths = [np.linalg.norm(p - p[[1, 2, 3, 0]], axis=1) for p in (source, target)]
    if np.abs(lengths[0] - lengths[1]).max() > 4 * slack:
        return None
    normal_a, normal_b = mesh.normals[first], mesh.normals[quad]
    size = np.linalg.norm(source[2] - source[0])
    from_ = np.vstack([source, source.mean(axis=0) + size * normal_a, source.mean(axis=0) - size * normal_a])
    to = np.vstack([target, target.mean(axis=0) + size * normal_b, target.mean(axis=0) - size * normal_b])
    u, _, vt = np.linalg.svd((from_).T @ to)
    matrix = (u @ vt).T
    if np.sign(np.linalg.det(matrix)) != way:
        return None
    return _refine_motion(mesh, points, tree, matrix, slack)


def _refine_motion(
    mesh: QuadMesh, points: np.ndarray, tree: cKDTree, matrix: np.ndarray, slack: float
) -> Symmetry | None:
    """Fit a motion to all vertices, and return it as a symmetry; None if it is not a symmetry.

    points, tree : vertex positions relative to the centre, metres, and a search tree of them
    matrix : approximate orthogonal matrix of the motion about the centre
    slack : largest distance of a vertex's image from a vertex, metres
    """
    few = points[:: max(1, len(points) // 40)]
    if tree.query(few @ matrix.T)[0].max() > 8 * slack:
        return None
    for bound in (8 * slack, slack):
        distance, image = tree.query(points @ matrix.T)
        if distance.max() > bound or len(np.unique(image)) < len(points):
            return None
        u, _, vt = np.linalg.svd(points.T @ points[image])
        matrix = (u @ vt).T
    edges = _edge_images(mesh, image)
    if edges is None:
        return None
    quads = _quad_images(mesh, edges)
    return None if quads is None else Symmetry(image, quads, edges, matrix)


def _edge_images(mesh: QuadMesh, image: np.ndarray) -> np.ndarray | None:
    """Return the edge between the images of every edge's ends; None if any of these edges does not exist."""
    n = len(mesh.vertices)
    ends = np.sort(image[mesh.edges], axis=1)
    keys = mesh.edges[:, 0].astype(np.int64) * n + mesh.edges[:, 1]
    wanted = ends[:, 0].astype(np.int64) * n + ends[:, 1]
    where = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return where if (keys[where] == wanted).all() else None


def _quad_images(mesh: QuadMesh, edges: np.ndarray) -> Int[np.ndarray, " quads"] | None:
    """Return the quad that has the images of every quad's edges; None if any of these quads does not exist."""
    own, images = np.sort(mesh.quad_edges, axis=1), np.sort(edges[mesh.quad_edges], axis=1)
    first, second = np.lexsort(own.T), np.lexsort(images.T)
    if (own[first] != images[second]).any():
        return None
    result = np.empty(len(own), dtype=np.int64)
    result[second] = first
    return result


def preserved_by(group: Sequence[Symmetry], cut: np.ndarray) -> list[Symmetry]:
    """Return the symmetries that map the cuts of a layout onto themselves.

    Parameters
    ----------
    group : symmetries of the mesh
    cut : mask of the mesh's edges that are cut
    """
    return [s for s in group if (cut[s.edges] == cut).all()]


def symmetric_closure(cut: Bool[np.ndarray, " edges"], symmetries: Sequence[Symmetry]) -> Bool[np.ndarray, " edges"]:
    """Return the smallest set of cuts that contains given cuts and that every symmetry maps onto itself.

    Parameters
    ----------
    cut : mask of the edges that are cut
    symmetries : symmetries of the mesh

    Returns
    -------
    mask of the edges in the extended set
    """
    while True:
        more = cut.copy()
        for symmetry in symmetries:
            more[symmetry.edges[cut]] = True
        if (more == cut).all():
            return cut
        cut = more


def subgroups(whole_group: list[Symmetry], max_count: int = 12) -> list[list[Symmetry]]:
    """Return groups of symmetries that one or two symmetries generate, the largest first, without the identity.

    If several groups have equal types of motions and equal numbers of fixed vertices, only one of them is returned.

    Parameters
    ----------
    whole_group : all symmetries of the mesh
    max_count : largest number of groups
    """
    index = {s.vertices.tobytes(): i for i, s in enumerate(whole_group)}
    count = len(whole_group)
    still = np.arange(len(whole_group[0].vertices)) if whole_group else np.zeros(0)
    table = -np.ones((count, count), dtype=np.int64)
    for i, a in enumerate(whole_group):
        for j, b in enumerate(whole_group):
            table[i, j] = index.get(a.vertices[b.vertices].tobytes(), -1)

    def closure(seed: set[int]) -> frozenset[int]:
        members = np.array(sorted(seed), dtype=np.int64)
        while True:
            more = np.union1d(members, table[np.ix_(members, members)])
            more = more[more >= 0]
            if len(more) == len(members):
                return frozenset(members.tolist())
            members = more

    cyclic = {closure({i}): i for i in range(count)}
    # two symmetries generate the same group as any generators of their cyclic groups: one generator per cyclic group will do
    generators = sorted(cyclic.values())
    known = {*cyclic, *(closure({i, j}) for i in generators for j in generators if j < i)}
    known.add(frozenset(range(count)))
    ordered = sorted(known, key=lambda g: (-len(g), sorted(g)))
    kinds = [
        (round(float(np.trace(s.matrix)), 2), round(float(np.linalg.det(s.matrix))), int((s.vertices == still).sum()))
        for s in whole_group
    ]
    seen: set[tuple[tuple[float, int, int], ...]] = set()
    result = []
    for group in ordered:
        look = tuple(sorted(kinds[i] for i in group))
        if group and look not in seen:
            seen.add(look)
            result.append([whole_group[i] for i in sorted(group)])
    return result[:max_count]
