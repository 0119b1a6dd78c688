"""Is this mesh one that can be made? Names every fault, the faces it concerns, and the way out.

Codes of the findings:

    code                      severity        what it says
    no-faces                  error           there is nothing to make
    bad-index                 error           a face refers to a vertex that is not there
    not-finite                error           a coordinate is NaN or infinite
    non-quad                  error           triangles or n-gons
    repeated-vertex           error           a face has the same vertex at two corners
    duplicate-faces           error           two faces on the same vertices
    zero-edge                 error           an edge without length
    zero-area                 error           a face without area
    crossed                   error           a quad whose sides cross
    non-manifold-edge         error           an edge of three or more faces
    non-manifold-vertex       error           fans of faces that share only a vertex
    non-orientable            error           a body with only one side, as the Moebius strip
    inconsistent-orientation  error           neighbours whose normals point to opposite sides
    size-ratio                error, warning  face sizes too different: above 10, above 3
    small-quads               warning         quads too small for a spiral
    concave                   warning         quads with a corner beyond 180 degrees
    warped                    warning         quads far from flat
    inside-out                warning         closed bodies whose normals point inwards
    several-bodies            warning         each is laid out by itself
    loose-vertices            warning         vertices that belong to no face; left out
    left-out                  warning         what the file holds beside its mesh
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import FlexMapsError
from .check_topology import Sides, bodies, inconsistent, repeated_faces, sides_of, split_vertices
from .mesh import PolygonMesh, QuadMesh

RATIO_ERROR, RATIO_WARNING = 10.0, 3.0  # 99th to 1st percentile of the faces' mean edge lengths
SMALL = 0.01  # metres: side of the smallest quad that takes a spiral well
WARP = np.radians(60.0)  # largest angle between the normals at two neighbouring corners of a quad
REMESH = "use the quad remesh (voxel remesh and QuadriFlow in Blender)"


@dataclass(frozen=True)
class Finding:
    """One fault of a mesh.

    faces : indices in the mesh as it came; edges : indices in ``edges_of`` the mesh as it came
    """

    code: str
    severity: str
    message: str
    faces: tuple[int, ...] = ()
    edges: tuple[int, ...] = ()

    @property
    def is_error(self) -> bool:
        return self.severity == "error"

    def as_dict(self) -> dict[str, Any]:
        """For report.json."""
        return {"code": self.code, "severity": self.severity, "message": self.message, "faces": list(self.faces)}


def _finding(code: str, message: str, faces: Any = (), edges: Any = (), severity: str = "error") -> Finding:
    return Finding(
        code, severity, message, tuple(np.asarray(faces, int).tolist()), tuple(np.asarray(edges, int).tolist())
    )


def edges_of(polygons: PolygonMesh) -> np.ndarray:
    """(E, 2) int: the vertices of every edge, the smaller first, in the order of the findings' ``edges``.

    The same order as ``QuadMesh.edges``.
    """
    return sides_of(polygons).edges


def used_vertices(polygons: PolygonMesh) -> np.ndarray:
    """(U,) int, ascending: vertices that belong to a face; vertex i of ``as_quad_mesh`` is vertex ``used[i]`` here."""
    return np.unique(polygons.corners)


def median_edge(polygons: PolygonMesh) -> float:
    """Median edge length in the unit of the vertices; NaN where it cannot be told."""
    try:
        lengths = _lengths(polygons, sides_of(polygons))
    except IndexError:
        return float("nan")
    return float(np.median(lengths)) if len(lengths) else float("nan")


def scaled(polygons: PolygonMesh, *, edge: float | None = None, height: float | None = None) -> PolygonMesh:
    """The mesh in metres, about its origin: with the median edge length ``edge``, or the extent ``height`` along z.

    With neither it is taken to be in metres already. A mesh without a size (no faces, NaN) comes back as it is, for
    ``findings`` to name. Raises FlexMapsError when both are given or a size makes no sense.
    """
    if edge is None and height is None:
        return polygons
    if edge is not None and height is not None:
        raise FlexMapsError("Give the edge length or the height, not both")
    wanted, name = (edge, "edge length") if edge is not None else (height, "height")
    assert wanted is not None
    if not np.isfinite(wanted) or wanted <= 0:
        raise FlexMapsError(f"The {name} must be a positive length, not {wanted * 1e3:g} mm")
    if edge is not None:
        size = median_edge(polygons)
    else:
        z = polygons.vertices[np.unique(polygons.corners), 2] if _indices_fit(polygons) else np.zeros(0)
        size = float(np.ptp(z)) if len(z) else float("nan")
        if size == 0:
            raise FlexMapsError("The mesh is flat along z, so it has no height; give the edge length instead")
    if not np.isfinite(size) or size <= 0:
        return polygons
    return replace(polygons, vertices=np.asarray(polygons.vertices, float) * (wanted / size))


def as_quad_mesh(polygons: PolygonMesh, findings: list[Finding] | None = None) -> QuadMesh:
    """The clean quad mesh: the same faces in the same order, without the vertices that belong to none.

    Raises FlexMapsError with the message and the culprits of the first error among ``findings`` (found here when not
    given), and the names of the others.
    """
    if findings is None:
        findings = _find(polygons, None)
    errors = [f for f in findings if f.is_error]
    if errors:
        others = ", ".join(dict.fromkeys(f.code for f in errors[1:]))
        message = errors[0].message + (f" [also: {others}]" if others else "")
        raise FlexMapsError(message, faces=errors[0].faces, edges=errors[0].edges)
    used, corners = np.unique(polygons.corners, return_inverse=True)
    vertices = np.ascontiguousarray(polygons.vertices[used], dtype=float)
    return QuadMesh(vertices, corners.reshape(-1, 4).astype(np.int64))


def findings(polygons: PolygonMesh, edge: float | None = None) -> list[Finding]:
    """Everything that is wrong with the mesh, errors first.

    Vertices are in metres, or judged as if scaled to the median edge length ``edge`` (metres).
    """
    found = _find(polygons, edge)
    return sorted(found, key=lambda f: not f.is_error)


def _find(polygons: PolygonMesh, edge: float | None) -> list[Finding]:
    if not len(polygons.sizes):
        return [_finding("no-faces", "The mesh has no faces; choose an object with a surface")]
    face_of = np.repeat(np.arange(len(polygons.sizes)), polygons.sizes)
    if not _indices_fit(polygons):
        bad = (polygons.corners < 0) | (polygons.corners >= len(polygons.vertices))
        faces = np.unique(face_of[bad]) if len(bad) == len(face_of) else ()
        return [
            _finding("bad-index", f"{_faces(faces)} refer to vertices that are not there; export the mesh again", faces)
        ]
    sides = sides_of(polygons)
    body = bodies(sides, len(polygons.sizes))
    finite = np.isfinite(polygons.vertices).all(axis=1)
    found = [] if finite[polygons.corners].all() else [_not_finite(polygons, finite, face_of)]
    found += _shape_of_faces(polygons, sides, body)
    found += _topology(polygons, sides, body)
    if not any(f.code == "not-finite" for f in found):
        found += _geometry(polygons, sides, body, edge)
    if body.max() > 0:
        text = f"The mesh has {body.max() + 1} separate bodies; each is laid out by itself"
        smallest = np.flatnonzero(body != np.argmax(np.bincount(body)))
        found.append(_finding("several-bodies", text, smallest, severity="warning"))
    loose = len(polygons.vertices) - len(np.unique(polygons.corners))
    if loose:
        text = f"{_count(loose, 'vertex belongs', 'vertices belong')} to no face and {'is' if loose == 1 else 'are'} left out"
        found.append(_finding("loose-vertices", text, severity="warning"))
    found += [_finding("left-out", text, severity="warning") for text in polygons.left_out]
    return found


def _indices_fit(polygons: PolygonMesh) -> bool:
    corners = polygons.corners
    fits = len(corners) == polygons.sizes.sum() and (polygons.sizes > 0).all()
    return bool(fits and (not len(corners) or (corners.min() >= 0 and corners.max() < len(polygons.vertices))))


# -- texts -----------------------------------------------------------------------------------------------------------


def _count(n: int, one: str, many: str) -> str:
    return f"{n} {one if n == 1 else many}"


def _faces(faces: Any) -> str:
    """For example "3 faces (4, 7, 12)"; long lists are cut short."""
    faces = np.asarray(faces)
    shown = ", ".join(str(f) for f in faces[:5].tolist())
    return f"{_count(len(faces), 'face', 'faces')} ({shown}{', ...' if len(faces) > 5 else ''})"


# -- single checks ---------------------------------------------------------------------------------------------------


def _not_finite(polygons: PolygonMesh, finite: np.ndarray, face_of: np.ndarray) -> Finding:
    bad = ~finite[polygons.corners]
    faces, vertices = np.unique(face_of[bad]), np.unique(polygons.corners[bad])
    shown = ", ".join(str(v) for v in vertices[:5].tolist()) + (", ..." if len(vertices) > 5 else "")
    what = _count(len(vertices), "vertex", "vertices")
    return _finding(
        "not-finite", f"{what} ({shown}) of {_faces(faces)}: no finite position; delete or move them", faces
    )


def _shape_of_faces(polygons: PolygonMesh, sides: Sides, body: np.ndarray) -> list[Finding]:
    found = []
    others = np.flatnonzero(polygons.sizes != 4)
    if len(others):
        triangles = int((polygons.sizes == 3).sum())
        kinds = [_count(triangles, "triangle", "triangles")] if triangles else []
        if len(others) > triangles:
            kinds.append(_count(len(others) - triangles, "n-gon", "n-gons"))
        parts = f", in a mesh of {body.max() + 1} separate bodies" if body.max() > 0 else ""
        text = f"{len(others)} of {len(polygons.sizes)} faces are not quads ({' and '.join(kinds)}{parts}): {REMESH}"
        found.append(_finding("non-quad", text, others))
    order = np.lexsort((polygons.corners, sides.face))
    face, corner = sides.face[order], polygons.corners[order]
    twice = np.unique(face[1:][(face[1:] == face[:-1]) & (corner[1:] == corner[:-1])])
    if len(twice):
        text = f"{_faces(twice)} with the same vertex at two corners: use Merge by Distance and Delete Loose"
        found.append(_finding("repeated-vertex", text, twice))
    same = repeated_faces(polygons)
    if len(same):
        text = f"{_faces(same)} on the vertices of another face: delete the doubles"
        found.append(_finding("duplicate-faces", text, same))
    return found


def _topology(polygons: PolygonMesh, sides: Sides, body: np.ndarray) -> list[Finding]:
    found = []
    uses = np.bincount(sides.edge, minlength=len(sides.edges))
    many = np.flatnonzero(uses > 2)
    if len(many):
        faces = np.unique(sides.face[uses[sides.edge] > 2])
        text = f"{_count(len(many), 'edge has', 'edges have')} three or more faces, at {_faces(faces)}: delete the inner walls"
        found.append(_finding("non-manifold-edge", text, faces, many))
        return found  # fans and sides mean nothing beside such edges
    split = split_vertices(polygons, sides)
    if len(split):
        faces = np.unique(sides.face[np.isin(polygons.corners, split)])
        text = f"{_count(len(split), 'vertex joins', 'vertices join')} faces that share no edge there, at {_faces(faces)}: split them apart (V in Blender)"
        found.append(_finding("non-manifold-vertex", text, faces))
    turned, one_sided, edges = inconsistent(sides, body)
    if len(one_sided):
        faces = np.flatnonzero(np.isin(body, one_sided))
        text = f"The body of {_faces(faces)} has only one side, like a Moebius strip: cut it open along a row of edges (V in Blender)"
        found.append(_finding("non-orientable", text, faces, edges))
    if len(turned):
        text = (
            f"{_faces(turned)} face the other way than their neighbours: use Recalculate Outside (Shift+N in Blender)"
        )
        found.append(_finding("inconsistent-orientation", text, turned, edges))
    return found


def _lengths(polygons: PolygonMesh, sides: Sides) -> np.ndarray:
    a, b = polygons.vertices[sides.edges.T]
    return np.linalg.norm(np.asarray(b, float) - a, axis=1)


def _geometry(polygons: PolygonMesh, sides: Sides, body: np.ndarray, edge: float | None) -> list[Finding]:
    found = []
    lengths = _lengths(polygons, sides)
    middle = float(np.median(lengths))
    area_vectors = _area_vectors(polygons, sides)
    areas = np.linalg.norm(area_vectors, axis=1)
    short = np.flatnonzero(lengths <= 1e-6 * middle)
    if len(short):
        faces = np.unique(sides.face[np.isin(sides.edge, short)])
        text = f"{_count(len(short), 'edge has', 'edges have')} no length, at {_faces(faces)}: use Merge by Distance"
        found.append(_finding("zero-edge", text, faces, short))
    flat = np.flatnonzero(areas <= 1e-6 * middle**2)
    if len(flat):
        found.append(_finding("zero-area", f"{_faces(flat)} without area: dissolve or collapse them", flat))
    quads = np.setdiff1d(np.flatnonzero(polygons.sizes == 4), flat)
    found += _quads(polygons, quads, area_vectors)
    ratio = _size_ratio(polygons, sides, lengths)
    if ratio is not None:
        found.append(ratio)
    scale = 1.0 if edge is None else edge / middle if middle > 0 else 1.0
    side = np.sqrt(areas) * scale
    small = np.flatnonzero((side < SMALL * (1 - 1e-6)) & (areas > 1e-6 * middle**2))
    if len(small):
        text = f"{_faces(small)} under {SMALL * 1e3:g} mm (the smallest is {side[small].min() * 1e3:.3g} mm): make the model larger or remesh coarser"
        found.append(_finding("small-quads", text, small, severity="warning"))
    found += _inside_out(polygons, sides, body, area_vectors)
    return found


def _area_vectors(polygons: PolygonMesh, sides: Sides) -> np.ndarray:
    """(F, 3): half the sum of cross products round every face, about its first corner."""
    p = np.asarray(polygons.vertices, float)
    starts = np.cumsum(polygons.sizes) - polygons.sizes
    origin = p[polygons.corners[starts]][sides.face]
    crosses = np.cross(p[polygons.corners] - origin, p[sides.following] - origin)
    return 0.5 * np.add.reduceat(crosses, starts, axis=0)


def _quads(polygons: PolygonMesh, quads: np.ndarray, area_vectors: np.ndarray) -> list[Finding]:
    """Crossed, concave and warped quads."""
    starts = np.cumsum(polygons.sizes) - polygons.sizes
    p = np.asarray(polygons.vertices, float)[polygons.corners[starts[quads][:, None] + np.arange(4)]]
    normals = np.cross(np.roll(p, -1, axis=1) - p, np.roll(p, 1, axis=1) - p)
    inward = (np.einsum("qki,qi->qk", normals, area_vectors[quads]) < 0).sum(axis=1)
    found = []
    crossed, concave = quads[inward > 1], quads[inward == 1]
    if len(crossed):
        text = f"{_faces(crossed)} whose sides cross or which are folded over: move their corners or {REMESH}"
        found.append(_finding("crossed", text, crossed))
    if len(concave):
        text = f"{_faces(concave)} with a corner beyond 180 degrees: the spiral there will be poor; regularise"
        found.append(_finding("concave", text, concave, severity="warning"))
    unit = normals / np.maximum(np.linalg.norm(normals, axis=2), 1e-300)[..., None]
    bend = np.arccos(np.clip(np.einsum("qki,qki->qk", unit, np.roll(unit, -1, axis=1)), -1, 1)).max(axis=1)
    warped = quads[(bend > WARP) & (inward == 0)]
    if len(warped):
        worst = np.degrees(bend[inward == 0].max())
        text = f"{_faces(warped)} far from flat (up to {worst:.0f} degrees between corners): regularise, or remesh finer there"
        found.append(_finding("warped", text, warped, severity="warning"))
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
    text = f"Face sizes differ too much: the largest are {ratio:.3g} times the smallest (99th to 1st percentile), see {_faces(off)}"
    if severe:
        text += f"; above {RATIO_ERROR:g} the surface cannot be made: {REMESH}"
    else:
        text += f"; even sizes, below {RATIO_WARNING:g}, hold the shape better"
    return _finding("size-ratio", text, off, severity="error" if severe else "warning")


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
    text = f"The normals of {_faces(faces)} point inwards: use Recalculate Outside (Shift+N in Blender) unless that is meant"
    return [_finding("inside-out", text, faces, severity="warning")]
