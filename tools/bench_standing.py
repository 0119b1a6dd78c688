"""Benchmark of bases: feet in the slots of plates and frames, and eyelets, read back from the cutting files.

python3 tools/dev.py bench standing [--only PATTERNS] [--kinds feet,frame,eyelets] [--json FILE]

ezdxf reads the sheets. Every foot is cut out of its panel's outline as it was read, made a solid as thick as the sheet by
trimesh, brought to where its hub stands in the simulated shape, and cut open at the upper and at the lower side of the base.
Shapely judges whether these sections lie within the slot that was read, and how far they are from filling it. Nothing of how feet
and slots are drawn is used; where panels and plates lie on their sheets is taken from the packing. Planks of frames are laid where they
belong: shapely judges whether they close a ring and how far they are from each other. Of eyelets it measures where their middles come to
lie, how large they are, and what is left round them; what they bear has to be the weight of the piece.
"""

from __future__ import annotations

import tempfile
from collections import Counter
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import shapely.affinity
import trimesh
from drawn_rings import dxf_rings
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication.sheets import CutSheets
from flexmaps.engine.fabrication.writers import dxf
from flexmaps.engine.params import Settings, with_values
from flexmaps.engine.runs import job
from flexmaps.engine.runs.result import Result
from flexmaps.engine.surface.formats import meshio
from flexmaps.engine.surface.mesh import PolygonMesh
from harness import MESHES, Bench, Surfaces, from_zoo
from rows import Table, at_least, at_most, note

# of the zoo: open surfaces that stand on their border; and files beside the checkout, with the axis that points up
MADE = ("dome", "dome-feet4", "cap-feet", "vault-plain", "barrel", "vase", "tower", "catenoid", "saddle-aspect2")
# others that can hang, and are not asked to stand
HUNG = ("dome-level", "perforated4", "hip-roof")
FILES = {"vault.obj": "z", "quad_dome.obj": "z", "flower_cmc1.obj": "y"}
OFF, ASTRAY = 0.1, 0.2  # millimetres and degrees that a foot may be away from where it is simulated
# share by which panels as they are cut, fillets and all, may be heavier than the simulation takes them for
HEAVIER = 0.05
FINE = 1e-4  # mm, chords of arcs as they are read
LEVEL = 1e-6  # metres inside the base at which its upper and its lower side are looked at


@dataclass(frozen=True)
class Fit:
    """Worst fit between the feet of a piece and their slots, in mm and degrees.

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
    """Measure, print the table and write the rows; return 0 whatever the figures."""
    kinds_help = ("feet,frame,eyelets", "kinds of base, with commas between them")
    bench = Bench("standing", arguments, 40, only="*", kinds=kinds_help)
    kinds, table, counts = bench.options.kinds.split(","), bench.table, Counter[str]()
    files: Surfaces = {name: partial(_file, name) for name in FILES if (MESHES / name).is_file()}
    for name, make in bench.cases((from_zoo(*MADE, *HUNG) | files).items()):
        for kind in kinds if name not in HUNG else ["eyelets"] if "eyelets" in kinds else []:
            try:
                made = _make(make(), kind)
            except FlexMapsError as error:
                table.add(note(name, f"no {kind}", str(error)[:60]))
                continue
            (_rows_of_hung if kind == "eyelets" else _rows_of_standing)(table, f"{name} {kind}", made)
            counts[kind] += 1
    summary = [at_least("all", f"open meshes with {kind}", 6, counts[kind]) for kind in kinds]
    return bench.finish(*(summary if bench.options.only == "*" else []))


def _make(polygons: PolygonMesh, kind: str) -> Result:
    """The sheets of a piece on its lowest spirals, or hung by its highest ones with its weight."""
    settings = with_values(Settings(), {"base.base": kind, "sheet.nesting": "FAST"})
    if kind != "eyelets":
        return job.run(polygons, settings, edge=0.02, supports="lowest")
    height = job.begin(polygons, edge=0.02).mesh.centroids[:, 2]
    top = np.flatnonzero(height >= height.max() - 0.005)
    settings = with_values(settings, {"simulate.clamped": False, "simulate.gravity": True})
    return job.run(polygons, settings, edge=0.02, supports=top.tolist())


def _rows_of_standing(table: Table, name: str, made: Result) -> None:
    """Rows of a piece on feet, and of its frame where that is what it stands on."""
    fit = read_back(made)
    table.add(
        note(name, "feet", fit.feet),
        at_most(name, "tongue outside of slot (mm)", OFF, fit.outside),
        at_most(name, "slot too wide (mm)", OFF, fit.loose),
        at_most(name, "shoulders off the base (mm)", OFF, fit.high),
        at_most(name, "slot turned (deg)", ASTRAY, fit.turned),
        at_most(name, "slot leaning (deg)", ASTRAY, fit.leaning),
    )
    assert made.sheets is not None
    assert made.sheets.base is not None
    if made.sheets.base.framed:
        ring = read_frame(made)
        table.add(
            note(name, "planks", ring.planks),
            at_most(name, "planks overlap (mm2)", 0.0, ring.overlap),
            at_most(name, "joint off its clearance (mm)", OFF, ring.off),
            at_least(name, "rings that the planks close", 1, ring.holes),
            at_least(name, "planks that come apart by no pull", ring.planks, ring.locked),
        )


def _rows_of_hung(table: Table, name: str, made: Result) -> None:
    """Rows of a piece that hangs."""
    fit = read_eyelets(made)
    table.add(
        note(name, "eyelets", fit.eyelets),
        at_most(name, "eyelet off its point (mm)", OFF, fit.off),
        at_most(name, "eyelet's diameter off (mm)", 0.02, fit.large),
        at_least(name, "material round it (diameters)", 1.0, fit.edge),
        at_most(name, "forces off the cut panels' weight (share)", HEAVIER, fit.weight),
    )


@dataclass(frozen=True)
class Ring:
    """planks : how many; overlap : mm2 that two of them share; off : mm between their distance and the clearance, the worst of all
    joints; holes : rings that they close; locked : planks whose neighbours hold them when they are pulled along the ring"""

    planks: int
    overlap: float
    off: float
    holes: int
    locked: int


def read_frame(made: Result) -> Ring:
    """The planks of a frame, as they are read, where they belong."""
    assert made.sheets is not None
    plates, clearance = parts(made.sheets)[1], 1e3 * made.sheets.connections.clearance
    solid = [shapely.Polygon(plate.exterior) for plate in plates]
    near = [(i, j) for i in range(len(solid)) for j in range(i) if solid[i].distance(solid[j]) < 2.0 * clearance + OFF]
    overlap = max(solid[i].intersection(solid[j]).area for i, j in near)
    off = max(abs(solid[i].distance(solid[j]) - clearance) for i, j in near)
    closed = shapely.union_all([one.buffer(0.5 * clearance + 0.01) for one in solid])
    # one that is shifted by a millimetre any way in its plane runs into a neighbour
    ways = 1.0 * np.column_stack([np.cos(np.arange(16) * np.pi / 8), np.sin(np.arange(16) * np.pi / 8)])
    locked = 0
    for k, one in enumerate(solid):
        others = shapely.union_all([solid[j] for j in range(len(solid)) if j != k])
        locked += all(shapely.affinity.translate(one, *way.tolist()).intersection(others).area > 1e-3 for way in ways)
    inside = [shapely.Polygon(ring) for part in shapely.get_parts(closed) for ring in part.interiors]
    rings = sum(one.area > sum(plank.area for plank in solid) / len(solid) ** 2 for one in inside)
    return Ring(len(solid), overlap, off, rings, locked)


@dataclass(frozen=True)
class Hung:
    """eyelets : how many; off : mm from where the hub is held in the simulation; large : mm, diameters; edge : diameters of material
    round the worst; weight : share by which the forces in all of them differ from the weight"""

    eyelets: int
    off: float
    large: float
    edge: float
    weight: float


def read_eyelets(made: Result) -> Hung:
    """The eyelets of a piece, as they are read."""
    assert made.sheets is not None
    assert made.sheets.base is not None
    assert made.simulation is not None
    assert made.design is not None
    assert made.supports is not None
    panels, pose, wanted = parts(made.sheets)[0], made.simulation.equilibrium.pose, 0.8
    off = large = 0.0
    edge = np.inf
    for quad in made.supports.tolist():
        panel, centre = (
            panels[int(made.design.flat.layout.patch_of[quad])],
            1e3 * made.design.flat.corners[quad].mean(axis=0),
        )
        holes = [shapely.Polygon(ring) for ring in panel.interiors]
        hole = min(holes, key=lambda one: one.distance(shapely.Point(centre)))
        middle = np.array([hole.centroid.x, hole.centroid.y]) - centre
        there = 1e3 * pose.centres[quad] + pose.rotations[quad, :, :2] @ middle
        off = max(off, float(np.linalg.norm(there - 1e3 * made.simulation.target.centroids[quad])))
        large = max(large, abs(2.0 * np.sqrt(hole.area / np.pi) - wanted))
        others = [panel.exterior, *(ring for ring, one in zip(panel.interiors, holes, strict=True) if one is not hole)]
        edge = min(edge, min(hole.distance(ring) for ring in others) / wanted)
    told = np.array(made.sheets.base.report["forces_N"]).sum(axis=0)
    # of the panels as they are read
    mass = (
        sum(panel.area for panel in panels.values()) * 1e-6 * made.sheets.thickness * made.simulation.material.density
    )
    return Hung(len(made.supports), off, large, float(edge), abs(float(told[2]) / (9.81 * mass) - 1.0))


def _file(name: str) -> PolygonMesh:
    return meshio.read_named(str(MESHES / name), FILES[name])[1]


def read_back(made: Result) -> Fit:
    """Write the sheets of a piece with a base, read them, and put its feet where they are simulated."""
    assert made.sheets is not None
    assert made.sheets.base is not None
    assert made.simulation is not None
    assert made.design is not None
    base, pose, arms = made.sheets.base, made.simulation.equilibrium.pose, made.design.arms
    panels, plates = parts(made.sheets)
    slots = [shapely.Polygon(ring) for plate in plates for ring in plate.interiors]
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
        body = _extrude(piece, sheet)
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
    """The panels by their patches, in the frames of these, and all plates in space seen from above; in mm."""
    panels, plates = {}, []
    with tempfile.TemporaryDirectory() as folder:
        for index in range(sheets.count):
            path = Path(folder) / "sheet.dxf"
            dxf.write(sheets, index, path)
            rings = [
                shapely.Polygon(ring)
                for layer, found in dxf_rings(path, FINE).items()
                if "cut" in layer.lower()
                for ring in found
            ]
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
                    plates.append(moved)
    return panels, plates


def _back(points: np.ndarray, turn: float, shift: np.ndarray) -> np.ndarray:
    """Transform from a sheet into a part's own frame."""
    cos, sin = np.cos(turn), np.sin(turn)
    return (points - shift) @ np.array([[cos, -sin], [sin, cos]])


def _extrude(shape: Any, height: float) -> Any:
    """A polygon without holes as a body."""
    corners = shapely.get_coordinates(shapely.constrained_delaunay_triangles(shape)).reshape(-1, 4, 2)[:, :3]
    points, faces = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    return trimesh.creation.extrude_triangulation(points, faces.reshape(-1, 3), height)


def _section(body: Any, height: float) -> Any:
    """Return the section of a body by a level plane, seen from above."""
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
