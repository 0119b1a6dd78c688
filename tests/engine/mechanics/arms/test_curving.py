"""The second order of the joints: against exact elastic curves (Kirchhoff rods) and closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.arm_bend import bend_point
from flexmaps.engine.mechanics.arms.beams import torsion_constant
from flexmaps.engine.mechanics.arms.compliances import arm_compliances
from flexmaps.engine.mechanics.arms.curving import CurvedArms, add_second_order, second_order_strains
from flexmaps.engine.mechanics.arms.cut import ROOT_DISTANCE
from flexmaps.engine.mechanics.assembly import Assembly
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

VERO, SPACING, THICKNESS = MATERIALS["vero"], 0.02, 0.002
WIDTH = 0.0015


def pair(twists: tuple[float, float], *, clockwise: bool = False) -> Assembly:
    """Two spirals side by side along x."""
    lever = np.array([[[0.5 * SPACING, 0.0, 0.0], [-0.5 * SPACING, 0.0, 0.0]]])
    axes = np.broadcast_to(np.eye(3), (1, 2, 3, 3))
    return Assembly(
        np.array([[0, 1]]),
        np.array([[1, 3]]),
        lever,
        axes,
        np.full((2, 4), WIDTH),
        np.array(twists),
        THICKNESS,
        clockwise,
    )


class Curve:
    """The inextensible elastic curve from the first hub to the second, at rest and bent, without any expansion."""

    def __init__(self, assembly: Assembly):
        self.assembly = assembly
        self.begin = ROOT_DISTANCE * WIDTH / (0.5 * SPACING)
        torsion = torsion_constant(np.array(THICKNESS / WIDTH))[0] * WIDTH**4 * 0.5 / (1.0 + VERO.poisson)
        inertias = np.array([float(torsion), WIDTH * THICKNESS**3 / 12.0, THICKNESS * WIDTH**3 / 12.0])
        self.flexible = 1.0 / (VERO.youngs * inertias)

    def rest(self, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Point, velocity and compliance per unit of t; t runs over [-1, 1], the joint at 0."""
        arm, u = (0, 1.0 - self.rigid(-t)) if t < 0 else (1, 1.0 - self.rigid(t))
        twist, side = self.assembly.twist[arm], -1.0 if self.assembly.clockwise else 1.0
        turn, rest = np.exp(1j * twist * (1.0 - u)), (1.0 - 1j * twist * u)
        z, v = 0.5 * SPACING * u * turn, 0.5 * SPACING * turn * rest * (1.0 - self.begin)
        if arm:
            z = SPACING - z  # the second arm is turned by half a turn and run through inwards
        point, velocity = (np.array([c.real, side * c.imag, 0.0]) for c in (z, v))
        tangent = velocity / np.linalg.norm(velocity)
        frame = np.stack([tangent, np.cross([0.0, 0.0, 1.0], tangent), [0.0, 0.0, 1.0]])
        return point, velocity, np.linalg.norm(velocity) * (frame.T * self.flexible) @ frame

    def rigid(self, t: float) -> float:
        """Share of the radius left to the joint at the parameter t."""
        return t * (1.0 - self.begin)

    def bent(self, force: np.ndarray, moment: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Place and rotation of the second hub under a wrench at the first one's rim, and the energy."""
        start = self.rest(-1.0)[0]

        def rate(t: float, state: np.ndarray) -> np.ndarray:
            turned, place = state[:9].reshape(3, 3), state[9:12]
            _, velocity, flexible = self.rest(t)
            acting = moment - np.cross(place - start, force)
            curvature = turned @ flexible @ turned.T @ acting
            return np.concatenate(
                [np.cross(curvature, turned.T).T.ravel(), turned @ velocity, [0.5 * acting @ curvature]]
            )

        state = np.concatenate([np.eye(3).ravel(), start, [0.0]])
        for span in ((-1.0, 0.0), (1e-12, 1.0)):
            state = solve_ivp(rate, span, state, rtol=1e-8, atol=1e-11).y[:, -1]
        turned = state[:9].reshape(3, 3)
        return state[9:12] + turned @ (np.array([SPACING, 0.0, 0.0]) - self.rest(1.0)[0]), turned, float(state[12])


def beam_compliance(curve: Curve) -> np.ndarray:
    """(1, 2, 6, 6) of the two halves of the curve, tip against hub at the joint, by quadrature."""
    x, w = np.polynomial.legendre.leggauss(40)
    out = np.zeros((1, 2, 6, 6))
    for arm in (0, 1):
        for t, weight in zip(0.5 * (x + 1.0) * (2 * arm - 1), 0.5 * w):
            point, _, flexible = curve.rest(t)
            way = point - [0.5 * SPACING, 0.0, 0.0]
            moment = np.concatenate([-np.cross(way, np.eye(3)).T, np.eye(3)], axis=1)
            out[0, arm] += weight * moment.T @ flexible @ moment
    return out


def models_energy(
    assembly: Assembly, compliance: np.ndarray, place: np.ndarray, turned: np.ndarray
) -> tuple[float, float]:
    """Energy of the pose by the linear strains between the hubs' centres alone, and with their second order."""
    arms = replace(table_arms(assembly), compliance=compliance)
    at_joint = np.linalg.inv(compliance.sum(axis=1))
    curving = second_order_strains(arms, at_joint, np.zeros((1, 2, 3)))
    turn = Rotation.from_matrix(turned).as_rotvec()
    shift = Rotation.from_rotvec(-0.5 * turn).apply(place) - [SPACING, 0.0, 0.0]
    strains = np.concatenate([shift, turn])[None]
    return tuple(
        0.5 * float(np.einsum("ei,eij,ej->", e, at_joint, e)) for e in (strains, add_second_order(strains, curving)[0])
    )


@pytest.mark.parametrize("clockwise", [False, True])
@pytest.mark.parametrize("twists", [(2.0, 2.0), (1.0, 4.5)])
@pytest.mark.parametrize("seed", [0, 1])
def test_energy_is_exact_to_the_third_order(twists: tuple[float, float], clockwise: bool, seed: int) -> None:
    """Halving the load quarters the relative error left, where it only halves without the second order."""
    assembly = pair(twists, clockwise=clockwise)
    curve = Curve(assembly)
    compliance = beam_compliance(curve)
    rng = np.random.default_rng(seed)
    force, moment = rng.normal(size=3), rng.normal(size=3) * 0.5 * SPACING
    errors = []
    for size in (0.4, 0.2, 0.1):
        place, turned, exact = curve.bent(size * force, size * moment)
        errors.append([e / exact - 1.0 for e in models_energy(assembly, compliance, place, turned)])
    plain, second = np.abs(errors).T
    assert plain[1] / plain[2] < 3.0
    assert second[1] / second[2] > 3.0
    assert second[2] < 0.3 * plain[2]


def test_straight_arms_bend_into_an_arc() -> None:
    """Closed form: rigid hubs and an arc between them; the chord shortens, which is no compression."""
    arms = table_arms(pair((0.0, 0.0)))
    curving = second_order_strains(arms, np.linalg.inv(arms.compliance.sum(axis=1)), np.zeros((1, 2, 3)))
    hub = ROOT_DISTANCE * WIDTH
    for axis in (4, 5):
        assert curving[0, 0, axis, axis] == pytest.approx(hub / 4.0 + (SPACING - 2.0 * hub) / 24.0, rel=0.02)


def test_bend_points_leave_little_for_turns() -> None:
    """The levers to the bend points are made so that turns alone need hardly any correction."""
    arms, radius = table_arms(pair((3.0, 3.0))), 0.5 * SPACING
    point = radius * np.append(bend_point(np.array([3.0]))[0][0], 0.0)
    at_joint = np.linalg.inv(arms.compliance.sum(axis=1))
    levers = (np.zeros((1, 2, 3)), np.array([[point, -point]]))
    between, bent = (second_order_strains(arms, at_joint, lever)[0, :3, 3:, 3:] for lever in levers)
    assert np.abs(bent).max() < 0.4 * np.abs(between).max()


def table_arms(assembly: Assembly) -> CurvedArms:
    return CurvedArms.from_assembly(assembly, VERO, arm_compliances(assembly, VERO).values)
