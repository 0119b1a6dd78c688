"""Compliances of the arms as they are cut: compliances of the stiffness table plus a correction (see ``cut``)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from ...arrays import Columns, Float
from ...errors import FlexMapsError
from ...materials import Material
from ..assembly import Assembly
from .cut import TWIST, WIDTH, CutArms, added_compliance, reduction_factors, rest_shapes
from .grain import GrainBeams
from .rim_beams import set_rim_compliances
from .stiffness import table_tip_compliance


@dataclass(frozen=True, eq=False)
class ArmCompliances(Columns):
    """Compliances of both arms of m joints as they are cut, in the arms' own axes, SI units.

    values : (m, 2, 6, 6) compliance of the stiffness table plus the correction for the cut shape
    table : compliance of the stiffness table
    table_by_scale : derivative of ``table`` with respect to twice the arm's radius, per metre
    table_by_grain : derivative of ``table`` with respect to the angle from the arm to the grain, per radian; 0 without
        a grain
    by : (m, 2, 5, 6, 6) derivatives of ``values`` with respect to the five design parameters of ``cut``, per metre and
        per radian; None if not computed
    """

    values: Float[np.ndarray, "joints 2 6 6"]
    table: Float[np.ndarray, "joints 2 6 6"]
    table_by_scale: Float[np.ndarray, "joints 2 6 6"]
    by: Float[np.ndarray, "joints 2 numbers 6 6"] | None
    table_by_grain: Float[np.ndarray, "joints 2 6 6"]

    def to_first_order(
        self, change: Float[np.ndarray, "n k"], by_shapes: Float[np.ndarray, "n k 6 6"]
    ) -> ArmCompliances:
        """Return a copy for slightly different arm shapes, to first order; the derivatives in it are not updated.

        Parameters
        ----------
        change : (n, k) change of the k parameters of ``cut.rest_shapes``, for n = 2 m arms
        by_shapes : (n, k, 6, 6) derivatives of the correction for the cut shape with respect to these parameters
        """
        shape = self.table.shape
        table = self.table + 2.0 * change[:, 0].reshape(shape[:2])[..., None, None] * self.table_by_scale
        if change.shape[1] > 3:
            # changes of the grain's angle are reduced to -pi/2 to pi/2, because opposite directions are the same grain
            turned = (change[:, 3] + 0.5 * np.pi) % np.pi - 0.5 * np.pi
            change = np.concatenate([change[:, :3], turned[:, None], change[:, 4:]], axis=1)
            table = table + change[:, 3].reshape(shape[:2])[..., None, None] * self.table_by_grain
        added = np.einsum("nkij,nk->nij", by_shapes, change).reshape(shape)
        return replace(self, table=table, values=self.values + (table - self.table) + added)

    def map_arrays(self, convert: Callable[[str, np.ndarray], np.ndarray]) -> ArmCompliances:
        """Return a copy in which ``convert(name, array)`` replaces the array of every attribute that is not None."""
        known: dict[str, Any] = {field.name: getattr(self, field.name) for field in fields(self)}
        changed: dict[str, Any] = {k: None if value is None else convert(k, value) for k, value in known.items()}
        return ArmCompliances(**changed)


def arm_compliances(assembly: Assembly, material: Material, slopes: bool = True) -> ArmCompliances:
    """Compute the tip compliances of both arms of every joint, for the shapes in which the arms are cut.

    Parameters
    ----------
    assembly : m joints at rest
    material : of the sheet
    slopes : also compute the derivatives ``by``; otherwise they are None

    Raises
    ------
    FlexMapsError : a width or a twist is not a number; its ``faces`` are the indices of the spirals
    """
    spiral, known = assembly.pairs.ravel(), material.orthotropy
    shape = rest_shapes(assembly, material)
    beam = None if known is None else GrainBeams(known, shape[:, 3], material.youngs, material.poisson)
    try:
        found = table_tip_compliance(
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
    arms = CutArms.from_assembly(assembly, shape)
    added, by = added_compliance(arms, assembly.thickness, material, slopes)
    share = reduction_factors(arms, found.values, added)[:, None, None]
    added = added * share
    if slopes:
        by *= share[..., None]
        by[:, WIDTH] += found.by_width
        by[:, TWIST] += found.by_twist
    both = assembly.pairs.shape
    by_grain = np.zeros_like(added) if found.by_grain is None else found.by_grain
    if assembly.nodes:
        set_rim_compliances(assembly, material, found.values, added, by if slopes else None)
    values, table, by_scale, by_grain = (
        v.reshape(*both, 6, 6) for v in (found.values + added, found.values, found.by_scale, by_grain)
    )
    return ArmCompliances(values, table, by_scale, by.reshape(*both, *by.shape[1:]) if slopes else None, by_grain)
