"""Measure the distance of a scanned piece from its predicted shape (Malomo et al. 2018, section 8)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...arrays import Bool, Float
from ...errors import FlexMapsError
from ...progress import SILENT, Progress
from ...surface.mesh import QuadMesh
from .register import Registration, register
from .scan_reader import MAX_POINTS, MIN_POINTS, UNITS, Scan
from .scan_target import TriangleSurface

# largest distance from the piece of points that may belong to it, share of its size; larger: other objects count too
MAX_DISTANCE = 0.1
# smallest cosine of the angle between the normal and the direction to a point (32 degrees); at larger angles the point
# lies beside the piece's border
MIN_COSINE = 0.85
MEDIAN_POINTS = 15  # number of points whose median is a spiral's distance; larger: less scatter, less local
# smallest number of points over a spiral, as a share of the median number; if there are fewer, they are taken for
# outliers in a gap of the scan
MIN_DENSITY = 0.15
MIN_SPIRAL_POINTS = 3  # smallest number of points over a spiral; fewer may all be outliers
MIN_COVERAGE = 0.3  # smallest share of the spirals that a scan must cover; larger: more partial scans are rejected
# largest RMS distance between scan and piece, as a share of the piece's size; larger: scans of other objects pass (the
# seven tried had over 0.031)
MAX_RMS = 0.025
MIN_WEIGHT = 0.5  # points with a smaller weight count as a table or wall; larger: more points of the piece are lost
MAX_SIZE_RATIO = 10.0  # largest ratio of the sizes of scan and piece, either way, if the unit must be guessed


@dataclass(frozen=True, eq=False)
class Comparison:
    """A scan registered to a piece.

    turn, shift : rotation and shift, metres; ``scale * scan @ turn.T + shift`` is the registered scan
    scale : metres per unit of the scan
    points, used : registered points, metres, and whether each belongs to the piece
    distances : signed distance of the scan from the piece along the normal at every spiral, metres; NaN if the scan has
        too few points there
    size : the piece's diagonal, metres
    noise : standard deviation of the scan about the piece's shape, metres
    name : name of the scan
    simulated : True if the scan is compared with the simulated shape, False if with the target
    remarks : sentences for the reader of the report
    """

    turn: Float[np.ndarray, "3 3"]
    shift: Float[np.ndarray, " 3"]
    scale: float
    points: Float[np.ndarray, "points 3"]
    used: Bool[np.ndarray, " points"]
    distances: Float[np.ndarray, " quads"]
    size: float
    noise: float
    name: str = "scan"
    simulated: bool = False
    remarks: tuple[str, ...] = ()

    @property
    def is_covered(self) -> Bool[np.ndarray, " quads"]:
        """Whether the scan has enough points over each spiral."""
        return np.isfinite(self.distances)

    @property
    def rms(self) -> float:
        """Root mean square distance over the covered spirals, metres."""
        return float(np.sqrt(np.nanmean(self.distances**2)))

    @property
    def highest(self) -> float:
        """Largest absolute distance of a covered spiral, metres."""
        return float(np.nanmax(np.abs(self.distances)))

    @property
    def shown_mm(self) -> Float[np.ndarray, " quads"]:
        """Absolute distances in mm for maps and attributes; -1 for spirals that are not covered."""
        return np.where(self.is_covered, 1e3 * np.abs(np.nan_to_num(self.distances)), -1.0)

    def report(self) -> dict[str, Any]:
        """Return the ``scan`` block of report.json; percentages are of the piece's diagonal, as in the paper."""
        mean, of_size = float(np.nanmean(self.distances)), 100 / self.size
        return {
            "file": self.name,
            "against": "simulated shape" if self.simulated else "target",
            "rms_mm": round(1e3 * self.rms, 4),
            "rms_percent": round(of_size * self.rms, 4),
            "max_mm": round(1e3 * self.highest, 4),
            "max_percent": round(of_size * self.highest, 4),
            "mean_mm": round(1e3 * mean, 4),
            "covered": round(float(self.is_covered.mean()), 4),
            "points": len(self.points),
            "points_beside": round(1 - float(self.used.mean()), 4),
            "noise_mm": round(1e3 * self.noise, 4),
            "unit_m": self.scale,
            "remarks": list(self.remarks),
        }


def compare_scan(mesh: QuadMesh, scan: Scan, simulated: bool = False, progress: Progress = SILENT) -> Comparison:
    """Register a scan to the predicted shape without markers, and measure distances.

    Parameters
    ----------
    mesh : predicted shape, metres
    scan : the scan
    simulated : True if the shape was simulated, False if it is the target
    progress : called with the fraction done; may cancel

    Raises
    ------
    FlexMapsError : too few or invalid points, no suitable unit, or another object
    """
    points = scan.points
    if len(points) < MIN_POINTS:
        raise FlexMapsError(
            f"The scan has only {len(points)} points, and at least {MIN_POINTS} are needed; export the whole mesh or "
            "point cloud, not single markers"
        )
    if not np.isfinite(points).all():
        bad = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise FlexMapsError(f"Point {bad + 1} of the scan is not a finite number; export the scan again")
    used = mesh.vertices[np.unique(mesh.quads)]
    middle, size = (used.min(axis=0) + used.max(axis=0)) / 2, float(np.linalg.norm(np.ptp(used, axis=0)))
    kept = points[np.random.default_rng(0).permutation(len(points))[:MAX_POINTS]].astype(float)
    scale, remarks = _find_unit(kept, size, scan.unit)
    # centre the scan before scaling: coordinates from surveying may be kilometres, and digits would be lost
    centre = np.median(kept, axis=0)
    surface = TriangleSurface.from_mesh(mesh, middle, size)
    local = scale / size * (kept - centre)
    found = register(surface, local, scan.anywhere, progress)
    laid = local @ found.turn.T + found.shift
    distances, shown = _distances(mesh, surface, laid, found)
    if not simulated:
        remarks += ("Nothing was simulated: the scan is compared with the target.",)
    seen = float(np.isfinite(distances).mean())
    if seen < MIN_COVERAGE:
        raise FlexMapsError(
            f"The scan covers only {100 * seen:.0f} % of the piece's spirals; is it another object, or in another unit?"
        )
    rms = float(np.sqrt(np.nanmean(distances**2)))
    if rms > MAX_RMS:
        raise FlexMapsError(
            f"Even at its best fit the scan is {100 * rms:.1f} % of the size (RMS) away from the piece; is it another object, "
            "in another unit, or did the piece snap into another shape?"
        )
    return Comparison(
        turn=found.turn,
        shift=size * found.shift + middle - scale * found.turn @ centre,
        scale=scale,
        points=size * laid + middle,
        used=shown,
        distances=size * distances,
        size=size,
        noise=size * found.reach / 3,
        name=scan.name,
        simulated=simulated,
        remarks=remarks,
    )


def _find_unit(points: np.ndarray, size: float, unit: str) -> tuple[float, tuple[str, ...]]:
    """Return the metres per unit of the scan, and a remark if the unit was guessed.

    size : size of the piece, metres; unit : key of ``UNITS``, or "" to guess metres or millimetres
    """
    if unit:
        return UNITS[unit], ()
    low, high = np.quantile(points, (0.02, 0.98), axis=0)
    wide = float(np.linalg.norm(high - low))
    if not wide > 0:
        raise FlexMapsError("All points of the scan are at one place; export the whole scan again")
    name = min(("m", "mm"), key=lambda one: abs(np.log(UNITS[one] * wide / size)))
    times = UNITS[name] * wide / size
    if not 1 / MAX_SIZE_RATIO < times < MAX_SIZE_RATIO:
        raise FlexMapsError(
            f"The scan is {wide:.3g} units wide, the piece {1e3 * size:.0f} mm: neither metres nor millimetres; "
            f"give the scan's unit ({', '.join(UNITS)}), or is it another object?"
        )
    return UNITS[name], (f"The scan is taken to be in {'metres' if name == 'm' else 'millimetres'}.",)


def _distances(
    mesh: QuadMesh, surface: TriangleSurface, laid: np.ndarray, found: Registration
) -> tuple[np.ndarray, Bool[np.ndarray, " points"]]:
    """Return the signed distance of the scan at every spiral, a share of the size, and which points are of the piece.

    For every spiral those points are taken whose closest points on the piece are nearest to its centre, within half a
    quad edge. Their median distance is used, so that a few outliers do not matter.
    """
    from scipy.spatial import cKDTree

    _, triangle, foot = surface.closest(laid)
    away = laid - foot
    height = np.einsum("ij,ij->i", away, surface.normals[triangle])
    far = np.linalg.norm(away, axis=1)
    over = (far <= found.reach) | (np.abs(height) >= MIN_COSINE * far)
    shown = (far < MAX_DISTANCE) & over & (found.weights >= MIN_WEIGHT)
    centres = surface.vertices[surface.triangles].reshape(-1, 6, 3).mean(axis=1)
    if np.count_nonzero(shown) < MIN_SPIRAL_POINTS:
        return np.full(len(centres), np.nan), shown
    tree, size = cKDTree(foot[shown]), float(np.linalg.norm(np.ptp(mesh.vertices[np.unique(mesh.quads)], axis=0)))
    half = 0.5 * np.sqrt(mesh.areas) / size
    count = tree.query_ball_point(centres, half, return_length=True)
    usual = np.median(count[count >= MIN_SPIRAL_POINTS]) if (count >= MIN_SPIRAL_POINTS).any() else 0.0
    told = count >= max(MIN_SPIRAL_POINTS, MIN_DENSITY * usual)
    distance, near = tree.query(centres, min(MEDIAN_POINTS, np.count_nonzero(shown)))
    heights = np.append(height[shown], np.nan)[np.where(distance < half[:, None], near, -1)]
    middle = np.full(len(centres), np.nan)
    middle[told] = np.nanmedian(heights[told], axis=1)
    return middle, shown
