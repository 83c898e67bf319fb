"""An error source along a sine of unknown frequency, faster than the slow functions of time that sources follow.

A vibration, a hum, an unbalance, a filter that rings: whatever repeats by itself, and has no name.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from typing_extensions import override

from estimators.gap.evidence.fitted_courses import FittedCourses
from estimators.gap.evidence.terms import Term, terms_along
from estimators.gap.hypotheses.courses import COSINES, Course
from estimators.gap.hypotheses.tones import of_waves, polished
from rig.arrays import Array

#: So many sources are weighed along a sine of their best frequency.
_MOST: Final = 3
#: Amid two frequencies of the transform a sine explains so much more than at either.
_BETWEEN: Final = 1.25


@dataclass(frozen=True)
class Sines(FittedCourses):
    """What any source would leave of a sine."""

    @cached_property
    def _inverses(self) -> list[Array]:
        return [np.linalg.pinv(np.einsum("icn,jcn->ij", own.series, own.series)) for own in self.every]

    @override
    def terms(self, left: Array, least: float = -np.inf) -> list[Term]:
        """Those that explain most, each along the sine that does."""
        count, interval_s = self.data.count, self.data.interval_s
        tried = (count - COSINES) // 2
        if tried < 1:
            return []
        residual = left.reshape(len(self.data.columns), count)
        seen = [np.einsum("fcn,cn->fn", source.series, residual) for source in self.every]
        found = []
        for index, own in enumerate(seen):
            spectra = np.fft.rfft(own, n=2 * count, axis=1)[:, COSINES:-1]
            squares = of_waves(spectra, self._inverses[index])
            peak = int(np.argmax(squares))
            # each of its freedoms has a sine and a cosine
            found.append((float(squares[peak]) - 2.0 * len(spectra), index, float(squares[peak]), peak + COSINES))
        terms = []
        for _, index, square, place in sorted(found, reverse=True)[:_MOST]:
            if 0.5 * _BETWEEN * square + self.shares[index] - np.log(tried) < least:
                continue
            nearby_Hz = place / (2.0 * count * interval_s)
            square, frequency_Hz = polished(seen[index], self._inverses[index], self.data.t, nearby_Hz)
            turns = 2.0 * np.pi * frequency_Hz * self.data.t
            course = Course(f"a sine of {frequency_Hz:.4g} Hz", np.stack([np.cos(turns), np.sin(turns)], 1), np.ones(2))
            # a sine so strong is told to sqrt(12) / (2 pi snr) of a cell (Rife and Boorstyn, 1974): of each the share
            told = np.sqrt(2.0 * np.pi) * np.sqrt(12.0 / max(square, 1.0)) / (2.0 * np.pi)
            share = self.shares[index] - float(np.log(tried / min(told, 1.0)))
            terms += terms_along(self.data.absorbed, self.every[index], course, share)
        return terms
