"""Check whether a mesh can be fabricated: report every fault with its faces and the remedy.

Codes of the findings; causes come before their consequences:

    code                      severity        meaning
    no-faces                  error           the mesh has no faces
    bad-index                 error           a face refers to a vertex that does not exist
    not-finite                error           a coordinate is NaN or infinite
    far-vertices              error           a few vertices are extremely far from all others
    far-from-origin           error           the mesh is so far from the origin that its coordinates are rounded
    non-quad                  error           triangles or n-gons
    repeated-vertex           error           a face has the same vertex at two corners
    duplicate-faces           error           two faces with the same vertices
    zero-edge                 error           an edge without length
    zero-area                 error           a face without area
    crossed                   error           a quad whose sides cross
    folded                    error           neighbouring faces that lie on each other
    non-manifold-edge         error           an edge of three or more faces
    non-manifold-vertex       error           fans of faces that share only a vertex
    non-orientable            error           a body with only one side, like a Moebius strip
    inconsistent-orientation  error           neighbouring faces whose normals point to opposite sides
    size                      error           edges under a thousandth of a millimetre or over a thousand kilometres
    size-ratio                error, warning  edges of faces differ by a factor above 10 (error) or 3 (warning)
    small-quads               warning         quads too small for a spiral
    concave                   warning         quads with a corner beyond 180 degrees
    warped                    warning         quads far from flat
    thin                      warning         quads too thin for a spiral
    sharp-folds               warning         edges at which quads turn more than spirals bend
    inside-out                warning         closed bodies whose normals point inwards
    several-bodies            warning         separate bodies; each gets a layout of its own
    loose-vertices            warning         vertices that belong to no face; they are ignored
    left-out                  warning         data of the file that were not read

``all_findings`` adds the codes of module ``overlaps``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...errors import FlexMapsError
from ..mesh import PolygonMesh, QuadMesh
from .finding import REMESH, Finding, list_faces, make_finding, with_count
from .folds import SHARP, fold_angles
from .geometry import FOLDED, degeneracy_findings, edge_lengths, position_findings, scale_to_unit, size_findings
from .overlaps import overlap_findings
from .topology import Sides, bodies, non_manifold_vertices, orientation_faults, repeated_faces, sides_of


def with_numeric_arrays(polygons: PolygonMesh) -> PolygonMesh:
    """Return the mesh with float and int arrays; raise FlexMapsError if they cannot be converted."""
    try:
        vertices = np.asarray(polygons.vertices, dtype=float)
        corners, sizes = np.asarray(polygons.corners), np.asarray(polygons.sizes)
        whole = all(not a.size or np.issubdtype(a.dtype, np.integer) for a in (corners, sizes))
    except (TypeError, ValueError, OverflowError):
        whole = False
    if not whole or vertices.shape[1:] != (3,) or corners.ndim != 1 or sizes.ndim != 1:
        raise FlexMapsError(
            "A mesh of arrays needs vertices (V, 3) of numbers, and corners (C,) and sizes (F,) of integers"
        )
    return replace(polygons, vertices=vertices, corners=corners.astype(np.int64), sizes=sizes.astype(np.int64))


def median_edge(polygons: PolygonMesh) -> float:
    """Return the median edge length in the vertices' unit; NaN if there are no faces or indices are invalid."""
    if not len(polygons.sizes) or not _indices_fit(polygons):
        return float("nan")
    unit, power = scale_to_unit(polygons)
    return float(np.ldexp(np.median(edge_lengths(unit, sides_of(unit))), power))


def scale_to_metres(polygons: PolygonMesh, *, edge: float | None = None, height: float | None = None) -> PolygonMesh:
    """Return a mesh scaled about the origin to a wanted size in metres; unchanged without ``edge`` and ``height``.

    Parameters
    ----------
    polygons : unchecked mesh; returned unchanged if its size is undefined (no faces, NaN), which ``findings`` reports
    edge : wanted median edge length, metres
    height : wanted extent along z, metres

    Raises
    ------
    FlexMapsError : both edge and height are given, or a size is not positive and finite
    """
    if edge is None and height is None:
        return polygons
    if edge is not None and height is not None:
        raise FlexMapsError("Give the edge length or the height, not both")
    wanted, name = (edge, "edge length") if edge is not None else (height, "height")
    assert wanted is not None
    if not np.isfinite(wanted) or wanted <= 0:
        raise FlexMapsError(f"The {name} must be a positive length, not {wanted * 1e3:g} mm")
    if not len(polygons.sizes) or not _indices_fit(polygons):
        return polygons
    unit, _ = scale_to_unit(polygons)
    if edge is not None:
        size = median_edge(unit)
    else:
        size = float(np.ptp(unit.vertices[unit.corners, 2]))
        if size == 0:
            raise FlexMapsError("The mesh is flat along z, so it has no height; give the edge length instead")
    if not np.isfinite(size) or size <= 0:
        return polygons
    return replace(unit, vertices=unit.vertices * (wanted / size))


def as_quad_mesh(polygons: PolygonMesh, findings: list[Finding] | None = None) -> QuadMesh:
    """Convert a mesh without errors to a quad mesh with the same faces in the same order; drop unused vertices.

    Parameters
    ----------
    polygons : unchecked mesh, metres
    findings : findings of that mesh; computed here if not given

    Raises
    ------
    FlexMapsError : the mesh has errors; gives message and faces of the first error, and the codes of all further errors
    """
    if findings is None:
        findings = _collect_findings(polygons, None)
    errors = [f for f in findings if f.is_error]
    if errors:
        others = ", ".join(dict.fromkeys(f.code for f in errors[1:]))
        message = errors[0].message + (f" [also: {others}]" if others else "")
        raise FlexMapsError(message, faces=errors[0].faces, edges=errors[0].edges)
    used, corners = np.unique(polygons.corners, return_inverse=True)
    vertices = np.ascontiguousarray(polygons.vertices[used], dtype=float)
    return QuadMesh(vertices, corners.reshape(-1, 4).astype(np.int64))


def findings(polygons: PolygonMesh, edge: float | None = None) -> list[Finding]:
    """Return all faults of a mesh, errors first.

    Parameters
    ----------
    polygons : unchecked mesh, metres
    edge : median edge length to which the mesh will be scaled, metres: sizes are checked at that scale; None: at the
        present scale
    """
    return sorted(_collect_findings(polygons, edge), key=lambda f: not f.is_error)


def all_findings(polygons: PolygonMesh) -> list[Finding]:
    """Return all findings of a mesh in metres, errors first: those of ``findings`` and of ``overlap_findings``."""
    return sorted([*findings(polygons), *overlap_findings(polygons)], key=lambda f: not f.is_error)


def count_non_quads(polygons: PolygonMesh) -> int:
    """Return the number of faces that are not quads."""
    return sum(len(found.faces) for found in findings(polygons) if found.code == "non-quad")


def remeshing_warning(faces: int) -> Finding:
    """Return the warning that the mesh was remeshed; ``faces`` is the number of its faces that were not quads."""
    return make_finding(
        "remeshed",
        f"{with_count(faces, 'face was not a quad', 'faces were not quads')}, so the whole mesh was remeshed",
        severity="warning",
    )


def _collect_findings(polygons: PolygonMesh, edge: float | None) -> list[Finding]:
    """Return all findings in the order of the module's table, those of ``overlaps`` excepted; ``edge``: see ``findings``."""
    if not len(polygons.sizes):
        return [make_finding("no-faces", "The mesh has no faces; choose an object with a surface")]
    face_of = np.repeat(np.arange(len(polygons.sizes)), np.maximum(polygons.sizes, 0))
    if not _indices_fit(polygons):
        bad = (polygons.corners < 0) | (polygons.corners >= len(polygons.vertices))
        faces = np.unique(face_of[bad]) if len(bad) == len(face_of) else ()
        text = (
            f"{list_faces(faces, 'refers', 'refer')} to vertices that are not there"
            if len(faces)
            else "Faces and corners do not fit together"
        )
        return [make_finding("bad-index", f"{text}; export the mesh again", faces)]
    sides = sides_of(polygons)
    body = bodies(sides, len(polygons.sizes))
    finite = np.isfinite(polygons.vertices).all(axis=1)
    found = [] if finite[polygons.corners].all() else [_not_finite_finding(polygons, finite, face_of)]
    unit, power = scale_to_unit(polygons)
    if not found:
        found += position_findings(unit, face_of)
    measured = not found  # lengths and areas are meaningful only for positions that are finite and near the origin
    found += _face_findings(polygons, sides, body)
    if measured:
        found += degeneracy_findings(unit, sides) + _sharp_fold_findings(unit, sides)
    found += _topology_findings(polygons, sides, body)
    if measured:
        found += size_findings(unit, sides, body, edge, power)
    if body.max() > 0:
        text = f"The mesh has {body.max() + 1} separate bodies; each is laid out by itself"
        smallest = np.flatnonzero(body != np.argmax(np.bincount(body)))
        found.append(make_finding("several-bodies", text, smallest, severity="warning"))
    loose = len(polygons.vertices) - len(np.unique(polygons.corners))
    if loose:
        text = f"{with_count(loose, 'vertex belongs', 'vertices belong')} to no face and {'is' if loose == 1 else 'are'} left out"
        found.append(make_finding("loose-vertices", text, severity="warning"))
    found += [make_finding("left-out", text, severity="warning") for text in polygons.left_out]
    found += [make_finding(code, text, severity="warning") for code, text in polygons.repairs]
    return found


def _indices_fit(polygons: PolygonMesh) -> bool:
    """Return whether the face sizes add up to the number of corners, and all corners refer to existing vertices."""
    corners = polygons.corners
    fits = len(corners) == polygons.sizes.sum() and (polygons.sizes > 0).all()
    return bool(fits and (not len(corners) or (corners.min() >= 0 and corners.max() < len(polygons.vertices))))


# -- single checks ---------------------------------------------------------------------------------------------------


def _not_finite_finding(polygons: PolygonMesh, finite: np.ndarray, face_of: np.ndarray) -> Finding:
    bad = ~finite[polygons.corners]
    faces, vertices = np.unique(face_of[bad]), np.unique(polygons.corners[bad])
    shown = ", ".join(str(v) for v in vertices[:5].tolist()) + (", ..." if len(vertices) > 5 else "")
    what = with_count(len(vertices), "vertex", "vertices")
    why = "have positions that are not numbers: delete them"
    if len(vertices) == 1:
        why = "has a position that is not a number: delete it"
    return make_finding("not-finite", f"{what} ({shown}) of {list_faces(faces)} {why}", faces)


def _face_findings(polygons: PolygonMesh, sides: Sides, body: np.ndarray) -> list[Finding]:
    """Report faces that are not quads, repeat a vertex, or have the vertices of another face."""
    found = []
    others = np.flatnonzero(polygons.sizes != 4)
    if len(others):
        triangles = int((polygons.sizes == 3).sum())
        kinds = [with_count(triangles, "triangle", "triangles")] if triangles else []
        if len(others) > triangles:
            kinds.append(with_count(len(others) - triangles, "n-gon", "n-gons"))
        parts = f", in a mesh of {body.max() + 1} separate bodies" if body.max() > 0 else ""
        text = f"{len(others)} of {with_count(len(polygons.sizes), 'face is not a quad', 'faces are not quads')} ({' and '.join(kinds)}{parts}): {REMESH}"
        found.append(make_finding("non-quad", text, others))
    order = np.lexsort((polygons.corners, sides.face))
    face, corner = sides.face[order], polygons.corners[order]
    twice = np.unique(face[1:][(face[1:] == face[:-1]) & (corner[1:] == corner[:-1])])
    if len(twice):
        text = f"{list_faces(twice, 'has', 'have')} the same vertex at two corners: merge vertices that lie in one place (Merge by Distance)"
        found.append(make_finding("repeated-vertex", text, twice))
    same = repeated_faces(polygons)
    if len(same):
        text = f"{list_faces(same, 'has', 'have')} the vertices of another face: delete one of the two"
        found.append(make_finding("duplicate-faces", text, same))
    return found


def _sharp_fold_findings(polygons: PolygonMesh, sides: Sides) -> list[Finding]:
    """Report edges of a quad mesh that are too sharp for spirals, except where faces lie on each other ("folded")."""
    turned = fold_angles(polygons, sides)
    sharp = np.flatnonzero((turned > SHARP) & (np.cos(turned) >= FOLDED))
    if not len(sharp) or (polygons.sizes != 4).any():
        return []
    faces = np.unique(sides.face[np.isin(sides.edge, sharp)])
    limit, most = (f"{np.degrees(angle):.0f}" for angle in (SHARP, turned[sharp].max()))
    angles = f"more than {limit} degrees, up to {most}" if most != limit else f"a little more than {limit} degrees"
    text = f"{with_count(len(sharp), 'edge turns', 'edges turn')} by {angles}: spirals bend, but do not fold. Press Round to ... mm, or Propose layouts, which also cuts along them"
    return [make_finding("sharp-folds", text, faces, sharp, severity="warning")]


def _topology_findings(polygons: PolygonMesh, sides: Sides, body: np.ndarray) -> list[Finding]:
    """Report non-manifold edges and vertices, and inconsistent orientation; ``body`` is the body of every face."""
    found = []
    uses = np.bincount(sides.edge, minlength=len(sides.edges))
    many = np.flatnonzero(uses > 2)
    if len(many):
        faces = np.unique(sides.face[uses[sides.edge] > 2])
        text = f"{with_count(len(many), 'edge has', 'edges have')} three or more faces, at {list_faces(faces)}: delete the walls inside, or split the surface there"
        found.append(make_finding("non-manifold-edge", text, faces, many))
        return found  # fans of faces and orientation are not defined at such edges
    split = non_manifold_vertices(polygons, sides)
    if len(split):
        faces = np.unique(sides.face[np.isin(polygons.corners, split)])
        text = f"{with_count(len(split), 'vertex joins', 'vertices join')} faces that share no edge there, at {list_faces(faces)}: split the surface there (V in Edit Mode)"
        found.append(make_finding("non-manifold-vertex", text, faces))
    turned, one_sided, edges = orientation_faults(sides, body)
    if len(one_sided):
        faces = np.flatnonzero(np.isin(body, one_sided))
        text = f"The body of {list_faces(faces)} has only one side, like a Moebius strip: cut it open along a row of edges (V in Edit Mode)"
        found.append(make_finding("non-orientable", text, faces, edges))
    if len(turned):
        text = f"{list_faces(turned, 'looks', 'look')} to the other side than the neighbours: turn the normals (Recalculate Outside, Shift+N in Edit Mode)"
        found.append(make_finding("inconsistent-orientation", text, turned, edges))
    return found
