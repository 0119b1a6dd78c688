"""Diagnose, for every spiral, why the shape misses its target there, and give advice."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Bool, Float, Int
from ..materials import OVERSTRAIN_SHARE
from ..mechanics.laplacian import laplacian_difference
from ..progress import SILENT, Progress
from ..simulation.rests import snapping_spirals
from ..simulation.shortfall import FarBody
from ..simulation.simulate import Simulation
from ..surface.checking.finding import with_count
from .optimise import Optimisation
from .remedies import CUT, FINER, LARGER, THINNER, Amounts, remedy_amounts
from .scaled_strain import forecast_strain

# Mismatch of a spiral in Laplacian coordinates, in distances of neighbouring hubs, up to which it counts as matched
MATCHED_BELOW = 0.01
DISTORTED_ABOVE = 0.01  # distortion (ARAP energy) of a quad above which it counts as distorted: a stretch by a tenth
MAJORITY = 0.5  # share of the quads above which one body counts as most of the piece
STRETCHED_ABOVE = 0.5  # share of in-plane energy in a spiral's elastic energy above which it counts as stretched

# reasons in order of precedence: name, predicate of the sentence of advice, and its remedies that a button offers
REASONS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("matched", "bends as the target does", ()),
    ("softest", "spirals are as soft as they may be: a larger object, a thinner sheet, narrower arms or more twist would help",
     (LARGER, THINNER)),
    ("stiffest", "spirals are as stiff as they may be: wider arms or less smallest twist would help", ()),
    ("unstable", "the shape is about to snap into another one: hold it there, or cut it along another line", (CUT,)),
    ("distorted", "quads are distorted by the flattening: squarer or finer quads, or a cut there, would help", (CUT, FINER)),
    ("stretched", "the panel is stretched in its plane more than it is bent: a cut there would let it close", (CUT,)),
    ("free", "spirals have room left to change but are pulled by their neighbours: optimise (further), or have other panels "
     "proposed", ()),
)  # fmt: skip
REASON_NAMES = tuple(name for name, _, _ in REASONS)


@dataclass(frozen=True, eq=False)
class MatchLimits:
    """Why each spiral misses the target.

    kind : (F,) reason of every spiral, index into ``REASON_NAMES``
    share : (kinds,) fraction of the squared mismatch, by reason; advice : sentences for the user
    remedies : amounts of the remedies in the advice that a button offers, see ``remedies.remedy_amounts``
    prospects : predicted RMS distance from the target after a cut or with supports, in percent of the size, see
        ``choosing.prospects``; None before it is computed
    """

    kind: Int[np.ndarray, " quads"]
    share: Float[np.ndarray, " kinds"]
    advice: str
    remedies: Amounts
    prospects: Mapping[str, float] | None = None

    def report(self) -> dict[str, Any]:
        """Return the ``reach`` block of report.json."""
        counts = np.bincount(self.kind, minlength=len(REASON_NAMES))
        return {
            "spirals": dict(zip(REASON_NAMES, counts.tolist(), strict=True)),
            "mismatch_share": dict(zip(REASON_NAMES, np.round(self.share, 4).tolist(), strict=True)),
            "advice": self.advice,
            "remedies": self.remedies,
            **({} if self.prospects is None else {"prospects": dict(self.prospects)}),
        }


def find_limits(of: Simulation | Optimisation, progress: Progress = SILENT, *, remedies: bool = True) -> MatchLimits:
    """Return why each spiral misses the target: the first reason that applies, in the order of ``REASONS``.

    Parameters
    ----------
    of : a simulation, or an optimisation, for which bounds of widths and twists are possible reasons too
    progress : reports progress and raises Cancelled
    remedies : whether to compute the amounts of remedies, which may take an equilibrium for each size and sheet
    """
    simulation = of.after if isinstance(of, Optimisation) else of
    within = progress.at(0.0, "Looking for what limits the match")
    difference = laplacian_difference(
        simulation.assembly.pairs, simulation.equilibrium.pose.centres, simulation.target.centroids
    )
    mismatch = np.linalg.norm(difference, axis=1)
    a, b = simulation.assembly.pairs.T
    spacing = np.linalg.norm(simulation.target.centroids[b] - simulation.target.centroids[a], axis=1).mean()
    kind = np.full(len(mismatch), REASON_NAMES.index("free"))
    reasons = _reasons(simulation, within)
    if isinstance(of, Optimisation):
        within(0.0)
        reasons |= _bounds(of)
    for name in reversed(REASON_NAMES):
        if name in reasons:
            kind[reasons[name]] = REASON_NAMES.index(name)
    kind[mismatch <= MATCHED_BELOW * spacing] = REASON_NAMES.index("matched")
    within(0.0)
    share = np.bincount(kind, weights=mismatch**2, minlength=len(REASON_NAMES)) / max(
        float((mismatch**2).sum()), 1e-300
    )
    advice = _advice(kind, share, simulation.far_bodies) + _strain_advice(simulation)
    return MatchLimits(kind, share, advice, _remedies(share, simulation) if remedies else {})


def _reasons(simulation: Simulation, progress: Progress) -> dict[str, np.ndarray]:
    """Return a mask (F,) for every reason that follows from the simulation."""
    found = {"distorted": simulation.design.flat.energy > DISTORTED_ABOVE}
    plane = simulation.model.in_plane_energy(simulation.model.start(simulation.equilibrium.pose))
    if plane is not None:
        found["stretched"] = _find_stretched(simulation, plane)
        found["unstable"] = _find_unstable(simulation, progress)
    return found


def _bounds(of: Optimisation) -> dict[str, np.ndarray]:
    """Return masks (F,) of the spirals that cannot get softer, or stiffer, though this would lower the objective.

    Wider arms are stiffer, arms with more twist softer.
    """
    push = -np.sign(of.gradient) * (of.at_bound != 0)
    outwards = push == of.at_bound
    stiffer = of.at_bound * np.append(np.ones(of.at_bound.shape[1] - 1), -1)  # 1 at the bound towards stiffness
    soft, stiff = ((outwards & (stiffer == way)).any(axis=1) for way in (-1, 1))
    return {"softest": soft, "stiffest": stiff & ~soft}


def _find_stretched(simulation: Simulation, plane: Float[np.ndarray, " joints"]) -> Bool[np.ndarray, " quads"]:
    """Return a mask (F,) of the spirals most of whose elastic energy comes from motions in the plane of the sheet.

    plane : joules, energy of every joint from such motions
    """
    both = np.stack([plane, simulation.equilibrium.per_joint], axis=1)
    total = np.zeros((simulation.assembly.size, 2))
    for side in (0, 1):
        np.add.at(total, simulation.model.assembly.hub_pairs[:, side], both)
    return total[:, 0] > STRETCHED_ABOVE * np.maximum(total[:, 1], 1e-300)


def _find_unstable(simulation: Simulation, progress: Progress) -> Bool[np.ndarray, " quads"]:
    """Return a mask (F,) of the spirals that move in a mode with hardly any energy, in which the piece may snap."""
    unstable = np.zeros(simulation.assembly.size, dtype=bool)
    unstable[snapping_spirals(simulation.equilibrium, lambda: simulation.softest(progress))[0]] = True
    return unstable


def _advice(kind: np.ndarray, share: np.ndarray, shortfalls: list[FarBody]) -> str:
    """Return the advice: first on bodies that miss their target as a whole, then on the reason with most mismatch."""
    worst = shortfalls[0] if shortfalls else None
    if worst is None:
        return _worst_kind_sentence(kind, share)
    if _stays_flat(shortfalls, len(kind)):
        return worst.fault_text + worst.remedy_text
    return f"{worst.fault_text} {_worst_kind_sentence(kind, share)}{worst.remedy_text}"


def _stays_flat(shortfalls: list[FarBody], quads: int) -> bool:
    """Return whether the worst body stays flat and is most of the piece, so that better spirals would not help."""
    return bool(shortfalls) and shortfalls[0].is_flat and len(shortfalls[0].quads) > MAJORITY * quads


def _strain_advice(simulation: Simulation) -> str:
    """Return the advice on overstrained arms, with a leading blank; "" if there are none."""
    over = 0 if simulation.strain is None else int((simulation.strain > OVERSTRAIN_SHARE).sum())
    if not over:
        return ""
    return (
        f" The arms of {with_count(over, 'spiral', 'spirals')} are strained beyond what the material bears: a larger object, a thinner sheet or a tougher "
        "material would help."
    )


def _worst_kind_sentence(kind: np.ndarray, share: np.ndarray) -> str:
    """Return the sentence of advice on the reason with most of the mismatch."""
    worst = _worst_kind(share)
    if worst is None:
        return "Every spiral bends as the target asks."
    count = int((kind == worst).sum())
    return f"{100 * share[worst]:.0f} % of the mismatch sits in {with_count(count, 'spiral', 'spirals')}: {REASONS[worst][1]}."


def _worst_kind(share: np.ndarray) -> int | None:
    """Return the index of the reason with most of the mismatch; None if all spirals match."""
    rest = np.where(np.arange(len(share)) == REASON_NAMES.index("matched"), 0.0, share)
    return int(rest.argmax()) if rest.sum() > 0.0 else None


def _remedies(share: np.ndarray, simulation: Simulation) -> Amounts:
    """Return the amounts of the remedies in the advice that a button offers.

    Finer quads are not offered where arms are overstrained, because shorter arms are strained more (docs/tuning.md).
    """
    short, worst = simulation.far_bodies[:1], _worst_kind(share)
    if _stays_flat(short, simulation.assembly.size):
        worst = None  # the advice on a flat piece mentions no reason
    kind, _, names = REASONS[0] if worst is None else REASONS[worst]
    strain = None if simulation.strain is None else float(simulation.strain.max())
    strained = strain is not None and strain > OVERSTRAIN_SHARE
    advised = [*names, *(CUT for piece in short if len(piece.cut_edges)), *((LARGER, THINNER) if strained else ())]
    if strained:
        advised = [name for name in advised if name != FINER]
    ease = forecast_strain(simulation) if strained else None
    return remedy_amounts(
        dict.fromkeys(advised),
        strain=None if strain is None else strain / OVERSTRAIN_SHARE,
        soft=kind == "softest",
        thickness=simulation.assembly.thickness,
        quads=simulation.assembly.size,
        forecast=None if ease is None else lambda times, thickness: ease(times, thickness) / OVERSTRAIN_SHARE,
    )
