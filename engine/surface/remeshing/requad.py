"""Quad remeshing of any mesh: each body by itself, with a tool that remeshes one clean body at a time.

The tool is Blender's (``bridge.hosts.second_blender``): QuadriFlow, and a voxel remesh for bodies that are not clean
(manifold, consistently oriented). This module ranks and repairs its results. QuadriFlow works in single precision and
fails on very small or large surfaces, so every body is first scaled to one size.

Closed bodies that intersect become one body. Bodies that are not clean are rebuilt from voxels. Open parts are cut apart
at edges of three faces. Bodies too small for the number of quads are left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import Cancelled, FlexMapsError
from ...params import RemeshParams
from ...progress import SILENT, Progress
from ...tolerances import SINGLE_TOL
from ..checking.check import Finding
from ..checking.topology import bodies, sides_of
from ..mesh import PolygonMesh
from ..quadrangulation.even import simplify_triangles
from ..quadrangulation.quadrangulate import quadrangulate
from ..welding import weld
from .bodies import choose_bodies, concatenate_meshes, find_bodies, is_clean, is_closed, target_surface, to_triangles
from .coverage import warn_of_gaps
from .halves import MirrorPlane, cut_at_plane, euler_characteristic, mirror_and_join, mirror_planes, planes_preserving
from .mend import SHARP_ANGLE, TargetSurface, mesh_from_rows
from .refine import split_into_quads
from .soundness import SoundQuads, rate_quads, regularise_if_better, repair_and_rate
from .tool import RemeshTool

EXTENT = 2.0  # largest dimension to which bodies are scaled for the tool, no unit; at smaller sizes QuadriFlow fails
# Default of the largest share of the area that may be left out because it lies in bodies with too few quads.
MAX_LEFT_OUT = RemeshParams.crumbs
FIRST, REST = (0.05, 0.3), (0.3, 1.0)  # fractions of the progress: for first quads of every body; for better quads
# Smallest number of quads of an open and of a closed body; bodies that would get fewer are left out. Larger: the pieces
# match the shape better, but small bodies are lost.
MIN_QUADS, MIN_QUADS_CLOSED = 6, 12
# Attempts with QuadriFlow, in order: seed, share of the wanted count, subdivisions, whether sharp edges are preserved.
QUADRIFLOW_ATTEMPTS = (
    (0, 1.0, 0, False), (0, 1.0, 1, False), (1, 1.0, 1, False), (2, 1.1, 1, False), (0, 1.0, 1, True), (0, 1.0, 0, True),
    (0, 1.0, 2, False), (1, 1.1, 2, True), (1, 1.0, 0, False), (2, 1.1, 0, False), (3, 0.9, 0, False), (4, 1.25, 0, False),
    (5, 0.8, 0, False), (6, 1.6, 0, False),
)  # fmt: skip
# Smallest number of attempts before the best sound result is accepted although some of its quads are poor (see
# ``mend.POOR``). Larger: fewer irregular vertices, slower.
MIN_ATTEMPTS = 4
NO_FOLDS = 180.0  # angle that no fold exceeds, degrees
# Attempts along the curvature: smallest angle of folds that quads follow, degrees; weight of the alignment; strength of
# the smoothing. Rows are tried until a row gives useful quads; a row ends at its first failure.
CURVATURE_ATTEMPTS: tuple[tuple[tuple[float, float, float], ...], ...] = (
    ((SHARP_ANGLE, 4.0, 10.0), (SHARP_ANGLE, 16.0, 10.0)),
    ((NO_FOLDS, 4.0, 10.0), (NO_FOLDS, 16.0, 10.0)),
    ((NO_FOLDS, 0.5, 30.0),),
)
MAX_MAPS = 3  # largest number of attempts along the curvature per body; larger: better, slower
# Approximate limit on the sum of the quads of all attempts along the curvature per body, so that fine quads get fewer
# attempts, but at least one. Larger: better, slower
MAX_MAPPED_QUADS = 3000
TRIANGLES_PER_QUAD = 20.0  # triangles per quad to which denser bodies are simplified; larger: more detail, slower
MAX_VOXEL_ATTEMPTS = 3  # largest number of attempts with QuadriFlow on each voxel surface
VOXEL_SIZES = (0.35, 0.5, 0.72, 1.0)  # voxel sizes in quad edges: small voxels preserve detail, large voxels close gaps
# Smallest share of all outer skins' area in the largest skin of a voxel surface. Smaller: larger parts may be dropped.
MIN_SKIN_SHARE = 0.95
MIN_RESULTS = 3  # smallest number of results before the best is accepted with poor quads; larger: better, slower
# Polygon sizes, in quad edges, tried if QuadriFlow finds no quads; each polygon is then split into one quad per corner.
CELL_SIZES = (2.0, 2.4, 1.6)
# Largest ratio of quads from CELL_SIZES to the wanted number; bodies that consist of small faces give more.
MAX_CELL_RATIO = 3
# Symmetric quads are accepted at once if their number differs from the wanted number by less than this factor. Larger:
# faster, but meshes that had to be subdivided, with many irregular vertices, are accepted.
MAX_COUNT_RATIO = 1.5
# Quads with less than this share of the surface's area rank lower. Larger: fewer thin parts are lost.
MIN_AREA_SHARE = 0.8


@dataclass(frozen=True, eq=False)
class RemeshResult:
    """Result of remeshing: quads, and warnings about parts of the mesh that were left out, joined or missed."""

    polygons: PolygonMesh
    findings: list[Finding]


def requad(
    mesh: PolygonMesh,
    count: int,
    tool: RemeshTool,
    progress: Progress = SILENT,
    crumbs: float = MAX_LEFT_OUT,
    symmetric: bool = False,
) -> RemeshResult:
    """Remesh any mesh with about ``count`` quads, which are shared out among its bodies by area.

    Parameters
    ----------
    mesh, count, tool : mesh with any faces; number of quads wanted; remesher for one clean body
    crumbs, symmetric : share of the area that may be left out; whether mirror planes should give symmetric quads

    Raises
    ------
    FlexMapsError : a body gets no sound quads, or more than ``crumbs`` would be left out
    """
    progress(0.0, "Looking for bodies")
    if not len(mesh.sizes) or not np.isfinite(mesh.vertices[mesh.corners]).all():
        raise FlexMapsError("The mesh has no faces, or vertices that are not finite: add faces, or delete these")
    mesh = weld(mesh).with_canonical_order()
    low = mesh.vertices[mesh.corners].min(axis=0)
    scale = EXTENT / max(float(np.ptp(mesh.vertices[mesh.corners], axis=0).max()), 1e-300)
    sized = replace(mesh, vertices=(mesh.vertices - low) * scale)
    triangles = to_triangles(sized, SINGLE_TOL * EXTENT, tool, progress)
    parts, found = find_bodies(triangles, tool, progress)
    areas = np.array([target_surface(part).area for part in parts])
    share = count * areas / areas.sum()
    fewest = np.where([is_closed(part) for part in parts], MIN_QUADS_CLOSED, MIN_QUADS)
    large, left_out = choose_bodies(areas, count, fewest, crumbs)
    kept = np.flatnonzero(large)
    planes = mirror_planes(concatenate_meshes([parts[k] for k in kept])) if symmetric else []
    searches: list[_BodySearch | _MirroredSearch] = []
    for done, k in enumerate(kept):
        image = next(_mirrored_searches(parts, kept[:done].tolist(), searches, k, planes), None)
        name = f" of body {done + 1} of {len(kept)}" if len(kept) > 1 else ""
        wanted = max(int(fewest[k]), round(share[k] * count / share[large].sum()))
        searches.append(image or _BodySearch(parts[k], wanted, tool, name, planes_preserving(parts[k], planes, EXTENT)))

    def joined_quads() -> PolygonMesh:
        quads = concatenate_meshes([search.best_quads for search in searches])
        return replace(quads, vertices=quads.vertices / scale + low)

    try:
        for to_the_end, (begin, end) in ((False, FIRST), (True, REST)):
            for done, search in enumerate(searches):
                piece = progress.part(begin, end).part(done / len(searches), (done + 1) / len(searches))
                search.run(piece, to_the_end)
            if not to_the_end:
                progress.show(joined_quads())
    except Cancelled:  # keep the best so far if every body has quads
        if not all(search.results for search in searches):
            raise
    progress.tell(1.0, "Quads are ready")
    first = np.cumsum([0, *(len(search.best_quads.sizes) for search in searches)]).tolist()
    missed = [w for search, begin in zip(searches, first, strict=False) for w in search.gap_warnings(first[-1], begin)]
    return RemeshResult(regularise_if_better(joined_quads()), found + left_out + missed)


# -- one body ----------------------------------------------------------------------------------------------------------


class _BodySearch:
    """Search for ``count`` quads of one body; messages append ``name`` to say which body.

    planes : mirror planes of the body; results : sound results so far
    """

    def __init__(self, body: PolygonMesh, count: int, tool: RemeshTool, name: str, planes: Sequence[MirrorPlane] = ()):
        low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
        self._middle, self._scale = 0.5 * (low + high), EXTENT / max(float((high - low).max()), 1e-300)
        self._small = replace(body, vertices=(body.vertices - self._middle) * self._scale)
        self._whole, self._count, self._tool, self._name = target_surface(self._small), count, tool, name
        self._clean = is_clean(self._small)
        self._planes = [replace(plane, point=(plane.point - self._middle) * self._scale) for plane in planes]
        self.results: list[SoundQuads] = []
        self._failure_reason, self._attempt_count, self._progress = "", 0, SILENT
        self._attempt_iterator = self._attempts()

    def run(self, progress: Progress, to_the_end: bool) -> None:
        """Try until there is a result, or all attempts if ``to_the_end``; raise FlexMapsError if there is no result."""
        self._progress, self._attempt_count = progress, 0
        while to_the_end or not self.results:
            found = next(self._attempt_iterator, None)
            if found is None:
                break
            if isinstance(found, SoundQuads):
                self.results.append(self._with_area_fault(found))
            else:
                self._failure_reason = self._failure_reason or found
        if not self.results:
            reason = self._failure_reason or "it is not a clean surface, neither by itself nor as voxels"
            raise FlexMapsError(
                f"No sound quads were found{self._name}: {reason}. "
                "Give another quad count; give open parts a thickness, and remove what is inside or folded"
            )

    @property
    def best_first(self) -> list[PolygonMesh]:
        """Results at the body's own position and size, the best first."""
        order = sorted(self.results, key=lambda one: (*one.faults[:2], one.cost))
        return [replace(one.quads, vertices=one.quads.vertices / self._scale + self._middle) for one in order]

    @property
    def best_quads(self) -> PolygonMesh:
        """The best result so far, at the body's own position and size."""
        return self.best_first[0]

    def _with_area_fault(self, judged: SoundQuads) -> SoundQuads:
        """Return a result with one fault more if it has too little area: thin parts, such as ears, are lost."""
        if not self._clean or target_surface(judged.quads).area >= MIN_AREA_SHARE * self._whole.area:
            return judged
        useless, missed, poor = judged.faults
        return replace(judged, faults=(useless, missed + 1, poor))

    def gap_warnings(self, count: int, first: int) -> list[Finding]:
        """Return a warning if the best quads miss parts of the surface; arguments: see ``warn_of_gaps``."""
        if not self._clean:
            return []
        best = replace(self.best_quads, vertices=(self.best_quads.vertices - self._middle) * self._scale)
        return warn_of_gaps(best, target_surface(best), self._whole, count, first)

    def _report_attempt(self, method: str) -> Progress:
        self._attempt_count += 1
        self._progress(1.0 - 0.75**self._attempt_count, f"Remeshing by {method}{self._name}")
        return self._progress.quiet()

    def _attempts(self) -> Iterator[SoundQuads | str]:
        """Yield the result of every attempt, or the reason if it fails; the quickest attempts come first."""
        yield from self._quads_by_halves()
        useful = _any_useful(self.results)
        if useful and 1.0 / MAX_COUNT_RATIO < len(self.results[0].quads.sizes) / self._count < MAX_COUNT_RATIO:
            return
        maps = max(1, min(MAX_MAPS, round(MAX_MAPPED_QUADS / self._count)))
        for surface in _surfaces_for_tool(self._small, self._whole, self._count, self._tool, self._progress.quiet()):
            of_voxels = surface.sizes[0] == 4
            yield self._quads_by_tool(surface, QUADRIFLOW_ATTEMPTS[0])
            mapped: list[SoundQuads] = []
            for row in CURVATURE_ATTEMPTS:
                for how in row if len(target_surface(surface).sharp_edges) or row[0][0] == NO_FOLDS else ():
                    if not maps or (of_voxels and _any_useful(self.results)):
                        break
                    maps -= 1
                    judged = _quads_along_curvature(
                        surface, self._whole, self._count, how, self._report_attempt("curvature")
                    )
                    yield judged
                    if isinstance(judged, str):
                        break
                    mapped.append(judged)
                if _any_useful(mapped):
                    break
            for again in QUADRIFLOW_ATTEMPTS[1 : MAX_VOXEL_ATTEMPTS if of_voxels else len(QUADRIFLOW_ATTEMPTS)]:
                if self._is_good_enough():
                    break
                yield self._quads_by_tool(surface, again)
            if any(not one.faults[1] for one in self.results):
                return
        if self._clean and not is_closed(self._small):
            yield from _quads_by_cells(self._small, self._whole, self._count, self._tool, self._report_attempt("cells"))

    def _quads_by_halves(self) -> Iterator[SoundQuads]:
        """Yield sound symmetric quads, a half and its mirror image; yield nothing on failure, as other attempts follow."""
        if not self._planes or not self._clean or self._count < 2 * MIN_QUADS:
            return
        first, *others = self._planes
        side = cut_at_plane(self._small, first)
        if side is None or not is_clean(side):
            return
        search = _BodySearch(side, round(self._count / 2), self._tool, self._name, others)
        try:
            search.run(self._report_attempt("halves"), True)
        except FlexMapsError:
            return
        edge = (self._whole.area / self._count) ** 0.5
        ends = side.vertices[np.abs(first.signed_distances(side.vertices)) < SINGLE_TOL]
        ends = ends[self._whole.distances_to_border(ends) < SINGLE_TOL]
        for quads in search.best_first:
            made = mirror_and_join(quads, first, edge, ends)
            if is_clean(made) and euler_characteristic(made) == euler_characteristic(self._small):
                judged = rate_quads(made, self._whole, self._count)
                if isinstance(judged, SoundQuads):
                    yield judged
                return

    def _is_good_enough(self) -> bool:
        """Return whether a result has no faults, or there were enough attempts and results, one without useless quads."""
        sound = [one for one in self.results if not one.faults[0]]
        if _any_useful(self.results) and not min(one.faults[2] for one in sound):
            return True
        enough = len(self.results) >= min(MIN_RESULTS, MIN_ATTEMPTS)
        return self._attempt_count >= MIN_ATTEMPTS and bool(sound) and enough

    def _quads_by_tool(self, surface: PolygonMesh, how: tuple[int, float, int, bool]) -> SoundQuads | str:
        """Return the tool's quads for ``how``, a row of ``QUADRIFLOW_ATTEMPTS``, repaired and rated, or the reason of the failure."""
        seed, factor, times, sharp = how
        asked = max(MIN_QUADS, round(factor * self._count / 4**times))
        raw = self._tool.quads(surface, asked, seed, sharp, self._report_attempt("QuadriFlow"))
        if raw is None or not len(raw.sizes):
            return "QuadriFlow finds none"
        return repair_and_rate(raw, self._whole, self._count, times, sharp)


@dataclass(frozen=True, eq=False)
class _MirroredSearch:
    """Body that is the mirror image of another body, whose quads it reflects; has the methods of ``_BodySearch``."""

    source: _BodySearch | _MirroredSearch
    plane: MirrorPlane

    @property
    def results(self) -> list[SoundQuads]:
        return self.source.results

    @property
    def best_quads(self) -> PolygonMesh:
        return self.plane.mirror(self.source.best_quads)

    def run(self, progress: Progress, to_the_end: bool) -> None:
        """Do nothing: the other body's search does the work."""

    def gap_warnings(self, count: int, first: int) -> list[Finding]:
        return self.source.gap_warnings(count, first)


def _mirrored_searches(
    parts: list[PolygonMesh],
    before: list[int],
    searches: list[_BodySearch | _MirroredSearch],
    k: int,
    planes: Sequence[MirrorPlane],
) -> Iterator[_MirroredSearch]:
    """Yield every way in which body ``k`` is the mirror image of one of the bodies ``before``, with these ``searches``."""
    for other, search in zip(before, searches, strict=True):
        for plane in planes:
            if plane.maps_onto(parts[other], parts[k], EXTENT):
                yield _MirroredSearch(search, plane)


def _any_useful(found: list[SoundQuads]) -> bool:
    """Return whether any result has room for every spiral and misses no part of the surface."""
    return any(not any(one.faults[:2]) for one in found)


def _quads_along_curvature(
    surface: PolygonMesh, whole: TargetSurface, count: int, how: tuple[float, float, float], progress: Progress
) -> SoundQuads | str:
    """Return quads along the curvature, rated, or the reason of the failure; ``how`` is an attempt from ``CURVATURE_ATTEMPTS``."""
    triangles, (fold, alignment, smoothing) = target_surface(surface), how
    edge = (triangles.area / count) ** 0.5
    given = mesh_from_rows(triangles.vertices, triangles.triangles)
    try:
        raw = quadrangulate(given, edge, np.radians(fold), alignment, smoothing, progress)
    except FlexMapsError as error:
        return str(error)
    return repair_and_rate(raw, whole, count, 0, fold < NO_FOLDS)


def _surfaces_for_tool(
    body: PolygonMesh, target: TargetSurface, count: int, tool: RemeshTool, progress: Progress
) -> Iterator[PolygonMesh]:
    """Yield surfaces for QuadriFlow: the body itself if it is clean, then its voxel surfaces, the finest first."""
    if is_clean(body):
        yield _simplify(body, count)
    edge = (target.area / count) ** 0.5
    for factor in VOXEL_SIZES:
        skin = tool.voxels(body, factor * edge, progress)
        if skin is None or not len(skin.sizes):
            continue
        largest = _outer_skin(skin)
        if largest is not None and is_clean(largest):
            yield largest


def _simplify(body: PolygonMesh, count: int) -> PolygonMesh:
    """Return a clean body, simplified to ``TRIANGLES_PER_QUAD`` triangles per quad if it has more."""
    triangles = target_surface(body)
    if len(triangles.triangles) <= TRIANGLES_PER_QUAD * count:
        return body
    fewer = mesh_from_rows(
        *simplify_triangles(triangles.vertices, triangles.triangles, round(TRIANGLES_PER_QUAD * count))
    )
    return fewer if is_clean(fewer) else body


def _outer_skin(skin: PolygonMesh) -> PolygonMesh | None:
    """Return the largest outer skin of a voxel surface; None if its share of all skins' area is below the minimum."""
    if not (skin.sizes == 4).all():
        return None
    rows, body = skin.corners.reshape(-1, 4), bodies(sides_of(skin), len(skin.sizes))
    p = skin.vertices[rows]
    across = 0.5 * np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
    volume = np.bincount(body, np.einsum("fi,fi->f", p.mean(axis=1), across))
    area = np.bincount(body, np.linalg.norm(across, axis=1)) * (volume > 0)
    if not area.any() or area.max() < MIN_SKIN_SHARE * area.sum():
        return None
    return mesh_from_rows(skin.vertices, rows[body == area.argmax()])


def _quads_by_cells(
    body: PolygonMesh, whole: TargetSurface, count: int, tool: RemeshTool, progress: Progress
) -> Iterator[SoundQuads]:
    """Yield sound quads of an open body with large flat faces, such as a letter; QuadriFlow often tears such bodies."""
    for factor in CELL_SIZES:
        polygons = tool.cells(body, factor * (whole.area / count) ** 0.5, progress)
        if polygons is None or not len(polygons.sizes) or len(polygons.corners) > MAX_CELL_RATIO * count:
            continue
        judged = repair_and_rate(split_into_quads(polygons), whole, count)
        if isinstance(judged, SoundQuads):
            yield judged
