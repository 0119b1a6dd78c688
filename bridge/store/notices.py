"""Notices about an object: a short label, a sentence, the faces and edges concerned, and buttons (cures) that help.

They are built from stored results alone, fast enough for every redraw. ``list_notices`` returns them in display order:
what stops a stage, what breaks the piece, what makes it worse, then information.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy

from ...engine.figures import format_length
from ...engine.materials import OVERSTRAIN_SHARE
from ...engine.optimisation import remedies
from . import cures, failures, flat_target, modifiers, objects, remesh_source, states, stored_report
from .columns import column
from .cures import Cure
from .dimensions import quad_edge
from .finding_words import BREAKS, FAILURE_LABELS, INFORMATION, LABELS, SEVERITIES, STOPS, WARNING_LABELS, WORSE
from .i18n import interface, quads, translate
from .notice import Notice
from .shape_notices import REMEDIES, advised_remedies, from_equilibrium

FIXED_BY_REGULARISE = {"concave", "warped", "thin"}  # codes of findings that Regularise can remove
# codes of findings that a remesh can remove
FIXED_BY_REMESH = {"non-quad", "crossed", "zero-area", "size-ratio", "non-manifold-edge", "repeated-vertex"}
# factor of enlargement offered where spirals lack room; larger gives more room and a larger piece. Within the range of
# the remedies' factors, not measured
ENLARGEMENT = 1.5
# keys of notices that only predict a problem, from the mesh or the layout
PREDICTIONS = (
    "checks/size-ratio",
    "checks/small-quads",
    "checks/concave",
    "checks/warped",
    "checks/thin",
    "layout/remarks",
)
TOO_SMALL = "layout/too-small"  # key of the notice: even the softest spirals would be strained too much
SHARED = "shared"  # key of the notice about a mesh that several objects use
FEW_QUADS = "quads-kept"  # key of the notice about few quads, which the user may keep


def list_notices(
    obj: bpy.types.Object, scene: bpy.types.Scene, stage_states: dict[str, states.StageState]
) -> list[Notice]:
    """Return all notices of an object, worst first; ``stage_states``: states of its stages from ``read_states``."""
    problem = objects.surface_problem(obj, scene)
    if problem is not None:  # no other notice about the object can be cured
        return [Notice("surface/none", *problem, STOPS)]
    blocks = states.current_blocks(obj, stage_states)
    result = [
        *_from_failures(obj, failures.read(obj, scene)),
        *_from_checks(obj, scene, blocks.get("checks", ())),
        *_few_quads(obj),
        *_ignored_modifiers(obj),
        *_missing_groups(obj),
        *_shared_mesh(obj, scene, stage_states),
        *_existing_seams(obj, stage_states["layout"].kind),
        *_too_small(obj, scene, blocks),
        *from_equilibrium(obj, blocks),
        *_from_findings("structure", blocks.get("structure", {}).get("findings", ())),
        *_flat_target(obj),
        *(
            one
            for name in WARNING_LABELS
            for one in _from_warnings(name, blocks, is_held=bool(obj.flexmaps.loads.supports))
        ),
    ]
    seen = [_downgrade_dismissed(obj.data, notice) for notice in _downgrade_predictions(obj, blocks, result)]
    return sorted(seen, key=lambda notice: SEVERITIES.index(notice.severity))


def _downgrade_predictions(obj: bpy.types.Object, blocks: dict[str, Any], result: list[Notice]) -> list[Notice]:
    """Downgrade predictions to information if the target is flat or the simulated shape near it, and nothing breaks."""
    percent = blocks.get("equilibrium", {}).get("rms_percent")
    near = percent is not None and percent <= remedies.wanted_percent(obj.flexmaps.choose)
    flat = "spirals" in blocks and flat_target.can_skip_simulation(obj)
    if not (near or flat) or any(one.severity == BREAKS for one in result if one.key.startswith("equilibrium/")):
        return result
    return [
        replace(one, severity=INFORMATION) if one.key in PREDICTIONS and one.severity == WORSE else one
        for one in result
    ]


def _downgrade_dismissed(mesh: bpy.types.Mesh, notice: Notice) -> Notice:
    """Downgrade a notice to information if the user dismissed it."""
    if notice.severity == INFORMATION or not failures.is_dismissed(mesh, notice.key, notice.sentence):
        return notice
    return replace(notice, severity=INFORMATION, cures=())


# -- one function for each source of notices ---------------------------------------------------------------------------


def _from_failures(obj: bpy.types.Object, failed: dict[str, dict[str, Any]]) -> list[Notice]:
    result = []
    for idname, failure in failed.items():
        faces, edges = tuple(failure["faces"]), tuple(failure["edges"])
        words = interface(FAILURE_LABELS.get(idname, "Stopped"), quads(len(faces)))
        ways = tuple(_cures_of_failure(obj, idname, failure.get("quads")))
        if failure.get("folder"):
            ways = (cures.choose_folder(idname),)
        result.append(Notice(f"failed/{idname}", words, failure["message"], STOPS, faces, edges, ways))
    return result


def _cures_of_failure(obj: bpy.types.Object, idname: str, suggested_quads: int | None = None) -> list[Cure]:
    """Return buttons that help after a stage failed; its error may suggest a number of quads."""
    quads, key = len(obj.data.polygons), f"failed/{idname}"
    if idname in {"flexmaps.spirals", "flexmaps.fit"}:
        return [
            *(cures.remesh(n) for n in dict.fromkeys([*filter(None, [suggested_quads]), *cures.coarser_counts(quads)])),
            cures.enlarge(ENLARGEMENT),
        ]
    if idname in {"flexmaps.simulate", "flexmaps.optimise", "flexmaps.regularise"}:
        return [cures.dismiss(key)]
    if idname in {"flexmaps.merge", "flexmaps.update_from_seams"}:
        return [cures.remesh(n) for n in cures.coarser_counts(quads)]
    if idname == "flexmaps.flatten":
        return [
            Cure(interface("Lay out anew"), "flexmaps.merge"),
            *(cures.remesh(n) for n in cures.coarser_counts(quads)),
        ]
    if idname == "flexmaps.quad_remesh":
        return [
            cures.remesh(n)
            for n in ([suggested_quads] if suggested_quads else cures.retry_counts(obj.flexmaps.remesh.quads))
        ]
    return []


def _from_checks(obj: bpy.types.Object, scene: bpy.types.Scene, findings: list[dict[str, Any]]) -> list[Notice]:
    made, helpless = [], states.is_side_result_current(obj, scene, "regularise")
    for row in findings:
        code, faces, edges = row["code"], tuple(row["faces"]), tuple(row.get("edges", ()))
        words, kind = LABELS.get(code, ("To look at", WORSE))
        kind = STOPS if row["severity"] == "error" else kind
        cure = cures.repair(code, len(edges) if code == "zero-edge" else len(faces))
        ways = [] if cure is None else [cure]
        if code == cures.FOLDS_CODE:
            ways.append(cures.round_folds(edge=quad_edge(obj, scene)))
        if code in FIXED_BY_REGULARISE and not helpless:
            ways.append(cures.regularise())
        if larger := row.get("larger"):
            ways += [cures.enlarge(larger)] if larger <= remedies.MAX_FACTOR else []
            ways += [cures.remesh(n) for n in cures.coarser_counts(len(obj.data.polygons))[:1]]
        if code == "t-junction" and remesh_source.SOURCE not in obj:  # another remesh would leave other T-junctions
            ways.append(cures.remesh(obj.flexmaps.remesh.quads))
        if code in FIXED_BY_REMESH or code in FIXED_BY_REGULARISE or code == "surface-missed":
            from ...engine.surface.remeshing.coverage import (
                suggest_finer_count,  # imported here because it imports scipy
            )

            # a remesh to the same number of quads would give the same quads
            again = code == "surface-missed" or remesh_source.SOURCE in obj
            ways.append(
                cures.remesh(suggest_finer_count(len(obj.data.polygons)) if again else obj.flexmaps.remesh.quads)
            )
        if kind not in (STOPS, INFORMATION):  # information does not block *Next*, so it need not be dismissed
            ways.append(cures.dismiss(f"checks/{code}"))
        label = interface(words, len(edges if code == cures.FOLDS_CODE else faces))
        made.append(Notice(f"checks/{code}", label, row["message"], kind, faces, edges, tuple(ways)))
    return made


def is_coarse(obj: bpy.types.Object) -> bool:
    """Return whether a mesh has fewer quads than ``MIN_QUADS``, and no remesh made them on request."""
    count = len(obj.data.polygons)
    return count < cures.MIN_QUADS and len(obj.data.loops) == 4 * count and remesh_source.SOURCE not in obj


def _few_quads(obj: bpy.types.Object) -> list[Notice]:
    """Warn of a mesh of few quads, unless modifiers change its faces."""
    if not is_coarse(obj) or objects.modifier_problem(obj):
        return []
    count = len(obj.data.polygons)
    text = (
        "{} quad makes a coarse piece: every quad becomes one spiral"
        if count == 1
        else "{} quads make a coarse piece: every quad becomes one spiral"
    )
    sentence = translate(text, count)
    ways = (
        cures.remesh(obj.flexmaps.remesh.quads),
        Cure(interface("Keep these quads"), "flexmaps.let_go", {"key": FEW_QUADS}),
    )
    return [Notice(FEW_QUADS, interface("Only {}", quads(count)), sentence, WORSE, cures=ways)]


def _ignored_modifiers(obj: bpy.types.Object) -> list[Notice]:
    """Report modifiers that are ignored when the surface is read, or were ignored at the last reading."""
    text = modifiers.describe_ignored(obj) or modifiers.read_note(obj.data)
    return [Notice("left-out", interface("Modifier left out"), text, INFORMATION)] if text else []


def _missing_groups(obj: bpy.types.Object) -> list[Notice]:
    """Report vertex groups that the settings name but the object lacks."""
    result = []
    for setting, what in (("supports", "Supports"), ("pulled", "Pulled")):
        name = getattr(obj.flexmaps.loads, setting)
        if name and name not in obj.vertex_groups:
            sentence = translate("The vertex group '{}' under {} is gone: choose another one", name, interface(what))
            ways = (
                [cures.hold("nothing", setting)]
                if setting == "pulled"
                else [cures.hold("lowest"), cures.hold("nothing")]
            )
            result.append(Notice(f"loads/{setting}", interface("Group is gone"), sentence, STOPS, cures=tuple(ways)))
    return result


def _shared_mesh(
    obj: bpy.types.Object, scene: bpy.types.Scene, stage_states: dict[str, states.StageState]
) -> list[Notice]:
    """Report other objects that use the mesh, and warn where a stage of this object would replace their results."""
    others = objects.other_users(obj)
    if not others:
        return []
    own, label = Cure(interface("Own mesh"), "flexmaps.own_mesh"), interface("Shared mesh")
    if not states.has_results_of_another(obj, scene, stage_states):
        sentence = translate("The mesh is shared with {}: seams and results are common to all", others)
        return [Notice(SHARED, label, sentence, INFORMATION, cures=(own,))]
    sentence = translate(
        "The mesh is shared with {}, and its results belong to that size and those settings: '{}' would replace them. Give '{}' its own mesh",
        others,
        obj.name,
        obj.name,
    )
    return [Notice(SHARED, label, sentence, WORSE, cures=(own, cures.dismiss(SHARED)))]


def _existing_seams(obj: bpy.types.Object, layout: str) -> list[Notice]:
    """Report seams that the mesh had before the first layout."""
    if layout != states.TODO or not has_seams(obj.data):
        return []
    sentence = translate(
        "The mesh has seams already: they can be the borders of the panels, or are replaced by a layout made anew"
    )
    ways = Cure(interface("Use these seams"), "flexmaps.flatten"), Cure(interface("Lay out anew"), "flexmaps.merge")
    return [Notice("layout/seams", interface("Has seams"), sentence, INFORMATION, cures=ways)]


def has_seams(mesh: bpy.types.Mesh) -> bool:
    """Return whether any edge is a seam."""
    return bool(column(mesh.edges, "use_seam").any())


def _flat_target(obj: bpy.types.Object) -> list[Notice]:
    if not flat_target.can_skip_simulation(obj):
        return []
    sentence = translate("The target is flat: its spirals are straight, and there is nothing to simulate or search for")
    return [Notice("layout/flat", interface("Flat target"), sentence, INFORMATION)]


def _too_small(obj: bpy.types.Object, scene: bpy.types.Scene, blocks: dict[str, Any]) -> list[Notice]:
    """Warn if the layout's forecast predicts too much strain even for the softest spirals; only before a simulation."""
    strain = blocks.get("layout", {}).get("strain_softest")
    if strain is None or {"equilibrium", "optimise"} & stored_report.read(obj.data).keys():
        return []
    if not states.is_side_result_current(obj, scene, "forecast"):
        return []
    sentence = translate(
        "Quads of {} are too small for the bends of this surface: even with the softest spirals everywhere, arms would be strained to "
        "{:.0f} % of the material's limit ({:.0f} % is allowed). Make the piece larger, or take a thinner sheet and press Lay out the panels again",
        format_length(quad_edge(obj, scene)),
        100.0 * strain,
        100.0 * OVERSTRAIN_SHARE,
    )
    ways = [] if any(obj.lock_scale) else [cures.enlarge(remedies.size_of_softest(strain))]
    return [
        Notice(TOO_SMALL, interface("Too small to bend"), sentence, BREAKS, cures=(*ways, cures.dismiss(TOO_SMALL)))
    ]


def _from_findings(source: str, findings: list[dict[str, Any]]) -> list[Notice]:
    made = []
    for row in findings:
        words, kind = LABELS.get(row["code"], ("To look at", WORSE))
        key, faces = f"{source}/{row['code']}", tuple(row["faces"])
        made.append(Notice(key, interface(words, len(faces)), row["message"], kind, faces, (), (cures.dismiss(key),)))
    return made


def _describe_halved(text: str, blocks: dict[str, Any], is_held: bool) -> str:
    """Return the text about a seam that was added so that a panel can bend; after a simulation, whether it helped.

    Parameters
    ----------
    text : text of the layout
    blocks : the stored report blocks that are up to date
    is_held : whether supports hold the piece
    """
    if is_held:
        return translate(
            "The surface was cut once more so that it rises into its shape. Now supports hold it: press Lay out the panels again to have it in one panel"
        )
    if any(row["code"] == "stays-flat" for row in blocks.get("equilibrium", {}).get("findings", ())):
        return translate(
            "The surface was cut once more so that it rises into its shape, but it stays flat. Hold it with supports (Rests, in Piece), then press Lay out the panels again to have it in one panel"
        )
    return text


def _from_warnings(source: str, blocks: dict[str, Any], *, is_held: bool = False) -> list[Notice]:
    """Return the warnings of a report block as a notice with cures; for a layout, also a notice about a further cut.

    Parameters
    ----------
    source : name of the report block
    blocks : the stored report blocks that are up to date
    is_held : whether supports hold the piece
    """
    rows, one, more = WARNING_LABELS[source]
    block, key = blocks.get(source, {}), f"{source}/{rows}"
    halved = block.get("halved")  # text about a seam added so that a panel can leave the plane; not a warning
    plain = []
    if halved:
        text = _describe_halved(halved, blocks, is_held)
        plain.append(Notice("layout/halved", interface("Cut once more"), text, INFORMATION))
    lines = [sentence for sentence in block.get(rows, ()) if sentence != halved]
    if not lines:
        return plain
    ways = []
    if source == "layout" and "choose" not in blocks:
        ways = cures.choose()
    elif source == "assembly":  # a larger piece or a thinner sheet needs less force at the joints
        advised = advised_remedies(blocks)
        ways = [cures.apply_remedy(name, advised[name]) for name in REMEDIES["strained"] if name in advised]
        if not ways and block.get("load_max", 0.0) > 1.0:
            ways = [cures.enlarge(remedies.size_factor(block["load_max"], soft=False))]
    # number of seams, of which each may have several warnings, or of panels, of which only some are described
    count = block.get("hard", len(block.get("forced", lines)))
    words = interface(one) if count == 1 else interface(more, count)
    return [*plain, Notice(key, words, "\n".join(lines), WORSE, cures=(*ways, cures.dismiss(key)))]
