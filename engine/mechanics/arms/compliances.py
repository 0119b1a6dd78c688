"""Compliances of the arms as they are cut: the table's and what the cut adds to it (see ``cut``), with their derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from ...arrays import Float
from ...errors import FlexMapsError
from ...materials import Material
from ..assembly import Assembly
from .cut import TWIST, WIDTH, CutArms, believable, more_compliant, shapes
from .grain import GrainBeams
from .rim_beams import of_rim
from .stiffness import tip_compliance


@dataclass(frozen=True, eq=False)
class ArmCompliances:
    """Compliance of both arms of m joints as they are cut: the table's and what the cut adds to it, in the arms' own axes, SI.

    values : (m, 2, 6, 6); table : without what the cut adds; table_by_scale : its derivative by twice the radius, per metre
    table_by_grain : by the angle to the grain, of sheets that have one, else 0
    by : (m, 2, 5, 6, 6) derivatives of the values by the numbers of ``cut``, per metre and per radian; None where they were not asked for
    """

    values: Float[np.ndarray, "joints 2 6 6"]
    table: Float[np.ndarray, "joints 2 6 6"]
    table_by_scale: Float[np.ndarray, "joints 2 6 6"]
    by: Float[np.ndarray, "joints 2 numbers 6 6"] | None
    table_by_grain: Float[np.ndarray, "joints 2 6 6"]

    def varied(self, change: Float[np.ndarray, "n k"], by_shapes: Float[np.ndarray, "n k 6 6"]) -> ArmCompliances:
        """To first order where the shapes of the arms change, of which ``by_shapes`` is what the cut adds; see ``cut``."""
        shape = self.table.shape
        table = self.table + 2.0 * change[:, 0].reshape(shape[:2])[..., None, None] * self.table_by_scale
        if change.shape[1] > 3:
            # the grain has no sense: half a turn is none
            change[:, 3] = (change[:, 3] + 0.5 * np.pi) % np.pi - 0.5 * np.pi
            table = table + change[:, 3].reshape(shape[:2])[..., None, None] * self.table_by_grain
        added = np.einsum("nkij,nk->nij", by_shapes, change).reshape(shape)
        return replace(self, table=table, values=self.values + (table - self.table) + added)

    def part(self, joints: np.ndarray) -> ArmCompliances:
        return self.each(lambda _, known: known[joints])

    def each(self, made: Callable[[str, np.ndarray], np.ndarray]) -> ArmCompliances:
        """Of all members that are known, what is made of their names and values."""
        known: dict[str, Any] = {one.name: getattr(self, one.name) for one in fields(self)}
        changed: dict[str, Any] = {k: None if value is None else made(k, value) for k, value in known.items()}
        return ArmCompliances(**changed)


def arm_compliances(assembly: Assembly, material: Material, slopes: bool = True) -> ArmCompliances:
    """Tip compliances of both arms of every joint as they are cut, with their derivatives or without them.

    Raises FlexMapsError with the spirals whose width or twist is no number.
    """
    spiral, known = assembly.pairs.ravel(), material.orthotropy
    shape = shapes(assembly, material)
    beam = None if known is None else GrainBeams(known, shape[:, 3], material.youngs, material.poisson)
    try:
        found = tip_compliance(
            2.0 * assembly.radius.ravel(),
            assembly.arm_width.ravel(),
            assembly.twist[spiral],
            thickness=assembly.thickness,
            youngs=material.youngs,
            poisson=material.poisson,
            beam=beam,
        )
    except FlexMapsError as error:
        raise FlexMapsError(str(error), faces=np.unique(spiral[np.asarray(error.faces, dtype=int)])) from None
    arms = CutArms.of(assembly, shape)
    added, by = more_compliant(arms, assembly.thickness, material, slopes)
    share = believable(arms, found.values, added)[:, None, None]
    added = added * share
    if slopes:
        by *= share[..., None]
        by[:, WIDTH] += found.by_width
        by[:, TWIST] += found.by_twist
    both = assembly.pairs.shape
    by_grain = np.zeros_like(added) if found.by_grain is None else found.by_grain
    if assembly.nodes:
        of_rim(assembly, material, found.values, added, by if slopes else None)
    values, table, by_scale, by_grain = (
        v.reshape(*both, 6, 6) for v in (found.values + added, found.values, found.by_scale, by_grain)
    )
    return ArmCompliances(values, table, by_scale, by.reshape(*both, *by.shape[1:]) if slopes else None, by_grain)
