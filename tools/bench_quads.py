"""Benchmark of remeshing triangles to quads: the best of several candidates beside QuadriFlow's first result.

Alignment is measured against libigl's principal directions on the triangles (Panozzo et al. 2010), and weighs by area and |k1 - k2|. On
spheres and planes it means nothing. Seconds are those of the processor, in this process and in the second Blender.
"""

from __future__ import annotations

from typing import Any

import igl
import numpy as np
from flexmaps.bridge.hosts import remesh
from flexmaps.engine.params import ObjectSettings
from flexmaps.engine.surface.checking.check import as_quad_mesh, with_numeric_arrays
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh
from flexmaps.engine.surface.remeshing import quality, requad
from harness import (
    Bench,
    Cases,
    Options,
    Row,
    Rows,
    at_most,
    from_folder,
    from_zoo,
    measure_time,
    note,
    processor_seconds,
    run_job,
)

FEWER, BETTER = 2 / 3, 0.8  # of the first answer alone: irregular vertices, misalignment to the principal directions
ENERGY = 0.035  # distortion that a quad should keep below
RADIUS = 5  # edges of the triangles that libigl's quadrics reach; its default
LONGEST = 60.0  # seconds
# radians by which a quad bends more one way than the other, in the mean, from which directions mean something
DIRECTED = 0.02
IRREGULAR, OFF, BENT = "irregular vertices", "misalignment", "bent more one way"  # names of rows
MADE = ("remesh-potato", "remesh-rough", "remesh-spiky", "remesh-land", "cube", "torus", "dome", "saddle")


def cases(options: Options) -> Cases:
    found = from_folder(options.meshes, "*.o[bf][jf]") | from_folder(options.meshes, "foreign/*.o[bf][jf]")
    return {name[:17]: make for name, make in (found | from_zoo(*MADE)).items()}


def measure(name: str, polygons: PolygonMesh, options: Options) -> Rows:
    """Yield the rows of one surface, remeshed by QuadriFlow's first result and by the program."""
    target = requad.target_surface(with_numeric_arrays(polygons))
    triangles = PolygonMesh(target.vertices, target.triangles.ravel(), np.full(len(target.triangles), 3))
    seconds_first, first = remeshed(triangles, options.quads, 1, 1, ())
    seconds, best = remeshed(
        triangles, options.quads, requad.MIN_ATTEMPTS, requad.MIN_RESULTS, requad.CURVATURE_ATTEMPTS
    )
    (off_first, _), (off, bent) = misalignment(first, target), misalignment(best, target)
    few, many = (quality.quality(PolygonMesh.from_quads(mesh), target).irregular for mesh in (best, first))
    yield note(name, IRREGULAR, int(few), {"first": int(many)})
    yield note(name, OFF, round(off, 1), {"first": round(off_first, 1), BENT: round(bent, 3)})
    yield at_most(name, "seconds", LONGEST, seconds, {"first": round(seconds_first, 1)})
    energy = run_job(PolygonMesh.from_quads(best), "split").flat.energy
    yield at_most(name, "E after merging", ENERGY, float(energy.max()))


def remeshed(triangles: PolygonMesh, count: int, *tries: Any) -> tuple[float, QuadMesh]:
    """Return the seconds of a remesh with these numbers and kinds of candidates, and its quads."""
    usual = requad.MIN_ATTEMPTS, requad.MIN_RESULTS, requad.CURVATURE_ATTEMPTS
    requad.MIN_ATTEMPTS, requad.MIN_RESULTS, requad.CURVATURE_ATTEMPTS = tries
    try:
        spent, found = measure_time(lambda: remesh.make_quads(triangles, count, ObjectSettings()), processor_seconds)
    finally:
        requad.MIN_ATTEMPTS, requad.MIN_RESULTS, requad.CURVATURE_ATTEMPTS = usual
    return spent, as_quad_mesh(found.polygons)


def sum_up(rows: list[Row], _: Options) -> Rows:
    """Return the rows over all surfaces, beside those of the first candidates."""
    counts, off = ([one for one in rows if one["row"] == name] for name in (IRREGULAR, OFF))
    directed = [one for one in off if one["peer"][BENT] >= DIRECTED]
    return [
        at_most("all", "refused", 0, sum(one["row"] == "refused" for one in rows)),
        _compared(IRREGULAR, FEWER, counts, 1),
        _compared("mean misalignment", BETTER, off, len(off)),
        _compared(f"of {len(directed)} with directions", BETTER, directed, len(directed)),
    ]


def _compared(name: str, share: float, rows: list[Row], count: int) -> Row:
    """Return the sum over rows by ``count``, at most this share of that of the first candidates."""
    best = sum(one["measured"] for one in rows) / max(count, 1)
    first = sum(one["peer"]["first"] for one in rows) / max(count, 1)
    return at_most("all", name, share * first, best, {"first": round(first, 1), "surfaces": len(rows)})


def misalignment(mesh: QuadMesh, target: Any) -> tuple[float, float]:
    """Return the mean angle (degrees) between the quads' sides and the principal directions of the triangles, and the mean
    difference (radians) of a quad's bending in its two directions."""
    one, _, k1, k2 = igl.principal_curvature(target.vertices, target.triangles, RADIUS)[:4]
    p = mesh.vertices[mesh.quads]
    _, triangle, _ = igl.point_mesh_squared_distance(mesh.centroids, target.vertices, target.triangles)[:3]
    near = target.triangles[triangle]
    nearest = np.linalg.norm(target.vertices[near] - mesh.centroids[:, None], axis=2).argmin(axis=1)
    vertex = near[np.arange(len(near)), nearest]
    along = p[:, 1] + p[:, 2] - p[:, 0] - p[:, 3]
    across = np.cross(mesh.normals, along)
    angle = np.arctan2(np.einsum("ni,ni->n", one[vertex], across), np.einsum("ni,ni->n", one[vertex], along))
    off = np.abs((angle + np.pi / 4) % (np.pi / 2) - np.pi / 4)
    weight = mesh.areas * np.minimum(np.abs(k1 - k2)[vertex] * np.sqrt(mesh.areas), 1.0)
    return float(np.degrees((off * weight).sum() / max(weight.sum(), 1e-300))), float(weight.sum() / mesh.areas.sum())


main = Bench(
    "quads", cases, measure, summary=sum_up, meshes=True, resume=True, quads=(1000, "quads asked for"),
)  # fmt: skip
