"""The stored report: summaries of the stages' results, as JSON in custom properties of the mesh.

The sidebar shows them without computing. Each stage writes one or more report blocks, which are the dictionaries of
report.json, see ``engine/runs/stages.py``; the mesh check writes "checks". A stage that has not run has no block.
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
INPUT_CHECKSUMS = (
    "flexmaps_made_from"  # block -> input -> checksum of the input when the block was written, see ``states``
)
CHECKSUM_SUFFIX = "_sum"  # suffix of the property that holds a text's checksum
PROGRAM = "program"  # key beside a report block's input checksums: version of FlexMaps that wrote the block
TRACED = "traced"  # key in the report block "layout": true where the patches are from Trace, before Merge
# codes of findings of a remesh, about the mesh before it
REMESH_CODES = {"surface-missed", "bodies-left-out", "bodies-joined", "bodies-cut"}
UNSTAMPED = (
    "flexmaps_fresh"  # custom property: names of the report blocks written since ``states.stamp`` was last called
)


# -- texts on the mesh: read only if their checksum is right -----------------------------------------------------------


def _checksum(text: str) -> str:
    return f"{zlib.crc32(text.encode('utf-8', 'surrogatepass')):08x}"


@lru_cache(maxsize=32)
def _parse(text: str, checksum: str) -> dict[str, Any] | None:
    return json.loads(text) if _checksum(text) == checksum else None


def _read_text(mesh: bpy.types.Mesh, name: str) -> dict[str, Any] | None:
    """Return the dictionary that ``put_text`` stored; {} if there is no text or no checksum, None if it is damaged."""
    text, checksum = mesh.get(name), mesh.get(name + CHECKSUM_SUFFIX)
    if text is None or checksum is None:
        return {}
    return _parse(text, checksum) if isinstance(text, str) and isinstance(checksum, str) else None


def put_text(mesh: bpy.types.Mesh, name: str, value: dict[str, Any]) -> None:
    """Store a dictionary on the mesh as JSON text with a checksum."""
    mesh[name] = json.dumps(value)
    mesh[name + CHECKSUM_SUFFIX] = _checksum(mesh[name])


def get_text(mesh: bpy.types.Mesh, name: str) -> dict[str, Any]:
    """Return the dictionary that ``put_text`` stored under a name; {} if it is missing or damaged."""
    return _read_text(mesh, name) or {}


def is_damaged(mesh: bpy.types.Mesh) -> bool:
    """Return whether the stored report or its input checksums are damaged; they are then ignored."""
    return _read_text(mesh, NAME) is None or _read_text(mesh, INPUT_CHECKSUMS) is None


def lacks_checksums(mesh: bpy.types.Mesh) -> bool:
    """Return whether an early version stored the report without checksums; it is then ignored too."""
    return any(name in mesh and name + CHECKSUM_SUFFIX not in mesh for name in (NAME, INPUT_CHECKSUMS))


def _remove_invalid(mesh: bpy.types.Mesh) -> None:
    """Remove a stored report that is damaged or lacks checksums, before a new one is written."""
    if is_damaged(mesh) or lacks_checksums(mesh):
        for name in (NAME, NAME + CHECKSUM_SUFFIX, INPUT_CHECKSUMS, INPUT_CHECKSUMS + CHECKSUM_SUFFIX, UNSTAMPED):
            if name in mesh:
                del mesh[name]


# -- blocks of stages ---------------------------------------------------------------------------------------------------


def read(mesh: bpy.types.Mesh) -> dict[str, Any]:
    """Return all stored report blocks by name. The dictionary is cached: do not modify it."""
    blocks = _read_text(mesh, NAME)
    return {} if not blocks or _read_text(mesh, INPUT_CHECKSUMS) is None else blocks


def missing_result(mesh: bpy.types.Mesh, member: str) -> str | None:
    """Return a sentence that a result is missing and which button makes it; None where its stage has run.

    Parameters
    ----------
    mesh : Blender's mesh
    member : name of a field of the engine's ``Result``
    """
    return None if stages.blocks_describing((member,)) & read(mesh).keys() else stages.MISSING[member]


def read_input_checksums(mesh: bpy.types.Mesh) -> dict[str, dict[str, str]]:
    """Return report block -> input -> checksum of the input. The dictionary is cached: do not modify it."""
    return {} if is_damaged(mesh) else _read_text(mesh, INPUT_CHECKSUMS) or {}


def write_input_checksums(mesh: bpy.types.Mesh, checksums: dict[str, dict[str, str]]) -> None:
    """Store the input checksums of some report blocks and the program's version; other blocks keep theirs."""
    _remove_invalid(mesh)
    put_text(
        mesh,
        INPUT_CHECKSUMS,
        read_input_checksums(mesh) | {name: parts | {PROGRAM: VERSION} for name, parts in checksums.items()},
    )


def read_version(mesh: bpy.types.Mesh) -> str:
    """Return a version that wrote report blocks: the newest if it is newer than this program, else the oldest."""
    if lacks_checksums(mesh):
        return versions.FIRST_VERSION
    made = read_input_checksums(mesh)
    made_by = [str(made.get(name, {}).get(PROGRAM, versions.FIRST_VERSION)) for name in read(mesh).keys() - {"checks"}]
    newest = max(made_by, key=versions.version_key, default=VERSION)
    return (
        newest
        if versions.version_key(newest) > versions.version_key(VERSION)
        else min(made_by, key=versions.version_key, default=VERSION)
    )


def write(mesh: bpy.types.Mesh, stage: str, block: object) -> None:
    """Store a report block, and remove the blocks of later stages, which are now out of date.

    Parameters
    ----------
    mesh : Blender's mesh
    stage : name of the block
    block : plain values, stored as JSON
    """
    _remove_invalid(mesh)
    gone = stages.stale_blocks(stage)
    put_text(mesh, NAME, {name: value for name, value in read(mesh).items() if name not in gone} | {stage: block})
    _mark_unstamped(mesh, stage)


def write_all(mesh: bpy.types.Mesh, blocks: dict[str, dict[str, Any]]) -> None:
    """Store several report blocks, in the order of the stages.

    Parameters
    ----------
    mesh : Blender's mesh
    blocks : name -> block, in the order of the stages
    """
    for stage, block in blocks.items():
        write(mesh, stage, block)


def drop_from(mesh: bpy.types.Mesh, stage: str) -> None:
    """Remove a report block and the blocks of all later stages.

    Parameters
    ----------
    mesh : Blender's mesh
    stage : name of the block
    """
    _remove_invalid(mesh)
    gone = stages.stale_blocks(stage) | {stage}
    put_text(mesh, NAME, {name: value for name, value in read(mesh).items() if name not in gone})


def write_checks(mesh: bpy.types.Mesh, findings: Sequence[Finding]) -> None:
    """Store the findings of the mesh check; no stage becomes out of date.

    Findings of a remesh are kept while the number of quads stays the same, because a check of the quads cannot find
    them.

    Parameters
    ----------
    mesh : Blender's mesh
    findings : findings of the check
    """
    count = len(mesh.polygons)
    blocks = [
        finding.as_dict() | {"edges": list(finding.edges), "quads": count, "larger": finding.growth_factor}
        for finding in findings
    ]
    codes = REMESH_CODES - {block["code"] for block in blocks}
    blocks += [
        block for block in read(mesh).get("checks", ()) if block["code"] in codes and block.get("quads") == count
    ]
    _remove_invalid(mesh)
    put_text(mesh, NAME, read(mesh) | {"checks": blocks})
    _mark_unstamped(mesh, "checks")


def _mark_unstamped(mesh: bpy.types.Mesh, stage: str) -> None:
    mesh[UNSTAMPED] = " ".join({*str(mesh.get(UNSTAMPED, "")).split(), stage})


def pop_unstamped(mesh: bpy.types.Mesh) -> set[str]:
    """Return the names of the report blocks written since the last call, as far as they still exist."""
    fresh = set(str(mesh.get(UNSTAMPED, "")).split())
    if UNSTAMPED in mesh:
        del mesh[UNSTAMPED]
    return fresh & set(read(mesh))
