"""Materials that sheets are cut from: stiffness, density and the strain they bear, each with its source.

Values are typical ones for choosing widths and twists; a maker's own batch may differ by a tenth or more, so test a strip.
The sources say where such values are published. Boards of wood differ most from one maker to the next.
"""

from __future__ import annotations

from dataclasses import dataclass

from .errors import FlexMapsError


@dataclass(frozen=True)
class Orthotropy:
    """How stiff a sheet is along its grain (1), across it in the sheet (2), and in shear, as if it were one homogeneous body, SI.

    along, across : Pa, Young's moduli; poisson : contraction across per stretch along
    shear : Pa, in the sheet (12); shear_along, shear_across : Pa, of planes parallel to the sheet (13 and 23)
    strength : Pa, along, across, and in shear in the sheet; None where the material's strain limit holds in every direction
    """

    along: float
    across: float
    poisson: float
    shear: float
    shear_along: float
    shear_across: float
    strength: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Material:
    """One sheet material, SI.

    youngs : Pa, in bending or tension; poisson : Poisson's ratio; density : kg / m^3
    strain_limit : largest strain to design for: yield for plastics that yield, else break
    breaks : True where the limit is a break without warning, False where it is yield
    source : where the values come from; note : what they leave out
    orthotropy : of sheets with a grain; ``youngs`` and ``poisson`` are then what a sheet without one would have
    """

    name: str
    youngs: float
    poisson: float
    density: float
    strain_limit: float
    breaks: bool
    source: str
    note: str = ""
    orthotropy: Orthotropy | None = None


# SI units, each with its source
MATERIALS: dict[str, Material] = {
    "pom": Material(
        "Delrin (POM)",
        3.1e9,
        0.37,
        1420.0,
        0.08,
        False,
        "DuPont Delrin 500P data sheet, ISO 527 and ISO 1183: modulus 3100 MPa, yield strain 17 %, 1420 kg/m3",
        "Poisson's ratio as is usual for POM. Creeps under lasting load, so half the yield strain is the limit.",
    ),
    "vero": Material(
        "VeroWhite",
        2.6e9,
        0.3,
        1185.0,
        0.02,
        True,
        "FlexMaps section 6.2 for stiffness and density; Stratasys Vero data sheet: strength 50-65 MPa",
        "The strain limit is strength over modulus; softens with warmth and age.",
    ),
    "acrylic": Material(
        "Acrylic, cast (PMMA)",
        3.2e9,
        0.37,
        1190.0,
        0.02,
        True,
        "Evonik Plexiglas GS data sheet, ISO 527: modulus 3300 MPa, strength 80 MPa, break 5.5 %; other cast sheets "
        "2800-3200 MPa, 67-75 MPa, 4-6 %",
        "Laser-cut edges carry stress cracks: the limit is well under the break.",
    ),
    "pla": Material(
        "PLA, printed",
        3.1e9,
        0.36,
        1240.0,
        0.015,
        True,
        "Farah, Anderson and Langer 2016, Adv. Drug Deliv. Rev. 107: modulus 3-3.5 GPa, Poisson 0.36, break 3-6 %",
        "Along the printed strands; less across layers.",
    ),
    "petg": Material(
        "PETG, printed",
        2.0e9,
        0.38,
        1270.0,
        0.03,
        False,
        "Prusament PETG data sheet: modulus 1.5-2.1 GPa; yield near 5 %; other printed bars 2-3 GPa, 1250-1290 kg/m3",
        "Along the printed strands; less across layers.",
    ),
    "birch": Material(
        "Birch plywood",
        8.7e9,
        0.3,
        680.0,
        0.004,
        True,
        "Handbook of Finnish Plywood (Finnish Forest Industries 2007), birch, 6.5 mm, five plies: mean modulus in bending "
        "12.7 GPa along the face grain and 4.8 GPa across it, characteristic strength 51 and 29 MPa, panel shear "
        "620 MPa and 9.5 MPa, mean density 680 kg/m3. Through the sheet: plies of yellow birch (Wood Handbook, Forest Products "
        "Laboratory 2010, tables 5-1 and 5-2), one over the other",
        "Young's modulus is the mean of both directions. Three plies (4 mm) differ by 16, not by 2.7: test a strip along and "
        "across, and give your own values.",
        Orthotropy(12.7e9, 4.8e9, 0.08, 0.62e9, 0.5e9, 0.4e9, (51e6, 29e6, 9.5e6)),
    ),
    "mdf": Material(
        "MDF",
        3.0e9,
        0.25,
        750.0,
        0.005,
        True,
        "EN 622-5, thin boards: bending modulus at least 2700 MPa, bending strength at least 23 MPa; GB/T 11718, 1.5-3.5 mm: "
        "2700 and 27 MPa",
        "Effective isotropic value in the sheet; weaker through the thickness. Thin arms swell and break with damp.",
    ),
}


def material(name: str) -> Material:
    """The material of that key; raises FlexMapsError with the keys there are."""
    try:
        return MATERIALS[name]
    except KeyError:
        raise FlexMapsError(f"'{name}' is no material; there are {', '.join(MATERIALS)}") from None
