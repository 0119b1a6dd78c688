"""The rim of an assembled piece, as ``bent`` needs it: every node of the rim gets a pose and arms like a hub.

Its arms are the neck that joins it to an arm of a spiral, and half of the strip to either neighbouring node.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...arrays import Float, Int
from ...materials import Material
from ...spirals.design import SpiralDesign
from ...spirals.rim import Rim
from ..assembly import Pose, assembly_from_design
from ..rim_bodies import BACKWARDS, FORWARDS, NECK, RimBeams
from .model import ArmModel
from .pieces import POISSON, STATIONS, Grain, piece_flexibilities


@dataclass(frozen=True, eq=False)
class RimPieces:
    """The joints of the rim, and the arms of its B nodes divided into pieces as in ``bent``.

    Every node has four arms: half of the strip to the next node, the neck, half of the strip to the previous node, and
    one that is not used.

    hub : (B,) index of the hub to which a node's neck leads
    arm : (k, 2) indices of both arms of the k joints of the rim
    axes : (k, 2, 3, 3) axes of these joints as columns, in the flat frames of their arms' patches
    flat, answer : as in ``bent._ArmPieces``
    """

    design: SpiralDesign
    material: Material
    hub: Int[np.ndarray, " nodes"]
    arm: Int[np.ndarray, "joints 2"]
    axes: Float[np.ndarray, "joints 2 3 3"]
    flat: Float[np.ndarray, "arms _ 3"]
    answer: Float[np.ndarray, "arms stations 6 6"]

    @property
    def nodes(self) -> int:
        """Number B of nodes."""
        return len(self.hub)

    @cached_property
    def _model(self) -> ArmModel:
        return ArmModel.from_assembly(
            assembly_from_design(self.design), self.material, curving=False, slopes=False
        ).rim_only

    def with_nodes(self, pose: Pose) -> Pose:
        """Return the pose with poses of the rim's nodes, which are in equilibrium between the fixed hubs.

        A pose that has poses of the nodes is returned unchanged.
        """
        return pose if pose.nodes is not None else self._model.start(pose).pose


def rim_pieces(design: SpiralDesign, material: Material | None) -> RimPieces:
    """Divide the arms of a design's rim into pieces.

    material : gives Poisson's ratio and the grain; None for ``POISSON`` and no grain
    """
    rim, whole = design.rim, assembly_from_design(design).whole
    assert rim is not None and whole.rim is not None
    known = (
        Material("Any", 1e9, POISSON, 1000.0, 0.02, True, "none: ratios count alone") if material is None else material
    )
    count = len(rim.quad)
    flat, answer = np.zeros((count, 4, STATIONS + 1, 3)), np.zeros((count, 4, STATIONS, 6, 6))
    share = np.linspace(0.0, 1.0, 2 * STATIONS + 1)
    grain = None if known.orthotropy is None else Grain(known.orthotropy, design.params.grain, known.youngs)
    for arm in (FORWARDS, NECK, BACKWARDS):
        place, way, long = _line(rim, arm, share)
        line = np.stack([place.real, place.imag, np.zeros(place.shape)], axis=-1)
        width = np.array(rim.width) if arm != NECK else design.arms.joint_width[rim.quad, rim.side][:, None]
        length = np.broadcast_to(long[:, None] / STATIONS, (count, STATIONS))
        beams = RimBeams.from_points(place[:, 1::2], way[:, 1::2], place[:, -1], length, width, np.zeros(length.shape))
        flat[:, arm] = line[:, ::2]
        answer[:, arm] = piece_flexibilities(
            beams.lever, beams.tangent, length, beams.width, design.params.thickness, known.poisson, grain
        )
    return RimPieces(
        design, known, rim.quad, 4 * whole.pairs[whole.n_inner_joints :] + whole.sides[whole.n_inner_joints :],
        whole.axes[whole.n_inner_joints :], flat.reshape(-1, STATIONS + 1, 3), answer.reshape(-1, STATIONS, 6, 6),
    )  # fmt: skip


def _line(rim: Rim, arm: int, share: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return k points of one arm of each of the B nodes of a rim.

    arm : ``FORWARDS``, ``NECK`` or ``BACKWARDS``; share : (k,) distances of the points from the node over the length

    Returns positions (B, k) relative to the node and unit tangents (B, k) away from the node, both complex, in the flat
    frame, and the lengths (B,) of the arms, metres.
    """
    count = len(rim.quad)
    if arm == NECK:
        long = np.full(count, rim.depth + 0.5 * rim.width)
        return (
            -(long[:, None] * share) * rim.outwards[:, None],
            np.broadcast_to(-rim.outwards[:, None], (count, len(share))),
            long,
        )
    back = arm == BACKWARDS
    long = rim.reach[:, int(back)]
    gone = long[:, None] * share
    place, way = rim.vectors_along_strip(np.repeat(np.arange(count), len(share)), back, gone.ravel())
    return place.reshape(gone.shape), (-way if back else way).reshape(gone.shape), long
