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

from ..engine.arrays import Float
from ..engine.errors import FlexMapsError
from . import linear, rods
from .sampling import LAWS, VERSION, Sampler, Samples, Subject, key, subjects

CHUNK = 25  # samples in a file: what is lost at most when the work is stopped
HELD_OUT = 10  # one sample in this many is kept whole and never fitted
ENOUGH = 400  # samples of a spiral after which more hardly change its fits
PER_LAW = {"strain": 1000, "newton": 200}  # samples of a spiral that are made, by the law of their loads
# the models whose parameters are fitted to samples; the hub-to-hub one follows from the linear limit
MODELS = ("chord", "arm")


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
    counts : how many converged, failed, needed load steps; Newton iterations of all
    compliance : of one tip in the linear limit, dimensionless
    kept : the held-out samples, and every failed one
    """

    normal: dict[str, tuple[np.ndarray, np.ndarray]]
    fitted: dict[str, int]
    counts: dict[str, int]
    compliance: Float[np.ndarray, "6 6"]
    kept: Samples

    def joined(self, other: Chunk) -> Chunk:
        """Both as one; the compliance is the same in every chunk of a spiral."""
        return Chunk(
            {m: tuple(a + b for a, b in zip(self.normal[m], other.normal[m])) for m in MODELS},
            {m: self.fitted[m] + other.fitted[m] for m in MODELS},
            {k: v + other.counts[k] for k, v in self.counts.items()},
            self.compliance,
            Samples.joined([self.kept, other.kept]),
        )


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
def _sampler(subject: Subject, law: str) -> tuple[Sampler, Float[np.ndarray, "6 6"]]:
    sampler = Sampler(subject, law)
    motions = linear.unit_motions(sampler.model)
    return sampler, linear.tip_compliance(sampler.model, motions)


def compute(task: Task, keep: Path | None = None) -> bytes:
    """Solve the samples of a chunk; the bytes of its file. ``keep`` is a folder for all its raw samples."""
    sampler, compliance = _sampler(task.subject, task.law)
    samples = sampler.samples(range(task.first, task.first + task.count))
    if keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
        write(keep / task.name, archive(columns(samples)))
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
    arrays.update({f"kept_{n}": v for n, v in columns(samples.chosen(held | ~ok)).items()})
    counts = {"converged": int(ok.sum()), "failed": int((~ok).sum()), "stepped": int((samples.steps > 1).sum())}
    header = {"version": VERSION, "task": asdict(task), "counts": counts, "iterations": int(samples.iterations.sum())}
    arrays["compliance"] = compliance
    return archive({**arrays, "header": np.array(json.dumps(header, sort_keys=True))})


def columns(samples: Samples) -> dict[str, np.ndarray]:
    """Compact columns: energies stay double, the rest goes to single precision."""
    out = {}
    for name, value in vars(samples).items():
        single = value.dtype == float and name != "energy"
        out[name] = value.astype(np.float32) if single else value.astype(np.int32) if value.dtype.kind == "i" else value
    return out


def samples_from(arrays: dict[str, np.ndarray]) -> Samples:
    """The samples that ``columns`` made compact."""
    return Samples(**{n: v.astype(float) if v.dtype.kind == "f" else v for n, v in arrays.items()})


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


def contents(source: Path | bytes) -> tuple[dict, dict[str, np.ndarray]]:
    """Header and arrays of a file of this version; raises FlexMapsError where it is broken or of another one."""
    name = source.name if isinstance(source, Path) else "The chunk"
    try:
        with np.load(io.BytesIO(source) if isinstance(source, bytes) else source, allow_pickle=False) as stored:
            arrays = {n: stored[n] for n in stored.files}
        header = json.loads(str(arrays.pop("header")))
        version = header["version"]
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, EOFError) as error:
        raise FlexMapsError(f"{name} cannot be read ({error}); build the database again") from None
    if version != VERSION:
        raise FlexMapsError(f"{name} is of version {version}, not {VERSION}; build the database again")
    return header, arrays


def read(source: Path | bytes) -> Chunk | None:
    """A chunk, or None where the file is broken or of another version."""
    try:
        header, arrays = contents(source)
        kept = samples_from({n: arrays[f"kept_{n}"] for n in Samples.__dataclass_fields__})
        normal = {m: (arrays[f"{m}_matrix"], arrays[f"{m}_side"]) for m in MODELS}
        fitted = {m: int(arrays[f"{m}_fitted"]) for m in MODELS}
        return Chunk(
            normal, fitted, {**header["counts"], "iterations": header["iterations"]}, arrays["compliance"], kept
        )
    except (FlexMapsError, KeyError):
        return None


def is_done(folder: Path, task: Task) -> bool:
    """Whether the chunk's file is there and whole."""
    path = folder / task.name
    return path.is_file() and read(path) is not None
