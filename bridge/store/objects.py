"""Queries about Blender objects that FlexMaps works on; fast enough for every redraw, without heavy imports."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...engine.errors import FlexMapsError
from . import modifiers
from .columns import column
from .i18n import interface, translate

# smallest product of an object's three scale factors that is not 0, metres per unit; far below any scale in use
MIN_VOLUME_SCALE = 1e-30
CONVERTIBLE = {"CURVE", "SURFACE", "FONT", "META"}  # object types that Blender can convert to meshes


def usage_problem(obj: bpy.types.Object | None) -> str | None:
    """Return why FlexMaps cannot work on this object, as a sentence; None if it can."""
    if obj is None:
        return "Select a mesh object"
    model = drawn_model(obj)
    if model is not None:
        return translate(
            "'{}' only shows '{}', and FlexMaps draws it anew: select '{}'", obj.name, model.name, model.name
        )
    if obj.type in CONVERTIBLE:
        return translate("'{}' is not a mesh; select one, or convert it to a mesh", obj.name)
    if obj.instance_type == "COLLECTION" and obj.instance_collection is not None:
        return translate(
            "'{}' is an instance of a collection: press Object, Apply, Make Instances Real, and select its mesh",
            obj.name,
        )
    if obj.type != "MESH":
        return translate("'{}' is not a mesh; select one", obj.name)
    if is_linked(obj):
        return translate("'{}' is linked from another file; make it local first", obj.name)
    if obj.mode not in {"OBJECT", "EDIT"}:
        return "Go to Object Mode or Edit Mode"
    return None


def drawn_model(obj: bpy.types.Object) -> bpy.types.Object | None:
    """Return the model beside which FlexMaps drew this object, such as its flat panels; None for any other object."""
    if "flexmaps_kind" not in obj:
        return None
    owned = [own for own in obj.users_collection if "flexmaps_owner" in own]
    models = [o for o in bpy.data.objects if o != obj and o.get("flexmaps_collection") in owned]
    names = [own["flexmaps_owner"] for own in owned]  # a duplicate of a model refers to the same collection
    return next((model for model in models if model.name in names), next(iter(models), None))


def is_linked(obj: bpy.types.Object) -> bool:
    """Return whether the object or its mesh is linked from another .blend file."""
    return obj.library is not None or (obj.data is not None and obj.data.library is not None)


def modifier_problem(obj: bpy.types.Object) -> str | None:
    """Return a sentence that names the modifier or parent that changes the mesh; None if the mesh is unchanged."""
    for modifier in modifiers.list_changing(obj):
        return translate("Apply or remove the modifier '{}' first: the layout lives in the mesh itself", modifier.name)
    parent = bending_parent(obj)
    if parent is not None:
        return translate(
            "'{}' bends the mesh as its parent: clear the parent first, or make it a modifier", parent.name
        )
    return None


def surface_problem(obj: bpy.types.Object, scene: bpy.types.Scene) -> tuple[str, str] | None:
    """Return why a mesh is not a usable surface, as a short label and a sentence; None if it is usable.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    """
    if not len(obj.data.polygons) and not modifier_problem(obj):
        sentence = translate(
            "'{}' has no faces: fill it in Edit Mode (select all, press F), or add a modifier that makes faces, such as Screw",
            obj.name,
        )
        return interface("No faces"), sentence
    squeezed = scale_problem(obj, scene)
    return None if squeezed is None else (interface("Squeezed flat"), squeezed)


def scale_problem(obj: bpy.types.Object, scene: bpy.types.Scene) -> str | None:
    """Return a sentence that a scale factor of 0 squeezes the object flat; None if no scale factor is 0.

    Parameters
    ----------
    obj, scene : the mesh object and its scene
    """
    if abs(obj.matrix_world.to_3x3().determinant()) * scene.unit_settings.scale_length**3 < MIN_VOLUME_SCALE:
        return translate("'{}' is squeezed flat by its scale; give it a scale that is not 0 along any axis", obj.name)
    return None


def bending_parent(obj: bpy.types.Object) -> bpy.types.Object | None:
    """Return the armature or lattice that bends the object as its parent; None without one."""
    return obj.parent if obj.parent is not None and obj.parent_type in {"ARMATURE", "LATTICE"} else None


def list_other_users(obj: bpy.types.Object) -> list[bpy.types.Object]:
    """Return the other objects that use the same mesh."""
    return [o for o in bpy.data.objects if o.data == obj.data and o != obj] if obj.data.users > 1 else []


def other_users(obj: bpy.types.Object) -> str:
    """Return the names of the other objects that use the same mesh, as a short text; "" where there are none."""
    others = [f"'{o.name}'" for o in list_other_users(obj)]
    return ", ".join(others[:2]) + (f" (+{len(others) - 2})" if len(others) > 2 else "")


def list_open_files() -> tuple[Path, ...]:
    """Return the open .blend file, if it was ever saved, and the files that it links."""
    linked = (bpy.path.abspath(library.filepath) for library in bpy.data.libraries)
    return tuple(Path(path) for path in (bpy.data.filepath, *linked) if path)


def find_by_uid(uid: int) -> bpy.types.Object:
    """Return the object with this ``session_uid``, even if renamed; raise ``FlexMapsError`` if it was deleted."""
    for obj in bpy.data.objects:
        if obj.session_uid == uid and obj.users:
            return obj
    raise FlexMapsError("The object was deleted meanwhile; nothing was changed")


def count_hidden(mesh: bpy.types.Mesh) -> int:
    """Return the number of hidden faces; 0 in edit mode, where the user can see that they are hidden."""
    if mesh.is_editmode or ".hide_poly" not in mesh.attributes:
        return 0
    return int(column(mesh.polygons, "hide").sum())
