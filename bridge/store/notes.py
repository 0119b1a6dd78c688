"""What a stage found out, kept on the mesh as text, so that the sidebar shows it without computing.

The blocks are those of report.json, see ``engine/runs/stages.py``, and "checks"; a stage that has not run is absent.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import bpy

from ...engine import VERSION, versions
from ...engine.runs import stages

if TYPE_CHECKING:
    from ...engine.surface.checking.check import Finding

NAME = "flexmaps_report"
MADE_FROM = "flexmaps_made_from"  # stage -> part -> checksum: what every stage was made from, see ``states``
SUM = "_sum"  # behind the name of a text: where its own checksum stands
PROGRAM = "program"  # beside the checksums of a stage: the version that made it
TRACED = "traced"  # in the layout's block: Trace made these patches, and Merge has not run yet
OF_REMESH = {
    "surface-missed",
    "bodies-left-out",
    "bodies-joined",
    "bodies-cut",
}  # findings about what quads were made from
FRESH = "flexmaps_fresh"  # on the mesh while a stage writes: which blocks it wrote


# -- texts on the mesh: only what this program wrote is read --------------------------------------------------------------


def _checksum(text: str) -> str:
    return f"{zlib.crc32(text.encode('utf-8', 'surrogatepass')):08x}"


@lru_cache(maxsize=32)
def _parsed(text: str, checksum: str) -> dict[str, Any] | None:
    return json.loads(text) if _checksum(text) == checksum else None


def _get(mesh: bpy.types.Mesh, name: str) -> dict[str, Any] | None:
    """What ``_put`` wrote; empty where there is nothing, or what has no checksum yet, None where it is something else."""
    text, checksum = mesh.get(name), mesh.get(name + SUM)
    if text is None or checksum is None:
        return {}
    return _parsed(text, checksum) if isinstance(text, str) and isinstance(checksum, str) else None


def _put(mesh: bpy.types.Mesh, name: str, value: dict[str, Any]) -> None:
    mesh[name] = json.dumps(value)
    mesh[name + SUM] = _checksum(mesh[name])


def get_text(mesh: bpy.types.Mesh, name: str) -> dict[str, Any]:
    """What ``put_text`` keeps under a name; empty where there is nothing, or what something else wrote."""
    return _get(mesh, name) or {}


def put_text(mesh: bpy.types.Mesh, name: str, value: dict[str, Any]) -> None:
    """Keep a dictionary on the mesh as text."""
    _put(mesh, name, value)


def unsound(mesh: bpy.types.Mesh) -> bool:
    """Whether what is kept is damaged, or written by something else; then it counts as nothing."""
    return _get(mesh, NAME) is None or _get(mesh, MADE_FROM) is None


def unsealed(mesh: bpy.types.Mesh) -> bool:
    """Whether a version made the notes that knew no checksums; they cannot be told from damaged ones, and count as nothing too."""
    return any(name in mesh and name + SUM not in mesh for name in (NAME, MADE_FROM))


def _begin(mesh: bpy.types.Mesh) -> None:
    """Call before writing: removes notes that count as nothing."""
    if unsound(mesh) or unsealed(mesh):
        for name in (NAME, NAME + SUM, MADE_FROM, MADE_FROM + SUM, FRESH):
            if name in mesh:
                del mesh[name]


# -- what stages found out -----------------------------------------------------------------------------------------------


def read(mesh: bpy.types.Mesh) -> dict[str, Any]:
    """The blocks that are there; do not change the returned dict."""
    found = _get(mesh, NAME)
    return {} if not found or _get(mesh, MADE_FROM) is None else found


def missing(mesh: bpy.types.Mesh, member: str) -> str | None:
    """Why a member of the engine's ``Result`` is not there, as a sentence; ``None`` where a stage has told of it."""
    return None if stages.blocks_of((member,)) & read(mesh).keys() else stages.MISSING[member]


def made_from(mesh: bpy.types.Mesh) -> dict[str, dict[str, str]]:
    """Of every stage and part the checksum of what it was made from; do not change the returned dict."""
    return {} if unsound(mesh) else _get(mesh, MADE_FROM) or {}


def write_made_from(mesh: bpy.types.Mesh, made: dict[str, dict[str, str]]) -> None:
    """Note what some stages were made from, and by which version; of the others the notes stay."""
    _begin(mesh)
    _put(mesh, MADE_FROM, made_from(mesh) | {name: parts | {PROGRAM: VERSION} for name, parts in made.items()})


def made_with(mesh: bpy.types.Mesh) -> str:
    """The version of the program that made what is noted: the newest, if that is newer than this one, else the oldest."""
    if unsealed(mesh):
        return versions.UNSTAMPED
    made = made_from(mesh)
    found = [str(made.get(name, {}).get(PROGRAM, versions.UNSTAMPED)) for name in read(mesh).keys() - {"checks"}]
    newest = max(found, key=versions.order, default=VERSION)
    return (
        newest if versions.order(newest) > versions.order(VERSION) else min(found, key=versions.order, default=VERSION)
    )


def write(mesh: bpy.types.Mesh, stage: str, block: Any) -> None:
    """Put the block of a stage, and drop those of the stages after it, which it made out of date."""
    _begin(mesh)
    gone = stages.blocks_after(stage)
    _put(mesh, NAME, {name: value for name, value in read(mesh).items() if name not in gone} | {stage: block})
    _note_fresh(mesh, stage)


def write_all(mesh: bpy.types.Mesh, blocks: dict[str, dict[str, Any]]) -> None:
    """Keep the blocks of several stages, in the order of the stages."""
    for stage, block in blocks.items():
        write(mesh, stage, block)


def drop_from(mesh: bpy.types.Mesh, stage: str) -> None:
    """Drop the block of a stage and those after it."""
    _begin(mesh)
    gone = stages.blocks_after(stage) | {stage}
    _put(mesh, NAME, {name: value for name, value in read(mesh).items() if name not in gone})


def write_checks(mesh: bpy.types.Mesh, findings: Sequence[Finding]) -> None:
    """Put the findings of the check, with their edges; they make nothing out of date.

    What the remesh has said of as many quads stays: no check of the quads alone can find it.
    """
    count = len(mesh.polygons)
    blocks = [
        finding.as_dict() | {"edges": list(finding.edges), "quads": count, "larger": finding.larger}
        for finding in findings
    ]
    codes = OF_REMESH - {block["code"] for block in blocks}
    blocks += [
        block for block in read(mesh).get("checks", ()) if block["code"] in codes and block.get("quads") == count
    ]
    _begin(mesh)
    _put(mesh, NAME, read(mesh) | {"checks": blocks})
    _note_fresh(mesh, "checks")


def _note_fresh(mesh: bpy.types.Mesh, stage: str) -> None:
    mesh[FRESH] = " ".join({*str(mesh.get(FRESH, "")).split(), stage})


def take_fresh(mesh: bpy.types.Mesh) -> set[str]:
    """The blocks that were written since the last call and are still there."""
    fresh = set(str(mesh.get(FRESH, "")).split())
    if FRESH in mesh:
        del mesh[FRESH]
    return fresh & set(read(mesh))
