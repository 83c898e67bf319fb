"""How far a piece of work is."""

from __future__ import annotations

from collections.abc import Callable

#: Is called again and again with the share that is done, from 0 to 1.
Progress = Callable[[float], None]


def unheard(share: float) -> None:
    """Progress that nobody watches."""
