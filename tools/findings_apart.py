"""Independent check of a piece's findings, computed with numpy, scipy and Blender's own trees only.

Nothing here is imported from the package, and the limits are stated a second time, so that a change in only one place is noticed.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from mathutils.bvhtree import BVHTree
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

RMS, MATCH = 1.0, 0.02  # percent of the size from the target; share by which two ways to measure it may differ
STRAIN = 1.0  # times what the material bears
QUAD, PANEL = 10.0, 6  # millimetres of the side of a quad; quads of a panel
FOLD = 45.0  # degrees between the normals of neighbours
MISSED = 1.5  # edges that a point of the source may be away from the quads
# what is measured -> keys of the findings that tell it
TOLD = {
    "rms": {"equilibrium/far-from-target", "equilibrium/match", "equilibrium/stays-flat"},
    "strain": {"equilibrium/strained"},
    "quad": {"checks/small-quads"},
    "panel": {"layout/remarks"},
    "folds": {"checks/sharp-folds"},
    "crossings": {"checks/cuts-itself", "checks/bodies-cross"},
    "missed": {"checks/surface-missed", "checks/bodies-left-out", "checks/bodies-joined"},
}


def measure_piece(obj: bpy.types.Object, source: bpy.types.Object | None) -> dict[str, float]:
    """Figures of a piece that *Next* has led to its sheets; ``source``: what its quads were made of."""
    mesh = obj.data
    points, quads = _of(mesh.vertices, "co", 3), _of(mesh.polygons, "vertices", 4, np.int64)
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    one, two = points[quads[:, 2]] - points[quads[:, 0]], points[quads[:, 3]] - points[quads[:, 1]]
    across = np.cross(one, two)
    area = 0.5 * np.linalg.norm(across, axis=1)
    metres = obj.matrix_world.median_scale
    figures = {"quad": 1e3 * metres * float(np.sqrt(area.min())), **_between(mesh, quads, across)}
    tree = BVHTree.FromPolygons(points.tolist(), quads.tolist(), epsilon=0.0)
    figures["crossings"] = sum(not set(quads[a]) & set(quads[b]) for a, b in tree.overlap(tree) if a < b)
    if source is not None and source is not obj:
        edge = float(np.sqrt(np.median(area)))
        scale = size / float(np.linalg.norm(np.ptp(_evaluated(source), axis=0)))
        figures["missed"] = max(tree.find_nearest(point)[3] for point in (scale * _evaluated(source)).tolist()) / edge
    if "flexmaps_hub" in mesh.attributes:  # the middles of the spirals
        hubs = _of(mesh.attributes["flexmaps_hub"].data, "vector", 3)
        figures["rms"] = 100.0 * _apart(hubs, points[quads].mean(axis=1)) / size
    return figures


def unreported_faults(obj: bpy.types.Object, source: bpy.types.Object | None, told: dict[str, Any]) -> list[str]:
    """Return sentences on faults that the findings of a piece omit or contradict; ``told``: result of ``api.press``."""
    figures, keys = measure_piece(obj, source), {finding["key"] for finding in told["findings"]}
    figures["strain"] = told["figures"]["strain_share"] or 0.0
    bad = {
        "rms": figures.get("rms", 0.0) > RMS * (1.0 + MATCH),
        "strain": figures["strain"] > STRAIN,
        "quad": figures["quad"] < QUAD * (1.0 - 1e-3),
        "panel": figures["panel"] < min(PANEL, figures["body"]),
        "folds": figures["folds"] > 0,
        "crossings": figures["crossings"] > 0,
        "missed": figures.get("missed", 0.0) > MISSED,
    }
    said = [
        f"{name} {figures[name]:.3g} is in no finding"
        for name, is_bad in bad.items()
        if is_bad and not TOLD[name] & keys
    ]
    rms = told["figures"]["rms_percent"]
    if rms is not None and "rms" in figures and abs(figures["rms"] - rms) > MATCH * max(rms, figures["rms"], 0.1):
        said.append(f"RMS is {figures['rms']:.3g} %, not {rms:.3g}")
    return said


def _of(rows: Any, name: str, width: int, kind: type = np.float64) -> np.ndarray:
    values: np.ndarray = np.empty(len(rows) * width, kind)
    rows.foreach_get(name, values)
    return values.reshape(-1, width)


def _evaluated(obj: bpy.types.Object) -> np.ndarray:
    """Points of an object with its modifiers, in its own space."""
    made = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    points = _of(made.to_mesh().vertices, "co", 3)
    made.to_mesh_clear()
    return points


def _between(mesh: bpy.types.Mesh, quads: np.ndarray, across: np.ndarray) -> dict[str, float]:
    """Folds between quads, and how many quads the smallest panel and the smallest body have."""
    edges = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    _, same = np.unique(edges, axis=0, return_inverse=True)
    order = np.argsort(same.ravel(), kind="stable")
    pairs = order[np.flatnonzero(np.diff(same.ravel()[order]) == 0)[:, None] + [0, 1]] // 4
    normals = across / np.linalg.norm(across, axis=1, keepdims=True)
    turned = np.degrees(np.arccos(np.clip((normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(axis=1), -1.0, 1.0)))
    patch = np.zeros(len(quads), np.int32)
    if "flexmaps_patch" in mesh.attributes:
        mesh.attributes["flexmaps_patch"].data.foreach_get("value", patch)
    joined = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(quads), len(quads)))
    bodies = connected_components(joined, directed=False)[1]
    return {
        "folds": int((turned > FOLD).sum()),
        "panel": int(np.bincount(patch)[np.unique(patch)].min()),
        "body": int(np.bincount(bodies).min()),
    }


def _apart(shape: np.ndarray, target: np.ndarray) -> float:
    """RMS distance of two shapes that are laid on each other (Kabsch 1976)."""
    one, two = shape - shape.mean(axis=0), target - target.mean(axis=0)
    left, _, right = np.linalg.svd(one.T @ two)
    sign = np.sign(np.linalg.det(left @ right))
    turn = left @ np.diag([1.0, 1.0, sign]) @ right
    return float(np.sqrt(((one @ turn - two) ** 2).sum(axis=1).mean()))
