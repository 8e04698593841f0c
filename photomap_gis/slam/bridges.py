"""Edges on which everything hangs, put to the test of the fixes.

No loop can speak against a bridge (an edge whose loss would cut its component in two), so a false one turns half the
map. The fixes can: the frames on one side, aligned to theirs, say where the frames across must be. The test is
wide on purpose (blunders, lag and drift of a plain GPS pass): cutting a good bridge tears a map.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from photomap_gis.core.similarity import FloatArray
from photomap_gis.slam.anchor import Fit, align
from photomap_gis.slam.components import IntArray
from photomap_gis.slam.initial import RelativePoses
from photomap_gis.slam.problem import ComplexArray, EdgeTerms, PositionTerms
from photomap_gis.slam.robust import REJECTED_BELOW

REACH = 40
"""How many frames with a fix on each side are heard: farther ones tell more of drift than of the bridge."""
CONTRADICTED_SIGMA = 4.5
SAMPLES_WORTH = 12.0
BLUNDER_SIGMA = 10.0
SAMPLES = 60


def contradicted_bridges(
    relative: RelativePoses, edges: EdgeTerms, positions: PositionTerms, judged: dict[bytes, float] | None = None
) -> IntArray:
    """Return the rows of bridges that the fixes on their two sides speak against, the worst one of each component.

    A false bridge throws doubt on good ones near it: judge those again once it is gone. ``judged`` keeps what was found
    of two sides from one time to the next; a bridge whose sides are the same frames as before hangs as it did.
    """
    judged = {} if judged is None else judged
    if len(positions) < 3:
        return np.zeros(0, np.intp)
    trusted = np.flatnonzero(relative.edge_weights > REJECTED_BELOW)
    neighbours: list[list[tuple[int, int]]] = [[] for _ in relative.w]
    for k in trusted.tolist():
        a, b = int(edges.a[k]), int(edges.b[k])
        neighbours[a].append((b, k))
        neighbours[b].append((a, k))
    fixes = {int(node): k for k, node in enumerate(positions.node)}
    worst: dict[int, tuple[float, int]] = {}
    for k in bridges(neighbours):
        a, b = int(edges.a[k]), int(edges.b[k])
        sides = [np.array([fixes[n] for n in _near(neighbours, start, k, fixes)], np.intp) for start in (a, b)]
        both = b"|".join(side.tobytes() for side in sides)
        if both not in judged:
            judged[both] = _doubt(relative.t, positions, *sides)
        doubt = judged[both]
        component = int(relative.labels[a])
        if doubt > max(CONTRADICTED_SIGMA, worst.get(component, (0.0, 0))[0]):
            worst[component] = (doubt, k)
    return np.array(sorted(k for _, k in worst.values()), np.intp)


def bridges(neighbours: list[list[tuple[int, int]]]) -> list[int]:
    """Return the edges whose loss cuts their component, by depth-first lowest reach (Tarjan), without recursion.

    ``neighbours[node]`` lists (other node, edge); parallel edges are told apart by their number.
    """
    n = len(neighbours)
    entered, lowest = [-1] * n, [0] * n
    out: list[int] = []
    clock = 0
    for root in range(n):
        if entered[root] >= 0:
            continue
        entered[root] = lowest[root] = clock
        clock += 1
        stack = [(root, -1, iter(neighbours[root]))]
        while stack:
            node, by, ways = stack[-1]
            for other, edge in ways:
                if edge == by:
                    continue
                if entered[other] >= 0:
                    lowest[node] = min(lowest[node], entered[other])
                    continue
                entered[other] = lowest[other] = clock
                clock += 1
                stack.append((other, edge, iter(neighbours[other])))
                break
            else:
                stack.pop()
                if stack:
                    parent = stack[-1][0]
                    lowest[parent] = min(lowest[parent], lowest[node])
                    if lowest[node] > entered[parent]:
                        out.append(by)
    return sorted(out)


def _near(neighbours: list[list[tuple[int, int]]], start: int, barred: int, fixes: dict[int, int]) -> list[int]:
    """Return up to ``REACH`` nodes with a fix, breadth first from ``start``, never over the barred edge."""
    seen, queue = {start}, deque([start])
    out: list[int] = []
    while queue and len(out) < REACH:
        node = queue.popleft()
        if node in fixes:
            out.append(node)
        for other, edge in neighbours[node]:
            if edge != barred and other not in seen:
                seen.add(other)
                queue.append(other)
    return out


def _doubt(t: ComplexArray, positions: PositionTerms, *sides: IntArray) -> float:
    """By how many sigmas the fixes of two sides are better off without the edge between them; 0 if they cannot say.

    One similarity for all against one a side (Chow's test). Fixes near in time share their error, so that all
    together count for ``SAMPLES_WORTH``; what they miss their own side's fit by widens the sigmas. A side of few fixes
    has no turn and scale of its own: the other side then lends it those, and is asked alone.
    """
    both = np.concatenate(sides)
    points, fixes, sigma = t[positions.node], positions.z_m, positions.sigma_m
    worth = min(1.0, SAMPLES_WORTH / max(1, len(both)))

    def squares(fit: Fit, rows: IntArray) -> FloatArray:
        miss = np.abs(fit.z * points[rows] + fit.t - fixes[rows]) / sigma[rows]
        return np.minimum(miss, BLUNDER_SIGMA) ** 2

    def fitted(rows: IntArray) -> Fit | None:
        return align(points[rows], fixes[rows], sigma[rows], samples=SAMPLES)

    def place(rows: IntArray, like: Fit) -> Fit:
        off = fixes[rows] - like.z * points[rows]
        return Fit(like.z, complex(np.median(off.real), np.median(off.imag)))

    if not all(map(len, sides)) or max(map(len, sides)) < 4:
        return 0.0
    joint = fitted(both)
    together = np.inf if joint is None else float(squares(joint, both).sum())
    if together * worth <= CONTRADICTED_SIGMA**2:
        return 0.0  # no room for a gain: most bridges end here
    own = [fitted(rows) if len(rows) >= 4 else None for rows in sides]
    doubt = 0.0
    for (here, there), (one, other) in ((sides, own), (sides[::-1], own[::-1])):
        if one is None:
            continue
        across = other or place(there, one)
        apart = np.concatenate([squares(one, here), squares(across, there)])
        whole = min([together, *(float(squares(fit, both).sum()) for fit in (one, across))])
        gain = max(0.0, whole - float(apart.sum())) * worth
        doubt = max(doubt, float(np.sqrt(gain / max(1.0, float(apart.mean()) / 2.0))))
    return doubt
