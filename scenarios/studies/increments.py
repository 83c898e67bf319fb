"""Sufficient statistics at many sample counts in one pass, and exact draws of them without drawing a sample.

With readings V = mu + e, rows A = [vec R, 1, mu] of the samples that are taken between two counts, and A = Q T (QR),
white noise e gives A^T e = T^T z with z = Q^T e normal, and e^T e = z^T z + rest, where the rest is chi-square with as
many degrees of freedom as there are rows beyond those of T, and independent of z. So the increments of X^T V and V^T V
from one count to the next are drawn exactly, jointly and independently of each other; sums over increments are the
statistics at every count, correlated from count to count as those of one growing data set are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from estimators.known_angle.statistics import ROTATION_TERMS
from rig.arrays import Array, Rows


@dataclass(frozen=True, eq=False)
class Increments:
    """What n samples say without noise, at growing n, and what noise adds from one n to the next.

    Attributes:
        counts: (c,) n, growing.
        gram: (c, 10, 10) sum of x x^T, x = [vec R_base_tool by rows, 1].
        cross: (c, 10, 3) sum of x mu^T [recorded unit].
        square: (c, 3) sum of mu^2 [recorded unit squared].
        roots: c upper triangles T (r, 13) of the increments' rows, r = min(rows, 13).
        sizes: (c,) rows of each increment.
    """

    counts: tuple[int, ...]
    gram: Array
    cross: Array
    square: Array
    roots: tuple[Array, ...]
    sizes: tuple[int, ...]

    @classmethod
    def of(cls, rotations: Array, readings: Array, rows: Rows, counts: Sequence[int]) -> Self:
        """Sum over samples in a given order.

        Args:
            rotations: (n, 9) vec R_base_tool by rows.
            readings: (n, 3) without noise [recorded unit].
            rows: the order in which samples are taken.
            counts: numbers of samples, growing, at most len(rows).
        """
        k = ROTATION_TERMS
        table = np.hstack([rotations, np.ones((len(rotations), 1)), readings])[rows[: counts[-1]]]
        total = np.zeros((table.shape[1],) * 2)
        sums: list[Array] = []
        roots: list[Array] = []
        start = 0
        for stop in counts:
            part = table[start:stop]
            total = total + part.T @ part
            sums.append(total)
            roots.append(np.asarray(np.linalg.qr(part, mode="r")))
            start = stop
        stacked = np.stack(sums)
        sizes = np.diff([0, *counts])
        square = np.einsum("ckk->ck", stacked[:, k:, k:])
        return cls(
            tuple(counts), stacked[:, :k, :k], stacked[:, :k, k:], square, tuple(roots), tuple(int(m) for m in sizes)
        )

    def draw(self, rng: np.random.Generator, noise: ArrayLike, draws: int) -> tuple[Array, Array]:
        """Statistics of ``draws`` data sets with white Gaussian noise at every count.

        Args:
            rng: source of the draws.
            noise: (3,) standard deviation [recorded unit].
            draws: m.

        Returns:
            cross (c, m, 10, 3) and square (c, m, 3), as of ``Statistics``.
        """
        sigma = np.asarray(noise, dtype=float)
        cross = np.empty((len(self.counts), draws, ROTATION_TERMS, 3))
        square = np.empty((len(self.counts), draws, 3))
        for index, (root, size) in enumerate(zip(self.roots, self.sizes, strict=True)):
            z = sigma * rng.standard_normal((draws, len(root), 3))
            projected = np.einsum("rp,mrk->mpk", root, z)
            own = np.einsum("rk,mrk->mk", root[:, ROTATION_TERMS:], z)
            rest = size - len(root)
            outside = sigma**2 * rng.chisquare(rest, (draws, 3)) if rest > 0 else 0.0
            cross[index] = projected[:, :ROTATION_TERMS]
            square[index] = 2.0 * own + np.square(z).sum(axis=1) + outside
        np.cumsum(cross, axis=0, out=cross)
        np.cumsum(square, axis=0, out=square)
        cross += self.cross[:, None]
        square += self.square[:, None]
        return cross, square
