"""Compliances of the necks and strips of a rim, to which the stiffness table does not apply."""

from __future__ import annotations

import numpy as np

from ...arrays import Float
from ...materials import Material
from ..assembly import Assembly
from ..rim_bodies import NECK_STEP, RimBeams, rim_tip_compliance
from .cut import MATE_TWIST, MATE_WIDTH, TWIST, WIDTH
from .pieces import Grain, piece_flexibilities


def set_rim_compliances(
    assembly: Assembly,
    material: Material,
    table: Float[np.ndarray, "n 6 6"],
    added: Float[np.ndarray, "n 6 6"],
    by: Float[np.ndarray, "n numbers 6 6"] | None,
) -> None:
    """Overwrite the compliances of a rim's necks and strips in the arrays of all arms, in place.

    An arm that ends at the rim is blended with its own mirror image, of equal width and opposite twist. So the
    derivatives by its mate's width are added to those by its own width, and those by its mate's twist are subtracted
    from those by its own twist.

    Parameters
    ----------
    assembly : m joints, those of the rim last; necks and strips are arms of these
    material : of the sheet
    table, added : (2 m, 6, 6) compliances of the arms in the stiffness table, and those that the cut shape adds
    by : (2 m, 5, 6, 6) derivatives of table + added by the design parameters of ``cut``; None if not needed
    """
    rim, ties = assembly.rim, assembly.tie_joints
    assert rim is not None
    arm, neck = 2 * np.arange(ties.start, ties.stop), 2 * np.arange(ties.start, ties.stop) + 1
    strips = np.arange(2 * ties.stop, len(table))
    width = assembly.arm_width[ties, 0]
    values, slope = _necks(assembly, rim.necks, width, material, by is not None)
    for where, found in ((neck, values), (strips, _beams(assembly, rim.strips, material))):
        back = _own_axes(assembly, where)
        table[where], added[where] = back @ found @ np.swapaxes(back, 1, 2), 0.0
    if by is not None:
        back = _own_axes(assembly, neck)
        by[neck], by[strips] = 0.0, 0.0
        # a neck is as wide as its mate, the arm at the border, so its compliance depends on the mate's width
        by[neck, MATE_WIDTH] = back @ slope @ np.swapaxes(back, 1, 2)
        by[arm, WIDTH] += by[arm, MATE_WIDTH]
        by[arm, TWIST] -= by[arm, MATE_TWIST]
        by[arm, MATE_WIDTH] = by[arm, MATE_TWIST] = 0.0


def _necks(
    assembly: Assembly, line: RimBeams, width: np.ndarray, material: Material, slopes: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return the compliances (B, 6, 6) of necks, in the flat frame, and their derivatives (B, 6, 6) by the widths.

    Parameters
    ----------
    line : the necks, with any widths
    width : (B,) the widths to use, metres
    slopes : compute the derivatives, by differences; otherwise they are 0
    """

    def at(share: float) -> np.ndarray:
        wide = np.broadcast_to((share * width)[:, None], line.length.shape)
        return _beams(assembly, RimBeams(line.lever, line.tangent, line.length, wide, line.bore), material)

    if not slopes:
        return at(1.0), np.zeros((len(width), 6, 6))
    near, far = at(1.0 + NECK_STEP) - at(1.0 - NECK_STEP), at(1.0 + 2.0 * NECK_STEP) - at(1.0 - 2.0 * NECK_STEP)
    return at(1.0), (8.0 * near - far) / (12.0 * NECK_STEP * width)[:, None, None]


def _beams(assembly: Assembly, line: RimBeams, material: Material) -> Float[np.ndarray, "n 6 6"]:
    """Return the compliances (N, 6, 6) of the necks or half strips ``line``, SI units, in the flat frame.

    At a hole through a strip, only the two bars beside the hole remain; in the plane of the sheet they bend as one
    section. A hole also softens the strip before and behind it, where the material carries no stress (see
    ``_hole_factors``).
    """
    known, height = material.orthotropy, assembly.thickness
    grain = None if known is None else Grain(known, assembly.grain, material.youngs)
    given = line.lever, line.tangent, line.length
    found = piece_flexibilities(*given, line.width, height, material.poisson, grain)
    if line.bore.any():
        assert assembly.rim is not None
        left = line.width - line.bore
        more = piece_flexibilities(*given, left, height, material.poisson, grain)
        more[:, :, 2, :] *= (left**3 / (line.width**3 - line.bore**3))[..., None]
        # ``line.width`` is the whole width of the strip, ``rim.width`` its width beside a hole
        softer = _hole_factors(1.0 - assembly.rim.width / line.width, height / line.width)
        normal = np.broadcast_to([0.0, 0.0, 1.0], line.tangent.shape)
        frame = np.stack([line.tangent, np.cross(normal, line.tangent), normal], axis=-1)
        for rows, factor in zip((slice(0, 3), slice(3, 6)), softer, strict=True):
            own = (frame * factor[..., None, :]) @ np.swapaxes(frame, -1, -2)
            found[:, :, rows] += own @ (more - found)[:, :, rows]
    compliance = rim_tip_compliance(found[:, :, :3], found[:, :, 3:], line.lever) / material.youngs
    # the hole's factors make the compliance slightly asymmetric in sheets with a grain, so its symmetric part is
    # returned
    return 0.5 * (compliance + np.swapaxes(compliance, 1, 2))


def _hole_factors(
    hole: Float[np.ndarray, "*lines"], height: Float[np.ndarray, "*lines"]
) -> tuple[Float[np.ndarray, "*lines 3"], Float[np.ndarray, "*lines 3"]]:
    """Return factors on the compliance that a hole adds to a strip, by which it exceeds a simple estimate.

    The estimate only takes into account that the sections at the hole are narrower. The factors are fitted to finite
    elements of strips with one hole. They are within 4 % for stretch, shear and bending in the sheet, within 12 % for
    bending out of it. Small holes soften a stretched plate by three times their share of its area (Kachanov, Tsukrov
    and Shafiro 1994).

    Parameters
    ----------
    hole, height : diameter of the hole and thickness of the sheet, both over the strip's width

    Returns
    -------
    (..., 3) and (..., 3) : factors for turns about three axes and for shifts along them: along the strip, across it in
        the sheet, normal to the sheet
    """
    one = np.ones(np.shape(hole))
    lift = 2.5 - 1.8 * hole + 0.26 * np.log(np.maximum(height, 1e-3) / 0.4)
    turns = np.stack([2.2 - 2.5 * hole - 0.6 * height**2, lift, 1.88 * one], axis=-1)
    return turns, np.stack([2.6 - 0.7 * hole, 4.8 + 3.0 * hole**2, 1.5 * one], axis=-1)


def _own_axes(assembly: Assembly, arms: np.ndarray) -> Float[np.ndarray, "n 6 6"]:
    """Return matrices (n, 6, 6) that rotate pairs of vectors from the flat frame to the arms' own axes.

    arms : (n,) indices of the arms, 2 * joint + side
    """
    e, side = np.divmod(arms, 2)
    flat = np.zeros((len(arms), 6, 6))
    flat[:, :3, :3] = flat[:, 3:, 3:] = np.swapaxes(assembly.axes[e, side], 1, 2)
    return np.swapaxes(assembly.arm_axes[e, side], 1, 2) @ flat
