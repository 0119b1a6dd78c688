"""The simulated shape on a Blender mesh, as shape keys and face attributes.

FlexMaps equilibrium     shape key   equilibrium shape of the assembled piece; the basis stays the target
FlexMaps other shape 1   shape key   another equilibrium shape, if the simulation found one; then 2, ...
flexmaps_distance        face        distance of the hub from the target, millimetres
flexmaps_strain_energy   face        elastic energy of the spiral, millijoules
flexmaps_strain          face        largest strain as a share of the material's limit, if the arm model yields strains
flexmaps_slot            face        narrowest slot beside the spiral's arms, millimetres; negative where arms overlap
flexmaps_reach           face        why the quad misses the target: an index into ``engine/optimisation/match_limits.REASONS``
flexmaps_utilisation     face        largest utilisation of the arms over all load cases, as a share of the limit
flexmaps_hub             face        position of the hub, see ``pose``
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np

from ...engine.arrays import Float
from ...engine.figures import format_figure
from ...engine.materials import OVERSTRAIN_SHARE
from . import attributes, pose, scans, states, stored_report
from .i18n import translate
from .shape_keys import EQUILIBRIUM_KEY, OTHER_KEY, simulated_keys

if TYPE_CHECKING:
    from ...engine.mechanics.assembly import Pose
    from ...engine.optimisation.match_limits import MatchLimits
    from ...engine.simulation.simulate import Simulation
    from .surface import ObjectSurface

NAMES, REACH, UTILISATION = ("distance", "strain_energy", "strain", "slot"), "reach", "utilisation"


# -- the shape key -----------------------------------------------------------------------------------------------------


def clear(obj: bpy.types.Object) -> None:
    """Remove all shape keys and attributes that a simulation wrote, because they are out of date."""
    for name in (*NAMES, REACH, UTILISATION):
        attributes.remove(obj, attributes.PREFIX + name)
    pose.clear(obj)
    scans.clear(obj)
    _remove(obj, simulated_keys(obj.data))


def _remove(obj: bpy.types.Object, keys: list[bpy.types.ShapeKey]) -> None:
    """Remove shape keys, and the basis if no other key is left."""
    mesh = obj.data
    if not keys:
        return
    if mesh.is_editmode:  # remove the keys from the BMesh too, which would restore them; the basis may stay there
        import bmesh

        shapes = bmesh.from_edit_mesh(mesh).verts.layers.shape
        for name in [key.name for key in keys]:
            if name in shapes:
                shapes.remove(shapes[name])
            obj.shape_key_remove(mesh.shape_keys.key_blocks[name])
        bmesh.update_edit_mesh(mesh, loop_triangles=False, destructive=False)
        return
    for name in [key.name for key in keys]:
        obj.shape_key_remove(mesh.shape_keys.key_blocks[name])
    # no key is left where the user deleted the basis, so that a simulated shape had taken its place
    if mesh.shape_keys is not None and len(mesh.shape_keys.key_blocks) == 1:
        obj.shape_key_clear()


def write(
    obj: bpy.types.Object,
    surface: ObjectSurface,
    simulation: Simulation,
    limits: MatchLimits | None,
) -> None:
    """Store a simulation as shape keys and face attributes; leave edit mode, where the shape would not show.

    Parameters
    ----------
    obj : the mesh object
    surface : the surface that was simulated
    simulation : the result
    limits : why each quad misses the target, or None if unknown
    """
    from ...engine.simulation.simulate import move_vertices

    if obj.mode == "EDIT":
        bpy.ops.object.mode_set(mode="OBJECT")
    if obj.data.shape_keys is None:
        obj.shape_key_add(name="Basis", from_mix=False)
    others = [move_vertices(simulation.design, other.pose, simulation.target) for other in simulation.others]
    names = [EQUILIBRIUM_KEY, *(f"{OTHER_KEY} {k + 1}" for k in range(len(others)))]
    for name, vertices in zip(names, [simulation.vertices, *others], strict=True):
        _put_key(obj, surface, name, vertices)
    for key in simulated_keys(obj.data):
        key.value = float(key.name == EQUILIBRIUM_KEY)
    for name in [key.name for key in simulated_keys(obj.data) if key.name not in names]:
        obj.shape_key_remove(obj.data.shape_keys.key_blocks[name])
    if not obj.show_only_shape_key:
        obj.active_shape_key_index = 0  # so that edit mode shows and edits the target
    slots = simulation.slots()
    room = None if slots is None else 1e3 * slots.narrowest_per_quad
    values_of = simulation.distance * 1e3, simulation.energy * 1e3, simulation.strain, room
    for name, values in zip(NAMES, values_of, strict=True):
        if values is None:
            attributes.remove(obj, attributes.PREFIX + name)
        else:
            attributes.write(obj, attributes.PREFIX + name, "FACE", "FLOAT", values)
    attributes.remove(obj, attributes.PREFIX + REACH)
    attributes.remove(obj, attributes.PREFIX + UTILISATION)
    if limits is not None:
        attributes.write(obj, attributes.PREFIX + REACH, "FACE", "INT", limits.kind)
    pose.write(obj, surface.to_metres, simulation.equilibrium.pose)
    scans.clear(obj)
    obj.data.update()


def _put_key(
    obj: bpy.types.Object,
    surface: ObjectSurface,
    name: str,
    vertices: Float[np.ndarray, "used 3"],
) -> None:
    """Write a shape key from the engine's vertices, metres in world axes; vertices without a quad stay in place."""
    inverse = np.linalg.inv(surface.to_metres)
    positions = surface.positions.astype(float).copy()
    used = np.unique(surface.polygons.corners)  # the engine knows only vertices of faces
    there = vertices @ inverse[:3, :3].T + inverse[:3, 3]
    positions[used] += there - surface.keyed_positions[used]  # only the offset, because Blender adds the user's keys
    key = obj.data.shape_keys.key_blocks.get(name) or obj.shape_key_add(name=name, from_mix=False)
    key.slider_min, key.slider_max, key.mute = 0.0, 1.0, False

    key.data.foreach_set("co", np.ascontiguousarray(positions, dtype=np.float32).ravel())


# -- findings and validity -----------------------------------------------------------------------------------------------


def is_reliable(block: dict[str, Any]) -> bool:
    """Return whether the simulation converged to a reliable equilibrium; if not, ``block["status"]`` says why."""
    return bool(block.get("converged")) and not block.get("locked")


def describe_result(block: dict[str, Any]) -> tuple[str, bool]:
    """Return a text about a simulation's result for the user, and whether it is a warning."""
    away = translate(
        "Distance to the target: RMS {} mm, {} %.", *(format_figure(block[name]) for name in ("rms_mm", "rms_percent"))
    )
    lines, band = list_warnings(block), block.get("band", {}).get("text")
    return " ".join(map(_with_full_stop, [block["status"], away, *([band] if band else []), *lines])), bool(
        lines
    ) or not is_reliable(block)


def _with_full_stop(text: str) -> str:
    """Add a full stop where the text has no end mark."""
    return text if text.endswith((".", "!", "?")) else f"{text}."


def is_overstrained(block: dict[str, Any]) -> bool:
    """Return whether the largest strain exceeds ``OVERSTRAIN_SHARE`` of the material's limit."""
    return block.get("strain_share_max", 0.0) > OVERSTRAIN_SHARE


def list_warnings(block: dict[str, Any]) -> list[str]:
    """Return the warnings of a simulation, except that no equilibrium was found, which the block's ``status`` states."""
    return [
        describe_finding(finding, block) for finding in block.get("findings", ()) if finding["code"] != "no-equilibrium"
    ]


def describe_finding(finding: dict[str, Any], block: dict[str, Any]) -> str:
    """Return a simulation's finding as a translated sentence."""
    if finding["code"] != "strained":
        return finding["message"]
    count = len(finding["faces"])
    if block.get("lasts") == "years":
        broken = (
            "The arms of {} spiral are strained by up to {:.0f} % of what the material bears for years: they sag or crack."
            if count == 1
            else "The arms of {} spirals are strained by up to {:.0f} % of what the material bears for years: they sag or crack."
        )
    else:
        broken = (
            "On their surface, the arms of {} spiral are strained by up to {:.0f} % of what the material bears, give or take 15 %: they may break or stay bent."
            if count == 1
            else "On their surface, the arms of {} spirals are strained by up to {:.0f} % of what the material bears, give or take 15 %: they may break or stay bent."
        )
    return translate(broken, count, 100 * block.get("strain_share_max", 0.0))


def merge_by_code(findings: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Merge findings with the same code, which come from several bodies: join their faces and their messages."""
    merged: dict[str, dict[str, Any]] = {}
    for row in findings:
        first = merged.setdefault(row["code"], row)
        if first is not row:
            faces = sorted({*first["faces"], *row["faces"]})
            merged[row["code"]] = first | {"faces": faces, "message": f"{first['message']}\n{row['message']}"}
    return list(merged.values())


def read_rest_pose(obj: bpy.types.Object, scene: bpy.types.Scene, surface: ObjectSurface) -> Pose | None:
    """Return the simulated pose of the hubs if it is reliable and up to date; else None.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    surface : the object's surface, for its frame
    """
    block = stored_report.read(obj.data).get("equilibrium")
    if block is None or not is_reliable(block) or states.is_stale(obj, scene, "equilibrium"):
        return None
    return pose.read(obj, surface.to_metres)


def write_utilisation(obj: bpy.types.Object, values: Float[np.ndarray, " quads"] | None) -> None:
    """Store the largest utilisation (share of the limit) of every spiral's arms over all load cases.

    Parameters
    ----------
    obj : the mesh object
    values : (F,); None removes the attribute
    """
    if values is None:
        attributes.remove(obj, attributes.PREFIX + UTILISATION)
    else:
        attributes.write(obj, attributes.PREFIX + UTILISATION, "FACE", "FLOAT", values)
