"""Solids of sheets with a grain: closed forms at an angle, isotropic ones told in full, and derivatives against differences."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flexmaps.database import linear
from flexmaps.database.elastic import STATION_PAIRS, Elements, orthotropic
from flexmaps.database.geometry import Spiral
from flexmaps.database.solid import make_solid
from flexmaps.database.statics import Model
from flexmaps.engine.materials import MATERIALS, Orthotropy

WOOD = MATERIALS["birch"].orthotropy
assert WOOD is not None
CROSS = Spiral(10.0, 1.3, 0.0)


def elements(angle: float, spiral: Spiral = CROSS) -> tuple[np.ndarray, Elements, np.ndarray]:
    """Nodes of a spiral, its elements, and the compliance of its material."""
    solid, stiffness = make_solid(spiral), orthotropic(WOOD, WOOD.along, angle)
    return solid.nodes, Elements(solid.nodes, solid.elements, 0.3, stiffness), np.linalg.inv(stiffness)


@pytest.mark.parametrize("degrees", [0.0, 25.0, 90.0, -40.0])
def test_a_bar_is_pulled_and_bent_at_an_angle_to_the_grain(degrees: float) -> None:
    """Pure tension and bending out of the sheet are exact fields, which the curved elements at the hub hold to 3 in 1000: 1/E = c^4/E1 + s^4/E2 + (1/G - 2 nu/E1) s^2 c^2, and sections
    that turn and warp by S16 / 2 in proportion to the bending stress (Lekhnitskii)."""
    nodes, bar, s = elements(math.radians(degrees))
    c2, s2 = math.cos(math.radians(degrees)) ** 2, math.sin(math.radians(degrees)) ** 2
    soft = c2**2 / WOOD.along + s2**2 / WOOD.across + (1.0 / WOOD.shear - 2.0 * WOOD.poisson / WOOD.along) * c2 * s2
    assert s[0, 0] == pytest.approx(WOOD.along * soft, rel=1e-12)
    x, y, z = nodes.T
    size = 1e-7
    pulled = np.stack([s[0, 0] * x + s[5, 0] * y, s[1, 0] * y, s[2, 0] * z], axis=1)
    half = 0.5 * s[5, 0]
    bent = np.stack(
        [
            s[0, 0] * x * z + half * y * z,
            s[1, 0] * y * z + half * x * z,
            0.5 * (s[2, 0] * z * z - s[0, 0] * x * x - s[1, 0] * y * y) - half * x * y,
        ],
        axis=1,
    )
    for field, stress_at in ((pulled, lambda p: np.ones(p.shape[:-1])), (bent, lambda p: p[..., 2])):
        f = bar.gradients(size * field)
        place = np.einsum("ps,emsi->empi", bar._n, bar.rest)
        wanted = np.zeros((*place.shape[:-1], 3, 3))
        wanted[..., 0, 0] = size * stress_at(place)
        strain = 0.5 * (f + np.swapaxes(f, -1, -2)) - np.eye(3)
        assert bar.stress(strain) == pytest.approx(wanted, abs=4e-3 * np.abs(wanted).max())
        assert bar.energy(strain) == pytest.approx(
            0.5 * s[0, 0] * (bar.weight * wanted[..., 0, 0] ** 2).sum(), rel=1e-3
        )


def test_an_isotropic_sheet_told_in_full_is_the_same() -> None:
    shear = 0.5 / 1.3
    told = orthotropic(Orthotropy(1.0, 1.0, 0.3, shear, shear, shear), 1.0, 0.7)
    spiral = Spiral(8.0, 1.2, 1.5)
    found = [Model(spiral, 0.3, stiffness=one) for one in (None, told)]
    plain, full = (linear.tip_compliance(one, linear.unit_motions(one)) for one in found)
    assert full == pytest.approx(plain, abs=1e-9 * np.abs(plain).max())


def test_forces_and_tangent_are_those_of_the_energy() -> None:
    nodes, el, _ = elements(0.5, Spiral(6.0, 1.0, 1.5))
    rng = np.random.default_rng(3)
    at, way = 0.05 * np.sin(nodes @ rng.normal(size=(3, 3))), np.cos(nodes @ rng.normal(size=(3, 3)))

    def forces(step: float) -> np.ndarray:
        f = el.gradients(at + step * way)
        return el.forces(f, el.stress(el.strain(f)))

    def energy(step: float) -> float:
        return el.energy(el.strain(el.gradients(at + step * way)))

    h = 1e-4
    own = way[el.index]
    slope = (8 * (energy(h) - energy(-h)) - energy(2 * h) + energy(-2 * h)) / (12 * h)
    assert slope == pytest.approx(float((forces(0.0) * own).sum()), rel=1e-8)
    f = el.gradients(at)
    tangents = el.tangents(f, el.stress(el.strain(f)))
    bend = 0.0
    for k, (p, r) in enumerate(STATION_PAIRS):
        part = np.einsum("eijst,esi,etj->", tangents[:, k], own[:, p], own[:, r])
        bend += part if p == r else 2.0 * part
    found = (8 * (forces(h) - forces(-h)) - forces(2 * h) + forces(-2 * h)) / (12 * h)
    assert bend == pytest.approx(float((found * own).sum()), rel=1e-8)
