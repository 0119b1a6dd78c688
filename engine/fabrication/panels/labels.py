"""Panel numbers and seam labels, engraved where the material has room for them: on hubs and along arms."""

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
from ...spirals.arcs import Curve
from ...spirals.contours import Hubs
from ...spirals.spiral import Arms, centre_line, width_at
from .lettering import along, length, straight

_FILL = 0.62  # height of the letters along an arm, as a share of its width
_SAMPLES = 97  # places along an arm between which the line of a label is straight; not measured
LEGIBLE = 0.002  # metres; letters that anybody reads without a lens
_TICK = 8  # samples of an arm that its tick is long, from the hub on
_PLACES = 8  # ends of arms that a panel's number beside it may point at
_TOGETHER = 1000  # quads whose arms are followed together
_SEAM_LETTERS = "ABCDEFGHJKLMNPQRSTUVWXYZ"
_UPSIDE_DOWN = str.maketrans("69", "96")


@dataclass(frozen=True, eq=False)
class SmallLabel:
    """A label whose letters are hardly read, or have no room: its text, its patch, and places (metres, patch frame) that it may point at.

    placed : whether it stands on the material all the same
    """

    text: str
    patch: int
    places: Float[np.ndarray, "places 2"]
    placed: bool


@dataclass(frozen=True, eq=False)
class Labels:
    """The strokes of every patch's labels in its frame, and how many labels had no room.

    strokes : one tuple of open curves per patch; on_hubs : those of them that stand on hubs and are legible
    placed, left_out : numbers of labels
    small : those that may stand beside their panels too
    """

    strokes: tuple[tuple[Curve, ...], ...]
    placed: int
    left_out: int
    on_hubs: tuple[tuple[Curve, ...], ...] = ()
    small: tuple[SmallLabel, ...] = ()


def seam_name(number: int) -> str:
    """A, B, ... Z, AA, AB, ... without I and O, which look like numbers."""
    name = ""
    number += 1
    while number:
        number, letter = divmod(number - 1, len(_SEAM_LETTERS))
        name = _SEAM_LETTERS[letter] + name
    return name


def marked(name: str, mark: str) -> str:
    """What is engraved for a name of a piece that has a letter, so that no other piece on the same sheets bears it too."""
    return f"{mark}-{name}" if mark else name


def panel_name(number: int, mark: str = "") -> str:
    """What is engraved for a panel's number; with a dot after numbers that are others upside down.

    mark : letter of its piece, where several lie on common sheets; then nothing is the same upside down
    """
    name = str(number)
    if mark:
        return marked(name, mark)
    return name + "." if set(name) <= set("01689") and name != name[::-1].translate(_UPSIDE_DOWN) else name


def seam_labels(layout: PatchLayout) -> dict[tuple[int, int], str]:
    """The name of every joint on a seam by (quad, side): the seam's letter and the joint's number, the same on both sides."""
    mesh, names = layout.mesh, {}
    for number, edges in enumerate(layout.seams):
        for place, edge in enumerate(edges.tolist()):
            for quad, side in zip(mesh.edge_quads[edge].tolist(), mesh.edge_sides[edge].tolist()):
                names[quad, side] = f"{seam_name(number)}{place + 1}"
    return names


def make_labels(
    layout: PatchLayout,
    arms: Arms,
    hubs: Hubs,
    params: SheetParams,
    taken: Float[np.ndarray, "quads 4"] | None = None,
    progress: Progress = SILENT,
    mark: str = "",
    pierced: Sequence[int] = (),
) -> Labels:
    """All labels: the number of every panel on its roomiest hub or arm, and the name of every seam joint on its arm.

    Where an arm is too narrow for letters that are easily read and its hub has room for larger ones, the name stands there, with
    a tick on the arm that is meant. What is smaller than that all the same is named as ``small``.

    ``taken`` is how many metres of every arm, from its joint on, a connector needs; ``mark`` as in ``panel_name``;
    ``pierced`` are quads whose hubs have a hole.
    """
    taken = np.zeros((len(arms.centre), 4)) if taken is None else taken
    lines = _Lines(arms, hubs, taken, progress.part(0.0, 0.2))
    lines.hub[list(pierced)] = 0.0
    strokes: list[list[Curve]] = [[] for _ in layout.patches]
    on_hubs: list[list[Curve]] = [[] for _ in layout.patches]
    small: list[SmallLabel] = []
    legible = min(LEGIBLE, params.label_height)
    names, numbers = seam_labels(layout), panel_numbers(layout)

    def add(label: _Written, text: str, patch: int, places: np.ndarray) -> None:
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
        text, patch = marked(joint, mark), int(layout.patch_of[quad])
        add(_joint_label(text, quad, side, lines, params), text, patch, lines.points[quad, side, :1])
    left_out = sum(not one.placed for one in small)
    placed = len(layout.patches) + len(names) - left_out
    return Labels(tuple(map(tuple, strokes)), placed, left_out, tuple(map(tuple, on_hubs)), tuple(small))


def hub_circles(arms: Arms, roots: Hubs) -> Float[np.ndarray, " quads"]:
    """Metres: radius of the circle about every hub's centre that its four fillets leave."""
    return (np.linalg.norm(roots.centre - arms.centre[:, None], axis=-1) - roots.fillet).min(axis=1)


def _curves(strokes: Iterable[np.ndarray]) -> Iterator[Curve]:
    return (Curve(s, np.zeros(len(s)), closed=False) for s in strokes)


def key_label(name: str, neck: float, long: float, params: SheetParams) -> tuple[Curve, ...]:
    """The name of a loose key's joint, across its middle; nothing where it is too small. Width and length in metres."""
    height = min(params.label_height, _FILL * neck, 0.8 * long / length(name))
    if not params.labels or height < params.label_min:
        return ()
    found = straight(name, height, np.zeros(2), np.array([1.0, 0.0]))
    return tuple(_curves(found))


class _Lines:
    """Where letters may stand: the free part of every arm, from its joint to its hub."""

    def __init__(self, arms: Arms, hubs: Hubs, taken: np.ndarray, progress: Progress):
        self.taken = taken
        end = np.minimum(hubs.left, np.roll(hubs.right, 1, axis=1))
        points, widths = [], []
        for part in progress.batches(len(end), _TOGETHER, "labels"):
            some, t = arms.of(np.arange(part.start, part.stop)), end[part, :, None] * np.linspace(0.0, 1.0, _SAMPLES)
            points.append(centre_line(some, t)[0])
            widths.append(width_at(some, t)[0])
        self.points, self.width = np.concatenate(points), np.concatenate(widths)
        self.length = np.linalg.norm(np.diff(self.points, axis=2), axis=-1).sum(axis=-1)
        self.narrowest = self.width.min(axis=-1)
        self.centre = arms.centre
        # the hub is at least as wide as the circle inside its four fillets
        self.hub = hub_circles(arms, hubs)

    def height(self, quad: int, side: int, text: str, largest: float) -> float:
        """Metres: how high the letters of a text along this arm may be."""
        room = 0.9 * (self.length[quad, side] - self.taken[quad, side] - 0.4 * self.width[quad, side, 0])
        return float(min(largest, _FILL * self.narrowest[quad, side], room / length(text)))

    def on_hub(self, quad: int, text: str, largest: float) -> float:
        """Metres: how high the letters of a text on this hub may be; 0 where something stands there."""
        return min(largest, 1.8 * float(self.hub[quad]) / float(np.hypot(length(text), 1.0)))


class _Written(NamedTuple):
    """A label on the material: its letters, their height in metres, whether they stand on a hub, and a tick; no letters without room."""

    letters: tuple[Curve, ...] = ()
    height: float = 0.0
    hub: bool = False
    tick: tuple[Curve, ...] = ()


def _joint_label(text: str, quad: int, side: int, lines: _Lines, params: SheetParams) -> _Written:
    """The name of a joint on its arm, or on its hub where that has room for larger letters and the arm's are hardly read."""
    height = lines.height(quad, side, text, params.label_height)
    on_hub = lines.on_hub(quad, text, params.label_height)
    if height < min(LEGIBLE, params.label_height) and max(height, params.label_min) < on_hub:
        lines.hub[quad] = 0.0  # taken
        tick = lines.points[quad, side, -_TICK:]
        letters = straight(text, on_hub, lines.centre[quad], np.array([1.0, 0.0]))
        return _Written(tuple(_curves(letters)), on_hub, True, tuple(_curves([tick])))
    if height < params.label_min:
        return _Written()
    width = float(lines.width[quad, side, 0])
    middle = float(lines.taken[quad, side]) + 0.4 * width + 0.5 * height * length(text)
    return _Written(tuple(_curves(along(text, height, lines.points[quad, side], middle))), height)


def _panel_label(
    text: str, quads: np.ndarray, lines: _Lines, taken: dict[tuple[int, int], str], largest: float
) -> _Written:
    """The number of a panel, as large as it goes: on the roomiest hub, or else along the roomiest arm without a seam label."""
    roomiest = int(quads[np.argmax(lines.hub[quads])])
    on_hub = lines.on_hub(roomiest, text, largest)
    free = [(q, k) for q in quads[np.argsort(-lines.narrowest[quads].min(axis=1))[:8]].tolist() for k in range(4)]
    free = [a for a in free if a not in taken] or free
    quad, side = max(free, key=lambda a: lines.height(a[0], a[1], text, largest))
    on_arm = lines.height(quad, side, text, largest)
    if on_hub >= on_arm:
        lines.hub[roomiest] = 0.0  # taken
        letters = straight(text, on_hub, lines.centre[roomiest], np.array([1.0, 0.0]))
        return _Written(tuple(_curves(letters)), on_hub, True)
    line, middle = lines.points[quad, side], 0.5 * float(lines.length[quad, side])
    return _Written(tuple(_curves(along(text, on_arm, line, middle))), on_arm)
