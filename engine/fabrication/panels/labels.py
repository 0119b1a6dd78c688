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
from .lettering import FILL_SHARE, curved_text, straight_text, text_length

_SAMPLES = 97  # samples along an arm, joined by straight lines along which labels run; more follow curves more exactly
# minimum height in metres of letters that can be read without a lens; larger puts more labels beside panels
LEGIBLE_HEIGHT = 0.002
# A tick on an arm shows to which joint a name on the hub belongs. Number of the arm's samples (``_SAMPLES``), from the
# hub, that the tick covers; by eye
_TICK = 8
# maximum number of arm ends to choose from when a panel's number is written beside the panel, with a tick that points
# at an arm end; more take longer
_PLACES = 8
_TOGETHER = 1000  # quads whose arms are sampled together; more take more memory
_SEAM_LETTERS = "ABCDEFGHJKLMNPQRSTUVWXYZ"  # without I and O, which look like digits
_UPSIDE_DOWN = str.maketrans("69", "96")


@dataclass(frozen=True, eq=False)
class SmallLabel:
    """A label whose letters are too small to read, or that has no room on the material at all.

    patch : index of the patch to which it belongs
    places : points (metres, patch frame); if the label is written beside its panel, a tick points from it at one of
        them
    is_engraved : whether it is engraved on the material, in small letters
    """

    text: str
    patch: int
    places: Float[np.ndarray, "places 2"]
    is_engraved: bool


@dataclass(frozen=True, eq=False)
class Labels:
    """The strokes of the labels of every patch in its frame.

    strokes : a tuple of open curves for every patch
    engraved_count, left_out_count : number of labels that are engraved, and of labels without room
    hub_strokes : for every patch those of ``strokes`` that lie on hubs and are large enough to read
    small : labels too small to read or without room; they may also be written beside their panels
    """

    strokes: tuple[tuple[Curve, ...], ...]
    engraved_count: int
    left_out_count: int
    hub_strokes: tuple[tuple[Curve, ...], ...] = ()
    small: tuple[SmallLabel, ...] = ()


def seam_name(number: int) -> str:
    """Return the letters of a seam by its index: A, B, ... Z, AA, AB, ... without I and O, which look like digits."""
    name = ""
    number += 1
    while number:
        number, letter = divmod(number - 1, len(_SEAM_LETTERS))
        name = _SEAM_LETTERS[letter] + name
    return name


def with_mark(name: str, mark: str) -> str:
    """Return the name with the letter of its piece in front, which makes it unique on sheets shared by pieces.

    Parameters
    ----------
    name : name of a panel or joint
    mark : letter of the piece; empty if the sheets hold a single piece
    """
    return f"{mark}-{name}" if mark else name


def panel_name(number: int, mark: str = "") -> str:
    """Return the engraved text of a panel's number, with a dot if it reads as another number upside down.

    Parameters
    ----------
    number : number of the panel
    mark : letter of its piece if several share sheets; it makes the dot unnecessary
    """
    name = str(number)
    if mark:
        return with_mark(name, mark)
    return name + "." if set(name) <= set("01689") and name != name[::-1].translate(_UPSIDE_DOWN) else name


def seam_labels(layout: PatchLayout) -> dict[tuple[int, int], str]:
    """Return the names of all joints at seams by (quad, side): letter of the seam and number, equal on both sides."""
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
    occupied_lengths: Float[np.ndarray, "quads 4"] | None = None,
    progress: Progress = SILENT,
    mark: str = "",
    quads_with_holes: Sequence[int] = (),
) -> Labels:
    """Make all labels: the number of every panel, on the hub or arm with most room, and the name of every joint.

    Names of joints are written on both arms of the joint. Where an arm is too narrow for legible letters and its hub
    has room for larger ones, the name is on the hub, with a tick on the arm. Labels that are still too small are listed
    in ``Labels.small``.

    Parameters
    ----------
    layout : panels and seams
    arms : arms of all quads
    hubs : inner ends of the slots between the arms, which bound the hubs
    params : heights of labels
    occupied_lengths : length in metres of the part of every arm, from its joint, that a connector occupies
    progress : called with the fraction done; may cancel
    mark : letter of the piece, see ``panel_name``
    quads_with_holes : quads whose hubs have a hole
    """
    occupied_lengths = np.zeros((len(arms.centre), 4)) if occupied_lengths is None else occupied_lengths
    lines = _LabelPlaces(arms, hubs, occupied_lengths, progress.part(0.0, 0.2))
    lines.hub_radius[list(quads_with_holes)] = 0.0
    strokes: list[list[Curve]] = [[] for _ in layout.patches]
    on_hubs: list[list[Curve]] = [[] for _ in layout.patches]
    small: list[SmallLabel] = []
    legible = min(LEGIBLE_HEIGHT, params.label_height)
    names, numbers = seam_labels(layout), panel_numbers(layout)

    def add(label: _PlacedLabel, text: str, patch: int, places: np.ndarray) -> None:
        strokes[patch] += [*label.letters, *label.tick]
        on_hubs[patch] += label.letters if label.is_on_hub and label.height >= legible else ()
        if label.height < legible:
            small.append(SmallLabel(text, patch, places, is_engraved=bool(label.letters)))

    for patch, quads in enumerate(layout.patches):
        progress(0.2 + 0.3 * patch / len(layout.patches), "placing labels")
        text = panel_name(numbers[patch], mark)
        ends = lines.points[quads][layout.outline_sides[quads]][:, 0]
        label = _panel_label(text, quads, lines, names, params.label_height)
        add(label, text, patch, ends[:: max(-(-len(ends) // _PLACES), 1)])
    for number, ((quad, side), joint) in enumerate(names.items()):
        progress(0.5 + 0.5 * number / len(names), "placing labels")
        text, patch = with_mark(joint, mark), int(layout.patch_of[quad])
        add(_joint_label(text, quad, side, lines, params), text, patch, lines.points[quad, side, :1])
    left_out = sum(not one.is_engraved for one in small)
    placed = len(layout.patches) + len(names) - left_out
    return Labels(tuple(map(tuple, strokes)), placed, left_out, tuple(map(tuple, on_hubs)), tuple(small))


def free_hub_radii(arms: Arms, roots: SlotRoots) -> Float[np.ndarray, " quads"]:
    """Return for every hub the radius in metres of the largest circle about its centre that no slot cuts into.

    Parameters
    ----------
    arms : arms of all quads
    roots : rounded inner ends of their slots
    """
    return (np.linalg.norm(roots.centre - arms.centre[:, None], axis=-1) - roots.fillet).min(axis=1)


def _curves(strokes: Iterable[np.ndarray]) -> Iterator[Curve]:
    """Convert strokes (polylines) to open curves."""
    return (Curve(s, np.zeros(len(s)), closed=False) for s in strokes)


def key_label(name: str, neck: float, long: float, params: SheetParams) -> tuple[Curve, ...]:
    """Return the strokes of a joint's name across the middle of its loose key; empty if the key is too small.

    Parameters
    ----------
    name : name of the joint
    neck, long : width of the key's neck and length of the key, metres
    params : heights of labels, and whether there are any
    """
    height = min(params.label_height, FILL_SHARE * neck, 0.8 * long / text_length(name))
    if not params.labels or height < params.label_min:
        return ()
    found = straight_text(name, height, np.zeros(2), np.array([1.0, 0.0]))
    return tuple(_curves(found))


class _LabelPlaces:
    """Places for letters: along the centre line of every arm, from joint to hub, and in a free circle on every hub."""

    def __init__(self, arms: Arms, hubs: SlotRoots, taken: np.ndarray, progress: Progress):
        self.occupied_lengths = taken
        end = np.minimum(hubs.left, np.roll(hubs.right, 1, axis=1))
        points, widths = [], []
        for part in progress.batches(len(end), _TOGETHER, "placing labels"):
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
        # radius of the free circle on each hub
        self.hub_radius = free_hub_radii(arms, hubs)

    def height_on_arm(self, quad: int, side: int, text: str, largest: float) -> float:
        """Return the height in metres of the largest letters that fit along this arm, at most ``largest``."""
        room = 0.9 * (self.length[quad, side] - self.occupied_lengths[quad, side] - 0.4 * self.width[quad, side, 0])
        return float(min(largest, FILL_SHARE * self.narrowest[quad, side], room / text_length(text)))

    def height_on_hub(self, quad: int, text: str, largest: float) -> float:
        """Return the height in metres of the largest letters that fit on this hub, at most ``largest``.

        It is 0 if the hub already has a label or a hole.
        """
        return min(largest, 1.8 * float(self.hub_radius[quad]) / float(np.hypot(text_length(text), 1.0)))


class _PlacedLabel(NamedTuple):
    """A label on the material; it has no letters if there is no room.

    height : height of the letters, metres
    is_on_hub : whether the label is on a hub
    tick : stroke on an arm, which shows that the label on the hub belongs to this arm's joint
    """

    letters: tuple[Curve, ...] = ()
    height: float = 0.0
    is_on_hub: bool = False
    tick: tuple[Curve, ...] = ()


def _joint_label(text: str, quad: int, side: int, lines: _LabelPlaces, params: SheetParams) -> _PlacedLabel:
    """Write the name of a joint on its arm, or on its hub if letters there are illegible and the hub has more room.

    lines : places for letters; a hub that gets the name is marked as full
    """
    height = lines.height_on_arm(quad, side, text, params.label_height)
    on_hub = lines.height_on_hub(quad, text, params.label_height)
    if height < min(LEGIBLE_HEIGHT, params.label_height) and max(height, params.label_min) < on_hub:
        lines.hub_radius[quad] = 0.0  # mark the hub as full
        tick = lines.points[quad, side, -_TICK:]
        letters = straight_text(text, on_hub, lines.centre[quad], np.array([1.0, 0.0]))
        return _PlacedLabel(tuple(_curves(letters)), on_hub, True, tuple(_curves([tick])))
    if height < params.label_min:
        return _PlacedLabel()
    width = float(lines.width[quad, side, 0])
    middle = float(lines.occupied_lengths[quad, side]) + 0.4 * width + 0.5 * height * text_length(text)
    return _PlacedLabel(tuple(_curves(curved_text(text, height, lines.points[quad, side], middle))), height)


def _panel_label(
    text: str, quads: np.ndarray, lines: _LabelPlaces, taken: dict[tuple[int, int], str], largest: float
) -> _PlacedLabel:
    """Write a panel's number as large as possible, on the hub with most room or along an arm.

    quads : quads of the panel
    lines : places for letters; a hub that gets the number is marked as full
    taken : names of joints by (quad, side); arms with such a name are avoided
    largest : maximum height of the letters, metres
    """
    roomiest = int(quads[np.argmax(lines.hub_radius[quads])])
    on_hub = lines.height_on_hub(roomiest, text, largest)
    free = [(q, k) for q in quads[np.argsort(-lines.narrowest[quads].min(axis=1))[:8]].tolist() for k in range(4)]
    free = [a for a in free if a not in taken] or free
    quad, side = max(free, key=lambda a: lines.height_on_arm(a[0], a[1], text, largest))
    on_arm = lines.height_on_arm(quad, side, text, largest)
    if on_hub >= on_arm:
        lines.hub_radius[roomiest] = 0.0  # mark the hub as full
        letters = straight_text(text, on_hub, lines.centre[roomiest], np.array([1.0, 0.0]))
        return _PlacedLabel(tuple(_curves(letters)), on_hub, True)
    line, middle = lines.points[quad, side], 0.5 * float(lines.length[quad, side])
    return _PlacedLabel(tuple(_curves(curved_text(text, on_arm, line, middle))), on_arm)
