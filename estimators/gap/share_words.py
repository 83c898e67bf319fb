"""Probabilities and shares in words."""

from __future__ import annotations

import math


def chance(probability: float) -> str:
    """A probability, to as many digits as tell it from certainty: ".93", ".998", "> .999"."""
    if probability > 0.999:
        return "> .999"
    if probability < 0.001:
        return "< .001"
    digits = 2 if 0.01 <= probability <= 0.99 else 3
    return f"{probability:.{digits}f}".removeprefix("0")


def percent(share: float | None, low: float | None = None, high: float | None = None) -> str:
    """A share in percent, to a tenth close to everything, with its interval where that says more: "97 % (95-99)".

    What rounds to nothing is "< 1 %", what rounds to everything and is not "> 99.9 %".
    """
    value, *ends = (_hundredths(each) for each in (share, low, high))
    if share is None or value == "–":
        return "–"
    if value == "0":
        value = "< 1"
        ends = ["–"] if ends == ["0", "0"] else ends
    elif value == "100" and share < 1.0:
        value = "> 99.9"
        ends = ["–"] if ends[0] == "100" else ends
    between = " to " if low is not None and low < 0.0 else "-"  # a dash beside a minus sign cannot be read
    return f"{value} %" if "–" in ends or ends == [value, value] else f"{value} % ({ends[0]}{between}{ends[1]})"


def _hundredths(share: float | None) -> str:
    if share is None or not math.isfinite(share):
        return "–"
    value = 100.0 * share
    return f"{value:.1f}".removesuffix(".0") if 99.0 <= value < 99.95 else f"{round(value)}"


def elsewhere_words(share: float) -> str:
    """What the causes do to the gap of another maneuver."""
    if share < 0.0:
        return "on the other maneuver it makes the gap larger: it is not there"
    return f"on the other maneuver it closes {percent(share)}"
