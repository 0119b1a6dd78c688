"""Quads along a smooth cross field that follows the curvature, by a seamless map (Bommes et al. 2009)."""

from __future__ import annotations

import numpy as np

from ...arrays import Float, Int
from ...errors import FlexMapsError
from ...progress import SILENT, Progress
from ...threads import one_thread
from ..mesh import PolygonMesh
from .even import even_out, smooth_surface
from .extraction import extract_quads
from .field import ALIGNMENT, Triangles, cross_field
from .rounding import round_unknowns
from .seamless import Maps, cut_to_disk, lattice
from .separation import NOTHING, TOO_MANY_FOLDS, apart

# Longest edge of the map's triangles, in quads; 0.4 gives the same quads on 16 meshes in two to three times the time.
FINE = 0.55
# Quad sizes, as shares of the wanted size, tried until the map does not fold.
SCALES = (1.0, 0.94)
ATTEMPTS = (
    # attempts over sizes, with and without separation of nearby points; with 2, a map that folds takes twice the time
    2
)
MAPPING = "Mapping the surface onto a grid"
# Smoothing of the surface before the field is computed; over amo_quad, homer and a scanned bunny 10 leaves 16, 70 and
# 139 irregular points of 32, 103 and 160.
SMOOTHING = 10.0
STIFFER = 12  # rounds in which folded triangles are made stiffer
IDLE = 3  # rounds without fewer folds after which it stops
SHORTEST = 3.0  # in quads: shorter folds are noise; a scanned bunny has hundreds
# Largest number of integers of a map; the time to find the best ones grows with the cube, 2 s of processor time for
# 1,000.
WHOLE = 1000
SPREAD, FADING = 4, 0.7  # rings of triangles round a folded one that are stiffened too, and the factor per ring


@one_thread  # with more threads sums, and so the integers of the map, differ from run to run
def quadrangulate(
    mesh: PolygonMesh,
    edge: float,
    fold: float = np.pi,
    alignment: float = ALIGNMENT,
    smoothing: float = SMOOTHING,
    progress: Progress = SILENT,
) -> PolygonMesh:
    """Make quads on a clean connected triangle surface, along its borders and curvature.

    Parameters
    ----------
    mesh : triangles, metres
    edge : wanted quad edge, metres
    fold : quads have sides along edges where the surface turns by more, radians
    alignment : with the curvature, see ``cross_field``
    smoothing : of the surface before the field is computed, see ``smooth_surface``
    progress : called with the fraction done

    Raises
    ------
    FlexMapsError : no map without folds is found, or the surface is not an oriented manifold
    """
    given = Triangles(mesh.vertices, mesh.corners.reshape(-1, 3))
    try:
        return _quads_by_map(even_out(given, FINE * edge, fold), edge, fold, alignment, smoothing, progress)
    except (ArithmeticError, RuntimeError, np.linalg.LinAlgError) as error:  # errors of the solvers
        raise FlexMapsError("Some triangles are too thin for a map: dissolve them") from error


def _quads_by_map(
    triangles: Triangles, edge: float, fold: float, alignment: float, smoothing: float, progress: Progress
) -> PolygonMesh:
    """Return the quads of the first size that gives a map without folds."""
    lines = triangles.long_lines(fold, SHORTEST * edge)
    progress(0.1, "Looking for the directions of quads")
    smooth = smooth_surface(triangles, lines, smoothing)
    chart = cut_to_disk(cross_field(smooth, lines, alignment))
    progress(0.3, "Opening the surface")
    maps = Maps(chart, lattice(chart, lines))
    if maps.lattice.whole.shape[1] > WHOLE:
        raise FlexMapsError(TOO_MANY_FOLDS)
    last, pairs = FlexMapsError("No map was found"), apart(maps, edge, progress.part(0.3, 0.4))
    ways = [(scale, asked) for scale in SCALES for asked in (pairs, NOTHING)[not len(pairs.least) :]]
    for number, (scale, asked) in enumerate(ways[:ATTEMPTS]):
        part = progress.part(0.4 + 0.6 * number / ATTEMPTS, 0.4 + 0.6 * (number + 1) / ATTEMPTS)
        part(0.0, MAPPING)
        whole = round_unknowns(*maps.energy(scale * edge), asked)
        if not asked.hold(whole):  # too many points are too near each other, and another size seldom helps
            continue
        try:
            return extract_quads(triangles, chart.jump, _unfold(maps, scale * edge, whole, part))
        except FlexMapsError as error:
            last = error
    raise last


def folded_triangles(uv: Float[np.ndarray, "triangles 3 2"]) -> np.ndarray:
    """Mask the triangles that the map turns over."""
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] <= 0


def _unfold(
    maps: Maps, edge: float, whole: Int[np.ndarray, " whole"], progress: Progress
) -> Float[np.ndarray, "triangles 3 2"]:
    """Compute the map, making folded triangles and their neighbours stiffer in rounds; return the map with the fewest folds.

    See Bommes et al. 2009, section 4.3.
    """
    mesh = maps.chart.field.mesh
    inner = np.flatnonzero(mesh.opposite >= 0)
    here, there = inner // 3, mesh.opposite[inner] // 3
    weights = np.ones(len(mesh.corners))
    best, fewest, last = np.zeros(0), len(weights) + 1, 0
    for k in range(STIFFER):
        progress(k / STIFFER, MAPPING)
        uv = maps.map(edge, whole)
        turned = folded_triangles(uv)
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
