"""Errors of a noise effect that a recording shows by itself."""

from __future__ import annotations

from dataclasses import dataclass

from rig.arrays import Array


@dataclass(frozen=True)
class ErrorsShown:
    """Errors of a noise effect that a recording itself shows.

    Attributes:
        errors: (n, r) as ``Effect.response`` takes them, at strength one.
        hidden: (n,) share of each cosine of these, from the slowest to the fastest, that it does not show.
    """

    errors: Array
    hidden: Array
