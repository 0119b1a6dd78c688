"""One notice: a short label, a sentence, the faces and edges concerned, and buttons (cures) that help."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .cures import Cure


@dataclass(frozen=True)
class Notice:
    """One notice.

    key : unique name, for ``flexmaps.show_notice`` and ``flexmaps.let_go``
    label : two or three words, for a row of the sidebar
    sentence : the full text, for a tooltip
    severity : one of ``SEVERITIES``
    faces, edges : indices of the faces and edges concerned, in the engine's numbering
    cures : buttons, best first
    """

    key: str
    label: str
    sentence: str
    severity: str
    faces: tuple[int, ...] = ()
    edges: tuple[int, ...] = ()
    cures: tuple[Cure, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for report.json and the command line."""
        cured = [{"name": cure.name, "label": cure.label, "call": cure.call} for cure in self.cures]
        place = {"faces": list(self.faces), "edges": list(self.edges)}
        return {
            "key": self.key,
            "text": self.sentence,
            "words": self.label,
            "kind": self.severity,
            **place,
            "cures": cured,
        }
