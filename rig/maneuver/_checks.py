"""Checks of what a maneuver is made with; a scenario file hands in whatever its author typed."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Real
from typing import Final

import numpy as np

from rig.errors import RigError

Limits = Sequence[tuple[float, float]]

#: Limits of the CRS A465's joints 1 to 6 [deg], in the model's joint variables; joint 6 is free to roll on where a
#: maneuver says so.
A465_LIMITS_DEG: Final = (
    (-175.0, 175.0),
    (0.0, 180.0),
    (-110.0, 110.0),
    (-180.0, 180.0),
    (-105.0, 105.0),
    (-180.0, 180.0),
)

_SLACK_DEG: Final = 1e-6


def number(where: str, value: object, low: float = -np.inf, high: float = np.inf, above: bool = False) -> float:
    """A finite number in [low, high], or in (low, high] with ``above``.

    Raises:
        RigError: it is none.
    """
    if isinstance(value, Real) and not isinstance(value, bool) and np.isfinite(float(value)):
        found = float(value)
        if low <= found <= high and not (above and found == low):
            return found
    if np.isinf(low) and np.isinf(high):
        expected = "a finite number"
    elif np.isinf(high):
        expected = f"a number {'above' if above else 'of at least'} {low:g}"
    else:
        expected = f"a number from {low:g} to {high:g}"
    raise RigError(f"{where}: found {value!r}, expected {expected}")


def whole(where: str, value: object, low: int = 0) -> int:
    """A whole number of at least ``low``.

    Raises:
        RigError: it is none.
    """
    if isinstance(value, int) and not isinstance(value, bool) and value >= low:
        return value
    raise RigError(f"{where}: found {value!r}, expected a whole number of at least {low}")


def numbers(where: str, values: object, length: int | None = None) -> tuple[float, ...]:
    """A sequence of finite numbers, of a given length if one is given.

    Raises:
        RigError: it is none.
    """
    if not isinstance(values, Sequence | np.ndarray) or isinstance(values, str):
        raise RigError(f"{where}: found {values!r}, expected a list of numbers")
    if length is not None and len(values) != length:
        raise RigError(f"{where}: found {len(values)} values, expected {length}")
    return tuple(number(f"{where}[{index}]", value) for index, value in enumerate(values))


def poses(where: str, values: object) -> tuple[tuple[float, ...], ...]:
    """At least one pose, all with the same number of joint angles [deg].

    Raises:
        RigError: it is none.
    """
    if not isinstance(values, Sequence | np.ndarray) or isinstance(values, str) or len(values) == 0:
        raise RigError(f"{where}: found {values!r}, expected a list of poses, each a list of joint angles in deg")
    first = numbers(f"{where}[0]", values[0])
    return tuple(numbers(f"{where}[{index}]", pose, len(first)) for index, pose in enumerate(values))


def within(where: str, joint: int, low_deg: float, high_deg: float, limits_deg: Limits | None) -> None:
    """Refuse a joint's motion from ``low_deg`` to ``high_deg`` that leaves the limits of joint ``joint`` (from 1).

    Raises:
        RigError: it does.
    """
    if limits_deg is None:
        return
    low, high = limits_deg[joint - 1]
    if low_deg < low - _SLACK_DEG or high_deg > high + _SLACK_DEG:
        found = f"{low_deg:.6g} to {high_deg:.6g}" if low_deg != high_deg else f"{low_deg:.6g}"
        raise RigError(f"{where}: joint{joint} goes to {found} deg, expected within {low:g} to {high:g} deg")


def limits(where: str, values: object, joints: int) -> tuple[tuple[float, float], ...] | None:
    """Limits (low, high) [deg] of every joint, or None for no check.

    Raises:
        RigError: they are not one pair a joint.
    """
    if values is None:
        return None
    pairs = poses(where, values)
    if len(pairs) != joints or len(pairs[0]) != 2:
        raise RigError(f"{where}: found {len(pairs)} entries, expected a pair (low, high) for each of {joints} joints")
    return tuple((pair[0], pair[1]) for pair in pairs)
