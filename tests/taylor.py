"""Whether derivatives are those of an energy: what they miss must fall with the square of the step, block by block."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping

import numpy as np

STEPS = (4e-3, 2e-3, 1e-3)  # of central differences, in the blocks' units
EXACT = 1e-8  # of what is differentiated: where rounding hides how the rest falls
ROUNDING = 1e-14  # of the energy, in its differences


def wrong_blocks(
    energy: Callable[[np.ndarray], float],
    gradient: np.ndarray,
    hessian: Callable[[np.ndarray], np.ndarray],
    blocks: Mapping[str, np.ndarray],
) -> list[str]:
    """Names of the blocks in which a gradient or a Hessian does not fit its energy.

    energy : after an increment (n,); gradient : (n,) at none; hessian : its product with (n,)
    blocks : by name, (n,) the units of the increments that belong to it, zeros elsewhere
    """
    rng = np.random.default_rng(0)
    ways = {name: units * rng.normal(size=units.shape) for name, units in blocks.items()}
    wrong, noise = [], ROUNDING * abs(energy(np.zeros_like(gradient)))
    for name, way in ways.items():
        found = [(energy(t * way) - energy(-t * way)) / (2.0 * t) for t in STEPS]
        if not _falls(found, float(gradient @ way), noise / STEPS[-1]):
            wrong.append(f"gradient by {name}")
    for first, second in itertools.combinations_with_replacement(ways, 2):
        u, v = ways[first], ways[second] if first != second else blocks[second] * rng.normal(size=gradient.shape)
        bends = []
        for t in STEPS:
            corners = [a * b * energy(t * (a * u + b * v)) for a in (1.0, -1.0) for b in (1.0, -1.0)]
            bends.append(sum(corners) / (4.0 * t * t))
        told = float(u @ hessian(v)), float(v @ hessian(u))
        if not all(_falls(bends, one, noise / STEPS[-1] ** 2) for one in told):
            wrong.append(f"Hessian by {first} and {second}")
    return wrong


def _falls(found: list[float], told: float, noise: float) -> bool:
    """Whether differences come nearer to a derivative by four at every halving, or are there already."""
    missed = np.abs(np.array(found) - told)
    size = max(abs(told), *np.abs(found))
    return bool(
        missed[-1] <= max(EXACT * size, noise) or ((missed[1:] < 0.4 * missed[:-1]).all() and missed[-1] < 0.05 * size)
    )
