"""Which button a person would press next; cheap enough to be asked at every redraw."""

from __future__ import annotations

import bpy

from . import notes
from .settings import unsaved
from .states import DONE, TODO, State, is_old_unnoted

EDGES = 64  # evenly picked, which tell whether the size of the quads is wrong by a factor of 2
SIZES = 0.5, 2.0  # quads within these shares of the wanted edge need no scaling
# findings of the check that Regularise helps with, and errors that are mended by hand rather than by new quads
MADE_SQUARER = {"concave", "warped", "thin"}
MENDED_BY_HAND = {
    "inconsistent-orientation", "size-ratio", "zero-edge", "zero-area", "not-finite", "loose-vertices", "far-vertices",
    "folded", "duplicate-faces",
}  # fmt: skip


def of(obj: bpy.types.Object, scene: bpy.types.Scene, stages: dict[str, State]) -> str:
    """The operator that a person would press next, by its idname; "" when the sheets are up to date."""
    mesh = obj.data
    if not len(mesh.polygons):
        return ""
    if len(mesh.loops) != 4 * len(mesh.polygons):
        return "flexmaps.quad_remesh"
    if stages["layout"].kind == TODO:
        preparing = _before_layout(obj, scene, stages)
        if preparing:
            return preparing
    if stages["layout"].kind != DONE:
        edited = stages["layout"].part == "seams" and "layout" in notes.read(mesh)
        return "flexmaps.update_from_seams" if edited else "flexmaps.merge"
    if stages["spirals"].kind == TODO and notes.read(mesh)["layout"].get(notes.TRACED):
        return "flexmaps.merge"
    if stages["spirals"].kind != DONE:
        return "flexmaps.spirals"
    if stages["sheets"].kind == DONE:
        return ""
    for stage, idname in (("equilibrium", "flexmaps.simulate"), ("optimise", "flexmaps.optimise")):
        if stages[stage].kind != DONE:
            return idname
    return "wm.save_mainfile" if unsaved(obj.flexmaps.export.folder) else "flexmaps.export"


def _before_layout(obj: bpy.types.Object, scene: bpy.types.Scene, stages: dict[str, State]) -> str:
    """What a mesh of quads still needs before it is cut; "" where it is fit."""
    edge, wanted = quad_edge(obj, scene), obj.flexmaps.remesh.edge * 1e-3
    if not SIZES[0] * wanted <= edge <= SIZES[1] * wanted and edge > 0:
        return "flexmaps.set_size"
    if stages["checks"].kind != DONE:
        return "flexmaps.check"
    checks = notes.read(obj.data)["checks"]
    errors = {finding["code"] for finding in checks if finding["severity"] == "error"}
    if errors:
        return "flexmaps.check" if errors <= MENDED_BY_HAND else "flexmaps.quad_remesh"
    poor = any(finding["code"] in MADE_SQUARER for finding in checks)
    regular = "regularise" in notes.made_from(obj.data) and not is_old_unnoted(obj, scene, "regularise")
    if poor and not regular:  # pressing Regularise a second time changes nothing
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
