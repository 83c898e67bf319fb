"""An error source that changes irregularly with time, at any rate, along one direction of its freedoms: somebody who
walks by, a motor that shakes the arm now and then, a line that picks up what goes past.

Smooth courses are slow, and have every freedom by itself. What one thing does moves all channels in one ratio: by that
it is told from noise, which each channel has by itself; of a single channel nothing tells it. The direction is the
leading eigenvector of the products of the freedoms' cosine transforms, each frequency with the weight that its power
gives it, as in principal components in the frequency domain (Brillinger, Time Series: Data Analysis and Theory, 1975,
chapter 9).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.fft import dct
from scipy.special import gammaln
from typing_extensions import override

from estimators.gap.evidence.fitted_courses import FittedCourses
from estimators.gap.evidence.piecewise_spectrum import piecewise
from estimators.gap.evidence.terms import Term, terms_along
from estimators.gap.hypotheses.courses import Course, half_waves
from rig.arrays import Array

#: So many sources are weighed, those that promise most.
_SOURCES: Final = 3
#: A process has so many cosines at most, those in which it is strongest.
_MOST: Final = 256
#: The direction is told this often, each time by the spectrum along the last one.
_ROUNDS: Final = 3

NAME: Final = "time, irregularly"


@dataclass(frozen=True)
class _Process:
    """What a source would leave: (f,) its direction, (n - 1,) its variance at each cosine over that of the noise, what
    it gains in log likelihood, and what that costs."""

    direction: Array
    excess: Array
    gain: float
    cost: float


@dataclass(frozen=True)
class Processes(FittedCourses):
    """What sources would leave that change irregularly."""

    @override
    def terms(self, left: Array, least: float = -np.inf) -> list[Term]:
        """Those that gain most, each along its likeliest direction and spectrum."""
        residual = left.reshape(len(self.data.columns), self.data.count)
        found: list[tuple[float, int, _Process]] = []
        for index, source in enumerate(self.every):
            if source.column >= 0:  # of one channel: that is noise
                continue
            waves = dct(source.root.T @ np.einsum("fcn,cn->fn", source.series, residual), norm="ortho")[:, 1:]
            if source.root.size and (process := likeliest(waves)) is not None:
                found.append((process.gain - process.cost + self.shares[index], index, process))
        terms: list[Term] = []
        for promised, index, process in sorted(found, key=lambda each: each[:2], reverse=True)[:_SOURCES]:
            if promised < least:
                continue
            source, along = self.every[index], self.every[index].root @ process.direction
            # direction and spectrum are told of what is whitened already
            single = replace(source, series=np.einsum("f,fcn->cn", along, source.series)[None], felt=None)
            terms += terms_along(self.data.absorbed, single, _course(process.excess), self.shares[index] - process.cost)
        return terms


def likeliest(waves: Array) -> _Process | None:
    """The process that a cosine transform (f, m) shows, of unit variance without one; None where it shows none."""
    freedoms = len(waves)
    power = np.mean(waves**2, axis=0)
    levels = piecewise(power)[2]
    for _ in range(_ROUNDS if freedoms > 1 else 1):
        if not (levels > 1.0).any():
            return None
        values, vectors = np.linalg.eigh((waves * (1.0 - 1.0 / levels)) @ waves.T)
        gain, cost, levels = piecewise((vectors[:, -1] @ waves) ** 2)
    if not (levels > 1.0).any():
        return None
    # of all directions, those about the likeliest (Laplace's approximation): half the area of a sphere over theirs
    area = 0.5 * freedoms * np.log(np.pi) - float(gammaln(0.5 * freedoms))
    told = np.maximum(values[-1] - values[:-1], 1.0) / (2.0 * np.pi)
    cost += max(area + 0.5 * float(np.log(told).sum()), 0.0) if freedoms > 1 else 0.0
    return _Process(vectors[:, -1], levels - 1.0, gain, cost)


def _course(excess: Array) -> Course:
    """The cosines in which a process is strongest, each with its size."""
    strongest = np.sort(np.argsort(-excess, kind="stable")[:_MOST])
    strongest = strongest[excess[strongest] > 0.0]
    return Course(NAME, half_waves(len(excess) + 1, strongest + 1), np.sqrt(excess[strongest]))
