"""The designs on which the coarse models are compared with full solids: spirals, supports, loads.

All but those with a grain are cut from 2 mm of a material with E = 2.6 GPa and a Poisson's ratio of 0.3, with the program's usual blends and fillets.
Widths are millimetres here, twists degrees, forces newtons.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from ..engine.arrays import Float, Int
from ..engine.errors import FlexMapsError
from ..engine.materials import MATERIALS, Material
from ..engine.optimisation.optimise import optimise
from ..engine.params import LayoutParams, OptimiseParams, SimulateParams, SpiralParams
from ..engine.patches.flattening.flatten import flatten, with_energies
from ..engine.patches.layout import PatchLayout
from ..engine.patches.merging.merge import merge
from ..engine.patches.tracing.trace import trace_layout
from ..engine.spirals.design import SpiralDesign
from ..engine.spirals.fabricable import design_from_curvature
from ..engine.surface import shapes
from ..engine.surface.curvature import rms_curvature
from ..engine.surface.mesh import QuadMesh
from ..engine.surface.shapes import weld_quads
from . import chunks
from .design_mesh import Resolution, make_mesh

DESIGNS = Path(__file__).resolve().parent / "validation"  # of the optimised designs
SIDE = 0.020  # metres, of most quads
# its strain limit plays no part
MATERIAL = Material("Reference", 2.6e9, 0.3, 1185.0, 0.02, True, "FlexMaps section 6.2")
Values = float | np.ndarray  # one for all quads, or one for each; of widths also one for every arm

# a range that holds every design here; blends and fillets are the program's usual ones
PARAMS = SpiralParams(width_min=0.0005, width_max=0.003, twist_max=math.radians(450.0))
USUAL = Resolution()
# where one neighbour's width puts a root far out and the other's does not, a hub is too bent for one element a quarter; and where arms
# are hardly longer than wide, their solids are 1.8 % too stiff with one
WIDE = Resolution(across=2)


@dataclass(frozen=True)
class Held:
    """A hub that is held: shift (m) and turn (rotation vector, rad) from its place at rest.

    ``shift`` None leaves it free to shift, ``turn`` None free to turn.
    """

    spiral: int
    turn: tuple[float, float, float] | None = (0.0, 0.0, 0.0)
    shift: tuple[float, float, float] | None = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Loading:
    """One state of a case: held hubs (none for a free body), dead forces (N) on hubs, and whether the sheet has weight."""

    name: str
    held: tuple[Held, ...] = ()
    forces: tuple[tuple[int, tuple[float, float, float]], ...] = ()
    weight: bool = False


@dataclass(frozen=True, eq=False)
class Case:
    """A design with the states in which it is solved.

    name : of its file; make : the design, whose mesh is the pose at rest that everything starts from
    material : of all arms
    """

    name: str
    make: Callable[[], SpiralDesign]
    loadings: tuple[Loading, ...]
    resolution: Resolution = USUAL
    material: Material = MATERIAL

    @cached_property
    def design(self) -> SpiralDesign:
        return self.make()

    @property
    def mesh(self) -> QuadMesh:
        return self.design.flat.layout.mesh

    def identity(self) -> dict:
        """What the results depend on besides the shape of the design, for their file's header."""
        material = asdict(self.material)
        del material["lasting"], material["for_years"]  # a solid is solved as it is on its first day
        if self.material.orthotropy is None:
            del material["orthotropy"]
        return {
            "loadings": [asdict(one) for one in self.loadings],
            "resolution": asdict(self.resolution),
            "material": material,
            "thickness": PARAMS.thickness,
            "fillet": PARAMS.fillet,
            **({"rim": self.design.params.rim_width} if self.design.params.border == "rim" else {}),
            **({"grain": self.design.params.grain} if self.material.orthotropy else {}),
        }


# -- designs -----------------------------------------------------------------------------------------------------------


def cells(columns: int, rows: int) -> Int[np.ndarray, "quads 2"]:
    """Column and row of every quad of a grid, row after row."""
    return np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)


def grid_mesh(columns: int, rows: int, *, closed: bool = False) -> tuple[Float[np.ndarray, "vertices 2"], np.ndarray]:
    """Column and row of every vertex of a grid, and its quads; ``closed`` leaves out the last column's vertices."""
    wide = columns if closed else columns + 1
    points = cells(wide, rows + 1).astype(float)
    c, r = cells(columns, rows).T
    right = (c + 1) % wide
    return points, np.stack([r * wide + c, r * wide + right, (r + 1) * wide + right, (r + 1) * wide + c], axis=1)


def sheet(
    columns: int,
    rows: int,
    width: Values,
    twist: Values,
    *,
    sides: tuple[float, float] = (SIDE, SIDE),
    angle: float = 90.0,
) -> SpiralDesign:
    """One flat patch of parallelograms with these sides in metres and this angle between them in degrees."""
    points, quads = grid_mesh(columns, rows)
    lean = np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle))])
    flat = points[:, :1] * [sides[0], 0.0] + points[:, 1:] * sides[1] * lean
    mesh = QuadMesh(np.column_stack([flat, np.zeros(len(flat))]), quads)
    layout = PatchLayout(mesh, np.zeros(len(mesh.edges), dtype=bool))
    placed = np.zeros((int(layout.flat_corners.max()) + 1, 2))
    placed[layout.flat_corners] = flat[quads]
    return SpiralDesign(with_energies(layout, placed), PARAMS, *_per_quad(len(quads), width, twist))


def shell(mesh: QuadMesh, cut: np.ndarray, width: Values, twist: Values) -> SpiralDesign:
    """A surface cut at these edges (bool), its patches flattened."""
    flat = flatten(PatchLayout(mesh, cut & ~mesh.border), LayoutParams())
    return SpiralDesign(flat, PARAMS, *_per_quad(len(mesh.quads), width, twist))


def _per_quad(count: int, width: Values, twist: Values) -> tuple[np.ndarray, np.ndarray]:
    """Widths in metres, one an arm, and twists in radians, one a quad, of millimetres and degrees."""
    given = np.asarray(width, dtype=float)
    wide = given[:, None] if given.shape == (count,) else given
    return 1e-3 * np.broadcast_to(wide, (count, 4)), np.radians(np.broadcast_to(np.asarray(twist, dtype=float), count))


def _along(mesh: QuadMesh, inside: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Edges whose both vertices are ``inside``, a function of the vertices (V, 3) in quad sides."""
    chosen = inside(mesh.vertices / SIDE)
    return chosen[mesh.edges].all(axis=1)


def _height(n: int, height: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> QuadMesh:
    """A square sheet of n x n quads of one side over the plane, its middle at the origin; heights in quad sides."""
    points, quads = grid_mesh(n, n)
    x, y = (points - 0.5 * n).T
    return QuadMesh(SIDE * np.column_stack([x, y, height(x, y)]), quads)


def _cross(mesh: QuadMesh) -> np.ndarray:
    """The edges along both middle lines."""
    return _along(mesh, lambda p: np.abs(p[:, 0]) < 1e-6) | _along(mesh, lambda p: np.abs(p[:, 1]) < 1e-6)


def saddle() -> SpiralDesign:
    """Four panels that spring up by themselves."""
    mesh = _height(6, lambda x, y: 0.09 * (x * x - y * y))
    return shell(mesh, _cross(mesh), 1.5, 200.0)


def soft() -> SpiralDesign:
    """A saddle whose softest mode has less than a tenth of its stiffness to spare."""
    mesh = _height(8, lambda x, y: 0.095 * (x * x - y * y))
    return shell(mesh, _cross(mesh), 1.5, 200.0)


def dome() -> SpiralDesign:
    mesh = _height(6, lambda x, y: 0.12 * (18.0 - x * x - y * y))
    return shell(mesh, _cross(mesh), 1.5, 150.0)


def ring(around: int, across: int, width: Values, twist: Values, bulge: float = 0.0, seams: int = 1) -> SpiralDesign:
    """A closed ring cut across at some places; its radius grows by ``bulge`` of itself towards the middle."""
    points, quads = grid_mesh(around, across, closed=True)
    circle = 0.5 * SIDE / math.sin(math.pi / around)
    angle, high = 2.0 * math.pi * points[:, 0] / around, points[:, 1] / across - 0.5
    radius = circle * (1.0 + bulge * (1.0 - 4.0 * high**2))
    place = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), SIDE * across * high])
    mesh = QuadMesh(place, quads)
    column = points[:, 0].astype(int)
    at = [k * around // seams for k in range(seams)]
    a, b = mesh.edges.T
    return shell(mesh, (column[a] == column[b]) & np.isin(column[a], at), width, twist)


def box(n: int, faces: int, twist: float, width: float = 1.5) -> SpiralDesign:
    """Three faces of a cube round a corner, or five, cut at the cube's edges."""
    points, quads = grid_mesh(n, n)
    x, y, z = np.eye(3)
    # to the right, up and outwards, as seen from outside
    frames = (
        [(x, y, z), (y, z, x), (z, x, y)] if faces == 3 else [(x, y, z), (y, z, x), (-x, z, y), (-y, z, -x), (x, z, -y)]
    )
    middle = points - 0.5 * n
    out = [middle[:, :1] * right + middle[:, 1:] * up + 0.5 * n * outward for right, up, outward in frames]
    whole = SIDE * np.concatenate(out)
    mesh = weld_quads(whole, np.concatenate([quads + k * len(points) for k in range(len(out))]))
    inner = ~mesh.border
    p = mesh.vertices[mesh.quads]
    normal = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    cut = np.zeros(len(mesh.edges), dtype=bool)
    a, b = mesh.edge_quads[inner].T
    cut[inner] = (normal[a] * normal[b]).sum(axis=1) < 0.5
    return shell(mesh, cut, width, twist)


def optimised(name: str, arms: str) -> SpiralDesign:
    """A sphere's design as the optimiser leaves it under its usual settings, from its file; made where that is missing.

    arms : whether the arms of a spiral are "alike", in "pairs" or "each" their own
    """
    mesh, path = shapes.make("cubesphere", SIDE), DESIGNS / f"{name}.design.npz"
    if not path.is_file():
        target, spirals = mesh, SpiralParams()
        flat = merge(trace_layout(mesh, LayoutParams()), LayoutParams())
        first = design_from_curvature(flat, spirals, rms_curvature(mesh))
        found = optimise(first, target, MATERIALS["vero"], OptimiseParams(arms=arms), SimulateParams()).design
        found = meshable(found)
        kept = {"cut": found.flat.layout.cut, "points": found.flat.points, "width": found.width, "twist": found.twist}
        chunks.write(path, chunks.archive(kept))
    with np.load(path) as stored:
        flat = with_energies(PatchLayout(mesh, stored["cut"]), stored["points"])
        return SpiralDesign(flat, SpiralParams(), stored["width"], stored["twist"])


def meshable(design: SpiralDesign) -> SpiralDesign:
    """The same design with arms more alike in the few spirals that one element a quarter of the hub cannot fill."""
    for _ in range(10):
        try:
            make_mesh(design, USUAL)
        except FlexMapsError as error:
            which, width = list(error.faces), design.width.copy()
            width[which] = 0.5 * (width[which] + width[which].mean(axis=1, keepdims=True))
            design = replace(design, width=width)
        else:
            break
    return design


# -- cases -------------------------------------------------------------------------------------------------------------


def _side(columns: int, rows: int, column: int) -> list[int]:
    return [row * columns + column for row in range(rows)]


def clamped(columns: int, rows: int) -> tuple[Held, ...]:
    return tuple(Held(one) for one in _side(columns, rows, 0))


def cantilever(name: str, columns: int, rows: int, *force: float) -> Loading:
    """The first column clamped, a force (N) on every hub of the last one."""
    pull = (force[0], force[1], force[2])
    return Loading(name, clamped(columns, rows), tuple((one, pull) for one in _side(columns, rows, columns - 1)))


def unlike() -> list[Case]:
    """Sheets of 4 x 4 spirals whose neighbours differ strongly, clamped at one side and pulled at the other."""
    c, r = cells(4, 4).T
    chess, row = (c + r) % 2, c % 2

    def case(name: str, width: Values, twist: Values, *force: float) -> Case:
        return Case(name, lambda: sheet(4, 4, width, twist), (cantilever("bent", 4, 4, *force),))

    return [
        case("unlike-width", 1.0 + chess, 180.0, 0.0, 0.0, 0.2),
        case("unlike-twist", 1.5, 330.0 * chess, 0.0, 0.0, 0.25),
        case("unlike-both", 2.0 - chess, 330.0 * chess, 0.0, 0.0, 0.2),
        case("unlike-rows", 2.0 - row, 330.0 * row, 0.0, 0.0, 0.2),
        case("unlike-plane", 2.0 - chess, 330.0 * chess, 0.0, 1.2, 0.0),
    ]


def shells() -> list[Case]:
    """Surfaces whose seams bend them, free or on their feet, and sheets of uncommon quads."""
    around, across = cells(8, 3).T
    beside = (around + across) % 2
    feet, top = (0, 5, 30, 35), 14
    pinned = tuple(Held(foot, turn=None) for foot in feet)
    free, pushed = Loading("free"), Loading("pushed", pinned, ((top, (0.5, 0.0, -1.5)),), weight=True)
    oblong = Loading("bent", clamped(6, 3), tuple((one, (0.0, 0.0, 0.3)) for one in _side(6, 3, 5)))
    short = Loading("bent", clamped(6, 5), tuple((one, (0.0, 0.0, 0.8)) for one in _side(6, 5, 5)))
    slender = Loading("bent", clamped(4, 4), tuple((one, (0.0, 0.0, 0.05)) for one in _side(4, 4, 3)))
    return [
        Case("saddle", saddle, (free,)),
        Case("barrel", lambda: ring(10, 3, 1.5, 180.0, bulge=0.12, seams=2), (free,)),
        Case("dome", dome, (pushed,)),
        Case("oblong", lambda: sheet(6, 3, 1.2, 110.0, sides=(0.024, 0.016), angle=75.0), (oblong,)),
        Case("ring", lambda: ring(8, 3, 1.5, 250.0), (free,)),
        Case("ring-unlike", lambda: ring(8, 3, 1.0 + beside, 250.0 - 200.0 * beside), (free,)),
        Case("short", lambda: sheet(6, 5, 2.0, 130.0, sides=(0.010, 0.010)), (short,), WIDE),
        Case("soft", soft, (free,)),
        Case("slender", lambda: sheet(4, 4, 1.0, 400.0, sides=(0.030, 0.030)), (slender,)),
    ]


def four_widths() -> list[Case]:
    """Sheets of 4 x 4 spirals with arms of unlike widths, from the side in the south counter-clockwise."""
    c, r = cells(4, 4).T
    turned = (np.arange(4) + c[:, None] + 2 * r[:, None]) % 4

    def case(
        name: str, width: list[float] | np.ndarray, twist: float, force: float, resolution: Resolution = USUAL
    ) -> Case:
        wide, loading = (
            np.broadcast_to(np.asarray(width, dtype=float), (16, 4)),
            cantilever("bent", 4, 4, 0.0, 0.0, force),
        )
        return Case(f"four-{name}", lambda: sheet(4, 4, wide, twist), (loading,), resolution)

    return [
        case("1212", [1.0, 2.0, 1.0, 2.0], 200.0, 0.35),
        case("2211", [2.0, 2.0, 1.0, 1.0], 200.0, 0.2),
        case("1234", [1.0, 1.3, 1.7, 2.0], 200.0, 0.2),
        case("turned", np.array([1.0, 1.3, 1.7, 2.0])[turned], 200.0, 0.2),
        case("1212-more", [1.0, 2.0, 1.0, 2.0], 300.0, 0.2, WIDE),
        case("2211-more", [2.0, 2.0, 1.0, 1.0], 250.0, 0.2, WIDE),
    ]


def loadings() -> list[Case]:
    """A pair and a patch pulled and turned in many ways, and faces of a cube that seams bend by right angles."""
    home = Held(0)
    pulls = {"up": (0.0, 0.0, 0.8), "aside": (0.0, 0.8, 0.0), "apart": (2.0, 0.0, 0.0)}
    turns = {"bend": (0.0, -0.6, 0.0), "sway": (0.0, 0.0, 0.6), "twist": (0.6, 0.0, 0.0), "all": (0.5, -0.7, 0.5)}
    pair = [Loading(name, (home,), ((1, pull),)) for name, pull in pulls.items()]
    pair += [Loading(name, (home, Held(1, turn, None))) for name, turn in turns.items()]
    saddle_forces = tuple((one, (0.0, 0.0, up)) for one, up in ((0, 1.6), (2, -1.6), (8, 1.6), (6, -1.6)))
    patch = [
        Loading("corner", (home,), ((8, (0.0, 0.0, 0.8)),)),
        Loading("wring", clamped(3, 3), ((2, (0.0, 0.0, 1.6)), (8, (0.0, 0.0, -1.6)))),
        Loading("saddle", (), saddle_forces),
        Loading("mixed", (home,), ((8, (1.6, -0.8, 0.8)), (2, (0.0, 0.8, -0.4)))),
    ]
    return [
        Case("pair", lambda: sheet(2, 1, np.array([1.0, 2.0]), np.array([180.0, 60.0])), tuple(pair)),
        Case("patch", lambda: sheet(3, 3, 1.5, 180.0), tuple(patch)),
        Case("corner", lambda: box(3, 3, 180.0), (Loading("free"),)),
        Case("box", lambda: box(3, 5, 300.0), (Loading("free"),)),
    ]


def strips() -> list[Case]:
    """Strips of 6 x 2 spirals all alike, of little twist to much, clamped at one end and lifted at the other."""
    little = [(0.0, 1.5, 0.6), (5.0, 1.5, 0.6), (10.0, 1.5, 0.6), (20.0, 1.5, 0.6), (35.0, 1.5, 0.5), (50.0, 1.5, 0.4)]
    much = [(90.0, 1.2, 0.25), (150.0, 1.2, 0.15), (330.0, 1.0, 0.04)]

    def case(twist: float, width: float, lift: float) -> Case:
        loading = cantilever("bent", 6, 2, 0.0, 0.0, lift)
        return Case(f"alike-{twist:.0f}", lambda: sheet(6, 2, width, twist), (loading,))

    return [case(*one) for one in (*little, *much)]


def cases() -> list[Case]:
    """All cases without a grain."""
    free = (Loading("free"),)
    found = [
        Case("optimised", lambda: optimised("optimised", "alike"), free),
        Case("optimised-four", lambda: optimised("optimised-four", "each"), free),
    ]
    return unlike() + four_widths() + loadings() + shells() + strips() + found
