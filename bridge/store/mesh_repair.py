"""Repair faults found by the mesh check with Blender's own tools, which keep seams, vertex groups and UV maps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import bmesh
import bpy
import numpy as np

from ...engine.errors import FlexMapsError
from ...engine.surface.checking import check
from ...engine.surface.checking.folds import SHARP
from ...engine.surface.checking.sewing import border_twins
from ...engine.surface.checking.topology import sides_of
from ...engine.tolerances import SINGLE_TOL
from . import mesh, objects, shape_keys, stored_report
from .i18n import translate

if TYPE_CHECKING:
    from ...engine.surface.checking.check import Finding
    from .surface import ObjectSurface

# an inner skin is deleted only if both skins make up at least MIN_SKIN_SHARE of the shell's area, and the smaller skin
# has at least MIN_INNER_SHARE of the larger skin's area. Lower shares occur where folds divide a skin: smaller would
# then keep only a part of it, larger leaves more double skins
MIN_SKIN_SHARE, MIN_INNER_SHARE = 0.7, 0.5
MERGE_FACTOR = 2.0  # merge distance, in SINGLE_TOL times the median edge; above 1 so that all reported edges vanish


@dataclass(frozen=True)
class _FaultyMesh:
    """A mesh with the findings to repair; indices in the findings refer to ``surface``."""

    bm: bmesh.types.BMesh
    surface: ObjectSurface
    findings: list[Finding]
    edge: float  # median edge length, in the object's own frame

    @property
    def faces(self) -> list[bmesh.types.BMFace]:
        """Return the faces that the findings name."""
        numbers = sorted({face for finding in self.findings for face in finding.faces})
        return [self.bm.faces[number] for number in numbers]

    @property
    def edges(self) -> list[bmesh.types.BMEdge]:
        """Return the edges that the findings name."""
        numbers = sorted({edge for finding in self.findings for edge in finding.edges})
        return [self.bm.edges[number] for number in self.surface.edge_of[numbers]] if numbers else []


def repair(obj: bpy.types.Object, scene: bpy.types.Scene, kind: str) -> str:
    """Repair one kind of fault, check the mesh again, and return a sentence about the result.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    kind : kind of fault, a key of ``_KINDS``

    Raises
    ------
    FlexMapsError if the mesh has no fault of that kind, or the repair did not reduce it; the mesh is then unchanged.
    """
    codes, work = _KINDS[kind]
    surface = mesh.read_surface(obj, scene)
    if obj.data.shape_keys is not None and shape_keys.has_user_keys(obj.data):
        raise FlexMapsError("The mesh has shape keys of its own: apply or remove them first, they fix the vertices")
    before = [finding for finding in check.all_findings(surface.polygons) if finding.code in codes]
    if not before:
        raise FlexMapsError("There is nothing of this kind to mend; press Check again")
    made = obj.data.copy()
    bm = bmesh.new()
    try:
        bm.from_mesh(made)
        for elements in (bm.verts, bm.edges, bm.faces):
            elements.ensure_lookup_table()
        work(_FaultyMesh(bm, surface, before, _median_edge(bm)))
        bm.to_mesh(made)
    finally:
        bm.free()
    shared, old = objects.other_users(obj), obj.data
    obj.data = made
    after = check.all_findings(mesh.read_surface(obj, scene).polygons) if len(made.polygons) else []
    if not len(made.polygons) or _count_faults(after, codes) >= _count_faults(before, codes):
        obj.data = old
        bpy.data.meshes.remove(made)
        raise FlexMapsError(f"This could not be mended: {before[0].message}", faces=before[0].faces)
    made.name = old.name
    if not old.users:
        name = old.name
        bpy.data.meshes.remove(old)
        made.name = name
    stored_report.write_checks(made, after)
    done = translate("Mended; {} finding is left" if len(after) == 1 else "Mended; {} findings are left", len(after))
    return f"{done}. {translate('The mesh was copied first: {} use the old one', shared)}" if shared else done


def _median_edge(bm: bmesh.types.BMesh) -> float:
    lengths = [edge.calc_length() for edge in bm.edges]
    return float(np.median(lengths)) if lengths else 0.0


def _count_faults(findings: list[Finding], codes: tuple[str, ...]) -> int:
    """Return the number of findings with these codes, plus the number of faces and edges that they name."""
    return sum(1 + len(finding.faces) + len(finding.edges) for finding in findings if finding.code in codes)


# -- one function for each kind of fault -------------------------------------------------------------------------------


def _merge_short_edges(faulty: _FaultyMesh) -> None:
    verts = {v for edge in faulty.edges for v in edge.verts} | {v for face in faulty.faces for v in face.verts}
    bmesh.ops.remove_doubles(faulty.bm, verts=list(verts), dist=MERGE_FACTOR * SINGLE_TOL * faulty.edge)
    bmesh.ops.dissolve_degenerate(faulty.bm, dist=MERGE_FACTOR * SINGLE_TOL * faulty.edge, edges=faulty.bm.edges)


def _weld_doubles(faulty: _FaultyMesh) -> None:
    """Weld border vertices that lie in one place; other vertices are not touched."""
    label = border_twins(faulty.surface.polygons, sides_of(faulty.surface.polygons))
    first = np.unique(label, return_index=True)[1]
    at = first[np.unique(label, return_inverse=True)[1]]
    verts = faulty.bm.verts
    pairs = {verts[k]: verts[int(one)] for k, one in enumerate(at) if k != one}
    bmesh.ops.weld_verts(faulty.bm, targetmap=pairs)


def _delete_double_shells(faulty: _FaultyMesh) -> None:
    """Keep the first of several faces with the same centre, and delete the others."""
    kept: set[tuple[int, ...]] = set()
    doubles = []
    for face in faulty.faces:
        spot = tuple(round(x / (0.01 * faulty.edge)) for x in face.calc_center_median())
        (doubles.append(face) if spot in kept else kept.add(spot))
    bmesh.ops.delete(faulty.bm, geom=doubles, context="FACES")


def _delete_inner_skins(faulty: _FaultyMesh) -> None:
    """Keep the larger skin of every closed shell, and delete the other skin and the rim between them.

    A shell whose skins are divided by folds stays as it is.
    """
    left, gone = set(faulty.faces), []
    while left:
        shell = _take_connected(next(iter(left)), left, np.pi)
        rest, skins = set(shell), []
        while rest:
            skins.append(_take_connected(next(iter(rest)), rest, SHARP))
        skins.sort(key=_total_area, reverse=True)
        areas = [_total_area(skin) for skin in skins]
        if (
            len(areas) > 1
            and areas[0] + areas[1] >= MIN_SKIN_SHARE * sum(areas)
            and areas[1] >= MIN_INNER_SHARE * areas[0]
        ):
            gone += [face for face in shell if face not in skins[0]]
    bmesh.ops.delete(faulty.bm, geom=gone, context="FACES")


def _total_area(faces: set[bmesh.types.BMFace]) -> float:
    """Return the sum of the faces' areas."""
    return sum(face.calc_area() for face in faces)


def _take_connected(
    first: bmesh.types.BMFace, unvisited: set[bmesh.types.BMFace], max_angle: float
) -> set[bmesh.types.BMFace]:
    """Return the faces connected to ``first`` across angles up to ``max_angle`` (radians); drop them from ``unvisited``."""
    found, ahead = {first}, [first]
    unvisited.discard(first)
    while ahead:
        for edge in ahead.pop().edges:
            for face in edge.link_faces:
                if face in unvisited and edge.calc_face_angle(np.pi) <= max_angle:
                    unvisited.discard(face)
                    found.add(face)
                    ahead.append(face)
    return found


def _dissolve_thin_faces(faulty: _FaultyMesh) -> None:
    bmesh.ops.dissolve_degenerate(
        faulty.bm,
        dist=MERGE_FACTOR * SINGLE_TOL * faulty.edge,
        edges=[edge for face in faulty.faces for edge in face.edges],
    )
    thin = [face for face in faulty.bm.faces if face.calc_area() <= SINGLE_TOL * faulty.edge**2]
    bmesh.ops.delete(faulty.bm, geom=thin, context="FACES")


def _delete_faces(faulty: _FaultyMesh) -> None:
    bmesh.ops.delete(faulty.bm, geom=faulty.faces, context="FACES")


def _delete_double_faces(faulty: _FaultyMesh) -> None:
    kept: set[frozenset[bmesh.types.BMVert]] = set()
    doubles = []
    for face in faulty.bm.faces:
        corners = frozenset(face.verts)
        (doubles.append(face) if corners in kept else kept.add(corners))
    bmesh.ops.delete(faulty.bm, geom=doubles, context="FACES")


def _delete_folds(faulty: _FaultyMesh) -> None:
    """Delete one of every two faces folded onto each other: the face with fewer neighbours."""
    gone: set[bmesh.types.BMFace] = set()
    for edge in faulty.edges:
        pair = [face for face in edge.link_faces if face not in gone]
        if len(pair) == 2:
            gone.add(min(pair, key=lambda face: (sum(not side.is_boundary for side in face.edges), -face.index)))
    bmesh.ops.delete(faulty.bm, geom=list(gone), context="FACES")


def _align_normals(faulty: _FaultyMesh) -> None:
    bmesh.ops.recalc_face_normals(faulty.bm, faces=faulty.bm.faces)


def _flip_outwards(faulty: _FaultyMesh) -> None:
    bmesh.ops.reverse_faces(faulty.bm, faces=faulty.faces)


def _delete_loose(faulty: _FaultyMesh) -> None:
    edges = [edge for edge in faulty.bm.edges if not edge.link_faces]
    bmesh.ops.delete(faulty.bm, geom=edges, context="EDGES")
    bmesh.ops.delete(faulty.bm, geom=[v for v in faulty.bm.verts if not v.link_faces], context="VERTS")


def _separate_fans(faulty: _FaultyMesh) -> None:
    for v in [v for v in faulty.bm.verts if v.link_faces and not v.is_manifold]:
        bmesh.utils.vert_separate(v, [edge for edge in v.link_edges if edge.is_boundary])


def _split_edges(faulty: _FaultyMesh) -> None:
    bmesh.ops.split_edges(faulty.bm, edges=faulty.edges)


def _round_folds(faulty: _FaultyMesh) -> None:
    """Smooth the vertices at sharp folds, in the object's own frame."""
    from ...engine.surface.checking.folds import smooth_folds
    from ...engine.surface.mesh import PolygonMesh

    own = np.array([tuple(v.co) for v in faulty.bm.verts])
    corners = np.array([v.index for face in faulty.bm.faces for v in face.verts])
    sizes = np.array([len(face.verts) for face in faulty.bm.faces])
    for v, to in zip(faulty.bm.verts, smooth_folds(PolygonMesh(own, corners, sizes)), strict=True):
        v.co = to


# kind of fault, as the operator names it -> codes of its findings, and the function that repairs them
_KINDS: dict[str, tuple[tuple[str, ...], Callable[[_FaultyMesh], None]]] = {
    "short-edges": (("zero-edge", "repeated-vertex"), _merge_short_edges),
    "doubles": (("doubled-vertices",), _weld_doubles),
    "double-shells": (("doubled-faces",), _delete_double_shells),
    "skins": (("double-skin",), _delete_inner_skins),
    "thin-faces": (("zero-area",), _dissolve_thin_faces),
    "double-faces": (("duplicate-faces",), _delete_double_faces),
    "folds": (("folded",), _delete_folds),
    "normals": (("inconsistent-orientation",), _align_normals),
    "outside": (("inside-out",), _flip_outwards),
    "loose": (("loose-vertices",), _delete_loose),
    "far": (("far-vertices",), _delete_faces),
    "not-finite": (("not-finite",), _delete_faces),
    "fans": (("non-manifold-vertex",), _separate_fans),
    "walls": (("non-manifold-edge",), _split_edges),
    "one-sided": (("non-orientable",), _split_edges),
    "round": (("sharp-folds",), _round_folds),
}
