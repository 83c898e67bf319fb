"""An error source along a sine of unknown frequency, faster than the slow functions of time that sources follow.

A vibration, a hum, an unbalance, a filter that rings: whatever repeats by itself, and has no name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.terms import Errors, Term, freedoms_of, smooth_terms
from estimators.gap.hypotheses.sources import COSINES, Course, Source
from estimators.gap.hypotheses.tones import of_waves, polished

Array = NDArray[np.float64]

#: So many sources are weighed along a sine of their best frequency.
_MOST: Final = 3


@dataclass(frozen=True)
class Sines:
    """What any source would leave of a sine.

    Attributes:
        data: sample by sample. every: the sources of it. shares: of each the log prior of one course.
    """

    data: WhitenedData
    every: Sequence[Source]
    shares: Sequence[float]

    @cached_property
    def _errors(self) -> Errors:
        return Errors.of(self.every)

    @cached_property
    def _inverses(self) -> list[Array]:
        series = [self._errors.series[:, own] for own in freedoms_of(self.every)]
        return [np.linalg.pinv(np.einsum("nic,njc->ij", own, own)) for own in series]

    def terms(self, left: Array) -> list[Term]:
        """The sources that explain most of a residual, each along the sine that does.

        Args:
            left: (c n,) whitened, with the calibration projected out.
        """
        count, interval_s = self.data.count, self.data.interval_s
        tried = (count - COSINES) // 2
        if tried < 1:
            return []
        seen = self._errors.moments(left[:, None])[:, :, 0].T
        found = []
        for index, own in enumerate(freedoms_of(self.every)):
            spectra = np.fft.rfft(seen[own], n=2 * count, axis=1)[:, COSINES:-1]
            explained = of_waves(spectra, self._inverses[index])
            peak = int(np.argmax(explained))
            # each of its freedoms has a sine and a cosine
            found.append((float(explained[peak]) - 2.0 * len(spectra), index, (peak + COSINES) / (2.0 * count)))
        terms = []
        for _, index, cycles in sorted(found, reverse=True)[:_MOST]:
            own = freedoms_of(self.every)[index]
            frequency_Hz = polished(seen[own], self._inverses[index], self.data.t, cycles / interval_s)[1]
            turns = 2.0 * np.pi * frequency_Hz * self.data.t
            course = Course(f"a sine of {frequency_Hz:.4g} Hz", np.stack([np.cos(turns), np.sin(turns)], 1), np.ones(2))
            share = self.shares[index] - float(np.log(tried))
            terms += smooth_terms(self.data.absorbed.dense(), [self.every[index]], [[course]], [share], lengths=())[1]
        return terms
