"""What a piece stands on: its feet in the slots of its base, read back from the files that are cut.

python3 tools/dev.py bench standing [--only PATTERNS] [--json FILE]

ezdxf reads the sheets. Every foot is cut out of its panel's outline as it was read, made a solid as thick as the sheet by
trimesh, brought to where its hub stands in the simulated shape, and cut open at the upper and at the lower side of the base.
Shapely judges whether these sections lie within the slot that was read, and how far they are from filling it. Nothing of how feet
and slots are drawn is used; where panels and plates lie on their sheets is taken from the packing.
"""

from __future__ import annotations

import argparse
import fnmatch
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import shapely
import trimesh
import zoo
from ezdxf.path import make_path
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication.sheets import CutSheets
from flexmaps.engine.fabrication.writers import dxf
from flexmaps.engine.params import Settings, changed
from flexmaps.engine.runs import job
from flexmaps.engine.runs.result import Result
from flexmaps.engine.surface.files import meshio
from flexmaps.engine.surface.mesh import PolygonMesh
from rows import Table, at_least, at_most, row

SHARED = Path(__file__).resolve().parent.parent.parent / "shared" / "meshes"
# of the zoo: open surfaces that stand on their border; and files beside the checkout, with the axis that points up
MADE = ("dome", "dome-feet4", "cap-feet", "vault-plain", "barrel", "vase", "tower", "catenoid", "saddle-aspect2")
FILES = {"vault.obj": "z", "quad_dome.obj": "z", "flower_cmc1.obj": "y"}
OFF, ASTRAY = 0.1, 0.2  # millimetres and degrees that a foot may be away from where it is simulated
FINE = 1e-4  # mm, chords of arcs as they are read
LEVEL = 1e-6  # metres inside the base at which its upper and its lower side are looked at


@dataclass(frozen=True)
class Fit:
    """How the feet of a piece fit their slots, the worst of all: mm and degrees.

    outside : how far a tongue reaches out of its slot; loose : how much wider a slot is than its tongue and the clearance
    high : how far shoulders are above the base, or below it; turned : between the slot and the tongue's section
    leaning : between the lean for which a slot is as wide as it is and the simulated one
    """

    feet: int
    outside: float
    loose: float
    high: float
    turned: float
    leaning: float


def main(arguments: list[str]) -> int:
    """Measure, print the table, write the rows; 0 whatever was measured."""
    parser = argparse.ArgumentParser(prog="dev.py bench standing")
    parser.add_argument("--only", default="*", help="patterns of names, with commas")
    parser.add_argument("--json", type=Path, help="write the rows here too")
    options = parser.parse_args(arguments)
    table, settings, stands = Table(30), changed(Settings(), {"base.base": "feet", "sheet.nesting": "FAST"}), 0
    for name, polygons in _surfaces().items():
        if not any(fnmatch.fnmatch(name, one) for one in options.only.split(",")):
            continue
        try:
            made = job.run(polygons, settings, edge=0.02, supports="lowest")
        except FlexMapsError as error:
            table.add(row(name, "no base", "", str(error)[:60], None))
            continue
        fit = read_back(made)
        stands += 1
        table.add(
            row(name, "feet", "", fit.feet, None),
            at_most(name, "tongue outside of slot (mm)", OFF, fit.outside),
            at_most(name, "slot too wide (mm)", OFF, fit.loose),
            at_most(name, "shoulders off the base (mm)", OFF, fit.high),
            at_most(name, "slot turned (deg)", ASTRAY, fit.turned),
            at_most(name, "slot leaning (deg)", ASTRAY, fit.leaning),
        )
    if options.only == "*":
        table.add(at_least("all", "open meshes that stand", 6, stands))
    table.finish(options.json)
    return 0


def _surfaces() -> dict[str, PolygonMesh]:
    found = {name: zoo.SURFACES[name].polygons() for name in MADE if name in zoo.SURFACES}
    for name, up in FILES.items():
        if (SHARED / name).is_file():
            found[name] = meshio.named(str(SHARED / name), up)[1]
    return found


def read_back(made: Result) -> Fit:
    """Write the sheets of a piece with a base, read them, and put its feet where they are simulated."""
    assert made.sheets is not None
    assert made.sheets.base is not None
    assert made.simulation is not None
    assert made.design is not None
    base, pose, arms = made.sheets.base, made.simulation.equilibrium.pose, made.design.arms
    panels, slots = parts(made.sheets)
    ground, sheet = 1e3 * base.ground, 1e3 * base.thickness
    clearance = 1e3 * made.sheets.connections.clearance
    tree, worst = shapely.STRtree(slots), np.zeros(5)
    for foot in base.feet:
        quad = foot.quad
        centre, rotation = 1e3 * arms.centre[quad], pose.rotations[quad]
        # what of the panel lies beyond the border of the foot's quad, as it was read
        way = -rotation[2, :2] / np.linalg.norm(rotation[2, :2])
        side = np.array([-way[1], way[0]])
        aside, far = 1e3 * foot.aside, 1e3 * foot.shoulder
        half = 0.5e3 * foot.width + 0.5
        corners = [(far - 1.0, -half), (far + 60.0, -half), (far + 60.0, half), (far - 1.0, half)]
        window = shapely.Polygon([centre + u * way + (aside + v) * side for u, v in corners])
        patch = int(made.design.flat.layout.patch_of[quad])
        piece = max(shapely.get_parts(panels[patch].intersection(window)), key=lambda p: p.area)
        body = _extruded(piece, sheet)
        local = body.vertices - [*centre, 0.5 * sheet]
        body.vertices = local @ rotation.T + 1e3 * pose.centres[quad]
        sections = [_section(body, height) for height in (ground - 1e3 * LEVEL, ground - sheet + 1e3 * LEVEL)]
        swept = shapely.convex_hull(shapely.union_all(sections))
        slot = slots[tree.nearest(swept)]
        room = slot.buffer(-clearance, join_style="mitre")
        outside = (
            max(float(shapely.hausdorff_distance(swept.union(room), room)), 0.0) if not room.covers(swept) else 0.0
        )
        loose = float(shapely.hausdorff_distance(room, swept))
        # the shoulders are what is wider than the slot
        points = local[:, :2] @ np.column_stack([way, side])
        wide = np.abs(points[:, 1] - aside) > 0.5e3 * foot.tongue + 0.05
        high = abs(float(body.vertices[wide, 2].min()) - ground)
        level = np.array([rotation[1, 2], -rotation[0, 2]]) / np.linalg.norm(rotation[:2, 2])
        turned, across = _along(slot, level)
        leaning = abs(_lean(across - 2.0 * clearance, sheet) - np.degrees(np.arccos(abs(rotation[2, 2]))))
        worst = np.maximum(worst, [outside, loose, high, turned, leaning])
    return Fit(len(base.feet), *worst.tolist())


def parts(sheets: CutSheets) -> tuple[dict[int, Any], list[Any]]:
    """The panels by their patches, in the frames of these, and the slots of all plates in space seen from above; in mm."""
    panels, slots = {}, []
    with tempfile.TemporaryDirectory() as folder:
        for index in range(sheets.count):
            path = Path(folder) / "sheet.dxf"
            dxf.write(sheets, index, path)
            rings = _rings(path)
            for number in np.flatnonzero(sheets.packing.sheet == index).tolist():
                panel = sheets.panels[number]
                if panel.kind == "key":
                    continue
                turn, shift = float(sheets.packing.rotation[number]), 1e3 * sheets.packing.shift[number]
                inside = shapely.Polygon(1e3 * panel.moved(turn, 1e-3 * shift).outline.sampled(1e-5))
                own = [ring for ring in rings if inside.buffer(0.2).contains(ring)]
                outer = max(own, key=lambda ring: ring.area)
                holes = [ring for ring in own if ring is not outer]
                whole = shapely.Polygon(outer.exterior, [hole.exterior for hole in holes])
                moved = shapely.transform(whole, partial(_back, turn=turn, shift=shift))
                if panel.patch >= 0:
                    panels[panel.patch] = moved
                else:
                    slots += [shapely.Polygon(ring) for ring in moved.interiors]
    return panels, slots


def _back(points: np.ndarray, turn: float, shift: np.ndarray) -> np.ndarray:
    """From a sheet into a part's own frame."""
    cos, sin = np.cos(turn), np.sin(turn)
    return (points - shift) @ np.array([[cos, -sin], [sin, cos]])


def _rings(path: Path) -> list[Any]:
    """The closed lines of the layers that are cut, as polygons, mm."""
    found = []
    for entity in ezdxf.readfile(path).modelspace():  # type: ignore[attr-defined]
        if "cut" in entity.dxf.layer.lower():
            points = [(p.x, p.y) for p in make_path(entity).flattening(FINE)]
            found.append(shapely.Polygon(points))
    return found


def _extruded(shape: Any, height: float) -> Any:
    """A polygon without holes as a body."""
    corners = shapely.get_coordinates(shapely.constrained_delaunay_triangles(shape)).reshape(-1, 4, 2)[:, :3]
    points, faces = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    return trimesh.creation.extrude_triangulation(points, faces.reshape(-1, 3), height)


def _section(body: Any, height: float) -> Any:
    """What a level plane cuts out of a body, seen from above."""
    lines = trimesh.intersections.mesh_plane(body, [0.0, 0.0, 1.0], [0.0, 0.0, height])
    return shapely.convex_hull(shapely.multipoints(lines.reshape(-1, 3)[:, :2]))


def _along(slot: Any, level: np.ndarray) -> tuple[float, float]:
    """Degrees between a slot and the level line of the sheet that stands in it, and how wide the slot is across that."""
    box = shapely.get_coordinates(shapely.minimum_rotated_rectangle(slot))
    sides = np.diff(box[:3], axis=0)
    length = np.linalg.norm(sides, axis=1)
    lean = np.abs(sides @ level) / length
    return float(np.degrees(np.arccos(min(lean.max(), 1.0)))), float(length[lean.argmin()])


def _lean(width: float, sheet: float) -> float:
    """Degrees at which a sheet needs an upright slot of this width in a sheet as thick: w = t / sin a + t / tan a = t / tan(a / 2)."""
    return float(np.degrees(2.0 * np.arctan2(sheet, width)))
