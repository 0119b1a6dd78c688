"""Cache of a design's drawings and measurements, reused in part by designs in which a few spirals differ."""

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
    """Drawings and measurements of a design.

    by_tolerance : fitted edges and outlines without connectors; key: tolerance in metres
    min_slot_and_bridge : result of ``SpiralDesign.measure_slot_and_bridge``; None before its first call
    similar_edges : fitted edges of a similar design; key: tolerance in metres
    changed_quads : quads whose arms differ between this design and the edges in ``similar_edges``
    contact_free : patches whose outlines are known not to touch themselves or each other
    """

    by_tolerance: dict[float, tuple[FittedArcs, list[Outline]]] = field(default_factory=dict)
    min_slot_and_bridge: tuple[float, float] | None = None
    similar_edges: dict[float, FittedArcs] = field(default_factory=dict)
    changed_quads: Int[np.ndarray, " some"] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    contact_free: set[int] = field(default_factory=set)

    def take_over(
        self, other: DrawingCache, quads: Int[np.ndarray, " some"], patches: Int[np.ndarray, " some"]
    ) -> None:
        """Take over valid entries from the cache of a similar design.

        Parameters
        ----------
        other : cache of the similar design
        quads : all quads whose arms differ between the two designs
        patches : patches of these quads
        """
        self.contact_free = other.contact_free - set(patches.tolist())
        if other.by_tolerance:
            self.similar_edges, self.changed_quads = (
                {tolerance: fitted for tolerance, (fitted, _) in other.by_tolerance.items()},
                quads,
            )
        else:
            self.similar_edges, self.changed_quads = other.similar_edges, np.union1d(other.changed_quads, quads)

    def cached_edges(
        self, tolerance: float, tips: Tips | None
    ) -> tuple[FittedArcs | None, Int[np.ndarray, " arms"] | None]:
        """Return cached edges, and the arms whose edges must be fitted again; (None, None) if nothing is cached.

        Parameters
        ----------
        tolerance : tolerance of the edges, metres
        tips : ends of arms with connectors; None for plain ends
        """
        if tips is not None and tolerance in self.by_tolerance:
            return self.by_tolerance[tolerance][0], np.array(sorted(tips.end_curves), dtype=np.int64)
        if tips is None and tolerance in self.similar_edges:
            return self.similar_edges[tolerance], (4 * self.changed_quads[:, None] + np.arange(4)).ravel()
        return None, None

    def update_contacts(self, outlines: list[Outline], progress: Progress) -> Float[np.ndarray, "n 3"]:
        """Return the contacts (``find_contacts``) of patches not in ``contact_free``, and update ``contact_free``."""
        where = find_contacts(outlines, progress, self.contact_free)
        self.contact_free = set(range(len(outlines))) - set(where[:, 0].astype(int).tolist())
        return where
