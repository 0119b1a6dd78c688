"""Diagnose, spiral by spiral, why a shape does not match its target, and give one sentence of advice."""

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
from .eased import forecast_strain
from .optimise import Optimisation
from .remedies import CUT, FINER, LARGER, THINNER, Amounts, remedy_amounts

# mismatch in Laplacian coordinates, in distances of neighbours, up to which a spiral counts as matched
MATCHED_BELOW = 0.01
DISTORTED_ABOVE = 0.01  # ARAP energy of a quad above which it counts as distorted: by about a tenth in length
MAJORITY = 0.5  # share of the quads above which one body counts as most of the piece
STRETCHED_ABOVE = 0.5  # share of in-plane energy in a spiral's elastic energy above which it counts as stretched

# name, predicate of the advice, and the remedies in it that a button offers
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

    kind : (F,) reason of every spiral, index into ``REASON_NAMES``; share : (kinds,) of the squared mismatch, by reason; advice : a sentence
    remedies : the remedies in the advice that a button offers, and their amounts, see ``remedies.remedy_amounts``
    prospects : RMS distance from the target, in percent of the size, that a cut or supports would reach, see ``choosing.prospects``;
        None before they are computed
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
    """Return the reason why each spiral of a design misses the target: the first that applies, in the order of ``REASONS``.

    Parameters
    ----------
    of : a simulated design, or an optimised one, of which also the bounds of widths and twists count
    progress : reports progress and raises Cancelled
    remedies : whether to compute the amounts of remedies, which may take an equilibrium for each sheet that is tried
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
    advice = _advice(kind, share, simulation.shortfalls) + _strain_advice(simulation)
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
    """Return masks (F,) of the spirals at a bound that the objective pushes against, towards softer and towards stiffer arms.

    Wider arms are stiffer, more twist makes them softer.
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
        np.add.at(total, simulation.model.assembly.owners[:, side], both)
    return total[:, 0] > STRETCHED_ABOVE * np.maximum(total[:, 1], 1e-300)


def _find_unstable(simulation: Simulation, progress: Progress) -> Bool[np.ndarray, " quads"]:
    """Return a mask (F,) of the spirals that move in a mode which hardly costs energy."""
    unstable = np.zeros(simulation.assembly.size, dtype=bool)
    unstable[snapping_spirals(simulation.equilibrium, lambda: simulation.softest(progress))[0]] = True
    return unstable


def _advice(kind: np.ndarray, share: np.ndarray, shortfalls: list[FarBody]) -> str:
    """Return the advice: on bodies that miss their target as a whole first, then on the worst kind of spiral."""
    worst = shortfalls[0] if shortfalls else None
    if worst is None:
        return _worst_kind_sentence(kind, share)
    if _stays_flat(shortfalls, len(kind)):
        return worst.wrong + worst.help
    return f"{worst.wrong} {_worst_kind_sentence(kind, share)}{worst.help}"


def _stays_flat(shortfalls: list[FarBody], quads: int) -> bool:
    """Return whether the worst body stays flat and is most of the piece: better spirals would not help then."""
    return bool(shortfalls) and shortfalls[0].flat and len(shortfalls[0].quads) > MAJORITY * quads


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
    """Return the sentence on the kind with most of the mismatch."""
    worst = _worst_kind(share)
    if worst is None:
        return "Every spiral bends as the target asks."
    count = int((kind == worst).sum())
    return f"{100 * share[worst]:.0f} % of the mismatch sits in {with_count(count, 'spiral', 'spirals')}: {REASONS[worst][1]}."


def _worst_kind(share: np.ndarray) -> int | None:
    """Return the kind with most of the mismatch; None if all spirals match."""
    rest = np.where(np.arange(len(share)) == REASON_NAMES.index("matched"), 0.0, share)
    return int(rest.argmax()) if rest.sum() > 0.0 else None


def _remedies(share: np.ndarray, simulation: Simulation) -> Amounts:
    """Return the amounts of the remedies in the advice that a button offers.

    Finer quads are not offered where arms are overstrained: with twice as many quads, on a dome and a saddle, the shorter arms were
    strained 1.6 and 1.7 times as much.
    """
    short, worst = simulation.shortfalls[:1], _worst_kind(share)
    if _stays_flat(short, simulation.assembly.size):
        worst = None  # the advice on a flat piece does not mention kinds
    kind, _, names = REASONS[0] if worst is None else REASONS[worst]
    strain = None if simulation.strain is None else float(simulation.strain.max())
    strained = strain is not None and strain > OVERSTRAIN_SHARE
    advised = [*names, *(CUT for piece in short if len(piece.line)), *((LARGER, THINNER) if strained else ())]
    if strained:
        advised = [name for name in advised if name != FINER]
    ease = forecast_strain(simulation) if strained else None
    return remedy_amounts(
        dict.fromkeys(advised),
        strain=None if strain is None else strain / OVERSTRAIN_SHARE,
        soft=kind == "softest",
        thickness=simulation.assembly.thickness,
        quads=simulation.assembly.size,
        eased=None if ease is None else lambda times, thickness: ease(times, thickness) / OVERSTRAIN_SHARE,
    )
