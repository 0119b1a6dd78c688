"""The paper's radial basis function network (FlexMaps section 6.3): neurons added one by one, spread chosen by count.

Inputs and outputs are scaled to the unit range. The outputs are logarithms of the parameters: without them the
network's errors are many times the smallest parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..engine.arrays import Float

SPREADS = np.linspace(0.2, 0.8, 20)  # in units of the inputs' ranges: twenty, as in FlexMaps section 6.3
# RMS errors, of the unit range, at which neurons are no longer added. FlexMaps has one; parameters fitted to finitely
# many samples scatter, and a network that follows the scatter is wild between its nodes
GOALS = (1e-3, 2e-3, 5e-3, 1e-2, 2e-2)
HALF = np.sqrt(np.log(2.0))  # A neuron's answer falls to one half at a distance of one spread


@dataclass(frozen=True, eq=False)
class Network:
    """y(x) = offset + span * (bias + sum of weights * exp(-(HALF |x' - centre| / spread)^2)), x' scaled to [0, 1].

    low, high : input range; offset, span : output range; centres : scaled; weights : bias last
    """

    low: Float[np.ndarray, " inputs"]
    high: Float[np.ndarray, " inputs"]
    offset: Float[np.ndarray, " outputs"]
    span: Float[np.ndarray, " outputs"]
    centres: Float[np.ndarray, "neurons inputs"]
    weights: Float[np.ndarray, "neurons+1 outputs"]
    spread: float
    rms: float

    def arrays(self) -> dict[str, np.ndarray]:
        return {n: np.asarray(v) for n, v in vars(self).items() if n != "rms"}

    def __call__(self, points: Float[np.ndarray, "points inputs"]) -> Float[np.ndarray, "points outputs"]:
        basis = _basis((points - self.low) / (self.high - self.low), self.centres, self.spread)
        return self.offset + self.span * (basis @ self.weights)


def _basis(points: np.ndarray, centres: np.ndarray, spread: float) -> np.ndarray:
    """(n, m + 1): the neurons' answers, and a column of ones."""
    distance = np.linalg.norm(points[:, None] - centres[None], axis=2)
    return np.column_stack([np.exp(-((HALF * distance / spread) ** 2)), np.ones(len(points))])


def _grow(points: np.ndarray, outputs: np.ndarray, spread: float, goal: float) -> tuple[list[int], float]:
    """Neurons by orthogonal least squares, the most useful first, until the RMS error meets the goal."""
    basis = _basis(points, points, spread)
    columns, ones = basis[:, :-1].copy(), basis[:, -1:] / np.sqrt(len(points))
    columns -= ones @ (ones.T @ columns)
    left = outputs - ones @ (ones.T @ outputs)
    chosen: list[int] = []
    rms = float(np.sqrt((left**2).mean()))
    while rms > goal and len(chosen) < len(points) - 1:
        norms = (columns**2).sum(0)
        gain = ((columns.T @ left) ** 2).sum(1) / np.maximum(norms, 1e-300)
        gain[norms < 1e-12] = -1.0
        gain[chosen] = -1.0
        best = int(np.argmax(gain))
        if gain[best] <= 0:
            break
        q = columns[:, best : best + 1] / np.sqrt(norms[best])
        left = left - q @ (q.T @ left)
        columns = columns - q @ (q.T @ columns)
        chosen.append(best)
        rms = float(np.sqrt((left**2).mean()))
    return chosen, rms


def train(points: np.ndarray, outputs: np.ndarray, goal: float = GOALS[0]) -> Network:
    """The network with the fewest neurons that meets the goal over 20 spreads; (n, 3) inputs, (n, 4) outputs.

    Where none meets it, the one that comes closest.
    """
    low, high, offset = points.min(0), points.max(0), outputs.min(0)
    span = np.maximum(outputs.max(0) - offset, 1e-12)
    x, y = (points - low) / (high - low), (outputs - offset) / span
    best: tuple[bool, float, float, list[int], float] | None = None
    for spread in SPREADS:
        chosen, rms = _grow(x, y, float(spread), goal)
        failed = rms > goal
        rank = (failed, float(len(chosen)) if not failed else rms, float(spread), chosen, rms)
        if best is None or rank[:2] < best[:2]:
            best = rank
    assert best is not None
    _, _, spread, chosen, _ = best
    return _solved(x, y, low, high, offset, span, np.array(chosen, dtype=int), spread)


def _solved(
    x: np.ndarray,
    y: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    offset: np.ndarray,
    span: np.ndarray,
    chosen: np.ndarray,
    spread: float,
) -> Network:
    basis = _basis(x, x[chosen], spread)
    weights = np.linalg.lstsq(basis, y, rcond=1e-12)[0]
    return Network(
        low, high, offset, span, x[chosen], weights, spread, float(np.sqrt(((basis @ weights - y) ** 2).mean()))
    )


def choose(points: np.ndarray, outputs: np.ndarray) -> tuple[Network, float, np.ndarray]:
    """The network of the goal whose parameters are nearest at points left out, on average; that goal, and those errors (n, 4)."""
    tried = []
    for goal in GOALS:
        made = train(points, outputs, goal)
        tried.append((made, goal, leave_one_out(points, outputs, made)))
    return min(tried, key=lambda one: float(one[2].mean()))


def leave_one_out(points: np.ndarray, outputs: np.ndarray, made: Network) -> Float[np.ndarray, "n outputs"]:
    """Relative errors of the parameters at every point when the network is solved without it."""
    x, y = (points - made.low) / (made.high - made.low), (outputs - made.offset) / made.span
    position = np.array([int(np.argmin(((x - c) ** 2).sum(1))) for c in made.centres])
    out = np.empty_like(outputs)
    for k in range(len(x)):
        keep = np.arange(len(x)) != k
        own = position[position != k]
        basis = _basis(x, x[own], made.spread)
        weights = np.linalg.lstsq(basis[keep], y[keep], rcond=1e-10)[0]
        out[k] = np.abs(np.exp(((basis[k] @ weights) - y[k]) * made.span) - 1.0)
    return out
