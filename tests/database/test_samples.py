"""Sampling, chunks, resuming, fits: what is stored is enough, nothing is lost, nothing of another kind is believed."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from flexmaps.database import build, chunks, cli, fits, linear, network, packs, rods, sampling
from flexmaps.database.chunks import Task
from flexmaps.database.sampling import Sampler, Subject
from flexmaps.database.solid import make_solid
from flexmaps.engine.errors import FlexMapsError
from scipy.spatial.transform import Rotation

STRAIGHT = Subject(0.010, 0.001, 0.0)


@pytest.fixture(scope="module")
def chunk_bytes() -> bytes:
    return chunks.compute(Task(STRAIGHT, "strain", 0, 25))


def test_all_125_spirals_can_be_cut_and_leave_the_slot():
    found = sampling.subjects()
    assert len(set(found)) == 125
    for s in found:
        assert s.spiral.tip_gap * s.width > 0.00029
    for s in found[::17]:
        make_solid(s.spiral, sampling.fineness_of(s.spiral))


def test_samples_do_not_depend_on_order_and_meet_their_targets():
    sampler = Sampler(STRAIGHT, "strain")
    first = sampler.samples(range(3))
    again = Sampler(STRAIGHT, "strain").samples(range(2, 3))
    assert np.array_equal(first.wrenches[2], again.wrenches[0])
    assert first.energy[2] == again.energy[0]
    assert first.converged.all() and (first.strain < 0.03).all() and (first.energy > 0).all()
    assert np.allclose(first.centres[:, 0], [5.0, 0.0, 0.0], atol=1e-9)
    assert np.abs(first.turns[:, 0]).max() < 1e-9


def test_small_samples_obey_the_linear_limit():
    sampler = Sampler(Subject(0.020, 0.0015, 3.0), "strain")
    model = sampler.model
    compliance = linear.tip_compliance(model, linear.unit_motions(model))
    found = model.solve(model.loads(1e-3 * sampler.wrenches(1)))
    centres, rotations = model.frames(found.displacement)
    motions = rods.arm_motions(centres[None], rotations[None], model.solid.tip_centres)
    energy = rods.stiffness_features(motions) @ rods.stiffness_parameters(compliance)
    assert energy[0] == pytest.approx(found.energy, rel=0.02)


def test_rod_features_vanish_under_rigid_motion_and_count_single_modes():
    rest = np.array([[5.0, 0, 0], [0, 5.0, 0], [-5.0, 0, 0], [0, -5.0, 0]])
    centres = np.vstack([rest, np.zeros(3)])
    turn = Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix()
    moved = (centres @ turn.T + [1.0, 2.0, 3.0])[None]
    rotations = np.broadcast_to(turn, (1, 5, 3, 3))
    assert np.abs(rods.chord_features(moved, rotations, rest)).max() < 1e-24
    assert np.abs(rods.arm_motions(moved, rotations, rest)).max() < 1e-12
    # stretch arm 0 by a tenth; roll arm 1 by 0.2 about its own axis
    single = centres.copy()[None]
    single[0, 0] *= 1.1
    frames = np.broadcast_to(np.eye(3), (1, 5, 3, 3)).copy()
    frames[0, 1] = Rotation.from_rotvec([0.0, 0.2, 0.0]).as_matrix()
    assert np.allclose(rods.chord_features(single, frames, rest), [[0.5 * 5 * 0.01, 0, 0, 0.5 * 0.04 / 5]])


def test_pair_features_of_a_stretch_and_a_twist():
    compliance = np.diag([2.0, 3.0, 5.0, 7.0, 11.0, 13.0])
    wrenches = np.eye(6)[[0, 3]]
    features, energy = rods.pair_features(wrenches, compliance, 10.0)
    assert np.allclose(energy, [2.0, 7.0])
    assert np.allclose(features, [[0.5 * 10 * 0.4**2, 0, 0, 0], [0, 0, 0, 0.5 * 14.0**2 / 10]])


def test_chunk_is_reproduced_bit_for_bit_and_read_back(chunk_bytes):
    assert chunks.compute(Task(STRAIGHT, "strain", 0, 25)) == chunk_bytes
    found = chunks.read(chunk_bytes)
    assert found is not None
    assert found.counts["converged"] == 25 and found.fitted["chord"] == 22 and list(found.kept.number) == [0, 10, 20]


def test_broken_chunks_and_other_versions_are_made_again(tmp_path, chunk_bytes, monkeypatch):
    task = Task(STRAIGHT, "strain", 0, 25)
    assert build.pending(tmp_path, [task]) == [task]
    (tmp_path / task.name).write_bytes(chunk_bytes[: len(chunk_bytes) // 2])
    assert build.pending(tmp_path, [task]) == [task]
    chunks.write(tmp_path / task.name, chunk_bytes)
    assert build.pending(tmp_path, [task]) == []
    assert not [p for p in tmp_path.iterdir() if p.name.endswith(".part")]
    for field, value in (("thickness", 0.003), ("poisson", 0.31), ("twist", 0.1)):
        assert dataclasses.replace(task, subject=dataclasses.replace(STRAIGHT, **{field: value})).name != task.name
    monkeypatch.setattr(chunks, "VERSION", chunks.VERSION + 1)
    assert build.pending(tmp_path, [task]) == [task]


def test_work_goes_on_where_it_was_stopped(tmp_path):
    """Cancelled after the first chunk; the second call makes only what is missing, and the same bytes."""
    from flexmaps.engine.errors import Cancelled
    from flexmaps.engine.progress import Progress

    todo = [Task(STRAIGHT, "strain", k, 2) for k in (0, 2, 4)]
    calls = iter([False, True])
    with pytest.raises(Cancelled):
        build.work(tmp_path, todo, progress=Progress(stopped=lambda: next(calls)))
    assert build.pending(tmp_path, todo) == todo[1:]
    first = (tmp_path / todo[0].name).stat().st_mtime_ns
    build.work(tmp_path, todo, keep=tmp_path / "raw")
    assert build.pending(tmp_path, todo) == []
    assert (tmp_path / todo[0].name).stat().st_mtime_ns == first
    assert sorted(p.name for p in (tmp_path / "raw").iterdir()) == sorted(t.name for t in todo[1:])


def test_worker_begins_with_its_stripe_and_then_helps_the_others(tmp_path, monkeypatch):
    seen = {}
    monkeypatch.setattr(cli, "PACK", tmp_path / "none.npz")
    monkeypatch.setattr(build, "work", lambda folder, todo, keep, progress: seen.update({len(seen): todo}))
    for stripe in ("0/2", "1/2"):
        line = ["work", "--dir", str(tmp_path), "--samples", "25", "--newton-samples", "0", "--stripe", stripe]
        assert cli.main(line) == 0
    first, second = seen[0], seen[1]
    assert first[:63] == second[:61:-1] and second[:62] == first[:62:-1]
    assert len(set(first)) == len(first) == 125


def test_strain_of_a_stretched_block():
    """Green strain of a uniform stretch by one hundredth: 0.01 + 0.01^2 / 2, in all of the volume and in any part."""
    elements = Sampler(STRAIGHT, "strain").model.elements
    nodes = Sampler(STRAIGHT, "strain").model.solid.nodes
    moved = nodes * [0.01, 0.0, -0.002]
    assert elements.peak_strain(moved) == pytest.approx(0.01005, rel=1e-9)
    assert elements.peak_strain(moved, only=np.array([3, 4])) == pytest.approx(0.01005, rel=1e-9)


def test_failures_are_recorded(monkeypatch):
    from flexmaps.database.statics import Model, Solution

    def fails(self, forces):
        return Solution(np.zeros_like(self.solid.nodes), 0.0, 99, 12, False)

    chunks._sampler.cache_clear()
    monkeypatch.setattr(Model, "solve", fails)
    found = chunks.read(chunks.compute(Task(STRAIGHT, "newton", 0, 4)))
    chunks._sampler.cache_clear()
    assert found is not None and found.counts["failed"] == 4 and found.counts["converged"] == 0
    assert len(found.kept.number) == 4 and np.isnan(found.kept.energy).all()


def test_statistics_alone_give_the_fit(tmp_path, chunk_bytes):
    """Packed sums of two chunks against least squares on all their samples."""
    second = Task(STRAIGHT, "strain", 25, 25)
    chunks.write(tmp_path / Task(STRAIGHT, "strain", 0, 25).name, chunk_bytes)
    chunks.write(tmp_path / second.name, chunks.compute(second))
    assert packs.gather(tmp_path, tmp_path / "pack.npz", chunks.tasks({"strain": 50})) == 2
    (series,) = packs.read(tmp_path / "pack.npz")
    assert series.subject == STRAIGHT and series.fitted["chord"] == 45
    # on another machine: only the packed file is there, and what it holds is neither made again nor lost
    assert build.pending(tmp_path / "empty", [second], tmp_path / "pack.npz") == []
    (tmp_path / "next").mkdir()
    third = Task(STRAIGHT, "newton", 0, 5)
    chunks.write(tmp_path / "next" / third.name, chunks.compute(third))
    assert packs.gather(tmp_path / "next", tmp_path / "pack.npz", chunks.tasks({"strain": 50, "newton": 5})) == 3
    again = next(s for s in packs.read(tmp_path / "pack.npz") if s.law == "strain")
    assert np.array_equal(again.normal["chord"][0], series.normal["chord"][0]) and again.fitted == series.fitted
    assert np.array_equal(again.kept.energy, series.kept.energy)
    # fewer samples asked for than there are: nothing goes
    assert packs.gather(tmp_path / "empty", tmp_path / "pack.npz", chunks.tasks({"strain": 25})) == 3
    samples = Sampler(STRAIGHT, "strain").samples(range(50))
    fit = samples.chosen(samples.number % chunks.HELD_OUT != 0)
    a = rods.chord_features(fit.centres, fit.rotations, series.rest_tips) / fit.energy[:, None]
    best = np.linalg.lstsq(a, np.ones(len(a)), rcond=None)[0]
    if (best > 0).all():
        assert np.allclose(fits.parameters(series, "chord"), best, rtol=1e-5)
    loss = ((a @ fits.parameters(series, "chord") - 1) ** 2).sum()
    assert loss <= 1.000001 * ((a @ np.maximum(best, 0) - 1) ** 2).sum()


def test_pack_that_is_broken_or_of_another_version_is_refused_and_built_again(tmp_path, chunk_bytes, monkeypatch):
    task, pack = Task(STRAIGHT, "strain", 0, 25), tmp_path / "pack.npz"
    with pytest.raises(FlexMapsError, match="is not there"):
        packs.read(pack)
    chunks.write(tmp_path / task.name, chunk_bytes)
    assert packs.gather(tmp_path, pack, [task]) == 1
    whole = pack.read_bytes()
    pack.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FlexMapsError, match=r"pack\.npz cannot be read"):
        packs.read(pack)
    assert packs.gather(tmp_path, pack, [task]) == 1 and pack.read_bytes() == whole
    monkeypatch.setattr(chunks, "VERSION", chunks.VERSION + 1)
    with pytest.raises(FlexMapsError, match="of version"):
        packs.read(pack)
    assert build.pending(tmp_path, [task], pack) == [task]


def test_bounded_fit_recovers_known_parameters():
    rng = np.random.default_rng(0)
    a = rng.uniform(0.1, 1.0, (300, 4)) * [1e-6, 1.0, 1e3, 10.0]
    true = np.array([2e5, 0.3, 1e-4, 0.02])
    a /= (a @ true)[:, None]
    assert np.allclose(fits.solve(a.T @ a, a.sum(0), 300), true, rtol=1e-6)


def test_network_learns_a_smooth_function():
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 5)] * 3, indexing="ij"), -1).reshape(-1, 3)

    def function(x):
        return np.stack([np.sin(2 * x[:, 0]) + x[:, 1], x[:, 2] ** 2, np.exp(x[:, 0] * x[:, 2]), x.sum(1)], 1)

    made = network.train(grid, function(grid))
    assert made.rms <= 1e-3 and 0.2 <= made.spread <= 0.8 and len(made.centres) < 125
    assert network.choose(grid, function(grid))[1] == network.GOALS[0]
    inside = np.random.default_rng(1).uniform(0.1, 0.9, (50, 3))
    assert np.abs(made(inside) - function(inside)).max() < 0.03


def test_network_does_not_follow_noise():
    """A line with 5 % of noise: fewer neurons than points, and nearer to the line at points left out than the noise is."""
    rng = np.random.default_rng(2)
    points = rng.uniform(0, 1, (80, 3))
    line = np.repeat(points.sum(1, keepdims=True), 4, axis=1)
    made, goal, _ = network.choose(points, line + 0.05 * rng.normal(size=line.shape))
    inside = rng.uniform(0.2, 0.8, (50, 3))
    assert goal > network.GOALS[0] and len(made.centres) < 60
    assert np.abs(made(inside) - inside.sum(1, keepdims=True)).mean() < 0.05


@pytest.mark.parametrize(
    "line",
    [
        ["build", "--samples", "-1"],
        ["build", "--samples", "40"],
        ["build", "--processes", "0"],
        ["work", "--stripe", "x"],
        ["work", "--stripe", "4/4"],
    ],
)
def test_command_line_refuses_nonsense_in_one_line(line, capsys, tmp_path):
    assert cli.main([*line, "--dir", str(tmp_path)]) == 1
    assert capsys.readouterr().out.startswith("database: ")


def test_missing_dask_is_said(monkeypatch, tmp_path):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(FlexMapsError, match="Dask is not installed"):
        build.run_dask(tmp_path, [], "tcp://127.0.0.1:1", ".", print)
