"""Quads along a smooth field of crosses that follows the curvature, by a seamless map (Bommes et al. 2009)."""

from __future__ import annotations

import numpy as np

from ...arrays import Float, Int
from ...errors import FlexMapsError
from ...progress import SILENT, Progress
from ...threads import one_thread
from ..mesh import PolygonMesh
from .even import evened, smoothed
from .extraction import extracted
from .field import ALIGNMENT, Triangles, cross_field
from .rounding import rounded
from .seamless import Maps, lattice, opened
from .separation import NOTHING, TOO_MANY_FOLDS, apart

# quads: longest edge of the triangles on which the map is made; with 0.4 the same quads of 16 meshes take two to three times as long
FINE = 0.55
# sizes of the quads, as shares of the one asked for, that are tried until the map does not fold
SCALES = (1.0, 0.94)
ATTEMPTS = (
    2  # sizes, with and without what is kept apart: a map that folds then takes twice as long as one that does not
)
MAPPING = "Mapping the surface onto a grid"
# over amo_quad, homer and a scanned bunny 10 leaves 16, 70 and 139 irregular points of 32, 103 and 160
SMOOTHING = 10.0
STIFFER = 12  # rounds in which folded triangles are made stiffer
IDLE = 3  # of them that may pass without fewer folds
SHORTEST = 3.0  # quads: shorter folds are noise; a scanned bunny has hundreds
# whole numbers of a map: of more than so many, finding the best ones takes time with their cube, 2 s of the processor for 1,000
WHOLE = 1000
SPREAD, FADING = 4, 0.7  # so far around them, by so much less from triangle to triangle


@one_thread  # with more, sums differ from run to run, and with them whole numbers of the map
def quadrangulate(
    mesh: PolygonMesh,
    edge: float,
    fold: float = np.pi,
    alignment: float = ALIGNMENT,
    smoothing: float = SMOOTHING,
    progress: Progress = SILENT,
) -> PolygonMesh:
    """Quads of about this edge on a clean connected surface of triangles, along its borders and curvature.

    edge : metres
    fold : radians; along edges at which the surface turns by more, quads have sides too
    alignment : to the curvature, as in ``cross_field``
    smoothing : of the surface before directions are looked for, as in ``smoothed``

    Raises FlexMapsError where no map without folds is found, or where the surface is no oriented manifold.
    """
    given = Triangles(mesh.vertices, mesh.corners.reshape(-1, 3))
    try:
        return _mapped(evened(given, FINE * edge, fold), edge, fold, alignment, smoothing, progress)
    except (ArithmeticError, RuntimeError, np.linalg.LinAlgError) as error:  # of the solvers
        raise FlexMapsError("Some triangles are too thin for a map: dissolve them") from error


def _mapped(
    triangles: Triangles, edge: float, fold: float, alignment: float, smoothing: float, progress: Progress
) -> PolygonMesh:
    """Quads of the first size that gives a map without folds."""
    lines = triangles.long_lines(fold, SHORTEST * edge)
    progress(0.1, "Looking for the directions of quads")
    smooth = smoothed(triangles, lines, smoothing)
    chart = opened(cross_field(smooth, lines, alignment))
    progress(0.3, "Opening the surface")
    maps = Maps(chart, lattice(chart, lines))
    if maps.lattice.whole.shape[1] > WHOLE:
        raise FlexMapsError(TOO_MANY_FOLDS)
    last, pairs = FlexMapsError("No map was found"), apart(maps, edge, progress.part(0.3, 0.4))
    ways = [(scale, asked) for scale in SCALES for asked in (pairs, NOTHING)[not len(pairs.least) :]]
    for number, (scale, asked) in enumerate(ways[:ATTEMPTS]):
        part = progress.part(0.4 + 0.6 * number / ATTEMPTS, 0.4 + 0.6 * (number + 1) / ATTEMPTS)
        part(0.0, MAPPING)
        whole = rounded(*maps.energy(scale * edge), asked)
        if not asked.hold(whole):  # too much lies too near, and another size seldom helps
            continue
        try:
            return extracted(triangles, chart.jump, _unfolded(maps, scale * edge, whole, part))
        except FlexMapsError as error:
            last = error
    raise last


def folded(uv: Float[np.ndarray, "triangles 3 2"]) -> np.ndarray:
    """Which triangles the map turns over."""
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] <= 0


def _unfolded(
    maps: Maps, edge: float, whole: Int[np.ndarray, " whole"], progress: Progress
) -> Float[np.ndarray, "triangles 3 2"]:
    """The map, with folded triangles and their neighbours stiffer round after round; that with the fewest folds
    (Bommes et al. 2009, section 4.3)."""
    mesh = maps.chart.field.mesh
    inner = np.flatnonzero(mesh.opposite >= 0)
    here, there = inner // 3, mesh.opposite[inner] // 3
    weights = np.ones(len(mesh.corners))
    best, fewest, last = np.zeros(0), len(weights) + 1, 0
    for k in range(STIFFER):
        progress(k / STIFFER, MAPPING)
        uv = maps.map(edge, whole)
        turned = folded(uv)
        if turned.sum() < fewest:
            best, fewest, last = uv, int(turned.sum()), k
        if not turned.any() or k - last >= IDLE:
            break
        near = turned.astype(float)
        for _ in range(SPREAD):
            np.maximum.at(near, there, FADING * near[here])
        weights *= 1.0 + near
        maps.weigh(weights)
    maps.weigh(np.ones(len(weights)))
    return best
