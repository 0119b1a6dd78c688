"""Quads from any mesh, with Blender's own tools: QuadriFlow, after a voxel remesh where the mesh is no clean surface."""

from __future__ import annotations

from collections.abc import Generator, Iterator

import bpy
import numpy as np

from ..engine.errors import FlexMapsError
from ..engine.surface import check
from ..engine.surface.mesh import PolygonMesh
from . import beside, equilibrium
from .mesh import read_surface, to_metres

# voxel sizes that are tried, in quad edges: fine ones keep detail, coarse ones close what hinders QuadriFlow
VOXELS = (0.35, 0.42, 0.5, 0.6, 0.72, 0.86, 1.0, 1.2)
MOST = 5  # meshes that are not sound after which more tries are vain; on sheets without a thickness QuadriFlow may never end
SEEDS = 3  # QuadriFlow gives up on some starts and not on others


def quads_in_pieces(
    obj: bpy.types.Object, context: bpy.types.Context, count: int, smooth: bool
) -> Generator[tuple[float, str], None, bpy.types.Object]:
    """A new object of about ``count`` quads in the shape that is seen of ``obj``, simulations apart, in the same place.

    Yields (fraction, text) between its pieces, and returns the object. A clean surface, open or closed, goes straight to
    QuadriFlow; anything else (several parts that overlap, edges of three faces, mixed normals) becomes one closed surface
    first. Quads that the check would refuse are sought anew. Raises ``FlexMapsError`` where nothing works; then, and where
    it is closed before its end, nothing is left behind.
    """
    yield 0.0, "Reading the surface"
    if abs(np.linalg.det(to_metres(obj, context.scene)[:3, :3])) < 1e-30:
        raise FlexMapsError(f"'{obj.name}' is squeezed flat by its scale; give it a scale that is not 0 along any axis")
    with equilibrium.shown_at(obj, 0.0):
        depsgraph = context.evaluated_depsgraph_get()
        mesh = bpy.data.meshes.new_from_object(obj.evaluated_get(depsgraph))
    if not len(mesh.polygons):
        bpy.data.meshes.remove(mesh)
        raise FlexMapsError(f"'{obj.name}' has no faces; select an object with a surface")
    mesh.name = f"{obj.name} quads"
    made = bpy.data.objects.new(mesh.name, mesh)
    made.matrix_world = obj.matrix_world.copy()
    for collection in obj.users_collection or (context.scene.collection,):
        collection.objects.link(made)
    try:
        _clean(mesh)
        yield from _seek(context, made, count, smooth)
        return made
    except BaseException:  # also where it is closed
        mesh = made.data
        bpy.data.objects.remove(made)
        bpy.data.meshes.remove(mesh)
        raise


def quads_from(obj: bpy.types.Object, context: bpy.types.Context, count: int, smooth: bool) -> bpy.types.Object:
    """``quads_in_pieces`` at once."""
    pieces = quads_in_pieces(obj, context, count, smooth)
    while True:
        try:
            next(pieces)
        except StopIteration as last:
            made: bpy.types.Object = last.value
            return made


def polygons_from(polygons: PolygonMesh, count: int, smooth: bool) -> PolygonMesh:
    """The same of a mesh that is no object, metres; nothing stays in Blender's file."""
    context = bpy.context
    unit = context.scene.unit_settings.scale_length
    data = beside.polygons(".flexmaps", polygons.vertices / unit, polygons.corners, polygons.sizes)
    obj = bpy.data.objects.new(data.name, data)
    context.scene.collection.objects.link(obj)
    context.view_layer.update()
    made = None
    try:
        made = quads_from(obj, context, count, smooth)
        return read_surface(made, context.scene).polygons
    finally:
        for each in (obj, made):
            if each is not None:
                mesh = each.data
                bpy.data.objects.remove(each)
                bpy.data.meshes.remove(mesh)


def _seek(
    context: bpy.types.Context, made: bpy.types.Object, count: int, smooth: bool
) -> Generator[tuple[float, str], None, None]:
    """Turn the object's surface into sound quads; raises ``FlexMapsError`` with what was wrong with the last ones."""
    refused = FlexMapsError(
        "Neither the mesh nor its voxel remesh is one clean surface; give open parts a thickness, or remove what is inside"
    )
    tried = vain = 0
    for _ in _surfaces(context, made, count):
        surface = made.data.copy()
        try:
            for seed in range(SEEDS):
                if seed:
                    made.data.clear_geometry()
                    _copy_geometry(surface, made.data)
                tried += 1
                yield 1.0 - 0.9**tried, f"QuadriFlow: try {tried}"
                done = _quadriflow(context, made, count, smooth, seed)
                if done == "SOUND":
                    try:
                        check.as_quad_mesh(read_surface(made, context.scene).polygons)
                        return
                    except FlexMapsError as error:
                        # the faces are those of a mesh that nobody will see
                        refused = FlexMapsError(
                            f"No sound quads were found; give another quad count. The last try: {error}"
                        )
                else:
                    refused = FlexMapsError(
                        "QuadriFlow finds no quads on it; give another quad count, or repair the mesh"
                    )
                vain += done != "REFUSED"
                if vain == MOST:
                    raise refused
        finally:
            bpy.data.meshes.remove(surface)
    raise refused


def _clean(mesh: bpy.types.Mesh) -> None:
    """Only the shape goes on: no attributes, materials or marks of the old faces; corners at one place become one."""
    import bmesh

    bm = bmesh.new()
    bm.from_mesh(mesh)
    size = max((v.co.length for v in bm.verts), default=1.0)
    bmesh.ops.remove_doubles(bm, verts=bm.verts, dist=1e-6 * size)
    bmesh.ops.delete(bm, geom=[v for v in bm.verts if not v.link_faces], context="VERTS")
    for layers in (bm.faces.layers, bm.edges.layers, bm.loops.layers):
        for kind in ("float", "int", "bool", "uv", "float_color"):
            sequence = getattr(layers, kind, None)
            if sequence is not None:
                for layer in list(sequence.values()):
                    sequence.remove(layer)
    for edge in bm.edges:
        edge.seam = False
    for face in bm.faces:
        face.hide = False
    mesh.clear_geometry()
    bm.to_mesh(mesh)
    bm.free()
    for key in list(mesh.keys()):
        del mesh[key]


def _manifold(mesh: bpy.types.Mesh) -> bool:
    """Whether it is one body with at most two faces an edge, which run along it in opposite directions."""
    corners, sizes = np.empty(len(mesh.loops), np.int32), np.empty(len(mesh.polygons), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    mesh.polygons.foreach_get("loop_total", sizes)
    following = np.arange(1, len(corners) + 1)
    ends = np.cumsum(sizes)
    following[ends - 1] = ends - sizes
    a, b = corners.astype(np.int64), corners[following].astype(np.int64)
    directed = a * len(mesh.vertices) + b
    if len(np.unique(directed)) < len(directed):
        return False
    from ..engine.patches.layout import groups
    from ..engine.surface.check_topology import sides_of, split_vertices
    from ..engine.surface.mesh import PolygonMesh

    polygons = PolygonMesh(np.zeros((len(mesh.vertices), 3)), a, sizes.astype(np.int64))
    if len(split_vertices(polygons, sides_of(polygons))):
        return False
    return len(np.unique(groups(len(mesh.vertices), a, b)[a])) == 1


def _surfaces(context: bpy.types.Context, obj: bpy.types.Object, count: int) -> Iterator[None]:
    """Puts one clean surface after another into the object: itself, if it is one, then voxel remeshes, the finest first."""
    if _manifold(obj.data):
        yield
    edge = (sum(polygon.area for polygon in obj.data.polygons) / count) ** 0.5
    original = obj.data.copy()
    try:
        for factor in VOXELS:
            obj.data.clear_geometry()
            _copy_geometry(original, obj.data)
            obj.data.remesh_voxel_size = factor * edge
            obj.data.remesh_voxel_adaptivity = 0.0
            try:
                with _only(context, obj):
                    bpy.ops.object.voxel_remesh()
            except RuntimeError:  # too small or too many voxels for Blender
                continue
            _keep_largest(obj.data)
            if len(obj.data.polygons) >= 50 and _manifold(obj.data):
                yield
    finally:
        bpy.data.meshes.remove(original)


def _copy_geometry(source: bpy.types.Mesh, target: bpy.types.Mesh) -> None:
    import bmesh

    bm = bmesh.new()
    bm.from_mesh(source)
    bm.to_mesh(target)
    bm.free()


def _keep_largest(mesh: bpy.types.Mesh) -> None:
    """Drop shells inside the body and crumbs beside it: bodies whose extent is under a tenth of the largest one's."""
    import bmesh

    bm = bmesh.new()
    bm.from_mesh(mesh)
    bodies, seen = [], set()
    for start in bm.verts:
        if start.index in seen:
            continue
        body, stack = [], [start]
        seen.add(start.index)
        while stack:
            vertex = stack.pop()
            body.append(vertex)
            for edge in vertex.link_edges:
                other = edge.other_vert(vertex)
                if other.index not in seen:
                    seen.add(other.index)
                    stack.append(other)
        bodies.append(body)
    if len(bodies) > 1:
        largest = max(bodies, key=len)
        bmesh.ops.delete(bm, geom=[v for body in bodies if body is not largest for v in body], context="VERTS")
        bm.to_mesh(mesh)
    bm.free()


def _quadriflow(context: bpy.types.Context, obj: bpy.types.Object, count: int, smooth: bool, seed: int) -> str:
    """``SOUND`` where QuadriFlow made one clean surface of quads, else ``UNSOUND``; where it ``REFUSED``, the mesh is as it was."""
    try:
        with _only(context, obj):
            result = bpy.ops.object.quadriflow_remesh(
                mode="FACES",
                target_faces=count,
                use_mesh_symmetry=False,
                use_preserve_sharp=False,
                use_preserve_boundary=True,
                smooth_normals=smooth,
                seed=seed,
            )
    except RuntimeError:
        return "REFUSED"
    if "FINISHED" not in result:
        return "REFUSED"
    return "SOUND" if _manifold(obj.data) else "UNSOUND"


class _only:
    """Selects one object and makes it active while Blender's own operators work on it."""

    def __init__(self, context: bpy.types.Context, obj: bpy.types.Object):
        self._context, self._obj = context, obj

    def __enter__(self) -> None:
        layer = self._context.view_layer
        self._active = layer.objects.active
        self._selected = [o for o in layer.objects if o.select_get()]
        for other in self._selected:
            other.select_set(False)
        layer.objects.active = self._obj
        self._obj.select_set(True)

    def __exit__(self, *_: object) -> None:
        self._obj.select_set(False)
        for other in self._selected:
            other.select_set(True)
        self._context.view_layer.objects.active = self._active
