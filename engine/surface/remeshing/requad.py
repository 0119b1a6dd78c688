"""Quad remeshing of any mesh: each body by itself, with a tool that remeshes one clean body at a time.

The tool is Blender's (``bridge.hosts.remesh``): QuadriFlow, and a voxel remesh for closed bodies that are not clean.
Its results are judged and repaired here. QuadriFlow works in single precision and fails on very small or large
surfaces, so every body is scaled to the same size first.

Closed bodies that intersect become one; closed bodies that are not clean are rebuilt from voxels; open parts are cut
apart at edges of three faces; bodies too small for the count are left out.
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
from ..quadrangulation.even import simplify
from ..quadrangulation.quadrangulate import quadrangulate
from ..welding import weld
from .bodies import concatenate_meshes, is_clean, is_closed, parts_of, target_of, triangles_of, without_crumbs
from .coverage import warn_of_gaps
from .halves import Plane, euler, half, mirror_and_join, own_planes, planes_of
from .mend import SHARP, TargetSurface, of_rows
from .refine import split
from .soundness import SoundQuads, judge, judge_raw, squarer
from .tool import Tool

EXTENT = 2.0  # extent of bodies given to the tool; QuadriFlow took all of 16 surfaces at this size, only some at 0.16
CRUMBS = RemeshParams.crumbs  # default share of the area, in bodies too small for the count, that may be left out
FIRST, REST = (0.05, 0.3), (0.3, 1.0)  # ranges of the progress: first quads of every body, better ones
# Smallest number of quads of open and closed bodies; smaller bodies are left out. Seven closed bodies ended 4 to 20 %
# of their size from their shape with 6 quads and strains of up to three times the limit, 1.5 to 5 % (but for a flat
# box) with 12, 0.3 to 3.7 % with 24.
FEWEST, FEWEST_CLOSED = 6, 12
# Attempts with QuadriFlow, in order: seed, share of the wanted count, subdivisions, whether sharp edges are kept.
TRIES = (
    (0, 1.0, 0, False), (0, 1.0, 1, False), (1, 1.0, 1, False), (2, 1.1, 1, False), (0, 1.0, 1, True), (0, 1.0, 0, True),
    (0, 1.0, 2, False), (1, 1.1, 2, True), (1, 1.0, 0, False), (2, 1.1, 0, False), (3, 0.9, 0, False), (4, 1.25, 0, False),
    (5, 0.8, 0, False), (6, 1.6, 0, False),
)  # fmt: skip
# Attempts evaluated if no quads along the curvature are usable; the best is kept. Over 25 meshes of 1000 quads, eight
# attempts gave 10 % fewer irregular vertices than one, in three times the time.
CANDIDATES = 4
FLAT = 180.0  # degrees; an angle that no fold exceeds
# Attempts along the curvature: smallest angle of folds to follow, degrees; alignment; smoothing. Rows are tried until
# one gives quads; a row ends at its first failure. On 14 meshes an alignment of 64 was best once, by 6 %; one below 4
# gave quads where 4 did not only on surfaces smoothed more.
OWN: tuple[tuple[tuple[float, float, float], ...], ...] = (
    ((SHARP, 4.0, 10.0), (SHARP, 16.0, 10.0)),
    ((FLAT, 4.0, 10.0), (FLAT, 16.0, 10.0)),
    ((FLAT, 0.5, 30.0),),
)
MAPS = 3  # largest number of these attempts per body; a body remeshed from voxels shares it among all voxel sizes
# Largest number of quads in all maps of a body together; 500 take some 3 s of processor time, twice that with folds.
MAPPED = 3000
# Triangles per quad to which denser bodies are simplified; QuadriFlow takes 4 s for a scan of 69,000.
DENSE = 20.0
OF_VOXELS = 3  # attempts with QuadriFlow on a voxel surface, the first included
VOXELS = (0.35, 0.5, 0.72, 1.0)  # voxel sizes in quad edges: fine ones keep detail, coarse ones close gaps
ONE_SKIN = 0.95  # smallest share of the voxel surface in its largest outer skin; the rest is only crumbs
ENOUGH = 3  # sound results from which the best is taken if all have poor quads
# Polygon sizes, in quad edges, tried if QuadriFlow finds no quads; each polygon is split into four or more. With 5
# letters at 200 to 700 quads that QuadriFlow tore apart, these sizes kept 4 whole.
CELLS = (2.0, 2.4, 1.6)
MANY = 3  # factor on the wanted count: more quads mean that the body itself consists of small faces
# Largest ratio, either way, of count and wanted count at which symmetric quads are accepted at once. Over 11 surfaces
# it was 0.69 to 1.2, but 2.2 for a cone that had to be split finer, with 24 times the irregular vertices.
MIRRORED = 1.5
COVERED = 0.8  # smallest share of the surface's area; quads with less are taken only if there are no others


@dataclass(frozen=True, eq=False)
class Requadded:
    """Quads, and warnings on parts of the mesh that were left out, joined or missed."""

    polygons: PolygonMesh
    findings: list[Finding]


def requad(
    mesh: PolygonMesh,
    count: int,
    tool: Tool,
    progress: Progress = SILENT,
    crumbs: float = CRUMBS,
    symmetric: bool = False,
) -> Requadded:
    """Make about ``count`` quads in the shape of any mesh; bodies share them by area.

    Parameters
    ----------
    mesh, count, tool : any faces; number of quads wanted; maker of quads of a clean body
    crumbs, symmetric : share of the area that may be left out; whether mirror planes give symmetric quads

    Raises
    ------
    FlexMapsError : a body gets no sound quads, or more than ``crumbs`` would be left out
    """
    progress(0.0, "Looking for bodies")
    if not len(mesh.sizes) or not np.isfinite(mesh.vertices[mesh.corners]).all():
        raise FlexMapsError("The mesh has no faces, or vertices that are not finite: add faces, or delete these")
    mesh = weld(mesh).in_order()
    low = mesh.vertices[mesh.corners].min(axis=0)
    scale = EXTENT / max(float(np.ptp(mesh.vertices[mesh.corners], axis=0).max()), 1e-300)
    sized = replace(mesh, vertices=(mesh.vertices - low) * scale)
    parts, found = parts_of(triangles_of(sized, SINGLE_TOL * EXTENT, tool, progress), tool, progress)
    areas = np.array([target_of(part).area for part in parts])
    share = count * areas / areas.sum()
    fewest = np.where([is_closed(part) for part in parts], FEWEST_CLOSED, FEWEST)
    large, left_out = without_crumbs(areas, count, fewest, crumbs)
    kept = np.flatnonzero(large)
    planes = planes_of(concatenate_meshes([parts[k] for k in kept])) if symmetric else []
    searches: list[_BodySearch | _MirroredSearch] = []
    for done, k in enumerate(kept):
        image = next(_images(parts, kept[:done].tolist(), searches, k, planes), None)
        name = f" of body {done + 1} of {len(kept)}" if len(kept) > 1 else ""
        wanted = max(int(fewest[k]), round(share[k] * count / share[large].sum()))
        searches.append(image or _BodySearch(parts[k], wanted, tool, name, own_planes(parts[k], planes, EXTENT)))

    def together() -> PolygonMesh:
        quads = concatenate_meshes([search.best for search in searches])
        return replace(quads, vertices=quads.vertices / scale + low)

    try:
        for to_the_end, (begin, end) in ((False, FIRST), (True, REST)):
            for done, search in enumerate(searches):
                piece = progress.part(begin, end).part(done / len(searches), (done + 1) / len(searches))
                search.go_on(piece, to_the_end)
            if not to_the_end:
                progress.show(together())
    except Cancelled:  # keep the best so far if every body has quads
        if not all(search.found for search in searches):
            raise
    progress.tell(1.0, "Quads are ready")
    first = np.cumsum([0, *(len(search.best.sizes) for search in searches)]).tolist()
    missed = [one for search, begin in zip(searches, first, strict=False) for one in search.uncovered(first[-1], begin)]
    return Requadded(squarer(together()), found + left_out + missed)


# -- one body ------------------------------------------------------------------------------------------------------------


class _BodySearch:
    """Search for ``count`` quads of one body, called ``name`` in messages.

    planes : mirror planes of the body; found : sound results so far
    """

    def __init__(self, body: PolygonMesh, count: int, tool: Tool, name: str, planes: Sequence[Plane] = ()):
        low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
        self._middle, self._scale = 0.5 * (low + high), EXTENT / max(float((high - low).max()), 1e-300)
        self._small = replace(body, vertices=(body.vertices - self._middle) * self._scale)
        self._whole, self._count, self._tool, self._name = target_of(self._small), count, tool, name
        self._clean = is_clean(self._small)
        self._planes = [replace(plane, point=(plane.point - self._middle) * self._scale) for plane in planes]
        self.found: list[SoundQuads] = []
        self._last, self._tried, self._progress = "", 0, SILENT
        self._way = self._tries()

    def go_on(self, progress: Progress, to_the_end: bool) -> None:
        """Search until there is a result, or with ``to_the_end`` until no attempt is left; raise FlexMapsError without a result."""
        self._progress, self._tried = progress, 0
        while to_the_end or not self.found:
            found = next(self._way, None)
            if found is None:
                break
            if isinstance(found, SoundQuads):
                self.found.append(self._with_losses(found))
            else:
                self._last = self._last or found
        if not self.found:
            reason = self._last or "it is not a clean surface, neither by itself nor as voxels"
            raise FlexMapsError(
                f"No sound quads were found{self._name}: {reason}. "
                "Give another quad count; give open parts a thickness, and remove what is inside or folded"
            )

    @property
    def ranked(self) -> list[PolygonMesh]:
        """Results at the body's own place and size, the best first."""
        order = sorted(self.found, key=lambda one: (*one.faults[:2], one.cost))
        return [replace(one.quads, vertices=one.quads.vertices / self._scale + self._middle) for one in order]

    @property
    def best(self) -> PolygonMesh:
        """The best result so far, at the body's own place and size."""
        return self.ranked[0]

    def _with_losses(self, judged: SoundQuads) -> SoundQuads:
        """Count one more missed edge if ears or fingers fell between the quads, so that a clean body loses area."""
        if not self._clean or target_of(judged.quads).area >= COVERED * self._whole.area:
            return judged
        useless, missed, poor = judged.faults
        return replace(judged, faults=(useless, missed + 1, poor))

    def uncovered(self, count: int, first: int) -> list[Finding]:
        """Warn if the best quads miss the surface; ``count`` counts the quads of all bodies, ``first`` the index of
        this body's first quad.
        """
        if not self._clean:
            return []
        best = replace(self.best, vertices=(self.best.vertices - self._middle) * self._scale)
        return warn_of_gaps(best, target_of(best), self._whole, count, first)

    def _tell(self, text: str) -> Progress:
        self._tried += 1
        self._progress(1.0 - 0.75**self._tried, f"{text}{self._name}")
        return self._progress.quiet()

    def _tries(self) -> Iterator[SoundQuads | str]:
        """Yield the result of one attempt after another, the quickest first, so that there is a result soon."""
        yield from self._by_halves()
        if _any_useful(self.found) and 1.0 / MIRRORED < len(self.found[0].quads.sizes) / self._count < MIRRORED:
            return
        maps = max(1, min(MAPS, round(MAPPED / self._count)))
        for surface in _surfaces(self._small, self._whole, self._count, self._tool, self._progress.quiet()):
            of_voxels = surface.sizes[0] == 4
            yield self._by_tool(surface, TRIES[0])
            mapped: list[SoundQuads] = []
            for row in OWN:
                for how in row if len(target_of(surface).sharp) or row[0][0] == FLAT else ():
                    if not maps or (of_voxels and _any_useful(self.found)):
                        break
                    maps -= 1
                    judged = _along_curvature(
                        surface, self._whole, self._count, how, self._tell("Quads along the curvature")
                    )
                    yield judged
                    if isinstance(judged, str):
                        break
                    mapped.append(judged)
                if _any_useful(mapped):
                    break
            for again in TRIES[1 : OF_VOXELS if of_voxels else len(TRIES)]:
                if self._enough():
                    break
                yield self._by_tool(surface, again)
            if any(not one.faults[1] for one in self.found):
                return
        if self._clean and not is_closed(self._small):
            yield from _by_cells(self._small, self._whole, self._count, self._tool, self._tell("Cells"))

    def _by_halves(self) -> Iterator[SoundQuads]:
        """Yield sound quads of one side of a mirror plane, with their images; failures are silent, as the whole body comes next."""
        if not self._planes or not self._clean or self._count < 2 * FEWEST:
            return
        first, *others = self._planes
        side = half(self._small, first)
        if side is None or not is_clean(side):
            return
        search = _BodySearch(side, round(self._count / 2), self._tool, self._name, others)
        try:
            search.go_on(self._tell("One half"), True)
        except FlexMapsError:
            return
        edge = (self._whole.area / self._count) ** 0.5
        ends = side.vertices[np.abs(first.heights(side.vertices)) < SINGLE_TOL]
        ends = ends[self._whole.to_border(ends) < SINGLE_TOL]
        for quads in search.ranked:
            made = mirror_and_join(quads, first, edge, ends)
            if is_clean(made) and euler(made) == euler(self._small):
                judged = judge(made, self._whole, self._count)
                if isinstance(judged, SoundQuads):
                    yield judged
                return

    def _enough(self) -> bool:
        """Return whether a result is good, or there were enough attempts."""
        sound = [one for one in self.found if not one.faults[0]]
        if _any_useful(self.found) and not min(one.faults[2] for one in sound):
            return True
        return self._tried >= CANDIDATES and bool(sound) and len(self.found) >= min(ENOUGH, CANDIDATES)

    def _by_tool(self, surface: PolygonMesh, how: tuple[int, float, int, bool]) -> SoundQuads | str:
        """Return the tool's quads for a row of ``TRIES``, judged, or the reason of the failure."""
        seed, factor, times, sharp = how
        asked = max(FEWEST, round(factor * self._count / 4**times))
        raw = self._tool.quads(surface, asked, seed, sharp, self._tell("QuadriFlow"))
        if raw is None or not len(raw.sizes):
            return "QuadriFlow finds none"
        return judge_raw(raw, self._whole, self._count, times, sharp)


@dataclass(frozen=True, eq=False)
class _MirroredSearch:
    """A body that is the mirror image of another body, whose quads are reflected; same methods as ``_BodySearch``."""

    of: _BodySearch | _MirroredSearch
    plane: Plane

    @property
    def found(self) -> list[SoundQuads]:
        return self.of.found

    @property
    def best(self) -> PolygonMesh:
        return self.plane.mirror(self.of.best)

    def go_on(self, progress: Progress, to_the_end: bool) -> None:
        """Do nothing: the other body's search does the work."""

    def uncovered(self, count: int, first: int) -> list[Finding]:
        return self.of.uncovered(count, first)


def _images(
    parts: list[PolygonMesh],
    before: list[int],
    searches: list[_BodySearch | _MirroredSearch],
    k: int,
    planes: Sequence[Plane],
) -> Iterator[_MirroredSearch]:
    """Yield body ``k`` as the image of one of the bodies ``before`` it."""
    for other, search in zip(before, searches, strict=True):
        for plane in planes:
            if plane.maps(parts[other], parts[k], EXTENT):
                yield _MirroredSearch(search, plane)


def _any_useful(found: list[SoundQuads]) -> bool:
    """Return whether a result has room for every spiral and misses no part of the surface."""
    return any(not any(one.faults[:2]) for one in found)


def _along_curvature(
    surface: PolygonMesh, whole: TargetSurface, count: int, how: tuple[float, float, float], progress: Progress
) -> SoundQuads | str:
    """Return quads along the curvature, judged, or the reason of the failure; ``how`` is an entry of ``OWN``."""
    triangles, (fold, alignment, smoothing) = target_of(surface), how
    edge = (triangles.area / count) ** 0.5
    given = of_rows(triangles.vertices, triangles.triangles)
    try:
        raw = quadrangulate(given, edge, np.radians(fold), alignment, smoothing, progress)
    except FlexMapsError as error:
        return str(error)
    return judge_raw(raw, whole, count, 0, fold < FLAT)


def _surfaces(
    body: PolygonMesh, target: TargetSurface, count: int, tool: Tool, progress: Progress
) -> Iterator[PolygonMesh]:
    """Yield surfaces for QuadriFlow: the body itself if it is clean, then its voxel surfaces, the finest first."""
    if is_clean(body):
        yield _simplify(body, count)
    edge = (target.area / count) ** 0.5
    for factor in VOXELS:
        skin = tool.voxels(body, factor * edge, progress)
        if skin is None or not len(skin.sizes):
            continue
        largest = _outer_skin(skin)
        if largest is not None and is_clean(largest):
            yield largest


def _simplify(body: PolygonMesh, count: int) -> PolygonMesh:
    """Simplify a clean body to as many triangles as its quads need."""
    triangles = target_of(body)
    if len(triangles.triangles) <= DENSE * count:
        return body
    fewer = of_rows(*simplify(triangles.vertices, triangles.triangles, round(DENSE * count)))
    return fewer if is_clean(fewer) else body


def _outer_skin(skin: PolygonMesh) -> PolygonMesh | None:
    """Return the outer skin of a voxel remesh without cavities; None if there are several of similar size."""
    if not (skin.sizes == 4).all():
        return None
    rows, body = skin.corners.reshape(-1, 4), bodies(sides_of(skin), len(skin.sizes))
    p = skin.vertices[rows]
    across = 0.5 * np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
    volume = np.bincount(body, np.einsum("fi,fi->f", p.mean(axis=1), across))
    area = np.bincount(body, np.linalg.norm(across, axis=1)) * (volume > 0)
    if not area.any() or area.max() < ONE_SKIN * area.sum():
        return None
    return of_rows(skin.vertices, rows[body == area.argmax()])


def _by_cells(
    body: PolygonMesh, whole: TargetSurface, count: int, tool: Tool, progress: Progress
) -> Iterator[SoundQuads]:
    """Yield sound quads of an open body of large flat faces, such as a letter, which QuadriFlow often tears or rounds off."""
    for factor in CELLS:
        polygons = tool.cells(body, factor * (whole.area / count) ** 0.5, progress)
        if polygons is None or not len(polygons.sizes) or len(polygons.corners) > MANY * count:
            continue
        judged = judge_raw(split(polygons), whole, count)
        if isinstance(judged, SoundQuads):
            yield judged
