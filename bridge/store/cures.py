"""Cures: buttons beside a notice that remove its cause, each an operator with properties and a label.

``api.press`` and the option ``--cure`` of the command line's ``next`` press a cure by its name.
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

# code of a finding that ``flexmaps.mend`` can repair -> kind of repair, label of the button
REPAIRS = {
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
# label for several faces -> label for one face
SINGULAR = {
    "Dissolve {} faces": "Dissolve {} face",
    "Delete {} faces": "Delete {} face",
    "Turn {} faces": "Turn {} face",
}
# factors on the number of quads for a coarser remesh where spirals lack room, in the order of trying; smaller factors
# give larger quads
COARSER_FACTORS = (0.6, 0.3)
FINER_FACTORS = (2, 4)  # factors on the number of quads for another try after a remesh failed
MIN_QUADS = 50  # number of quads below which a remesh is offered; larger offers it more often
FOLDS_CODE = "sharp-folds"  # code of the finding whose button also shows a radius
# kinds of repair: value, name, tooltip
REPAIR_KINDS = (
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
    """Button of a notice: label in the interface's language (without "Next:"), operator, operator's properties."""

    label: str
    idname: str
    properties: dict[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Return the name on the command line, such as "make_larger" or, with the kind of repair, "mend-normals"."""
        short = self.idname.partition(".")[2]
        kind = self.properties.get("what") or self.properties.get("where")
        return f"{short}-{kind}" if kind else short

    @property
    def call(self) -> str:
        """Return the Python call of the operator, for reports and scripts."""
        arguments = ", ".join(f"{key}={value!r}" for key, value in self.properties.items())
        return f"bpy.ops.{self.idname}({arguments})"


def repair(code: str, count: int) -> Cure | None:
    """Return the button that repairs a finding of the mesh check; None where it cannot be repaired automatically.

    Parameters
    ----------
    code : code of the finding
    count : number of faces (or edges) for the label
    """
    if code not in REPAIRS:
        return None
    what, words = REPAIRS[code]
    return Cure(interface(SINGULAR.get(words, words) if count == 1 else words, count), "flexmaps.mend", {"what": what})


def round_folds(percent: float | None = None, edge: float | None = None) -> Cure:
    """Return the button that rounds sharp folds.

    Parameters
    ----------
    percent : predicted RMS distance from the target in percent of the size, if known
    edge : quad edge in metres, to show the radius on the button
    """
    from ...engine.surface.checking.folds import min_bend_radius  # imported here because it imports scipy

    words = (
        interface("Round the folds") if edge is None else interface("Round to {:.0f} mm", 1e3 * min_bend_radius(edge))
    )
    return Cure(_with_percent(words, percent), "flexmaps.mend", {"what": "round"})


def coarser_counts(quads: int) -> list[int]:
    """Return smaller numbers of quads to remesh to, rounded to tens or hundreds; none below ``MIN_QUADS``."""
    wanted = [round(share * quads, -2 if share * quads >= 200 else -1) for share in COARSER_FACTORS]
    return [int(n) for n in wanted if n >= MIN_QUADS]


def retry_counts(quads: int) -> list[int]:
    """Return numbers of quads to try after a remesh failed: first more quads, which resolve small parts, then fewer."""
    return [*(round(times * quads, -1) for times in FINER_FACTORS), *coarser_counts(quads)[:1]]


def remesh(quads: int) -> Cure:
    """Return the button that remeshes to about this number of quads."""
    return Cure(interface("Remesh to {}", quads), "flexmaps.quad_remesh", {"quads": quads})


def enlarge(times: float) -> Cure:
    """Return the button that enlarges the piece by a factor."""
    return Cure(interface("Larger: {:g} x", times), "flexmaps.set_size", {"times": times})


def regularise() -> Cure:
    """Return the button that makes the quads squarer."""
    return Cure(interface("Squarer quads"), "flexmaps.regularise")


def hold(where: str, setting: str = "supports", percent: float | None = None) -> Cure:
    """Return the button that holds the lowest quads or the border, or clears the setting of a vertex group.

    Parameters
    ----------
    where : "lowest", "border" or "nothing"
    setting : "supports" or "pulled": setting of the vertex group to clear
    percent : predicted RMS distance from the target in percent of the size, if known
    """
    all_words = {
        "lowest": interface("Stand on lowest"),
        "border": interface("Hold the border"),
        "nothing": interface("Choose none"),
    }
    words = all_words[where]
    return Cure(_with_percent(words, percent), "flexmaps.stand_on", {"where": where, "setting": setting})


def choose_folder(stage: str) -> Cure:
    """Return the button that asks for another export folder and writes there; ``stage``: idname of the operator."""
    return Cure(interface("Choose a folder"), "flexmaps.choose_folder", {"stage": stage})


def cut_there(percent: float | None = None) -> Cure:
    """Return the button that adds cuts where they bring the shape nearer to its target; ``percent`` as in ``hold``."""
    return Cure(_with_percent(interface("Cut there"), percent), "flexmaps.cut_there")


def choose() -> list[Cure]:
    """Return a list with the button that compares layouts by their simulated shapes; empty if that extra is missing."""
    return [Cure(interface("Propose layouts"), "flexmaps.choose")] if registry.has("choosing") else []


def improve_match(choose_settings: bpy.types.PropertyGroup, blocks: dict[str, Any]) -> list[Cure]:
    """Return buttons that bring an optimised piece nearer to its target, best first.

    Short searches have predicted the RMS distance after each remedy. *Propose layouts* has no prediction; the wanted
    RMS distance gives its rank.

    Parameters
    ----------
    choose_settings : settings of *Choose*, with the wanted RMS distance
    blocks : the stored report blocks that are up to date
    """
    prospects = sorted(blocks.get("reach", {}).get("prospects", {}).items(), key=lambda one: one[1])
    if not registry.has("choosing"):
        prospects = [(name, percent) for name, percent in prospects if name != "cut"]
    made = {"cut": cut_there, "round": round_folds}
    ways = [
        (percent, made[name](percent) if name in made else hold(name, percent=percent)) for name, percent in prospects
    ]
    if "optimise" in blocks and "choose" not in blocks and choose_settings.goal == "match":
        ways += [(choose_settings.match, way) for way in choose()]
    return [way for _, way in sorted(ways, key=lambda one: one[0])]


def _with_percent(words: str, percent: float | None) -> str:
    return words if percent is None else interface("{}: {} %", words, format_figure(percent))


def dismiss(key: str) -> Cure:
    """Return the button that dismisses the notice with this key, so that *Next* goes on."""
    return Cure(interface("Go on as it is"), "flexmaps.let_go", {"key": key})


def apply_remedy(name: str, amount: float | None) -> Cure:
    """Return the button that applies a remedy advised by the optimiser.

    Parameters
    ----------
    name : name of the remedy, see ``engine/optimisation/remedies.py``
    amount : factor of the size, thickness in mm, or number of quads; None for a cut
    """
    if name == remedies.LARGER:
        return Cure(interface("Larger: {:g} x", amount), "flexmaps.make_larger")
    if name == remedies.THINNER:
        return Cure(interface("Sheet of {:g} mm", amount), "flexmaps.make_thinner")
    if name == remedies.FINER:
        return Cure(interface("Finer: {:.0f} quads", amount), "flexmaps.make_finer")
    return cut_there()
