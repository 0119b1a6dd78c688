"""Spirals changed by hand: a brush, or a field over the whole surface, draws them towards others, as far as they can be cut.

Every brush names spirals that full strength would lead to, and a stroke leads so much of the way there as its weight says.
So nothing is ever beyond the bounds of widths and twists, and where slots would close, a spiral goes less far.
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
from .design import SpiralDesign
from .room import Room
from .slots import DEPTH, slot_needed, twist_limit, width_range

HALVINGS = (
    6  # of a spiral's way where its slots would close, before it stays where it is: 2 % of the way are lost at most
)
LONGEST = 40  # rounds in which spirals are found that have to go less far

Spirals = tuple[np.ndarray, np.ndarray]  # widths (F, 4) in metres and twists (F,) in radians


@dataclass(frozen=True, eq=False)
class Canvas:
    """What does not change while somebody paints: where spirals may go, and who are neighbours.

    low, high : (F,) metres, range of the widths; diameter : (F,) metres, of the spirals
    spokes : (F, 4, 3) metres, from the middle of every quad of the surface to the middles of its sides
    mate : (F, 4) the arm that every arm is joined with, 4 quad + side; itself at the border
    """

    flat: FlatPatches
    low: Float[np.ndarray, " quads"]
    high: Float[np.ndarray, " quads"]
    diameter: Float[np.ndarray, " quads"]
    spokes: Float[np.ndarray, "quads 4 3"]
    mate: Int[np.ndarray, "quads 4"]

    @classmethod
    def of(cls, design: SpiralDesign) -> Canvas:
        """That of all designs in the same flat patches with the same settings."""
        return _canvas(design.flat, design.params)

    @cached_property
    def beside(self) -> Int[np.ndarray, "quads 4"]:
        """The quads at the sides of every quad, also across cuts; itself at the border."""
        return self.mate // 4


@lru_cache(maxsize=2)  # one dab after the other asks for that of the same patches
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
    """What a brush is told beside its weight.

    inverted : the other way round, where a brush has one
    direction : (3,) of all, or (F, 3) of every quad, along which ``along`` makes sheets stiff; of any length, in the surface's axes
    level : (F,) from 0 to 1, the stiffness that ``stiffness`` gives
    """

    inverted: bool = False
    direction: np.ndarray | None = None
    level: Float[np.ndarray, " quads"] | None = None


Brush = Callable[[SpiralDesign, Canvas, Stroke], Spirals]


def _stiffest(design: SpiralDesign, canvas: Canvas) -> Spirals:
    """As wide as may be, and as little wound."""
    return np.repeat(canvas.high[:, None], 4, axis=1), np.full(len(canvas.low), design.params.twist_min)


def _softest(design: SpiralDesign, canvas: Canvas) -> Spirals:
    """As thin as may be, and as far wound as a regular spiral of that width."""
    width = np.repeat(canvas.low[:, None], 4, axis=1)
    return width, _most_wound(design, canvas, width)


def _most_wound(
    design: SpiralDesign, canvas: Canvas, width: Float[np.ndarray, "quads 4"]
) -> Float[np.ndarray, " quads"]:
    """Radians: as far as a regular spiral may be wound before its slots close; quads that are none close them sooner."""
    params = design.params
    limit = twist_limit(canvas.diameter, width.mean(axis=1), slot_needed(params), DEPTH)
    return np.clip(limit, params.twist_min, params.twist_max)


def _stiffer(design: SpiralDesign, canvas: Canvas, stroke: Stroke) -> Spirals:
    return _softest(design, canvas) if stroke.inverted else _stiffest(design, canvas)


def _softer(design: SpiralDesign, canvas: Canvas, stroke: Stroke) -> Spirals:
    return _stiffest(design, canvas) if stroke.inverted else _softest(design, canvas)


def _stiffness(design: SpiralDesign, canvas: Canvas, stroke: Stroke) -> Spirals:
    """Between the softest at 0 and the stiffest at 1."""
    if stroke.level is None:
        raise FlexMapsError("How stiff? Give every quad a level from 0, the softest, to 1, the stiffest")
    level = 1.0 - stroke.level if stroke.inverted else stroke.level
    (thin, wound), (wide, straight) = _softest(design, canvas), _stiffest(design, canvas)
    return thin + level[:, None] * (wide - thin), wound + level * (straight - wound)


def _smooth(design: SpiralDesign, canvas: Canvas, stroke: Stroke) -> Spirals:
    """Half of the way to the neighbours' mean, so that a chequerboard fades and does not flip.

    The mean width of a spiral goes to that of its neighbours, what an arm differs from it by to that of the arm it is joined with.
    """
    middle = design.width.mean(axis=1)
    unlike = design.width - middle[:, None]
    mated = unlike.ravel()[canvas.mate]
    width = 0.5 * (middle + middle[canvas.beside].mean(axis=1))[:, None] + 0.5 * (unlike + mated)
    # the border has itself for a neighbour, and what an arm differs by may add up to more than there is room for
    width = np.clip(width, np.minimum(canvas.low, design.width.min(axis=1))[:, None], canvas.high[:, None])
    return width, 0.5 * (design.twist + design.twist[canvas.beside].mean(axis=1))


def _twist(design: SpiralDesign, canvas: Canvas, stroke: Stroke) -> Spirals:
    """More wound; inverted, less."""
    least = np.full(len(canvas.low), design.params.twist_min)
    return design.width, least if stroke.inverted else _most_wound(design, canvas, design.width)


def _width(design: SpiralDesign, canvas: Canvas, stroke: Stroke) -> Spirals:
    """Wider; inverted, thinner."""
    ends = canvas.low if stroke.inverted else canvas.high
    return np.repeat(ends[:, None], 4, axis=1), design.twist


def _along(design: SpiralDesign, canvas: Canvas, stroke: Stroke) -> Spirals:
    """Arms along a direction wider and those across it thinner, by the cosine of twice the angle; inverted, the other way round."""
    if stroke.direction is None:
        raise FlexMapsError("Along what? Give a direction, such as x, or draw the brush that way")
    way = np.broadcast_to(np.asarray(stroke.direction, dtype=float), (len(canvas.low), 3))
    normal = np.cross(canvas.spokes[:, 0], canvas.spokes[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    way = way - (way * normal).sum(axis=1, keepdims=True) * normal
    long = np.linalg.norm(way, axis=1)
    spokes = canvas.spokes / np.maximum(np.linalg.norm(canvas.spokes, axis=2, keepdims=True), 1e-30)
    share = 2.0 * ((spokes * way[:, None]).sum(axis=2) / np.maximum(long, 1e-30)[:, None]) ** 2 - 1.0
    share = np.where(long[:, None] > 1e-6, -share if stroke.inverted else share, 0.0)
    ends = np.where(share > 0.0, canvas.high[:, None], np.minimum(canvas.low, design.width.min(axis=1))[:, None])
    return design.width + np.abs(share) * (ends - design.width), design.twist


BRUSHES: dict[str, Brush] = {
    "stiffer": _stiffer,
    "softer": _softer,
    "smooth": _smooth,
    "twist": _twist,
    "width": _width,
    "along": _along,
    "stiffness": _stiffness,
}


def painted(
    design: SpiralDesign,
    brush: str,
    weight: Float[np.ndarray, " quads"],
    stroke: Stroke | None = None,
    *,
    kept: Int[np.ndarray, " some"] | None = None,
) -> SpiralDesign:
    """The design after one dab of a brush, one of ``BRUSHES``; spirals without weight, and those ``kept``, stay as they are.

    weight : (F,) from 0 to 1, so much of the way is gone. Raises ``FlexMapsError`` where there is no such brush.
    """
    if brush not in BRUSHES:
        raise FlexMapsError(f"There is no brush '{brush}'; the brushes are {', '.join(BRUSHES)}")
    if weight.shape != design.twist.shape or not np.isfinite(weight).all():
        raise FlexMapsError(f"The design has {len(design.twist)} spirals; give each of them a weight from 0 to 1")
    weight = np.clip(weight, 0.0, 1.0)
    weight[design.solid] = 0.0
    if kept is not None:
        weight[kept] = 0.0
    canvas = Canvas.of(design)
    width, twist = BRUSHES[brush](design, canvas, stroke or Stroke())
    wanted = (
        design.width + weight[:, None] * (width - design.width),
        design.twist + weight * (twist - design.twist),
    )
    room, touched = Room.of(design.flat, design.params), weight > 0.0
    # what gives room first, so that what takes it finds it
    opened = _gone(
        room,
        (design.width, design.twist),
        (np.minimum(wanted[0], design.width), np.minimum(wanted[1], design.twist)),
        touched,
    )
    found = _gone(room, opened, wanted, touched)
    return replace(design, width=found[0], twist=found[1], painted=True)


def _gone(room: Room, start: Spirals, wanted: Spirals, touched: Bool[np.ndarray, " quads"]) -> Spirals:
    """As much of the way from a start as keeps the slots open, spiral by spiral; the start where that is nothing."""
    share, quads = touched.astype(float), touched
    width, twist = wanted
    for turn in range(LONGEST):
        quads = room.closed(width, twist, quads) & (share > 0.0)
        if not quads.any():
            break
        share[quads] = 0.5 * share[quads] if turn < HALVINGS else 0.0
        width = start[0] + share[:, None] * (wanted[0] - start[0])
        twist = start[1] + share * (wanted[1] - start[1])
    return width, twist
