"""Panel numbers and seam labels, engraved on hubs and along arms where there is room."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...arrays import Float
from ...params import SheetParams
from ...patches.joining import panel_numbers
from ...patches.layout import PatchLayout
from ...progress import SILENT, Progress
from ...spirals.curves.arcs import Curve
from ...spirals.curves.spiral import Arms, centre_line, width_at
from ...spirals.roots import SlotRoots
from .lettering import FILL_SHARE, along, length, straight

_SAMPLES = 97  # samples along an arm; the line of a label is straight between them; 25 and 193 place the same labels on five surfaces
LEGIBLE = 0.002  # metres; height of letters legible without a lens
_TICK = 8  # length of a tick in samples of its arm, from the hub
_PLACES = 8  # ends of arms to which the tick of a panel's number may point
_TOGETHER = 1000  # quads whose arms are sampled together
_SEAM_LETTERS = "ABCDEFGHJKLMNPQRSTUVWXYZ"
_UPSIDE_DOWN = str.maketrans("69", "96")


@dataclass(frozen=True, eq=False)
class SmallLabel:
    """A label with letters too small to read, or without room.

    patch : of the label
    places : points (metres, patch frame) to which a tick may point
    placed : whether it is engraved on the material nevertheless
    """

    text: str
    patch: int
    places: Float[np.ndarray, "places 2"]
    placed: bool


@dataclass(frozen=True, eq=False)
class Labels:
    """The strokes of the labels of every patch in its frame.

    strokes : a tuple of open curves per patch
    placed, left_out : numbers of labels engraved, and without room
    on_hubs : legible labels on hubs, contained in ``strokes``
    small : labels that may also be written beside their panels
    """

    strokes: tuple[tuple[Curve, ...], ...]
    placed: int
    left_out: int
    on_hubs: tuple[tuple[Curve, ...], ...] = ()
    small: tuple[SmallLabel, ...] = ()


def seam_name(number: int) -> str:
    """Return A, B, ... Z, AA, AB, ... without I and O, which look like digits."""
    name = ""
    number += 1
    while number:
        number, letter = divmod(number - 1, len(_SEAM_LETTERS))
        name = _SEAM_LETTERS[letter] + name
    return name


def with_mark(name: str, mark: str) -> str:
    """Return the name preceded by the letter of its piece, which makes it unique on common sheets.

    Parameters
    ----------
    name : of a panel or joint
    mark : letter of the piece; empty if it is alone
    """
    return f"{mark}-{name}" if mark else name


def panel_name(number: int, mark: str = "") -> str:
    """Return the text engraved for a panel's number, with a dot if it reads as another number upside down.

    Parameters
    ----------
    number : of the panel
    mark : letter of its piece on common sheets, which makes the dot unnecessary
    """
    name = str(number)
    if mark:
        return with_mark(name, mark)
    return name + "." if set(name) <= set("01689") and name != name[::-1].translate(_UPSIDE_DOWN) else name


def seam_labels(layout: PatchLayout) -> dict[tuple[int, int], str]:
    """Return the name of every joint on a seam by (quad, side): seam letter and joint number, equal on both sides."""
    mesh, names = layout.mesh, {}
    for number, edges in enumerate(layout.seams):
        for place, edge in enumerate(edges.tolist()):
            for quad, side in zip(mesh.edge_quads[edge].tolist(), mesh.edge_sides[edge].tolist()):
                names[quad, side] = f"{seam_name(number)}{place + 1}"
    return names


def make_labels(
    layout: PatchLayout,
    arms: Arms,
    hubs: SlotRoots,
    params: SheetParams,
    taken: Float[np.ndarray, "quads 4"] | None = None,
    progress: Progress = SILENT,
    mark: str = "",
    pierced: Sequence[int] = (),
) -> Labels:
    """Make all labels: every panel's number on its roomiest hub or arm, and every joint's name on its arm.

    Where an arm is too narrow for legible letters and its hub has room for larger ones, the name is placed on the hub,
    with a tick on the arm. Labels that are still too small are listed in ``small``.

    Parameters
    ----------
    layout : panels and seams
    arms, hubs : arms of all quads, and the ends of their slots
    params : heights of labels
    taken : metres of every arm, from its joint, that a connector occupies
    progress : called with the fraction done; may cancel
    mark : letter of the piece, see ``panel_name``
    pierced : quads whose hubs have a hole
    """
    taken = np.zeros((len(arms.centre), 4)) if taken is None else taken
    lines = _Lines(arms, hubs, taken, progress.part(0.0, 0.2))
    lines.hub[list(pierced)] = 0.0
    strokes: list[list[Curve]] = [[] for _ in layout.patches]
    on_hubs: list[list[Curve]] = [[] for _ in layout.patches]
    small: list[SmallLabel] = []
    legible = min(LEGIBLE, params.label_height)
    names, numbers = seam_labels(layout), panel_numbers(layout)

    def add(label: _PlacedLabel, text: str, patch: int, places: np.ndarray) -> None:
        strokes[patch] += [*label.letters, *label.tick]
        on_hubs[patch] += label.letters if label.hub and label.height >= legible else ()
        if label.height < legible:
            small.append(SmallLabel(text, patch, places, placed=bool(label.letters)))

    for patch, quads in enumerate(layout.patches):
        progress(0.2 + 0.3 * patch / len(layout.patches), "labels")
        text = panel_name(numbers[patch], mark)
        ends = lines.points[quads][layout.outline_sides[quads]][:, 0]
        label = _panel_label(text, quads, lines, names, params.label_height)
        add(label, text, patch, ends[:: max(-(-len(ends) // _PLACES), 1)])
    for number, ((quad, side), joint) in enumerate(names.items()):
        progress(0.5 + 0.5 * number / len(names), "labels")
        text, patch = with_mark(joint, mark), int(layout.patch_of[quad])
        add(_joint_label(text, quad, side, lines, params), text, patch, lines.points[quad, side, :1])
    left_out = sum(not one.placed for one in small)
    placed = len(layout.patches) + len(names) - left_out
    return Labels(tuple(map(tuple, strokes)), placed, left_out, tuple(map(tuple, on_hubs)), tuple(small))


def hub_circles(arms: Arms, roots: SlotRoots) -> Float[np.ndarray, " quads"]:
    """Return the radius in metres of the circle about every hub's centre that its four fillets leave free.

    Parameters
    ----------
    arms : of all quads
    roots : ends of their slots, with fillets
    """
    return (np.linalg.norm(roots.centre - arms.centre[:, None], axis=-1) - roots.fillet).min(axis=1)


def _curves(strokes: Iterable[np.ndarray]) -> Iterator[Curve]:
    """Return strokes as open curves."""
    return (Curve(s, np.zeros(len(s)), closed=False) for s in strokes)


def key_label(name: str, neck: float, long: float, params: SheetParams) -> tuple[Curve, ...]:
    """Return the name of a loose key's joint across its middle; empty if too small.

    Parameters
    ----------
    name : of the joint
    neck, long : width of the key's neck and length of the key, metres
    params : heights of labels, and whether there are any
    """
    height = min(params.label_height, FILL_SHARE * neck, 0.8 * long / length(name))
    if not params.labels or height < params.label_min:
        return ()
    found = straight(name, height, np.zeros(2), np.array([1.0, 0.0]))
    return tuple(_curves(found))


class _Lines:
    """Free part of every arm for letters, from its joint to its hub."""

    def __init__(self, arms: Arms, hubs: SlotRoots, taken: np.ndarray, progress: Progress):
        self.taken = taken
        end = np.minimum(hubs.left, np.roll(hubs.right, 1, axis=1))
        points, widths = [], []
        for part in progress.batches(len(end), _TOGETHER, "labels"):
            some, t = (
                arms.subset(np.arange(part.start, part.stop)),
                end[part, :, None] * np.linspace(0.0, 1.0, _SAMPLES),
            )
            points.append(centre_line(some, t)[0])
            widths.append(width_at(some, t)[0])
        self.points, self.width = np.concatenate(points), np.concatenate(widths)
        self.length = np.linalg.norm(np.diff(self.points, axis=2), axis=-1).sum(axis=-1)
        self.narrowest = self.width.min(axis=-1)
        self.centre = arms.centre
        # the hub contains the circle inside its four fillets
        self.hub = hub_circles(arms, hubs)

    def height(self, quad: int, side: int, text: str, largest: float) -> float:
        """Return the maximum height in metres of the letters of a text along this arm."""
        room = 0.9 * (self.length[quad, side] - self.taken[quad, side] - 0.4 * self.width[quad, side, 0])
        return float(min(largest, FILL_SHARE * self.narrowest[quad, side], room / length(text)))

    def on_hub(self, quad: int, text: str, largest: float) -> float:
        """Return the maximum height in metres of the letters of a text on this hub; 0 if it is occupied."""
        return min(largest, 1.8 * float(self.hub[quad]) / float(np.hypot(length(text), 1.0)))


class _PlacedLabel(NamedTuple):
    """A label on the material; without letters if there is no room.

    height : of the letters, metres
    hub : whether it is on a hub
    tick : stroke that points to the arm
    """

    letters: tuple[Curve, ...] = ()
    height: float = 0.0
    hub: bool = False
    tick: tuple[Curve, ...] = ()


def _joint_label(text: str, quad: int, side: int, lines: _Lines, params: SheetParams) -> _PlacedLabel:
    """Return the name of a joint on its arm, or on its hub if that allows larger letters and the arm's are not legible."""
    height = lines.height(quad, side, text, params.label_height)
    on_hub = lines.on_hub(quad, text, params.label_height)
    if height < min(LEGIBLE, params.label_height) and max(height, params.label_min) < on_hub:
        lines.hub[quad] = 0.0  # occupied
        tick = lines.points[quad, side, -_TICK:]
        letters = straight(text, on_hub, lines.centre[quad], np.array([1.0, 0.0]))
        return _PlacedLabel(tuple(_curves(letters)), on_hub, True, tuple(_curves([tick])))
    if height < params.label_min:
        return _PlacedLabel()
    width = float(lines.width[quad, side, 0])
    middle = float(lines.taken[quad, side]) + 0.4 * width + 0.5 * height * length(text)
    return _PlacedLabel(tuple(_curves(along(text, height, lines.points[quad, side], middle))), height)


def _panel_label(
    text: str, quads: np.ndarray, lines: _Lines, taken: dict[tuple[int, int], str], largest: float
) -> _PlacedLabel:
    """Return a panel's number as large as possible.

    It stands on the roomiest hub, or along the roomiest arm without a seam label.
    """
    roomiest = int(quads[np.argmax(lines.hub[quads])])
    on_hub = lines.on_hub(roomiest, text, largest)
    free = [(q, k) for q in quads[np.argsort(-lines.narrowest[quads].min(axis=1))[:8]].tolist() for k in range(4)]
    free = [a for a in free if a not in taken] or free
    quad, side = max(free, key=lambda a: lines.height(a[0], a[1], text, largest))
    on_arm = lines.height(quad, side, text, largest)
    if on_hub >= on_arm:
        lines.hub[roomiest] = 0.0  # occupied
        letters = straight(text, on_hub, lines.centre[roomiest], np.array([1.0, 0.0]))
        return _PlacedLabel(tuple(_curves(letters)), on_hub, True)
    line, middle = lines.points[quad, side], 0.5 * float(lines.length[quad, side])
    return _PlacedLabel(tuple(_curves(along(text, on_arm, line, middle))), on_arm)
