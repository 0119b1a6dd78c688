"""Many chunks in one small file, which travels with the repository: sums per spiral and law, and the samples kept."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from ..engine.errors import FlexMapsError
from . import chunks
from .chunks import MODELS, Chunk, Task
from .sampling import VERSION, Samples, Subject, key


@dataclass(frozen=True, eq=False)
class Series(Chunk):
    """All chunks of one spiral under one load law, joined.

    key : that of spiral and law, see ``sampling.key``, when the chunks were made
    names : those of the chunks' files
    """

    subject: Subject
    law: str
    key: str
    names: tuple[str, ...]

    @property
    def held_out(self) -> Samples:
        """The converged samples that no fit has seen."""
        return self.kept.chosen(self.kept.converged & (self.kept.number % chunks.HELD_OUT == 0))

    @property
    def rest_tips(self) -> np.ndarray:
        """(4, 3) rest positions of the tips against the hub, in arm widths."""
        z = self.subject.spiral.radius * 1j ** np.arange(4)
        return np.column_stack([z.real, z.imag, np.zeros(4)])


def read(path: Path) -> list[Series]:
    """All series of a packed file; raises FlexMapsError where it is missing, broken or of another version."""
    if not path.is_file():
        raise FlexMapsError(f"{path} is not there; run: tools/dev.py database build")
    header, arrays = chunks.contents(path)
    out = []
    for number, entry in enumerate(header["series"]):
        mine = arrays["kept_series"] == number
        out.append(
            Series(
                normal={m: (arrays[f"{m}_matrix"][number], arrays[f"{m}_side"][number]) for m in MODELS},
                fitted=entry["fitted"],
                counts=entry["counts"],
                compliance=arrays["compliance"][number],
                kept=chunks.samples_from({n: arrays[f"kept_{n}"][mine] for n in Samples.__dataclass_fields__}),
                subject=Subject(**entry["subject"]),
                law=entry["law"],
                key=entry["key"],
                names=tuple(entry["chunks"]),
            )
        )
    return out


def write(path: Path, all_series: list[Series]) -> None:
    """Write a packed file, whole or not at all."""
    columns = [chunks.columns(s.kept) for s in all_series]
    arrays = {f"kept_{n}": np.concatenate([c[n] for c in columns]) for n in Samples.__dataclass_fields__}
    arrays["kept_series"] = np.repeat(np.arange(len(columns), dtype=np.int32), [len(c["number"]) for c in columns])
    for m in MODELS:
        for position, part in enumerate(("matrix", "side")):
            arrays[f"{m}_{part}"] = np.array([s.normal[m][position] for s in all_series])
    arrays["compliance"] = np.array([s.compliance for s in all_series])
    entries = [
        {
            "key": s.key,
            "law": s.law,
            "subject": asdict(s.subject),
            "chunks": s.names,
            "counts": s.counts,
            "fitted": s.fitted,
        }
        for s in all_series
    ]
    arrays["header"] = np.array(json.dumps({"version": VERSION, "series": entries}, sort_keys=True))
    path.parent.mkdir(parents=True, exist_ok=True)
    chunks.write(path, chunks.archive(arrays))


def known(path: Path) -> list[Series]:
    """Like ``read``, but nothing where there is nothing that can be read: it is built again then."""
    try:
        return read(path)
    except FlexMapsError:
        return []


def gather(folder: Path, path: Path, wanted: list[Task]) -> int:
    """Add the finished chunks of a folder to what a packed file holds already; how many chunks it holds then.

    Series of spirals whose geometry, mesh or law has changed since are dropped from it.
    """
    held: dict[str, Series] = {s.key: s for s in known(path) if s.key == key(s.subject, s.law)}
    for task in wanted:
        name = key(task.subject, task.law)
        before = held.get(name)
        if before and task.name in before.names:
            continue
        chunk = chunks.read(folder / task.name)
        if chunk is not None:
            whole = before.joined(chunk) if before else chunk
            names = (*(before.names if before else ()), task.name)
            held[name] = Series(**vars(whole), subject=task.subject, law=task.law, key=name, names=names)
    if held:
        write(path, list(held.values()))
    return sum(len(s.names) for s in held.values())
