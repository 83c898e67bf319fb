"""An error source that switches between two levels, again and again, at instants that single readings do not tell: a
loose contact, a range that switches, burst noise.

The evidence of random telegraph noise is averaged over all instants. By its spectrum alone it is coloured noise of
short memory; only two levels tell.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import log
from typing import Final

import numpy as np
from typing_extensions import override

from estimators.gap.data.projection import project
from estimators.gap.evidence.fitted_courses import FittedCourses
from estimators.gap.evidence.terms import Term, terms_along
from estimators.gap.floor.two_levels import forward, smoothed
from estimators.gap.hypotheses.courses import Course
from estimators.gap.hypotheses.sources import Source
from rig.arrays import Array

#: More samples than these are added up first.
_SAMPLES: Final = 8192
#: So many sources are tried, those with most slow power, where this gains so much in log likelihood.
_SOURCES, _WORTH = 3, 10.0
#: Levels are looked for so many times at most, each about those found before, beside what the calibration takes.
_ROUNDS: Final = 3
#: Of what levels gain, means over pieces of one length tell at least this share.
_OVERLOOKED: Final = 0.5
#: A level lasts from so many samples to such a share of the recording; means over at least so many pieces tell of it.
_SHORTEST, _LONGEST, _RATES, _PIECES = 4, 0.3, 7, 16
#: Shares of the time at the upper level, and distances of the levels in the one that the slow power tells.
_SHARES: Final = (0.25, 0.5, 0.75)
_APART: Final = (0.6, 0.75, 0.9, 1.05, 1.2, 1.4)
#: Switches at least, where the catalogue has single steps: fewer are such ones, each a cause of its own.
_FEWEST, _STEPS = 2, 4

NAME: Final = "time, between two levels"


@dataclass(frozen=True)
class Telegraphs(FittedCourses):
    """What sources would leave that switch between two levels."""

    @cached_property
    def _single(self) -> list[tuple[Source, float, Array]]:
        """Those of one freedom, with their shares, and (n,) what each sample tells of the level."""
        return [
            (source, share, np.sum(source.series[0] ** 2, axis=0))
            for source, share in zip(self.every, self.shares, strict=True)
            if len(source.series) == 1
        ]

    @property
    def _together(self) -> int:
        """Samples that are added up first."""
        return -(-self.data.count // _SAMPLES)

    def _summed(self, values: Array) -> Array:
        return np.asarray(np.add.reduceat(values, np.arange(0, self.data.count, self._together)))

    @override
    def terms(self, left: Array, least: float = -np.inf) -> list[Term]:
        """Those that have most slow power, each along its likely levels."""
        residual = left.reshape(len(self.data.columns), self.data.count)
        found = []
        for source, share, told in self._single:
            moments, informations = self._moments(source, residual), self._summed(told)
            gain, excess = slow_power(moments, informations)
            if gain > max(_WORTH, _OVERLOOKED * (least - share)):
                found.append((gain, source, share, moments, informations, excess))
        terms = []
        for _, source, share, moments, informations, excess in sorted(found, key=lambda each: -each[0])[:_SOURCES]:
            upper, gained, cost = self._refined(source, residual, moments, informations, excess)
            switches = int(np.count_nonzero(np.diff(upper > 0.5)))
            fewest = _STEPS if source.name in self.stepping else _FEWEST
            if share + gained < least or switches < fewest:
                continue
            course = Course(NAME, self._every(upper)[:, None], np.ones(1))
            terms += terms_along(self.data.absorbed, source, course, share + cost)
        return terms

    def _moments(self, source: Source, residual: Array) -> Array:
        return self._summed(np.einsum("cn,cn->n", source.series[0], residual))

    def _every(self, values: Array) -> Array:
        """At every sample, of values at the sums."""
        return np.repeat(values, self._together)[: self.data.count]

    def _refined(
        self, source: Source, residual: Array, moments: Array, informations: Array, excess: float
    ) -> tuple[Array, float, float]:
        """(k,) the probability of the upper level at each sum; what such levels gain in log likelihood, and what their
        instants cost of it.

        Where the calibration takes a part of a level, what it leaves has no two: levels are looked for again about
        those found, beside what it takes of these.

        Args:
            residual: (c, n) whitened. moments, informations, excess: as ``slow_power`` takes and tells them.
        """
        levels, gained, left = likely_levels(excess), -np.inf, residual.ravel()
        for _ in range(_ROUNDS):
            evidence, upper = two_levels(moments, informations, levels)
            mean = float(informations @ upper / informations.sum())
            moved = upper - mean
            explained = 0.5 * float(moments @ moved) ** 2 / max(float(informations @ moved**2), 1e-300)
            change = (source.series[0] * self._every(moved)).ravel()
            alone = project(self.data.absorbed, change[:, None])[:, 0]
            size = float(alone @ left) / max(float(alone @ alone), 1e-300)
            cost = min(evidence - explained, 0.0)
            before, gained = gained, cost + 0.5 * size * float(alone @ left)
            if gained < before + 1.0:
                break
            moments = self._moments(source, residual + size * (change - alone).reshape(residual.shape))
            levels = size * np.array([[[1.0 - mean, -mean]]])
        return upper, gained, cost


def slow_power(moments: Array, informations: Array) -> tuple[float, float]:
    """What a level that changes slowly gains in log likelihood at most, by means over ever longer pieces; and the
    variance of that level.

    Args:
        moments, informations: (n,) sums over samples of the level's effect times the residual, and squared.
    """
    best, excess, width = 0.0, 0.0, _SHORTEST
    while len(moments) // width >= _PIECES:
        edges = np.arange(0, len(moments) // width * width, width)
        told = np.add.reduceat(informations[: edges[-1] + width], edges)
        there = told > 0.0
        squares = np.add.reduceat(moments[: edges[-1] + width], edges)[there] ** 2 / told[there]
        ratio = float(np.mean(squares)) if there.any() else 0.0
        gain = 0.5 * len(squares) * (ratio - 1.0 - log(ratio)) if ratio > 1.0 else 0.0
        if gain > best:
            best = gain
            excess = max(excess, (ratio - 1.0) / float(np.mean(told[there])))
        width *= 2
    return best, excess


def likely_levels(excess: float) -> Array:
    """(d, s, 2): an upper and a lower level of a mean of zero, at each distance and for each share of the time.

    Args:
        excess: the level's variance, as slow power tells it.
    """
    share = np.array(_SHARES)
    apart = np.sqrt(excess / (share * (1.0 - share))) * np.array(_APART)[:, None]
    return np.stack([apart * (1.0 - share), -apart * share], axis=-1)


def two_levels(moments: Array, informations: Array, levels: Array) -> tuple[float, Array]:
    """Log evidence of a level that switches between two, against none: averaged over all instants, over how often, and
    over how long at either, at the likeliest levels; and (n,) the probability of the upper one.

    Args:
        levels: (d, s, 2), upper and lower, for each share of the time; or (d, 1, 2), for all of them.
    """
    longest = max(_LONGEST * len(moments), 2.0 * _SHORTEST)
    rates = 1.0 / np.geomspace(_SHORTEST, longest, _RATES)
    pair, which, rate = (
        each.ravel() for each in np.meshgrid(range(len(levels)), range(len(_SHARES)), rates, indexing="ij")
    )
    upper, lower = np.broadcast_to(levels, (len(levels), len(_SHARES), 2))[pair, which].T
    share = np.array(_SHARES)[which]
    odds = np.outer(moments, upper - lower) - 0.5 * np.outer(informations, upper**2 - lower**2)
    gains, filtered = forward(odds, share, rate)
    gains += lower * moments.sum() - 0.5 * lower**2 * informations.sum()
    best = int(np.argmax(gains))
    alike = gains.reshape(len(levels), -1)[pair[best]]  # of the same levels
    evidence = float(np.logaddexp.reduce(alike)) - log(len(alike))
    return evidence, smoothed(filtered[:, best], float(share[best]), float(rate[best]))
