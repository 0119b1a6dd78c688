"""What is committed fits together: the statistics give the fitted parameters again, the table holds their compliances."""

from __future__ import annotations

import json

import numpy as np
import pytest
from flexmaps.database import cli, fits, packs, report, table, table_file
from flexmaps.engine.mechanics.arms import stiffness
from flexmaps.engine.mechanics.rods import rod_stiffness as stiffness_rods

REPORT = cli.ROOT / "database" / "report"


@pytest.fixture(scope="module")
def every_series():
    return packs.read(cli.PACK)


@pytest.fixture(scope="module")
def series(every_series):
    return [s for s in every_series if s.law == "strain"]


@pytest.fixture(scope="module")
def newton_series(every_series):
    return [s for s in every_series if s.law == "newton"]


def test_statistics_give_the_committed_parameters_again(series, tmp_path):
    fits.write_parameters(cli.PACK, lambda text: None, tmp_path / "again.npz")
    with np.load(tmp_path / "again.npz") as again, np.load(stiffness_rods.PARAMETERS) as committed:
        assert sorted(again.files) == sorted(committed.files)
        for model in stiffness_rods.MODELS:
            assert np.allclose(again[f"{model}_offset"], committed[f"{model}_offset"], rtol=1e-9)
            assert again[f"{model}_weights"].shape == committed[f"{model}_weights"].shape
    subjects = [s for s in series if s.subject.twist > 0.1][::7]
    at = [np.array([getattr(s.subject, n) for s in subjects]) for n in ("scale", "width", "twist")]
    found = stiffness_rods.rod_parameters(*at, thickness=0.002, youngs=2.6e9).values
    unit = 2.6e9 * at[1][:, None] ** [2, 4, 4, 4]
    own = np.array([fits.parameters(s, "pair") for s in subjects]) * unit
    assert np.median(np.abs(found / own - 1.0)) < 0.01


@pytest.mark.parametrize("model", stiffness_rods.MODELS)
def test_networks_tell_energies_as_well_as_the_fits_they_learned_from(series, model):
    at = [np.array([getattr(s.subject, n) for s in series]) for n in ("scale", "width", "twist")]
    found = stiffness_rods.rod_parameters(*at, thickness=0.002, youngs=2.6e9, model=model).values
    found /= 2.6e9 * at[1][:, None] ** [2, 4, 4, 4]
    made = [fits.predicted(s, model, p) for s, p in zip(series, found)]
    learned = np.median(np.concatenate([np.abs(energy / true - 1.0) for energy, true in made]))
    assert learned < 1.05 * np.median(fits.errors(series, model, "strain"))


def test_networks_are_tame_between_the_spirals_they_learned_from():
    """Parameters at a spiral that the network has not seen are off by less than what the model itself leaves of energies."""
    with np.load(stiffness_rods.PARAMETERS) as stored:
        networks = json.loads(str(stored["provenance"]))["networks"]
    assert networks["pair"]["leave_one_out_median"] < 0.01
    assert networks["chord"]["leave_one_out_median"] < 0.1 and networks["chord"]["leave_one_out_95"] < 0.36


def test_table_meets_the_compliances_of_the_sampled_spirals(series):
    errors = []
    found = stiffness.load_table(0.3)
    for s in series:
        spiral = s.subject.spiral
        stored = table.relative_factor(s.compliance, spiral.scale, spiral.height, spiral.twist, 0.3)
        errors.append(np.abs(table.block_errors(stored, spiral, 0.3, found)))
    assert len(errors) == 125
    assert np.median(errors) < 0.015
    assert np.quantile(errors, 0.95) < 0.08


def test_the_table_goes_on_beyond_its_nodes(tmp_path):
    """Spirals far more slender than those that the table was made of, against finite elements of their own."""
    some = [s for s in table.slender() if (s[0].scale, s[0].height, round(np.degrees(s[0].twist))) in BEYOND]
    assert len(some) == len(BEYOND)
    assert np.abs(table_file.errors(some, tmp_path, "slender")).max() < 0.02


BEYOND = {(80.0, 1.0, 150), (120.0, 1.0, 0)}


def test_report_tells_what_the_models_can_do(series):
    found = report.summary(series)
    strain = found["laws"]["strain"]
    assert strain["spirals"] == 125 and strain["failed"] <= 0.001 * strain["converged"]
    arm, chord = found["models"]["arm"]["strain"], found["models"]["chord"]["strain"]
    assert arm["median"] < 0.012 and arm["p95"] < 0.055
    assert 0.05 < chord["median"] < 0.2 and chord["p95"] > arm["p95"]
    least, usual = (f(series, "pair", "strain") for f in (fits.floor, fits.errors))
    assert len(least) == len(usual) and (least**2).mean() < (usual**2).mean()


def test_four_parameters_follow_forces_from_hub_to_hub_but_not_from_hub_to_tip(newton_series):
    """Fitted where they are used, under the paper's own loads: 5 % median; fitted on chords, twice that and more."""
    pair, chord = (np.median(fits.errors(newton_series, model, "newton")) for model in ("pair", "chord"))
    assert pair < 0.05 and chord > 2 * pair


def test_committed_report_is_that_of_the_committed_samples(series, newton_series):
    found = json.loads((REPORT / "fit_report.json").read_text(encoding="utf-8"))
    assert (REPORT / "README.md").read_text(encoding="utf-8") == report.page(found)
    for law, mine in (("strain", series), ("newton", newton_series)):
        for count in ("converged", "failed"):
            assert found["laws"][law][count] == sum(s.counts[count] for s in mine)


def test_pack_is_small_enough_to_travel():
    assert cli.PACK.stat().st_size < 5_000_000
