"""How far every stage of an object is, and which button comes next; cheap enough to be asked at every redraw.

A stage is done while everything that its result was made from is as it was. ``stamp`` notes that, part by part (the shape,
the seams, a group of settings), as checksums beside the notes; ``of`` compares them with the present. A stamp outlives the
note that an earlier stage dropped, and so tells a stage that has to be run again from one that never ran.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import bmesh
import bpy
import numpy as np

from ...engine.runs import stages
from . import attributes, notes, pose, settings

TODO, DONE, OLD = "TODO", "DONE", "OLD"

# what of a result a hand can change on a Blender mesh, the likeliest first: its edges' seams, its faces' spirals, its vertices
BY_HAND = {"flat": "seams", "design": "design", "mesh": "shape"}


def _parts(members: Iterable[str], settings: Iterable[str]) -> tuple[str, ...]:
    """What something is made from that goes on from some members: what a hand can change of them, then the settings."""
    given = stages.ingredients(members)
    own = tuple(part for member, part in BY_HAND.items() if member in given)
    named = tuple(dict.fromkeys(settings))
    return (*own, *named, *(("down",) if "loads" in named else ()))


def _parts_of(block: str) -> tuple[str, ...]:
    writers = stages.writers(block)
    return _parts((m for s in writers for m in s.needs), (name for s in writers for name in s.settings))


# block of the notes -> what it is made from; settings by the name of their section, see ``stages.Stage``
PARTS: dict[str, tuple[str, ...]] = {"checks": ("shape",)} | {block: _parts_of(block) for block in stages.BLOCKS}
PARTS["sheets"] += ("export",)  # the note names the files
# what has no note, but is made from the same
BESIDE: dict[str, tuple[str, ...]] = {
    "regularise": _parts(stages.STAGES["regularise"].needs, stages.STAGES["regularise"].settings),
    "preview": (*_parts(("design",), ("spiral",)), "pose"),
}
OF_MESH = {*BY_HAND.values(), "pose"}
GIVEN = {
    part for parts in (*PARTS.values(), *BESIDE.values()) for part in parts
} - OF_MESH  # settings, and which way is down
# block -> those of the stages that it goes on from
AFTER = {
    block: stages.blocks_of(need for stage in stages.writers(block) for need in stage.needs) - {block}
    for block in stages.BLOCKS
}
WHY = {
    "seams": "The seams were edited since",
    "shape": "The mesh was changed since",
    "design": "The spirals were changed since",
    "down": "The object was turned since",
}
SETTING, EARLIER = "A setting was changed since", "An earlier stage was changed since"
MANY = 20_000  # edges of a mesh that can be looked at one by one in a redraw (some milliseconds)
EDGES = 64  # so many edges, evenly picked, tell the size of the quads well enough
SIZES = 0.5, 2.0  # quads within these shares of the wanted edge need no scaling
MADE_SQUARER = {"concave", "warped", "thin"}
MENDED_BY_HAND = {
    "inconsistent-orientation", "size-ratio", "zero-edge", "zero-area", "not-finite", "loose-vertices", "far-vertices",
    "folded", "duplicate-faces",
}  # fmt: skip


@dataclass(frozen=True)
class State:
    """One stage: ``TODO``, ``DONE`` or ``OLD`` (out of date); ``part`` is what changed, "" where an earlier stage did."""

    kind: str
    part: str = ""

    @property
    def reason(self) -> str:
        """Why it is out of date, as a sentence without its full stop; "" where it is not."""
        if self.kind != OLD:
            return ""
        return WHY.get(self.part, SETTING) if self.part else EARLIER


# -- checksums ---------------------------------------------------------------------------------------------------------


class _Present:
    """The checksums of an object as it is now, each computed when it is first asked for, but those that are ``known``."""

    def __init__(self, obj: bpy.types.Object, scene: bpy.types.Scene, known: dict[str, str] | None = None):
        self._obj, self._scene = obj, scene
        self._known = dict(known or {})
        self._frame = np.array(obj.matrix_world)[:3, :3] * scene.unit_settings.scale_length

    def __getitem__(self, part: str) -> str:
        if part not in self._known:
            own: dict[str, Callable[[], bytes]] = {
                "shape": self._shape,
                "seams": self._seams,
                "design": lambda: self._values("width", "twist"),
                "pose": lambda: self._values(*pose.NAMES),
                "down": self._down,
            }
            data = own[part]() if part in own else self._settings(part)
            self._known[part] = f"{zlib.crc32(data):08x}"
        return self._known[part]

    def _shape(self) -> bytes:
        """Vertices, faces and size; where it stands and how it is turned do not matter."""
        mesh = self._obj.data
        bm = self._edited()
        if bm is not None:
            bm.verts.index_update()
            positions = np.fromiter((x for v in bm.verts for x in v.co), np.float32, 3 * len(bm.verts))
            corners = np.fromiter((loop.vert.index for face in bm.faces for loop in face.loops), np.int32)
            faces = len(bm.faces)
        else:
            positions, corners = np.empty(3 * len(mesh.vertices), np.float32), np.empty(len(mesh.loops), np.int32)
            mesh.vertices.foreach_get("co", positions)
            mesh.loops.foreach_get("vertex_index", corners)
            faces = len(mesh.polygons)
        mirrored = bool(np.linalg.det(self._frame) < 0)
        rest = f"{_rounded(self._frame.T @ self._frame)} {mirrored} {faces}"
        return positions.tobytes() + corners.tobytes() + rest.encode()

    def _edited(self) -> bmesh.types.BMesh | None:
        """Where the user is editing, of which the mesh does not know yet; None elsewhere, or where it would take too long.

        Of shape keys only the basis is what stages read; while another one is edited, the mesh is as edit mode found it.
        """
        mesh = self._obj.data
        if not mesh.is_editmode or len(mesh.edges) > MANY or self._obj.active_shape_key_index > 0:
            return None
        bm = bmesh.from_edit_mesh(mesh)
        return bm if len(bm.edges) <= MANY else None

    def _seams(self) -> bytes:
        mesh = self._obj.data
        bm = self._edited()
        if bm is not None:
            return np.fromiter((edge.seam for edge in bm.edges), bool, len(bm.edges)).tobytes()
        seams = np.empty(len(mesh.edges), bool)
        mesh.edges.foreach_get("use_seam", seams)
        return seams.tobytes()

    def _values(self, *names: str) -> bytes:
        """Attributes of ours on the faces."""
        mesh = self._obj.data
        if not mesh.is_editmode:
            found = (attributes.get(mesh, attributes.PREFIX + name) for name in names)
            return b"".join(b"" if values is None else values.tobytes() for values in found)
        faces = bmesh.from_edit_mesh(mesh).faces  # while it is edited, the mesh itself has none
        data = b""
        for name in names:
            number, way = (
                layers.get(attributes.PREFIX + name) for layers in (faces.layers.float, faces.layers.float_vector)
            )
            if number is not None:
                data += np.fromiter((face[number] for face in faces), np.float32, len(faces)).tobytes()
            elif way is not None:
                data += np.fromiter((x for face in faces for x in face[way]), np.float32, 3 * len(faces)).tobytes()
        return data

    def _down(self) -> bytes:
        """Where weight and forces pull; nothing where there are none."""
        given = getattr(self._obj, "flexmaps", None)
        if given is None or not (
            given.simulate.gravity or given.loads.force_x or given.loads.force_y or given.loads.force_z
        ):
            return b""
        return _rounded(self._frame).encode()

    def _settings(self, name: str) -> bytes:
        given = getattr(self._obj, "flexmaps", None)  # without the extension there are no settings
        section, _, but = name.partition("!")
        return b"" if given is None else settings.changed(getattr(given, section), but).encode()


def _rounded(matrix: np.ndarray) -> str:
    """A matrix without the noise of its last digits."""
    size = max(float(np.abs(matrix).max()), 1e-30)
    return f"{size:.5g} {(np.round(matrix / size, 4) + 0.0).tolist()}"


# -- stamps ------------------------------------------------------------------------------------------------------------


def given(obj: bpy.types.Object, scene: bpy.types.Scene) -> dict[str, str]:
    """Checksums of the settings as they are now, for ``stamp``: a stage begins with them, and they may change until it ends."""
    now = _Present(obj, scene)
    return {part: now[part] for part in GIVEN}


def stamp(obj: bpy.types.Object, scene: bpy.types.Scene, begun: dict[str, str] | None = None) -> None:
    """Note what the results that were written since the last stamp are made from; call it after writing.

    begun : what was ``given`` when the work began, where that is a while ago
    """
    mesh = obj.data
    fresh = notes.take_fresh(mesh)
    if not fresh:
        return
    if mesh.is_editmode:
        obj.update_from_editmode()
    now = _Present(obj, scene, begun)
    made = {stage: {part: now[part] for part in PARTS[stage]} for stage in fresh if stage in PARTS}
    notes.write_made_from(mesh, made)


def stamp_beside(obj: bpy.types.Object, scene: bpy.types.Scene, name: str, begun: dict[str, str] | None = None) -> None:
    """Note what something was made from that is no stage, one of ``BESIDE``; ``begun`` as for ``stamp``."""
    if obj.data.is_editmode:
        obj.update_from_editmode()
    now = _Present(obj, scene, begun)
    notes.write_made_from(obj.data, {name: {part: now[part] for part in BESIDE[name]}})


# -- states ------------------------------------------------------------------------------------------------------------


def of(obj: bpy.types.Object, scene: bpy.types.Scene) -> dict[str, State]:
    """The state of every stage, in edit mode too; a mesh of more than ``MANY`` edges is there as edit mode found it."""
    blocks, stamps, now = notes.read(obj.data), notes.made_from(obj.data), _Present(obj, scene)
    found: dict[str, State] = {}
    for stage, parts in PARTS.items():
        made = stamps.get(stage)
        earlier = [found[name] for name in AFTER.get(stage, ()) if name in found]
        if stage not in blocks:
            found[stage] = State(TODO if made is None else OLD)
            continue
        changed = next((part for part in parts if made is not None and made.get(part) != now[part]), None)
        if changed is not None:
            found[stage] = State(OLD, changed)
        else:
            found[stage] = State(DONE if all(state.kind == DONE for state in earlier) else OLD)
    return found


def is_old(obj: bpy.types.Object, scene: bpy.types.Scene, stage: str) -> bool:
    """Whether there is a result of a stage that what it was made from has left behind; earlier stages are not looked at."""
    return stage in notes.read(obj.data) and _left_behind(obj, scene, stage, PARTS[stage])


def is_old_beside(obj: bpy.types.Object, scene: bpy.types.Scene, name: str) -> bool:
    """The same of one of ``BESIDE``, which has no note; False where it was never made."""
    return _left_behind(obj, scene, name, BESIDE[name])


def _left_behind(obj: bpy.types.Object, scene: bpy.types.Scene, name: str, parts: tuple[str, ...]) -> bool:
    made = notes.made_from(obj.data).get(name)
    if made is None:
        return False
    now = _Present(obj, scene)
    return any(made.get(part) != now[part] for part in parts)


# -- what comes next ---------------------------------------------------------------------------------------------------


def next_button(obj: bpy.types.Object, scene: bpy.types.Scene, found: dict[str, State]) -> str:
    """The operator that a person would press next, by its idname; "" when the sheets are up to date."""
    mesh = obj.data
    if not len(mesh.polygons):
        return ""
    if len(mesh.loops) != 4 * len(mesh.polygons):
        return "flexmaps.quad_remesh"
    if found["layout"].kind == TODO:
        preparing = _before_layout(obj, scene, found)
        if preparing:
            return preparing
    if found["layout"].kind != DONE:
        edited = found["layout"].part == "seams" and "layout" in notes.read(mesh)
        return "flexmaps.update_from_seams" if edited else "flexmaps.merge"
    if found["spirals"].kind == TODO and notes.read(mesh)["layout"].get(notes.TRACED):
        return "flexmaps.merge"
    for stage, idname in (("spirals", "flexmaps.spirals"), ("sheets", "")):
        if found[stage].kind != DONE and idname:
            return idname
    if found["sheets"].kind == DONE:
        return ""
    for stage, idname in (("equilibrium", "flexmaps.simulate"), ("optimise", "flexmaps.optimise")):
        if found[stage].kind != DONE:
            return idname
    return "wm.save_mainfile" if unsaved(obj) else "flexmaps.export"


def unsaved(obj: bpy.types.Object) -> bool:
    """Whether the files would go beside a .blend file that is not there yet."""
    return obj.flexmaps.export.folder.startswith("//") and not bpy.data.filepath


def _before_layout(obj: bpy.types.Object, scene: bpy.types.Scene, found: dict[str, State]) -> str:
    """What a mesh of quads still needs before it is cut; "" where it is fit."""
    edge, wanted = quad_edge(obj, scene), obj.flexmaps.remesh.edge * 1e-3
    if not SIZES[0] * wanted <= edge <= SIZES[1] * wanted and edge > 0:
        return "flexmaps.set_size"
    if found["checks"].kind != DONE:
        return "flexmaps.check"
    checks = notes.read(obj.data)["checks"]
    errors = {finding["code"] for finding in checks if finding["severity"] == "error"}
    if errors:
        return "flexmaps.check" if errors <= MENDED_BY_HAND else "flexmaps.quad_remesh"
    poor = any(finding["code"] in MADE_SQUARER for finding in checks)
    regular = "regularise" in notes.made_from(obj.data) and not is_old_beside(obj, scene, "regularise")
    if poor and not regular:  # once it is as regular as it gets, pressing again is no use
        return "flexmaps.regularise"
    return ""


def quad_edge(obj: bpy.types.Object, scene: bpy.types.Scene) -> float:
    """About the median edge length in metres, from a few edges."""
    mesh, matrix = obj.data, obj.matrix_world.to_3x3()
    lengths = []
    for k in range(0, len(mesh.edges), max(1, len(mesh.edges) // EDGES)):
        a, b = mesh.edges[k].vertices
        lengths.append((matrix @ (mesh.vertices[a].co - mesh.vertices[b].co)).length)
    lengths.sort()
    return lengths[len(lengths) // 2] * scene.unit_settings.scale_length if lengths else 0.0
