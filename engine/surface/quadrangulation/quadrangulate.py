"""Quad meshing along a smooth cross field that follows the curvature, by a seamless map (Bommes et al. 2009)."""

from __future__ import annotations

import numpy as np

from ...arrays import Float, Int
from ...errors import FlexMapsError
from ...progress import SILENT, Progress
from ...threads import one_thread
from ..mesh import PolygonMesh
from .even import equalise_triangles, smooth_surface
from .extraction import extract_quads
from .field import ALIGNMENT, Triangles, cross_field
from .rounding import round_unknowns
from .seamless import SeamlessMaps, cut_to_disk, parametrise_maps
from .separation import NO_CONSTRAINTS, TOO_MANY_FOLDS, separation_constraints

FINE = 0.55  # longest edge of the mapped triangles, in quad edges; smaller: slower, with almost the same quads
# Quad sizes, as shares of the wanted size, that are tried in turn until the map does not fold.
SCALES = (1.0, 0.94)
# Largest number of attempts. Each size is tried first with constraints that keep nearby points apart, then without.
# Larger: slower, fewer failures.
ATTEMPTS = 2
MAPPING = "Mapping the surface onto a grid"
# Strength of the smoothing before the cross field is computed, see ``smooth_surface``. Larger: fewer irregular
# vertices, less alignment with small features.
SMOOTHING = 10.0
STIFFER = 12  # largest number of rounds in which folded triangles are made stiffer; larger: fewer folds, slower
IDLE = 3  # the rounds end after this number of rounds without fewer folds; larger: fewer folds, slower
# Length of a fold of the surface, in quad edges, below which quads ignore it as noise. Larger: fewer sharp edges are
# followed.
SHORTEST = 3.0
# Largest number of integer unknowns of the map; surfaces that need more are refused. Larger: surfaces with more folds and
# irregular points pass, but the time for rounding grows with the cube of the number (1,000 take 2 s).
WHOLE = 1000
# Number of rings of triangles round a folded triangle that are stiffened too, and factor on the stiffening per ring.
# Larger: fewer rounds, but the map is distorted farther from the fold.
SPREAD, FADING = 4, 0.7


@one_thread  # with more threads, rounding errors of sums, and so the integers of the map, differ from run to run
def quadrangulate(
    mesh: PolygonMesh,
    edge: float,
    fold: float = np.pi,
    alignment: float = ALIGNMENT,
    smoothing: float = SMOOTHING,
    progress: Progress = SILENT,
) -> PolygonMesh:
    """Make quads on a connected, oriented, manifold triangle surface, along its borders and curvature.

    Parameters
    ----------
    mesh : triangles, metres
    edge : wanted edge length of the quads, metres
    fold : quads have sides along edges where the normals differ by more than this, radians
    alignment : weight of the alignment with the curvature, see ``cross_field``
    smoothing : strength of the smoothing before the cross field is computed, see ``smooth_surface``
    progress : called with the fraction done

    Raises
    ------
    FlexMapsError : no map without folds is found, or the surface is not an oriented manifold
    """
    given = Triangles(mesh.vertices, mesh.corners.reshape(-1, 3))
    try:
        return _quads_by_map(equalise_triangles(given, FINE * edge, fold), edge, fold, alignment, smoothing, progress)
    except (ArithmeticError, RuntimeError, np.linalg.LinAlgError) as error:  # errors of the solvers
        raise FlexMapsError("Some triangles are too thin for a map: dissolve them") from error


def _quads_by_map(
    triangles: Triangles, edge: float, fold: float, alignment: float, smoothing: float, progress: Progress
) -> PolygonMesh:
    """Return quads of the first size in ``SCALES`` for which quads can be extracted from the map.

    See ``quadrangulate`` for the arguments; ``triangles`` are already of about one size.
    """
    lines = triangles.long_feature_sides(fold, SHORTEST * edge)
    progress(0.1, "Looking for the directions of quads")
    smooth = smooth_surface(triangles, lines, smoothing)
    chart = cut_to_disk(cross_field(smooth, lines, alignment))
    progress(0.3, "Opening the surface")
    maps = SeamlessMaps(chart, parametrise_maps(chart, lines))
    if maps.parametrisation.integer_factors.shape[1] > WHOLE:
        raise FlexMapsError(TOO_MANY_FOLDS)
    last, pairs = FlexMapsError("No map was found"), separation_constraints(maps, edge, progress.part(0.3, 0.4))
    ways = [(scale, asked) for scale in SCALES for asked in (pairs, NO_CONSTRAINTS)[not len(pairs.lower_bounds) :]]
    for number, (scale, asked) in enumerate(ways[:ATTEMPTS]):
        part = progress.part(0.4 + 0.6 * number / ATTEMPTS, 0.4 + 0.6 * (number + 1) / ATTEMPTS)
        part(0.0, MAPPING)
        whole = round_unknowns(*maps.energy(scale * edge), asked)
        if not asked.are_satisfied(whole):  # too many points are too near each other, and another size seldom helps
            continue
        try:
            return extract_quads(triangles, chart.period_jumps, _map_with_few_folds(maps, scale * edge, whole, part))
        except FlexMapsError as error:
            last = error
    raise last


def folded_triangles(uv: Float[np.ndarray, "triangles 3 2"]) -> np.ndarray:
    """Return a mask of the triangles that a map with coordinates ``uv`` flips or collapses."""
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] <= 0


def _map_with_few_folds(
    maps: SeamlessMaps, edge: float, whole: Int[np.ndarray, " whole"], progress: Progress
) -> Float[np.ndarray, "triangles 3 2"]:
    """Compute a map with few folds, by stiffening folded triangles and their neighbours in rounds.

    See Bommes et al. 2009, section 4.3.

    Parameters
    ----------
    maps : all seamless maps of the surface
    edge : quad edge, metres
    whole : values of the map's integer unknowns
    progress : called with the fraction done

    Returns
    -------
    coordinates of the map with the fewest folded triangles, in quads
    """
    mesh = maps.chart.field.mesh
    inner = np.flatnonzero(mesh.opposite >= 0)
    here, there = inner // 3, mesh.opposite[inner] // 3
    weights = np.ones(len(mesh.corners))
    best, fewest, last = np.zeros(0), len(weights) + 1, 0
    for k in range(STIFFER):
        progress(k / STIFFER, MAPPING)
        uv = maps.uv_coordinates(edge, whole)
        turned = folded_triangles(uv)
        if turned.sum() < fewest:
            best, fewest, last = uv, int(turned.sum()), k
        if not turned.any() or k - last >= IDLE:
            break
        near = turned.astype(float)
        for _ in range(SPREAD):
            np.maximum.at(near, there, FADING * near[here])
        weights *= 1.0 + near
        maps.set_weights(weights)
    maps.set_weights(np.ones(len(weights)))
    return best
