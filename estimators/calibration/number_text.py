"""Numbers as text that every reader of YAML, JSON and C takes for the same number."""

from __future__ import annotations


def number(value: float) -> str:
    """A float with all its digits and always a point: YAML 1.1 takes ``1e-05`` for a text."""
    text = repr(float(value))
    mantissa, e, exponent = text.partition("e")
    return (mantissa if "." in mantissa else f"{mantissa}.0") + e + exponent
