"""Settings of the machine, the sheets, the base, the cost and the files."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import FlexMapsError
from .fields import Params, setting


@dataclass(frozen=True)
class CutParams(Params):
    """The machine that cuts the sheet; paths in the files run half of the kerf outside the material."""

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
        "Width that the cutter takes away inside holes, where it differs from the outlines",
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
    nozzle: float = setting(
        0.0,
        "Nozzle",
        "Width of a 3D printer's nozzle, 0 for other machines: no arm may be narrower, and those under two lines are named",
        low=0.0,
        high=0.01,
        unit="m",
    )
    line_width: float = setting(
        0.0254 / 1e3,  # 0.001 inch; written like this, it equals exactly a user's 0.0254 mm after conversion
        "Line width",
        "Width of the lines in SVG and PDF: drivers that cut by width take 0.0254 mm; where colours decide, 0.1 mm shows better",
        low=0.000001,
        high=0.002,
        unit="m",
    )
    svg_unit: str = setting(
        "mm",
        "Unit of SVG",
        "Unit of the sheets in SVG",
        choices=(
            ("mm", "Millimetres", "Most common for laser cutters"),
            ("in", "Inches", "Used by programs with imperial units"),
        ),
    )
    lead_in: float = setting(
        0.0,
        "Lead-in",
        "Distance beside its path at which every cut begins, in the waste, where there is room; 0 for none",
        low=0.0,
        high=0.02,
        unit="m",
    )
    tabs: int = setting(
        0, "Holding tabs", "Number of bridges that hold every panel in its sheet until you break them", low=0, high=50
    )
    tab_width: float = setting(
        0.001,
        "Tab width",
        "Width of a holding tab, the kerf not counted: wider ones hold better and leave more to file off",
        low=0.0001,
        high=0.02,
        unit="m",
    )


@dataclass(frozen=True)
class SheetParams(Params):
    """The sheets to cut, and how panels are placed on them."""

    sheet_width: float = setting(
        0.6,
        "Sheet width",
        "Width of the sheets that you cut from, at most that of the machine's bed; larger panels are divided, see Too large panels",
        low=0.01,
        high=10.0,
        unit="m",
    )
    sheet_height: float = setting(
        0.4,
        "Sheet height",
        "Height of the sheets that you cut from, at most that of the machine's bed; larger panels are divided, see Too large panels",
        low=0.01,
        high=10.0,
        unit="m",
    )
    margin: float = setting(
        0.005,
        "Margin",
        "Border of the sheet in which nothing is cut: room for clamps and crooked edges; more leaves less room for panels",
        low=0.0,
        high=0.5,
        unit="m",
    )
    spacing: float = setting(
        0.003,
        "Spacing",
        "Free distance between panels on the sheet: more keeps thin waste from burning or breaking, and takes more sheet",
        low=0.0,
        high=0.1,
        unit="m",
    )
    tolerance: float = setting(
        0.00001,
        "Curve tolerance",
        "Largest distance of the arcs from the true outline: smaller gives smoother outlines and larger files",
        low=1e-6,
        high=0.001,
        unit="m",
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
            ("split", "Cut", "Cut the panel along a new seam when panels are merged, until every piece fits"),
            ("enlarge", "Larger sheet", "Give it a sheet as large as it needs, with a warning"),
            ("error", "Stop", "Stop and name the panel"),
        ),
    )  # fmt: skip
    many_sheets: bool = setting(
        False,
        "Many sheets",
        "Continue if panels that almost fill a sheet each take far more sheets than their area needs",
    )
    rotation: str = setting(
        "FREE", "Rotation", "Rotations allowed for panels on the sheet",
        choices=(
            ("FREE", "Any", "Any angle"),
            ("QUARTER", "Quarter turns", "Every panel's longer side along or across the sheet"),
            ("GRAIN", "Along the grain", "The grain of every panel along the sheet's width: its longer side, or as Grain says"),
        ),
    )  # fmt: skip
    nesting: str = setting(
        "TRUE", "Nesting", "Method of laying the panels on sheets",
        choices=(
            ("TRUE", "Tight", "Search for the fewest sheets and the largest rest of the last one, as long as the time limit allows"),
            ("FAST", "Quick", "Quarter turns only, without a search"),
        ),
    )  # fmt: skip
    # larger: sometimes fewer or better filled sheets, slower (docs/tuning.md)
    nesting_seconds: float = setting(
        3.0,
        "Nesting seconds",
        "Longest time that the tight nesting may take: more often leaves a larger piece of the last sheet",
        low=0.0,
        high=86400.0,
    )
    remnants: str = setting(
        "",
        "Remnants",
        "DXF or SVG drawings of odd pieces of sheet, with ; between them: they are filled first, each once. Along their width runs the grain",
    )
    remnant_unit: str = setting(
        "mm",
        "Unit of drawings",
        "Unit of lengths in drawings of remnants that name none",
        choices=(
            ("mm", "Millimetres", "Most common for laser cutters"),
            ("cm", "Centimetres", "Used by some drawing programs"),
            ("m", "Metres", "Used by programs for architecture"),
            ("in", "Inches", "Used by programs with imperial units"),
            ("pt", "Points", "1/72 inch"),
            ("px", "Pixels", "1/96 inch, as browsers read SVG"),
        ),
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
    """Base on which a supported piece stands, or by which it hangs."""

    base: str = setting(
        "none",
        "Base",
        "Base of the supported spirals; choose it before the spirals are made",
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
        """Whether the base consists of feet and plates, not of eyelets."""
        return self.base not in ("none", "eyelets")


@dataclass(frozen=True)
class CostParams(Params):
    """Prices of sheets, machine time and labour, in any currency; 0 leaves a cost out."""

    sheet_price: float = setting(0.0, "Price of a sheet", "Price of one sheet of the material", low=0.0, high=1e6)
    machine_rate: float = setting(
        0.0,
        "Machine, an hour",
        "Price of an hour of the laser; not counted for materials that a laser cannot cut",
        low=0.0,
        high=1e6,
    )
    labour_rate: float = setting(
        0.0, "Assembly, an hour", "Price of an hour of putting the panels together", low=0.0, high=1e6
    )


@dataclass(frozen=True)
class ExportParams(Params):
    """Files to write, and their folder."""

    folder: str = setting(
        "//flexmaps", "Folder", "Folder of the files; // is the folder of the .blend file", folder=True
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
        1,
        "Copies",
        "Number of copies of this piece, when several pieces are exported on common sheets",
        low=1,
        high=1000,
    )
    guide: bool = setting(True, "Assembly sheet", "Write a PDF that shows how to put the panels together, step by step")
