"""Cache of a design's drawings and measurements, reused in part by designs with a few other spirals."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..arrays import Float, Int
from ..progress import Progress
from .contacts import find_contacts
from .contours import Outline, Tips
from .curves.arcs import FittedArcs


@dataclass
class DrawingCache:
    """Cache of a design.

    plain : fitted edges and outlines without connectors; key: tolerance in metres
    narrowest : result of ``SpiralDesign.measure``; None before its first call
    earlier : fitted edges of a similar design, whose arms differ only in the quads ``changed``; key: tolerance
    changed : quads whose arms differ from the edges in ``earlier``
    sound : patches whose outlines are known not to touch themselves or each other
    """

    plain: dict[float, tuple[FittedArcs, list[Outline]]] = field(default_factory=dict)
    narrowest: tuple[float, float] | None = None
    earlier: dict[float, FittedArcs] = field(default_factory=dict)
    changed: Int[np.ndarray, " some"] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    sound: set[int] = field(default_factory=set)

    def take_over(
        self, other: DrawingCache, quads: Int[np.ndarray, " some"], patches: Int[np.ndarray, " some"]
    ) -> None:
        """Take over valid entries from the cache of a similar design.

        Parameters
        ----------
        other : cache of the similar design
        quads : all quads whose arms differ
        patches : patches of these quads
        """
        self.sound = other.sound - set(patches.tolist())
        if other.plain:
            self.earlier, self.changed = {tolerance: fitted for tolerance, (fitted, _) in other.plain.items()}, quads
        else:
            self.earlier, self.changed = other.earlier, np.union1d(other.changed, quads)

    def known_edges(
        self, tolerance: float, tips: Tips | None
    ) -> tuple[FittedArcs | None, Int[np.ndarray, " arms"] | None]:
        """Return cached edges, and the arms whose edges must be fitted again; (None, None) if nothing is cached.

        Parameters
        ----------
        tolerance : tolerance of the edges, metres
        tips : ends of arms with connectors; None for plain ends
        """
        if tips is not None and tolerance in self.plain:
            return self.plain[tolerance][0], np.array(sorted(tips.across), dtype=np.int64)
        if tips is None and tolerance in self.earlier:
            return self.earlier[tolerance], (4 * self.changed[:, None] + np.arange(4)).ravel()
        return None, None

    def contacts(self, drawn: list[Outline], progress: Progress) -> Float[np.ndarray, "n 3"]:
        """Return the result of ``find_contacts``, checking only patches not in ``sound``, and update ``sound``."""
        where = find_contacts(drawn, progress, self.sound)
        self.sound = set(range(len(drawn))) - set(where[:, 0].astype(int).tolist())
        return where
