"""The table of the stages: it fits the steps, the results and the settings, and says what a change makes out of date."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.extras.registry import REGISTRY
from flexmaps.engine.params import ObjectSettings
from flexmaps.engine.runs import job, manual_changes, report, stages
from flexmaps.engine.runs.outputs import OUTPUTS, DesignVersion, FinalLayout
from flexmaps.engine.runs.result import Result
from flexmaps.engine.runs.stage import section_of
from flexmaps.engine.runs.stages import BY_HAND, STAGES, TABLE
from flexmaps.engine.runs.steps import STEPS, _constraints, function_of
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh

# sections that say how to search, what to draw and where to write, so that no result depends on them
NO_RESULT = {"page", "choose", "optimise", "remesh", "export", "preview", "render"} | {
    section for extra in REGISTRY for section in extra.kept
}


@pytest.fixture(scope="module")
def settings() -> ObjectSettings:
    base = ObjectSettings()
    return replace(base, sheet=replace(base.sheet, nesting="FAST"))


@pytest.fixture(scope="module")
def made(settings: ObjectSettings) -> Result:
    return job.run(PolygonMesh.from_quads(shapes.make("strip")), settings)


def there(result: Result) -> set[str]:
    return LISTED.intersection(result.outputs)


def test_every_stage_has_its_step_and_every_output_its_stage() -> None:
    assert list(STEPS) == [stage.name for stage in TABLE if not stage.code]
    makers = [name for stage in TABLE for name in stage.makes]
    of_extras = {name for stage in TABLE if stage.code for name in stage.makes}
    assert sorted(makers) == sorted({*OUTPUTS} | of_extras)  # each once
    assert all(callable(function_of(stage)) for stage in TABLE)
    made_by_now = {"mesh"}
    for stage in TABLE:
        assert made_by_now.issuperset((*stage.needs, *stage.may_use)), stage.name
        made_by_now.update(stage.makes)
        assert made_by_now.issuperset(stage.replaces), stage.name
        assert stages.MISSING.keys() >= {*stage.needs} - {"mesh"}


def test_every_section_of_the_settings_concerns_a_stage_or_no_result() -> None:
    named = {section_of(entry)[0] for stage in TABLE for entry in stage.settings}
    assert named == {f.name for f in fields(ObjectSettings)} - NO_RESULT
    for section, but in (section_of(entry) for stage in TABLE for entry in stage.settings):
        assert all(hasattr(getattr(ObjectSettings(), section), one) for one in but)


LAYOUT = {"layout", "merged", "flat"}
SPIRALS = LAYOUT | {"design"}
SHAPE, CUT = {"simulation"}, {"sheets", "estimates"}
LISTED = SPIRALS | SHAPE | CUT  # a stage that is added needs rows of its own, and changes none of these


@pytest.mark.parametrize(
    ("section", "values", "left"),
    [
        ("layout", {"patch_min": 3}, set()),
        ("spiral", {"width_max": 0.0015}, LAYOUT),
        ("spiral", {"thickness": 0.003}, SPIRALS),
        ("material", {"material": "petg"}, SPIRALS | {"sheets"}),
        ("simulate", {"model": "rod"}, SPIRALS | {"sheets"}),
        ("loads", {"force_z": 1.0}, SPIRALS | {"sheets"}),
        ("sheet", {"sheet_width": 0.3}, SPIRALS | SHAPE),
        ("connect", {"connector": "none"}, SPIRALS | SHAPE),
        ("structure", {"cases": "a: weight"}, SPIRALS | SHAPE | CUT),
        ("export", {"pdf": True}, SPIRALS | SHAPE | CUT),
        ("optimise", {"iterations": 7}, SPIRALS | SHAPE | CUT),
    ],
)
def test_a_changed_setting_takes_what_was_made_from_it(
    made: Result, settings: ObjectSettings, section: str, values: dict[str, object], left: set[str]
) -> None:
    """The expected sets follow from what each step reads, not from the table."""
    assert there(made) == LISTED
    other = replace(settings, **{section: replace(getattr(settings, section), **values)})  # type: ignore[arg-type]
    found = made.without_outdated(other)
    assert there(found) == left
    if found.design is not None:
        assert found.design.params == other.spiral


def test_what_is_missing_runs_first_and_in_order(made: Result) -> None:
    bare = made.without("layout")
    assert not bare.outputs
    assert bare.missing("sheets") == ("trace", "merge", "split", "spirals", "sheets")
    assert bare.with_outputs(FinalLayout(made.need(FinalLayout).flat, BY_HAND)).missing("design") == ("spirals",)
    assert made.missing("sheets") == ()


def test_what_was_lost_is_told_instead_of_what_is_missing(made: Result, settings: ObjectSettings) -> None:
    reason = FlexMapsError("the seams were edited")
    bare = replace(made.without("layout"), lost={"flat": reason})
    with pytest.raises(FlexMapsError, match="the seams were edited"):
        bare.missing("design")
    with pytest.raises(FlexMapsError, match="the seams were edited"):
        job.run_stages(bare, settings, ("spirals",))
    with pytest.raises(FlexMapsError, match="no flat panels"):
        job.run_stages(replace(bare, lost={}), settings, ("spirals",))
    # whoever lays it out anew has lost nothing
    assert job.run_stages(bare, settings, ("trace",)).lost == {}


def test_a_stage_that_runs_again_drops_what_came_of_it(made: Result, settings: ObjectSettings) -> None:
    """Simulating leaves the sheets alone, but how hard they are to join is judged anew; new spirals leave nothing."""
    again = job.run_stages(made, settings, ("simulate",))
    assert again.sheets is made.sheets and again.assembly is not None and again.assembly is not made.assembly
    assert there(job.run_stages(made, settings, ("spirals",))) == SPIRALS
    assert there(job.run_stages(made, settings, ("regularise",))) == there(made)  # it was regular, and nothing moved
    assert there(made.with_surface(mesh=made.mesh.with_vertices(2.0 * made.mesh.vertices))) == set()


def test_every_output_says_how_it_came_about(made: Result, settings: ObjectSettings) -> None:
    traced, version = made.need(FinalLayout), made.need(DesignVersion)
    assert (traced.origin, version.origin) == (stages.TRACED, stages.CURVED)
    cut = traced.flat.layout.cut
    again = manual_changes.flatten_by_hand(made, cut, settings)
    assert again.need(FinalLayout).origin == BY_HAND and there(again) == {"merged", "flat"}
    painted = manual_changes.with_design(made, version.design, BY_HAND, settings)
    assert painted.need(DesignVersion).origin == BY_HAND and there(painted) == there(made)


def test_seams_of_the_user_are_kept_where_they_differ_from_the_traced_ones(
    made: Result, settings: ObjectSettings
) -> None:
    traced = manual_changes.trace_with_seams(made, np.zeros(len(made.mesh.edges), dtype=bool), settings)
    cuts = made.mesh.edge_quads.min(axis=1) == 0
    chosen = manual_changes.trace_with_seams(made, cuts & ~made.mesh.border, settings)
    assert traced.layout is not None and made.layout is not None and chosen.layout is not None
    assert np.array_equal(traced.layout.cut, made.layout.cut)
    assert chosen.layout.cut[cuts & ~made.mesh.border].all()
    assert not np.array_equal(chosen.layout.cut, made.layout.cut)


def test_other_loads_leave_what_does_not_depend_on_them(made: Result) -> None:
    force = np.zeros((len(made.mesh.quads), 3))
    pulled = made.with_user(force=force)
    assert there(pulled) == there(made) - SHAPE - {"estimates"}
    assert there(pulled.with_user(force=force.copy())) == there(pulled)


def test_notes_are_dropped_with_what_they_tell_of() -> None:
    """In a .blend file a note stays true until a stage before its own writes."""
    made = {"spirals", "optimise", "equilibrium", "reach", "structure", "sheets", "assembly"}

    def stale(block: str) -> set[str]:
        return stages.stale_blocks(block) & (made | {"layout", "choose"})

    assert stale("layout") == made | {"choose"}
    assert stale("choose") == set()  # the layout that is written with it takes them
    assert stale("spirals") == {"optimise", "equilibrium", "reach", "structure", "sheets", "assembly"}
    assert stale("equilibrium") == {"structure"} and stale("optimise") == set()


def test_every_block_is_told(made: Result) -> None:
    asked = {block for stage in TABLE if stage.asked for block in stage.blocks}  # which nobody asked for
    assert asked >= {"choose", "optimise", "scan", "structure"}
    assert report.report_blocks(made).keys() == set(stages.BLOCKS) - asked
    assert report.report_blocks(made, ("sheets", "optimise")).keys() == {"sheets"}


def test_stages_up_to_a_name() -> None:
    assert job.stages("split") == ["check", "regularise", "trace", "merge", "split"]
    assert "optimise" not in job.stages("sheets") and "optimise" in job.stages("sheets", optimised=True)
    assert job.stages("optimise")[-1] == "optimise"
    assert "structure" not in job.stages("sheets") and "structure" in job.stages("sheets", structured=True)
    assert "choose" not in job.stages("sheets", optimised=True) and "optimise" not in job.stages("sheets", chosen=True)
    assert job.stages("spirals", chosen=True)[-3:] == ["split", "choose", "spirals"]
    assert not any(STAGES[name].quick for name in job.STAGE_NAMES[1:])
    with pytest.raises(FlexMapsError, match="no stage 'nest'"):
        job.stages("nest")


@pytest.mark.parametrize(("base", "asked"), [("none", set()), ("plate", {"straight"}), ("eyelets", {"wide"})])
def test_supports_constrain_spirals_only_where_a_base_needs_them(
    settings: ObjectSettings, base: str, asked: set[str]
) -> None:
    surface = job.check_input(PolygonMesh.from_quads(shapes.make("strip")))
    found = _constraints(
        surface.with_user(supports=np.array([0])), replace(settings, base=replace(settings.base, base=base))
    )
    assert {one.name for one in fields(found) if len(getattr(found, one.name))} == asked
    found = _constraints(surface, replace(settings, base=replace(settings.base, base=base)))
    assert not any(len(getattr(found, one.name)) for one in fields(found))
