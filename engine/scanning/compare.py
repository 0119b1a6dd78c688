"""How far the built piece, scanned, lies from the shape that was predicted (Malomo et al. 2018, section 8)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..arrays import Bool, Float
from ..errors import FlexMapsError
from ..progress import SILENT, Progress
from ..surface.files.meshio import PARSERS
from ..surface.mesh import QuadMesh
from .register import register

MOST = 60_000  # points of the scan that are kept
FEWEST = 100  # points below which a scan shows no shape
SEEN = 0.05  # share of the size: spirals with no point of the scan within it are not covered
COVERED = 0.3  # share of the spirals that a scan of the same piece covers at least
PLANE = 8  # neighbours that tell the scan's surface between its points


@dataclass(frozen=True, eq=False)
class Comparison:
    """A scan over a piece.

    turn, shift : ``scale * scan @ turn.T + shift`` is the scan laid over the piece, metres
    points : the scan where it lies, metres; distances : of every spiral's centre from it, metres, NaN where it is not covered
    size : the piece's diagonal, metres; remark : what was guessed, or nothing
    """

    turn: Float[np.ndarray, "3 3"]
    shift: Float[np.ndarray, " 3"]
    scale: float
    points: Float[np.ndarray, "points 3"]
    distances: Float[np.ndarray, " quads"]
    size: float
    remark: str

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
        return float(np.nanmax(self.distances))


def read_points(path: str | Path) -> Float[np.ndarray, "points 3"]:
    """The vertices of a scan, a mesh or points alone, in the file's unit. Raises FlexMapsError where it cannot be read."""
    path = Path(path)
    if path.suffix.lower() not in PARSERS:
        raise FlexMapsError(f"{path} is no scan that can be read; save it as {', '.join(PARSERS)}")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FlexMapsError(f"{path} cannot be read ({error.strerror}); check the name of the scan") from None
    head = data[: data.find(b"end_header")]
    if (
        path.suffix.lower() == ".ply" and b"element face" not in head
    ):  # points alone: the reader of meshes asks for faces
        data = data.replace(b"end_header", b"element face 0\nproperty list uchar int vertex_indices\nend_header", 1)
    return PARSERS[path.suffix.lower()](data, path.name).vertices


def compare(
    mesh: QuadMesh,
    scan: Float[np.ndarray, "points 3"],
    scale: float | None = None,
    anywhere: bool = False,
    progress: Progress = SILENT,
) -> Comparison:
    """Lay a scan's points over the predicted shape and measure.

    scale : metres in the scan's unit; without, 1 or 0.001, whichever comes nearer the piece's size
    anywhere : whether the scan may lie in any pose, not only roughly as the piece does

    Raises FlexMapsError where the scan has too few points, one that is no number, or shows another object.
    """
    from scipy.spatial import cKDTree

    if len(scan) < FEWEST:
        raise FlexMapsError(f"The scan has {len(scan)} points; at least {FEWEST} are needed: export the scan itself")
    if not np.isfinite(scan).all():
        bad = int(np.flatnonzero(~np.isfinite(scan).all(axis=1))[0])
        raise FlexMapsError(f"Point {bad + 1} of the scan is not a finite number; export the scan again")
    size, remark = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0))), ""
    kept = scan[np.random.default_rng(0).permutation(len(scan))[:MOST]]
    if scale is None:
        wide = float(np.linalg.norm(np.ptp(np.quantile(kept, (0.02, 0.98), axis=0), axis=0)))
        scale = min((1.0, 0.001), key=lambda one: abs(np.log(max(one * wide, 1e-300) / size)))
        remark = f"The scan is taken to be in {'metres' if scale == 1.0 else 'millimetres'}."
    points, normals = _samples(mesh)
    turn, shift = register(points, normals, scale * kept, anywhere, progress)
    laid = scale * kept @ turn.T + shift
    tree = cKDTree(laid)
    distance, near = tree.query(mesh.centroids, PLANE)
    around = laid[near] - laid[near].mean(axis=1, keepdims=True)
    normal = np.linalg.svd(around, full_matrices=False)[2][:, 2]
    off = np.abs(np.einsum("ij,ij->i", normal, mesh.centroids - laid[near].mean(axis=1)))
    off[distance[:, 0] > SEEN * size] = np.nan
    seen = float(np.isfinite(off).mean())
    if seen < COVERED:
        raise FlexMapsError(
            f"The scan covers only {100 * seen:.0f} % of the piece's spirals; is it another object, or in another unit?"
        )
    return Comparison(turn, shift, scale, laid, off, size, remark)


def _samples(mesh: QuadMesh, count: int = 1500) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) points spread evenly over the quads by area, metres, and their unit normals."""
    random = np.random.default_rng(0)
    of = random.choice(len(mesh.quads), count, p=mesh.areas / mesh.areas.sum())
    u, v = random.random((2, count, 1))
    p = mesh.vertices[mesh.quads[of]]
    return (p[:, 0] * (1 - u) + p[:, 1] * u) * (1 - v) + (p[:, 3] * (1 - u) + p[:, 2] * u) * v, mesh.normals[of]
