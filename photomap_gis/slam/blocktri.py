"""A direct solver for the normal equations of a map: block-tridiagonal elimination, with the inverse's diagonal.

A flight's frames tie to near frames only, so the breadth-first levels of the graph from a far frame form a chain:
level k touches k - 1 and k + 1 and nothing else. Eliminating level by level costs dense algebra on small blocks, and
the backward sweep gives every pose's covariance for little more than the solution (one sparse solve a column would
cost thousands of solves). Unknowns that touch everything (a flight's GPS bias) are kept apart as a border.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.linalg import blas, cho_solve, lapack, solve_triangular
from scipy.sparse import csgraph

from photomap_gis.core.similarity import FloatArray

IntArray = npt.NDArray[np.intp]

BLOCK_SIZE = 96
"""Levels are joined until a block has at least this many unknowns: smaller ones spend their time in Python."""


@dataclass(frozen=True, slots=True, eq=False)
class BlockFactor:
    """A factored symmetric positive definite matrix: chain of ``blocks`` (index arrays) and the ``border`` after it.

    ``scale`` brings the matrix to unit diagonal; ``chol[k]`` is the lower factor of the k-th Schur complement,
    ``carry[k] = chol[k]^-1 H[k, k+1]``. ``border_solution`` is ``A^-1 C``, ``border_chol`` that of its complement.
    """

    blocks: tuple[IntArray, ...]
    border: IntArray
    scale: FloatArray
    chol: tuple[FloatArray, ...]
    carry: tuple[FloatArray, ...]
    border_solution: FloatArray
    border_chol: FloatArray

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Return ``H^-1 rhs`` for right-hand sides ``(n,)`` or ``(n, m)``."""
        b = rhs.reshape(len(rhs), -1) * self.scale[:, None]
        x = np.zeros_like(b)
        inner = np.ones(len(b), bool)
        inner[self.border] = False
        if len(self.border):
            y = b[self.border] - self.border_solution.T @ b[inner]
            x[self.border] = cho_solve((self.border_chol, True), y)
        x[inner] = self._solve_chain(b)[inner] - self.border_solution @ x[self.border]
        return (x * self.scale[:, None]).reshape(rhs.shape)

    def _solve_chain(self, b: FloatArray) -> FloatArray:
        """Solve with the chain alone for ``(n, m)`` scaled right-hand sides; border rows are left 0."""
        return _solve_chain(self.blocks, self.chol, self.carry, b)

    def inverse_diagonal(self, size: int, first: IntArray) -> FloatArray:
        """``(len(first), size, size)`` diagonal blocks of the inverse at rows ``first ... first + size - 1``.

        The rows of a diagonal block must lie in one block of the chain (those of a pose do) or all in the border.
        """
        n = len(self.scale)
        where, place = np.full(n, -1), np.zeros(n, np.intp)
        for k, block in enumerate(self.blocks):
            where[block], place[block] = k, np.arange(len(block))
        out = np.empty((len(first), size, size))
        rows = first[:, None] + np.arange(size)
        z: FloatArray = np.zeros((0, 0))
        asked = where[first]
        last = int(asked[asked >= 0].min()) if (asked >= 0).any() else len(self.blocks)
        for k in range(len(self.blocks) - 1, last - 1, -1):
            lower = self.chol[k]
            own = lapack.dpotri(lower, lower=1)[0]
            own += np.tril(own, -1).T
            if self.carry[k].size:
                g = blas.dtrsm(1.0, lower, self.carry[k], lower=1, trans_a=1)
                own += (g @ z) @ g.T
            z = own
            here = np.flatnonzero(where[first] == k)
            index = place[rows[here]]
            out[here] = z[index[:, :, None], index[:, None, :]]
        if len(self.border):
            inverse_border = cho_solve((self.border_chol, True), np.eye(len(self.border)))
            inner = np.full(n, -1)
            inner[np.setdiff1d(np.arange(n), self.border)] = np.arange(n - len(self.border))
            chain = where[first] >= 0
            y = self.border_solution[inner[rows[chain]]]
            out[chain] += y @ inverse_border @ y.transpose(0, 2, 1)
            index = np.searchsorted(self.border, rows[~chain])
            out[~chain] = inverse_border[index[:, :, None], index[:, None, :]]
        s = self.scale[rows]
        return out * s[:, :, None] * s[:, None, :]


def factor(H: sparse.csc_array, border: IntArray, *, group: IntArray | None = None) -> BlockFactor:
    """Factor a symmetric positive definite ``H``; ``border`` are the (sorted) unknowns that touch everything.

    Unknowns of a ``group`` (``(n,)`` its number for each, those of the border too) stay in one block, coupled or not:
    a pose that hangs on nothing but its own fix and compass has a place and a heading that know nothing of each other.

    Raises ``numpy.linalg.LinAlgError`` where H is not positive definite: something is tied to nothing.
    """
    diagonal = H.diagonal()
    if not np.all(diagonal > 0):
        raise np.linalg.LinAlgError("an unknown is tied to nothing")
    scale = 1.0 / np.sqrt(diagonal)
    blocks = _chain_of_blocks(H, border, np.arange(H.shape[0]) if group is None else group)
    order = np.concatenate([*blocks, border]).astype(np.intp)
    ordered = sparse.csr_array(H)[order][:, order]
    s = scale[order]
    starts = np.cumsum([0, *(len(b) for b in blocks)])

    def strips() -> Iterator[FloatArray]:
        for k in range(len(blocks)):
            a, b = starts[k], starts[k + 1]
            c = starts[k + 2] if k + 2 < len(starts) else b
            yield ordered[a:b, a:c].toarray() * s[a:b, None] * s[None, a:c]

    columns = np.asarray(H[:, border].toarray()) * scale[:, None] * scale[border]
    return factor_strips(blocks, border, scale, strips(), columns)


def factor_strips(
    blocks: tuple[IntArray, ...], border: IntArray, scale: FloatArray, strips: Iterable[FloatArray], columns: FloatArray
) -> BlockFactor:
    """Factor a matrix that is told part by part and scaled already.

    ``strips`` are the rows of each block, of its own columns and of the next block's; ``columns`` ``(n, m)`` those of
    the border. Raises ``numpy.linalg.LinAlgError`` where the matrix is not positive definite.
    """
    chol: list[FloatArray] = []
    carry: list[FloatArray] = []
    for strip in strips:
        own = len(strip)
        block = np.asfortranarray(strip[:, :own])
        if carry:
            block = blas.dsyrk(-1.0, carry[-1], beta=1.0, c=block, trans=1, lower=1, overwrite_c=1)
        lower, failed = lapack.dpotrf(block, lower=1, clean=1, overwrite_a=1)
        if failed:
            raise np.linalg.LinAlgError("the matrix is not positive definite")
        chol.append(lower)
        carry.append(blas.dtrsm(1.0, lower, np.asfortranarray(strip[:, own:]), lower=1, overwrite_b=1))
    n, m = len(scale), len(border)
    if not m:
        return BlockFactor(blocks, border, scale, tuple(chol), tuple(carry), np.zeros((n, 0)), np.zeros((0, 0)))
    inner = np.setdiff1d(np.arange(n), border)
    solution = _solve_chain(blocks, chol, carry, columns)[inner]
    complement = columns[border] - columns[inner].T @ solution
    border_chol = np.asarray(np.linalg.cholesky((complement + complement.T) / 2.0), np.float64)
    return BlockFactor(blocks, border, scale, tuple(chol), tuple(carry), solution, border_chol)


def _solve_chain(
    blocks: tuple[IntArray, ...], chol: list[FloatArray] | tuple[FloatArray, ...],
    carry: list[FloatArray] | tuple[FloatArray, ...], b: FloatArray,
) -> FloatArray:  # fmt: skip
    """Forward and backward substitution along the chain for ``(n, m)`` right-hand sides."""
    x = np.zeros_like(b)
    y: list[FloatArray] = []
    for k, block in enumerate(blocks):
        r = b[block] - (carry[k - 1].T @ y[-1] if k and carry[k - 1].size else 0.0)
        y.append(solve_triangular(chol[k], r, lower=True, check_finite=False))
    later: FloatArray = np.zeros((0, b.shape[1]))
    for k in range(len(blocks) - 1, -1, -1):
        r = y[k] - (carry[k] @ later if carry[k].size else 0.0)
        later = solve_triangular(chol[k], r, lower=True, trans="T", check_finite=False)
        x[blocks[k]] = later
    return x


def _chain_of_blocks(H: sparse.csc_array, border: IntArray, group: IntArray) -> tuple[IntArray, ...]:
    """Cut all groups of unknowns but the border into blocks that touch only their neighbours in the sequence."""
    n = H.shape[0]
    inner = np.ones(n, bool)
    inner[border] = False
    index = np.flatnonzero(inner)
    numbers, group = np.unique(group[index], return_inverse=True)
    entries = sparse.coo_array(sparse.csr_array(H)[index][:, index])
    touching = (group[entries.row], group[entries.col])
    pattern = sparse.csr_array((np.ones(len(group[entries.row])), touching), shape=(len(numbers), len(numbers)))
    size = np.bincount(group)
    count, label = csgraph.connected_components(pattern, directed=False)
    levels: list[IntArray] = []
    for component in range(count):
        members = np.flatnonzero(label == component)
        level = _levels(pattern, int(members[0]))
        # a level structure from one end is narrower than from the middle
        far = members[np.argmax(level[members])]
        level = _levels(pattern, int(far))[members]
        order = np.argsort(level, kind="stable")
        cuts = np.flatnonzero(np.diff(level[order])) + 1
        levels.extend(np.split(members[order], cuts))
    blocks: list[list[IntArray]] = [[]]
    for members in levels:
        if blocks[-1] and sum(int(size[m].sum()) for m in blocks[-1]) >= BLOCK_SIZE:
            blocks.append([])
        blocks[-1].append(members)
    block_of = np.empty(len(numbers), np.intp)
    for k, block in enumerate(blocks):
        block_of[np.concatenate([*block, np.zeros(0, np.intp)])] = k
    order = np.argsort(block_of[group], kind="stable")
    cuts = np.flatnonzero(np.diff(block_of[group][order])) + 1
    return tuple(index[part] for part in np.split(order, cuts) if len(part))


def _levels(pattern: sparse.csr_array, start: int) -> IntArray:
    """``(n,)`` breadth-first distance from ``start``; -1 where it cannot be reached."""
    order, predecessor = csgraph.breadth_first_order(pattern, start, directed=False)
    level = np.full(pattern.shape[0], -1, np.intp)
    level[start] = 0
    for node in order[1:]:
        level[node] = level[predecessor[node]] + 1
    return level
