"""Sections of arms bent by motions of their tips: their place in space, and derivatives by the bent arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Complex, Float, Int
from ..arms.tip_beams import BentBeams, PointGradient, SplitVector
from ..vectors import dot, matvec, right_jacobian, rotation_matrix, to_space


@dataclass(eq=False)
class SectionPull:
    """Derivatives of one number per section by ``middle``, ``along``, ``across``, ``off`` and ``half`` of ``Section``."""

    middle: Float[np.ndarray, "n places 3"]
    along: Float[np.ndarray, "n places 3"]
    across: Float[np.ndarray, "n places 3"]
    off: Float[np.ndarray, "n places 3"]
    half: Float[np.ndarray, "n places"]

    @classmethod
    def none(cls, like: Float[np.ndarray, "n places 3"]) -> SectionPull:
        """Zero derivatives for sections with these middles."""
        zero = np.zeros_like(like)
        return cls(zero, zero, zero, zero, zero[..., 0])


@dataclass(frozen=True, eq=False)
class Section:
    """Sections of arms at t.

    middle : metres; along, across, off : unit vectors along the arm (inwards), across it and normal to the sheet
    half : metres, half of the width; widening : its derivative by t
    velocity : derivative of the middle by t, metres; curving : derivative by t of the direction in the flat plane,
        radians
    piece, share : the piece of the arm, and the share of it up to the section; rate : derivative of the share by t, 0
        in the hub
    turn : radians; chord : metres, on the flat arm, from the station before; pace : velocity of the flat arm
    bend, stretch : of the piece; halfway : mean of the turns of the station and of the section
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
        """Place the sections of bent arms at t."""
        beams, every = field.beams, arm[:, None]
        pieces, hub = beams.velocity.shape[1], beams.hub[arm, None]
        point, velocity, change, half, widening = beams.lines.at(every, t)[:5]
        point, size = point - beams.lines.centre[every], np.abs(velocity)
        tangent = velocity / size
        way = np.clip(1.0 - t / hub, 0.0, 1.0) * pieces
        piece = np.minimum(way.astype(int), pieces - 1)
        share = (way - piece)[..., None]
        bend, stretch, turn, shift = (
            x[every, piece].space for x in (field.bend, field.stretch, field.turn, field.shift)
        )
        # within the hub the arm is rigid
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
    def turning(self) -> Float[np.ndarray, "n places 3"]:
        """Derivative of the vector ``along`` by t, to first order in the bend."""
        return self.rate[..., None] * np.cross(self.bend, self.along) - self.curving[..., None] * self.across

    def by_place(self, pull: SectionPull) -> Float[np.ndarray, "n places"]:
        """Derivatives by t of numbers with the derivatives ``pull`` by the sections."""
        turn, aside = self._vjp_of_turns(pull)
        return (
            dot(pull.middle, self.velocity)
            + self.rate * dot(turn, self.bend)
            + self.curving * aside
            + pull.half * self.widening
        )

    def vjp(self, pull: SectionPull) -> tuple[PointGradient, Int[np.ndarray, " n"]]:
        """Vector-Jacobian product with respect to the bent arms, one section per arm; and the pieces of the sections."""
        turn, aside = self._vjp_of_turns(pull)
        share, halfway = self.share[..., None], np.cross(self.chord, pull.middle)
        within = (self.rate < 0.0)[..., None]
        chord = SplitVector.from_vectors(np.where(within, np.cross(pull.middle, self.halfway), 0.0)).flat
        by_share = dot(pull.middle, self.stretch) + dot(0.5 * halfway + turn, self.bend)
        rates = by_share * -self.rate * self.t / self.hub
        spin = aside * 1j * self.pace / np.abs(self.pace) ** 2
        vectors = (pull.middle, halfway + turn, share * (0.5 * halfway + turn), share * pull.middle)
        shift, turns, bend, stretch = (SplitVector.from_vectors(x[:, 0]) for x in vectors)
        flat = SplitVector.from_vectors(pull.middle).flat
        return PointGradient(
            shift, turns, bend, stretch, -chord[:, 0], rates[:, 0], (flat + chord)[:, 0], spin[:, 0], pull.half[:, 0]
        ), self.piece[:, 0]

    def _vjp_of_turns(self, pull: SectionPull) -> tuple[Float[np.ndarray, "n places 3"], Float[np.ndarray, "n places"]]:
        """Derivatives by the turns of the sections and by the direction of the flat arm."""
        torque = sum(
            np.cross(axis, by)
            for axis, by in ((self.along, pull.along), (self.across, pull.across), (self.off, pull.off))
        )
        aside = dot(pull.across, self.along) - dot(pull.along, self.across)
        return matvec(right_jacobian(self.turn), torque), aside
