"""Results of stages, kept on the mesh as text, so that the sidebar shows them without computing.

The blocks are those of report.json, see ``engine/runs/stages.py``, and "checks"; a stage that has not run has no block.
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
MADE_FROM = "flexmaps_made_from"  # stage -> part -> checksum of the stage's inputs, see ``states``
SUM = "_sum"  # suffix of a text's name under which the text's checksum is stored
PROGRAM = "program"  # key beside the checksums of a stage: the version that made it
TRACED = "traced"  # key in the layout's block: Trace made these patches, and Merge has not run yet
# codes of findings about the mesh before the remesh
OF_REMESH = {"surface-missed", "bodies-left-out", "bodies-joined", "bodies-cut"}
FRESH = "flexmaps_fresh"  # names of the blocks written since the last stamp


# -- texts on the mesh: read only if their checksum is right -------------------------------------------------------------


def _checksum(text: str) -> str:
    return f"{zlib.crc32(text.encode('utf-8', 'surrogatepass')):08x}"


@lru_cache(maxsize=32)
def _parse(text: str, checksum: str) -> dict[str, Any] | None:
    return json.loads(text) if _checksum(text) == checksum else None


def _get(mesh: bpy.types.Mesh, name: str) -> dict[str, Any] | None:
    """Return what ``_put`` wrote; {} where there is nothing or no checksum yet, None where it is damaged."""
    text, checksum = mesh.get(name), mesh.get(name + SUM)
    if text is None or checksum is None:
        return {}
    return _parse(text, checksum) if isinstance(text, str) and isinstance(checksum, str) else None


def put_text(mesh: bpy.types.Mesh, name: str, value: dict[str, Any]) -> None:
    """Store a dictionary on the mesh as text with a checksum."""
    mesh[name] = json.dumps(value)
    mesh[name + SUM] = _checksum(mesh[name])


def get_text(mesh: bpy.types.Mesh, name: str) -> dict[str, Any]:
    """Return the dictionary that ``put_text`` stored under a name; {} where there is none or it is damaged."""
    return _get(mesh, name) or {}


def unsound(mesh: bpy.types.Mesh) -> bool:
    """Return whether the stored texts are damaged; they are then ignored."""
    return _get(mesh, NAME) is None or _get(mesh, MADE_FROM) is None


def unsealed(mesh: bpy.types.Mesh) -> bool:
    """Return whether an early version without checksums wrote the notes; they may be damaged, and are ignored too."""
    return any(name in mesh and name + SUM not in mesh for name in (NAME, MADE_FROM))


def _begin(mesh: bpy.types.Mesh) -> None:
    """Remove notes that are ignored, before new ones are written."""
    if unsound(mesh) or unsealed(mesh):
        for name in (NAME, NAME + SUM, MADE_FROM, MADE_FROM + SUM, FRESH):
            if name in mesh:
                del mesh[name]


# -- blocks of stages ---------------------------------------------------------------------------------------------------


def read(mesh: bpy.types.Mesh) -> dict[str, Any]:
    """Return the stored blocks; do not change the returned dict."""
    blocks = _get(mesh, NAME)
    return {} if not blocks or _get(mesh, MADE_FROM) is None else blocks


def missing(mesh: bpy.types.Mesh, member: str) -> str | None:
    """Return why a member of the engine's ``Result`` is missing, as a sentence; None where its stage has run.

    Parameters
    ----------
    mesh : Blender's mesh
    member : name of a member of ``Result``
    """
    return None if stages.blocks_describing((member,)) & read(mesh).keys() else stages.MISSING[member]


def made_from(mesh: bpy.types.Mesh) -> dict[str, dict[str, str]]:
    """Return stage -> part -> checksum of the stage's inputs; do not change the returned dict."""
    return {} if unsound(mesh) else _get(mesh, MADE_FROM) or {}


def write_made_from(mesh: bpy.types.Mesh, made: dict[str, dict[str, str]]) -> None:
    """Store the input checksums of some stages with this version; other stages keep theirs."""
    _begin(mesh)
    put_text(mesh, MADE_FROM, made_from(mesh) | {name: parts | {PROGRAM: VERSION} for name, parts in made.items()})


def made_with(mesh: bpy.types.Mesh) -> str:
    """Return the version that made the notes: the newest if it is newer than this program, else the oldest."""
    if unsealed(mesh):
        return versions.FIRST_VERSION
    made = made_from(mesh)
    made_by = [str(made.get(name, {}).get(PROGRAM, versions.FIRST_VERSION)) for name in read(mesh).keys() - {"checks"}]
    newest = max(made_by, key=versions.order, default=VERSION)
    return (
        newest
        if versions.order(newest) > versions.order(VERSION)
        else min(made_by, key=versions.order, default=VERSION)
    )


def write(mesh: bpy.types.Mesh, stage: str, block: object) -> None:
    """Store the block of a stage, and drop the blocks of later stages, which are now out of date.

    Parameters
    ----------
    mesh : Blender's mesh
    stage : name of the block
    block : plain values, which become JSON
    """
    _begin(mesh)
    gone = stages.stale_blocks(stage)
    put_text(mesh, NAME, {name: value for name, value in read(mesh).items() if name not in gone} | {stage: block})
    _note_fresh(mesh, stage)


def write_all(mesh: bpy.types.Mesh, blocks: dict[str, dict[str, Any]]) -> None:
    """Store the blocks of several stages, in the order of the stages.

    Parameters
    ----------
    mesh : Blender's mesh
    blocks : name -> block, in the order of the stages
    """
    for stage, block in blocks.items():
        write(mesh, stage, block)


def drop_from(mesh: bpy.types.Mesh, stage: str) -> None:
    """Drop the block of a stage and of all later ones.

    Parameters
    ----------
    mesh : Blender's mesh
    stage : name of the block
    """
    _begin(mesh)
    gone = stages.stale_blocks(stage) | {stage}
    put_text(mesh, NAME, {name: value for name, value in read(mesh).items() if name not in gone})


def write_checks(mesh: bpy.types.Mesh, findings: Sequence[Finding]) -> None:
    """Store the findings of the check with their edges; no stage becomes out of date.

    Findings of the remesh stay while the number of quads is the same, because a check of the quads cannot find them.

    Parameters
    ----------
    mesh : Blender's mesh
    findings : findings of the check
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
    put_text(mesh, NAME, read(mesh) | {"checks": blocks})
    _note_fresh(mesh, "checks")


def _note_fresh(mesh: bpy.types.Mesh, stage: str) -> None:
    mesh[FRESH] = " ".join({*str(mesh.get(FRESH, "")).split(), stage})


def take_fresh(mesh: bpy.types.Mesh) -> set[str]:
    """Return the blocks that were written since the last call and still exist."""
    fresh = set(str(mesh.get(FRESH, "")).split())
    if FRESH in mesh:
        del mesh[FRESH]
    return fresh & set(read(mesh))
