"""Cross-sections of arms that are bent by motions of their tips, with derivatives by the bent arm's state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Complex, Float, Int
from ..arms.split_vector import SplitVector
from ..arms.tip_beams import BentBeams, PointGradient
from ..vectors import dot, matvec, right_jacobian, rotation_matrix, to_space


@dataclass(eq=False)
class SectionGradient:
    """Derivatives of one scalar per section by five attributes of ``Section``, which have the same names."""

    middle: Float[np.ndarray, "n places 3"]
    along: Float[np.ndarray, "n places 3"]
    across: Float[np.ndarray, "n places 3"]
    off: Float[np.ndarray, "n places 3"]
    half: Float[np.ndarray, "n places"]

    @classmethod
    def zeros(cls, like: Float[np.ndarray, "n places 3"]) -> SectionGradient:
        """Return derivatives that are all 0; ``like`` is an array of the shape of ``middle``."""
        zero = np.zeros_like(like)
        return cls(zero, zero, zero, zero, zero[..., 0])


@dataclass(frozen=True, eq=False)
class Section:
    """Cross-sections of n bent arms, several on each, in the flat frames of the arms' hubs.

    An arm is divided into pieces (see ``TipBeams``). The inner station of a piece is its end nearer to the hub.

    t : position of the section on its arm, 0 at the tip, 1 at the hub's centre
    hub : t where the arm leaves its hub
    middle : middle of the section, metres
    along, across, off : unit vectors along the arm (inwards), across it, and along its normal
    half : half of the arm's width, metres
    widening : derivative of ``half`` with respect to t
    velocity : derivative of ``middle`` with respect to t, metres
    curving : derivative of the flat arm's direction (an angle in radians) with respect to t
    piece : index of the piece that contains the section
    share : share of this piece between its inner station and the section
    rate : derivative of ``share`` with respect to t, 0 within the hub
    turn : rotation vector of the section relative to the hub, radians
    chord : vector on the flat arm from the inner station to the section, metres
    pace : derivative of the position on the flat arm with respect to t, metres, complex
    bend, stretch : rotation vector (radians) and elongation (metres) over the whole piece
    halfway : mean of the rotation vectors of the inner station and of the section, radians
    """

    t: Float[np.ndarray, "n places"]
    hub: Float[np.ndarray, "n 1"]
    middle: Float[np.ndarray, "n places 3"]
    along: Float[np.ndarray, "n places 3"]
    across: Float[np.ndarray, "n places 3"]
    off: Float[np.ndarray, "n places 3"]
    half: Float[np.ndarray, "n places"]
    widening: Float[np.ndarray, "n places"]
    velocity: Float[np.ndarray, "n places 3"]
    curving: Float[np.ndarray, "n places"]
    piece: Int[np.ndarray, "n places"]
    share: Float[np.ndarray, "n places"]
    rate: Float[np.ndarray, "n places"]
    turn: Float[np.ndarray, "n places 3"]
    chord: Float[np.ndarray, "n places 3"]
    pace: Complex[np.ndarray, "n places"]
    bend: Float[np.ndarray, "n places 3"]
    stretch: Float[np.ndarray, "n places 3"]
    halfway: Float[np.ndarray, "n places 3"]

    @classmethod
    def from_arms(cls, field: BentBeams, arm: Int[np.ndarray, " n"], t: Float[np.ndarray, "n places"]) -> Section:
        """Compute sections of n of the bent arms ``field``.

        arm : (n,) indices of the arms in ``field``; t : (n, places) positions of the sections on them
        """
        beams, every = field.beams, arm[:, None]
        pieces, hub = beams.velocity.shape[1], beams.hub[arm, None]
        point, velocity, change, half, widening = beams.lines.evaluate(every, t)[:5]
        point, size = point - beams.lines.centre[every], np.abs(velocity)
        tangent = velocity / size
        way = np.clip(1.0 - t / hub, 0.0, 1.0) * pieces
        piece = np.minimum(way.astype(int), pieces - 1)
        share = (way - piece)[..., None]
        bend, stretch, turn, shift = (
            x[every, piece].space for x in (field.bend, field.stretch, field.turn, field.shift)
        )
        # where ``way`` is 0 the section lies within the hub and does not move relative to it, so its chord is set to 0
        chord = to_space(np.where(way > 0.0, point - beams.flat[every, piece], 0.0))
        halfway, whole = turn + 0.5 * share * bend, turn + share * bend
        frame = rotation_matrix(whole)
        rate = np.where(way > 0.0, -pieces / hub, 0.0)
        going = to_space(velocity) + rate[..., None] * (stretch + 0.5 * np.cross(bend, chord))
        return cls(
            t, hub, to_space(point) + shift + share * stretch + np.cross(halfway, chord),
            matvec(frame, to_space(tangent)), matvec(frame, to_space(-1j * tangent)), frame[..., 2], half, widening,
            going + np.cross(halfway, to_space(velocity)), (np.conj(velocity) * change).imag / size**2,
            piece, share[..., 0], rate, whole, chord, velocity, bend, stretch, halfway,
        )  # fmt: skip

    @property
    def along_by_t(self) -> Float[np.ndarray, "n places 3"]:
        """Derivative of ``along`` with respect to t, to first order in ``bend``."""
        return self.rate[..., None] * np.cross(self.bend, self.along) - self.curving[..., None] * self.across

    def vjp_by_t(self, gradient: SectionGradient) -> Float[np.ndarray, "n places"]:
        """Return the derivatives of one scalar per section with respect to t.

        gradient : the scalars' derivatives by the attributes of the sections
        """
        turn, aside = self._vjp_of_turns(gradient)
        return (
            dot(gradient.middle, self.velocity)
            + self.rate * dot(turn, self.bend)
            + self.curving * aside
            + gradient.half * self.widening
        )

    def vjp(self, gradient: SectionGradient) -> tuple[PointGradient, Int[np.ndarray, " n"]]:
        """Convert derivatives of scalars by one section of every arm to derivatives by the bent arms.

        gradient : the scalars' derivatives by the attributes of the sections

        Returns the derivatives that ``BentBeams.vjp`` needs, and the indices (n,) of the pieces with the sections.
        """
        turn, aside = self._vjp_of_turns(gradient)
        share, halfway = self.share[..., None], np.cross(self.chord, gradient.middle)
        within = (self.rate < 0.0)[..., None]
        chord = SplitVector.from_vectors(np.where(within, np.cross(gradient.middle, self.halfway), 0.0)).flat
        by_share = dot(gradient.middle, self.stretch) + dot(0.5 * halfway + turn, self.bend)
        rates = by_share * -self.rate * self.t / self.hub
        spin = aside * 1j * self.pace / np.abs(self.pace) ** 2
        vectors = (gradient.middle, halfway + turn, share * (0.5 * halfway + turn), share * gradient.middle)
        shift, turns, bend, stretch = (SplitVector.from_vectors(x[:, 0]) for x in vectors)
        flat = SplitVector.from_vectors(gradient.middle).flat
        return PointGradient(
            shift,
            turns,
            bend,
            stretch,
            -chord[:, 0],
            rates[:, 0],
            (flat + chord)[:, 0],
            spin[:, 0],
            gradient.half[:, 0],
        ), self.piece[:, 0]

    def _vjp_of_turns(
        self, gradient: SectionGradient
    ) -> tuple[Float[np.ndarray, "n places 3"], Float[np.ndarray, "n places"]]:
        """Convert derivatives by ``along``, ``across`` and ``off``, which rotate with the section.

        Returns the derivatives with respect to the sections' rotation vectors and to the direction of the flat arm
        (an angle in radians).
        """
        torque = sum(
            np.cross(axis, by)
            for axis, by in ((self.along, gradient.along), (self.across, gradient.across), (self.off, gradient.off))
        )
        aside = dot(gradient.across, self.along) - dot(gradient.along, self.across)
        return matvec(right_jacobian(self.turn), torque), aside
