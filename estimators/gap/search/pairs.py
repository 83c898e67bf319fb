"""Pairs of effects that explain together what neither does alone.

A forward search extends the effects that lead. Where one effect does what two others do together, as the eccentricity
of a joint does what its scale and its droop do, these two are far behind one by one. So they are where two others do it
together: either of these two beside one of the others is worse.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from estimators.gap.data.projection import side_by_side
from estimators.gap.hypotheses.scan import Look, ScoreTest
from estimators.gap.hypotheses.score import ABSORBED, Explained, evidence
from rig.arrays import Array

#: So many effects are tried two by two in the place of one, and so many of these pairs are fitted.
_PAIRED, _PAIRS = 32, 2
#: A direction of the second effect of which the first leaves less than this share of its square is the first's.
_SAME: Final = 1e-3


def likely_pairs(
    priced: Sequence[tuple[float, list[ScoreTest]]], least: float, look: Look, explained: Explained
) -> list[tuple[list[ScoreTest], list[ScoreTest]]]:
    """The two effects each, with the places at which they do the same, that promise most together.

    Args:
        priced: log prices and score tests, the most evident first. least: log odds that a pair must promise.
        look: of means over neighbouring samples, which both must outlive. explained: in it.
    """
    some = [each for each in priced if each[1][0].candidate.smooth][:_PAIRED]
    prices = np.array([price for price, _ in some])
    gains = 0.5 * paired([group[0] for _, group in some], look, explained)
    promises = np.triu(gains + prices[:, None] + prices, 1)
    leading = [index for index in np.argsort(-promises, axis=None)[:_PAIRS] if promises.flat[index] > max(least, 0.0)]
    return [(some[index // len(some)][1], some[index % len(some)][1]) for index in leading]


def paired(tests: Sequence[ScoreTest], look: Look, explained: Explained) -> Array:
    """(m, m) evidence of every two of some score tests together, each at its own shape, as ``Score.evidence``.

    Args:
        look: the data that the candidates were tested on. explained: what is explained already.
    """
    if len(tests) < 2:
        return np.zeros((len(tests), len(tests)))
    bases = [_basis(tested, look, explained) for tested in tests]
    ranks = np.array([basis.shape[1] for basis in bases])
    starts, widest = np.cumsum(ranks) - ranks, int(ranks.max(initial=0))
    every = side_by_side(*bases)
    del bases
    moment, shared = every.T @ explained.residual, every.T @ every
    # the blocks of each effect, all as wide as the widest
    index = starts[:, None] + np.arange(widest)
    there = np.arange(widest) < ranks[:, None]
    index = np.where(there, index, 0)
    own = np.where(there, moment[index], 0.0)
    found = np.zeros((len(tests), len(tests)))
    for number, first in enumerate(starts):
        taken = slice(first, first + ranks[number])
        overlap = np.where(there[:, :, None], shared[index][:, :, taken], 0.0)  # (m, widest, r)
        left = own - overlap @ moment[taken]
        values, vectors = np.linalg.eigh(there[:, :, None] * np.eye(widest) - overlap @ overlap.transpose(0, 2, 1))
        kept = values > _SAME
        along = np.einsum("mij,mi->mj", vectors, left)
        further = np.where(kept, along**2 / np.where(kept, values, 1.0), 0.0).sum(axis=1)
        statistic = moment[taken] @ moment[taken] + further
        together = ranks[number] + kept.sum(axis=1)
        found[number] = [evidence(float(each), int(rank)) for each, rank in zip(statistic, together, strict=True)]
    return found


def _basis(tested: ScoreTest, look: Look, explained: Explained) -> Array:
    """(c n, r) orthonormal, of what is not explained already."""
    full = look.columns(tested.candidate, tested.shape).full(look.data.size)
    length = np.maximum(np.linalg.norm(full, axis=0), 1e-100)
    full = explained.without(full / length)
    values, vectors = np.linalg.eigh(full.T @ full)
    kept = values > ABSORBED**2
    return np.asarray(full @ (vectors[:, kept] / np.sqrt(values[kept])))
