"""Spirals with arms of strongly unlike widths, all the way to the files: judged by shapely, trimesh, ezdxf and svgelements."""

import sys

import ezdxf
import ezdxf.path
import numpy as np
import pytest
import shapely
import svgelements
import trimesh
from flexmaps.engine.display import arrange, solids
from flexmaps.engine.display.panel_mesh import DETAILS, make_panel_mesh
from flexmaps.engine.extras.film import assembly_film
from flexmaps.engine.fabrication import estimates, sheets
from flexmaps.engine.fabrication.writers import export, operations
from flexmaps.engine.fabrication.writers.panel_solids import TOLERANCE, extrude_panel
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.arms.bent import bend_arms
from flexmaps.engine.mechanics.assembly import target_pose
from flexmaps.engine.params import ConnectorParams, CutParams, LayoutParams, SheetParams, SimulateParams, SpiralParams
from flexmaps.engine.patches.flattening import flatten
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.patches.tracing import trace
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.spirals.contacts import find_contacts
from flexmaps.engine.surface import shapes

fit = sys.modules["flexmaps_connector_gaps"].fit

KERF = 0.0001
POM = MATERIALS["pom"]
CUT = {one.colour for one in operations.OPERATIONS if one.name.startswith("cut")}


def _widths(pattern, quads, low, high):
    """(F, 4) metres, from one end of the range to the other."""
    rng = np.random.default_rng(11)
    if pattern == "checker":
        return np.where(np.arange(4) % 2 == rng.integers(0, 2, (quads, 1)), low, high)
    if pattern == "thin":  # one arm of four
        return np.where(np.arange(4) == rng.integers(0, 4, (quads, 1)), low, high)
    return rng.uniform(low, high, (quads, 4))


def _layout(name):
    """A surface with quads of 20 mm and its seams."""
    mesh = {"dome": shapes.dome, "saddle": shapes.saddle}.get(name, lambda _: shapes.torus(8, 5))(4)
    mesh = mesh.with_vertices(mesh.vertices * 0.02 / mesh.median_edge)
    if name != "saddle":
        return mesh, trace.trace_layout(mesh, LayoutParams())
    across = np.abs(mesh.vertices[mesh.edges][:, :, 0]).max(axis=1) < 1e-6
    return mesh, PatchLayout(mesh, across & ~mesh.border)


QUICK = {("saddle", "random"), ("torus", "checker")}
CASES = [
    pytest.param(
        (name, pattern), id=f"{name}-{pattern}", marks=() if (name, pattern) in QUICK else pytest.mark.thorough
    )
    for pattern in ("checker", "thin", "random")
    for name in ("dome", "saddle", "torus")
]


@pytest.fixture(scope="module", params=CASES)
def case(request):
    """A surface, a design as wound as it can be in half of its quads, and its sheets."""
    name, pattern = request.param
    mesh, layout = _layout(name)
    flat = flatten.flatten(layout, LayoutParams())
    params, count = SpiralParams(clockwise=name == "saddle"), len(mesh.quads)
    width = _widths(pattern, count, params.width_min, params.width_max)
    made = fabricable.make_fabricable(flat, params, width, np.random.default_rng(12).uniform(0.0, 8.0, count))
    cut = sheets.make_sheets(made, SheetParams(nesting="FAST"), cut=CutParams(kerf_outline=KERF, kerf_holes=KERF))
    return mesh, made, cut


def _polygon(outline, holes=()):
    return shapely.Polygon(outline.sample(1e-6), [h.sample(1e-6) for h in holes])


def test_what_is_drawn_is_what_was_asked_for(case):
    """Nearly everywhere: the widths of half of the quads differ as much as they may."""
    _, made, _ = case
    spread = np.ptp(made.width, axis=1) / (made.params.width_max - made.params.width_min)
    assert np.median(spread) > 0.5 and not len(made.thin_quads)
    assert np.median(made.twist) > 1.0 and not len(fabricable.unfabricable_quads(made))


def test_panels_are_whole_and_can_be_cut(case):
    _, made, cut = case
    slot, arm = made.params.slot_min, made.params.width_min
    assert cut.slot_min >= 0.999 * slot
    assert not len(find_contacts(list(cut.connections.outlines)))
    for plain in made.outlines():
        polygon = _polygon(plain.outer, plain.holes)
        assert polygon.is_valid
        # no slot closes for a cutter as wide as the smallest one, no arm parts that is as thin as the thinnest
        assert len(polygon.buffer(0.49 * slot).interiors) == len(plain.holes)
        assert polygon.buffer(-0.49 * arm).geom_type == "Polygon"
    for panel in cut.panels:
        polygon = _polygon(panel.outline, panel.holes)
        assert polygon.is_valid and polygon.area == pytest.approx(panel.area, rel=1e-3)
        assert len(polygon.buffer(0.49 * slot).interiors) == len(panel.holes)
        assert polygon.buffer(-0.49 * ConnectorParams.thinnest).geom_type == "Polygon"
    for index in range(cut.count):
        placed = [_polygon(p.outline) for p in cut.panels_on_sheet(index)]
        assert min((a.distance(b) for a in placed for b in placed if a is not b), default=1.0) >= cut.params.spacing


def test_connectors_fit_and_nearly_every_joint_has_one(case):
    _, made, cut = case
    gaps = fit(made, cut.connections, KERF)
    kinds = [c.kind for c in cut.connections.connectors]
    assert kinds.count("tab") <= 0.1 * len(kinds) and not cut.connections.plain_joints
    assert gaps.overlap.max() == 0.0
    assert np.abs(gaps.least - cut.connections.clearance).max() < 1e-6


def test_labels_lie_inside_the_material(case):
    _, _, cut = case
    assert cut.labels_placed > 10 * cut.labels_left_out
    for panel in cut.panels:
        material = _polygon(panel.outline, panel.holes).buffer(-0.00005)
        shapely.prepare(material)
        assert all(material.contains(shapely.LineString(s.points)) for s in panel.labels)


def test_paths_beside_the_kerf_leave_the_panels(case):
    _, _, cut = case
    for index in range(cut.count):
        for panel, path in zip(cut.panels_on_sheet(index), cut.paths_on_sheet(index), strict=True):
            wanted, left = _polygon(panel.outline, panel.holes), _polygon(path.outline, path.holes)
            assert left.is_valid and len(left.interiors) == len(wanted.interiors)
            wrong = left.buffer(-0.5 * KERF, quad_segs=32).symmetric_difference(wanted)
            assert wrong.area < 2e-6 * wanted.length


def test_estimates_are_those_of_the_polygons(case):
    _, made, cut = case
    polygons = [_polygon(p.outline, p.holes) for p in cut.panels]
    assert cut.cut_length == pytest.approx(sum(p.length for p in polygons), rel=1e-3)
    mass = POM.density * made.params.thickness * sum(p.area for p in polygons)
    assert estimates.estimate(cut, made, POM).mass == pytest.approx(mass, rel=1e-3)
    plain = sum(_polygon(o.outer, o.holes).area for o in made.outlines())
    assert made.area.sum() == pytest.approx(plain, rel=5e-3)  # but for fillets


def _closed(vertices, corners, sizes):
    """The faces as triangles, for trimesh to judge."""
    starts = np.cumsum(sizes) - sizes
    fans = [
        np.stack([corners[s], corners[s + k], corners[s + k + 1]], axis=1)
        for k in range(1, sizes.max() - 1)
        for s in [starts[sizes > k + 1]]
    ]
    solid = trimesh.Trimesh(vertices, np.concatenate(fans), process=False)
    assert solid.is_watertight and solid.is_winding_consistent
    return solid


def test_solids_are_closed_and_as_heavy_as_the_panels(case):
    _, made, cut = case
    for panel in cut.panels:
        solid = extrude_panel(panel, made.params.thickness)
        mesh = trimesh.Trimesh(solid.vertices, solid.triangles, process=False)
        # between an arc and its chords lies at most two thirds of the tolerance along it
        length = panel.outline.length + sum(hole.length for hole in panel.holes)
        lost = 2.0 / 3.0 * TOLERANCE * length * made.params.thickness
        assert mesh.is_watertight and mesh.volume == pytest.approx(panel.area * made.params.thickness, abs=lost)
    shown = solids.make_solids(made, arrange.arrange_patches(made.flat), cut.connections.tips)
    volume = sum(p.area for p in cut.panels if p.patch >= 0) * made.params.thickness
    assert _closed(shown.vertices, shown.corners, shown.sizes).volume == pytest.approx(volume, rel=5e-3)


@pytest.mark.parametrize("case", [("saddle", "random")], indirect=True, ids="-".join)
def test_files_hold_the_same_polygons(case, tmp_path):
    _, _, cut = case
    written = export.write_sheets(cut, tmp_path / "sheet", ("svg", "dxf"))
    for index in range(cut.count):
        paths = cut.paths_on_sheet(index)
        wanted = [_polygon(c) for p in paths for c in (p.outline, *p.holes)]
        svg = next(p for p in written if p.name == f"sheet-{index + 1:02}.svg")
        dxf = next(p for p in written if p.name == f"sheet-{index + 1:02}.dxf")
        height = 1e3 * cut.packing.sizes[index][1]
        for found in (_of_svg(svg, height), _of_dxf(dxf)):
            assert len(found) == len(wanted)
            tree = shapely.STRtree(found)
            for polygon in wanted:
                near = [found[k] for k in tree.query(polygon)]
                assert min(polygon.symmetric_difference(f).area for f in near) < 2e-6 * polygon.length


def _of_svg(path, height):
    """Polygons of all that is cut, metres, as svgelements reads them."""
    found = []
    for element in svgelements.SVG.parse(path, ppi=25.4).elements():
        if isinstance(element, svgelements.Path) and element.stroke.hex in CUT:
            points = []
            for segment in element:
                if isinstance(segment, svgelements.Arc):
                    points += [segment.point(t) for t in np.linspace(0, 1, 2 + int(abs(segment.sweep) / 0.04))]
                elif isinstance(segment, svgelements.Line):
                    points += [segment.start, segment.end]
            found.append(shapely.Polygon([(1e-3 * p.x, 1e-3 * (height - p.y)) for p in points]))
    return found


def _of_dxf(path):
    document = ezdxf.readfile(path)
    assert not document.audit().errors
    cuts = [e for e in document.modelspace() if e.dxf.layer.startswith("CUT")]
    return [shapely.Polygon([(1e-3 * v.x, 1e-3 * v.y) for v in ezdxf.path.make_path(e).flattening(1e-3)]) for e in cuts]


def test_the_assembled_piece_is_drawn_without_gaps(case):
    mesh, made, cut = case
    pose = target_pose(mesh, made.flat.corners)
    panels = make_panel_mesh(made, DETAILS["MEDIUM"], cut.connections.tips)
    points = panels.vertices_at_pose(bend_arms(made, pose), pose)
    assert np.isfinite(points).all()
    volume = sum(p.area for p in cut.panels if p.patch >= 0) * made.params.thickness
    assert _closed(points, panels.corners, panels.sizes).volume == pytest.approx(volume, rel=0.02)


@pytest.mark.parametrize(
    "pattern", ["random", *(pytest.param(k, marks=pytest.mark.thorough) for k in ("checker", "thin"))]
)
def test_the_film_of_the_assembly_is_finite(pattern):
    mesh, layout = _layout("saddle")
    flat = flatten.flatten(layout, LayoutParams())
    width = _widths(pattern, len(mesh.quads), 0.001, 0.002)
    made = fabricable.make_fabricable(flat, SpiralParams(), width, np.full(len(width), 2.0))
    count = len(flat.layout.patches)
    table = np.c_[0.4 * np.arange(count), np.zeros((count, 2))]
    pose = target_pose(mesh, flat.corners)
    found = assembly_film.make_film(made, pose, table, DETAILS["COARSE"], POM, SimulateParams())
    for track in found.tracks:
        for values in (track.shapes, track.turns, track.places):
            assert np.isfinite(values).all()
        assert np.abs(track.shapes).max() < 1.0 and np.abs(track.places).max() < 0.4 * count + 1.0
