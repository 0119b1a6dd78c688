"""Change spirals by hand, with a brush or with a field over the whole surface, as far as they can be cut.

Every brush defines goal spirals within the allowed ranges. A dab moves each spiral towards its goal; its weight, from
0 to 1, is the share of the way. Where slots would close, a spiral moves less.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from ..arrays import Bool, Float, Int
from ..errors import FlexMapsError
from ..patches.flattening.flatten import FlatPatches
from ..surface.mesh import QuadMesh
from .clearance.clearance_model import ClearanceModel
from .clearance.slots import OPEN_SHARE, min_slot_width, twist_limit, width_range
from .design import SpiralDesign

# number of times the move of a spiral is halved where slots would close; then the spiral stays. A larger number loses
# less of the move (6: at most 2 %) and takes longer
HALVINGS = 6
# largest number of rounds; each halves (from round ``HALVINGS`` on, cancels) the moves of all spirals at closed slots;
# more takes longer
ROUNDS = 40

Spirals = tuple[np.ndarray, np.ndarray]  # widths (F, 4) in metres and twists (F,) in radians


@dataclass(frozen=True, eq=False)
class Canvas:
    """Data that stays constant while painting: ranges of the spirals, and neighbours.

    flat : flat patches
    low, high : (F,) range of the widths, metres
    diameter : (F,) diameter of the spirals, metres
    spokes : (F, 4, 3) vectors from the centre of every quad of the surface to the middles of its sides, metres
    mate : (F, 4) arm across every joint, 4 quad + side; at the border the arm itself
    """

    flat: FlatPatches
    low: Float[np.ndarray, " quads"]
    high: Float[np.ndarray, " quads"]
    diameter: Float[np.ndarray, " quads"]
    spokes: Float[np.ndarray, "quads 4 3"]
    mate: Int[np.ndarray, "quads 4"]

    @classmethod
    def from_design(cls, design: SpiralDesign) -> Canvas:
        """Return the canvas for all designs with these flat patches and settings (cached)."""
        return _canvas(design.flat, design.params)

    @cached_property
    def neighbours(self) -> Int[np.ndarray, "quads 4"]:
        """Quads across the sides of every quad, also across cuts; at the border the quad itself."""
        return self.mate // 4


@lru_cache(maxsize=2)  # consecutive dabs paint on the same patches
def _canvas(flat: FlatPatches, params: object) -> Canvas:
    mesh = flat.layout.mesh
    low, high = width_range(flat, params)  # type: ignore[arg-type]
    sides = 0.5 * (flat.corners + np.roll(flat.corners, -1, axis=1))
    diameter = 2.0 * np.linalg.norm(sides - flat.corners.mean(axis=1, keepdims=True), axis=2).mean(axis=1)
    return Canvas(flat, low, high, diameter, _spokes(mesh), _mates(mesh))


def _spokes(mesh: QuadMesh) -> Float[np.ndarray, "quads 4 3"]:
    corners = mesh.vertices[mesh.quads]
    return 0.5 * (corners + np.roll(corners, -1, axis=1)) - corners.mean(axis=1, keepdims=True)


def _mates(mesh: QuadMesh) -> Int[np.ndarray, "quads 4"]:
    mate = np.arange(4 * len(mesh.quads))
    inner = ~mesh.border
    arms = 4 * mesh.edge_quads[inner] + mesh.edge_sides[inner]
    mate[arms[:, 0]], mate[arms[:, 1]] = arms[:, 1], arms[:, 0]
    return mate.reshape(-1, 4)


@dataclass(frozen=True, eq=False)
class Stroke:
    """Options of a brush besides its weight.

    is_inverted : reverse the brush's effect; the brush ``smooth`` has no reverse
    direction : (3,) or (F, 3) vector along which the brush ``along`` stiffens, in the surface's axes; of any length
    level : (F,) stiffness from 0 to 1 that the brush ``stiffness`` sets
    """

    is_inverted: bool = False
    direction: np.ndarray | None = None
    level: Float[np.ndarray, " quads"] | None = None


Brush = Callable[[SpiralDesign, Canvas, Stroke], Spirals]


def _stiffest(design: SpiralDesign, canvas: Canvas) -> Spirals:
    """Return the stiffest spirals: largest widths and smallest twist."""
    return np.repeat(canvas.high[:, None], 4, axis=1), np.full(len(canvas.low), design.params.twist_min)


def _softest(design: SpiralDesign, canvas: Canvas) -> Spirals:
    """Return the softest spirals: smallest widths, and the largest twists that these widths allow."""
    width = np.repeat(canvas.low[:, None], 4, axis=1)
    return width, _largest_twist(design, canvas, width)


def _largest_twist(
    design: SpiralDesign, canvas: Canvas, width: Float[np.ndarray, "quads 4"]
) -> Float[np.ndarray, " quads"]:
    """Return the largest twist of a regular spiral of given width, radians; in irregular quads slots close sooner."""
    params = design.params
    limit = twist_limit(canvas.diameter, width.mean(axis=1), min_slot_width(params), OPEN_SHARE)
    return np.clip(limit, params.twist_min, params.twist_max)


def _brush_stiffer(design: SpiralDesign, canvas: Canvas, stroke: Stroke) -> Spirals:
    return _softest(design, canvas) if stroke.is_inverted else _stiffest(design, canvas)


def _brush_softer(design: SpiralDesign, canvas: Canvas, stroke: Stroke) -> Spirals:
    return _stiffest(design, canvas) if stroke.is_inverted else _softest(design, canvas)


def _brush_stiffness(design: SpiralDesign, canvas: Canvas, stroke: Stroke) -> Spirals:
    """Interpolate between the softest spirals (level 0) and the stiffest (level 1)."""
    if stroke.level is None:
        raise FlexMapsError("The brush needs a stiffness; give every quad a level from 0 (softest) to 1 (stiffest)")
    level = 1.0 - stroke.level if stroke.is_inverted else stroke.level
    (thin, wound), (wide, straight) = _softest(design, canvas), _stiffest(design, canvas)
    return thin + level[:, None] * (wide - thin), wound + level * (straight - wound)


def _brush_smooth(design: SpiralDesign, canvas: Canvas, stroke: Stroke) -> Spirals:
    """Move halfway to the mean of the neighbours; a full step would flip a chequerboard instead of fading it.

    The mean width of a spiral moves towards its neighbours' mean width, and an arm's deviation from its spiral's mean
    towards the deviation of the arm across the joint.
    """
    middle = design.width.mean(axis=1)
    unlike = design.width - middle[:, None]
    mated = unlike.ravel()[canvas.mate]
    width = 0.5 * (middle + middle[canvas.neighbours].mean(axis=1))[:, None] + 0.5 * (unlike + mated)
    # the sum of mean and deviation may leave the allowed range
    width = np.clip(width, np.minimum(canvas.low, design.width.min(axis=1))[:, None], canvas.high[:, None])
    return width, 0.5 * (design.twist + design.twist[canvas.neighbours].mean(axis=1))


def _brush_twist(design: SpiralDesign, canvas: Canvas, stroke: Stroke) -> Spirals:
    """Increase the twist, or decrease it if the stroke is inverted."""
    least = np.full(len(canvas.low), design.params.twist_min)
    return design.width, least if stroke.is_inverted else _largest_twist(design, canvas, design.width)


def _brush_width(design: SpiralDesign, canvas: Canvas, stroke: Stroke) -> Spirals:
    """Widen the arms, or thin them if the stroke is inverted."""
    ends = canvas.low if stroke.is_inverted else canvas.high
    return np.repeat(ends[:, None], 4, axis=1), design.twist


def _brush_along(design: SpiralDesign, canvas: Canvas, stroke: Stroke) -> Spirals:
    """Widen arms along a direction and thin arms across it, in proportion to the cosine of twice their angle to it.

    An inverted stroke thins the arms along the direction and widens the arms across it.
    """
    if stroke.direction is None:
        raise FlexMapsError("The brush needs a direction; give one, such as x, or draw with the brush along it")
    way = np.broadcast_to(np.asarray(stroke.direction, dtype=float), (len(canvas.low), 3))
    normal = np.cross(canvas.spokes[:, 0], canvas.spokes[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    way = way - (way * normal).sum(axis=1, keepdims=True) * normal
    long = np.linalg.norm(way, axis=1)
    spokes = canvas.spokes / np.maximum(np.linalg.norm(canvas.spokes, axis=2, keepdims=True), 1e-30)
    share = 2.0 * ((spokes * way[:, None]).sum(axis=2) / np.maximum(long, 1e-30)[:, None]) ** 2 - 1.0
    share = np.where(long[:, None] > 1e-6, -share if stroke.is_inverted else share, 0.0)
    ends = np.where(share > 0.0, canvas.high[:, None], np.minimum(canvas.low, design.width.min(axis=1))[:, None])
    return design.width + np.abs(share) * (ends - design.width), design.twist


BRUSHES: dict[str, Brush] = {
    "stiffer": _brush_stiffer,
    "softer": _brush_softer,
    "smooth": _brush_smooth,
    "twist": _brush_twist,
    "width": _brush_width,
    "along": _brush_along,
    "stiffness": _brush_stiffness,
}


def paint_spirals(
    design: SpiralDesign,
    brush: str,
    weight: Float[np.ndarray, " quads"],
    stroke: Stroke | None = None,
    *,
    fixed: Int[np.ndarray, " some"] | None = None,
) -> SpiralDesign:
    """Return the design after one dab of a brush.

    Parameters
    ----------
    design : the present design
    brush : key of ``BRUSHES``
    weight : (F,) share of the way to the brush's goal, from 0 to 1
    stroke : options of the brush
    fixed : indices of spirals that must stay

    Raises
    ------
    FlexMapsError : unknown brush, missing option of the brush, or weights of a wrong shape
    """
    if brush not in BRUSHES:
        raise FlexMapsError(f"There is no brush '{brush}'; the brushes are {', '.join(BRUSHES)}")
    if weight.shape != design.twist.shape or not np.isfinite(weight).all():
        raise FlexMapsError(f"The design has {len(design.twist)} spirals; give each of them a weight from 0 to 1")
    weight = np.clip(weight, 0.0, 1.0)
    weight[design.has_solid_hub] = 0.0
    if fixed is not None:
        weight[fixed] = 0.0
    canvas = Canvas.from_design(design)
    width, twist = BRUSHES[brush](design, canvas, stroke or Stroke())
    goal = (
        design.width + weight[:, None] * (width - design.width),
        design.twist + weight * (twist - design.twist),
    )
    room, touched = ClearanceModel.from_flat(design.flat, design.params), weight > 0.0
    # first make the changes that widen slots, so that all other changes have more room
    opened = _move_towards(
        room,
        (design.width, design.twist),
        (np.minimum(goal[0], design.width), np.minimum(goal[1], design.twist)),
        touched,
    )
    width, twist = _move_towards(room, opened, goal, touched)
    return replace(design, width=width, twist=twist, is_painted=True)


def _move_towards(room: ClearanceModel, start: Spirals, goal: Spirals, touched: Bool[np.ndarray, " quads"]) -> Spirals:
    """Move spirals towards their goals as far as slots stay open: halve the moves of spirals at closed slots.

    touched : mask of the spirals that may move
    """
    share, quads = touched.astype(float), touched
    width, twist = goal
    for turn in range(ROUNDS):
        quads = room.quads_with_closed_gaps(width, twist, quads) & (share > 0.0)
        if not quads.any():
            break
        share[quads] = 0.5 * share[quads] if turn < HALVINGS else 0.0
        width = start[0] + share[:, None] * (goal[0] - start[0])
        twist = start[1] + share * (goal[1] - start[1])
    return width, twist
