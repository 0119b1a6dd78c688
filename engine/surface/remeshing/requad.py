"""Quads in the shape of any mesh: every body by itself, by a tool that makes quads of one clean body at a time.

The tool is Blender's (``bridge.hosts.remesh``): QuadriFlow, and a voxel remesh for closed bodies that are not clean. What it
gives is judged and mended here. QuadriFlow works in single precision and refuses or spoils surfaces that are very small
or large, so that it gets every body at one size.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import Cancelled, FlexMapsError
from ...params import RemeshParams
from ...progress import SILENT, Progress
from ..checking.check import Finding
from ..checking.topology import bodies, sides_of
from ..mesh import PolygonMesh
from ..quadrangulation.even import simplified
from ..quadrangulation.quadrangulate import quadrangulate
from ..welding import welded
from .bodies import is_clean, is_closed, joined, parts_of, target_of, without_crumbs
from .coverage import uncovered
from .halves import Plane, doubled, euler, half, own_planes, planes_of
from .mend import SHARP, Target, of_rows
from .refine import split
from .soundness import Judged, judge, judge_raw, squarer
from .tool import Tool

EXTENT = 2.0  # largest extent of what the tool gets; QuadriFlow took every one of 16 surfaces at this size, at 0.16 only some
JOINED = 1e-6  # of the extent: corners nearer than this are one
CRUMBS = (
    RemeshParams.crumbs
)  # share of the area in bodies too small for the count that is left out unless a setting says otherwise
FIRST, REST = (0.05, 0.3), (0.3, 1.0)  # shares of the progress until there are quads of every body, and for better ones
# Quads: a body that would get fewer is left out. Closed ones of 6 ended 4 to 20 % of their size from their shape with strains of up to
# three times the limit, of 12 at 1.5 to 5 % (but for a flat box), of 24 at .3 to 3.7 %: seven bodies, from balls to thin boxes
FEWEST, FEWEST_CLOSED = 6, 12
# what is tried of a body, one after another: QuadriFlow's seed, the share of the wanted count, how often its quads are cut
# into four, and whether it is to keep sharp edges
TRIES = (
    (0, 1.0, 0, False), (0, 1.0, 1, False), (1, 1.0, 1, False), (2, 1.1, 1, False), (0, 1.0, 1, True), (0, 1.0, 0, True),
    (0, 1.0, 2, False), (1, 1.1, 2, True), (1, 1.0, 0, False), (2, 1.1, 0, False), (3, 0.9, 0, False), (4, 1.25, 0, False),
    (5, 0.8, 0, False), (6, 1.6, 0, False),
)  # fmt: skip
# of them are tried where no quads along the curvature are useful, and the best taken: over 25 meshes of 1000 quads, eight of them gave
# 10 % fewer irregular vertices than one, in three times the time
CANDIDATES = 4
FLAT = 180.0  # degrees: no fold is as sharp
# degrees from which a fold is followed, how much the quads follow the curvature, and how much the surface is smoothed before:
# what is tried row by row until one gives quads; a row is gone along while its tries do. Of 14 meshes with 500 quads a pull of 64 was
# the best on one, by 6 %; a weaker one than 4 gave quads nowhere where 4 had none, but for surfaces smoothed more
OWN: tuple[tuple[tuple[float, float, float], ...], ...] = (
    ((SHARP, 4.0, 10.0), (SHARP, 16.0, 10.0)),
    ((FLAT, 4.0, 10.0), (FLAT, 16.0, 10.0)),
    ((FLAT, 0.5, 30.0),),
)
MAPS = 3  # of these are tried of a body at most: of one that is remeshed from voxels, all the sizes of them together
# quads in all of these maps: more take longer than a person waits, some 3 s of the processor for 500 and where a map folds, twice that
MAPPED = 3000
# triangles for each quad: a body of more is thinned before quads are laid on it. Maps are made on about so many, and
# QuadriFlow takes time in proportion to them: 4 s of the processor for a scan of 69,000
DENSE = 20.0
OF_VOXELS = 3  # how many of them a skin of voxels is worth
# voxel sizes in quad edges: fine ones keep detail, coarse ones close what hinders QuadriFlow
VOXELS = (0.35, 0.5, 0.72, 1.0)
ONE_SKIN = 0.95  # share of the voxels' outer skins that the largest must have: nothing but crumbs is lost
ENOUGH = 3  # sound results of which the best is taken, where none is without poor quads
# sizes in quad edges of the polygons that are cut into quads where QuadriFlow finds none; each becomes four or more. Of 5
# letters at 200 to 700 quads that came apart with QuadriFlow, these sizes made 4 whole
CELLS = (2.0, 2.4, 1.6)
MANY = 3  # times the wanted count: so many quads are the small faces of the body itself
# times the wanted count, or that share of it: symmetric quads are taken at once where they are as many. Over 11 surfaces at 200 and 500
# quads they came to .69 to 1.2, but for a cone that had to be cut finer, at 2.2 and with 24 times the irregular vertices
MIRRORED = 1.5
COVERED = 0.8  # times the surface's area: less leaves parts out, which is taken only where nothing else is found


@dataclass(frozen=True, eq=False)
class Requadded:
    """The quads, and what is to be said of them: parts that were left out or joined."""

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
    """About ``count`` quads in the shape of any mesh; each body gets its share by area.

    Closed bodies that cut each other become one, and so does what is closed but no clean surface. Open parts are cut apart
    where three faces meet. Bodies too small for the count are left out. Raises ``FlexMapsError`` where no sound quads are found for
    a body, and where those that are left out are more than ``crumbs`` of the area.

    symmetric : give a surface that is its own image in planes at right angles quads that are so too
    """
    progress(0.0, "Looking for bodies")
    if not len(mesh.sizes) or not np.isfinite(mesh.vertices[mesh.corners]).all():
        raise FlexMapsError("The mesh has no faces, or corners without a place; give it some, or delete those")
    mesh = welded(mesh).in_order()
    low, high = mesh.vertices[mesh.corners].min(axis=0), mesh.vertices[mesh.corners].max(axis=0)
    scale = EXTENT / max(float((high - low).max()), 1e-300)
    triangles = tool.triangles(replace(mesh, vertices=(mesh.vertices - low) * scale), JOINED * EXTENT, progress.quiet())
    if triangles is None or not len(triangles.sizes):
        raise FlexMapsError("The faces of the mesh have no area; give it some that have")
    parts, found = parts_of(triangles, tool, progress)
    areas = np.array([target_of(part).area for part in parts])
    share = count * areas / areas.sum()
    fewest = np.where([is_closed(part) for part in parts], FEWEST_CLOSED, FEWEST)
    large, left_out = without_crumbs(areas, count, fewest, crumbs)
    found += left_out
    kept = np.flatnonzero(large)
    planes = planes_of(joined([parts[k] for k in kept])) if symmetric else []
    searches: list[_Search | _Image] = []
    for done, k in enumerate(kept):
        image = next(_images(parts, kept[:done].tolist(), searches, k, planes), None)
        name = f" of body {done + 1} of {len(kept)}" if len(kept) > 1 else ""
        wanted = max(int(fewest[k]), round(share[k] * count / share[large].sum()))
        searches.append(image or _Search(parts[k], wanted, tool, name, own_planes(parts[k], planes, EXTENT)))

    def together() -> PolygonMesh:
        quads = joined([search.best for search in searches])
        return replace(quads, vertices=quads.vertices / scale + low)

    try:
        for to_the_end, (begin, end) in ((False, FIRST), (True, REST)):
            for done, search in enumerate(searches):
                piece = progress.part(begin, end).part(done / len(searches), (done + 1) / len(searches))
                search.go_on(piece, to_the_end)
            if not to_the_end:
                progress.show(together())
    except Cancelled:  # the best so far is kept, where there is one
        if not all(search.found for search in searches):
            raise
    progress.tell(1.0, "Quads are ready")
    first = np.cumsum([0, *(len(search.best.sizes) for search in searches)]).tolist()
    made = zip(searches, first, strict=False)
    missed = [one for search, begin in made for one in search.uncovered(first[-1], begin)]
    return Requadded(squarer(together()), found + missed)


# -- one body ------------------------------------------------------------------------------------------------------------


class _Search:
    """The quads of one body: what has been found so far, and the way to more.

    count : of the quads that are wanted; name : of the body, for what is told
    planes : in which the body is its own image
    found : sound quads
    """

    def __init__(self, body: PolygonMesh, count: int, tool: Tool, name: str, planes: Sequence[Plane] = ()):
        low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
        self._middle, self._scale = 0.5 * (low + high), EXTENT / max(float((high - low).max()), 1e-300)
        self._small = replace(body, vertices=(body.vertices - self._middle) * self._scale)
        self._whole, self._count, self._tool, self._name = target_of(self._small), count, tool, name
        self._clean = is_clean(self._small)
        self._planes = [replace(plane, point=(plane.point - self._middle) * self._scale) for plane in planes]
        self.found: list[Judged] = []
        self._last, self._tried, self._progress = "", 0, SILENT
        self._way = self._tries()

    def go_on(self, progress: Progress, to_the_end: bool) -> None:
        """Look for quads until there are some, or until no more are worth a try. Raises ``FlexMapsError`` where there are none."""
        self._progress, self._tried = progress, 0
        while to_the_end or not self.found:
            found = next(self._way, None)
            if found is None:
                break
            if isinstance(found, Judged):
                self.found.append(self._with_losses(found))
            else:
                self._last = self._last or found
        if not self.found:
            reason = self._last or "it is no clean surface, neither by itself nor as voxels"
            raise FlexMapsError(
                f"No sound quads were found{self._name}: {reason}. "
                "Give another quad count; give open parts a thickness, and remove what is inside or folded"
            )

    @property
    def ranked(self) -> list[PolygonMesh]:
        """What was found, where the body was, the best first."""
        order = sorted(self.found, key=lambda one: (*one.faults[:2], one.cost))
        return [replace(one.quads, vertices=one.quads.vertices / self._scale + self._middle) for one in order]

    @property
    def best(self) -> PolygonMesh:
        """The best quads so far, where the body was."""
        return self.ranked[0]

    def _with_losses(self, judged: Judged) -> Judged:
        """The quads, with one more missed edge where they have less area than a clean body.

        So few quads that ears or fingers fall between them are all that some counts allow; they are taken where there are no others.
        A body that cuts itself has lost what was inside.
        """
        if not self._clean or target_of(judged.quads).area >= COVERED * self._whole.area:
            return judged
        useless, missed, poor = judged.faults
        return replace(judged, faults=(useless, missed + 1, poor))

    def uncovered(self, count: int, first: int) -> list[Finding]:
        """The warning where the best quads miss the surface; ``first`` is the number of the first of them, ``count`` of all bodies."""
        if not self._clean:
            return []
        best = replace(self.best, vertices=(self.best.vertices - self._middle) * self._scale)
        return uncovered(best, target_of(best), self._whole, count, first)

    def _tell(self, text: str) -> Progress:
        self._tried += 1
        self._progress(1.0 - 0.75**self._tried, f"{text}{self._name}")
        return self._progress.quiet()

    def _tries(self) -> Iterator[Judged | str]:
        """What is tried, one after another: the quickest first, so that there is something soon."""
        yield from self._by_halves()
        if _useful(self.found) and 1.0 / MIRRORED < len(self.found[0].quads.sizes) / self._count < MIRRORED:
            return
        maps = max(1, min(MAPS, round(MAPPED / self._count)))
        for surface in _surfaces(self._small, self._whole, self._count, self._tool, self._progress.quiet()):
            of_voxels = surface.sizes[0] == 4
            yield self._by_tool(surface, TRIES[0])
            mapped: list[Judged] = []
            for row in OWN:
                for how in row if len(target_of(surface).sharp) or row[0][0] == FLAT else ():
                    if not maps or (of_voxels and _useful(self.found)):
                        break
                    maps -= 1
                    judged = _own(surface, self._whole, self._count, how, self._tell("Quads along the curvature"))
                    yield judged
                    if isinstance(judged, str):
                        break
                    mapped.append(judged)
                if _useful(mapped):
                    break
            for again in TRIES[1 : OF_VOXELS if of_voxels else len(TRIES)]:
                if self._enough():
                    break
                yield self._by_tool(surface, again)
            if any(not one.faults[1] for one in self.found):
                return
        if self._clean and not is_closed(self._small):
            yield from _by_cells(self._small, self._whole, self._count, self._tool, self._tell("Cells"))

    def _by_halves(self) -> Iterator[Judged]:
        """Yield the quads of one side of a plane with their images, if they are sound; no reason is told, as the whole body is tried next."""
        if not self._planes or not self._clean or self._count < 2 * FEWEST:
            return
        first, *others = self._planes
        side = half(self._small, first)
        if side is None or not is_clean(side):
            return
        search = _Search(side, round(self._count / 2), self._tool, self._name, others)
        try:
            search.go_on(self._tell("One half"), True)
        except FlexMapsError:
            return
        edge = (self._whole.area / self._count) ** 0.5
        ends = side.vertices[np.abs(first.heights(side.vertices)) < JOINED]
        ends = ends[self._whole.to_border(ends) < JOINED]
        for quads in search.ranked:
            made = doubled(quads, first, edge, ends)
            if is_clean(made) and euler(made) == euler(self._small):
                judged = judge(made, self._whole, self._count)
                if isinstance(judged, Judged):
                    yield judged
                return

    def _enough(self) -> bool:
        """Whether there are good quads, or as many tries as are worth it."""
        sound = [one for one in self.found if not one.faults[0]]
        if _useful(self.found) and not min(one.faults[2] for one in sound):
            return True
        return self._tried >= CANDIDATES and bool(sound) and len(self.found) >= min(ENOUGH, CANDIDATES)

    def _by_tool(self, surface: PolygonMesh, how: tuple[int, float, int, bool]) -> Judged | str:
        """Quads of the tool as ``TRIES`` says, or why there are none."""
        seed, factor, times, sharp = how
        asked = max(FEWEST, round(factor * self._count / 4**times))
        raw = self._tool.quads(surface, asked, seed, sharp, self._tell("QuadriFlow"))
        if raw is None or not len(raw.sizes):
            return "QuadriFlow finds none"
        return judge_raw(raw, self._whole, self._count, times, sharp)


@dataclass(frozen=True, eq=False)
class _Image:
    """The quads of a body that is the image of another one in a plane."""

    of: _Search | _Image
    plane: Plane

    @property
    def found(self) -> list[Judged]:
        return self.of.found

    @property
    def best(self) -> PolygonMesh:
        return self.plane.mirrored(self.of.best)

    def go_on(self, progress: Progress, to_the_end: bool) -> None:
        """The other search does the work."""

    def uncovered(self, count: int, first: int) -> list[Finding]:
        return self.of.uncovered(count, first)


def _images(
    parts: list[PolygonMesh], before: list[int], searches: list[_Search | _Image], k: int, planes: Sequence[Plane]
) -> Iterator[_Image]:
    """The body ``k`` as the image of one of those ``before`` it."""
    for other, search in zip(before, searches, strict=True):
        for plane in planes:
            if plane.maps(parts[other], parts[k], EXTENT):
                yield _Image(search, plane)


def _useful(found: list[Judged]) -> bool:
    """Whether any has room for every spiral and misses nothing of the surface."""
    return any(not any(one.faults[:2]) for one in found)


def _own(
    surface: PolygonMesh, whole: Target, count: int, how: tuple[float, float, float], progress: Progress
) -> Judged | str:
    """Quads along the curvature, judged, or why there are none; ``how`` as in ``OWN``."""
    triangles, (fold, alignment, smoothing) = target_of(surface), how
    edge = (triangles.area / count) ** 0.5
    given = of_rows(triangles.vertices, triangles.triangles)
    try:
        raw = quadrangulate(given, edge, np.radians(fold), alignment, smoothing, progress)
    except FlexMapsError as error:
        return str(error)
    return judge_raw(raw, whole, count, 0, fold < FLAT)


def _surfaces(body: PolygonMesh, target: Target, count: int, tool: Tool, progress: Progress) -> Iterator[PolygonMesh]:
    """What QuadriFlow is to work on: the body itself if it is clean, then its skins of voxels, the finest first."""
    if is_clean(body):
        yield _thinned(body, count)
    edge = (target.area / count) ** 0.5
    for factor in VOXELS:
        skin = tool.voxels(body, factor * edge, progress)
        if skin is None or not len(skin.sizes):
            continue
        largest = _outer(skin)
        if largest is not None and is_clean(largest):
            yield largest


def _thinned(body: PolygonMesh, count: int) -> PolygonMesh:
    """A clean body of no more triangles than its quads need."""
    triangles = target_of(body)
    if len(triangles.triangles) <= DENSE * count:
        return body
    fewer = of_rows(*simplified(triangles.vertices, triangles.triangles, round(DENSE * count)))
    return fewer if is_clean(fewer) else body


def _outer(skin: PolygonMesh) -> PolygonMesh | None:
    """The one outer skin of a voxel remesh, without those round cavities; ``None`` where there are several."""
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


def _by_cells(body: PolygonMesh, whole: Target, count: int, tool: Tool, progress: Progress) -> Iterator[Judged]:
    """Sound quads of an open body of large flat faces, as a letter, on which QuadriFlow often comes apart or loses sharp corners."""
    for factor in CELLS:
        polygons = tool.cells(body, factor * (whole.area / count) ** 0.5, progress)
        if polygons is None or not len(polygons.sizes) or len(polygons.corners) > MANY * count:
            continue
        judged = judge_raw(split(polygons), whole, count)
        if isinstance(judged, Judged):
            yield judged
