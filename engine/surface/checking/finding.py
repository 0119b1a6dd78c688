"""Findings (faults of a mesh), and helpers for their messages."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

REMESH = "use Quad remesh"


@dataclass(frozen=True)
class Finding:
    """A fault of a mesh.

    code : kind of the fault, see the table in ``check``
    severity : "error" or "warning"
    faces : indices of the faces with the fault, in the mesh as it was read
    edges : indices of the edges with the fault, in ``topology.Sides.edges`` of that mesh
    growth_factor : factor by which the model must grow to mend the fault; None if the fault does not depend on its size
    """

    code: str
    severity: str
    message: str
    faces: tuple[int, ...] = ()
    edges: tuple[int, ...] = ()
    growth_factor: float | None = None

    @property
    def is_error(self) -> bool:
        """Whether the fault prevents fabrication."""
        return self.severity == "error"

    def as_dict(self) -> dict[str, Any]:
        """Return the fields for report.json."""
        return {"code": self.code, "severity": self.severity, "message": self.message, "faces": list(self.faces)}


def make_finding(code: str, message: str, faces: Any = (), edges: Any = (), severity: str = "error") -> Finding:
    """Make a ``Finding`` from any sequences of indices.

    Parameters
    ----------
    code, message : kind of the fault, text for the reader
    faces, edges : indices of the faces and edges with the fault
    severity : "error" or "warning"
    """
    return Finding(
        code, severity, message, tuple(np.asarray(faces, int).tolist()), tuple(np.asarray(edges, int).tolist())
    )


def merge_alike(findings: Iterable[Finding]) -> list[Finding]:
    """Merge findings with equal code and message into one finding that lists all their faces and edges."""
    by_words: dict[tuple[str, str], list[Finding]] = {}
    for one in findings:
        by_words.setdefault((one.code, one.message), []).append(one)
    return [
        replace(
            alike[0],
            faces=tuple(face for one in alike for face in one.faces),
            edges=tuple(edge for one in alike for edge in one.edges),
        )
        for alike in by_words.values()
    ]


def with_count(n: int, one: str, many: str) -> str:
    """Return for example "1 edge has" or "2 edges have".

    Parameters
    ----------
    n : count
    one, many : words after the number, singular and plural
    """
    return f"{n} {one if n == 1 else many}"


def list_faces(faces: Any, one: str = "", many: str = "") -> str:
    """Return for example "3 faces (4, 7, 12)" or "3 faces (4, 7, 12) have"; long lists are cut short.

    Parameters
    ----------
    faces : face indices
    one, many : verb after the faces, singular and plural, or ""
    """
    faces = np.asarray(faces)
    shown = ", ".join(str(f) for f in faces[:5].tolist())
    verb = one if len(faces) == 1 else many
    return f"{with_count(len(faces), 'face', 'faces')} ({shown}{', ...' if len(faces) > 5 else ''}) {verb}".rstrip()
