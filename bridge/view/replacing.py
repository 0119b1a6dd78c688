"""Replace or scale an object, or delete the results of an object whose quads have changed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

from ...engine.params import ObjectSettings
from ..store import derived_properties, dimensions, failures, settings, stored_report
from . import collection, framing

if TYPE_CHECKING:
    from ...engine.surface.checking.check import Finding


def replace_object(context: bpy.types.Context, obj: bpy.types.Object, new: bpy.types.Object) -> None:
    """Replace an object by a new one, which gets its settings and becomes active; the old object is hidden.

    Parameters
    ----------
    context : Blender's context
    obj : the old object
    new : the new object
    """
    from ..store import mark_transfer  # imported here because it imports scipy

    leave_edit_mode(context)
    settings.write(new.flexmaps, settings.read(obj.flexmaps, ObjectSettings))
    if not obj.flexmaps.spiral.is_property_set("border"):
        new.flexmaps.spiral.property_unset("border")
        derived_properties.store_border_setting(new)
    failures.transfer(obj.data, new.data)
    mark_transfer.transfer_marks(obj, new)
    collection.clear(obj)
    obj.select_set(False)
    obj.hide_set(True)
    obj.hide_render = True
    context.view_layer.objects.active = new
    new.select_set(True)


def resize(context: bpy.types.Context, obj: bpy.types.Object, millimetres: float) -> None:
    """Scale an object about its origin so that its longest dimension has a given length; the 3D views zoom with it.

    Parameters
    ----------
    context : Blender's context
    obj : the object
    millimetres : wanted length of its longest dimension
    """
    context.view_layer.update()
    factor = millimetres * 1e-3 / (max(dimensions.extents(obj)) * context.scene.unit_settings.scale_length)
    scale_object(context, obj, factor)


def scale_object(context: bpy.types.Context, obj: bpy.types.Object, factor: float) -> None:
    """Scale an object about its origin; the 3D views zoom with it.

    Parameters
    ----------
    context : Blender's context
    obj : the object
    factor : scale factor
    """
    obj.scale = [s * factor for s in obj.scale]
    framing.scale_views(context, obj, factor)
    context.view_layer.update()


def drop_results(obj: bpy.types.Object, findings: list[Finding]) -> None:
    """Delete all results of an object whose quads have changed, and store the findings of a check.

    Parameters
    ----------
    obj : the mesh object
    findings : findings of the check of the new quads
    """
    from ..store import mesh

    mesh.clear(obj, mesh.NAMES)
    collection.clear(obj)
    obj.pop(framing.FRAMED_KEY, None)
    stored_report.drop_from(obj.data, "layout")
    stored_report.write_checks(obj.data, findings)


def leave_edit_mode(context: bpy.types.Context) -> None:
    """Leave edit mode, as is needed before a new object becomes active; *Check* may have entered it to show a fault."""
    if context.object is not None and context.object.mode == "EDIT":
        bpy.ops.object.mode_set(mode="OBJECT")
