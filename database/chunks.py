"""Chunks of samples: what is kept of them, how they are named, written and read back.

A chunk's file holds the sufficient statistics of the three fits and a held-out share of full samples. It is written
beside its place and then renamed, so that a file that exists is whole; one that cannot be read, or of another version,
is made again.
"""

from __future__ import annotations

import io
import json
import zipfile
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from . import linear, rods
from .sampling import LAWS, VERSION, Sampler, Samples, Subject, key, subjects

CHUNK = 25
HELD_OUT = 10
"""One sample in this many is kept whole and never fitted."""
ENOUGH = 400
"""Samples of a spiral after which more hardly change its fits."""
PER_LAW = {"strain": 1000, "newton": 200}
MODELS = ("chord", "arm")
"""The models whose parameters are fitted to samples; the hub-to-hub one follows from the linear limit."""


@dataclass(frozen=True)
class Task:
    """One chunk to compute: a spiral, a load law, and which samples."""

    subject: Subject
    law: str
    first: int
    count: int = CHUNK

    @property
    def name(self) -> str:
        return f"{key(self.subject, self.law)}-{self.first:05d}-{self.count}.npz"


@dataclass(frozen=True, eq=False)
class Chunk:
    """What a chunk's file holds.

    normal : per model, the (p, p) sum of a a^T and the (p,) sum of a, with a = features / energy, so that eq. 5 of
        FlexMaps 6.2 is |normal matrix p - right side|^2 up to a constant
    fitted : number of samples in the sums
    counts : converged, failed, needing load steps, seconds of computing
    kept : the held-out samples, and every failed one
    """

    normal: dict[str, tuple[np.ndarray, np.ndarray]]
    fitted: dict[str, int]
    counts: dict[str, float]
    kept: Samples


def tasks(per_law: dict[str, int] | None = None) -> list[Task]:
    """All chunks: the first of every spiral, then up to ``ENOUGH`` samples of every one, then what is left.

    So all spirals are visited early, and yet a spiral's mesh and its factor's numbering are made once for many chunks.
    """
    per_law = per_law or PER_LAW
    every = [
        Task(subject, law, first, min(CHUNK, per_law[law] - first))
        for subject in subjects()
        for law in LAWS
        for first in range(0, per_law.get(law, 0), CHUNK)
    ]
    return sorted(every, key=lambda task: (task.first > 0) + (task.first >= ENOUGH))


@lru_cache(maxsize=1)
def _sampler(subject: Subject, law: str) -> tuple[Sampler, np.ndarray]:
    sampler = Sampler(subject, law)
    motions = linear.unit_motions(sampler.model)
    return sampler, linear.tip_compliance(sampler.model, motions)


def compute(task: Task, keep: Path | None = None) -> bytes:
    """Solve the samples of a chunk; the bytes of its file. ``keep`` is a folder for all its raw samples."""
    sampler, compliance = _sampler(task.subject, task.law)
    samples = sampler.samples(range(task.first, task.first + task.count))
    if keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
        write(keep / task.name, _packed(samples))
    ok = samples.converged
    held = samples.number % HELD_OUT == 0
    fit = samples.chosen(ok & ~held)
    rest = sampler.model.solid.tip_centres
    arrays: dict[str, np.ndarray] = {}
    rotations = fit.rotations
    features = {
        "chord": (rods.chord_features(fit.centres, rotations, rest), fit.energy),
        "arm": (rods.stiffness_features(rods.arm_motions(fit.centres, rotations, rest)), fit.energy),
    }
    for name, (values, energy) in features.items():
        relative = values / energy[:, None]
        arrays[f"{name}_matrix"], arrays[f"{name}_side"] = relative.T @ relative, relative.sum(0)
        arrays[f"{name}_fitted"] = np.array(len(energy))
    arrays.update({f"kept_{n}": v for n, v in _columns(samples.chosen(held | ~ok)).items()})
    counts = {"converged": int(ok.sum()), "failed": int((~ok).sum()), "stepped": int((samples.steps > 1).sum())}
    header = {"version": VERSION, "task": asdict(task), "counts": counts, "iterations": int(samples.iterations.sum())}
    arrays["compliance"] = compliance
    return archive({**arrays, "header": np.array(json.dumps(header, sort_keys=True))})


def joint_wrenches(samples: Samples, rest_tips: np.ndarray) -> np.ndarray:
    """(3 n, 6) the loads of tips 1-3 in their arms' axes, which turn with the hub."""
    frames = rods._arm_frames(rest_tips)[1:]
    turned = np.einsum(
        "nji,nkjl->nkil", samples.rotations[:, rods.HUB], samples.wrenches.reshape(-1, 3, 2, 3).swapaxes(2, 3)
    )
    return np.einsum("kij,nkil->nklj", frames, turned).reshape(-1, 6)


def _columns(samples: Samples) -> dict[str, np.ndarray]:
    """Compact columns: energies stay double, the rest goes to single precision."""
    out = {}
    for name, value in vars(samples).items():
        single = value.dtype == float and name != "energy"
        out[name] = value.astype(np.float32) if single else value.astype(np.int32) if value.dtype.kind == "i" else value
    return out


def _packed(samples: Samples) -> bytes:
    return archive(_columns(samples))


def archive(arrays: dict[str, np.ndarray]) -> bytes:
    """An .npz whose bytes depend on the arrays alone (numpy's own holds the time of day)."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(arrays):
            buffer = io.BytesIO()
            np.save(buffer, arrays[name], allow_pickle=False)
            archive.writestr(
                zipfile.ZipInfo(name + ".npy", (1980, 1, 1, 0, 0, 0)), buffer.getvalue(), zipfile.ZIP_DEFLATED
            )
    return stream.getvalue()


def write(path: Path, data: bytes) -> None:
    """Write a file whole or not at all."""
    import os

    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    part.write_bytes(data)
    part.replace(path)


def read(source: Path | bytes) -> Chunk | None:
    """A chunk, or None where the file is broken or of another version."""
    try:
        with np.load(io.BytesIO(source) if isinstance(source, bytes) else source, allow_pickle=False) as stored:
            header = json.loads(str(stored["header"]))
            if header["version"] != VERSION:
                return None
            kept = {n: stored[f"kept_{n}"] for n in Samples.__dataclass_fields__}
            normal = {m: (stored[f"{m}_matrix"], stored[f"{m}_side"]) for m in MODELS}
            fitted = {m: int(stored[f"{m}_fitted"]) for m in MODELS}
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, EOFError):
        return None
    counts = {**header["counts"], "iterations": header["iterations"]}
    return Chunk(
        normal, fitted, counts, Samples(**{n: v.astype(float) if v.dtype.kind == "f" else v for n, v in kept.items()})
    )


def is_done(folder: Path, task: Task) -> bool:
    """Whether the chunk's file is there and whole."""
    path = folder / task.name
    return path.is_file() and read(path) is not None


# -- many chunks in one small file, which travels with the repository ------------------------------------------------


def packed_names(pack_file: Path) -> set[str]:
    """File names of the chunks whose sums are in a packed file; none where it is missing or of another version."""
    return {name for entry in _packed_series(pack_file).values() for name in entry["chunks"]}


def _packed_series(pack_file: Path) -> dict[str, dict]:
    """Per key of spiral and law what a packed file holds: its header's entry, the kept samples and the sums."""
    if not pack_file.is_file():
        return {}
    try:
        with np.load(pack_file, allow_pickle=False) as stored:
            header = json.loads(str(stored["header"]))
            arrays = {n: stored[n] for n in stored.files if n != "header"}
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, EOFError):
        return {}
    if header["version"] != VERSION:
        return {}
    out = {}
    for number, entry in enumerate(header["series"]):
        mine = arrays["kept_series"] == number
        columns = {n: arrays[f"kept_{n}"][mine] for n in Samples.__dataclass_fields__}
        sums = {n: arrays[n][number] for n in SUMS}
        out[entry["key"]] = {**entry, "kept": Samples(**columns), "sums": sums}
    return out


SUMS = (*(f"{m}_{part}" for m in MODELS for part in ("matrix", "side")), "compliance")


def pack(folder: Path, target: Path, per_law: dict[str, int] | None = None) -> int:
    """Add the finished chunks of a folder to what a packed file holds already; how many chunks it holds then.

    Spirals whose key has changed since (geometry, mesh or law) are dropped from the file.
    """
    known = _packed_series(target)
    by_series: dict[tuple[Subject, str], list[Task]] = {}
    for task in tasks(per_law):
        by_series.setdefault((task.subject, task.law), []).append(task)
    entries = []
    for (subject, law), members in by_series.items():
        name = key(subject, law)
        entry = known.get(name) or {"key": name, "law": law, "subject": asdict(subject), "chunks": []}
        for task in members:
            if task.name not in entry["chunks"] and (folder / task.name).is_file():
                entry = _with_chunk(entry, task.name, folder / task.name)
        if entry["chunks"]:
            entries.append(entry)
    if not entries:
        return 0
    columns = [_columns(e["kept"]) for e in entries]
    packed = {f"kept_{n}": np.concatenate([c[n] for c in columns]) for n in Samples.__dataclass_fields__}
    packed["kept_series"] = np.repeat(np.arange(len(entries), dtype=np.int32), [len(c["number"]) for c in columns])
    packed.update({n: np.array([e["sums"][n] for e in entries]) for n in SUMS})
    series = [{k: v for k, v in e.items() if k not in ("kept", "sums")} for e in entries]
    packed["header"] = np.array(json.dumps({"version": VERSION, "series": series}, sort_keys=True))
    target.parent.mkdir(parents=True, exist_ok=True)
    write(target, archive(packed))
    return sum(len(e["chunks"]) for e in entries)


def _with_chunk(entry: dict, name: str, path: Path) -> dict:
    """A series' entry with one more chunk; as it was where the file is broken."""
    chunk = read(path)
    if chunk is None:
        return entry
    with np.load(path, allow_pickle=False) as stored:
        sums = {n: stored[n] for n in SUMS}
    counts, fitted, kept = chunk.counts, chunk.fitted, chunk.kept
    if entry["chunks"]:
        old = entry["sums"]
        sums = {n: old[n] if n == "compliance" else old[n] + sums[n] for n in SUMS}
        counts = {k: entry["counts"][k] + v for k, v in counts.items()}
        fitted = {m: entry["fitted"][m] + v for m, v in fitted.items()}
        kept = Samples.joined([entry["kept"], kept])
    return {**entry, "chunks": [*entry["chunks"], name], "counts": counts, "fitted": fitted, "kept": kept, "sums": sums}
