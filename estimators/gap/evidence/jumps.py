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
from scipy.ndimage import maximum_filter1d
from typing_extensions import override

from estimators.gap.evidence.fitted_courses import FittedCourses, worth
from estimators.gap.evidence.jumps_in_drift import StepsInDrift, scores
from estimators.gap.evidence.terms import Term, terms_along
from estimators.gap.hypotheses.courses import Course
from estimators.gap.hypotheses.sources import Source
from rig.arrays import Array

#: Where the catalogue has single steps, fewer jumps are such ones, each a cause of its own. More are not followed.
_STEPS, _MOST = 4, 64
#: So many splits one by one, which overlook a level that is left and taken up again, are looked at again together.
_SUSPECT: Final = 2
#: The share of what an instant costs that it must gain by itself to be looked at; and how often instants are moved.
_TOLD: Final = 0.35
_MOVED: Final = 2
#: Together they explain up to so much more than one by one.
_TOGETHER: Final = 1.5
#: So many sources are weighed with their jumps.
_SOURCES: Final = 3


@dataclass(frozen=True)
class Jumps(FittedCourses):
    """What sources would leave of jumps."""

    @override
    def terms(self, left: Array, least: float = -np.inf) -> list[Term]:
        """Those that explain most, each with the jumps that do."""
        count = self.data.count
        residual = left.reshape(len(self.data.columns), count)
        if not self.data.only_scaled:
            return self._terms_in_drift(residual)
        found = []
        for source, share in zip(self.every, self.shares, strict=True):
            root = source.root
            moment = np.einsum("fcn,cn->nf", source.series, residual) @ root
            # one freedom: what each sample tells; several tell about as much wherever the arm points
            told = np.sum(source.series[0] ** 2, axis=0) * root[0, 0] ** 2 if len(root) == 1 else np.ones(count)
            fewest = _STEPS if source.name in self.stepping else 1
            if len(at := roughly(moment, told)) >= min(_SUSPECT, fewest):
                found.append((_explained(moment, told, at), fewest, source, share, (moment, told)))
        terms = []
        for explained, fewest, source, share, level in sorted(found, key=lambda each: -each[0])[:_SOURCES]:
            at = best(*level) if 0.5 * _TOGETHER * explained + share > least else []
            terms += self._terms(source, at, fewest, share)
        return terms

    @cached_property
    def in_drift(self) -> list[StepsInDrift]:
        """Steps of each source where the floor has a memory."""
        taken = self.data.absorbed.dense().T.reshape(-1, len(self.data.columns), self.data.count)
        taken = scores(self.data, taken)
        return [StepsInDrift(self.data, source, taken) for source in self.every]

    def _terms_in_drift(self, residual: Array) -> list[Term]:
        """Those that explain most where the floor has a memory."""
        price = _price(self.data.count, 1)
        found = []
        for index, steps in enumerate(self.in_drift):
            gain = worth(float(steps.squares(residual).max()), len(self.every[index].series))
            if gain > _TOLD * price:
                found.append((gain, index))
        terms = []
        for _, index in sorted(found, key=lambda each: (-each[0], each[1]))[:_SOURCES]:
            fewest = _STEPS if self.every[index].name in self.stepping else 1
            at = self.in_drift[index].instants(residual, price)
            terms += self._terms(self.every[index], at, fewest, self.shares[index])
        return terms

    def _terms(self, source: Source, at: Sequence[int], fewest: int, share: float) -> list[Term]:
        """A source that jumps at these instants, where there are neither too few nor too many."""
        if not fewest <= len(at) <= _MOST:
            return []
        count = self.data.count
        number = np.searchsorted(at, np.arange(count), side="right")
        values = (number[:, None] == np.arange(len(at) + 1)).astype(float)
        course = Course(f"time, in {len(at)} jumps", values, np.ones(len(at) + 1))
        prior = share - len(at) * log(count) + lgamma(len(at) + 1.0)
        return terms_along(self.data.absorbed, source, course, prior)


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
        if gain < _price(*moment.shape):
            break
        del open_[first, end]
        at.append(middle)
        open_[first, middle], open_[middle, end] = _split(*sums, first, middle), _split(*sums, middle, end)
    return sorted(at)


def best(moment: Array, information: Array) -> list[int]:
    """Where levels change, by optimal partitioning over the instants that stand out from what is around them, far or
    near; each then moved to where it is best between its neighbours."""
    moments, informations = _sums(moment), np.maximum(_sums(information), 1e-300)
    some = [*_standing_out(moments, informations), np.asarray(roughly(moment, information), dtype=np.intp)]
    at = _partitioned(moments, informations, np.concatenate(some))
    for _ in range(_MOVED):
        ends = [0, *at, len(moment)]
        moved = [_split(moments, informations, *both)[1] for both in zip(ends[:-2], ends[2:], strict=True)]
        at = _partitioned(moments, informations, np.array([*at, *moved], dtype=np.intp))
    return at


def _standing_out(moments: Array, informations: Array) -> list[NDArray[np.intp]]:
    """Instants with another level after them than before, by windows of one sample to half of all."""
    count = len(moments) - 1
    at, found, width = np.arange(1, count), [], 1
    while width <= count // 2:
        before, after = np.maximum(at - width, 0), np.minimum(at + width, count)
        gain = _square(moments[at] - moments[before], informations[at] - informations[before])
        gain += _square(moments[after] - moments[at], informations[after] - informations[at])
        gain -= _square(moments[after] - moments[before], informations[after] - informations[before])
        largest = maximum_filter1d(gain, 2 * (width // 2) + 1)
        found.append(at[(0.5 * gain > _TOLD * _price(*moments.shape)) & (gain >= largest)])
        width *= 2
    return found


def _partitioned(moments: Array, informations: Array, at: NDArray[np.intp]) -> list[int]:
    """The instants of some between which levels explain most, less the price of each."""
    ends = np.unique([0, *at, len(moments) - 1])
    own, told, price = moments[ends], informations[ends], _price(*moments.shape)
    reached, last = np.zeros(len(ends)), np.zeros(len(ends), dtype=np.intp)
    for end in range(1, len(ends)):
        every = reached[:end] + 0.5 * _square(own[end] - own[:end], told[end] - told[:end])
        last[end] = np.argmax(every)
        reached[end] = every[last[end]] - price
    kept: list[int] = []
    end = int(last[-1])
    while end > 0:
        kept.append(int(ends[end]))
        end = int(last[end])
    return kept[::-1]


def _explained(moment: Array, information: Array, at: Sequence[int]) -> float:
    """Twice the log likelihood that levels between instants explain, less the price of these."""
    ends = [0, *at]
    square = _square(np.add.reduceat(moment, ends), np.add.reduceat(information, ends))
    return float(square.sum()) - 2.0 * len(at) * _price(*moment.shape)


def _price(count: int, freedoms: int) -> float:
    """What a chance jump gains at most, the largest of all samples, and no less than its instant costs."""
    return log(count) + 1.0 + freedoms


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
