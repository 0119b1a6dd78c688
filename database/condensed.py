"""Static condensation of arms to their two ends: the inside of every piece first, then the boundaries of the pieces in turn.

All arms have the same number of pieces and go through every step together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..engine.arrays import Float
from .elastic import STATION_PAIRS

STATIONS = 4  # of a piece, its two ends among them


@dataclass(frozen=True, eq=False)
class Pieces:
    """Tangents of the elements of arms, as ``elastic.Elements.tangents`` gives them: by arm, piece and place across."""

    tangents: Float[np.ndarray, "elements 10 3 3 16 16"]
    pieces: int
    across: int

    @property
    def stiffness(self) -> Float[np.ndarray, "arms pieces 4 section 4 section"]:
        """Of every piece, by station and degree of freedom of its section."""
        given = self.tangents.reshape(-1, self.across, *self.tangents.shape[1:])
        nodes = 4 * (3 * self.across + 1)
        out = np.zeros((len(given), STATIONS, nodes, 3, STATIONS, nodes, 3))
        for pair, (p, r) in enumerate(STATION_PAIRS):
            for j in range(self.across):
                own = slice(12 * j, 12 * j + 16)
                block = given[:, j, pair].transpose(0, 3, 1, 4, 2)  # node, component, node, component
                out[:, p, own, :, r, own] += block
                if p != r:
                    out[:, r, own, :, p, own] += block.transpose(0, 3, 4, 1, 2)
        section = 3 * nodes
        return out.reshape(-1, self.pieces, STATIONS, section, STATIONS, section)


@dataclass(frozen=True, eq=False)
class Condensed:
    """Arms whose inside moves so that no force is left there.

    stiffness : of their ends, root first; gradient : what the forces inside add to those at the ends
    inner : motion of the two inner stations of every piece, turned round, per motion of its ends and by itself
    between : the same of the boundary at which piece 1, 2, ... begins, by the root, the boundary after it, and by itself
    """

    stiffness: Float[np.ndarray, "arms both both"]
    gradient: Float[np.ndarray, "arms both"]
    inner: Float[np.ndarray, "arms pieces both columns"]
    between: list[Float[np.ndarray, "arms section columns"]]

    def back(self, root: np.ndarray, end: np.ndarray) -> Float[np.ndarray, "arms stations section"]:
        """Motions of all stations, given those of the roots and the ends, (arms, section) each."""
        arms, pieces = self.inner.shape[:2]
        section = root.shape[1]
        out = np.empty((arms, 3 * pieces + 1, section))
        out[:, 0], out[:, -1] = root, end
        one = np.ones((arms, 1))
        for m in range(pieces - 1, 0, -1):
            given = np.concatenate([root, out[:, 3 * m + 3], one], axis=1)
            out[:, 3 * m] = -np.einsum("aij,aj->ai", self.between[m - 1], given)
        for m in range(pieces):
            given = np.concatenate([out[:, 3 * m], out[:, 3 * m + 3], one], axis=1)
            found = -np.einsum("aij,aj->ai", self.inner[:, m], given)
            out[:, 3 * m + 1 : 3 * m + 3] = found.reshape(arms, 2, section)
        return out


def condense(pieces: Pieces, gradient: Float[np.ndarray, "arms stations section"]) -> Condensed:
    """Condense arms under the gradient of the energy at their stations.

    Raises ``numpy.linalg.LinAlgError`` where what is condensed is not positive definite.
    """
    whole = pieces.stiffness
    arms, count, _, section = whole.shape[:4]
    inside = whole[:, :, 1:3][..., 1:3, :].reshape(arms, count, 2 * section, 2 * section)
    coupling = whole[:, :, 1:3][..., ::3, :].reshape(arms, count, 2 * section, 2 * section)
    ends = whole[:, :, ::3][..., ::3, :].reshape(arms, count, 2 * section, 2 * section)
    within = gradient[:, np.arange(count)[:, None] * 3 + [1, 2]].reshape(arms, count, -1)
    np.linalg.cholesky(inside)
    inner = np.linalg.solve(inside, np.concatenate([coupling, within[..., None]], axis=-1))
    reduced = -np.swapaxes(coupling, -1, -2) @ inner
    k = (ends + reduced[..., :-1]).reshape(arms, count, 2, section, 2, section)
    g = reduced[..., -1].reshape(arms, count, 2, section)
    first, link, last = k[:, 0, 0, :, 0], k[:, 0, 0, :, 1], k[:, 0, 1, :, 1]
    root, tip, between = g[:, 0, 0], g[:, 0, 1], []
    for m in range(1, count):
        middle, following = last + k[:, m, 0, :, 0], k[:, m, 0, :, 1]
        own = tip + g[:, m, 0] + gradient[:, 3 * m]
        np.linalg.cholesky(middle)
        x = np.linalg.solve(middle, np.concatenate([np.swapaxes(link, 1, 2), following, own[..., None]], axis=2))
        to_root, to_next, by_itself = x[..., :section], x[..., section:-1], x[..., -1]
        first, root = first - link @ to_root, root - np.einsum("aij,aj->ai", link, by_itself)
        back = np.swapaxes(following, 1, 2)
        last, tip = k[:, m, 1, :, 1] - back @ to_next, g[:, m, 1] - np.einsum("aij,aj->ai", back, by_itself)
        link = -link @ to_next
        between.append(x)
    stiffness = np.block([[first, link], [np.swapaxes(link, 1, 2), last]])
    return Condensed(stiffness, np.concatenate([root, tip], axis=1), inner, between)
