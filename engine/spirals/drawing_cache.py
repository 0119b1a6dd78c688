"""Cache of a design's drawings and measurements; some are copied from the design that it was made from."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..arrays import Float, Int
from ..progress import Progress
from .contours import Outline, Tips
from .curves.arcs import FittedArcs
from .touching import find_contacts


@dataclass
class DrawingCache:
    """Cache of a design.

    plain : edges and outlines without connectors, by tolerance; narrowest : the result of ``SpiralDesign.measure``
    earlier : edges of a design whose arms differ in the quads ``changed`` only, by tolerance
    sound : patches whose outlines touch nowhere
    """

    plain: dict[float, tuple[FittedArcs, list[Outline]]] = field(default_factory=dict)
    narrowest: tuple[float, float] | None = None
    earlier: dict[float, FittedArcs] = field(default_factory=dict)
    changed: Int[np.ndarray, " some"] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    sound: set[int] = field(default_factory=set)

    def take_over(
        self, other: DrawingCache, quads: Int[np.ndarray, " some"], patches: Int[np.ndarray, " some"]
    ) -> None:
        """Take over what is known of a design whose arms differ in these quads only, which lie in these patches."""
        self.sound = other.sound - set(patches.tolist())
        if other.plain:
            self.earlier, self.changed = {tolerance: fitted for tolerance, (fitted, _) in other.plain.items()}, quads
        else:
            self.earlier, self.changed = other.earlier, np.union1d(other.changed, quads)

    def known_edges(
        self, tolerance: float, tips: Tips | None
    ) -> tuple[FittedArcs | None, Int[np.ndarray, " arms"] | None]:
        """Return edges that are known, and the arms that must be fitted again; None if none are known."""
        if tips is not None and tolerance in self.plain:
            return self.plain[tolerance][0], np.array(sorted(tips.across), dtype=np.int64)
        if tips is None and tolerance in self.earlier:
            return self.earlier[tolerance], (4 * self.changed[:, None] + np.arange(4)).ravel()
        return None, None

    def contacts(self, drawn: list[Outline], progress: Progress) -> Float[np.ndarray, "n 3"]:
        """Return the places where outlines touch, as ``find_contacts``, which checks only patches not known to be sound."""
        where = find_contacts(drawn, progress, self.sound)
        self.sound = set(range(len(drawn))) - set(where[:, 0].astype(int).tolist())
        return where
