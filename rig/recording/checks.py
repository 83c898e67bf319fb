"""What must hold for the samples of a recording: numbers, in the order of time, with poses that are rotations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from rig.arrays import Array
from rig.errors import RigError

#: How far a quaternion's norm may be from one. Rounding every component to three decimals moves it by up to
#: 0.0005 * sum |q_i| <= 0.001; a norm further away is another mistake.
NORM_TOLERANCE: Final = 1e-3
#: No quantity of a recording is as large, and its fourth power is still a number.
_LARGEST: Final = 1e60

#: Units of Unix time, and how many of each are a second.
_UNIX_UNITS: Final = (("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9))
_UNIX_S: Final = (6e8, 4.2e9)  # the years 1989 to 2103


def as_columns(values: object, what: str, where: str) -> Array:
    """A read-only float64 array (n,) or (n, k) whose columns are contiguous, without a copy where it is one already.

    Raises:
        RigError: not numbers.
    """
    try:
        array = np.asarray(values, dtype=np.float64, order="F").view()
    except (TypeError, ValueError) as error:
        raise RigError(f"{where}: {what} does not hold numbers: {error}") from error
    array.flags.writeable = False
    return array


def check_shape(array: Array, shape: tuple[int, ...], what: str, where: str) -> None:
    """Raise a RigError unless the array has the shape, in which -1 stands for any positive number."""
    fits = len(array.shape) == len(shape) and all(
        found == expected or (expected < 0 < found) for found, expected in zip(array.shape, shape, strict=True)
    )
    if not fits:
        expected = ", ".join("N" if size < 0 else str(size) for size in shape)
        raise RigError(
            f"{where}: {what} has shape {array.shape}, expected ({expected}{',' if len(shape) == 1 else ''})"
        )


def check_finite(array: Array, names: Sequence[str], where: str, first_row: int = 0) -> None:
    """Raise a RigError that names the first value of (n, k), or (n,), with k column names, that is no number, or so
    large that its powers are none."""
    with np.errstate(over="ignore", invalid="ignore"):
        flat = array.ravel(order="K")
        total = float(flat @ flat)  # one pass
    if total < _LARGEST**2:
        return
    columns = array.reshape(len(array), -1)
    rows, bad = np.nonzero(~(np.abs(columns) < _LARGEST))  # none where the sum alone is as large
    if rows.size:
        value = columns[rows[0], bad[0]]
        found = "NaN (or missing)" if np.isnan(value) else str(value)
        row = first_row + int(rows[0])
        expected = "a number" if not np.isfinite(value) else f"a number below {_LARGEST:g}"
        raise RigError(f"{where}: {names[bad[0]]} in row {row} (first row 0) is {found}, expected {expected}")


def check_increasing(t: Array, where: str, first_row: int = 0) -> None:
    """Raise a RigError that names the first time [s] that is not later than the one before, or by next to nothing."""
    later = t[1:] - t[:-1] > 1.0 / _LARGEST
    if not later.all():
        row = int(np.argmin(later)) + 1
        before, after = t[row - 1 : row + 1].tolist()
        by = f", expected at least {1.0 / _LARGEST:g} s more" if after > before else ""
        order = f"row {first_row + row} (first row 0) has {after!r} after {before!r}"
        raise RigError(f"{where}: t_s does not increase: {order}{by}")


def check_seconds(t: Array, where: str) -> None:
    """Raise a RigError for times that are of our days as Unix time in another unit."""
    begin = float(t[0])
    for unit, factor in _UNIX_UNITS:
        if _UNIX_S[0] <= begin / factor < _UNIX_S[1]:
            raise RigError(
                f"{where}: t_s begins with {float(t[0]):.6g}, which looks like Unix time in {unit}, expected seconds:"
                f" divide it by {factor:g}"
            )


def check_unit(quaternion: Array, names: Sequence[str], where: str, first_row: int = 0) -> None:
    """Raise a RigError that names the first quaternion of (n, 4) that is not a rotation."""
    with np.errstate(over="ignore"):
        squares = np.einsum("ij,ij->i", quaternion, quaternion)
    # |norm - 1| <= tol, without the roots: (1 - tol)^2 <= squares <= (1 + tol)^2
    good = (squares >= (1.0 - NORM_TOLERANCE) ** 2) & (squares <= (1.0 + NORM_TOLERANCE) ** 2)
    if not good.all():
        row = int(np.argmin(good))
        norm = math.hypot(*quaternion[row].tolist())
        columns = f"{names[0]}..{names[-1]}"
        raise RigError(f"{where}: {columns} in row {first_row + row} (first row 0) has the norm {norm:.6g}, expected 1")
