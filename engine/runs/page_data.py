"""Data of a page's 3D view of the piece: JSON with one packed block of numbers, read by ``view.js`` and ``packed.js``.

Lengths are in millimetres. Every array is quantised to multiples of a step and delta-coded from row to row, with as few
bytes per number as its largest difference needs; bytes are shuffled (the low bytes of all numbers come first). The
block of all arrays is deflated and written in base64.
"""

from __future__ import annotations

import json
import zlib
from base64 import b64encode
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .. import colours
from ..arrays import Float
from ..display import arrange
from ..display.run_plots import MapValues
from ..display.skin import Skin
from ..extras import registry
from ..fabrication.panels.labels import panel_name, seam_labels, seam_name
from ..materials import Material
from ..mechanics.arms.spiral_stiffness import spiral_stiffness
from ..mechanics.assembly import Pose, target_pose
from ..params import ObjectSettings
from ..patches import joining
from ..progress import SILENT, Progress
from ..spirals.design import SpiralDesign
from ..surface.far import recentre_quads
from .result import Result

MM = 1e3  # millimetres in a metre
# Quantisation steps of shapes and of the target, millimetres, of angles, radians, and of components of quaternions.
# Larger: smaller pages, less accurate; with these, corners of arms are within 0.05 mm in pieces up to a room's size
FINE, PLACE, TURN, QUATERNION = 0.01, 0.01, 1e-3, 1 / 32767
SHARE = 1 / 120  # quantisation step of shares from 0 to 1, so that the share 1 fits into a signed byte
SHADES = 500  # number of distinct values on a colour scale, more than a screen shows; larger: larger pages


@dataclass(eq=False)
class ArrayPacker:
    """Builder of the packed block of arrays.

    parts : packed arrays; size : their total number of bytes
    listed : by name of an array, its offset in the uncompressed block, bytes per number, rows, columns and step
    """

    parts: list[bytes] = field(default_factory=list)
    listed: dict[str, dict[str, Any]] = field(default_factory=dict)
    size: int = 0

    def add(self, name: str, values: np.ndarray, step: float = 1.0) -> None:
        """Append an array (n, ...), rounded to multiples of ``step``, under ``name``."""
        whole = np.rint(np.asarray(values, dtype=float) / step).astype(np.int64)
        rows = whole.reshape(len(whole), -1) if len(whole) else whole.reshape(0, 1)
        steps = np.diff(rows, axis=0, prepend=0)
        most = int(np.abs(steps).max(initial=0))
        width = next(size for size in (1, 2, 4) if most < 1 << (8 * size - 1))
        data = np.ascontiguousarray(steps.astype(f"<i{width}")).view(np.uint8).reshape(-1, width).T.tobytes()
        self.listed[name] = {"at": self.size, "bytes": width, "rows": len(rows), "columns": rows.shape[1], "step": step}
        self.parts.append(data)
        self.size += len(data)

    def block(self) -> str:
        """Return all arrays, deflated, in base64."""
        return b64encode(zlib.compress(b"".join(self.parts), 9)).decode("ascii")


@dataclass(frozen=True, eq=False)
class ViewContent:
    """Content of the 3D view.

    design : the spirals
    measured : values per quad for the colourings
    pose : simulated pose of the hubs; None if there is no simulation
    """

    design: SpiralDesign
    measured: MapValues
    pose: Pose | None = None

    @classmethod
    def from_result(cls, result: Result) -> ViewContent | None:
        """Collect the content from the outputs of the stages; return None without spirals."""
        if result.design is None:
            return None
        measured = MapValues.from_results(result.mesh, result.flat, result.design, result.simulation)
        simulation = result.simulation
        return cls(result.design, measured, None if simulation is None else simulation.equilibrium.pose)

    def near(self) -> ViewContent:
        """Return the content moved to the origin if it is so far away that packed numbers would overflow."""
        layout = self.design.flat.layout
        moved = recentre_quads(layout.mesh)
        if moved is layout.mesh:
            return self
        way = moved.vertices[0] - layout.mesh.vertices[0]
        flat = replace(self.design.flat, layout=replace(layout, mesh=moved))
        measured = replace(self.measured, mesh=moved)
        pose = None if self.pose is None else replace(self.pose, centres=self.pose.centres + way)
        return ViewContent(replace(self.design, flat=flat), measured, pose)


def to_json(shown: ViewContent, settings: ObjectSettings, title: str, progress: Progress = SILENT) -> str:
    """Return the data of the view as JSON that is safe inside a script element.

    Parameters
    ----------
    shown : content of the view
    settings : settings of the piece; material, simulation and page are used
    title : name of the piece, any text
    progress : called with the fraction done; may cancel

    Raises
    ------
    FlexMapsError : a spiral is outside the elastic model's range
    """
    made = view_data(shown, settings, title, progress)
    # escape "<", so that no text ends the element or begins a comment
    return json.dumps(made, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def view_data(shown: ViewContent, settings: ObjectSettings, title: str, progress: Progress = SILENT) -> dict[str, Any]:
    """Return the data of the view as a dictionary of JSON types; parameters and errors as in ``to_json``."""
    shown = shown.near()
    design, pose, packed = shown.design, shown.pose, ArrayPacker()
    material = settings.material.chosen
    layout = design.flat.layout
    steps = joining.assembly_steps(layout)
    skin = Skin.from_design(design, pose, progress.part(0.0, 0.2))
    _pack_skin(packed, skin)
    _pack_target(packed, shown.measured)
    place = target_pose(layout.mesh, design.flat.corners) if pose is None else pose
    table = arrange.places_before_assembly(design, place)
    described: dict[str, Any] = {
        "title": title,
        "simulated": pose is not None,
        "thickness": MM * design.params.thickness,
        "edge": round(MM * layout.mesh.median_edge, 3),
        "panels": _describe_panels(design, [step.panel for step in steps]),
        "colourings": _pack_colourings(packed, shown, material),
        "seams": _describe_seams(design, steps),
    }
    if pose is None:
        described |= {"length": 0.0, "tracks": _static_tracks(packed, design, _on_table(design, table)), "notes": []}
    elif not registry.has("film"):
        described |= {"length": 0.0, "tracks": _static_tracks(packed, design, pose), "notes": []}
        packed.add("closings", np.tile([-1.0, -0.5], (int((~layout.mesh.border).sum()), 1)), 1e-3)
    else:
        hub_film, resting = registry.load("film.hub_film"), settings.page.coming == "RESTING"
        hubs, rest = hub_film.HubActors(design), progress.part(0.2, 1.0)
        shots = hub_film.make_hub_film(hubs, pose, table, material, settings.simulate, rest, resting=resting)
        described |= {"length": shots.length, "tracks": _moving_tracks(packed, hubs, shots)}
        described["notes"] = _describe_skipped(shots.stages.skipped)
        # clamp infinite closing times to a time after the film's end
        packed.add("closings", np.minimum(hub_film.closing_times(design, shots), shots.length + 1.0), 1e-3)
    mesh = layout.mesh
    packed.add("patch", layout.patch_of)
    packed.add("joints", 4 * mesh.edge_quads[~mesh.border] + mesh.edge_sides[~mesh.border])
    return described | {"arrays": packed.listed, "block": packed.block()}


def _pack_skin(packed: ArrayPacker, skin: Skin) -> None:
    quads = len(skin.tip) // 4
    packed.add("sections", np.bincount(skin.arm, minlength=4 * quads))
    packed.add("share", skin.share, SHARE)
    packed.add("flat", MM * np.hstack([skin.left, skin.right]), FINE)
    packed.add("tip", MM * skin.tip, FINE)
    packed.add("axis", skin.axis, TURN / 10)
    packed.add("way", MM * skin.way, FINE)
    packed.add("turn", skin.turn, TURN)
    if skin.rim_strip is not None:
        packed.add("rim_quad", skin.rim_strip.quad)
        packed.add("rim_flat", MM * skin.rim_strip.flat, FINE)
        packed.add("rim_way", MM * skin.rim_strip.way, FINE)
        packed.add("rim_up", skin.rim_strip.up, TURN)
        packed.add("rim_triangles", skin.rim_strip.triangles)
        packed.add("rim_walls", skin.rim_strip.walls)


def _pack_target(packed: ArrayPacker, measured: MapValues) -> None:
    packed.add("target", MM * measured.mesh.vertices, PLACE)
    packed.add("quads", measured.mesh.quads)


def _describe_panels(design: SpiralDesign, joined: list[int]) -> list[dict[str, Any]]:
    """Return for each patch: name and colour of its panel, the quad for its label, and its step of the assembly.

    joined : panels in the order of the assembly
    """
    layout = design.flat.layout
    shades, numbers = colours.to_hexadecimal(colours.patch_colours(len(layout.patches))), joining.panel_numbers(layout)
    found = []
    for patch, quads in enumerate(layout.patches):
        centres = design.arms.centre[quads]
        middle = int(quads[np.argmin(np.linalg.norm(centres - centres.mean(axis=0), axis=1))])
        found.append(
            {"name": panel_name(numbers[patch]), "colour": shades[patch], "hub": middle, "step": joined.index(patch)}
        )
    return found


def _describe_seams(design: SpiralDesign, steps: list[joining.AssemblyStep]) -> list[list[dict[str, Any]]]:
    """Return the seams that each assembly step closes: name, colour, other panel, and arm and name of every joint."""
    layout = design.flat.layout
    mesh, names, numbers = layout.mesh, seam_labels(layout), joining.panel_numbers(layout)
    shades = colours.to_hexadecimal(colours.seam_colours(max(len(layout.seams), 1)))
    found = []
    for step in steps:
        row = []
        for join in step.joins:
            joints = []
            for edge in layout.seams[join.seam].tolist():
                quad, side = int(mesh.edge_quads[edge][0]), int(mesh.edge_sides[edge][0])
                joints.append([4 * quad + side, names[quad, side]])
            other = None if join.other == join.panel else panel_name(numbers[join.other])
            row.append({"name": seam_name(join.seam), "colour": shades[join.seam], "other": other, "joints": joints})
        found.append(row)
    return found


def _static_tracks(packed: ArrayPacker, design: SpiralDesign, pose: Pose) -> list[dict[str, Any]]:
    """Return tracks for panels that do not move: every panel stays in one pose."""
    patch, found = design.flat.layout.patch_of, []
    for panel in range(len(design.flat.layout.patches)):
        own = patch == panel
        _pack_poses(packed, panel, pose.centres[None, own], pose.rotations[None, own])
        found.append(_pack_track(panel, [0.0], [0], [0.0], np.eye(3)[None], np.zeros((1, 3))))
    return found


def _on_table(design: SpiralDesign, table: np.ndarray) -> Pose:
    """Return the pose of flat panels that lie on the table."""
    patch = design.flat.layout.patch_of
    flat = np.c_[design.arms.centre, np.zeros(len(patch))] + table[patch]
    return Pose(flat, np.broadcast_to(np.eye(3), (len(flat), 3, 3)))


def _moving_tracks(packed: ArrayPacker, hubs: Any, shots: Any) -> list[dict[str, Any]]:
    """Return the tracks of the moving panels, in the order of the assembly."""
    found = []
    for one in shots.tracks:
        _pack_poses(packed, one.patch, *hubs.poses(one.shapes))
        times, which = one.shape_times.tolist(), one.which.tolist()
        found.append(_pack_track(one.patch, times, which, one.times.tolist(), one.turns, one.places))
    return found


def _pack_poses(
    packed: ArrayPacker, panel: int, centres: np.ndarray, rotations: Float[np.ndarray, "shapes hubs 3 3"]
) -> None:
    packed.add(f"centres {panel}", MM * centres, FINE)
    packed.add(f"turns {panel}", _quaternions(rotations), QUATERNION)


def _pack_track(
    panel: int, changes: list[float], which: list[int], times: list[float], turns: np.ndarray, places: np.ndarray
) -> dict[str, Any]:
    return {
        "panel": panel,
        "changes": [round(time, 4) for time in changes],
        "which": which,
        "times": [round(time, 4) for time in times],
        "turns": np.round(_quaternions(turns), 6).tolist(),
        "places": np.round(MM * places, 3).tolist(),
    }


def _quaternions(rotations: Float[np.ndarray, "times ... 3 3"]) -> Float[np.ndarray, "times ... 4"]:
    """Convert rotations to quaternions x, y, z, w, with signs such that consecutive quaternions are near each other."""
    from scipy.spatial.transform import Rotation

    found = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_quat().reshape(*rotations.shape[:-2], 4)
    found = np.where(found[:1, ..., 3:] < 0.0, -found, found)
    turned = np.where((found[1:] * found[:-1]).sum(axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    return np.concatenate([found[:1], found[1:] * np.cumprod(turned, axis=0)])


def _pack_colourings(packed: ArrayPacker, shown: ViewContent, material: Material) -> list[dict[str, Any]]:
    """Pack the values per spiral that colours can show; return their names, units and colour scales."""
    m, found = shown.measured, []
    values: list[tuple[str, str, str, np.ndarray | None, float, np.ndarray]] = []
    if shown.pose is not None and m.distance is not None:
        high = max(float(m.distance.max()), colours.LEAST_DISTANCE)
        values.append(("distance", "Distance to the target", "mm", m.distance, high, colours.ERROR_SCALE))
    if shown.pose is not None and m.strain is not None:
        high = max(100.0, 100.0 * float(m.strain.max()))
        values.append(("strain", "Strain", "% of the limit", 100.0 * m.strain, high, colours.ERROR_SCALE))
    stiff = spiral_stiffness(shown.design, material)
    if stiff is not None:
        values.append(
            ("stiffness", "Stiffness of the arms", "N\u00b7mm/rad", stiff, float(stiff.max()), colours.QUANTITY_SCALE)
        )
    for name, label, unit, numbers, high, scale in values:
        assert numbers is not None
        if not np.isfinite(numbers).all():  # the stored values were edited in a .blend file
            continue
        low = float(numbers.min()) if name == "stiffness" else 0.0
        packed.add(name, np.clip((numbers - low) / max(high - low, 1e-12), 0.0, 1.0), 1.0 / SHADES)
        shades = [f"#{r:02x}{g:02x}{b:02x}" for r, g, b in np.rint(255 * scale).astype(int).tolist()]
        found.append({"name": name, "label": label, "unit": unit, "low": low, "high": high, "scale": shades})
    return found


def _describe_skipped(skipped: tuple[tuple[str, str], ...]) -> list[str]:
    if not skipped:
        return []
    names = ", ".join(f"{panel}-{seam}" for panel, seam in skipped[:4]) + ", ..." * (len(skipped) > 4)
    return [f"{len(skipped)} half-finished pieces (panel-seam {names}) find no rest; blends stand in."]
