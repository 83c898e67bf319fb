"""Numbers as text: for every reader of YAML, JSON and C, and for people with their standard deviation."""

from __future__ import annotations

import math


def number(value: float) -> str:
    """A float with all its digits and always a point: YAML 1.1 takes ``1e-05`` for a text."""
    text = repr(float(value))
    mantissa, e, exponent = text.partition("e")
    return (mantissa if "." in mantissa else f"{mantissa}.0") + e + exponent


def with_std(value: float, std: float | None, none: str = "–") -> tuple[str, str]:
    """A value and its standard deviation to the second significant digit of the latter; without one, ``none``."""
    if std is None or not math.isfinite(std) or std <= 0.0:
        return f"{value:.6g}", none
    decimals = min(max(1 - math.floor(math.log10(std)), 0), 12)
    return f"{value:.{decimals}f}", f"{std:.{decimals}f}"
