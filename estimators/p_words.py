"""A p-value in words."""

from __future__ import annotations

from typing import Final

#: What is less is told as less: a double has no smaller numbers than 5e-324, and nobody needs them.
_LEAST: Final = 1e-99


def p_words(value: float) -> str:
    """``p = 0.0012``, or ``p < 1e-99`` of what is as good as zero."""
    return f"p = {value:.2g}" if value > _LEAST else f"p < {_LEAST:g}"
