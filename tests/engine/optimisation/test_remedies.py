"""What is advised as names and amounts: what each kind of surface gets, and how much of it, against the bent sheet by hand."""

import dataclasses
import math
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from flexmaps.engine.materials import MATERIALS, STRAIN_MARGIN
from flexmaps.engine.optimisation import match_limits as reaching
from flexmaps.engine.optimisation import remedies
from flexmaps.engine.params import ChooseParams, Settings, SimulateParams
from flexmaps.engine.runs import job
from flexmaps.engine.runs.result import Result
from flexmaps.engine.simulation.simulate import Simulation, simulate
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh

LIMIT = 0.004  # a strain


def bent(thickness: float, radius: float) -> float:
    """By how much the outer side of a sheet is longer than its middle when it is bent to a radius, as a share of the limit."""
    turn = 0.1
    return ((radius + 0.5 * thickness) * turn - radius * turn) / (radius * turn) / LIMIT


@pytest.mark.parametrize("radius", [0.22, 0.25, 0.3, 0.36])
def test_a_bent_sheet_ends_within_its_limit(radius: float) -> None:
    thickness = 0.003
    before = bent(thickness, radius)
    assert 1.0 < before < remedies.MAX_FACTOR
    times = remedies.size_factor(before, soft=False)
    assert 1.0 - remedies.FACTOR_STEP < bent(thickness, times * radius) <= 1.0
    sheet = remedies.thinner_sheet(thickness, times)
    assert sheet is not None and bent(sheet, radius) <= 1.0
    share = 10.0 ** (math.log10(sheet) % 1.0)
    assert min(abs(share - usual) for usual in remedies.SHEET_SERIES) < 1e-6
    # there is no usual sheet between that and the one that would just do
    assert not [s for s in remedies.SHEET_SERIES if sheet * 1e3 + 1e-6 < s <= thickness * 1e3 / times]


def test_where_no_strain_says_how_much_it_is_a_modest_step() -> None:
    for strain in (None, 0.0, 0.7):
        assert remedies.size_factor(strain, soft=True) == remedies.MIN_SOFT_FACTOR
    assert remedies.size_factor(1.4, soft=True) == 1.4
    assert remedies.size_factor(50.0, soft=False) == remedies.MAX_FACTOR
    assert remedies.thinner_sheet(0.0001, 1.25) is None  # the thinnest that can be asked for
    assert remedies.thinner_sheet(0.002, 1.0) == pytest.approx(0.0015)
    assert remedies.thinner_sheet(0.0021, 1.0) == pytest.approx(0.002)
    assert remedies.quad_count(240) == 480 and remedies.quad_count(99_999) is None


def test_what_cannot_be_followed_is_left_out() -> None:
    every = remedies.remedy_amounts(remedies.REMEDIES, strain=1.33, soft=False, thickness=0.003, quads=100)
    assert every == {"cut": None, "larger": 1.35, "thinner": 2.0, "finer": 200}
    least = remedies.remedy_amounts(remedies.REMEDIES, strain=1.33, soft=False, thickness=0.0001, quads=90_000)
    assert least == {"cut": None, "larger": 1.35}


def test_blocks_of_earlier_versions_tell_of_a_cut_in_their_sentence_alone() -> None:
    assert remedies.read_block({"advice": "a cut there would help"}) == {"cut": None}
    assert remedies.read_block({"advice": "a larger object would help"}) == {}
    assert remedies.read_block({"advice": "a cut", "remedies": {"larger": 1.25, "of another version": 3}}) == {
        "larger": 1.25
    }


def stand_in(strain: float | None, *, flat: bool | None = None, line: int = 0, quads: int = 100) -> Any:
    short = [] if flat is None else [SimpleNamespace(is_flat=flat, cut_edges=np.arange(line), quads=np.arange(quads))]
    values = None if strain is None else np.array([0.1, strain])
    assembly = SimpleNamespace(thickness=0.002, size=100)
    return SimpleNamespace(strain=values, far_bodies=short, assembly=assembly, model=None)


def advised(kind: str, simulation: Any) -> list[str]:
    share = np.zeros(len(reaching.REASON_NAMES))
    share[reaching.REASON_NAMES.index(kind)] = 1.0
    found = reaching._remedies(share, simulation)
    sentence = reaching.REASONS[reaching.REASON_NAMES.index(kind)][1]
    for name, word in (("larger", "larger"), ("thinner", "thinner"), ("finer", "finer"), ("cut", "cut")):
        if simulation.strain is None and not simulation.far_bodies:
            assert name not in found or word in sentence  # a button never says more than the sentence
    return list(found)


@pytest.mark.parametrize(
    ("kind", "wanted"),
    [
        ("matched", []),
        ("softest", ["larger", "thinner"]),
        ("stiffest", []),
        ("unstable", ["cut"]),
        ("distorted", ["cut", "finer"]),
        ("stretched", ["cut"]),
        ("free", []),
    ],
)
def test_every_kind_has_its_remedies(kind: str, wanted: list[str]) -> None:
    assert advised(kind, stand_in(None)) == advised(kind, stand_in(0.9)) == wanted
    # strained arms ask for a larger piece or a thinner sheet as well, and finer quads would strain them more
    over = advised(kind, stand_in(1.3))
    assert set(over) == {"larger", "thinner", *wanted} - {"finer"}
    # a piece that stays flat is told nothing of its spirals, one that is far off is; where a line would help it is a cut
    assert advised(kind, stand_in(0.9, flat=True)) == []
    assert advised(kind, stand_in(0.9, flat=True, line=3)) == ["cut"]
    assert set(advised(kind, stand_in(0.9, flat=False, line=3))) == {"cut", *wanted}
    # of a small body that stays flat beside a large one that does not, the large one's spirals count
    assert set(advised(kind, stand_in(0.9, flat=True, line=3, quads=10))) == {"cut", *wanted}


# -- on a surface ------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=1)
def dome() -> Result:
    """In as few panels as the limits allow, so that its arms are strained."""
    few = Settings(choose=ChooseParams(goal="panels"))
    return job.run(PolygonMesh.from_quads(shapes.make("dome")), few, edge=0.02, stop_after="spirals")


def on_sheets_of(side: float) -> Settings:
    sheet = dataclasses.replace(Settings().sheet, sheet_width=side, sheet_height=side)
    return dataclasses.replace(Settings(), sheet=sheet)


def test_as_much_larger_as_is_advised_the_arms_bear_their_strain() -> None:
    """The advice scales the solved shape; the larger piece is fitted and solved anew."""
    start, before = dome(), strained_by(1.42)
    told = reaching.find_limits(before).report()["remedies"]
    assert 1.2 < told["larger"] < 1.6, "about as much as it is strained too much"
    about = np.array([0.1, -0.2, 0.3])
    larger = job.scale_piece(start, told["larger"], about, on_sheets_of(1.0))
    assert larger.design is not None and larger.flat is not None and start.flat is not None and start.design is not None
    assert larger.mesh.median_edge == pytest.approx(told["larger"] * start.mesh.median_edge)
    assert larger.mesh.vertices[3] - about == pytest.approx(told["larger"] * (start.mesh.vertices[3] - about))
    assert (larger.flat.layout.cut == start.flat.layout.cut).all()
    assert larger.flat.points == pytest.approx(told["larger"] * start.flat.points)
    assert larger.flat.energy == pytest.approx(start.flat.energy)
    assert larger.design.twist == pytest.approx(start.design.twist, abs=0.02)  # there is more room: nothing has to give
    after = simulate(larger.design, larger.mesh, before.material, SimulateParams())
    assert after.strain is not None and after.strain.max() == pytest.approx(1.0 / STRAIN_MARGIN, rel=0.08)
    if after.strain.max() <= 1.0 / STRAIN_MARGIN:
        assert "larger" not in reaching.find_limits(after).remedies


def test_of_as_thin_a_sheet_as_is_advised_the_arms_bear_their_strain() -> None:
    """The next thicker one of the series does not do; both are solved anew."""
    start, before = dome(), strained_by(1.15)
    assert start.design is not None
    told = reaching.find_limits(before).report()["remedies"]["thinner"]
    usual = sorted(round(share * decade, 6) for share in remedies.SHEET_SERIES for decade in (0.1, 1.0))
    sheets = [sheet for sheet in usual if told <= sheet < 1e3 * before.assembly.thickness]
    strains = {}
    for sheet in sheets[:2]:
        params = dataclasses.replace(start.design.params, thickness=1e-3 * sheet)
        found = simulate(
            dataclasses.replace(start.design, params=params), start.mesh, before.material, SimulateParams()
        )
        assert found.strain is not None
        strains[sheet] = float(found.strain.max()) * STRAIN_MARGIN
    assert strains.pop(told) < 1.03
    assert all(share > 0.97 for share in strains.values())


def strained_by(times: float) -> Simulation:
    """A dome of a material that bears so much less than its arms are strained by."""
    start = dome()
    assert start.design is not None
    found = simulate(start.design, start.mesh, MATERIALS["vero"], SimulateParams())
    assert found.strain is not None
    largest = float(found.strain.max()) * found.material.strain_limit
    weak = dataclasses.replace(MATERIALS["vero"], strain_limit=largest * STRAIN_MARGIN / times)
    return simulate(start.design, start.mesh, weak, SimulateParams())


def test_a_panel_that_outgrows_its_sheet_is_cut() -> None:
    start = dome()
    assert start.flat is not None
    larger = job.scale_piece(start, 2.0, np.zeros(3), on_sheets_of(0.3))
    assert larger.flat is not None and larger.design is not None
    assert larger.flat.layout.cut[start.flat.layout.cut].all()
    assert len(larger.flat.layout.patches) > len(start.flat.layout.patches)
