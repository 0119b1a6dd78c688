"""One fault of a mesh, and how it is told."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

REMESH = "use the quad remesh (voxel remesh and QuadriFlow in Blender)"


@dataclass(frozen=True)
class Finding:
    """One fault of a mesh.

    faces : indices in the mesh as it came; edges : indices in ``edges_of`` the mesh as it came
    larger : times that the model would have to be larger; None where its size is not to blame
    """

    code: str
    severity: str
    message: str
    faces: tuple[int, ...] = ()
    edges: tuple[int, ...] = ()
    larger: float | None = None

    @property
    def is_error(self) -> bool:
        return self.severity == "error"

    def as_dict(self) -> dict[str, Any]:
        """For report.json."""
        return {"code": self.code, "severity": self.severity, "message": self.message, "faces": list(self.faces)}


def finding(code: str, message: str, faces: Any = (), edges: Any = (), severity: str = "error") -> Finding:
    """A finding from indices of any kind."""
    return Finding(
        code, severity, message, tuple(np.asarray(faces, int).tolist()), tuple(np.asarray(edges, int).tolist())
    )


def joined_alike(findings: Iterable[Finding]) -> list[Finding]:
    """The findings, those of the same words as one that names the places of all."""
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


def counted(n: int, one: str, many: str) -> str:
    """For example "1 edge has" or "2 edges have"."""
    return f"{n} {one if n == 1 else many}"


def named(faces: Any) -> str:
    """For example "3 faces (4, 7, 12)"; long lists are cut short."""
    faces = np.asarray(faces)
    shown = ", ".join(str(f) for f in faces[:5].tolist())
    return f"{counted(len(faces), 'face', 'faces')} ({shown}{', ...' if len(faces) > 5 else ''})"
