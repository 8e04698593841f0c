"""Which nodes hang together."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse import csgraph

IntArray = npt.NDArray[np.intp]


def component_labels(n_nodes: int, a: IntArray, b: IntArray) -> IntArray:
    """``(n,)`` component of every node, numbered by the lowest node in it; ``a``, ``b`` are the edges' ends."""
    links = sparse.coo_array((np.ones(len(a)), (a, b)), shape=(n_nodes, n_nodes))
    _, label = csgraph.connected_components(links, directed=False)
    _, first = np.unique(label, return_index=True)
    rank = np.empty(len(first), np.intp)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[label]


def by_size(labels: IntArray) -> IntArray:
    """Renumber components so that the largest is 0; equal sizes keep the order of their lowest node."""
    if not len(labels):
        return labels
    size = np.bincount(labels)
    rank = np.empty(len(size), np.intp)
    rank[np.argsort(-size, kind="stable")] = np.arange(len(size))
    return rank[labels]
