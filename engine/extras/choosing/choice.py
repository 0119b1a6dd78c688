"""Outcome of choosing: a few proposals with their figures, and the number of the present one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...fabrication.estimates import assembly_seconds, cut_seconds
from ...materials import Material
from ...params import Settings
from ...patches.flattening.flatten import FlatPatches
from ...patches.splitting.split import usable
from .judge import JudgedLayout

# share of a sheet that panels fill: true nesting fills 0.43 to 0.55 of it
FILLED = 0.5
PROPOSALS, LEAST_SHOWN = 6, 3  # largest and smallest number of proposals to show: more are hard to compare
STRIDE = 1.6  # largest ratio of the numbers of panels of consecutive proposals, if there are layouts between them
INITIAL = "as it was"  # origin of the layout with which choosing began


@dataclass(frozen=True, eq=False)
class Proposal:
    """A layout with its match, and with estimates of making it.

    judged : match and strains; predicted if it is not ``proved``
    sheets : estimated number; cut, join : seconds; cut is None if no laser cuts the material, or the panels were not drawn
    """

    judged: JudgedLayout
    sheets: int
    cut: float | None
    join: float

    @property
    def flat(self) -> FlatPatches:
        return self.judged.flat

    @property
    def panels(self) -> int:
        return self.judged.laid.panels

    @property
    def rms(self) -> float:
        """Distance from the target, as a share of its size."""
        return self.judged.eased

    @property
    def proved(self) -> bool:
        """Whether a search gave its figures; otherwise they are predicted."""
        return self.judged.proved

    @property
    def symmetric(self) -> bool:
        """Whether it keeps at least one of the surface's symmetries."""
        return self.judged.laid.symmetric > 1

    def report(self) -> dict[str, Any]:
        """Return the proposal's row in the ``choose`` block of report.json."""
        laid = self.judged.laid
        return {
            "origin": laid.origin,
            "panels": laid.panels,
            "joints": laid.joints,
            "seams_m": round(laid.seams, 4),
            "rms_percent": round(100.0 * self.rms, 4),
            "max_percent": round(100.0 * self.judged.largest, 4),
            "proved": self.proved,
            "strain_share_max": round(self.judged.strain, 4),
            **({} if self.judged.closed is None else {"slots_closed": self.judged.closed}),
            "symmetries_kept": laid.symmetric,
            "sheets": self.sheets,
            **({} if self.cut is None else {"cut_minutes": round(self.cut / 60.0, 1)}),
            "join_minutes": round(self.join / 60.0),
            "advice": self.judged.advice,
        }


def proposal(judged: JudgedLayout, settings: Settings, material: Material) -> Proposal:
    """Make a proposal: add estimates of sheets and times to a judged layout.

    Parameters
    ----------
    judged : the layout with its match
    settings : of the piece
    material : of the sheets
    """
    flat, thickness = judged.laid.flat, settings.spiral.thickness
    corners = flat.corners - np.roll(flat.corners, 2, axis=1)
    area = 0.5 * float(np.abs(corners[:, 0, 0] * corners[:, 1, 1] - corners[:, 0, 1] * corners[:, 1, 0]).sum())
    room = float(usable(settings.sheet).prod())
    return Proposal(
        judged,
        max(1, int(np.ceil(area / (FILLED * room)))),
        None
        if judged.cut_length is None or judged.contours is None
        else cut_seconds(material, thickness, judged.cut_length, judged.contours),
        assembly_seconds(judged.laid.joints),
    )


@dataclass(frozen=True, eq=False)
class Choice:
    """The proposals, fewest panels first, and the number of the present one.

    reached : whether it meets the goal; note : sentence on the choice, or on why the goal was missed
    finished : False if the user stopped the search; judged : number of layouts judged
    """

    proposals: tuple[Proposal, ...]
    taken: int
    goal: str
    reached: bool
    note: str
    finished: bool
    judged: int

    @property
    def best(self) -> Proposal:
        return self.proposals[self.taken]

    def report(self) -> dict[str, Any]:
        """The ``choose`` block of report.json."""
        return {
            "goal": self.goal,
            "reached": self.reached,
            "note": self.note,
            "finished": self.finished,
            "layouts_judged": self.judged,
            "taken": self.taken,
            "proposals": [one.report() for one in self.proposals],
        }


def front(judged: list[JudgedLayout]) -> list[JudgedLayout]:
    """Return the Pareto front of few panels and small distance from the target, fewest panels first."""
    found: list[JudgedLayout] = []
    for one in sorted(judged, key=lambda one: (one.laid.panels, one.eased, one.laid.joints)):
        if not found or one.eased < found[-1].eased:
            found.append(one)
    return found


def worth_showing(made: list[Proposal], best: Proposal) -> list[Proposal]:
    """Return the proposals worth showing, fewest panels first: the chosen one, the initial one, and some of those with fewer panels than the nearest."""
    given = [one for one in made if one.judged.laid.origin == INITIAL]
    symmetric = sorted((one for one in made if one.symmetric), key=lambda one: one.rms)[:1]
    nearest = {id(one) for one in front([one.judged for one in made])}
    steps = sorted((one for one in made if id(one.judged) in nearest), key=lambda one: one.panels)
    way = steps[:1]
    while way and way[-1] is not steps[-1]:
        following = [one for one in steps if one.panels > way[-1].panels]
        near = [one for one in following if one.panels <= STRIDE * way[-1].panels]
        way.append(near[-1] if near else following[0])
    chosen: list[Proposal] = []
    # always show the initial layout, so that users can return to it
    for one in dict.fromkeys((best, *given, *way, *symmetric, *made)):
        wanted = len(chosen) < (PROPOSALS if one in way or one in symmetric else LEAST_SHOWN)
        if one in given or (wanted and not any(_look(one) == _look(other) for other in chosen)):
            chosen.append(one)
    return sorted(chosen, key=lambda one: (one.panels, one.judged.laid.joints, one.rms))


def _look(one: Proposal) -> tuple[float | str, ...]:
    """Return the figures that make proposals distinguishable to users."""
    return one.panels, one.judged.laid.joints, f"{100.0 * one.rms:.1g}", one.sheets
