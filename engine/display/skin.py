"""Skinned panels: arms that follow their hubs without a solver, so that a web page can bend them.

Every section of an arm follows a weighted mean of two frames, that of its hub and that of its tip, which lies half way
between the two hubs of the joint ("skinning" in animation). The difference to the elastic arm's shape in the final pose
(``mechanics.arms.bent``) is stored for every section, and added in proportion to the arm's bend. So the flat panels and
the final pose are exact, and poses in between are approximated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Float, Int
from ..mechanics.arms.bent import Bender, BentArms, hub_edge_of_design
from ..mechanics.assembly import Pose, rest_joints
from ..mechanics.vectors import matvec, rotation_matrix, rotation_vector
from ..progress import SILENT, Progress
from ..spirals.design import SpiralDesign
from .panel_mesh import Detail, make_panel_mesh
from .rim_mesh import RimMesh

# Resolution of the arms for up to MAX_FINE_SPIRALS spirals, and the coarser resolution for more spirals, which appear
# small (some 40 pixels). Finer: smoother arms, larger pages.
FINE_DETAIL, COARSE_DETAIL, MAX_FINE_SPIRALS = Detail(4, 45.0, 0), Detail(3, 60.0, 0), 600


@dataclass(frozen=True, eq=False)
class RimStrip:
    """The rim of a piece: plates whose points follow the hub of their quad, sorted by quad. Lengths in metres.

    quad : quad of every point
    flat : position of every point in the flat panel, from the hub's centre
    way, up : in the final pose, in the hub's frame: displacement of every point from ``flat``, and upward normal
    triangles : counter-clockwise, seen from above
    walls : edges of the plates, with the material on the left
    """

    quad: Int[np.ndarray, " points"]
    flat: Float[np.ndarray, "points 2"]
    way: Float[np.ndarray, "points 3"]
    up: Float[np.ndarray, "points 3"]
    triangles: Int[np.ndarray, "triangles 3"]
    walls: Int[np.ndarray, "walls 2"]

    @classmethod
    def from_rim_mesh(cls, rim: RimMesh, design: SpiralDesign, pose: Pose | None, arms: BentArms | None) -> RimStrip:
        """Build the plates of a rim.

        Parameters
        ----------
        rim : mesh of the rim
        design : spirals
        pose, arms : final pose of the hubs and the arms bent in it; None for flat plates
        """
        order = np.argsort(rim.quad, kind="stable")
        new = np.empty(len(order), dtype=np.int64)
        new[order] = np.arange(len(order))
        quad = rim.quad[order]
        flat = rim.flat_points[order, :2] - design.arms.centre[quad]
        way, up = np.zeros((len(quad), 3)), np.tile([0.0, 0.0, 1.0], (len(quad), 1))
        if pose is not None and arms is not None:
            place, normal = (values[order] for values in rim.points_at_pose(arms))
            back = np.swapaxes(pose.rotations, 1, 2)[quad]
            way, up = matvec(back, place - pose.centres[quad]) - _to_space(flat), matvec(back, normal)
        triangles, walls = new[rim.triangles], new[rim.walls]
        triangles = triangles[np.argsort(quad[triangles[:, 0]], kind="stable")]
        return cls(quad, flat, way, up, triangles, walls[np.argsort(quad[walls[:, 0]], kind="stable")])


@dataclass(frozen=True, eq=False)
class Skin:
    """Skinned panels; lengths in metres, flat positions from the hub's centre in the patch's frame.

    arm : arm of every section, as 4 quad + side; the sections of an arm run from tip to root
    share : weight of the tip's frame at every section, 1 at the tip and 0 at the hub
    left, right : flat positions of the edges of every section
    tip, axis : flat position of every arm's end, and direction of the quad's side there, radians
    partner : arm (4 quad + side) that meets each arm in its joint, -1 at the border
    way, turn : corrections of the sections in the final pose, in the hub's frame: displacements and rotation vectors
    final_motion : (A, 6) motion of the tip relative to the hub in the final pose, see ``tip_motions``
    rim_strip : plates of the rim; None without a rim
    """

    arm: Int[np.ndarray, " sections"]
    share: Float[np.ndarray, " sections"]
    left: Float[np.ndarray, "sections 2"]
    right: Float[np.ndarray, "sections 2"]
    tip: Float[np.ndarray, "arms 2"]
    axis: Float[np.ndarray, " arms"]
    partner: Int[np.ndarray, " arms"]
    way: Float[np.ndarray, "sections 3"]
    turn: Float[np.ndarray, "sections 3"]
    final_motion: Float[np.ndarray, "arms 6"]
    rim_strip: RimStrip | None = None

    @classmethod
    def from_design(cls, design: SpiralDesign, pose: Pose | None, progress: Progress = SILENT) -> Skin:
        """Build the panels of a design.

        Parameters
        ----------
        design : spirals
        pose : final pose; None for flat panels
        progress : called with the fraction done
        """
        mesh = design.flat.layout.mesh
        panels = make_panel_mesh(design, choose_detail(design), (), progress.part(0.0, 0.3))
        arm = panels.arm
        hub = np.maximum(hub_edge_of_design(design).ravel()[arm], 1e-9)
        flat = panels.line[:, None] + panels.sides
        spokes = 0.5 * (design.flat.corners + np.roll(design.flat.corners, -1, axis=1)) - design.arms.centre[:, None]
        inner = ~mesh.border
        both = 4 * mesh.edge_quads[inner] + mesh.edge_sides[inner]
        partner, axis = np.full(4 * len(mesh.quads), -1), np.zeros(4 * len(mesh.quads))
        partner[both] = both[:, ::-1]
        axes = rest_joints(mesh, design.flat.corners)[1]
        axis[both] = np.arctan2(axes[..., 1, 0], axes[..., 0, 0])
        nothing = np.zeros((len(arm), 3))
        skin = cls(
            arm, np.clip(1.0 - panels.t / hub, 0.0, 1.0), flat[:, 0, :2], flat[:, 1, :2], spokes.reshape(-1, 2), axis,
            partner, nothing, nothing, np.zeros((len(axis), 6)),
        )  # fmt: skip
        arms = None if pose is None else Bender.from_design(design).bend(pose, progress=progress.part(0.3, 1.0))
        strip = None if panels.rim_mesh is None else RimStrip.from_rim_mesh(panels.rim_mesh, design, pose, arms)
        if pose is None or arms is None:
            return replace(skin, rim_strip=strip)
        place, turn = arms.at(arm, panels.t, panels.line)
        middle = place + matvec(turn, panels.sides.mean(axis=1))
        full = skin.tip_motions(pose, (partner >= 0).astype(float))
        back = np.swapaxes(pose.rotations, 1, 2)[arm // 4]
        # position and rotation of the sections in the hub's frame
        own = matvec(back, middle - pose.centres[arm // 4])
        turned = rotation_vector(back @ turn)
        guess, guessed = skin.interpolate(full)
        return cls(
            arm, skin.share, skin.left, skin.right, skin.tip, axis, partner, own - guess, turned - guessed, full, strip
        )  # fmt: skip

    def tip_motions(self, pose: Pose, closed: Float[np.ndarray, " arms"]) -> Float[np.ndarray, "arms 6"]:
        """Return the motion of every tip relative to its hub, in the hub's frame: displacement (m), rotation vector.

        Parameters
        ----------
        pose : pose of the hubs
        closed : how far every joint is closed: 1 if the tips of both arms meet half way, 0 if they are rigid with
            their hubs
        """
        quad, met = np.arange(len(self.tip)) // 4, np.flatnonzero(self.partner >= 0)
        end = pose.centres[quad] + matvec(pose.rotations[quad], _to_space(self.tip))
        frame = pose.rotations[quad] @ _about_z(self.axis)
        other = self.partner[met]
        out = np.zeros((len(self.tip), 6))
        back = np.swapaxes(pose.rotations, 1, 2)[quad[met]]
        out[met, :3] = 0.5 * closed[met, None] * matvec(back, end[other] - end[met])
        across = rotation_vector(np.swapaxes(frame[met], 1, 2) @ frame[other])
        out[met, 3:] = matvec(_about_z(self.axis[met]), 0.5 * closed[met, None] * across)
        return out

    def interpolate(self, motion: Float[np.ndarray, "arms 6"]) -> tuple[np.ndarray, np.ndarray]:
        """Return middles (n, 3), metres, and rotation vectors (n, 3) of the sections, in the frames of their hubs.

        They are interpolated between the hub, which stays, and the tip, which moves.

        motion : motion of every tip relative to its hub, see ``tip_motions``
        """
        middle, tip = _to_space(0.5 * (self.left + self.right)), _to_space(self.tip)[self.arm]
        way, turn = motion[self.arm, :3], motion[self.arm, 3:]
        share = self.share[:, None]
        with_tip = tip + way + matvec(rotation_matrix(turn), middle - tip)
        return (1.0 - share) * middle + share * with_tip, share * turn

    def corners_at_pose(self, pose: Pose, closed: Float[np.ndarray, " arms"], thickness: float) -> np.ndarray:
        """Return the corners of every section, (n, 4, 3) metres: left and right above, then left and right below.

        The web page has the same computation.

        Parameters
        ----------
        pose : pose of the hubs
        closed : how far every joint is closed, see ``tip_motions``
        thickness : thickness of the sheet, metres
        """
        moved = self.tip_motions(pose, closed)
        middle, turn = self.interpolate(moved)
        measure = self.bend_shares(moved)[self.arm, None]
        quad = self.arm // 4
        rotation = pose.rotations[quad] @ rotation_matrix(turn + measure * self.turn)
        middle = pose.centres[quad] + matvec(pose.rotations[quad], middle + measure * self.way)
        half = _to_space(0.5 * (self.left - self.right))
        up = 0.5 * thickness * rotation[:, :, 2]
        left, right = middle + matvec(rotation, half), middle - matvec(rotation, half)
        return np.stack([left + up, right + up, left - up, right - up], axis=1)

    def bend_shares(self, motion: Float[np.ndarray, "arms 6"]) -> Float[np.ndarray, " arms"]:
        """Return for every arm the ratio of its bend to its bend in the final pose, 0 to 1.

        Arms without a joint get the mean of the arms of their spiral that have one.

        motion : result of ``tip_motions``
        """
        measure = self.joint_bend_shares(motion)
        return np.where(self.partner >= 0, measure, np.repeat(self._mean_over_joints(measure), 4))

    def _mean_over_joints(self, measure: Float[np.ndarray, " arms"]) -> Float[np.ndarray, " quads"]:
        """Return the mean of a value over the arms with a joint, for every spiral."""
        met = (self.partner >= 0).reshape(-1, 4)
        return (measure.reshape(-1, 4) * met).sum(axis=1) / np.maximum(met.sum(axis=1), 1)

    def joint_bend_shares(self, motion: Float[np.ndarray, "arms 6"]) -> Float[np.ndarray, " arms"]:
        """Return ``bend_shares``, but 0 for arms without a joint.

        motion : result of ``tip_motions``
        """
        size = np.linalg.norm(self.tip, axis=1)
        unit = np.concatenate([np.repeat(1.0 / size[:, None], 3, axis=1), np.ones((len(size), 3))], axis=1)
        full = self.final_motion * unit
        return np.clip((motion * unit * full).sum(axis=1) / np.maximum((full**2).sum(axis=1), 1e-12), 0.0, 1.0)


def choose_detail(design: SpiralDesign) -> Detail:
    """Return the resolution of the arms that suits the number of spirals."""
    return FINE_DETAIL if len(design.width) <= MAX_FINE_SPIRALS else COARSE_DETAIL


def _to_space(points: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points 3"]:
    """Return plane points as points in space with z = 0."""
    return np.c_[points, np.zeros(len(points))]


def _about_z(angle: Float[np.ndarray, " angles"]) -> Float[np.ndarray, "angles 3 3"]:
    """Return rotation matrices about the z axis; ``angle`` in radians."""
    return rotation_matrix(np.stack([np.zeros_like(angle), np.zeros_like(angle), angle], axis=1))
