"""Derivatives of the second-order strains by widths and twists, against differences of whole models."""

import sys

import numpy as np
import pytest
from flexmaps.engine.mechanics.arms import curving_changes
from flexmaps.engine.mechanics.arms.model import ArmModel

chains = sys.modules["flexmaps_chains"]
VERO, row, straight = (getattr(chains, name) for name in ("VERO", "row", "straight"))

RNG = np.random.default_rng(3)
POSE = straight(5).moved(RNG.normal(scale=0.3, size=(5, 6)) * np.array([1e-3] * 3 + [1.0] * 3))
WIDER, TURNED = RNG.normal(size=(5, 1)), RNG.normal(size=5)


def error(share: float, wider: np.ndarray, turned: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> float:
    """The relative error of the joints' gradients of a bent row; share : of the energy, from which on joints are differentiated."""
    monkeypatch.setattr(curving_changes, "MIN_SHARE", share)
    assembly = row(5, twist=1.5)
    model, width = ArmModel.from_assembly(assembly, VERO), wider * assembly.width
    known = curving_changes.DesignChanges(model, model.start(POSE)).complete
    change = np.concatenate([width, turned[:, None]], axis=1)[assembly.pairs]
    found = np.einsum("erks,eks->er", known.gradient_by_design, change)

    def gradients(t: float) -> np.ndarray:
        there = assembly.with_spirals(assembly.width + t * width, assembly.twist + t * turned)
        there_model = ArmModel.from_assembly(there, VERO)
        return there_model.joint_gradients(there_model.start(POSE))

    true = (gradients(1e-5) - gradients(-1e-5)) / 2e-5
    return float(np.linalg.norm(found - true) / np.linalg.norm(true))


def test_by_twists_they_are_differences(monkeypatch: pytest.MonkeyPatch) -> None:
    nothing = np.zeros_like(WIDER)
    none, some, every = (error(s, nothing, TURNED, monkeypatch) for s in (np.inf, curving_changes.MIN_SHARE, 0.0))
    assert every < 1e-6 < some < 0.3 * none


def test_by_widths_they_are_differences(monkeypatch: pytest.MonkeyPatch) -> None:
    nothing = np.zeros_like(TURNED)
    assert error(0.0, WIDER, nothing, monkeypatch) < 1e-6 < error(np.inf, WIDER, nothing, monkeypatch)
