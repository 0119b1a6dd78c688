"""Arms that motions of their tips bend: against the general beam's matrices, and derivatives against differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from flexmaps.engine.mechanics.arms.pieces import POISSON, piece_flexibilities
from flexmaps.engine.mechanics.arms.split_vector import SplitVector
from flexmaps.engine.mechanics.arms.tip_beams import BentBeams, PointGradient, TipBeams
from flexmaps.engine.mechanics.clearance import slot_estimate
from flexmaps.engine.mechanics.clearance.sections import Section, SectionGradient
from flexmaps.engine.mechanics.clearance.slot_estimate import Slots
from flexmaps.engine.spirals.curves.arm_curves import ArmCurves
from flexmaps.engine.spirals.curves.blends import N_BLEND_PARAMETERS

PIECES, FILLET, THICKNESS, COUNT = 10, 3e-4, 0.002, 40
ROWS = np.arange(COUNT)
# of the differences, in the order of ``blends``, and by the motion; metres and radians
STEPS = np.array([1e-8, 1e-8, 1e-5, 1e-5, 1e-7, 1e-5, 1e-5, 1e-5])
MOTION_STEPS = np.repeat([1e-6, 1e-4], 3)


def random_arms(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers and motions."""
    rng = np.random.default_rng(seed)
    width, wind = rng.uniform(1e-3, 2e-3, (count, 2)), rng.uniform(2.5, 4.5, (count, 2))
    other = rng.uniform(0.009, 0.011, count), rng.uniform(-3.0, 3.0, count), rng.normal(0.0, 0.1, (count, 2))
    motion = rng.normal(size=(count, 6)) * np.repeat([8e-4, 0.15], 3)
    return np.column_stack([width, wind, *other]), motion


def bent(numbers: np.ndarray, motion: np.ndarray) -> BentBeams:
    both = numbers[:, 0:2], numbers[:, 2:4], numbers[:, 6:8]
    lines = ArmCurves.from_arms(np.zeros(len(numbers), complex), numbers[:, 4], numbers[:, 5], both, 0.15)
    return TipBeams.from_lines(lines, FILLET, THICKNESS, PIECES).bend(motion)


def test_tips_move_as_asked_by_the_general_beam() -> None:
    numbers, motion = random_arms(1, COUNT)
    field = bent(numbers, motion)
    beams, zero = field.beams, np.zeros((COUNT, PIECES))
    lever = SplitVector(-1j * beams.lever, zero).space
    pace = np.abs(beams.velocity)
    tangent = SplitVector(-beams.velocity / pace, zero).space
    answer = piece_flexibilities(lever, tangent, pace * beams.hub[:, None] / PIECES, beams.width, THICKNESS, POISSON)
    load = np.concatenate([field.load.force.space, field.load.moment.space], axis=1)
    strain = (answer @ load[:, None, :, None])[..., 0]
    assert field.bend.space == pytest.approx(strain[..., :3], abs=1e-3 * np.abs(strain[..., :3]).max())
    assert field.stretch.space == pytest.approx(strain[..., 3:], abs=1e-9 * np.abs(strain[..., 3:]).max())
    turn = field.bend.space.sum(axis=1)
    shift = (field.stretch.space - np.cross(lever, field.bend.space)).sum(axis=1)
    assert np.concatenate([shift, turn], axis=1) == pytest.approx(motion, abs=1e-12)


def test_what_places_do_follows_motions_and_numbers() -> None:
    numbers, motion = random_arms(2, COUNT)
    rng = np.random.default_rng(3)
    t, piece = rng.uniform(0.0, 0.4, COUNT), rng.integers(0, PIECES, COUNT)
    vectors = rng.normal(size=(4, COUNT, 3)) * np.array([1.0, 1e-3, 1e-3, 1.0])[:, None, None]
    station, point, velocity = (rng.normal(size=COUNT) + 1j * rng.normal(size=COUNT) for _ in range(3))
    hub, half = 1e-3 * rng.normal(size=COUNT), rng.normal(size=COUNT)

    def value(numbers: np.ndarray, motion: np.ndarray) -> np.ndarray:
        field = bent(numbers, motion)
        here, pace, _, wide = field.beams.lines.evaluate(ROWS, t)[:4]
        members = field.shift, field.turn, field.bend, field.stretch
        out = sum((x[ROWS, piece].space * by).sum(axis=1) for x, by in zip(members, vectors))
        pairs = (field.beams.flat[ROWS, piece], station), (here, point), (pace, velocity)
        return out + sum((np.conj(by) * x).real for x, by in pairs) + hub * field.beams.hub + half * wide

    pull = PointGradient(*(SplitVector.from_vectors(x) for x in vectors), station, hub, point, velocity, half)
    assert_differences(bent(numbers, motion).vjp(t, piece, pull), value, numbers, motion)


def test_sections_follow_places_motions_and_numbers() -> None:
    """Their middles, directions and widths: by t, within the hub too, by the motions of the tips and by the arms' numbers."""
    numbers, motion = random_arms(5, COUNT)
    rng = np.random.default_rng(6)
    hub = bent(numbers, motion).beams.hub
    t = np.where(ROWS % 4 == 0, hub + (1.0 - hub) * rng.uniform(0.1, 0.9, COUNT), hub * rng.uniform(0.0, 0.95, COUNT))
    vectors = rng.normal(size=(4, COUNT, 1, 3)) * np.array([1.0, 1e-2, 1e-2, 1e-2])[:, None, None, None]
    pull = SectionGradient(*vectors, rng.normal(size=(COUNT, 1)))

    def value(numbers: np.ndarray, motion: np.ndarray, t: np.ndarray = t) -> np.ndarray:
        at = Section.from_arms(bent(numbers, motion), ROWS, t[:, None])
        members = at.middle, at.along, at.across, at.off
        return (sum((x * by).sum(axis=2) for x, by in zip(members, vectors)) + at.half * pull.half)[:, 0]

    here = Section.from_arms(bent(numbers, motion), ROWS, t[:, None])
    found = (value(numbers, motion, t + 1e-6) - value(numbers, motion, t - 1e-6)) / 2e-6
    assert here.vjp_by_t(pull)[:, 0] == pytest.approx(found, abs=1e-6 * np.abs(found).max())
    by, piece = here.vjp(pull)
    assert_differences(bent(numbers, motion).vjp(t, piece, by), value, numbers, motion)


def assert_differences(
    derivatives: tuple[np.ndarray, ...], value: Callable[..., np.ndarray], numbers: np.ndarray, motion: np.ndarray
) -> None:
    """Compare derivatives by motions and by numbers with central differences."""
    for told, steps, which in zip(derivatives, (MOTION_STEPS, STEPS), (1, 0)):
        for k, step in enumerate(steps):
            ahead, behind = [numbers, motion], [numbers, motion]
            ahead[which], behind[which] = (
                given[which] + s * step * np.eye(len(steps))[k] for s, given in ((1, ahead), (-1, behind))
            )
            found = (value(*ahead) - value(*behind)) / (2.0 * step)
            assert told[:, k] == pytest.approx(found, abs=1e-6 * np.abs(found).max())


@pytest.mark.parametrize("clockwise", [False, True])
def test_the_rough_look_leaves_no_narrow_place_out(clockwise, monkeypatch) -> None:
    numbers, motion = random_arms(4, 2000)
    numbers[:, 5] = np.tile(0.5 * np.pi * np.arange(4), 500)
    # one sense of rotation, and alike twists within a spiral
    numbers[:, 2] = np.repeat(numbers[::4, 2], 4)
    numbers[:, 2:4] *= -1.0 if clockwise else 1.0
    slots = Slots(0.15, FILLET, THICKNESS, clockwise)
    found = slots.below(np.full(len(numbers), 4e-4), numbers, motion)
    monkeypatch.setattr(slot_estimate, "ROUGH_MARGIN", 1.0)
    every = slots.below(np.full(len(numbers), 4e-4), numbers, motion)
    assert len(every.values) > 100 and numbers.shape[1] == N_BLEND_PARAMETERS
    assert found.values == pytest.approx(every.values, abs=1e-12)
