"""What a recording shows of an effect by itself: in single readings, or in the errors of noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rig.arrays import Array

if TYPE_CHECKING:
    from rig.effects.base import Effect


@dataclass(frozen=True)
class Readings:
    """Readings beside what is expected of them, in which effects on single readings look for themselves.

    Attributes:
        values: (n, 6) [recorded unit]; NaN where a channel is not there.
        expected: (n, 6) [recorded unit] without noise.
        sigma: (6,) [recorded unit] of the noise: of each reading as seen from those before it.
        white: (n, 6) the difference of the two, whitened; where a reading is left out, as those on either side have it.
        left_out: (n, 6) bool, readings that do not count.
        step: (6,) [recorded unit] the converter's step, as it is known from a recording at rest; zero or NaN where
            none is.
        degrees: for each of the six channels those of Student's distribution that a recording at rest shows of the
            noise, infinite where it is normal; None where nobody knows.
    """

    values: Array
    expected: Array
    sigma: Array
    white: Array
    left_out: NDArray[np.bool_]
    step: Array
    degrees: tuple[float | None, ...] = (None,) * 6

    @property
    def columns(self) -> list[int]:
        """The channels that are there."""
        return [int(column) for column in np.flatnonzero(np.isfinite(self.values[0]))]


@dataclass(frozen=True)
class Finding:
    """What an effect on single readings shows in them.

    Attributes:
        effect: with the parameters that the readings tell.
        std: their standard deviations; None where there is none.
        affected: (n, 6) bool, the readings that tell nothing else any more.
        log_p: logarithm of the chance of as much without the effect, over all readings and channels looked at.
        added: (6,) [recorded unit] root mean square of what it adds to the readings.
        anywhere: whether each reading may be affected alike, not those of some levels alone.
    """

    effect: Effect
    std: Mapping[str, float | None]
    affected: NDArray[np.bool_]
    log_p: float
    added: Array
    anywhere: bool = True


@dataclass(frozen=True)
class ErrorsShown:
    """Errors of a noise effect that a recording itself shows.

    Attributes:
        errors: (n, r) as ``Effect.response`` takes them, at strength one.
        hidden: (n,) share of each cosine of these, from the slowest to the fastest, that it does not show.
    """

    errors: Array
    hidden: Array
