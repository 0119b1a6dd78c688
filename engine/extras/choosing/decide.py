"""Decision among the judged layouts: the best one, the proposals to show, and the note to users."""

from __future__ import annotations

from dataclasses import replace

from ...surface.checking.finding import with_count
from .choice import INITIAL_ORIGIN, Choice, Proposal, make_proposal, select_proposals
from .judge import FULL_SHARE, LONG_SHARE, FlatLayout, JudgedLayout
from .layout_search import LONG_TO_SHORT_RATIO, SEARCH_SCATTER, LayoutSearch, describe_layout, layout_key
from .prospects import WORTHWHILE_RATIO

# Largest ratio of two layouts' distances from the target at which the farther layout is preferred if it has fewer
# joints. Larger: fewer joints, larger distances. Keep it above 1.03, because two searches of one layout differ by up to
# 3 %. For the goal "match" (fewest joints within a distance), 1 / WORTHWHILE_RATIO takes its place.
NEAR_TIE_RATIO = 1.05


def decide(search: LayoutSearch, first: FlatLayout, finished: bool) -> Choice:
    """Choose the best of all judged layouts, and the proposals to show beside it.

    Parameters
    ----------
    search : state of the search, with all judged layouts
    first : the initial layout
    finished : False if the user cancelled
    """
    settings = search.piece.settings
    judged = [one if one.share else replace(one, rms=search.distance(one)) for one in search.ranking]
    search.expected = 1.0
    drawn_one = next((one for one in judged if one.cut_length is not None), None)
    # seams hardly change the length of cuts, so predicted layouts get that of a layout whose outlines were computed
    if drawn_one is not None:
        judged = [
            one if one.share else replace(one, cut_length=drawn_one.cut_length, contours=drawn_one.contours)
            for one in judged
        ]
    best = pick_best(search, judged, first)
    made = {id(one): make_proposal(one, settings, settings.material.chosen) for one in judged}
    shown = select_proposals([made[id(one)] for one in judged], made[id(best)])
    reached = search.holds(best)
    given = next((one for one in made.values() if one.judged.laid.origin == INITIAL_ORIGIN), None)
    return Choice(
        tuple(shown),
        shown.index(made[id(best)]),
        search.params.goal,
        reached,
        _explain_choice(search, made[id(best)], given, reached),
        finished,
        len(search.known),
    )


def pick_best(search: LayoutSearch, judged: list[JudgedLayout], first: FlatLayout) -> JudgedLayout:
    """Return the best layout.

    If the first searched layout meets a goal other than a number of panels, it is the best. Otherwise one with fewer
    joints is preferred to one that is slightly nearer to the target; if the goal is a number of panels, only the
    initial layout is preferred in this way. An initial layout that was optimised then stays unless another one is
    clearly nearer to the target, or alone meets the goal.

    Parameters
    ----------
    search : state of the search, with the goal and the expected distances
    judged : all judged layouts, best first
    first : the initial layout
    """
    # a prediction may be too good, so layouts that were searched come first
    best = next((one for one in judged if one.share), judged[0])
    if search.params.goal != "panels" and search.holds(best):
        return best
    given = next((one for one in judged if layout_key(one.laid) == layout_key(first)), None)
    enough = 1.0 / WORTHWHILE_RATIO if search.params.goal == "match" else NEAR_TIE_RATIO
    alike = [
        one for one in judged if one.share >= LONG_SHARE and search.distance(one) <= enough * search.distance(best)
    ]
    if search.params.near:
        alike = []
    elif search.params.goal == "panels":
        alike = [given] if given is not None and search.holds(given) and given in alike else []
    alike.append(best)
    if given is not None and given.share >= FULL_SHARE and search.holds(given) == search.holds(best):
        alike = [one for one in alike if one is given or (1.0 + SEARCH_SCATTER) * one.eased < given.rms] or [given]
    return min(alike, key=lambda one: (one.laid.joints, one.laid.panels))


def may_replace_initial(search: LayoutSearch, one: JudgedLayout) -> bool:
    """Return whether a layout would replace the initial one if a search reached its expected distance.

    Also true if the initial layout was not optimised before.

    Parameters
    ----------
    search : state of the search
    one : the judged layout
    """
    given = next((other for other in search.proved.values() if other.share >= FULL_SHARE), None)
    if given is None:
        return True
    expected = replace(one, rms=search.distance(one), strain=0.0, share=max(one.share, LONG_SHARE))
    return pick_best(search, sorted((given, expected), key=search.key), given.laid) is expected


def _explain_choice(search: LayoutSearch, best: Proposal, given: Proposal | None, reached: bool) -> str:
    """Return a sentence that explains the choice of the best layout, or why the goal was missed."""
    what = describe_layout(best.judged.laid, best.rms)
    if given is not None and given is not best:
        what += f" (before: {describe_layout(given.judged.laid, given.rms)})"
    if search.params.near and search.params.goal == "match":
        asked = "a nearer match by other cuts"
    elif search.params.goal == "panels":
        asked = f"no more than {with_count(search.params.panels, 'panel', 'panels')}"
    elif search.params.goal == "match":
        asked = f"a match of {search.params.match:g} %"
    else:
        asked = "the present match with less work"
    if reached:
        return f"Chosen for {asked}: {what}."
    if search.params.near and given is not None and best.rms < given.rms:
        return f"Changed for {asked}: {what}."
    if given is best and best.judged.share >= FULL_SHARE:
        searched = any(0.0 < one.share < FULL_SHARE for one in search.ranking)
        verb = "comes" if searched else "is expected to come"
        return f"No other layout {verb} clearly nearer than the present one, with {what}. {best.judged.advice}"
    return f"No layout was found for {asked}; the best has {what}. {_panels_bring_no_gain(search, best.judged)}{best.judged.advice}"


def _panels_bring_no_gain(search: LayoutSearch, best: JudgedLayout) -> str:
    """Return a sentence with a trailing space if searches show that more panels bring no gain; else ""."""
    searched = [one for one in search.ranking if one.share]
    most = max(searched, key=lambda one: one.laid.panels, default=best)
    left = most.rms if most.share >= LONG_SHARE else LONG_TO_SHORT_RATIO * most.rms
    if search.params.goal != "match" or most.laid.panels <= best.laid.panels or left < best.rms:
        return ""
    return f"Up to {most.laid.panels} panels bring it no nearer. "
