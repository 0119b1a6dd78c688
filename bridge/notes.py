"""What a stage found out, kept on the mesh as text, so that the sidebar shows it without computing.

The blocks are those of report.json ("checks", "layout", "spirals", "equilibrium", "reach", "optimise",
"sheets"); a stage that has not run is absent.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import bpy

if TYPE_CHECKING:
    from ..engine.surface.check import Finding

NAME = "flexmaps_report"
TRACED = "traced"  # in the layout's block: there are patches that nobody has tried to join yet
FRESH = "flexmaps_fresh"  # on the mesh while a stage writes: which blocks it wrote
# how late a stage comes: running it makes everything that comes later out of date
ORDER = {"checks": 0, "layout": 1, "spirals": 2, "equilibrium": 3, "reach": 3, "optimise": 3, "sheets": 3}


@lru_cache(maxsize=32)
def _parsed(text: str) -> dict[str, Any]:
    return json.loads(text)


def read(mesh: bpy.types.Mesh) -> dict[str, Any]:
    """The blocks that are there; do not change the returned dict."""
    text = mesh.get(NAME)
    return _parsed(text) if isinstance(text, str) else {}


def write(mesh: bpy.types.Mesh, stage: str, block: Any) -> None:
    """Put the block of a stage, and drop those of the stages after it, which it made out of date."""
    kept = {name: value for name, value in read(mesh).items() if name != stage and ORDER[name] <= ORDER[stage]}
    kept[stage] = block
    mesh[NAME] = json.dumps(kept)
    _note_fresh(mesh, stage)


def drop_from(mesh: bpy.types.Mesh, stage: str) -> None:
    """Drop the block of a stage and those after it."""
    kept = {name: value for name, value in read(mesh).items() if ORDER[name] < ORDER[stage]}
    mesh[NAME] = json.dumps(kept)


def write_checks(mesh: bpy.types.Mesh, findings: Sequence[Finding]) -> None:
    """Put the findings of the check, with their edges; they make nothing out of date."""
    blocks = [finding.as_dict() | {"edges": list(finding.edges)} for finding in findings]
    mesh[NAME] = json.dumps(dict(read(mesh)) | {"checks": blocks})
    _note_fresh(mesh, "checks")


def _note_fresh(mesh: bpy.types.Mesh, stage: str) -> None:
    mesh[FRESH] = " ".join({*str(mesh.get(FRESH, "")).split(), stage})


def take_fresh(mesh: bpy.types.Mesh) -> set[str]:
    """The stages whose blocks were written since this was last asked, those dropped since left out."""
    fresh = set(str(mesh.get(FRESH, "")).split())
    if FRESH in mesh:
        del mesh[FRESH]
    return fresh & set(read(mesh))
