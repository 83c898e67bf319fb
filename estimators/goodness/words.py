"""The answer for one sensor, and its verdict in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from estimators.calibration import SensorCalibration
from estimators.calibration.parts import CONDITION_LIMIT
from estimators.coverage.seen import Coverage
from estimators.goodness.by_direction import ByDirection
from estimators.goodness.cross_terms import CrossTerms
from estimators.goodness.hold_out import HoldOut
from estimators.goodness.outliers import Outliers
from estimators.goodness.own_optimum import Transfer
from estimators.goodness.raw_readings import Clipped, Repeats
from estimators.goodness.whiteness import Whiteness
from estimators.loud_floor import times_too_loud
from estimators.p_words import p_words
from rig.channels import CHANNELS_OF
from rig.documents import plain

#: A test that a good calibration fails once in ten thousand: with the five that have p-values, and the three readings
#: tests at 1e-4 or below, a good one is called not good less than once in a thousand times.
P_VALUE_LIMIT: Final = 1e-4
#: Standard deviations that are too small by less than this are those of a good calibration.
INFLATION_LIMIT: Final = 1.02
_EQUAL: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Goodness:
    """The answer for one sensor.

    Attributes:
        sensor: which one.
        reasons: why it is not good; none where it is.
        remarks: what else to know.
        chi_square: against a noise floor, as of ``Quality``; None without a floor.
        condition: of the Fisher information; infinite where something cannot be told.
        transfer: whether the calibration's parameters are the recording's; None where these samples cannot tell.
        coverage, by_direction, hold_out, whiteness, repeats, clipped, outliers: each test's result; None where the
            recording is too short for it.
        cross_terms: of a fit of six parameters without attitude; None of others.
        copies: channels that are another one's readings, as of ``raw_readings.copies``.
        left_out: outliers that the estimator says it has left out.
        samples: that were looked at.
    """

    sensor: str
    reasons: tuple[str, ...]
    remarks: tuple[str, ...]
    chi_square: Mapping[str, Any] | None
    condition: float
    transfer: Transfer | None
    coverage: Coverage
    by_direction: ByDirection | None
    cross_terms: CrossTerms | None
    hold_out: HoldOut | None
    whiteness: Whiteness
    repeats: Repeats
    clipped: Clipped
    outliers: Outliers
    copies: tuple[tuple[int, int, float], ...]
    left_out: int
    samples: int

    @property
    def good(self) -> bool:
        """Whether the estimates and their standard deviations can be relied upon."""
        return not self.reasons

    @property
    def verdict(self) -> str:
        """``good: ..`` or ``not good: because ..``."""
        if self.reasons:
            return f"not good: because {'; '.join(self.reasons)}"
        return f"good: {'; '.join(self.remarks)}"

    def __str__(self) -> str:
        """One line."""
        return f"{self.sensor}: {self.verdict}"

    def to_json(self) -> dict[str, Any]:
        """The ``verdict`` of the calibration's quality."""
        names = ("reasons", "remarks", "samples", "transfer", "by_direction", "cross_terms", "hold_out", "whiteness")
        return {"good": self.good, "text": self.verdict, **{name: plain(getattr(self, name)) for name in names}}


def copied(sensor: str, copies: Sequence[tuple[int, int, float]]) -> list[str]:
    """A sensor's channels that are another one's readings, as of ``raw_readings.copies``, in words."""
    names = CHANNELS_OF[sensor]
    told = []
    for one, other, factor in copies:
        how = "equals" if abs(factor - 1.0) < _EQUAL else f"is {1.0 / factor:.6g} times"
        told.append(f"{names[one]} {how} {names[other]}: one of them is a copy")
    return told


def reasons(found: Goodness, calibration: SensorCalibration) -> list[str]:
    """Why it is not good."""
    told = copied(found.sensor, found.copies)
    untold = [name for name, told in calibration.identifiable.items() if told is not True and "deg" not in name]
    if untold or not np.isfinite(calibration.covariance.diagonal()).any():
        told.append(f"{', '.join(untold) or 'the parameters'} cannot be told from these orientations")
    if found.condition > CONDITION_LIMIT and np.isfinite(found.condition):
        told.append(f"the orientations tell the parameters apart badly (condition {found.condition:.1e})")
    if found.clipped.count:
        names = CHANNELS_OF[found.sensor]
        ends = [
            f"{name} at {end:g} {count}"
            for side, values in ((found.clipped.low, found.clipped.lowest), (found.clipped.high, found.clipped.highest))
            for name, count, end in zip(names, side, values, strict=True)
            if count
        ]
        told.append(f"readings are clipped ({', '.join(ends)})")
    if _held(found):
        share, longest, held = found.repeats.share, found.repeats.longest, found.repeats.held
        told.append(
            f"{100.0 * share:.2g} % of the readings repeat the one before (up to {longest} in a row): the standard"
            f" deviations are too small by a factor of {np.sqrt(held):.2f}"
        )
    if found.transfer is not None and found.transfer.p_value < P_VALUE_LIMIT:
        told.append(
            f"the calibration is not this recording's: its parameters have moved (chi-square"
            f" {found.transfer.chi_square:.3g} of {found.transfer.parameters} degrees,"
            f" {p_words(found.transfer.p_value)})"
        )
    if found.outliers.significant and not found.left_out:
        told.append(
            f"{found.outliers.count} readings are outliers, up to {found.outliers.largest:.3g} standard deviations:"
            f" they move a channel's mean by {found.outliers.pull:.1f} of its standard errors"
        )
    if found.chi_square is not None and found.chi_square["p_value"] < P_VALUE_LIMIT:
        worst = max(found.chi_square["residual_over_floor"])
        missed = np.sqrt(max(worst**2 - 1.0, 0.0))
        told.append(
            f"residuals are {_times(worst)} times the noise floor ({p_words(found.chi_square['p_value'])}): the model"
            f" misses {_times(missed)} times the noise"
        )
    if found.by_direction is not None and found.by_direction.p_value < P_VALUE_LIMIT:
        told.append(
            f"residuals depend on the direction ({p_words(found.by_direction.p_value)}), most about"
            f" {found.by_direction.worst_name}"
        )
    if found.cross_terms is not None and found.cross_terms.p_value < P_VALUE_LIMIT:
        told.append(
            f"six parameters leave {found.cross_terms.ratio:.3g} times what nine do"
            f" ({p_words(found.cross_terms.p_value)}): the axes are not square to each other"
        )
    if found.hold_out is not None and found.hold_out.p_value < P_VALUE_LIMIT:
        first, last = found.hold_out.worst_s
        told.append(
            f"readings that were held out are predicted worse than the noise explains ({found.hold_out.ratio:.4f} times"
            f" the residuals, {p_words(found.hold_out.p_value)}), most from {first:.4g} to {last:.4g} s"
        )
    if not _held(found) and found.whiteness.p_value < P_VALUE_LIMIT:
        told.append(
            f"successive residuals are correlated ({found.whiteness.correlation:.2g}): standard deviations are too"
            f" small by a factor of {found.whiteness.inflation:.2f} or more"
        )
    return told


def remarks(found: Goodness) -> list[str]:
    """What was found in order, and what could not be looked at."""
    told: list[str] = []
    if found.chi_square is None:
        told.append("no noise floor was recorded to hold the residuals against")
    else:
        ratios = ", ".join(f"{ratio:.3f}" for ratio in found.chi_square["residual_over_floor"])
        times = times_too_loud(found.chi_square)
        how = p_words(found.chi_square["p_value"])
        if times is not None:
            how = f"a floor that is too loud: standard deviations are {times:.3g} times too large"
        told.append(f"residuals over noise floor {ratios} ({how})")
    if found.left_out:
        told.append(f"{found.left_out} samples were left out as outliers")
    if found.by_direction is None:
        told.append("too few readings to look at them by direction")
    else:
        told.append(f"no direction stands out ({p_words(found.by_direction.p_value)})")
    if found.cross_terms is not None:
        told.append(f"six parameters leave {found.cross_terms.ratio:.3g} times what nine do")
    if found.hold_out is None:
        told.append("no part of the recording can be held out")
    else:
        told.append(f"held-out residuals {found.hold_out.ratio:.4f} times the fitted ones")
        if found.hold_out.alone:
            told.append(f"{len(found.hold_out.alone)} of ten parts of the recording cannot be done without")
    if found.repeats.significant:
        told.append(f"{100.0 * found.repeats.share:.2g} % of the readings repeat the one before")
    absent = ["clipped", *(["repeated"] if not found.repeats.significant else [])]
    absent += ["outlying"] if not found.outliers.count else []
    told.append(f"no {', '.join(absent[:-1])}{' or ' if absent[:-1] else ''}{absent[-1]} readings")
    told.append(str(found.coverage))
    return told


def _held(found: Goodness) -> bool:
    """Whether readings repeat so often that it matters."""
    return found.repeats.significant and bool(np.sqrt(found.repeats.held) > INFLATION_LIMIT)


def _times(value: float) -> str:
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.3g}"
