"""Arms of sheets with a grain: flexibility of their sections, and the curved beam that replaces the isotropic beam.

The material of an arm at an angle to the grain is monoclinic: symmetric about the plane of the sheet, but not about the
arm's cross-section. Let S be the sheet's elastic compliances in the section's axes (1 along the arm, 2 across it in the
sheet, 3 normal to the sheet), w and h the section's width and height, A = w h and I = w h^3 / 12. By Saint-Venant's
principle (Lekhnitskii, Theory of Elasticity of an Anisotropic Body, chapters 2 and 6) the flexibilities per length are

    stretch                   S11 / A
    shear in the sheet        6/5 S66 / A,    coupled with stretch by S16 / A
    bending in the sheet      S11 / (h w^3 / 12)
    bending out of the sheet  S11 / I
    torsion                   1 / D + S16^2 / (4 S11 I),    coupled with bending out of the sheet by -S16 / (2 I)

D is the torsional rigidity of a section with the shear compliances a = S66 - S16^2 / S11 in the sheet and b = S55
normal to it. It is computed like that of an isotropic section whose width is multiplied by sqrt(a / b). Apart from the
factor 6/5 all this is exact for forces and moments that are constant along the arm.

A hub has two further effects. It keeps the sections near it from warping, which matters more, the larger S16 is
(``SectionFlexibility.of_held``). And it is softer, the softer the sheet is in shear (``SectionFlexibility.of_hub``).
The stiffness table contains both effects for isotropic sheets, so only the differences from an isotropic hub are added.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...arrays import Float
from ...materials import Orthotropy
from .beams import SHEAR_FACTOR, Blocks, gauss, torsion_constant
from .stacked import BATCH
from .stations import product, spiral_stations, sum_products
from .stiffness import ENTRIES, IN_PLANE, OUT_OF_PLANE

# number of Gauss points along an arm; more are slower and more exact (error 1e-6 up to 150 degrees of twist)
POINTS = 48
# A hub in a sheet with a grain bends more than an isotropic hub: as much as an additional piece of arm of this length,
# in arm widths, times the difference between E / G of the sheet and of isotropic material. HUB_BEND is for bending in
# the sheet (with the shear modulus G in the sheet), HUB_LIFT for bending out of it (G normal to the sheet). Larger:
# softer arms in sheets with a grain
HUB_BEND, HUB_LIFT = 0.045, 0.025
# distance from the hub's centre, in arm widths, up to which the hub keeps sections from warping; larger: stiffer arms
HUB_HOLDS = 1.7
# The additional bending of a hub out of the sheet (HUB_LIFT) is proportional to w/h for tall arms and to h/w for wide
# arms, with w and h an arm's width and height. This is the fourth power of the w/h at which the two laws meet
HUB_TALL = 0.31
HUB_AT = 0.5  # distance from the hub's centre, in arm widths, at which the hub's flexibility acts: where the arm begins
# indices of the parameters of an arm by which its beam's compliance is differentiated
_RADIUS, _WIDTH, _TWIST, _GRAIN = range(4)


@dataclass(frozen=True, eq=False)
class SectionFlexibility:
    """Flexibilities of an arm's section, per length of arm.

    Every array is (3, ...): value, derivative by the width, derivative by the angle from the arm to the grain.

    stretch : stretch per force along the arm
    slide : shear per force across the arm in the sheet
    mixed : coupling of ``stretch`` and ``slide``: shear in the sheet per force along the arm
    rise : shear per force normal to the sheet
    bend : curvature in the sheet per moment about the normal
    lift : curvature out of the sheet per moment about the direction across the arm
    twist : twist rate per torque
    coupled : coupling of ``lift`` and ``twist``: twist rate per moment about the direction across the arm
    """

    stretch: np.ndarray
    slide: np.ndarray
    mixed: np.ndarray
    rise: np.ndarray
    bend: np.ndarray
    lift: np.ndarray
    twist: np.ndarray
    coupled: np.ndarray

    @classmethod
    def evaluate(
        cls, known: Orthotropy, angle: np.ndarray, width: np.ndarray, height: float | np.ndarray
    ) -> SectionFlexibility:
        """Return the flexibilities of sections that are free to warp; all arguments broadcast.

        Parameters
        ----------
        known : moduli of the sheet
        angle : radians from the arm to the grain, positive to the arm's left
        width, height : of the sections, metres
        """
        s11, s16, s66, s55 = _rotated_compliances(known, angle)
        area, inertia = 1.0 / (width * height), 12.0 / (width * height**3)

        def per_section(value: np.ndarray, factor: np.ndarray, power: int) -> np.ndarray:
            return np.stack([value[0] * factor, -power * value[0] * factor / width, value[1] * factor])

        stretch, mixed = per_section(s11, area, 1), per_section(s16, area, 1)
        slide, rise = per_section(SHEAR_FACTOR * s66, area, 1), per_section(SHEAR_FACTOR * s55, area, 1)
        bend, lift = per_section(s11, 12.0 / (height * width**3), 3), per_section(s11, inertia, 1)
        # S16^2 and its derivative; in the next line S16^2 / S11 and its derivative
        shared = np.stack([s16[0] ** 2, 2.0 * s16[0] * s16[1]])
        shared = np.stack([shared[0] / s11[0], (shared[1] - shared[0] * s11[1] / s11[0]) / s11[0]])
        left = s66 - shared
        twist = _torsion(left, s55, width, height) + per_section(0.25 * shared, inertia, 1)
        return cls(stretch, slide, mixed, rise, bend, lift, twist, per_section(-0.5 * s16, inertia, 1))

    @classmethod
    def of_held(
        cls, known: Orthotropy, angle: np.ndarray, width: np.ndarray, height: float | np.ndarray
    ) -> SectionFlexibility:
        """Return flexibilities of sections that are kept from warping minus those of free sections.

        The part of the difference that isotropic sections have too is left out. A section that cannot warp stays plane.
        With Q, the inverse of [S11, S16; S16, S66], its stiffness per length is Q11 h w^3 / 12 in bending in the sheet,
        and the matrix [Q11 I, -Q16 I; -Q16 I, Q66 I + h w^3 / (12 S55)] for bending out of the sheet and torsion.
        Arguments as in ``evaluate``.
        """
        free = cls.evaluate(known, angle, width, height)
        s11, s16, s66, s55 = (np.stack([v[0], np.zeros_like(v[0]), v[1]]) for v in _rotated_compliances(known, angle))
        level = np.stack([width * height**3 / 12.0, height**3 / 12.0 + 0.0 * width, 0.0 * width])
        upright = np.stack([height * width**3 / 12.0, height * width**2 / 4.0, 0.0 * width])
        over = _inverse(product(s11, s66) - product(s16, s16))
        bent, mixed = product(level, product(s66, over)), product(level, product(s16, over))
        twisted = product(level, product(s11, over)) + product(upright, _inverse(s55))
        both = _inverse(product(bent, twisted) - product(mixed, mixed))
        bend = _inverse(product(upright, product(s66, over))) - free.bend
        constant, slope = torsion_constant(height / width)
        torsion = np.stack([width**4 * constant, 4.0 * width**3 * constant - width**2 * height * slope, 0.0 * width])
        alike = product(torsion, _inverse(level + upright))
        lift, coupled = product(twisted, both) - free.lift, -product(mixed, both) - free.coupled
        twist = product(bent, both) - product(alike, free.twist)
        none = np.zeros_like(bend)
        return cls(none, none, none, none, bend, lift, twist, coupled)

    @classmethod
    def of_hub(
        cls, known: Orthotropy, angle: np.ndarray, width: np.ndarray, height: float | np.ndarray, poisson: float
    ) -> SectionFlexibility:
        """Return the flexibility of the hub at an arm's inner end minus that of an isotropic hub.

        It is that of the whole hub, not per length. Arguments as in ``evaluate``; poisson : of the isotropic hub.
        """
        s11, _, s66, s55 = _rotated_compliances(known, angle)
        more_level, more_upright = s66 - 2.0 * (1.0 + poisson) * s11, s55 - 2.0 * (1.0 + poisson) * s11
        flat = width / height
        spread = HUB_TALL + flat**4
        factor, by = 12.0 * HUB_LIFT / height**3, (HUB_TALL - flat**4) / spread**1.5 / height
        part = flat / np.sqrt(spread)
        level = 12.0 * HUB_BEND / (height * width**2)
        bend = np.stack([more_level[0] * level, -2.0 * more_level[0] * level / width, more_level[1] * level])
        lift = factor * np.stack([more_upright[0] * part, more_upright[0] * by, more_upright[1] * part])
        none = np.zeros_like(bend)
        return cls(none, none, none, none, bend, lift, none, none)


def _rotated_compliances(known: Orthotropy, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the elastic compliances S11, S16, S66 and S55 in the arm's axes (1/Pa), with derivatives by the angle.

    Jones, Mechanics of Composite Materials, section 2.6. Each is (2, ...): value and derivative.

    angle : radians from the arm to the grain
    """
    s1, s2, s12, s6 = 1.0 / known.along, 1.0 / known.across, -known.poisson / known.along, 1.0 / known.shear
    # S11 = mean + half cos(2 angle) + quarter cos(4 angle)
    mean, half = 0.125 * (3.0 * (s1 + s2) + 2.0 * s12 + s6), 0.5 * (s1 - s2)
    quarter = 0.125 * (s1 + s2 - 2.0 * s12 - s6)
    c2, n2, c4, n4 = np.cos(2.0 * angle), np.sin(2.0 * angle), np.cos(4.0 * angle), np.sin(4.0 * angle)
    s11 = np.stack([mean + half * c2 + quarter * c4, -2.0 * half * n2 - 4.0 * quarter * n4])
    s16 = np.stack([half * n2 + 2.0 * quarter * n4, 2.0 * half * c2 + 8.0 * quarter * c4])
    s66 = np.stack([s6 + 4.0 * quarter * (1.0 - c4), 16.0 * quarter * n4])
    flat, steep = 1.0 / known.shear_along, 1.0 / known.shear_across
    s55 = np.stack([0.5 * (flat + steep) + 0.5 * (flat - steep) * c2, (steep - flat) * n2])
    return s11, s16, s66, s55


def _torsion(level: np.ndarray, upright: np.ndarray, width: np.ndarray, height: float | np.ndarray) -> np.ndarray:
    """Return 1 / D (3, ...) of sections, D their torsional rigidity: value, derivatives by width and by angle.

    level, upright : (2, ...) shear compliances in the sheet and normal to it: value, derivative by the angle
    """
    wider = np.sqrt(level[0] / upright[0])
    wider_by = 0.5 * wider * (level[1] / level[0] - upright[1] / upright[0])
    wide = width * wider
    constant, slope = torsion_constant(height / wide)
    value = level[0] * wider / (wide**4 * constant)
    by_wide = -value * (4.0 - slope * height / (wide * constant)) / wide
    by_angle = value * (level[1] / level[0] + wider_by / wider) + by_wide * width * wider_by
    return np.stack([value, by_wide * wider, by_angle])


def _inverse(a: np.ndarray) -> np.ndarray:
    """Return the reciprocals of values and the derivatives of the reciprocals.

    a : (1 + P, ...) the values, then their derivatives by P parameters
    """
    out = -a / a[0] ** 2
    out[0] = 1.0 / a[0]
    return out


def line_compliance(
    place: np.ndarray,
    velocity: np.ndarray,
    width: np.ndarray,
    weight: np.ndarray,
    grain: np.ndarray,
    height: float | np.ndarray,
    flexibilities: Callable[..., SectionFlexibility],
) -> Float[np.ndarray, "12 numbers n"]:
    """Integrate flexibilities along lines on N arms to the compliances of the arms' tips.

    Parameters
    ----------
    place, velocity, width, weight : S stations on every arm, with derivatives by P parameters, as in ``cut._Line``
    grain : (1 + P, 1 or S, N) angle from the arm's radius to the grain, radians
    height : thickness of the sheet, metres
    flexibilities : function that returns the flexibilities of sections from their angle to the grain, width and height

    Returns
    -------
    (12, 1 + P, N) : axis 0: ``ENTRIES`` of the in-plane block, then of the out-of-plane block; axis 1: value and
        derivatives
    """
    x, y = -place.real, -place.imag
    speed = np.abs(velocity[0])
    along = velocity * (np.conj(velocity[0]) / speed)
    unit = 1j * along.imag * (velocity[0] / speed**2)
    unit[0] = velocity[0] / speed
    tx, ty = unit.real, unit.imag
    turn = along.imag / speed
    turn[0] = np.angle(unit[0])
    angle = grain - turn
    length = product(weight, np.concatenate([speed[None], along.real[1:]]))
    yields = flexibilities(angle[0], width[0], height)

    def over(value: np.ndarray) -> np.ndarray:
        out = value[1] * width + value[2] * angle
        out[0] = value[0]
        return product(length, out)

    one, none = np.zeros_like(tx), np.zeros_like(tx)
    one[0] = 1.0
    bend, stretch, slide, mixed = (over(v) for v in (yields.bend, yields.stretch, yields.slide, yields.mixed))
    inside = _sum_squares(bend, (-y, x, one))
    forces = _sum_coupled(stretch, slide, mixed, (tx, ty, none), (-ty, tx, none))
    twist, lift, coupled, rise = (over(v) for v in (yields.twist, yields.lift, yields.coupled, yields.rise))
    lever, torque = product(x, tx) + product(y, ty), product(y, tx) - product(x, ty)
    outside = _sum_coupled(twist, lift, coupled, (torque, tx, ty), (-lever, -ty, tx))
    outside[0] += rise.sum(axis=1)
    return np.concatenate([inside + forces, outside])


def _sum_squares(value: np.ndarray, rows: tuple[np.ndarray, ...]) -> Float[np.ndarray, "6 numbers n"]:
    """Return for every (i, j) in ``ENTRIES`` the sum of value * a_i * a_j over the stations; rows : a_0, a_1, a_2."""
    scaled = [product(value, row) for row in rows]
    return np.stack([sum_products(scaled[i], rows[j]) for i, j in ENTRIES])


def _sum_coupled(
    first: np.ndarray, second: np.ndarray, mixed: np.ndarray, a: tuple[np.ndarray, ...], b: tuple[np.ndarray, ...]
) -> Float[np.ndarray, "6 numbers n"]:
    """Return sums over the stations, for every (i, j) in ``ENTRIES``.

    The summands are first * a_i * a_j + second * b_i * b_j + mixed * (a_i * b_j + b_i * a_j).
    """
    rows = [
        (product(first, p) + product(mixed, q), product(mixed, p) + product(second, q))
        for p, q in zip(a, b, strict=True)
    ]
    return np.stack([sum_products(rows[i][0], a[j]) + sum_products(rows[i][1], b[j]) for i, j in ENTRIES])


@dataclass(frozen=True, eq=False)
class GrainBeams:
    """The beams of n arms in a sheet with a grain, as a callable for ``beam`` of ``stiffness.table_tip_compliance``.

    known : moduli of the sheet
    grain : (n,) radians from the arm's radius to the grain, positive to the side to which arms wind inwards
    unit : Young's modulus with which the table is evaluated, Pa; the compliances are multiplied by it
    poisson : Poisson's ratio with which the table is evaluated
    """

    known: Orthotropy
    grain: Float[np.ndarray, " n"]
    unit: float
    poisson: float

    def __call__(self, scale: np.ndarray, height: np.ndarray, twist: np.ndarray) -> Blocks:
        """Return the dimensionless tip compliances, with a fourth slope by the angle to the grain.

        scale, height : (n,) scale and sheet thickness over arm width; twist : (n,) radians
        """
        parts = [
            self._lines(*(values[start : start + BATCH] for values in (scale, height, twist, self.grain)))
            for start in range(0, len(scale), BATCH)
        ]
        found = self.unit * np.concatenate(parts, axis=2).reshape(2, 6, 5, -1)
        value, by_radius, by_width, by_twist, by_grain = np.moveaxis(found, 2, 0)
        by_scale = 0.5 * scale * by_radius
        # If all lengths are multiplied by c, a shift per force is multiplied by c^-1, a shift per moment or turn per
        # force by c^-2, a turn per moment by c^-3. This gives the derivative by the height from the other derivatives
        kind = np.array([[0 if r < 3 else 1 for r in rows] for rows in (IN_PLANE, OUT_OF_PLANE)])
        power = np.array([[-1 - kind[b, i] - kind[b, j] for i, j in ENTRIES] for b in (0, 1)])[..., None]
        by_height = power * value - by_scale - by_width
        return Blocks(value, np.stack([by_scale, -by_height, by_twist, by_grain]))

    def _lines(
        self, scale: np.ndarray, height: np.ndarray, twist: np.ndarray, grain: np.ndarray
    ) -> Float[np.ndarray, "12 5 n"]:
        """Return the tip compliances of the beams, as in ``line_compliance``, with lengths in arm widths.

        Axis 1: value, derivatives by ``_RADIUS``, ``_WIDTH``, ``_TWIST`` and ``_GRAIN``. Parameters as in ``__call__``.
        """
        x, w = gauss(POINTS)
        radius, n = 0.5 * scale, len(scale)
        width, angle, weight = np.zeros((5, 1, n)), np.zeros((5, 1, n)), np.zeros((5, POINTS, 1))
        width[0], width[1 + _WIDTH], weight[0] = 1.0, 1.0, w[:, None]
        angle[0], angle[1 + _GRAIN] = grain, 1.0
        t = np.zeros((5, POINTS, 1))
        t[0] = x[:, None]
        # ``share`` is the degree (1 to 0) to which the hub keeps a section from warping. It decreases with ``away``,
        # the distance of the section from the hub's centre
        away = radius * (1.0 - t[0])
        share = np.zeros((5, POINTS, n))
        share[0] = np.exp(-((away / HUB_HOLDS) ** 2))
        share[1 + _WIDTH] = 2.0 * (away / HUB_HOLDS) ** 2 * share[0]
        share[1 + _RADIUS] = -share[1 + _WIDTH] / radius
        rows = {"by_radius": 1 + _RADIUS, "by_twist": 1 + _TWIST}
        lines = spiral_stations(radius, twist, t, **rows)
        free = partial(SectionFlexibility.evaluate, self.known)
        along = line_compliance(*lines, width, weight, angle, height, free)
        weight = weight * share[:1] + weight[:1] * share
        weight[0] = w[:, None] * share[0]
        along += line_compliance(*lines, width, weight, angle, height, partial(SectionFlexibility.of_held, self.known))
        t = np.zeros((5, 1, n))
        t[0], t[1 + _RADIUS], t[1 + _WIDTH] = 1.0 - HUB_AT / radius, HUB_AT / radius**2, -HUB_AT / radius
        places, paces = spiral_stations(radius, twist, t, **rows)
        # ``of_hub`` is the flexibility of a whole hub, not per length. So it is integrated over one station whose
        # weight times speed, its length, is 1
        speed = np.abs(paces[0])
        weight = -(paces * np.conj(paces[0])).real / speed**3
        weight[0] *= -1.0
        of = partial(SectionFlexibility.of_hub, self.known, poisson=self.poisson)
        return along + line_compliance(places, paces, width, weight, angle, height, of)


def direction_share(
    strength: tuple[float, float, float], stress: float, angle: Float[np.ndarray, "*n"]
) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
    """Return stress / strength of the sheet in the direction of the stress, and the derivative by ``angle``.

    Norris, Strength of Orthotropic Materials Subjected to Combined Stresses, Forest Products Laboratory 1962.

    Parameters
    ----------
    strength : along the grain, across it, and in shear, Pa, as in ``Orthotropy``
    stress : normal stress in one direction, Pa
    angle : radians from the grain to the stress
    """
    first, second, sheared = (stress / one for one in strength)
    c, s = np.cos(angle) ** 2, np.sin(angle) ** 2
    both = sheared**2 - first * second
    share = np.sqrt(c * c * first**2 + s * s * second**2 + c * s * both)
    slope = np.sin(2.0 * angle) * (s * second**2 - c * first**2 + 0.5 * (c - s) * both)
    return share, slope / share
