"""Consistent or not: words that follow from the numbers of a summary.

A study makes thousands of tests, of which some fail by chance. So a single one counts only beyond the limit that all of
them together pass with a probability of 99.9 % (Bonferroni); what lies between 3.5 standard errors and that limit is
reported with the number that chance lets expect.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from scipy.stats import binom, chi2, norm, t

from estimators.known_angle.model import Method
from scenarios.studies.error_summary import SMALL_BOUND, Cell, Rate, Summary
from scenarios.studies.intervals import LEVEL

#: A bias beyond so many standard errors is given a reason.
BIAS_SIGMAS: Final = 3.5
#: Probability that any test of one kind fails by chance, over a whole study.
FALSE_ALARM: Final = 1e-3
#: A study that would overlook a bias of so many bounds decides nothing.
COARSEST: Final = 0.5
#: The orders whose bound falls as 1/sqrt(n), so that the slope has a value to be held against.
SPREAD_ORDERS: Final = ("every-kth", "random")

Word = Literal["consistent and efficient", "consistent", "not consistent", "undecided"]
Reason = Literal["curvature", "large errors", "chance", "unexplained"]


@dataclass(frozen=True)
class Departure:
    """A bias of more than 3.5 standard errors, and why.

    Attributes:
        cell: whose. sigmas: of its bias, in standard errors; after: less what curvature lets expect.
        reason: "curvature": the second-order bias of a nonlinear fit explains it, which falls as 1/n; "large errors":
            the bound is not small, so that no expansion holds; "chance": within what all cells together allow;
            "unexplained": none of these.
    """

    cell: Cell
    sigmas: float
    after: float
    reason: Reason


@dataclass(frozen=True)
class Verdict:
    """On one sensor, method and noise level.

    Attributes:
        sensor, method, noise_factor: which.
        word: what it comes to.
        sentences: why, one each on bias, RMSE, rate and coverage.
        departures: of the bias, over all cells.
    """

    sensor: str
    method: Method
    noise_factor: float
    word: Word
    sentences: tuple[str, ...]
    departures: tuple[Departure, ...]

    @property
    def title(self) -> str:
        """Which fit, and what it is."""
        return f"{self.sensor}, {self.method} fit, noise ×{self.noise_factor:g}: {self.word}"


def verdicts(summary: Summary) -> tuple[Verdict, ...]:
    """One for each sensor, method and noise level."""
    keys = dict.fromkeys((cell.sensor, cell.method, cell.noise_factor) for cell in summary.cells)
    small = sum(cell.small for cell in summary.cells)
    spread = sum(rate.order in SPREAD_ORDERS for rate in summary.rates)
    return tuple(_verdict(summary, *key, small, spread) for key in keys)


def _verdict(summary: Summary, sensor: str, method: Method, factor: float, tests: int, slopes: int) -> Verdict:
    cells = [
        cell for cell in summary.cells if (cell.sensor, cell.method, cell.noise_factor) == (sensor, method, factor)
    ]
    rates = [
        rate
        for rate in summary.rates
        if (rate.sensor, rate.method, rate.noise_factor) == (sensor, method, factor) and rate.order in SPREAD_ORDERS
    ]
    small = [cell for cell in cells if cell.small]
    found = tuple(departures(cells, tests))
    if not small:
        return Verdict(sensor, method, factor, "undecided", (_too_uncertain(cells),), found)
    wide = [cell for cell in small if not _ratio_holds(cell, tests)]
    slow = [rate for rate in rates if not _slope_holds(rate, slopes)]
    uncovered = [cell for cell in small if not _coverage_holds(cell, tests)]
    off = [departure for departure in found if departure.reason == "unexplained"]
    resolution = _sigmas(tests) / np.sqrt(small[0].draws)
    needed = int(np.ceil((_sigmas(tests) / COARSEST) ** 2))
    sentences = (
        _on_bias(small, found, tests),
        _on_rmse(small, wide),
        _on_rate(rates, slow),
        _on_coverage(small),
        f"Undecided because {small[0].draws:,} draws are too few: raise --draws to {needed:,} at least."
        if resolution > COARSEST
        else "",
        f"With {small[0].draws:,} draws a bias of {resolution:.2f} bounds, or an RMSE {resolution / np.sqrt(2.0):.0%}"
        " above the bound, would be found at any single number of samples.",
    )
    if off or any(rate.slope > max(-0.5, rate.bound_slope) for rate in slow):
        word: Word = "not consistent"
    elif resolution > COARSEST:
        word = "undecided"
    elif wide or slow or uncovered:
        word = "consistent"
    else:
        word = "consistent and efficient"
    return Verdict(sensor, method, factor, word, tuple(filter(None, sentences)), found)


def departures(cells: Iterable[Cell], tests: int) -> Iterable[Departure]:
    """Every bias beyond 3.5 standard errors, with its reason.

    Args:
        cells: to be looked at.
        tests: how many cells the study has where the bound is small.
    """
    limit = _sigmas(tests)
    for cell in cells:
        sigmas = cell.bias / cell.bias_std
        after = (cell.bias - cell.bias_expected) / cell.bias_std
        if not abs(sigmas) > BIAS_SIGMAS:
            continue
        reason: Reason = "unexplained"
        if not cell.small:
            reason = "large errors"
        elif abs(after) <= BIAS_SIGMAS:
            reason = "curvature"
        elif abs(after) <= limit:
            reason = "chance"
        yield Departure(cell, sigmas, after, reason)


def _sigmas(tests: int) -> float:
    return float(norm.isf(0.5 * FALSE_ALARM / max(tests, 1)))


def _too_uncertain(cells: Sequence[Cell]) -> str:
    """Where no bound is small: how many samples would make it so, as it falls with their root."""
    best = min(cells, key=lambda cell: cell.largest_bound)
    text = (
        f"Undecided because the bound is nowhere below {SMALL_BOUND:.0%} of the values: with {best.count:,} samples"
        f" it is {best.largest_bound:.0%}"
    )
    if not np.isfinite(best.largest_bound):
        return f"{text}, for a parameter cannot be told: raise the number of orientations of the maneuver."
    more = best.count * (best.largest_bound / SMALL_BOUND) ** 2
    lower = best.noise_factor * SMALL_BOUND / best.largest_bound
    return (
        f"{text}. Raise the samples to some {more:,.0f} (a longer maneuver, a higher rate), or lower the noise"
        f" (--noise) to {lower:.2g} times the scenario's."
    )


def _ratio_holds(cell: Cell, tests: int) -> bool:
    tail = 0.5 * FALSE_ALARM / tests
    square = cell.draws * cell.ratio**2
    return bool(chi2.isf(1.0 - tail, cell.draws) <= square <= chi2.isf(tail, cell.draws))


def _coverage_holds(cell: Cell, tests: int) -> bool:
    inside = round(cell.coverage * cell.draws)
    tail = 0.5 * FALSE_ALARM / tests
    return bool(binom.cdf(inside, cell.draws, LEVEL) >= tail and binom.sf(inside - 1, cell.draws, LEVEL) >= tail)


def _slope_holds(rate: Rate, slopes: int) -> bool:
    """At -1/2, or where the poses have their own, at the bound's slope."""
    limit = float(t.isf(0.5 * FALSE_ALARM / max(slopes, 1), max(rate.units - 1, 1)))
    return min(abs(rate.slope + 0.5), abs(rate.slope - rate.bound_slope)) <= limit * rate.slope_std


def _on_bias(small: Sequence[Cell], found: Sequence[Departure], tests: int) -> str:
    inside = [departure for departure in found if departure.cell.small]
    by_chance = len(small) * 2.0 * float(norm.sf(BIAS_SIGMAS))
    text = (
        f"Bias: {_number(len(small) - len(inside), len(small))} biases lie within {BIAS_SIGMAS} standard errors of zero"
    )
    reasons = []
    curved = [departure for departure in inside if departure.reason == "curvature"]
    if curved:
        worst = max(curved, key=lambda departure: abs(departure.sigmas))
        reasons.append(
            f"{len(curved)} by the curvature of the model (Box 1971; {worst.cell.parameter} at {worst.cell.count:,}"
            f" samples is off by {worst.sigmas:.1f}, and by {worst.after:.1f} after it), which falls as 1/n"
        )
    if chance := sum(departure.reason == "chance" for departure in inside):
        reasons.append(f"{chance} within chance ({by_chance:.1f} expected, up to {_sigmas(tests):.1f} standard errors)")
    unexplained = [departure for departure in inside if departure.reason == "unexplained"]
    if unexplained:
        last = max(unexplained, key=lambda departure: (departure.cell.count, abs(departure.after)))
        cell = last.cell
        reasons.append(
            f"{len(unexplained)} without an explanation: at {cell.count:,} samples {cell.parameter} is off by"
            f" {cell.bias:.3g} ± {cell.bias_std:.2g} {cell.unit}, {abs(cell.bias) / cell.bound:.1f} times the bound"
        )
    beyond = sum(departure.reason == "large errors" for departure in found)
    text += f"; the others: {'; '.join(reasons)}." if reasons else "."
    if beyond:
        text += f" Where the bound is not small {beyond} more are biased, as a nonlinear fit is."
    return text


def _on_rmse(small: Sequence[Cell], wide: Sequence[Cell]) -> str:
    lowest, highest = (pick(small, key=lambda cell: cell.ratio) for pick in (min, max))
    holding = sum(cell.ratio_low <= 1.0 <= cell.ratio_high for cell in small)
    text = (
        f"RMSE over bound, from where the bound of every parameter is below {SMALL_BOUND:.0%}: {lowest.ratio:.3f} to"
        f" {highest.ratio:.3f}; {holding / len(small):.1%} of the {LEVEL:.0%} intervals hold 1"
    )
    if wide:
        worst = max(wide, key=lambda cell: abs(np.log(cell.ratio)))
        where = f"{worst.parameter} at {worst.count:,} samples in the order {worst.order}"
        text += f"; {len(wide)} beyond chance, the farthest {worst.ratio:.3f} ({where})"
    return text + "."


def _on_rate(rates: Sequence[Rate], slow: Sequence[Rate]) -> str:
    if not rates:
        return ""
    holding = sum(rate.slope_low <= -0.5 <= rate.slope_high for rate in rates)
    slopes = [rate.slope for rate in rates]
    half = float(np.median([0.5 * (rate.slope_high - rate.slope_low) for rate in rates]))
    text = (
        f"Slope of log RMSE over log n: {np.mean(slopes):.4f} on average ({min(slopes):.3f} to {max(slopes):.3f}, ±"
        f"{half:.3f} each); {_number(holding, len(rates))} {LEVEL:.0%} intervals hold -1/2"
    )
    if slow:
        worst = max(slow, key=lambda rate: abs(rate.slope + 0.5))
        text += (
            f"; {len(slow)} beyond chance, the farthest {worst.slope:.3f} ({worst.parameter}, {worst.order}), where the"
            f" bound's is {worst.bound_slope:.3f}"
        )
    return text + "."


def _on_coverage(small: Sequence[Cell]) -> str:
    shares = [cell.coverage for cell in small]
    return (
        f"Coverage of the fits' own {LEVEL:.0%} intervals: {np.mean(shares):.2%} on average, {min(shares):.1%} to"
        f" {max(shares):.1%}."
    )


def _number(part: int, whole: int) -> str:
    return f"all {whole:,}" if part == whole else f"{part:,} of {whole:,}"
