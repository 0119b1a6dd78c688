"""Benchmark of bases: feet in the slots of plates and frames, and eyelets, read back from the cutting files.

ezdxf reads the sheets. Every foot is cut out of its panel's outline as it was read, made a solid as thick as the sheet by
trimesh, brought to where its hub stands in the simulated shape, and cut open at the upper and at the lower side of the base.
Shapely judges whether these sections lie within the slot that was read, and how far they are from filling it. Nothing of how feet
and slots are drawn is used; where panels and plates lie on their sheets is taken from the packing.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
import shapely
import shapely.affinity
import trimesh
from drawn_rings import dxf_rings
from flexmaps.engine.fabrication.sheets import CutSheets
from flexmaps.engine.fabrication.writers import dxf
from flexmaps.engine.runs import job
from flexmaps.engine.surface.mesh import PolygonMesh
from harness import EDGE, Bench, Cases, Options, Rows, from_zoo, judge_record, run_job, temporary_folder

# of the zoo: open surfaces that stand on their border
MADE = ("dome", "dome-feet4", "cap-feet", "vault-plain", "barrel", "vase", "tower", "catenoid", "saddle-aspect2")
# others that can hang, and are not asked to stand
HUNG = ("dome-level", "perforated4", "hip-roof")
OFF = 0.1  # mm that planks may be nearer to each other than the clearance and still be neighbours
FINE = 1e-4  # mm, chords of arcs as they are read
LEVEL = 1e-3  # mm inside the base at which its upper and its lower side are looked at
HOLE = 0.8  # mm, diameter of an eyelet
WANTED = {
    # little enough that a slot shows too which is turned against its tongue, or made for another lean
    "tongue outside of slot (mm)": "<= 0.01",
    "slot too wide (mm)": "<= 0.01",  # beyond its tongue and the clearance
    "shoulders off the base (mm)": "<= 0.1",  # above it or below
    "planks overlap (mm2)": "<= 0",
    "joint off its clearance (mm)": "<= 0.1",
    "rings that the planks close": ">= 1",
    "planks that a pull takes out": "<= 0",
    "eyelet off its point (mm)": "<= 0.1",  # where the hub is held in the simulation
    "eyelet's diameter off (mm)": "<= 0.02",
    "material round it (diameters)": ">= 1",
    # panels as they are cut, fillets and all, may be heavier than the simulation takes them for
    "forces off the cut panels' weight (share)": "<= 0.05",
}
Figures = dict[str, float]  # by the names above


def cases(options: Options) -> Cases:
    return {
        f"{name} {kind}": partial(measure, f"{name} {kind}", make, kind)
        for name, make in from_zoo(*MADE, *HUNG).items()
        for kind in options.kinds.split(",")
        if kind == "eyelets" or name not in HUNG
    }


def measure(name: str, make: Callable[[], PolygonMesh], kind: str, _: Options) -> Rows:
    """Put a piece on its lowest spirals, or hang it by its highest ones, and read its base back."""
    polygons = make()
    values: dict[str, Any] = {"base.base": kind, "sheet.nesting": "FAST"}
    if kind == "eyelets":
        height = job.check_input(polygons, edge=EDGE).mesh.centroids[:, 2]
        top = np.flatnonzero(height >= height.max() - 0.005).tolist()
        values |= {"simulate.clamped": False, "simulate.gravity": True}
        return judge_record(name, WANTED, read_eyelets(run_job(polygons, values=values, supports=top)))
    piece = run_job(polygons, values=values, supports="lowest")
    ring = read_frame(piece) if piece.sheets.base.is_frame else {}
    return judge_record(name, WANTED, read_back(piece) | ring)


def read_back(piece: Any) -> Figures:
    """Write the sheets of a piece with a base, read them, and put its feet where they are simulated; the worst foot counts."""
    base, pose, design = piece.sheets.base, piece.simulation.equilibrium.pose, piece.design
    panels, plates = parts(piece.sheets)
    slots = [shapely.Polygon(ring) for plate in plates for ring in plate.interiors]
    ground, sheet = 1e3 * base.ground_height, 1e3 * base.thickness
    clearance = 1e3 * piece.sheets.connections.clearance
    tree, worst = shapely.STRtree(slots), np.zeros(3)
    for foot in base.feet:
        centre, rotation = 1e3 * design.arms.centre[foot.quad], pose.rotations[foot.quad]
        # what of the panel lies beyond the border of the foot's quad, as it was read
        way = -rotation[2, :2] / np.linalg.norm(rotation[2, :2])
        side = np.array([-way[1], way[0]])
        aside, far, half = 1e3 * foot.tongue_offset, 1e3 * foot.shoulder_distance - 1.0, 0.5e3 * foot.width + 0.5
        corners = [(far, -half), (far + 61.0, -half), (far + 61.0, half), (far, half)]
        window = shapely.Polygon([centre + u * way + (aside + v) * side for u, v in corners])
        panel = panels[int(design.flat.layout.patch_of[foot.quad])]
        body = _extrude(max(shapely.get_parts(panel.intersection(window)), key=lambda p: p.area), sheet)
        local = body.vertices - [*centre, 0.5 * sheet]
        body.vertices = local @ rotation.T + 1e3 * pose.centres[foot.quad]
        swept = _swept(body, (ground - LEVEL, ground - sheet + LEVEL))
        room = slots[tree.nearest(swept)].buffer(-clearance, join_style="mitre")
        outside = 0.0 if room.covers(swept) else float(shapely.hausdorff_distance(swept.union(room), room))
        loose = float(shapely.hausdorff_distance(room, swept))
        # the shoulders are what is wider than the slot
        wide = np.abs(local[:, :2] @ side - aside) > 0.5e3 * foot.tongue_width + 0.05
        high = abs(float(body.vertices[wide, 2].min()) - ground)
        worst = np.maximum(worst, [outside, loose, high])
    return dict(zip(WANTED, worst.tolist()))


def read_frame(piece: Any) -> Figures:
    """Lay the planks of a frame, as they are read, where they belong."""
    plates, clearance = parts(piece.sheets)[1], 1e3 * piece.sheets.connections.clearance
    solid = [shapely.Polygon(plate.exterior) for plate in plates]
    near = [(a, b) for a, b in combinations(solid, 2) if a.distance(b) < 2.0 * clearance + OFF]
    closed = shapely.union_all([one.buffer(0.5 * clearance + 0.01) for one in solid])
    # one that is shifted by a millimetre any way in its plane runs into a neighbour
    ways = np.column_stack([np.cos(np.arange(16) * np.pi / 8), np.sin(np.arange(16) * np.pi / 8)]).tolist()
    loose = 0
    for one in solid:
        others = shapely.union_all([other for other in solid if other is not one])
        loose += any(shapely.affinity.translate(one, *way).intersection(others).area <= 1e-3 for way in ways)
    inside = [shapely.Polygon(ring).area for part in shapely.get_parts(closed) for ring in part.interiors]
    slit = sum(one.area for one in solid) / len(solid) ** 2
    return {
        "planks overlap (mm2)": max(a.intersection(b).area for a, b in near),
        "joint off its clearance (mm)": max(abs(a.distance(b) - clearance) for a, b in near),
        "rings that the planks close": sum(area > slit for area in inside),
        "planks that a pull takes out": loose,
    }


def read_eyelets(piece: Any) -> Figures:
    """Read the eyelets of a piece; the worst of them counts."""
    panels, pose, flat = parts(piece.sheets)[0], piece.simulation.equilibrium.pose, piece.design.flat
    off = large = 0.0
    edge = np.inf
    for quad in piece.supports.tolist():
        panel, centre = panels[int(flat.layout.patch_of[quad])], 1e3 * flat.corners[quad].mean(axis=0)
        hole = min(map(shapely.Polygon, panel.interiors), key=lambda one: one.distance(shapely.Point(centre)))
        middle = np.array([hole.centroid.x, hole.centroid.y]) - centre
        there = 1e3 * pose.centres[quad] + pose.rotations[quad, :, :2] @ middle
        off = max(off, float(np.linalg.norm(there - 1e3 * piece.simulation.target.centroids[quad])))
        large = max(large, abs(2.0 * np.sqrt(hole.area / np.pi) - HOLE))
        others = [ring for ring in (panel.exterior, *panel.interiors) if shapely.Polygon(ring) != hole]
        edge = min(edge, min(hole.distance(ring) for ring in others) / HOLE)
    forces = np.array(piece.sheets.base.report["forces_N"]).sum(axis=0)
    # of the panels as they are read
    area = 1e-6 * sum(panel.area for panel in panels.values())
    weight = 9.81 * area * piece.sheets.thickness * piece.simulation.material.density
    return {
        "eyelet off its point (mm)": off,
        "eyelet's diameter off (mm)": large,
        "material round it (diameters)": float(edge),
        "forces off the cut panels' weight (share)": abs(float(forces[2]) / weight - 1.0),
    }


def parts(sheets: CutSheets) -> tuple[dict[int, Any], list[Any]]:
    """Return the panels by their patches, in the frames of these, and all plates in space seen from above; in mm."""
    panels, plates = {}, []
    with temporary_folder() as folder:
        for index in range(sheets.count):
            path = folder / "sheet.dxf"
            dxf.write_dxf(sheets, index, path)
            layers = [found for layer, found in dxf_rings(path, FINE).items() if "cut" in layer.lower()]
            rings = [shapely.Polygon(ring) for found in layers for ring in found]
            for number in np.flatnonzero(sheets.packing.sheet == index).tolist():
                panel = sheets.panels[number]
                if panel.kind == "key":
                    continue
                turn, shift = float(sheets.packing.rotation[number]), 1e3 * sheets.packing.shift[number]
                inside = shapely.Polygon(1e3 * panel.transform(turn, 1e-3 * shift).outline.sample(1e-5)).buffer(0.2)
                own = sorted(filter(inside.contains, rings), key=lambda ring: ring.area)
                whole = shapely.Polygon(own[-1].exterior, [hole.exterior for hole in own[:-1]])
                moved = shapely.affinity.rotate(
                    shapely.affinity.translate(whole, *-shift), -turn, (0, 0), use_radians=True
                )
                if panel.patch >= 0:
                    panels[panel.patch] = moved
                else:
                    plates.append(moved)
    return panels, plates


def _extrude(shape: Any, height: float) -> Any:
    """Make a body of a polygon without holes."""
    corners = shapely.get_coordinates(shapely.constrained_delaunay_triangles(shape)).reshape(-1, 4, 2)[:, :3]
    points, faces = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    return trimesh.creation.extrude_triangulation(points, faces.reshape(-1, 3), height)


def _swept(body: Any, heights: tuple[float, ...]) -> Any:
    """Return what a body takes of the plane between level sections, seen from above."""
    lines = [trimesh.intersections.mesh_plane(body, [0.0, 0.0, 1.0], [0.0, 0.0, height]) for height in heights]
    return shapely.convex_hull(shapely.multipoints(np.concatenate(lines).reshape(-1, 3)[:, :2]))


main = Bench("standing", cases, kinds=("feet,frame,eyelets", "kinds of base, with commas between them"))
