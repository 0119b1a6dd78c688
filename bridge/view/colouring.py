"""Colour maps of a model's quads by kind of value (distortion, width, strain, ...), with their legends."""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

import bpy
import numpy as np

from ...engine import colours
from ...engine.arrays import Float, Int, Shaped
from ...engine.errors import FlexMapsError
from ...engine.params import ObjectSettings
from ..store import attributes, fields, scans, settings, states
from ..store.columns import column
from .legend import Legend


class ValueKind(NamedTuple):
    """A kind of value that quads can be coloured by.

    attribute : attribute of the mesh with the values
    label, unit : words of the legend
    name, explanation : words of the menu
    """

    attribute: str
    label: str
    unit: str
    name: str
    explanation: str


KINDS = {
    "PATCH": ValueKind("flexmaps_patch", "Panels", "", "Panels", "One colour per panel"),
    "ENERGY": ValueKind("flexmaps_energy", "Distortion E", "", "Distortion", "Distortion of every quad when it is flattened"),
    "SQUARE": ValueKind("flexmaps_square", "Distance from a square", "", "Squareness", "Difference of every quad from a square"),
    "STIFFNESS": ValueKind(
        "flexmaps_stiffness", "Stiffness of the arms", "N\u00b7mm/rad", "Stiffness",
        "Mean bending stiffness of the arms of every spiral",
    ),
    "WIDTH": ValueKind("flexmaps_width", "Width", "mm", "Arm width", "Mean width of the spirals' arms"),
    "ANISOTROPY": ValueKind(
        "flexmaps_width", "Anisotropy", "%", "Anisotropy",
        "Difference between the two pairs of opposite arms; the length of a bar is the width of a pair",
    ),
    "TWIST": ValueKind("flexmaps_twist", "Twist", "\N{DEGREE SIGN}", "Twist", "Twist of the spirals"),
    "DISTANCE": ValueKind(
        "flexmaps_distance", "Distance to target", "mm", "Distance", "Distance of the simulated shape from the target"
    ),
    "STRAIN_ENERGY": ValueKind(
        "flexmaps_strain_energy", "Strain energy", "mJ", "Energy", "Elastic energy in every spiral of the simulated shape"
    ),
    "SAFETY": ValueKind(
        "flexmaps_strain", "Strain", "%", "Strain",
        "Largest strain on the surface of every spiral's arms, without fillets, against what the material bears",
    ),
    "SLOT": ValueKind(
        "flexmaps_slot", "Slots", "mm", "Gaps", "Narrowest gap beside the arms of every spiral in the simulated shape"
    ),
    "REACH": ValueKind(
        "flexmaps_reach", "What limits the match", "", "Limits", "Reason why each spiral does not bend as the target does"
    ),
    "UTILISATION": ValueKind(
        "flexmaps_utilisation", "Utilisation", "%", "Loads",
        "Largest strain of every spiral's arms under the load cases, as a share of the limit",
    ),
    "SCAN": ValueKind(
        "flexmaps_scan", "Distance of the scan", "mm", "Scan",
        "Distance of the scanned piece from the simulated shape",
    ),
}  # fmt: skip
OVERLAY_ITEMS = [
    ("NONE", "No colours", "No colours"),
    *((kind, one.name, one.explanation) for kind, one in KINDS.items()),
]
SIMULATED_KINDS = ("DISTANCE", "STRAIN_ENERGY", "REACH", "SAFETY", "SLOT")
# upper end of the colour scale of "SQUARE" (dimensionless); larger hides differences between good quads, smaller
# saturates bad ones
SQUARE_HIGH = 0.25


def to_quad_values(kind: str, values: np.ndarray) -> Shaped[np.ndarray, " quads"]:
    """Convert an attribute's values to one value per quad.

    The attribute of widths has four values per quad: "WIDTH" takes their mean, "ANISOTROPY" the difference between the
    two pairs of opposite arms in percent. Other values are returned unchanged.
    """
    if kind == "WIDTH":
        return attributes.corners_by_face(values).mean(axis=1)
    from ...engine.spirals.curves.spiral import anisotropy  # imported here because it imports scipy

    return 100 * anisotropy(attributes.corners_by_face(values)) if kind == "ANISOTROPY" else values


def colours_and_legend(
    obj: bpy.types.Object, kind: str, values: Shaped[np.ndarray, " quads"]
) -> tuple[Float[np.ndarray, "quads 3"], Legend]:
    """Return linear colours of the quads, (F, 3), and the legend.

    Parameters
    ----------
    obj : the mesh object
    kind : a key of ``KINDS``
    values : one value per quad, from ``to_quad_values``
    """
    _, label, unit, *_ = KINDS[kind]
    if kind == "PATCH":
        count = int(values.max()) + 1
        return colours.patch_colours(count)[values.astype(int)], Legend("1 panel" if count == 1 else f"{count} panels")
    if kind == "REACH":
        return _reason_colours(values.astype(int))
    low, high = float(values.min()), float(values.max())
    if kind == "STIFFNESS":
        shares = stiffness_share(values, low, high)
        return colours.map_to_scale(shares, 0.0, 1.0, colours.QUANTITY_SCALE), stiffness_legend(low, high)
    if kind in {"ENERGY", "SQUARE"}:
        limit = obj.flexmaps.layout.distortion_limit if kind == "ENERGY" else SQUARE_HIGH
        return _error_colours(values, limit, f"{label}, largest {values.max():.3f}", f"{limit:.3g}")
    if kind in {"SAFETY", "UTILISATION"}:
        what = "Strain" if kind == "SAFETY" else "Under loads"
        return _error_colours(values, 1.0, f"{what}, largest {100 * values.max():.0f} % of the limit", "limit")
    if kind == "SLOT":
        high = max(high, colours.LEAST_SLOT)
        text = f"Slots in this shape, narrowest {low:.2f} mm"
        return _error_colours(high - values, high, text, "closed", f"{high:.2g} mm")
    if kind == "SCAN":
        high = max(high, colours.LEAST_DISTANCE)
        text = f"{label}, grey where there is none"
        rgb, legend = _error_colours(np.maximum(values, 0.0), high, text, f"{high:.3g} mm")
        rgb[values < 0] = colours.srgb_to_linear(colours.MISSING_GREY)
        return rgb, legend
    if kind == "DISTANCE":
        high = max(high, colours.LEAST_DISTANCE)
        return _error_colours(values, high, label, f"{high:.3g} mm")
    if kind == "ANISOTROPY":
        low, high = 0.0, max(high, colours.LEAST_ANISOTROPY)
    if kind == "STRAIN_ENERGY":
        low = 0.0
    gap = "" if unit == "\N{DEGREE SIGN}" else " "
    legend = Legend(label, f"{low:.3g}{gap}{unit}", f"{high:.3g}{gap}{unit}", colours.QUANTITY_SCALE)
    return colours.map_to_scale(values, low, high, colours.QUANTITY_SCALE), legend


def _error_colours(
    values: np.ndarray, high: float, title: str, high_label: str, low_label: str = "0"
) -> tuple[Float[np.ndarray, "quads 3"], Legend]:
    """Map values to the error colour scale, and return colours and legend.

    Parameters
    ----------
    values : one value per quad
    high : value at the upper end of the scale; the lower end is 0
    title : title of the legend
    high_label, low_label : labels at the upper and lower end
    """
    return colours.map_to_scale(values, 0.0, high, colours.ERROR_SCALE), Legend(
        title, low_label, high_label, colours.ERROR_SCALE
    )


def stiffness_share(values: Shaped[np.ndarray, " quads"], low: float, high: float) -> Float[np.ndarray, " quads"]:
    """Map stiffness logarithmically from [low, high] to [0, 1], because ``high`` is about ten times ``low``."""
    least = max(low, 1e-12)
    return np.clip(np.log(np.maximum(values, least) / least) / max(np.log(high / least), 1e-9), 0.0, 1.0)


def stiffness_legend(low: float, high: float) -> Legend:
    """Return the legend of the logarithmic stiffness scale from ``low`` to ``high``, N mm/rad."""
    _, label, unit, *_ = KINDS["STIFFNESS"]
    return Legend(f"{label} (logarithmic)", f"{low:.3g} {unit}", f"{high:.3g} {unit}", colours.QUANTITY_SCALE)


def _reason_colours(kinds: Int[np.ndarray, " quads"]) -> tuple[Float[np.ndarray, "quads 3"], Legend]:
    """Return colours and legend of the reasons why spirals miss the target; ``kinds`` are indices of the reasons."""
    from ...engine.optimisation.match_limits import REASON_NAMES

    looks = [colours.LIMITS[name] for name in REASON_NAMES]
    count = np.bincount(kinds, minlength=len(looks))
    entries = tuple((rgb, f"{text}: {n}") for (rgb, text), n in zip(looks, count.tolist(), strict=True) if n)
    rgb = colours.srgb_to_linear(np.array([rgb for rgb, _ in looks]))
    return rgb[kinds], Legend(KINDS["REACH"].label, entries=entries)


def legend_of(obj: bpy.types.Object, kind: str) -> Legend:
    """Return the legend of the colours of a kind that ``store_colours`` has written into the mesh."""
    with attributes.readable_mesh(obj) as mesh:
        values = attributes.read(mesh, KINDS[kind].attribute)
    assert values is not None
    return colours_and_legend(obj, kind, to_quad_values(kind, values))[1]


def store_colours(obj: bpy.types.Object, kind: str, *, recompute: bool = False) -> bool:
    """Write the colours of a kind into the mesh's active colour attribute.

    Return False if there are no up-to-date values of this kind, for example because their stage has not run.

    Parameters
    ----------
    obj : the mesh object
    kind : a key of ``KINDS``
    recompute : recompute the stiffness, which is stored for colours only, such as after a change of material
    """
    if not is_current(obj, kind):
        return False
    if kind == "STIFFNESS" and (recompute or not attributes.has(obj, KINDS[kind].attribute)):
        _store_stiffness(obj)
    with attributes.readable_mesh(obj) as mesh:
        values = attributes.read(mesh, KINDS[kind].attribute)
        sizes = column(mesh.polygons, "loop_total")
    if values is None or (sizes != 4).any():
        return False
    values = to_quad_values(kind, values)
    rgb, _ = colours_and_legend(obj, kind, values)
    rgba = np.repeat(np.c_[rgb, np.ones(len(rgb))], sizes, axis=0)
    attributes.write(obj, "flexmaps_colour", "CORNER", "FLOAT_COLOR", rgba)
    if not obj.data.is_editmode:
        obj.data.attributes.active_color_name = "flexmaps_colour"
    return True


def _store_stiffness(obj: bpy.types.Object) -> None:
    """Compute and store the spirals' stiffness; remove it if there are no spirals or the arm model excludes them."""
    from ...engine.mechanics.arms.spiral_stiffness import spiral_stiffness
    from ..store import mesh, snapshot

    attributes.remove(obj, KINDS["STIFFNESS"].attribute)
    with suppress(FlexMapsError):
        used = settings.read(obj.flexmaps, ObjectSettings)
        taken = snapshot.take_snapshot(obj, mesh.read_surface(obj, bpy.context.scene), used, with_loads=False)
        design = taken.to_result().design
        values = None if design is None else spiral_stiffness(design, used.material.chosen)
        if values is not None:
            fields.write_stiffness(obj, values)


def is_current(obj: bpy.types.Object, kind: str) -> bool:
    """Return whether the values of a kind are up to date; out-of-date values are not shown."""
    if kind == "SCAN":
        return scans.is_current(obj, bpy.context.scene)
    if kind == "UTILISATION":
        return not states.is_stale(obj, bpy.context.scene, "structure")
    return kind not in SIMULATED_KINDS or not states.is_stale(obj, bpy.context.scene, "equilibrium")
