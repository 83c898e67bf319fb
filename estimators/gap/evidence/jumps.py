"""An error source that jumps from level to level at unknown instants, again and again: a contact, a range that
switches, readings that are lost from a buffer, burst noise.

Which sources jump is told by binary segmentation (Scott and Knott, Biometrics 30, 1974); when, by optimal partitioning
(Jackson et al., IEEE Signal Processing Letters 12, 2005).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import lgamma, log
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.terms import Term, terms_along
from estimators.gap.hypotheses.courses import Course
from estimators.gap.hypotheses.sources import Source

Array = NDArray[np.float64]

#: Where the catalogue has single steps, fewer jumps are such ones, each a cause of its own. More are not followed.
_STEPS, _MOST = 4, 64
#: So many splits one by one, which overlook a level that is left and taken up again, are looked at again together.
_SUSPECT: Final = 2
#: After so many samples each.
_DROPPED: Final = 16
#: Together they explain up to so much more than one by one.
_TOGETHER: Final = 1.5
#: So many sources are weighed with their jumps.
_SOURCES: Final = 2


@dataclass(frozen=True)
class Jumps:
    """What sources would leave of jumps.

    Attributes:
        data: sample by sample. every: the sources of it. shares: of each the log prior of one course.
        stepping: names of the sources of which the catalogue has single steps.
    """

    data: WhitenedData
    every: Sequence[Source]
    shares: Sequence[float]
    stepping: frozenset[str] = frozenset()

    @cached_property
    def _roots(self) -> list[Array]:
        """(f, f) of each source: what makes its freedoms alike and independent, over the whole recording."""
        found = []
        for source in self.every:
            values, vectors = np.linalg.eigh(np.einsum("icn,jcn->ij", source.series, source.series) / self.data.count)
            kept = values > 1e-9 * values[-1]
            found.append(vectors[:, kept] / np.sqrt(values[kept]))
        return found

    def terms(self, left: Array, least: float = -np.inf) -> list[Term]:
        """The sources that explain most of a residual, each with the jumps that do.

        Args:
            left: (c n,) whitened, with the calibration projected out.
            least: log mass below which a term is not made.
        """
        count = self.data.count
        residual = left.reshape(len(self.data.columns), count)
        found = []
        for source, root, share in zip(self.every, self._roots, self.shares, strict=True):
            moment = np.einsum("fcn,cn->nf", source.series, residual) @ root
            # one freedom: what each sample tells; several tell about as much wherever the arm points
            told = np.sum(source.series[0] ** 2, axis=0) * root[0, 0] ** 2 if len(root) == 1 else np.ones(count)
            fewest = _STEPS if source.name in self.stepping else 1
            if len(at := roughly(moment, told)) >= min(_SUSPECT, fewest):
                found.append((_explained(moment, told, at), fewest, source, share, (moment, told)))
        terms = []
        for explained, fewest, source, share, level in sorted(found, key=lambda each: -each[0])[:_SOURCES]:
            at = best(*level) if 0.5 * _TOGETHER * explained + share > least else []
            if fewest <= len(at) <= _MOST:
                number = np.searchsorted(at, np.arange(count), side="right")
                values = (number[:, None] == np.arange(len(at) + 1)).astype(float)
                course = Course(f"time, in {len(at)} jumps", values, np.ones(len(at) + 1))
                prior = share - len(at) * log(count) + lgamma(len(at) + 1.0)
                terms += terms_along(self.data.absorbed, source, course, prior)
        return terms


def roughly(moment: Array, information: Array) -> list[int]:
    """Where levels change, by binary segmentation: ever the split that explains most.

    Args:
        moment: (n, f) of each sample, of levels that are independent of each other.
        information: (n,) what each sample tells of each.
    """
    sums = _sums(moment), _sums(information)
    at: list[int] = []
    open_ = {(0, len(moment)): _split(*sums, 0, len(moment))}
    while len(at) < _MOST:
        (first, end), (gain, middle) = max(open_.items(), key=lambda item: item[1][0])
        if gain < _price(moment):
            break
        del open_[first, end]
        at.append(middle)
        open_[first, middle], open_[middle, end] = _split(*sums, first, middle), _split(*sums, middle, end)
    return sorted(at)


def best(moment: Array, information: Array) -> list[int]:
    """Where levels change, by optimal partitioning; instants that can begin no level any more are dropped (Killick,
    Fearnhead and Eckley, Journal of the American Statistical Association 107, 2012)."""
    moments, informations = _sums(moment), np.maximum(_sums(information), 1e-300)
    count, price = len(moment), _price(moment)
    reached, last = np.zeros(count + 1), np.zeros(count + 1, dtype=np.intp)
    open_ = np.zeros(1, dtype=np.intp)
    for end in range(1, count + 1):
        every = reached[open_] + 0.5 * _square(moments[end] - moments[open_], informations[end] - informations[open_])
        likeliest = int(np.argmax(every))
        last[end], reached[end] = open_[likeliest], every[likeliest] - price
        if end % _DROPPED == 0:
            open_ = open_[every >= reached[end]]
        open_ = np.append(open_, end)
    at: list[int] = []
    end = int(last[count])
    while end > 0:
        at.append(end)
        end = int(last[end])
    return sorted(at)


def _explained(moment: Array, information: Array, at: Sequence[int]) -> float:
    """Twice the log likelihood that levels between instants explain, less the price of these."""
    ends = [0, *at]
    square = _square(np.add.reduceat(moment, ends), np.add.reduceat(information, ends))
    return float(square.sum()) - 2.0 * len(at) * _price(moment)


def _price(moment: Array) -> float:
    """What a chance jump of (n, f) gains at most, the largest of all samples, and no less than its instant costs."""
    return log(len(moment)) + 1.0 + int(moment.shape[1])


def _sums(values: Array) -> Array:
    return np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])


def _square(moment: Array, information: Array) -> Array:
    """(m,) what levels explain, of moments (m, f) and information (m,)."""
    square = moment[:, 0] ** 2
    for other in moment.T[1:]:
        square += other**2
    return np.asarray(square / np.maximum(information, 1e-300))


def _split(moments: Array, informations: Array, first: int, end: int) -> tuple[float, int]:
    """The best instant between two samples, and its gain in log likelihood."""
    if end - first < 2:
        return -np.inf, first
    moment, information = moments[first : end + 1] - moments[first], informations[first : end + 1] - informations[first]
    two = _square(moment[1:-1], information[1:-1])
    two += _square(moment[-1] - moment[1:-1], information[-1] - information[1:-1])
    middle = int(np.argmax(two))
    return 0.5 * float(two[middle] - _square(moment[-1:], information[-1:])[0]), first + middle + 1
