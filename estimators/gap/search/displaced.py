"""Causes that something without a name may be instead of, several at once.

Steps that follow each other may be a drift, dipoles a field that is not uniform: without one of them that is less
likely, without all it is likelier.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final

import numpy as np

from estimators.gap.evidence.discrepancy import Discrepancies
from estimators.gap.evidence.terms import every_along
from estimators.gap.search.explanation import Explanation, Member
from rig.arrays import Array

#: Sets of more than this many causes are not weighed without each of them and without all in any case.
FEW: Final = 2
#: So many sets at most, and the log odds that they must promise, to first order, against the set itself.
_MOST, _HOPELESS = 2, -14.0
#: What means over neighbours may lose of what a source explains, as a share.
_LOST: Final = 0.02


def displaced(
    each: Explanation, rests: Sequence[Explanation], discrepancies: Discrepancies
) -> list[tuple[Member, ...]]:
    """A set without causes in whose place one source along one course would be likeliest, the most promising first.

    Args:
        each: the set. rests: the same without each of its causes.
    """
    columns = np.column_stack([each.linear.left, *each.changes])
    costs, whole = _costs(each, rests), columns.T @ columns
    promises: dict[frozenset[int], float] = {}
    for term, along in zip(discrepancies.terms, every_along(discrepancies.terms, columns), strict=True):
        shrunk, determinants = term.shrunk
        explained = np.matmul(along.T * shrunk[:, None], along)  # (steps, k + 1, k + 1), what is left first
        order = np.argsort(-np.diag(explained[-1])[1:] / np.maximum(np.diag(whole)[1:], 1e-300))
        # what remains where the causes go one after another, those first that the term explains best
        kept = np.ix_(np.append(0, 1 + order), np.append(0, 1 + order))
        remains = 0.5 * (whole[kept] - explained[:, kept[0], kept[1]])
        remains = np.einsum("sii->si", remains.cumsum(axis=1).cumsum(axis=2))[:, FEW:] - 0.5 * whole[0, 0]
        remains -= _LOST * 0.5 * np.diag(whole[kept].cumsum(axis=0).cumsum(axis=1))[FEW:]
        promise = costs[order].cumsum()[FEW - 1 :] - remains - 0.5 * determinants[:, None] + term.log_prior
        for count, best in enumerate(promise.max(axis=0), start=FEW):
            gone = frozenset(order[:count].tolist())
            promises[gone] = max(float(best), promises.get(gone, _HOPELESS))
    likeliest = sorted((gone for gone in promises if promises[gone] > _HOPELESS), key=lambda gone: -promises[gone])
    return [tuple(one for index, one in enumerate(each.members) if index not in gone) for gone in likeliest[:_MOST]]


def _costs(each: Explanation, rests: Sequence[Explanation]) -> Array:
    """(k,) what each cause costs: the prior, and the width of its parameters."""
    square = float(each.linear.left @ each.linear.left)
    costs = {}
    for rest in rests:
        (label,) = (Counter(each.key) - Counter(rest.key)).elements()
        explained = 0.5 * (float(rest.linear.left @ rest.linear.left) - square)
        costs[label] = explained - (each.log_mass - rest.log_mass)
    return np.array([costs[member.label] for member in each.members])
