"""How far the built piece, scanned, lies from the shape that was predicted (Malomo et al. 2018, section 8)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Bool, Float
from ..errors import FlexMapsError
from ..progress import SILENT, Progress
from ..surface.mesh import QuadMesh
from .reading import FEWEST, MOST, UNITS, Scan
from .register import Registration, register
from .surface import Surface

SEEN = (
    0.1  # share of the size within which a point of the scan is taken for the piece: the paper's largest error is 0.041
)
SIDE = 0.85  # cosine: a point further than 32 degrees from a quad's normal lies beyond a border, not over the quad
MEDIAN = 15  # points whose median tells where a spiral is: scatters a third as much as one point, and stays local
SPARSE = 0.15  # share of the usual number of points over a spiral: fewer are outliers where the scan shows nothing
LEAST = 3  # points over a spiral that tell where it is; fewer may all be outliers
COVERED = 0.3  # share of the spirals that a scan of the same piece covers at least
# share of the size: 17 pieces bent by up to 4 % end at 0.85 % RMS at most, scans of 7 other objects at 3.1 % at least
ALIEN = 0.025
CLUTTER = 0.5  # weight of a table's points below which they tell nothing of the piece
ALIKE = 10.0  # times the scan may be larger or smaller than the piece where its unit is guessed: metres for millimetres is 1000


@dataclass(frozen=True, eq=False)
class Comparison:
    """A scan over a piece.

    turn, shift : ``scale * scan @ turn.T + shift`` is the scan laid over the piece, metres
    points : the scan where it lies, metres; used : which of them show the piece
    distances : metres from every spiral's centre to the scan along its normal, NaN where the scan does not show it
    size : the piece's diagonal, metres; noise : standard deviation of the scan about the piece's shape, metres
    name : of the scan; simulated : whether it is laid over the simulated shape, else over the target
    remarks : what a reader has to know besides
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
    def covered(self) -> Bool[np.ndarray, " quads"]:
        """The spirals that the scan shows."""
        return np.isfinite(self.distances)

    @property
    def rms(self) -> float:
        """Root mean square distance of the covered spirals, metres."""
        return float(np.sqrt(np.nanmean(self.distances**2)))

    @property
    def highest(self) -> float:
        """The largest distance of a covered spiral, metres."""
        return float(np.nanmax(np.abs(self.distances)))

    @property
    def shown_mm(self) -> Float[np.ndarray, " quads"]:
        """Millimetres from every spiral's centre to the scan, -1 where the scan does not show it: for maps and attributes."""
        return np.where(self.covered, 1e3 * np.abs(np.nan_to_num(self.distances)), -1.0)

    def report(self) -> dict[str, Any]:
        """The block "scan" of report.json; percentages are of the piece's diagonal, as the paper's."""
        mean, of_size = float(np.nanmean(self.distances)), 100 / self.size
        return {
            "file": self.name,
            "against": "simulated shape" if self.simulated else "target",
            "rms_mm": round(1e3 * self.rms, 4),
            "rms_percent": round(of_size * self.rms, 4),
            "max_mm": round(1e3 * self.highest, 4),
            "max_percent": round(of_size * self.highest, 4),
            "mean_mm": round(1e3 * mean, 4),
            "covered": round(float(self.covered.mean()), 4),
            "points": len(self.points),
            "points_beside": round(1 - float(self.used.mean()), 4),
            "noise_mm": round(1e3 * self.noise, 4),
            "unit_m": self.scale,
            "remarks": list(self.remarks),
        }


def compare(mesh: QuadMesh, scan: Scan, simulated: bool = False, progress: Progress = SILENT) -> Comparison:
    """Lay a scan over the predicted shape, without markers, and measure.

    Raises FlexMapsError where the scan has too few points, one that is no number, no unit that fits, or shows another object.
    """
    points = scan.points
    if len(points) < FEWEST:
        raise FlexMapsError(f"The scan has {len(points)} points; at least {FEWEST} are needed: export the scan itself")
    if not np.isfinite(points).all():
        bad = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise FlexMapsError(f"Point {bad + 1} of the scan is not a finite number; export the scan again")
    used = mesh.vertices[np.unique(mesh.quads)]
    middle, size = (used.min(axis=0) + used.max(axis=0)) / 2, float(np.linalg.norm(np.ptp(used, axis=0)))
    kept = points[np.random.default_rng(0).permutation(len(points))[:MOST]].astype(float)
    scale, remarks = _scale(kept, size, scan.unit)
    centre = np.median(kept, axis=0)  # a scan in a surveyor's frame may lie kilometres off, where digits are lost
    surface = Surface.of(mesh, middle, size)
    local = scale / size * (kept - centre)
    found = register(surface, local, scan.anywhere, progress)
    laid = local @ found.turn.T + found.shift
    distances, shown = _distances(mesh, surface, laid, found)
    if not simulated:
        remarks += ("Nothing was simulated: the scan is compared with the target.",)
    seen = float(np.isfinite(distances).mean())
    if seen < COVERED:
        raise FlexMapsError(
            f"The scan covers only {100 * seen:.0f} % of the piece's spirals; is it another object, or in another unit?"
        )
    rms = float(np.sqrt(np.nanmean(distances**2)))
    if rms > ALIEN:
        raise FlexMapsError(
            f"The scan lies RMS {100 * rms:.1f} % of the size from the piece where it comes nearest; is it another object, "
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


def _scale(points: np.ndarray, size: float, unit: str) -> tuple[float, tuple[str, ...]]:
    """Metres in the scan's unit, and what was guessed."""
    if unit:
        return UNITS[unit], ()
    low, high = np.quantile(points, (0.02, 0.98), axis=0)
    wide = float(np.linalg.norm(high - low))
    if not wide > 0:
        raise FlexMapsError("All points of the scan are the same; export the scan itself")
    name = min(("m", "mm"), key=lambda one: abs(np.log(UNITS[one] * wide / size)))
    times = UNITS[name] * wide / size
    if not 1 / ALIKE < times < ALIKE:
        raise FlexMapsError(
            f"The scan is {wide:.3g} units wide, the piece {1e3 * size:.0f} mm: neither metres nor millimetres; "
            f"give the scan's unit ({', '.join(UNITS)}), or is it another object?"
        )
    return UNITS[name], (f"The scan is taken to be in {'metres' if name == 'm' else 'millimetres'}.",)


def _distances(
    mesh: QuadMesh, surface: Surface, laid: np.ndarray, found: Registration
) -> tuple[np.ndarray, Bool[np.ndarray, " points"]]:
    """Of every spiral the distance to the scan, shares of the size, and which points show the piece.

    It is the median over the points whose closest points on the piece lie nearest to the spiral's centre, within half an edge of
    its quad, so that a few outliers have no say.
    """
    from scipy.spatial import cKDTree

    triangle, foot = surface.closest(laid)
    away = laid - foot
    height = np.einsum("ij,ij->i", away, surface.normals[triangle])
    far = np.linalg.norm(away, axis=1)
    over = (far <= found.reach) | (np.abs(height) >= SIDE * far)
    shown = (far < SEEN) & over & (found.weights >= CLUTTER)
    centres = surface.vertices[surface.triangles].reshape(-1, 6, 3).mean(axis=1)
    if np.count_nonzero(shown) < LEAST:
        return np.full(len(centres), np.nan), shown
    tree, size = cKDTree(foot[shown]), float(np.linalg.norm(np.ptp(mesh.vertices[np.unique(mesh.quads)], axis=0)))
    half = 0.5 * np.sqrt(mesh.areas) / size
    count = tree.query_ball_point(centres, half, return_length=True)
    usual = np.median(count[count >= LEAST]) if (count >= LEAST).any() else 0.0
    told = count >= max(LEAST, SPARSE * usual)
    distance, near = tree.query(centres, min(MEDIAN, np.count_nonzero(shown)))
    heights = np.append(height[shown], np.nan)[np.where(distance < half[:, None], near, -1)]
    middle = np.full(len(centres), np.nan)
    middle[told] = np.nanmedian(heights[told], axis=1)
    return middle, shown
