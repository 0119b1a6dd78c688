"""Result of comparing layouts: a few proposals with match and estimated effort, and the index of the chosen one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...fabrication.estimates import assembly_seconds, cut_seconds
from ...materials import Material
from ...params import Settings
from ...patches.flattening.flatten import FlatPatches
from ...patches.splitting.split import usable_size
from .judge import JudgedLayout

# share of a sheet's area that panels fill, to estimate the number of sheets; larger: fewer sheets are announced
SHEET_FILL = 0.5
MAX_PROPOSALS, MIN_PROPOSALS = 6, 3  # largest and smallest number of proposals to show: more are hard to compare
# largest ratio of panel counts of consecutive proposals, if layouts with counts between them exist; larger: fewer
# proposals
MAX_PANEL_STEP = 1.6
INITIAL_ORIGIN = "as it was"  # ``origin`` of the layout that the piece had before layouts were compared


@dataclass(frozen=True, eq=False)
class Proposal:
    """A judged layout with estimates of the effort to make it.

    judged : match and strains; predicted unless ``proved``
    sheets : estimated number of sheets
    cut : cutting time of the laser, seconds; None if no laser cuts the material, or the length of cuts is not known
    join : time to snap all joints together, seconds
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
        """RMS distance from the target that is expected with strains within the limit, share of the target's size."""
        return self.judged.eased

    @property
    def proved(self) -> bool:
        """Whether the match was reached by a full search, or by a long one with strains within the limit; otherwise it
        is an estimate."""
        return self.judged.proved

    @property
    def symmetric(self) -> bool:
        """Whether the layout keeps at least one of the surface's symmetries."""
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


def make_proposal(judged: JudgedLayout, settings: Settings, material: Material) -> Proposal:
    """Make a proposal: add estimates of sheets and times to a judged layout.

    Parameters
    ----------
    judged : the layout with its match
    settings : settings of the piece
    material : material of the sheets
    """
    flat, thickness = judged.laid.flat, settings.spiral.thickness
    corners = flat.corners - np.roll(flat.corners, 2, axis=1)
    area = 0.5 * float(np.abs(corners[:, 0, 0] * corners[:, 1, 1] - corners[:, 0, 1] * corners[:, 1, 0]).sum())
    room = float(usable_size(settings.sheet).prod())
    return Proposal(
        judged,
        max(1, int(np.ceil(area / (SHEET_FILL * room)))),
        None
        if judged.cut_length is None or judged.contours is None
        else cut_seconds(material, thickness, judged.cut_length, judged.contours),
        assembly_seconds(judged.laid.joints),
    )


@dataclass(frozen=True, eq=False)
class Choice:
    """The proposals, fewest panels first, and which of them is chosen.

    taken : index of the chosen proposal
    goal : goal of the search (``ChooseParams.goal``); reached : whether the chosen proposal meets the goal
    note : sentence that explains the choice, or why the goal was missed
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
        """Return the ``choose`` block of report.json."""
        return {
            "goal": self.goal,
            "reached": self.reached,
            "note": self.note,
            "finished": self.finished,
            "layouts_judged": self.judged,
            "taken": self.taken,
            "proposals": [one.report() for one in self.proposals],
        }


def pareto_front(judged: list[JudgedLayout]) -> list[JudgedLayout]:
    """Return the layouts on the Pareto front of panel count and RMS distance from the target, fewest panels first."""
    found: list[JudgedLayout] = []
    for one in sorted(judged, key=lambda one: (one.laid.panels, one.eased, one.laid.joints)):
        if not found or one.eased < found[-1].eased:
            found.append(one)
    return found


def select_proposals(made: list[Proposal], best: Proposal) -> list[Proposal]:
    """Return the proposals worth showing, fewest panels first.

    These are the chosen and the initial layout, the symmetric layout nearest to the target, and steps along the Pareto
    front of panel count and distance from the target. Further proposals are added only up to ``MIN_PROPOSALS``.
    Proposals whose displayed figures are equal appear once; the initial layout always appears.

    Parameters
    ----------
    made : all proposals, best first
    best : the chosen proposal
    """
    given = [one for one in made if one.judged.laid.origin == INITIAL_ORIGIN]
    symmetric = sorted((one for one in made if one.symmetric), key=lambda one: one.rms)[:1]
    nearest = {id(one) for one in pareto_front([one.judged for one in made])}
    steps = sorted((one for one in made if id(one.judged) in nearest), key=lambda one: one.panels)
    way = steps[:1]
    while way and way[-1] is not steps[-1]:
        following = [one for one in steps if one.panels > way[-1].panels]
        near = [one for one in following if one.panels <= MAX_PANEL_STEP * way[-1].panels]
        way.append(near[-1] if near else following[0])
    chosen: list[Proposal] = []
    # always show the initial layout, so that users can return to it
    for one in dict.fromkeys((best, *given, *way, *symmetric, *made)):
        wanted = len(chosen) < (MAX_PROPOSALS if one in way or one in symmetric else MIN_PROPOSALS)
        if one in given or (wanted and not any(_visible_figures(one) == _visible_figures(other) for other in chosen)):
            chosen.append(one)
    return sorted(chosen, key=lambda one: (one.panels, one.judged.laid.joints, one.rms))


def _visible_figures(one: Proposal) -> tuple[float | str, ...]:
    """Return the displayed figures of a proposal: panels, joints, rounded distance from the target, sheets."""
    return one.panels, one.judged.laid.joints, f"{100.0 * one.rms:.1g}", one.sheets
