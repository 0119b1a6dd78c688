"""Check connectors by virtual assembly: cut both sides of every joint, put them together, and measure the gap."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from flexmaps.engine.arrays import Float, Int
from flexmaps.engine.fabrication.connectors.connect import Connections, Connector
from flexmaps.engine.fabrication.connectors.joined_arms import JoinedArms, JointArms, to_complex, to_points
from flexmaps.engine.fabrication.connectors.shape import key_outline
from flexmaps.engine.fabrication.connectors.tips import ConnectorCandidate
from flexmaps.engine.fabrication.panels.kerf import cut_paths
from flexmaps.engine.spirals.contours import Outline
from flexmaps.engine.spirals.design import SpiralDesign

_FINE = 5e-7  # maximum distance of chords from arcs in metres


@dataclass(frozen=True, eq=False)
class ConnectorGaps:
    """Gaps between the finished parts of every connector in metres; a key has a row for each of its sockets.

    joint : index into ``Connections.connectors``
    least, most : smallest and largest gap around the head or between two faces, less the setback of the faces
    overlap : m2 that both parts would occupy
    """

    joint: Int[np.ndarray, " rows"]
    least: Float[np.ndarray, " rows"]
    most: Float[np.ndarray, " rows"]
    overlap: Float[np.ndarray, " rows"]


def fit(design: SpiralDesign, made: Connections, kerf: float) -> ConnectorGaps:
    """Cut all panels and keys along the paths for a kerf in metres, and put every joint together.

    The paths are those that would be written to files; shapely derives the remaining material from them alone.
    """
    panels = [_blank(cut_paths(o, kerf, kerf)) for o in made.outlines]
    rows = []
    for index, connector in enumerate(made.connectors):
        rows += [(index, *row) for row in _joint(design, connector, panels, kerf)]
    table = np.array(rows).reshape(-1, 4)
    return ConnectorGaps(table[:, 0].astype(int), table[:, 1], table[:, 2], table[:, 3])


def _blank(outline: Outline) -> Any:
    """Return the polygon enclosed by the paths."""
    import shapely

    return shapely.Polygon(outline.outer.sample(_FINE), [h.sample(_FINE) for h in outline.holes])


def _joint(
    design: SpiralDesign, connector: Connector, panels: list[Any], kerf: float
) -> list[tuple[float, float, float]]:
    """Return for each part of one joint the smallest gap, the largest gap and the overlap."""
    import shapely

    a = connector.candidate
    halves = [
        JointArms.from_arms(design, np.array([q]), np.array([k]))
        for q, k in zip(connector.faces, connector.sides, strict=True)
    ]
    point, way = _point_along(JoinedArms(halves[0], halves[1]), -a.shift)
    point += 1j * way * a.lateral_offset
    parts = []
    for half, sign in zip(halves, (1.0, -1.0), strict=True):
        place = half.in_patch_frames(np.array([sign * point]))[0]
        reach = a.size.pad_width + a.size.length + abs(a.setback)
        window = (place.real - reach, place.imag - reach, place.real + reach, place.imag + reach)
        left = shapely.clip_by_rect(panels[int(half.patch[0])], *window).buffer(-0.5 * kerf, quad_segs=64)
        if halves[0].patch[0] == halves[1].patch[0]:
            # Both arms belong to the same panel. The opposite arm moves away when the cut closes, so keep only the part
            # that belongs to this arm
            through = JoinedArms(half, halves[0] if half is halves[1] else halves[1])
            behind = _point_along(through, a.setback + a.size.length + a.size.wall - sign * a.shift)[0]
            at = shapely.Point(to_points(half.in_patch_frames(np.array([behind]))[0]))
            pieces = shapely.get_parts(left)
            left = pieces[int(np.argmin(shapely.distance(pieces, at)))]
        into = lambda p, half=half, sign=sign: to_points(  # noqa: E731
            (sign * half.in_arm_frames(to_complex(p)[None])[0] - point) / way
        )
        parts.append(shapely.transform(left, into))
    if a.kind == "key":
        whole = _blank(cut_paths(Outline(key_outline(a.size, a.setback), ()), kerf, kerf)).buffer(
            -0.5 * kerf, quad_segs=64
        )
        # the socket of the first arm holds the half of the key at x < 0
        return [_gap(whole, part, a) for part in (_half_turn(parts[0]), parts[1])]
    if a.kind == "tab":
        near = shapely.box(-a.size.pad_width, -a.size.pad_width, a.size.pad_width, a.size.pad_width)
        one, two = (shapely.intersection(p, near) for p in parts)
        gap = float(one.distance(two)) - 2.0 * a.setback
        return [(gap, gap, float(one.intersection(two).area))]
    one, two = parts if a.head_arm == 0 else (_half_turn(parts[1]), _half_turn(parts[0]))
    return [_gap(one, two, a)]


def _point_along(through: JoinedArms, distance: float) -> tuple[complex, complex]:
    """Return point and direction of an arm at a distance in metres from its joint."""
    point, way, _ = through.centre_lines(through.tau_at(np.array([[distance]]))[:, 0])
    return complex(point[0]), complex(way[0])


def _half_turn(part: Any) -> Any:
    """Return the part turned by half a turn about the origin."""
    from shapely.affinity import rotate

    return rotate(part, 180, (0, 0))


def _gap(one: Any, two: Any, a: ConnectorCandidate) -> tuple[float, float, float]:
    """Return smallest gap, largest gap and overlap of the part ``one``, whose head points along x, and ``two``."""
    import shapely

    s = a.size
    box = shapely.box(a.setback + 0.5 * s.length, -0.6 * s.head, a.setback + s.length + 2.0 * s.rounding, 0.6 * s.head)
    # ignore the borders of the window itself
    edge = shapely.intersection(shapely.boundary(one), box)
    at = shapely.points(shapely.get_coordinates(shapely.segmentize(edge, 2e-5)))
    apart = shapely.distance(at, shapely.boundary(two))
    window = shapely.box(a.setback - s.length, -0.45 * s.pad_width, a.setback + 2.0 * s.length, 0.45 * s.pad_width)
    one, two = shapely.intersection(one, window), shapely.intersection(two, window)
    least = min(float(one.distance(two)), float(apart.min()))
    # dogbones enlarge the gap at the head's corners, so the largest gap is not measured there
    return least, least if s.inside_radius else float(apart.max()), float(one.intersection(two).area)
