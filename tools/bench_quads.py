"""Benchmark of remeshing triangles to quads: the best of several candidates beside QuadriFlow's first result.

python3 tools/dev.py bench quads [--meshes DIR] [--only PATTERNS] [--quads N] [--json FILE]

The surfaces are the meshes of a folder, in triangles, and some that the project makes. Alignment is measured against libigl's
principal directions on the triangles (Panozzo et al. 2010), and weighs by area and |k1 - k2|. On spheres and planes it means
nothing; the mean is told over all surfaces, and over those that have directions. Seconds are those of the processor, in this
process and in the second Blender.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import igl
import numpy as np
import zoo
from flexmaps.bridge.hosts import remesh
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.params import ObjectSettings, Settings
from flexmaps.engine.runs import job
from flexmaps.engine.surface.checking.check import as_quad_mesh, with_numeric_arrays
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh
from flexmaps.engine.surface.remeshing import quality, requad
from harness import EDGE, Bench, from_folder, processor
from rows import Row, at_most, note

FEWER, BETTER = 2 / 3, 0.8  # of the first answer alone: irregular vertices, misalignment to the principal directions
ENERGY = 0.035  # distortion that a quad should keep below
RADIUS = 5  # edges of the triangles that libigl's quadrics reach; its default
LONGEST = 60.0  # seconds
# radians by which a quad bends more one way than the other, in the mean, from which directions mean something
DIRECTED = 0.02
IRREGULAR, OFF, BENT = "irregular vertices", "misalignment", "bent more one way"  # names of rows
MADE = ("remesh-potato", "remesh-rough", "remesh-spiky", "remesh-land", "cube", "torus", "dome", "saddle")


def main(arguments: list[str]) -> int:
    """Measure, print the table and write the rows; return 0 whatever the figures."""
    bench = Bench("quads", arguments, 26, only="*", meshes=True, resume=True, quads=(1000, "quads asked for"))
    folder = bench.options.meshes
    surfaces: dict[str, Any] = from_folder(folder, "*.o[bf][jf]") | from_folder(folder, "foreign/*.o[bf][jf]")
    surfaces |= {name: zoo.SURFACES[name].make for name in MADE if name in zoo.SURFACES}
    bench.each(_rows, {name[:17]: make for name, make in surfaces.items()}, bench.options.quads)
    return bench.finish(*_sum_up(bench.table.rows))


def _rows(name: str, polygons: PolygonMesh, count: int) -> Iterator[Row]:
    """Return the rows of one surface, remeshed by QuadriFlow's first result and by the program."""
    target = requad.target_of(
        PolygonMesh.from_quads(polygons) if isinstance(polygons, QuadMesh) else with_numeric_arrays(polygons)
    )
    triangles = PolygonMesh(target.vertices, target.triangles.ravel(), np.full(len(target.triangles), 3))
    found = {}
    usual = requad.CANDIDATES, requad.ENOUGH, requad.OWN, requad.DENSE
    for way, tries in (("first", (1, 1, (), requad.DENSE)), ("best", usual)):
        requad.CANDIDATES, requad.ENOUGH, requad.OWN, requad.DENSE = tries
        begun = processor()
        try:
            mesh = as_quad_mesh(remesh.quads_of(triangles, count, ObjectSettings()).polygons)
            judged = quality.quality(PolygonMesh.from_quads(mesh), target)
            found[way] = (judged, off_principal(mesh, target), mesh, processor() - begun)
        except FlexMapsError as error:
            print(f"{name} {way}: {error}", flush=True)
        finally:
            requad.CANDIDATES, requad.ENOUGH, requad.OWN, requad.DENSE = usual
    yield at_most(name, "refused", 0, int("best" not in found))
    if len(found) == 2:
        (one, (off_one, _), mesh_one, seconds_one), (best, (off, bent), mesh, seconds) = found["first"], found["best"]
        yield from (
            note(name, IRREGULAR, best.irregular, {"first": one.irregular}),
            note(name, OFF, round(off, 1), {"first": round(off_one, 1)}),
            note(name, BENT, round(bent, 3)),
            note(name, "unevenness", round(best.unevenness, 3), {"first": round(one.unevenness, 3)}),
            note(name, "sharp edges lost", round(best.lost, 3), {"first": round(one.lost, 3)}),
            note(name, "quads", len(mesh.quads), {"first": len(mesh_one.quads)}),
            at_most(name, "E after merging", ENERGY, merged_energy(mesh)),
            at_most(name, "seconds", LONGEST, seconds, {"first": round(seconds_one, 1)}),
        )


def _sum_up(rows: list[Row]) -> list[Row]:
    """Return the rows over all surfaces, beside those of the first candidates."""

    def both(name: str, meshes: set[str] | None = None) -> tuple[list[float], list[float]]:
        found = [one for one in rows if one["row"] == name and (meshes is None or one["mesh"] in meshes)]
        return [one["measured"] for one in found], [one["peer"]["first"] for one in found]

    (irregular, irregular_first), (off, off_first) = both(IRREGULAR), both(OFF)
    if not irregular:
        return []
    count = len(irregular)
    bent = {one["mesh"] for one in rows if one["row"] == BENT and one["measured"] >= DIRECTED}
    (some, some_first) = both(OFF, bent)
    return [
        note("all", "surfaces", count),
        at_most("all", IRREGULAR, FEWER * sum(irregular_first), sum(irregular), {"first": sum(irregular_first)}),
        _mean("mean misalignment", off, off_first, count),
        _mean(f"of {len(bent)} with directions", some, some_first, max(len(bent), 1)),
    ]


def _mean(name: str, best: list[float], first: list[float], count: int) -> Row:
    return at_most("all", name, BETTER * sum(first) / count, sum(best) / count, {"first": round(sum(first) / count, 1)})


def merged_energy(mesh: QuadMesh) -> float:
    """The worst quad's distortion in the merged panels; NaN where no layout is found."""
    try:
        found = job.run(PolygonMesh.from_quads(mesh), Settings(), edge=EDGE, stop_after="split")
    except FlexMapsError as error:
        print(error, flush=True)
        return float("nan")
    assert found.flat is not None
    return round(float(found.flat.energy.max()), 4)


def off_principal(mesh: QuadMesh, target: Any) -> tuple[float, float]:
    """Return the mean angle (degrees) between the quads' sides and the principal directions of the triangles, and the mean
    difference (radians) of a quad's bending in its two directions."""
    one, _, k1, k2 = igl.principal_curvature(target.vertices, target.triangles, RADIUS)[:4]
    p = mesh.vertices[mesh.quads]
    _, triangle, _ = igl.point_mesh_squared_distance(mesh.centroids, target.vertices, target.triangles)[:3]
    near = target.triangles[triangle]
    vertex = near[
        np.arange(len(near)), np.linalg.norm(target.vertices[near] - mesh.centroids[:, None], axis=2).argmin(axis=1)
    ]
    along = p[:, 1] + p[:, 2] - p[:, 0] - p[:, 3]
    normal = mesh.normals
    across = np.cross(normal, along)
    angle = np.arctan2(np.einsum("ni,ni->n", one[vertex], across), np.einsum("ni,ni->n", one[vertex], along))
    off = np.abs((angle + np.pi / 4) % (np.pi / 2) - np.pi / 4)
    weight = mesh.areas * np.minimum(np.abs(k1 - k2)[vertex] * np.sqrt(mesh.areas), 1.0)
    return float(np.degrees((off * weight).sum() / max(weight.sum(), 1e-300))), float(weight.sum() / mesh.areas.sum())
