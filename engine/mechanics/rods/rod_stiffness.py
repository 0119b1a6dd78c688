"""The four parameters of the paper's rod model, from radial basis function networks (FlexMaps sections 6.1 to 6.3).

The rod model is kept for comparison; the arm model uses the tip compliances of ``arms.stiffness``. There are two
networks. "pair" is fitted to edges from hub to hub, as the rod model uses them; "chord" is fitted to edges from a hub
to a free tip, as in the paper.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from ...arrays import Float
from ...errors import FlexMapsError
from ...spirals.clearance.table_range import table_limit_and_slope
from ..dimensions import check_dimensions, check_material
from ..out_of_range import SLACK, OutOfRange

PARAMETERS = Path(__file__).resolve().parents[3] / "data" / "rod_parameters.npz"
FORMAT = 1  # version of the file of networks that ``load_network`` can read
MODELS = ("pair", "chord")
# range of the arms' width over the sheet's thickness, of the spirals on which the networks were trained
FLATNESS_RANGE = (0.5, 1.0)
# range of the spirals' scale over the sheet's thickness, of the spirals on which the networks were trained
SCALE_OVER_THICKNESS = (5.0, 15.0)
SMALLEST_SLOT = 0.15  # smallest slot over the sheet's thickness, of the spirals on which the networks were trained


@dataclass(frozen=True, eq=False)
class RodStiffnesses:
    """Rod parameters of n spirals, and their derivatives by the spirals' dimensions.

    values : (n, 4) k_s (N), k_b0, k_b1, k_t (N m^2)
    by_scale, by_width : (n, 4) derivatives per metre of the spiral's scale and of its arms' width
    by_twist : (n, 4) derivatives per radian of twist
    """

    values: Float[np.ndarray, "spirals 4"]
    by_scale: np.ndarray
    by_width: np.ndarray
    by_twist: np.ndarray


@lru_cache(maxsize=4)
def load_network(model: str, path: Path = PARAMETERS) -> dict[str, np.ndarray]:
    """Load the arrays of the network ``model``, "pair" or "chord", from a file.

    Raises FlexMapsError if the file is missing, has another version or does not contain this network.
    """
    if model not in MODELS:
        raise FlexMapsError(f"'{model}' is not a rod model; choose one of {', '.join(MODELS)}")
    if not path.is_file():
        raise FlexMapsError(f"The rod parameters {path.name} are missing; reinstall the add-on or build the database")
    with np.load(path) as stored:
        if json.loads(str(stored["provenance"])).get("format") != FORMAT:
            raise FlexMapsError(f"The rod parameters {path.name} have another version; build the database again")
        found = {n[len(model) + 1 :]: stored[n] for n in stored.files if n.startswith(model + "_")}
    if not found:
        raise FlexMapsError(
            f"The rod parameters of the model '{model}' are not in {path.name}: they need more samples than were made; "
            "use 'pair', or go on with the database and fit it again"
        )
    return found


def rod_parameters(
    scale: np.ndarray,
    width: np.ndarray,
    twist: np.ndarray,
    *,
    thickness: float,
    youngs: float,
    model: str = "pair",
) -> RodStiffnesses:
    """Return the rod parameters of n spirals with exact derivatives, at a Poisson's ratio of 0.3.

    Spirals outside the region of the training samples get the parameters of the nearest spiral inside. In the region,
    the scale is 5 to 15 sheet thicknesses, the width 0.5 to 1, every slot at least 0.15, and the twist is at most 360
    degrees.

    Parameters
    ----------
    scale, width : (n,) scale of the spirals and width of their arms, metres
    twist : (n,) radians
    thickness, youngs : thickness of the sheet, metres, and its Young's modulus, Pa
    model : the network, "pair" or "chord" (see the module's docstring)
    """
    check_material(thickness, youngs)
    near = _Nearest.from_spirals(*check_dimensions(scale, width, twist), thickness)
    net = load_network(model)
    ratio = near.scale / near.width
    limit, slope = table_limit_and_slope(ratio)
    x = np.stack([np.log(ratio), np.log(near.width / thickness), near.twist / limit], axis=1)
    span = net["high"] - net["low"]
    offset = ((x - net["low"]) / span)[:, None] - net["centres"]
    sharp = math.log(2.0) / float(net["spread"]) ** 2
    answers = np.exp(-sharp * (offset**2).sum(2))
    weights, bias = net["weights"][:-1], net["weights"][-1]
    value = np.exp(net["offset"] + net["span"] * (answers @ weights + bias))
    slopes = [net["span"] / span[k] * ((-2.0 * sharp * offset[..., k] * answers) @ weights) for k in range(3)]
    # chain rule: the inputs of the network are ln(s/w), ln(w/h) and twist / limit(s/w)
    share_by_scale = -(near.twist / limit**2 * slope)[:, None]
    log_scale = slopes[0] + slopes[2] * share_by_scale
    power = np.array([2, 4, 4, 4])
    value = value * youngs * near.width[:, None] ** power
    by_scale = value * log_scale / near.scale[:, None]
    by_width = value * (slopes[1] - log_scale + power) / near.width[:, None]
    return near.with_own_derivatives(RodStiffnesses(value, by_scale, by_width, value * slopes[2] / limit[:, None]))


@dataclass(frozen=True, eq=False)
class _Nearest:
    """The n spirals in the region of the training samples that are nearest to n given spirals.

    scale, width, twist : (n,) of the nearest spirals
    moves : (3, n) mask: whether scale, width and twist are those of the given spiral; False where they are clipped
    along : (2, n) derivatives of clipped twists by scale and width, rad/m; 0 for twists that are not clipped
    """

    scale: np.ndarray
    width: np.ndarray
    twist: np.ndarray
    moves: np.ndarray
    along: np.ndarray

    @classmethod
    def from_spirals(cls, scale: np.ndarray, width: np.ndarray, twist: np.ndarray, thickness: float) -> _Nearest:
        """Find the nearest spirals in the region of the training samples."""
        # the region is a little enlarged, because rounding may put spirals at its border just outside
        low, high = 1.0 - SLACK, 1.0 + SLACK
        near = np.clip(scale, low * thickness * SCALE_OVER_THICKNESS[0], high * thickness * SCALE_OVER_THICKNESS[1])
        thin = np.clip(width, low * thickness * FLATNESS_RANGE[0], high * thickness * FLATNESS_RANGE[1])
        limit, by_scale, by_width = _largest_twist(near, thin, thickness)
        wound = twist > limit
        moves = np.stack([near == scale, thin == width, ~wound & (twist >= 0.0)])
        along = np.stack([by_scale, by_width]) * wound
        return cls(near, thin, np.clip(twist, 0.0, limit), moves, along)

    def with_own_derivatives(self, found: RodStiffnesses) -> RodStiffnesses:
        """Convert derivatives by the nearest spirals to derivatives by the given spirals (chain rule)."""
        by_scale, by_width = (
            (slope + found.by_twist * along[:, None]) * moves[:, None]
            for slope, along, moves in zip((found.by_scale, found.by_width), self.along, self.moves[:2], strict=True)
        )
        return RodStiffnesses(found.values, by_scale, by_width, found.by_twist * self.moves[2][:, None])


def _largest_twist(scale: np.ndarray, width: np.ndarray, thickness: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the largest twist (n,) of the training samples, radians, and its derivatives by scale and width."""
    spread = (0.25 * math.pi * scale / (width + SMALLEST_SLOT * thickness)) ** 2
    # spread - 1 is positive: spread is least, about 11, at the smallest scale over width of the training samples
    cut = np.sqrt(spread - 1.0)
    slope = np.where(cut < 2.0 * math.pi, spread / cut, 0.0)
    return np.minimum(2.0 * math.pi, cut), slope / scale, -slope / (width + SMALLEST_SLOT * thickness)


def beyond(
    scale: Float[np.ndarray, " joints"],
    width: Float[np.ndarray, " joints"],
    twist: Float[np.ndarray, " rad"],
    thickness: float,
) -> list[OutOfRange]:
    """Return the quantities that are outside the region of the training samples, with the spirals that have them.

    Parameters
    ----------
    scale, width, twist : (n,) of the spirals, metres and radians
    thickness : of the sheet, metres
    """
    near, every = _Nearest.from_spirals(scale, width, twist, thickness), np.arange(len(scale))
    share = twist / _largest_twist(near.scale, near.width, thickness)[0]
    return [
        *OutOfRange.outside_range("scale / thickness", scale / thickness, *SCALE_OVER_THICKNESS, every),
        *OutOfRange.outside_range("width / thickness", width / thickness, *FLATNESS_RANGE, every),
        *OutOfRange.outside_range("twist / largest twist", share, 0.0, 1.0, every),
    ]
