"""Cures: the buttons beside a notice, each an operator with its properties and a label.

``api`` has a function, and the command line a ``--cure``, of the same name for each.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ...engine.extras import registry
from ...engine.figures import format_figure
from ...engine.optimisation import remedies
from .i18n import interface

if TYPE_CHECKING:
    import bpy

# findings of the check that one press repairs -> kind for ``flexmaps.mend``, label of the button
MENDS = {
    "zero-edge": ("short-edges", "Merge {}"),
    "repeated-vertex": ("short-edges", "Merge {}"),
    "doubled-vertices": ("doubles", "Merge them"),
    "doubled-faces": ("double-shells", "Delete one"),
    "double-skin": ("skins", "Keep the outer skin"),
    "zero-area": ("thin-faces", "Dissolve {} faces"),
    "duplicate-faces": ("double-faces", "Delete {} faces"),
    "folded": ("folds", "Delete {} faces"),
    "inconsistent-orientation": ("normals", "Turn {} faces"),
    "inside-out": ("outside", "Turn {} faces"),
    "loose-vertices": ("loose", "Delete loose parts"),
    "far-vertices": ("far", "Delete {} faces"),
    "not-finite": ("not-finite", "Delete {} faces"),
    "non-manifold-vertex": ("fans", "Split vertices"),
    "non-manifold-edge": ("walls", "Split edges"),
    "non-orientable": ("one-sided", "Cut it open"),
}
# labels for one face in place of several
ONE = {
    "Dissolve {} faces": "Dissolve {} face",
    "Delete {} faces": "Delete {} face",
    "Turn {} faces": "Turn {} face",
}
# shares of the present number of quads to remesh to, in this order, where spirals lack room; fewer quads are larger
FEWER = (0.6, 0.3)
MORE = (2, 4)  # factors on the number of quads where a remesh found none
LEAST_QUADS = 50  # below this a piece is a toy, and a remesh is offered first
FOLDS = "sharp-folds"  # finding whose button also names a radius
# kinds of repair: value, name, tooltip
MENDING = (
    ("short-edges", "Merge vertices", "Merge vertices that lie in one place"),
    ("doubles", "Merge doubled vertices", "Merge vertices of the border that lie in one place"),
    ("double-shells", "Delete doubled shells", "Delete one of two shells that lie on each other"),
    ("skins", "Keep the outer skin", "Delete the inner skin and the rim of a thin closed shell"),
    ("thin-faces", "Dissolve faces without area", "Dissolve faces that have no area"),
    ("double-faces", "Delete doubled faces", "Delete faces on the same vertices as another one"),
    ("folds", "Delete folded faces", "Delete one of two faces that lie on each other"),
    ("normals", "Turn faces", "Turn faces that look to the other side than their neighbours"),
    ("outside", "Turn bodies", "Turn closed bodies whose faces look inwards"),
    ("loose", "Delete loose parts", "Delete vertices and edges that belong to no face"),
    ("far", "Delete far faces", "Delete faces that lie nowhere near the others"),
    ("not-finite", "Delete lost faces", "Delete faces with coordinates that are not numbers"),
    ("fans", "Split vertices", "Split vertices at which faces touch that share no edge"),
    ("walls", "Split edges", "Split edges of three or more faces"),
    ("one-sided", "Cut it open", "Cut a body with only one side open"),
    ("round", "Round folds", "Draw vertices at sharp edges to their neighbours until spirals can bend there"),
)


@dataclass(frozen=True)
class Cure:
    """A button: its label without *Next* in the interface's language, its operator, and the operator's properties."""

    label: str
    idname: str
    properties: dict[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Return the name on the command line, such as "make_larger", or "mend-normals" if the operator has kinds."""
        short = self.idname.partition(".")[2]
        kind = self.properties.get("what") or self.properties.get("where")
        return f"{short}-{kind}" if kind else short

    @property
    def call(self) -> str:
        """Return the Python call of the operator, for reports and scripts."""
        arguments = ", ".join(f"{key}={value!r}" for key, value in self.properties.items())
        return f"bpy.ops.{self.idname}({arguments})"


def mend(code: str, count: int) -> Cure | None:
    """Return the cure of a finding of the check; None where only a person can repair it."""
    if code not in MENDS:
        return None
    what, words = MENDS[code]
    return Cure(interface(ONE.get(words, words) if count == 1 else words, count), "flexmaps.mend", {"what": what})


def round_folds(percent: float | None = None, edge: float | None = None) -> Cure:
    """Return the cure that rounds folds, with its radius where the quad edge in metres is given; ``percent`` as in ``hold``."""
    from ...engine.surface.checking.folds import radius  # scipy comes with it

    words = interface("Round the folds") if edge is None else interface("Round to {:.0f} mm", 1e3 * radius(edge))
    return Cure(_with_percent(words, percent), "flexmaps.mend", {"what": "round"})


def fewer(quads: int) -> list[int]:
    """Return smaller numbers of quads to try, rounded to tens or hundreds."""
    wanted = [round(share * quads, -2 if share * quads >= 200 else -1) for share in FEWER]
    return [int(n) for n in wanted if n >= LEAST_QUADS]


def other_counts(quads: int) -> list[int]:
    """Return numbers of quads to try where a remesh found none: more, to give small parts room, then fewer."""
    return [*(round(times * quads, -1) for times in MORE), *fewer(quads)[:1]]


def remesh(quads: int) -> Cure:
    """Return the cure that remeshes to about so many quads."""
    return Cure(interface("Remesh to {}", quads), "flexmaps.quad_remesh", {"quads": quads})


def larger(times: float) -> Cure:
    """Return the cure that enlarges the piece by a factor."""
    return Cure(interface("Larger: {:g} x", times), "flexmaps.set_size", {"times": times})


def regularise() -> Cure:
    """Return the cure that makes the quads squarer."""
    return Cure(interface("Squarer quads"), "flexmaps.regularise")


def hold(where: str, setting: str = "supports", percent: float | None = None) -> Cure:
    """Return the cure that lets the piece stand on its lowest quads, holds its border, or clears a vertex group.

    Parameters
    ----------
    where : "lowest", "border" or "nothing"
    setting : "supports" or "pulled", the group to clear
    percent : predicted RMS distance from the target in percent of the size, if known
    """
    all_words = {
        "lowest": interface("Stand on lowest"),
        "border": interface("Hold the border"),
        "nothing": interface("Choose none"),
    }
    words = all_words[where]
    return Cure(_with_percent(words, percent), "flexmaps.stand_on", {"where": where, "setting": setting})


def cut_there(percent: float | None = None) -> Cure:
    """Return the cure that adds cuts where the shape limits the match; ``percent`` as in ``hold``."""
    return Cure(_with_percent(interface("Cut there"), percent), "flexmaps.cut_there")


def choose() -> list[Cure]:
    """Return the cure that compares many layouts by the shape that their panels take; none where that is missing."""
    return [Cure(interface("Propose layouts"), "flexmaps.choose")] if registry.has("choosing") else []


def nearer(wanted: bpy.types.PropertyGroup, blocks: dict[str, Any]) -> list[Cure]:
    """Return cures that bring an optimised piece nearer to its target: remedies tried by short searches, and other layouts.

    Sorted by predicted distance; other layouts, without a prediction, rank at the wanted match.

    Parameters
    ----------
    wanted : settings of the layout's choice
    blocks : the up-to-date notes
    """
    prospects = sorted(blocks.get("reach", {}).get("prospects", {}).items(), key=lambda one: one[1])
    if not registry.has("choosing"):
        prospects = [(name, percent) for name, percent in prospects if name != "cut"]
    made = {"cut": cut_there, "round": round_folds}
    ways = [
        (percent, made[name](percent) if name in made else hold(name, percent=percent)) for name, percent in prospects
    ]
    if "optimise" in blocks and "choose" not in blocks and wanted.goal == "match":
        ways += [(wanted.match, way) for way in choose()]
    return [way for _, way in sorted(ways, key=lambda one: one[0])]


def _with_percent(words: str, percent: float | None) -> str:
    return words if percent is None else interface("{}: {} %", words, format_figure(percent))


def let_go(key: str) -> Cure:
    """Return the cure that dismisses a notice, so that *Next* goes on."""
    return Cure(interface("Go on as it is"), "flexmaps.let_go", {"key": key})


def remedy(name: str, amount: float | None) -> Cure:
    """Return the cure for a remedy of the optimiser, see ``engine/optimisation/remedies.py``."""
    if name == remedies.LARGER:
        return Cure(interface("Larger: {:g} x", amount), "flexmaps.make_larger")
    if name == remedies.THINNER:
        return Cure(interface("Sheet of {:g} mm", amount), "flexmaps.make_thinner")
    if name == remedies.FINER:
        return Cure(interface("Finer: {:.0f} quads", amount), "flexmaps.make_finer")
    return cut_there()
