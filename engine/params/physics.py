"""Settings of the material, of the simulation, of the search for a design, and of the loads."""

from __future__ import annotations

from dataclasses import dataclass

from ..materials import MATERIALS, LongTermProperties, Material, Orthotropy, find_material
from .fields import Params, setting


@dataclass(frozen=True)
class MaterialParams(Params):
    """Material of the sheet."""

    material: str = setting(
        "pom",
        "Material",
        "Material of the sheet: stiffness, weight and the strain it bears",
        choices=(
            *((key, m.name, m.source) for key, m in MATERIALS.items()),
            ("custom", "Custom", "The values below"),
        ),
    )
    youngs: float = setting(
        2.6e9,
        "Young's modulus",
        "How hard a custom material is to stretch and bend; it decides how far weight and forces deform the piece, and does not change its shape without them",
        low=1e6,
        high=1e12,
        unit="Pa",
    )
    poisson: float = setting(
        0.3,
        "Poisson's ratio",
        "How much narrower a custom material becomes as it is stretched, as a share of the stretch; most plastics 0.35 to 0.4",
        low=0.01,
        high=0.44,
    )
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
        "Shear modulus of a custom material with a grain, in the plane of the sheet; 0 takes the same share of Young's modulus as in plywood",
        low=0.0,
        high=1e12,
        unit="Pa",
    )
    density: float = setting(
        1185.0, "Density", "Density of a custom material, in kg per cubic metre", low=1.0, high=3e4
    )
    strain_limit: float = setting(
        0.02,
        "Strain limit",
        "Largest strain that a bar of a custom material bears in tension, as a share of its length",
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

    lasts: str = setting(
        "days",
        "Lasts",
        "Time that the piece has to last; it sets the strain that arms may reach, in all stages",
        choices=(
            ("days", "For days", "Up to what the material bears for a short time, as the published pieces were made"),
            ("years", "For years", "Up to what the material bears for years, where that is known; its source stands with the material"),
        ),
    )  # fmt: skip

    @property
    def chosen(self) -> Material:
        """The material with its strain limit for the time that the piece must last."""
        return self.sheet.lasts(self.lasts == "years")

    @property
    def sheet(self) -> Material:
        """The material with its properties for days and, if known, for years under load."""
        if self.material != "custom":
            return find_material(self.material)
        given = "given by the user"
        lasting = LongTermProperties(self.lasting_share, self.lasting_strain, given) if self.lasting_share else None
        rest = (self.poisson, self.density, self.strain_limit, True, given)
        if not self.across:
            return Material("Custom", self.youngs, *rest, lasting=lasting)
        # moduli that the user leaves out have the same ratios to the modulus along the grain as in birch plywood
        usual = MATERIALS["birch"].orthotropy
        assert usual is not None
        shear = self.shear or self.youngs * usual.shear / usual.along
        poisson = self.poisson * min(1.0, self.youngs / self.across)
        flat, steep = (shear * one / usual.shear for one in (usual.shear_along, usual.shear_across))
        known = Orthotropy(self.youngs, self.across, poisson, shear, flat, steep)
        return Material("Custom", 0.5 * (self.youngs + self.across), *rest, lasting=lasting, orthotropy=known)


@dataclass(frozen=True)
class SimulateParams(Params):
    """Simulation of the shape that the assembled piece takes (FlexMaps section 6.1)."""

    model: str = setting(
        "arm",
        "Elastic model",
        "Model of how the arms of the spirals deform",
        choices=(
            ("arm", "Arms", "The full stiffness of every arm, from volumetric finite elements"),
            ("rod", "Rods", "Four stiffnesses a spiral, as published; kept for comparison"),
        ),
    )
    gravity: bool = setting(False, "Gravity", "Let the weight of the sheet act, downwards along z; needs supports")
    clamped: bool = setting(True, "Clamp supports", "Supported spirals keep their direction too, not only their place")
    # most pieces take 5 to 60 iterations, a ribbon that unrolls by several turns 300 (docs/tuning.md)
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
    """Search for the spirals whose assembly takes the target's shape (FlexMaps section 7)."""

    WERE = {"laplacian": {"lies": 1.0}}
    GONE = ("method",)

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
    # smaller: worse match of position; larger: worse match of curvature (docs/tuning.md)
    lies: float = setting(
        0.35,
        "Match curvature / position",
        "What is compared with the target: 0 compares curvature, which keeps small features, 1 compares position; values in between compare both",
        low=0.0,
        high=1.0,
    )
    # larger: dragged spirals come nearer to their drag targets, other spirals less near to the surface (docs/tuning.md)
    urge: float = setting(
        1.0,
        "Weight of drag targets",
        "Weight of the places to which you dragged spirals, relative to the target's shape; 0 ignores them",
        low=0.0,
        high=100.0,
    )
    smoothness: float = setting(
        0.0,
        "Smoothness",
        "Makes neighbouring spirals more alike the larger it is, at the cost of the match; 0 lets each differ",
        low=0.0,
        high=1.0,
    )
    strain_share: float = setting(
        1.0,
        "Strain limit",
        "Largest strain on the arms' surface, as a share of what the material bears less a margin of a tenth; 0 sets no limit",
        low=0.0,
        high=10.0,
    )
    open_slots: bool = setting(
        True, "Keep slots open", "Keep the slots between the arms open in the assembled shape, where arms would touch"
    )
    iterations: int = setting(
        60, "Steps", "Most steps of the search: fewer end it sooner and farther from the target", low=1, high=1000
    )
    restart: bool = setting(
        True,
        "Try other starts",
        "Start from the present spirals, curvature-adjusted or uniform ones, whichever is nearest to the target; else only from the present ones",
    )
    codesign: bool = setting(
        True,
        "Flat shapes too",
        "Also move the vertices of the flat panels a little where that lowers the mismatch: nearer to the target, but two to four times slower. With the elastic model Arms only",
    )
    distortion_limit: float = setting(
        0.035,
        "Flat distortion",
        "Largest distortion (ARAP energy) that the flat shape of a quad may get: more lets the search move it farther",
        low=0.001,
        high=1.0,
    )
    patience: float = setting(
        1.0,
        "Patience",
        "Time limit of the search: with 1 about 50 s for 1,500 quads and 3 min for 6,000; most searches stop earlier, within 0.1 % of the size from the target or once further steps gain too little. 2 doubles both times and halves that distance, 0.5 quarters the times, 0 sets no limit",
        low=0.0,
        high=1000.0,
    )
    stop: float = setting(
        1e-3,
        "Stop at",
        "Smallest gain of a step, as a share: two steps in a row that gain less end a run of steps. While flat shapes move, runs end sooner, below gains of up to 10 %. A larger share ends sooner and farther from the target. Patience may end the search before",
        low=0.0,
        high=0.5,
    )


@dataclass(frozen=True)
class LoadParams(Params):
    """Supports of an object in Blender and a force on it; vertex groups choose the quads."""

    supports: str = setting(
        "", "Supports", "Vertex group that is held: every quad with two corners or more in it; empty: nothing is held"
    )
    pulled: str = setting("", "Pulled", "Vertex group that a force pulls at: every quad with two corners or more in it")
    force_x: float = setting(0.0, "Force X (N)", "Along the world's x, shared by the pulled quads")
    force_y: float = setting(0.0, "Force Y (N)", "Along the world's y, shared by the pulled quads")
    force_z: float = setting(0.0, "Force Z (N)", "Along the world's z, shared by the pulled quads")

    @property
    def force(self) -> tuple[float, float, float]:
        """Force along the world's x, y and z, newtons."""
        return self.force_x, self.force_y, self.force_z
