"""Every setting of the program: default, bounds, unit and help text, each said once.

The engine works in SI units; ``unit`` is the unit of the value in the dataclass ("m", "rad", "Pa", or "" for a pure number).
People are shown millimetres, degrees and gigapascals: ``SHOWN`` holds the factor and the symbol, used by the Blender settings and by
the command line.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import Field, dataclass, field, fields, replace
from numbers import Integral, Real
from os import PathLike
from typing import Any, ClassVar, TypeVar

from .errors import FlexMapsError
from .materials import MATERIALS, Lasting, Material, Orthotropy, material

# of each unit: the factor to what is shown, and its symbol
SHOWN: dict[str, tuple[float, str]] = {
    "m": (1e3, "mm"),
    "rad": (180.0 / math.pi, "\N{DEGREE SIGN}"),
    "Pa": (1e-9, "GPa"),
    "": (1.0, ""),
}


def setting(
    default: Any,
    label: str,
    help: str,
    *,
    low: float | None = None,
    high: float | None = None,
    unit: str = "",
    choices: tuple[tuple[str, str, str], ...] = (),
    folder: bool = False,
) -> Any:
    """Declare a dataclass field with what the user interfaces need to show it.

    ``choices`` are (identifier, label, help) triples for a string setting; ``folder`` marks a string that names one.
    """
    meta = {"label": label, "help": help, "low": low, "high": high, "unit": unit, "choices": choices, "folder": folder}
    return field(default=default, metadata=meta)


LARGEST = 1e300  # of any number; beyond it, and where it is no number at all, is what nobody means
SLACK = 1e-6  # relative: Blender's single precision lands a hair outside of bounds


def wanted(f: Field) -> str:
    """What number a field takes, e.g. "a whole number from 0 to 50"."""
    whole = isinstance(f.default, int)
    kind, tell = ("a whole number", str) if whole else ("a number", lambda bound: shown(f, bound))
    low, high = (None if f.metadata[k] is None else tell(f.metadata[k]) for k in ("low", "high"))
    if low is not None and high is not None:
        return f"{kind} from {low} to {high}"
    return kind if low is None else f"{kind} from {low} on"


def shown(f: Field, value: float) -> str:
    """``value`` of the field ``f`` as a person reads it, e.g. ``"2 mm"``."""
    factor, symbol = SHOWN[f.metadata["unit"]]
    return f"{value * factor:g}{' ' if symbol.isalpha() else ''}{symbol}"


class Params:
    """Base of all settings: refuses values of another kind, values outside their bounds, and bounds of each other that cross."""

    ORDERED: ClassVar[tuple[tuple[str, str], ...]] = ()  # of each pair the first may not be above the second
    # switches that earlier versions had, on by default, and the settings that stand for them where they are off
    WERE: ClassVar[dict[str, dict[str, Any]]] = {}

    def __post_init__(self) -> None:
        known = {f.name: f for f in fields(self)}  # type: ignore[arg-type]
        for f in known.values():
            _refuse_wrong(f, getattr(self, f.name))
        for name, other in self.ORDERED:
            _refuse_above(self, name, self, other, "exchange them, or change one of them")


def _refuse_above(block: Params, name: str, other: Params, limit: str, remedy: str) -> None:
    """Raise where a setting of a block is above one of the same or of another block."""
    value, most = getattr(block, name), getattr(other, limit)
    if value > most + SLACK * abs(most):
        low, high = (next(f for f in fields(b) if f.name == n) for b, n in ((block, name), (other, limit)))  # type: ignore[arg-type]
        raise FlexMapsError(
            f"{low.metadata['label']} {shown(low, value)} is above {high.metadata['label']} {shown(high, most)}; {remedy}"
        )


def _is_number(value: Any, *, whole: bool = False) -> bool:
    """Whether it is a number that can be computed with."""
    return isinstance(value, Integral if whole else Real) and not isinstance(value, bool) and abs(value) <= LARGEST  # type: ignore[operator]


def _quoted(value: Any) -> str:
    """A value for a message, in one line, however long it is."""
    try:
        text = value if isinstance(value, str) else repr(value)
    except ValueError:  # Python does not write out whole numbers of thousands of digits
        text = "a very large number"
    text = " ".join(text.split())
    return f"'{text if len(text) <= 60 else text[:57] + '...'}'"


def _refuse_wrong(f: Field, value: Any) -> None:
    """Raise unless ``value`` is one that the field may have."""
    meta, default = f.metadata, f.default
    if meta["choices"]:
        names = [choice[0] for choice in meta["choices"]]
        if not isinstance(value, str) or value not in names:
            raise FlexMapsError(f"{meta['label']}: {_quoted(value)} is not one of {', '.join(names)}")
    elif isinstance(default, str):
        if not isinstance(value, str):
            raise FlexMapsError(f"{meta['label']} {_quoted(value)}: give a text")
    elif isinstance(default, bool):
        if not isinstance(value, bool):
            raise FlexMapsError(f"{meta['label']} {_quoted(value)}: give on or off")
    elif not _is_number(value, whole=isinstance(default, int)):
        raise FlexMapsError(f"{meta['label']} {_quoted(value)}: give {wanted(f)}")
    else:
        low, high = meta["low"], meta["high"]
        if low is not None and value < low - SLACK * abs(low):
            raise FlexMapsError(f"{meta['label']} {shown(f, value)} is below its smallest value {shown(f, low)}")
        if high is not None and value > high + SLACK * abs(high):
            raise FlexMapsError(f"{meta['label']} {shown(f, value)} is above its largest value {shown(f, high)}")


@dataclass(frozen=True)
class RegulariseParams(Params):
    """Making the quads squarer before they are flattened (Pietroni et al. 2015)."""

    iterations: int = setting(60, "Iterations", "Rounds of fitting squares and averaging them", low=0, high=1000)
    boundary: bool = setting(True, "Keep the border", "Move border vertices only along the border of an open surface")


@dataclass(frozen=True)
class LayoutParams(Params):
    """How large and how regular the patches may become (FlexMaps section 4)."""

    distortion_limit: float = setting(
        0.035, "Distortion limit", "Largest ARAP energy of a quad in a merged patch", low=0.001, high=1.0
    )
    compactness_limit: float = setting(
        5.0,
        "Compactness limit",
        "Largest perimeter / sqrt(area) of a patch; a square has 4. Where the surface itself is narrow, its border hardly counts",
        low=3.6,
        high=50.0,
    )
    neck_min: int = setting(2, "Smallest neck", "Fewest quads across any isthmus of a patch", low=1, high=10)
    patch_min: int = setting(6, "Smallest patch", "Fewest quads in a patch, where the surface allows", low=1, high=1000)
    symmetric: bool = setting(True, "Keep symmetry", "Give a symmetric surface a symmetric layout where possible")
    seamless: bool = setting(
        False,
        "One panel without a cut",
        "Leave a curved surface in one panel where it lies flat in one. Without supports such a panel stays flat: "
        "nothing makes it leave the plane",
    )


@dataclass(frozen=True)
class ChooseParams(Params):
    """What is wanted of a layout that is chosen by the shape which its panels take."""

    goal: str = setting(
        "match",
        "Goal",
        "What the layout shall be chosen for",
        choices=(
            ("match", "Match", "As near to the target as is asked, with as few joints as that takes"),
            ("panels", "Panels", "As near to the target as so many panels come"),
            ("least", "Least work", "As few joints as come as near to the target as the present layout does"),
        ),
    )
    match: float = setting(
        1.0,
        "Match (%)",
        "RMS distance from the target that the assembled piece may keep, in percent of its size",
        low=0.001,
        high=100.0,
    )
    panels: int = setting(4, "Panels", "Most panels that the layout may have", low=1, high=1000)
    near: bool = setting(
        False, "Only changes", "Try only cuts, darts and joins in the present layout, no other layouts; quicker"
    )


@dataclass(frozen=True)
class SpiralParams(Params):
    """The fabricable range of the spirals (FlexMaps section 5)."""

    ORDERED = (("width_min", "width_max"), ("twist_min", "twist_max"))

    thickness: float = setting(0.002, "Thickness", "Thickness of the sheet", low=0.0001, high=0.05, unit="m")
    width_min: float = setting(0.001, "Smallest width", "Width of the thinnest arm", low=0.0002, high=0.1, unit="m")
    width_max: float = setting(0.002, "Largest width", "Width of the thickest arm", low=0.0002, high=0.1, unit="m")
    twist_min: float = setting(
        0.0, "Smallest twist", "Winding angle of the stiffest spiral", low=0.0, high=4 * math.pi, unit="rad"
    )
    twist_max: float = setting(
        2 * math.pi,
        "Largest twist",
        "Winding angle of the softest spiral, where it can be cut",
        low=0.0,
        high=4 * math.pi,
        unit="rad",
    )
    slot_min: float = setting(
        0.0003, "Smallest slot", "Narrowest gap between two arms that can be cut", low=0.0, high=0.01, unit="m"
    )
    slot_seam: float = setting(
        0.0012,
        "Slot at seams",
        "Narrowest gap beside arms that meet across a cut, where they are too short for a connector to find room farther along them; no more than half of what straight arms leave",
        low=0.0,
        high=0.02,
        unit="m",
    )
    blend: float = setting(
        0.15, "Blend", "Share of an arm's end over which two neighbours merge smoothly", low=0.01, high=0.5
    )
    fillet: float = setting(
        0.00015,
        "Fillet",
        "Radius of the inside corners at the hub; at least half of the kerf, and of the smallest slot if the slot is to be that wide at its root too",
        low=0.0,
        high=0.005,
        unit="m",
    )
    curvature_top: float = setting(
        98.0,
        "Curvature top",
        "Percentile of the curvature that gets the softest spirals; 100 takes the very largest",
        low=50.0,
        high=100.0,
    )
    clockwise: bool = setting(False, "Clockwise", "Wind the spirals the other way round")
    grain: float = setting(
        0.0,
        "Grain",
        "Direction of the sheet's grain in every panel, from its longer side, counter-clockwise as seen from outside; for sheets that "
        "are stiffer along it, and for panels that are laid along the grain",
        low=-0.5 * math.pi,
        high=0.5 * math.pi,
        unit="rad",
    )
    border: str = setting(
        "stubs",
        "Border",
        "What becomes of the arms that end at an open border, where they have no other arm to meet",
        choices=(
            ("stubs", "Stubs", "They are cut as all others, and end in the air"),
            ("left_out", "Left out", "They are not cut; their hubs have a round end in their place"),
            ("rim", "Rim", "A strip along the border joins their tips, with holes for a cord or rivets"),
        ),
    )
    rim_width: float = setting(
        0.005,
        "Rim width",
        "Width of the strip along an open border; at least twice its holes",
        low=0.0005,
        high=0.1,
        unit="m",
    )
    rim_hole: float = setting(
        0.002,
        "Rim holes",
        "Diameter of the holes in the rim, for a cord or rivets; 0 for none",
        low=0.0,
        high=0.05,
        unit="m",
    )
    rim_spacing: float = setting(
        0.01,
        "Hole spacing",
        "About how far apart the holes of the rim are; they are spread evenly between two arms",
        low=0.001,
        high=1.0,
        unit="m",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.border != "rim" or self.rim_hole == 0.0:
            return
        if self.rim_width < 2.0 * self.rim_hole * (1.0 - SLACK):
            raise FlexMapsError(
                f"A rim of {self.rim_width * 1e3:g} mm is too narrow for holes of {self.rim_hole * 1e3:g} mm; make it at least twice as wide as "
                "its holes, or the holes smaller"
            )
        if self.rim_spacing < 2.0 * self.rim_hole * (1.0 - SLACK):
            raise FlexMapsError(
                f"Holes of {self.rim_hole * 1e3:g} mm cannot be {self.rim_spacing * 1e3:g} mm apart; make the hole spacing at least twice their diameter"
            )


@dataclass(frozen=True)
class ConnectorParams(Params):
    """The joints of the panels, wherever two arms meet across a cut (FlexMaps section 8)."""

    connector: str = setting(
        "dovetail",
        "Connectors",
        "What holds two arms together where they meet across a cut",
        choices=(
            ("none", "None", "Plain ends"),
            ("dovetail", "Dovetails", "A head on one panel snaps into a socket of the other"),
            ("key", "Keys", "Both panels have sockets; a small loose key holds them and can be taken out again"),
            ("tab", "Tabs", "Widened plain ends, to be glued"),
        ),
    )
    clearance: float = setting(
        0.00005,
        "Clearance",
        "Free gap all round between the finished parts of a joint: about 0.05 mm for a laser, 0.1 mm for a 3D printer; the kerf comes on top of it",
        low=0.0,
        high=0.001,
        unit="m",
    )
    neck: float = setting(
        1.0, "Neck", "Width of a connector's neck as a share of the width of its arm", low=0.5, high=2.0
    )
    thinnest: float = setting(
        0.0008,
        "Thinnest part",
        "No neck and no wall of a connector is thinner; sheets of 2 mm need about 0.8 mm",
        low=0.0002,
        high=0.02,
        unit="m",
    )
    rounding: float = setting(
        0.0002,
        "Rounding",
        "Radius of a connector's corners; at least half of the kerf of a laser",
        low=0.00005,
        high=0.005,
        unit="m",
    )


@dataclass(frozen=True)
class CutParams(Params):
    """What cuts the sheet: the paths in the files run half of the kerf beside the material."""

    kerf_outline: float = setting(
        0.0,
        "Kerf, outlines",
        "Width that the cutter takes away along the outlines; 0.1 to 0.2 mm for a laser, a mill's diameter; 0 if the machine's own program allows for it",
        low=0.0,
        high=0.01,
        unit="m",
    )
    kerf_holes: float = setting(
        0.0,
        "Kerf, holes",
        "The same in the holes, for cutters whose holes come out otherwise",
        low=0.0,
        high=0.01,
        unit="m",
    )
    mill: float = setting(
        0.0,
        "Mill",
        "Diameter of the mill that cuts the sheet, 0 for a laser or water: every slot must be as wide, sockets get dogbones",
        low=0.0,
        high=0.01,
        unit="m",
    )
    lead_in: float = setting(
        0.0,
        "Lead-in",
        "Every cut begins so far beside its path, in the waste, where there is room; 0 for none",
        low=0.0,
        high=0.02,
        unit="m",
    )
    tabs: int = setting(
        0, "Holding tabs", "How many bridges hold every panel in its sheet until you break them", low=0, high=50
    )
    tab_width: float = setting(
        0.001, "Tab width", "Width of a holding tab, the kerf not counted", low=0.0001, high=0.02, unit="m"
    )


@dataclass(frozen=True)
class SheetParams(Params):
    """The sheets that are cut, and how the panels lie on them."""

    sheet_width: float = setting(0.6, "Sheet width", "Width of the sheet of material", low=0.01, high=10.0, unit="m")
    sheet_height: float = setting(0.4, "Sheet height", "Height of the sheet of material", low=0.01, high=10.0, unit="m")
    margin: float = setting(0.005, "Margin", "Free border of the sheet", low=0.0, high=0.5, unit="m")
    spacing: float = setting(0.003, "Spacing", "Free distance between panels", low=0.0, high=0.1, unit="m")
    tolerance: float = setting(
        0.00001, "Curve tolerance", "How far arcs may stray from the true outline", low=1e-6, high=0.001, unit="m"
    )
    labels: bool = setting(True, "Labels", "Engrave panel and seam labels where there is room")
    label_height: float = setting(
        0.0025, "Label height", "Largest letter height of a label", low=0.0005, high=0.1, unit="m"
    )
    label_min: float = setting(
        0.0006,
        "Smallest letters",
        "Seam labels that would have to be smaller than this are left out",
        low=0.0001,
        high=0.1,
        unit="m",
    )
    frame: bool = setting(
        True,
        "Sheet outline",
        "Draw the sheet's edge and its origin in SVG and DXF, on a layer of their own that is not to be cut",
    )
    oversize: str = setting(
        "split", "Too large panels", "What happens to a panel that is larger than the sheet",
        choices=(
            ("split", "Cut", "Cut the patch along a new seam when patches are merged, until every piece fits"),
            ("enlarge", "Larger sheet", "Give it a sheet as large as it needs, with a warning"),
            ("error", "Stop", "Stop and name the patch"),
        ),
    )  # fmt: skip
    cut_joints: int = setting(
        0,
        "Joints for a sheet",
        "Panels are cut further where that saves a sheet and makes at most so many joints more; with 0 only those that are too large",
        low=0,
        high=10000,
    )
    rotation: str = setting(
        "FREE", "Rotation", "How the panels may be turned on the sheet",
        choices=(
            ("FREE", "Any", "Any angle"),
            ("QUARTER", "Quarter turns", "Every panel's longer side along or across the sheet"),
            ("GRAIN", "Along the grain", "The grain of every panel along the sheet's width: its longer side, or as Grain says"),
        ),
    )  # fmt: skip
    nesting: str = setting(
        "TRUE", "Nesting", "How the panels are laid on the sheets",
        choices=(
            ("TRUE", "Tight", "Search for the fewest sheets, as long as the time limit allows"),
            ("FAST", "Quick", "Quarter turns only, without a search"),
        ),
    )  # fmt: skip
    # the panels of 986 quads came onto as few sheets, as full, in 8 s as in 20
    nesting_seconds: float = setting(
        8.0, "Nesting seconds", "Longest time that the search for fewer sheets may take", low=0.0, high=86400.0
    )
    remnants: str = setting(
        "",
        "Remnants",
        "DXF or SVG drawings of odd pieces of sheet, with ; between them: they are filled first, each once. Along their width runs the grain",
    )
    seed: int = setting(0, "Seed", "Another number tries the panels in another order", low=0, high=2**31 - 1)

    def __post_init__(self) -> None:
        super().__post_init__()
        if 2.0 * self.margin >= min(self.sheet_width, self.sheet_height):
            raise FlexMapsError(
                f"The sheet of {self.sheet_width * 1e3:g} x {self.sheet_height * 1e3:g} mm is nothing but margin; make it"
                f" larger or the margin of {self.margin * 1e3:g} mm smaller"
            )


@dataclass(frozen=True)
class BaseParams(Params):
    """What a supported piece stands on."""

    base: str = setting(
        "none",
        "Base",
        "What the supported spirals stand on; choose it before the spirals are made",
        choices=(
            ("none", "None", "Nothing is made for the supports"),
            ("plate", "Plate", "One plate with a slot for the foot of every supported spiral"),
            ("feet", "Feet", "A plate for every run of supported spirals side by side"),
            ("frame", "Frame", "A closed ring of planks under the feet, which lock into each other"),
            (
                "eyelets",
                "Eyelets",
                "The piece hangs: a hole in the hub of every supported spiral, for a cord or a hook",
            ),
        ),
    )
    base_height: float = setting(
        0.005, "Height", "Free height between the base and the lowest point of the piece", low=0.0, high=1.0, unit="m"
    )
    foot_width: float = setting(
        0.008,
        "Foot width",
        "Width of a foot; its tongue is narrower by a fifth on either side",
        low=0.001,
        high=0.5,
        unit="m",
    )
    base_edge: float = setting(0.012, "Edge", "Width of the plate round its slots", low=0.001, high=0.5, unit="m")
    eyelet: float = setting(
        0.0008,
        "Eyelet",
        "Diameter of the holes by which a piece hangs; their hubs have to leave as much material round them",
        low=0.0001,
        high=0.1,
        unit="m",
    )

    @property
    def stands(self) -> bool:
        """Whether there are feet."""
        return self.base not in ("none", "eyelets")


@dataclass(frozen=True)
class CostParams(Params):
    """What the sheets, the machine and the hands cost, in any money; 0 where that does not count."""

    sheet_price: float = setting(0.0, "Price of a sheet", "What one sheet of the material costs", low=0.0, high=1e6)
    machine_rate: float = setting(
        0.0,
        "Machine, an hour",
        "What an hour of the laser costs; materials that no laser cuts have none",
        low=0.0,
        high=1e6,
    )
    labour_rate: float = setting(
        0.0, "Assembly, an hour", "What an hour of putting the panels together costs", low=0.0, high=1e6
    )


@dataclass(frozen=True)
class MaterialParams(Params):
    """What the sheet is made of."""

    material: str = setting(
        "pom",
        "Material",
        "What the sheet is made of: stiffness, weight and the strain it bears",
        choices=(
            *((key, m.name, m.source) for key, m in MATERIALS.items()),
            ("custom", "Custom", "The values below"),
        ),
    )
    youngs: float = setting(2.6e9, "Young's modulus", "Stiffness of a custom material", low=1e6, high=1e12, unit="Pa")
    poisson: float = setting(0.3, "Poisson's ratio", "Sideways strain of a custom material", low=0.01, high=0.44)
    across: float = setting(
        0.0,
        "Across the grain",
        "Young's modulus of a custom material across its grain, and the one above along it; 0 for a material without a grain",
        low=0.0,
        high=1e12,
        unit="Pa",
    )
    shear: float = setting(
        0.0,
        "Shear modulus",
        "In the sheet, of a custom material with a grain; 0 takes what plywood has beside its Young's modulus",
        low=0.0,
        high=1e12,
        unit="Pa",
    )
    density: float = setting(1185.0, "Density", "Of a custom material, in kg per cubic metre", low=1.0, high=3e4)
    strain_limit: float = setting(
        0.02,
        "Strain limit",
        "Largest strain that a custom material bears, as a share of its length",
        low=1e-4,
        high=5.0,
    )
    lasting_share: float = setting(
        0.0,
        "Left after a year",
        "Share of Young's modulus that a custom material has left after a year under load; 0: not known",
        low=0.0,
        high=1.0,
    )
    lasting_strain: float = setting(
        0.01, "Lasting strain limit", "Largest strain that a custom material bears for years", low=1e-5, high=5.0
    )

    @property
    def chosen(self) -> Material:
        """The material as the engine needs it."""
        if self.material != "custom":
            return material(self.material)
        given = "given by the user"
        lasting = Lasting(self.lasting_share, self.lasting_strain, given) if self.lasting_share else None
        rest = (self.poisson, self.density, self.strain_limit, True, given)
        if not self.across:
            return Material("Custom", self.youngs, *rest, lasting=lasting)
        # what is left as it is between the moduli of birch plywood
        usual = MATERIALS["birch"].orthotropy
        assert usual is not None
        shear = self.shear or self.youngs * usual.shear / usual.along
        poisson = self.poisson * min(1.0, self.youngs / self.across)
        flat, steep = (shear * one / usual.shear for one in (usual.shear_along, usual.shear_across))
        known = Orthotropy(self.youngs, self.across, poisson, shear, flat, steep)
        return Material("Custom", 0.5 * (self.youngs + self.across), *rest, lasting=lasting, orthotropy=known)


@dataclass(frozen=True)
class SimulateParams(Params):
    """Finding the shape that the assembled object takes (FlexMaps section 6.1)."""

    model: str = setting(
        "arm",
        "Elastic model",
        "How the arms of the spirals deform",
        choices=(
            ("arm", "Arms", "The full stiffness of every arm, from volumetric finite elements"),
            ("rod", "Rods", "Four stiffnesses a spiral, as published; kept for comparison"),
        ),
    )
    gravity: bool = setting(False, "Gravity", "Let the weight of the sheet act, downwards along z; needs supports")
    clamped: bool = setting(True, "Clamp supports", "Supported spirals keep their direction too, not only their place")
    # a long ribbon that unrolls by several turns takes some 300; all else converges in 5 to 60
    iterations: int = setting(
        500, "Iterations", "Most Newton iterations before the search is given up", low=1, high=10_000
    )
    tolerance: float = setting(
        1e-8, "Tolerance", "Largest force left over, as a share of the forces within", low=1e-12, high=1e-2
    )
    restarts: int = setting(
        0,
        "Other shapes",
        "Searches from randomly bent starts, to find whether it can snap into another shape",
        low=0,
        high=50,
    )


@dataclass(frozen=True)
class OptimiseParams(Params):
    """Finding the spirals whose assembly takes the target's shape (FlexMaps section 7)."""

    WERE = {"laplacian": {"lies": 1.0}}

    method: str = setting(
        "gauss_newton",
        "Method",
        "How the best spirals are sought",
        choices=(
            ("gauss_newton", "Gauss-Newton", "Few large steps; fast"),
            ("lbfgs", "L-BFGS-B", "Many small steps, as published; kept for comparison"),
        ),
    )
    arms: str = setting(
        "each",
        "Arms",
        "Which arms of a spiral may be of different widths. Spirals that are there already begin with the mean of arms that have to be alike",
        choices=(
            ("alike", "All alike", "All four arms of a spiral are as wide as each other, as published"),
            ("pairs", "In pairs", "Opposite arms are alike: a sheet may bend more easily one way than the other"),
            ("each", "Each its own", "Four widths a spiral: nearest to the target"),
        ),
    )
    grain: str = setting(
        "common",
        "Grain of panels",
        "Before the search, panels of a sheet with a grain may be turned on it, each for itself, where that brings the shape nearer to the target; lay them along the grain then",
        choices=(
            ("common", "All alike", "Every panel's grain as Grain says"),
            ("crossed", "Along or across", "Panels may be turned by a quarter"),
            ("free", "Any direction", "Panels may be turned by any multiple of 15 degrees"),
        ),
    )
    lies: float = setting(
        0.2,
        "Bends or lies alike",
        "What shall be alike: 0 compares how the surface bends, which keeps small features, 1 where it lies; in between, both",
        low=0.0,
        high=1.0,
    )
    # on a dome of 192 quads whose border was wished some 18 mm away, spirals came to .4 mm from there with 1, .8 with 0.3, 3 with 0.1 (7 at the start)
    urge: float = setting(
        1.0,
        "Urge of wishes",
        "How much it counts that spirals come to where they are wished, beside the target's shape; 0 leaves wishes aside",
        low=0.0,
        high=100.0,
    )
    smoothness: float = setting(
        0.0,
        "Smoothness",
        "How much neighbouring spirals should be alike; 0 lets each be as it likes",
        low=0.0,
        high=1.0,
    )
    strain_share: float = setting(
        1.0,
        "Strain limit",
        "Share of the strain which the material bears that the arms should stay below; 0 lets them be strained at will",
        low=0.0,
        high=10.0,
    )
    open_slots: bool = setting(
        True, "Keep slots open", "Keep the slots between the arms open in the assembled shape, where arms would touch"
    )
    iterations: int = setting(60, "Steps", "Most steps before the search ends", low=1, high=1000)
    cg_iterations: int = setting(
        40, "Inner steps", "Most conjugate gradient steps in a Gauss-Newton step", low=1, high=500
    )
    restart: bool = setting(
        True,
        "Try other starts",
        "Start from the present spirals, curvature-adjusted or uniform ones, whichever is nearest to the target; else only from the present ones",
    )
    codesign: bool = setting(
        True,
        "Flat shapes too",
        "Also move the vertices of the flat patches a little where that lowers the mismatch: nearer to the target, but two to four times slower. With the elastic model Arms only",
    )
    distortion_limit: float = setting(
        0.035, "Flat distortion", "Largest ARAP energy of a quad whose flat shape may move", low=0.001, high=1.0
    )
    patience: float = setting(
        1.0,
        "Patience",
        "How long the search may last: with 1 it ends with the best so far after about 25 s for 1,500 quads and 90 s for 6,000; 2 doubles that, 0 sets no limit",
        low=0.0,
        high=1000.0,
    )
    stop: float = setting(
        1e-3, "Stop at", "Ends when two steps in a row improve the match by less than this share", low=0.0, high=0.5
    )


@dataclass(frozen=True)
class StructureParams(Params):
    """What the piece has to bear; how lines of load cases read stands in ``engine/structure/cases.py``."""

    cases: str = setting(
        "weight: weight",
        "Load cases",
        "NAME: KIND VALUE AXIS on GROUP times FACTOR, with semicolons between them; kinds: weight, point, line, pressure, wind, snow, move; "
        "N, N/m, N/m2, mm",
    )
    combinations: str = setting(
        "", "Combinations", "Sums of cases with factors, with semicolons between them: NAME = 1.35 weight + 1.5 snow"
    )
    factor_max: float = setting(
        10.0, "Largest factor", "How many times a load may rise before it counts as safe", low=1.0, high=1000.0
    )


@dataclass(frozen=True)
class Settings:
    """All settings of the main job together."""

    regularise: RegulariseParams = field(default_factory=RegulariseParams)
    layout: LayoutParams = field(default_factory=LayoutParams)
    choose: ChooseParams = field(default_factory=ChooseParams)
    spiral: SpiralParams = field(default_factory=SpiralParams)
    connect: ConnectorParams = field(default_factory=ConnectorParams)
    cut: CutParams = field(default_factory=CutParams)
    sheet: SheetParams = field(default_factory=SheetParams)
    base: BaseParams = field(default_factory=BaseParams)
    cost: CostParams = field(default_factory=CostParams)
    material: MaterialParams = field(default_factory=MaterialParams)
    simulate: SimulateParams = field(default_factory=SimulateParams)
    optimise: OptimiseParams = field(default_factory=OptimiseParams)
    structure: StructureParams = field(default_factory=StructureParams)


# settings of different sections of which the first may not be above the second, and what to do then
BOUNDS = (
    ("cut.kerf_outline", "sheet.spacing", "the panels lie too close together for the cutter; make the spacing larger"),
    ("cut.mill", "sheet.spacing", "the panels lie too close together for the mill; make the spacing larger"),
    ("cut.kerf_outline", "spiral.slot_min", "the cutter leaves no such slot; make the smallest slot at least as wide"),
    ("cut.kerf_holes", "spiral.slot_min", "the cutter leaves no such slot; make the smallest slot at least as wide"),
    ("cut.mill", "spiral.slot_min", "the mill does not fit into such a slot; make the smallest slot at least as wide"),
)


def refuse_crossed(blocks: Mapping[str, Params], sections: Collection[str]) -> None:
    """Raise ``FlexMapsError`` where settings of two of these blocks cross, if one of them is of the ``sections``."""
    for low, high, remedy in BOUNDS:
        (block, name), (other, limit) = low.split("."), high.split(".")
        if {block, other} <= blocks.keys() and not {block, other}.isdisjoint(sections):
            _refuse_above(blocks[block], name, blocks[other], limit, remedy)


@dataclass(frozen=True)
class RemeshParams(Params):
    """Making quads out of any mesh in Blender, and the size at which the piece is made."""

    quads: int = setting(1500, "Quads", "About how many quads the new mesh has", low=50, high=100_000)
    smooth: bool = setting(True, "Smooth normals", "Follow the smooth shape rather than every small dent")
    edge: float = setting(
        0.02, "Quad edge", "Median edge length of the quads when the piece is cut", low=0.001, high=1.0, unit="m"
    )


@dataclass(frozen=True)
class ExploreParams(Params):
    """What the sidebar varies when it tries many candidates, and what they shall hold."""

    candidates: int = setting(32, "Candidates", "How many are tried at most", low=1, high=10_000)
    ratio: float = setting(
        1.5,
        "Up to times",
        "Numbers are varied from their present value divided by this to that times this",
        low=1.01,
        high=10.0,
    )
    vary_size: bool = setting(True, "Vary size", "Try the piece smaller and larger")
    vary_thickness: bool = setting(True, "Vary thickness", "Try other thicknesses of the sheet")
    vary_widths: bool = setting(False, "Vary width", "Try another largest width of the arms")
    vary_twist: bool = setting(False, "Vary twist", "Try another largest twist of the spirals")
    vary_material: bool = setting(False, "Vary material", "Try every material of the list")
    vary_arms: bool = setting(False, "Vary arms", "Try arms all alike, in pairs and each its own")
    vary_panels: bool = setting(
        False, "Vary panels", "Try fewer and larger, and more and smaller panels, by another distortion limit"
    )
    largest: float = setting(
        1.0,
        "Distance (%)",
        "RMS distance from the target that is wanted at most, in percent of its size",
        low=0.001,
        high=100.0,
    )
    sheets: int = setting(0, "Most sheets", "How many sheets there are; 0 for as many as are needed", low=0, high=1000)


@dataclass(frozen=True)
class ExportParams(Params):
    """Which files are written, and where."""

    folder: str = setting(
        "//flexmaps", "Folder", "Where the files go; // is the folder of the .blend file", folder=True
    )
    svg: bool = setting(True, "SVG", "Write the sheets as SVG, with a layer and a colour per operation")
    dxf: str = setting(
        "R2010",
        "DXF",
        "Write the sheets as DXF",
        choices=(
            ("NONE", "None", "No DXF file"),
            ("R2010", "R2010", "For current programs"),
            ("R12", "R12", "For old programs and machines"),
            ("BOTH", "Both", "R2010 and R12"),
        ),
    )
    pdf: bool = setting(True, "PDF", "Write the sheets as PDF at true size, a page per sheet")
    solids: str = setting(
        "NONE",
        "Solids",
        "Write the panels as solids for 3D printing, as thick as the sheet",
        choices=(
            ("NONE", "None", "No solids"),
            ("3MF", "3MF", "Knows its units and keeps the panels apart"),
            ("STL", "STL", "For old programs"),
            ("BOTH", "Both", "3MF and STL"),
        ),
    )
    copies: int = setting(
        1, "Copies", "How often this piece is made, where several are exported on common sheets", low=1, high=1000
    )
    guide: bool = setting(True, "Assembly sheet", "Write a PDF that shows how to put the panels together, step by step")


@dataclass(frozen=True)
class LoadParams(Params):
    """What holds an object in Blender and what pulls at it; both are chosen by vertex groups."""

    supports: str = setting(
        "", "Supports", "Vertex group that is held: every quad with two corners or more in it; empty: nothing is held"
    )
    pulled: str = setting("", "Pulled", "Vertex group that a force pulls at: every quad with two corners or more in it")
    force_x: float = setting(0.0, "Force X (N)", "Along the world's x, shared by the pulled quads")
    force_y: float = setting(0.0, "Force Y (N)", "Along the world's y, shared by the pulled quads")
    force_z: float = setting(0.0, "Force Z (N)", "Along the world's z, shared by the pulled quads")

    @property
    def force(self) -> tuple[float, float, float]:
        """Newtons in world axes."""
        return self.force_x, self.force_y, self.force_z


@dataclass(frozen=True)
class PreviewParams(Params):
    """The assembled piece with its true spirals, to look at."""

    detail: str = setting(
        "MEDIUM",
        "Detail",
        "How finely the spirals are drawn",
        choices=(
            ("LINES", "Lines", "Wires along the arms; the lightest"),
            ("COARSE", "Coarse", "True arms and hubs in few pieces; for thousands of spirals"),
            ("MEDIUM", "Medium", "True arms and hubs; smooth from afar"),
            ("FINE", "Fine", "True arms and hubs with their inner corners; for close-ups"),
        ),
    )
    colour: str = setting(
        "PATCH",
        "Colour",
        "What the colours of the spirals tell",
        choices=(
            ("PATCH", "Patches", "One colour per patch"),
            ("STRAIN_ENERGY", "Energy", "Elastic energy in every spiral"),
            ("SAFETY", "Safety", "Largest strain in every spiral, against what the material bears"),
            ("DISTANCE", "Distance", "How far every spiral is from the target"),
            ("MATERIAL", "Material", "The look of the chosen material"),
        ),
    )
    joined: bool = setting(
        False,
        "With connectors",
        "Draw the connectors along the seams in their true shape, in the animation and in pictures too; takes longer",
    )
    place: str = setting(
        "BESIDE",
        "Place",
        "Where the assembled piece is shown",
        choices=(
            ("BESIDE", "Beside", "To the left of the model"),
            ("ON", "On the model", "Where the model is, to compare both; hide the model to see all of it"),
        ),
    )


@dataclass(frozen=True)
class RenderParams(Params):
    """A picture of the target, the assembled piece and its flat panels."""

    finish: str = setting(
        "PATCH",
        "Finish",
        "What the pieces look like",
        choices=(
            ("PATCH", "Patches", "One colour per patch, so that panels and piece can be compared"),
            ("SHEET", "The sheet's material", "The material that is chosen for the sheet"),
            ("pom", "Delrin", "White, a little translucent"),
            ("birch", "Birch plywood", "Light wood, its grain along the panels"),
            ("acrylic", "Acrylic", "Clear red"),
            ("pla", "PLA, printed", "Blue, with fine strands"),
            ("DISTANCE", "Distance", "How far every spiral is from the target"),
            ("STRAIN_ENERGY", "Energy", "Elastic energy in every spiral"),
            ("SAFETY", "Safety", "Largest strain in every spiral, against what the material bears"),
        ),
    )
    target: bool = setting(True, "Target", "Show the surface that is to be made")
    assembled: bool = setting(True, "Assembled", "Show the assembled piece with its true spirals")
    panels: bool = setting(True, "Panels", "Show the flat panels")
    azimuth: float = setting(
        math.radians(25.0),
        "View from",
        "Where the camera stands: 0 is in front, a positive angle to the right",
        low=-2 * math.pi,
        high=2 * math.pi,
        unit="rad",
    )
    elevation: float = setting(
        math.radians(32.0),
        "View from above",
        "How steeply the camera looks down",
        low=0.0,
        high=math.pi / 2,
        unit="rad",
    )
    pixels_x: int = setting(1920, "Width", "Pixels across", low=16, high=16384)
    pixels_y: int = setting(0, "Height", "Pixels down; 0: as many as the pieces need", low=0, high=16384)
    samples: int = setting(24, "Samples", "Rays per pixel: more are smoother and slower", low=1, high=4096)
    film: bool = setting(
        False,
        "Animation",
        "Render the frames of the assembly's animation instead: PNG files, or a film if the file ends in .mp4",
    )
    file: str = setting("//flexmaps-render.png", "File", "Where the picture goes; // is the folder of the .blend file")


@dataclass(frozen=True)
class FilmParams(Params):
    """The assembly as an animation."""

    seconds: float = setting(12.0, "Seconds", "How long the animation is", low=1.0, high=600.0)
    film_detail: str = setting(
        "COARSE",
        "Detail",
        "How finely the spirals are drawn in the animation",
        choices=(
            ("COARSE", "Coarse", "Plays smoothly, also with thousands of spirals"),
            ("MEDIUM", "Medium", "Smooth from afar"),
            ("FINE", "Fine", "For close-ups"),
        ),
    )


@dataclass(frozen=True)
class PageParams(Params):
    """The report's page."""

    viewer: bool = setting(
        True,
        "3D view",
        "Hold the piece in 3D on the report's page, and write share.html, the piece alone to send to somebody",
    )
    coming: str = setting(
        "RESTING",
        "Assembly",
        "How the panels come together in the 3D view",
        choices=(
            (
                "RESTING",
                "Simulated",
                "Through the shapes in which half-finished pieces rest, as in the animation; takes longer",
            ),
            ("AT_ONCE", "Quick", "Every panel takes its final shape as it comes"),
        ),
    )


@dataclass(frozen=True)
class ObjectSettings(Settings):
    """All settings that an object in Blender carries with it."""

    loads: LoadParams = field(default_factory=LoadParams)
    remesh: RemeshParams = field(default_factory=RemeshParams)
    explore: ExploreParams = field(default_factory=ExploreParams)
    export: ExportParams = field(default_factory=ExportParams)
    preview: PreviewParams = field(default_factory=PreviewParams)
    film: FilmParams = field(default_factory=FilmParams)
    render: RenderParams = field(default_factory=RenderParams)
    page: PageParams = field(default_factory=PageParams)


S = TypeVar("S", bound=Settings)


def changed(settings: S, values: Mapping[str, Any]) -> S:
    """The settings with other values, given by "section.name" in the units that people are shown: millimetres, degrees.

    Values may be texts, as they come from a command line. Raises ``FlexMapsError`` for what is no setting, or is out of bounds.
    """
    blocks: dict[str, dict[str, Any]] = {}
    for key, value in values.items():
        section, _, name = key.partition(".")
        block = getattr(settings, section, None)
        if not isinstance(block, Params):
            names = ", ".join(f.name for f in fields(settings))
            raise FlexMapsError(
                f"There is no setting {_quoted(key)}; give it as section.name, with one of the sections {names}"
            )
        known = {f.name: f for f in fields(block)}  # type: ignore[arg-type]
        if name in block.WERE:
            instead = {} if _switched(name, value) else block.WERE[name]
            blocks.setdefault(section, {}).update(instead)
            continue
        if name not in known:
            raise FlexMapsError(f"There is no setting {_quoted(key)}; the settings of {section} are {', '.join(known)}")
        blocks.setdefault(section, {})[name] = _from_shown(known[name], value)
    made = {section: _replaced(section, getattr(settings, section), given) for section, given in blocks.items()}
    return replace(settings, **made)


def wish(*, goal: str | None = None, panels: Any = None, match: Any = None) -> dict[str, Any]:
    """The settings that a layout be chosen by, as ``changed`` takes them: who names a number means that goal."""
    named = goal or ("panels" if panels is not None else "match" if match is not None else None)
    values = {"choose.goal": named, "choose.panels": panels, "choose.match": match}
    return {name: value for name, value in values.items() if value is not None}


def _replaced(section: str, block: Any, given: dict[str, Any]) -> Any:
    try:
        return replace(block, **given)
    except FlexMapsError as error:
        raise FlexMapsError(f"In the settings of {section}: {error}") from None


def shown_values(settings: Settings) -> dict[str, dict[str, Any]]:
    """Every setting in the units that people are shown, by section and name: what ``changed`` takes."""
    return {
        block.name: {
            f.name: _as_shown(f, getattr(getattr(settings, block.name), f.name))
            for f in fields(getattr(settings, block.name))
        }
        for block in fields(settings)
    }


def _as_shown(f: Field, value: Any) -> Any:
    return float(f"{value * SHOWN[f.metadata['unit']][0]:.9g}") if isinstance(value, float) else value


SWITCHES = {"true": True, "yes": True, "on": True, "1": True, "false": False, "no": False, "off": False, "0": False}


def _switched(label: str, value: Any) -> bool:
    """On or off from what a person gives."""
    if not isinstance(value, bool | str | Integral) or str(value).lower() not in SWITCHES:
        raise FlexMapsError(f"{label} {_quoted(value)}: give on or off")
    return SWITCHES[str(value).lower()]


def _from_shown(f: Field, value: Any) -> Any:
    """The value of a field from one that a person gives, perhaps as text."""
    default, label = f.default, f.metadata["label"]
    if isinstance(default, str):
        return str(value) if isinstance(value, PathLike) else value
    if isinstance(default, bool):
        return _switched(label, value)
    number = value
    # Python would take other digits and groups of them too
    if isinstance(value, str) and value.isascii() and "_" not in value:
        try:
            number = float(value)
        except ValueError:
            number = None
    if not _is_number(number):
        raise FlexMapsError(f"{label} {_quoted(value)}: give {wanted(f)}")
    if not isinstance(default, int):
        return float(number) / SHOWN[f.metadata["unit"]][0]
    if number != int(number):
        raise FlexMapsError(f"{label} {_quoted(value)}: give {wanted(f)}")
    return int(number)
