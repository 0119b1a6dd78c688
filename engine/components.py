"""Connected components of graphs."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from .arrays import Int


def components(count: int, a: Int[np.ndarray, " links"], b: Int[np.ndarray, " links"]) -> Int[np.ndarray, " nodes"]:
    """Return the connected component of every node, numbered from 0.

    Parameters
    ----------
    count : number of nodes
    a, b : ends of the links
    """
    links = coo_array((np.ones(len(a)), (a, b)), shape=(count, count))
    return connected_components(links, directed=False)[1]
