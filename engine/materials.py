"""Materials of sheets: stiffness, density and strain limit, each with its source.

The values are typical, good enough to choose widths and twists. A batch may differ from them by a tenth or more,
especially wooden boards: test a strip.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from .errors import FlexMapsError

# Ratio of the strain limit to the largest allowed strain, a safety factor: computed strains are accurate to about 15 %
# (see ``peak_strain``). Larger: safer pieces, fewer surfaces can be made
STRAIN_MARGIN = 1.1
# Share of the strain limit above which arms are reported as overstrained: 0.5 % above the allowed strain. Optimised
# pieces reach the allowed strain, and repairs of their outlines change strains by less than 0.5 %
OVERSTRAIN_SHARE = 1.005 / STRAIN_MARGIN
# Utilisation of a neck above which its connector is reported as overloaded: 1, and a little more for rounding errors
OVERLOADED = 1.0005
# Strain concentration: ratio of the strain at the fillet of an arm's root to the largest strain of the arm beside it.
# Matters for materials that break before they yield. Larger: safer pieces, fewer can be made (docs/tuning.md)
FILLET_STRAIN = 1.65


@dataclass(frozen=True)
class LongTermProperties:
    """Properties of a material after a year under load at room temperature.

    share : creep modulus after a year over Young's modulus
    strain : largest total strain to design for, elastic and creep
    source : where the values come from
    estimated : names of the fields without a public source, whose values are guesses between other materials
    """

    share: float
    strain: float
    source: str
    estimated: tuple[str, ...] = ()


@dataclass(frozen=True)
class Orthotropy:
    """Orthotropic stiffness of a sheet with a grain, homogenised through its thickness.

    Axes: 1 along the grain, 2 across it in the plane of the sheet, 3 through the thickness.

    along, across : Pa, Young's moduli of axes 1 and 2
    poisson : contraction along axis 2 over stretch along axis 1
    shear : Pa, modulus in the plane of the sheet (12)
    shear_along, shear_across : Pa, transverse shear moduli (13 and 23)
    strength : Pa, along the grain, across it, and in shear in the plane; None if the strain limit is the same in all
        directions
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
    """A sheet material, in SI units.

    youngs : Pa, in bending or tension
    poisson : Poisson's ratio
    density : kg/m3
    strain_limit : largest strain to design for, from tensile tests: at yield for plastics that yield, else at break
    breaks : True if the limit is at break, False if it is at yield
    source : where the values come from
    note : remarks for the user on what the values do not cover
    lasting : properties after a year under load; None if unknown
    orthotropy : of sheets with a grain; ``youngs`` and ``poisson`` are then isotropic equivalents
    for_years : whether ``strain_limit`` holds for years of load, not only for days
    """

    name: str
    youngs: float
    poisson: float
    density: float
    strain_limit: float
    breaks: bool
    source: str
    note: str = ""
    lasting: LongTermProperties | None = None
    orthotropy: Orthotropy | None = None
    for_years: bool = False

    def lasts(self, years: bool) -> Material:
        """Return the material with its strain limit for years of load, or for days if not ``years`` or if unknown."""
        if self.lasting is None:
            return self
        if not years:
            return replace(self, lasting=None)
        share, grain = self.lasting.strain / self.strain_limit, self.orthotropy
        if grain is not None and grain.strength is not None:
            along, across, shear = (share * one for one in grain.strength)
            grain = replace(grain, strength=(along, across, shear))
        return replace(self, strain_limit=self.lasting.strain, orthotropy=grain, for_years=True)

    @property
    def bears(self) -> str:
        """Name of the strain limit in messages to users, as in "80 % of what the material bears"."""
        return "what the material bears for years" if self.for_years else "what the material bears"

    @property
    def safe_strain(self) -> float:
        """Largest computed strain that is safe, given the accuracy of computed strains."""
        return self.strain_limit / STRAIN_MARGIN

    @property
    def strength(self) -> float:
        """Stress at the strain limit, Pa."""
        return self.youngs * self.strain_limit


# all materials by key, SI units
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
        LongTermProperties(
            0.37,
            0.02,
            "ISO 899-1 creep moduli at 1 and 1000 h: Hostaform C 9021 2500 and 1300 MPa (modulus 2850), C 27021 2400 and 1200 (2750), "
            "Delrin 500T 2300 and 1200 (2300); a factor of 0.80 each tenfold time goes on to 8760 h: 0.35 to 0.42. No data sheet that was "
            "read gives a strain limit for years: a quarter of the one for short times, a guess",
            ("strain",),
        ),
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
        LongTermProperties(
            0.5,
            0.0064,
            "Plexiglas G, stresses that are to be designed for under continuous load, against crazing: 1500 psi (10.3 MPa). The share of the "
            "modulus is usual for PMMA at 20 degrees, uncertain by a quarter; the strain is that stress over what is left of the modulus",
            ("share", "strain"),
        ),
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
        LongTermProperties(
            0.4,
            0.005,
            "Fischbach and Weinberg 2023 (arXiv 2302.11240): printed PLA creeps for months far below its glass transition, less the older it is. "
            "Both numbers are guesses between POM and acrylic",
            ("share", "strain"),
        ),
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
        LongTermProperties(
            0.4,
            0.0075,
            "Romeijn et al. 2022 (Additive Manufacturing 103145) and Polymers 17 (2025) 2075 measured creep of printed PETG for hours. Both "
            "numbers are guesses between POM and acrylic",
            ("share", "strain"),
        ),
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
        LongTermProperties(
            1.0 / 1.8,
            0.004,
            "EN 1995-1-1, plywood of EN 636 part 1 in service class 1: k_def 0.80 (table 3.2, of decades rather than of a year, so on the safe side), k_mod 0.60 under "
            "permanent load (table 3.1). The strain is k_mod (1 + k_def) of the limit, at most the limit itself",
        ),
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
        LongTermProperties(
            1.0 / 3.25,
            0.00325,
            "EN 1995-1-1, MDF.LA of EN 622-5 in service class 1: k_def 2.25 (table 3.2, of decades), k_mod 0.20 under permanent load (table 3.1). The strain is "
            "k_mod (1 + k_def) of the limit",
        ),
    ),
}


def find_material(name: str) -> Material:
    """Return the material with a key. Raises ``FlexMapsError``, which lists all keys, if there is none."""
    try:
        return MATERIALS[name]
    except KeyError:
        raise FlexMapsError(f"'{name}' is not a material; choose one of {', '.join(MATERIALS)}") from None
