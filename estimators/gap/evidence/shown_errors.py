"""Errors of a noise effect that the recordings themselves show: their mean is known, and what is hidden is less."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.fft import dct

from estimators.gap.data.projection import project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.laplace import Linear
from rig.arrays import Array
from rig.effects import Effect, ErrorsShown

#: Width of the share of what is shown that is errors, about all of it: the path itself may be as rough.
_WIDTH: Final = 1.0 / 3.0
#: Signal-to-noise below which they are not asked for.
_SEEN: Final = 1.0


@dataclass(frozen=True, eq=False)
class Shown:
    """What the recordings show of an effect's errors.

    Attributes:
        parts: of each recording. change: (c n,) what they do, whitened, the calibration projected out.
    """

    parts: tuple[ErrorsShown, ...]
    change: Array

    @classmethod
    def of(cls, data: WhitenedData, probe: Effect) -> Shown | None:
        """None where the recordings show none, or nothing that the readings could.

        Args:
            probe: the effect, of any shape.
        """
        found = [probe.errors_shown(part.base) for part in data.parts]
        parts = tuple(each for each in found if each is not None)
        if len(parts) < len(found):
            return None
        changes = [
            np.einsum("nkr,nr->nk", probe.response(part.base, part.pipeline), each.errors)
            for part, each in zip(data.parts, parts, strict=True)
        ]
        change = project(data.absorbed, data.whiten(of_parts(data, changes)))
        return cls(parts, change) if change @ change > _SEEN**2 else None

    @property
    def pieces(self) -> int:
        """As many free errors as are hidden."""
        return max(1, round(sum(float(each.hidden.sum()) for each in self.parts)))

    def log_shares(self, probes: Sequence[Effect], interval_s: float) -> Array:
        """Logarithms of how likely the shapes (p,) of an effect are by the spectrum of what is shown alone."""
        gains = np.zeros(len(probes))
        for each in self.parts:
            seen = each.hidden < 0.5
            frequency = np.arange(len(seen))[seen] / (2.0 * len(seen))
            power = np.sum(dct(each.errors, axis=0, norm="ortho")[seen] ** 2, axis=1) / (1.0 - each.hidden[seen]) ** 2
            if not power.any():
                continue
            for index, probe in enumerate(probes):
                spectrum = probe.added_spectrum(frequency, interval_s)
                size = float(np.mean(power / spectrum))
                gains[index] -= 0.5 * each.errors.shape[1] * float(np.sum(np.log(spectrum * size)))
        return np.asarray(gains - np.logaddexp.reduce(gains))

    def beside(self, linear: Linear) -> Linear:
        """A set of effects beside what the errors that are shown do."""
        return linear.beside(self.change, 1.0, _WIDTH)

    def square(self, known: Linear, single: Array) -> tuple[float, float]:
        """Mean square of the errors, as much of it as is shown, and its standard deviation.

        Args:
            known: as ``beside`` makes it. single: (n,) by how much a single reading's error varies more than a mean's.
        """
        mean, covariance = known.posterior(known.likeliest)
        share, width = float(mean[-1]), float(np.sqrt(covariance[-1, -1]))
        errors = np.concatenate([each.errors for each in self.parts])
        square = share**2 * float(np.mean(errors**2 * single[: len(errors), None]))
        return square, square * float(np.hypot(2.0 * width / max(abs(share), width), np.sqrt(2.0 / errors.size)))


def of_parts(data: WhitenedData, values: Sequence[Array], beyond: float = 0.0) -> Array:
    """(count, ...) of each recording's values, and of rows that are none's."""
    found = np.concatenate(values)
    rest = np.full((data.count - len(found), *found.shape[1:]), beyond)
    return np.concatenate([np.nan_to_num(found, posinf=np.inf), rest])
