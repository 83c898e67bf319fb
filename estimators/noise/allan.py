"""The Allan deviation of a sensor at rest, overlapping, pooled over several records, with its confidence interval.

Overlapping differences of neighbouring means, as in Riley, "Handbook of frequency stability analysis", NIST Special
Publication 1065 (2008), section 5.2.4, for whose test data the tests have the published values. Written out, as it is a
running sum and a difference; what packages for clocks add (confidence intervals by noise type, one record at a time)
does not hold for the sum of several noises pooled over poses, and is found from the spectrum instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri

from rig.arrays import Array, Rows
from rig.errors import RigError

#: The longest averaging time is this share of the longest record: six means, four differences that do not overlap.
_LONGEST: Final = 6
#: Fewer samples than this have no Allan deviation worth having.
FEWEST_SAMPLES: Final = 24


@dataclass(frozen=True, eq=False)
class AllanDeviation:
    """The Allan deviation of one channel.

    Attributes:
        interval_s: between samples [s].
        samples: (s,) of each record.
        averaged: (k,) m, samples averaged; octaves.
        deviation: (k,) [unit].
    """

    interval_s: float
    samples: Rows
    averaged: Rows
    deviation: Array

    @property
    def tau_s(self) -> Array:
        """(k,) averaging times m / rate [s]."""
        return np.asarray(self.averaged * self.interval_s, dtype=float)

    def interval(self, freedom: ArrayLike, level: float = 0.95) -> tuple[Array, Array]:
        """Lower and upper end (k,) of a confidence interval [unit].

        Args:
            freedom: (k,) equivalent degrees of freedom, as of ``estimators.noise.allan_terms``.
            level: its coverage.
        """
        degrees = np.asarray(freedom, dtype=float)
        tail = 0.5 * (1.0 - level)
        return (
            self.deviation * np.sqrt(degrees / chdtri(degrees, tail)),
            self.deviation * np.sqrt(degrees / chdtri(degrees, 1.0 - tail)),
        )


def allan_deviation(records: Sequence[ArrayLike], rate_Hz: float) -> AllanDeviation:
    """The overlapping Allan deviation at octaves of the sampling interval.

    Args:
        records: (n,) each, evenly sampled at rest [unit]; every one about a mean of its own.
        rate_Hz: of the samples.

    Raises:
        RigError: no record of ``FEWEST_SAMPLES``.
    """
    values = [np.asarray(record, dtype=float) for record in records]
    samples = np.array([len(record) for record in values], dtype=np.intp)
    if not len(values) or samples.max() < FEWEST_SAMPLES:
        raise RigError(
            f"Allan deviation: found records of {', '.join(map(str, samples)) or 'no'} samples, expected one of"
            f" {FEWEST_SAMPLES} or more"
        )
    octaves = int(np.log2(samples.max() // _LONGEST)) + 1
    averaged = 2 ** np.arange(octaves)
    squares, counts = np.zeros(octaves), np.zeros(octaves)
    for record in values:
        total = np.concatenate([[0.0], np.cumsum(record - record.mean())])
        for k, m in enumerate(averaged):
            if len(record) < 2 * m:
                break
            difference = total[2 * m :] - 2.0 * total[m:-m] + total[: -2 * m]
            squares[k] += difference @ difference
            counts[k] += len(difference)
    return AllanDeviation(1.0 / rate_Hz, samples, averaged, np.sqrt(squares / counts / (2.0 * averaged**2.0)))
