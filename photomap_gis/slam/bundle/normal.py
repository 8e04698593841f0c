"""The normal equations with the spots taken out: blocks of views that meet, a border, and their solution.

What fixes share is written with unknowns of its own, as a state of a drift beside each view and a bias of the flight:
taken out again they leave exactly the dense information of ``FixNoise``, which would join every view with every other.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from photomap_gis.core.similarity import FloatArray
from photomap_gis.slam.blocktri import BlockFactor, factor_strips
from photomap_gis.slam.bundle.fixes import FixNoise
from photomap_gis.slam.bundle.layout import POSE, Layout
from photomap_gis.slam.bundle.marks import MarkTerms
from photomap_gis.slam.bundle.problem import IntArray
from photomap_gis.slam.bundle.sums import put_blocks


@dataclass(frozen=True, eq=False)
class Normal:
    """``H step = -g``, written part by part as ``layout`` says.

    ``blocks`` ``(S, 6, 6)`` of views that meet, ``cross`` ``(N, 6, C)`` of views with the border, ``border``
    ``(C, C)``; ``g`` ``(N, 6)`` and ``g_border`` ``(C,)``. Of the drifts, along x and y alike: ``drift_own`` ``(F,)``,
    ``drift_view`` ``(F,)`` with the view's place, ``drift_bias`` ``(F,)`` with the bias, ``drift_next`` with the next
    of ``layout.steps``, and ``g_drift`` ``(F, 2)``. ``fix_of`` ``(F,)`` are the fixes' views, ``bias_of`` their
    columns.
    """

    layout: Layout
    blocks: FloatArray
    g: FloatArray
    cross: FloatArray
    border: FloatArray
    g_border: FloatArray
    fix_of: IntArray
    bias_of: IntArray
    drift_own: FloatArray
    drift_view: FloatArray
    drift_bias: FloatArray
    drift_next: FloatArray
    g_drift: FloatArray

    @classmethod
    def nothing(cls, layout: Layout, fix_of: IntArray, noise: FixNoise) -> Normal:
        """Return equations that say nothing yet."""
        n, c, f = len(layout.first), layout.border.size, len(fix_of)
        return cls(
            layout, np.zeros((len(layout.slots), POSE, POSE)), np.zeros((n, POSE)), np.zeros((n, POSE, c)),
            np.zeros((c, c)), np.zeros(c), fix_of, layout.border.bias(noise.flight), np.zeros(f), np.zeros(f),
            np.zeros(f), np.zeros(len(layout.steps[0])), np.zeros((f, 2)),
        )  # fmt: skip

    def add_fixes(self, noise: FixNoise, off: FloatArray) -> None:
        """Add fixes that cameras are ``off`` ``(F, 2)``, with the drift and the bias that they share."""
        known, drift, bias = 1.0 / noise.white_variance, noise.drift_sigma, noise.bias_sigma
        biased = np.flatnonzero(bias > 0.0)
        view, column, own = self.fix_of[biased], self.bias_of[biased], (known * bias)[biased]
        for axis in (0, 1):
            np.add.at(self.blocks[:, axis, axis], self.fix_of, known)
            np.add.at(self.g[:, axis], self.fix_of, known * off[:, axis])
            np.subtract.at(self.cross[:, axis], (view, column + axis), own)
            np.add.at(self.border, (column + axis, column + axis), own * bias[biased])
            np.subtract.at(self.g_border, column + axis, own * off[biased, axis])
        first = self.layout.border.seen
        unit = first + np.arange(2 * len(self.layout.border.flights))
        self.border[unit, unit] += 1.0
        self.drift_own[:] = known * drift**2
        self.drift_view[:] = -known * drift
        self.drift_bias[:] = known * drift * bias
        self.g_drift[:] = -(known * drift)[:, None] * off
        begins = drift > 0.0
        early, late, stays = self.layout.steps
        begins[late] = False
        self.drift_own[begins] += 1.0
        fresh = 1.0 / (1.0 - stays**2)
        self.drift_own[early] += fresh * stays**2
        self.drift_own[late] += fresh
        self.drift_next[:] = -fresh * stays

    def add_marks(self, view: IntArray, lens: IntArray, terms: MarkTerms) -> None:
        """Add known points that ``view`` ``(K,)`` show through ``lens`` ``(K,)``."""
        shared = self.layout.border.place
        for g, place in enumerate(terms.place):
            at = slice(shared(g), shared(g) + 2)
            self.border[at, at] += place
        for k, v in enumerate(view.tolist()):
            own, pose = terms.own[k], terms.by_view[k]
            columns, by = [2 * int(lens[k]), 2 * int(lens[k]) + 1], terms.by_lens[k]
            if (group := int(terms.group[k])) >= 0:
                columns += [shared(group), shared(group) + 1]
                by = np.concatenate([by, -np.eye(2)], axis=1)
            self.blocks[v] += pose.T @ own @ pose
            self.g[v] += pose.T @ own @ terms.residual[k]
            self.cross[v][:, columns] += pose.T @ own @ by
            self.border[np.ix_(columns, columns)] += by.T @ own @ by
            self.g_border[columns] += by.T @ own @ terms.residual[k]

    def without(self, columns: IntArray) -> Normal:
        """Return the equations with some columns of the border held where they are."""
        cross, border, g_border = self.cross.copy(), self.border.copy(), self.g_border.copy()
        cross[:, :, columns] = 0.0
        border[columns], border[:, columns], g_border[columns] = 0.0, 0.0, 0.0
        border[columns, columns] = 1.0
        return replace(self, cross=cross, border=border, g_border=g_border)

    def step(self, damping: float = 0.0) -> FloatArray:
        """Return the step ``(6 N + 2 L + K,)`` of views, lenses and bends; the diagonal grows by ``damping`` of itself.

        Raises ``numpy.linalg.LinAlgError`` where the equations have no single answer.
        """
        found = -self._factor(damping).solve(self.gradient)
        return self.told(found)

    def told(self, found: FloatArray) -> FloatArray:
        """Return what is asked for of values of all unknowns ``(n, ...)``: views in their order, lenses and bends."""
        w = self.layout.width
        return np.concatenate([found[self._pose_rows.ravel()], found[w : w + self.layout.border.seen]])

    @cached_property
    def factored(self) -> BlockFactor:
        """The factored equations; ``numpy.linalg.LinAlgError`` as ``step``."""
        return self._factor(0.0)

    def pose_covariances(self) -> FloatArray:
        """``(N, 6, 6)`` covariances of the views' steps."""
        return self.factored.inverse_diagonal(POSE, self.layout.first)

    def shared_covariance(self) -> tuple[FloatArray, FloatArray]:
        """Return ``(C, C)`` of lenses and bends, the border's first C columns, and ``(N, 6, C)`` of views with them."""
        seen, rows = self.layout.border.seen, self._pose_rows
        ones = np.zeros((self.layout.width + self.layout.border.size, seen))
        ones[self.layout.width + np.arange(seen), np.arange(seen)] = 1.0
        found = self.factored.solve(ones)
        return found[self.layout.width : self.layout.width + seen], found[rows]

    def joint_covariance(self) -> FloatArray:
        """``(6 N, 6 N)`` covariance of all views' steps together: for small flights."""
        rows = self._pose_rows.ravel()
        ones = np.zeros((self.layout.width + self.layout.border.size, len(rows)))
        ones[rows, np.arange(len(rows))] = 1.0
        return np.asarray(self.factored.solve(ones)[rows], np.float64)

    @property
    def gradient(self) -> FloatArray:
        """``(n,)`` of all unknowns in the layout's order."""
        w = self.layout.width
        out = np.zeros(w + self.layout.border.size)
        out[self._pose_rows] = self.g
        drifts = self.layout.drift >= 0
        for axis in (0, 1):
            out[self.layout.drift[drifts] + axis] = self.g_drift[drifts, axis]
        out[w:] = self.g_border
        return out

    @property
    def _pose_rows(self) -> IntArray:
        return self.layout.first[:, None] + np.arange(POSE)

    def _factor(self, damping: float) -> BlockFactor:
        layout = self.layout
        grown = np.concatenate([self._diagonal(), np.diag(self.border)]) * (1.0 + damping)
        scale = 1.0 / np.sqrt(np.maximum(grown, 1e-300))
        w, c = layout.width, layout.border.size
        border = self.border + damping * np.diag(np.diag(self.border))
        columns = np.concatenate([self._columns(), border]) * scale[:, None] * scale[w:]
        blocks = tuple(np.arange(s.begin, s.begin + s.size) for s in layout.slices)
        return factor_strips(blocks, np.arange(w, w + c), scale, self._strips(scale, damping), columns)

    def _diagonal(self) -> FloatArray:
        out = np.zeros(self.layout.width)
        out[self._pose_rows] = np.diagonal(self.blocks[: len(self.g)], axis1=1, axis2=2)
        drifts = self.layout.drift >= 0
        for axis in (0, 1):
            out[self.layout.drift[drifts] + axis] = self.drift_own[drifts]
        return out

    def _columns(self) -> FloatArray:
        """``(width, C)`` of all that comes before the border."""
        layout = self.layout
        out = np.zeros((layout.width, layout.border.size))
        out[self._pose_rows] = self.cross
        drifts = np.flatnonzero((layout.drift >= 0) & (self.drift_bias > 0.0))
        for axis in (0, 1):
            out[layout.drift[drifts] + axis, self.bias_of[drifts] + axis] = self.drift_bias[drifts]
        return out

    def _strips(self, scale: FloatArray, damping: float) -> Iterator[FloatArray]:
        """Yield each slice's rows of its own columns and of the next slice's, scaled."""
        numbers = np.concatenate([self.drift_own, self.drift_view, self.drift_next])
        for s in self.layout.slices:
            strip = np.zeros((s.size, s.width))
            put_blocks(s.slot, s.row, s.column, s.turned, self.blocks, strip)
            strip[s.scalar_row, s.scalar_column] = numbers[s.scalar]
            own = np.arange(s.size)
            strip[own, own] *= 1.0 + damping
            strip *= scale[s.begin : s.begin + s.size, None]
            strip *= scale[s.begin : s.begin + s.width]
            yield strip
