"""The noise procedure of Renk et al.: the arm locked in a few orientations, the RMS noise of each, and their mean.

Everything comes with its uncertainty. That of an RMS is found from the spread of mean squares over stretches of each
pose, so that it also holds for noise that is not white.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from estimators.noise.settling import unsettled
from rig.arrays import Array, Rows
from rig.channels import CHANNELS, COLUMNS_OF
from rig.documents import plain
from rig.errors import RigError
from rig.number_text import with_std
from rig.recording import Recording, whole_or_beginning
from rig.units import conversion_factor

#: The sensors' output range [V] to which the paper's dynamic ranges refer: 20 log10(5 V / RMS).
FULL_SCALE_V: Final = 5.0
#: One bit of dynamic range [dB]; the paper rounds 20 log10(2) = 6.0206 to it.
DB_PER_BIT: Final = 6.02

#: A pose is held where joint angles and quaternion elements stay within this [rad] for ``HOLD_S``: encoders toggle by
#: some 1e-5, tracking systems tremble by some 1e-4, and an arm that moves at 1 deg/s covers 9e-3.
HOLD_RANGE: Final = 2e-3
HOLD_S: Final = 0.5
#: Fewer samples than this are no pose.
SHORTEST_POSE: Final = 20
_STRETCHES: Final = 20


@dataclass(frozen=True, eq=False)
class NoiseFloor:
    """The noise of every recorded channel.

    Attributes:
        channels: (c,) names, in the order of ``rig.channels.CHANNELS``. units: (c,) recorded units.
        rms: (c,) mean over the poses of the RMS about each pose's mean [recorded unit], and rms_std its standard error.
        pose_rms: (p, c) of each pose. pose_samples: (p,).
        dynamic_range_dB, dynamic_range_std_dB: (c,) 20 log10(full scale / RMS); NaN for channels not in volts.
        bits, bits_std: (c,) dynamic range over 6.02 dB.
        rate_Hz: of the recording.
    """

    channels: tuple[str, ...]
    units: tuple[str, ...]
    rms: Array
    rms_std: Array
    pose_rms: Array
    pose_samples: Rows
    dynamic_range_dB: Array
    dynamic_range_std_dB: Array
    bits: Array
    bits_std: Array
    rate_Hz: float = np.nan

    def of(self, sensor: str, unit: str | None = None) -> tuple[Array, Array] | None:
        """RMS and its standard error of a sensor's channels, (3,) each, in ``unit``; None where it was not recorded.

        Raises:
            RigError: ``unit`` is of another quantity.
        """
        names = CHANNELS[COLUMNS_OF[sensor]]
        if names[0] not in self.channels:
            return None
        rows = [self.channels.index(name) for name in names]
        recorded = self.units[rows[0]]
        factor = 1.0 if unit is None else conversion_factor(recorded, unit)
        return factor * self.rms[rows], factor * self.rms_std[rows]

    def __str__(self) -> str:
        """A readable table."""
        rows: list[tuple[str, ...]] = [("channel", "RMS", "std", "unit", "dynamic range [dB]", "bits")]
        for i, (channel, unit) in enumerate(zip(self.channels, self.units, strict=True)):
            rms = with_std(self.rms[i], self.rms_std[i], "-")
            others = (
                f"{value:.2f}" if np.isfinite(value) else "-" for value in (self.dynamic_range_dB[i], self.bits[i])
            )
            rows.append((channel, *rms, unit, *others))
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
        return "\n".join([f"Noise at rest, samples in each pose: {', '.join(map(str, self.pose_samples))}", *lines])

    def to_json(self) -> dict[str, Any]:
        """A JSON object: per channel RMS, dynamic range and bits with their standard errors."""
        columns = ("rms", "rms_std", "dynamic_range_dB", "dynamic_range_std_dB", "bits", "bits_std")
        return {
            "format": "rig-noise/1",
            "pose_samples": plain(self.pose_samples),
            "channels": {
                name: {
                    "unit": self.units[i],
                    "pose_rms": plain(self.pose_rms[:, i]),
                    **{key: plain(getattr(self, key)[i]) for key in columns},
                }
                for i, name in enumerate(self.channels)
            },
        }


def noise_floor(
    locked: Recording | str | os.PathLike[str], poses: ArrayLike | None = None, full_scale_V: float = FULL_SCALE_V
) -> NoiseFloor:
    """The noise of each channel from a locked-arm recording.

    Args:
        locked: one or more held poses, one after the other; the way between them is left out. Without joint angles or
            tool poses it is taken as one pose. Of a file as much as the memory holds.
        poses: (n,) number of the pose of each sample, negative where it moves, instead of finding them.
        full_scale_V: output range of the sensors [V].

    Raises:
        RigError: no pose is held for long enough, ``poses`` has another length, or the file cannot be read.
    """
    if not isinstance(locked, Recording):
        locked = whole_or_beginning(locked)[0]
    where = locked.origin or locked.name
    labels = held_poses(locked) if poses is None else np.asarray(poses)
    if labels.shape != (len(locked),):
        raise RigError(f"{where}: poses: found shape {labels.shape}, expected ({len(locked)},)")
    numbers = [number for number in np.unique(labels[labels >= 0]) if (labels == number).sum() >= SHORTEST_POSE]
    if not numbers:
        raise RigError(
            f"{where}: no pose is held for {HOLD_S:g} s and {SHORTEST_POSE} samples, expected a locked-arm recording"
        )
    readings = locked.every_reading
    channels = tuple(name for sensor in locked.sensors for name in CHANNELS[COLUMNS_OF[sensor]])
    units = tuple(locked.units[sensor] for sensor in locked.sensors for _ in range(3))
    segments = [readings[labels == number] for number in numbers]
    samples = np.array([len(segment) for segment in segments])
    squares = [np.square(segment - segment.mean(axis=0)) for segment in segments]
    variance = np.array([square.sum(axis=0) / (len(square) - 1) for square in squares])
    variance_std = np.array([_mean_std(square) for square in squares])
    pose_rms = np.sqrt(variance)
    safe = np.where(pose_rms > 0.0, pose_rms, 1.0)
    rms = pose_rms.mean(axis=0)
    rms_std = np.sqrt(np.square(variance_std / (2.0 * safe)).sum(axis=0)) / len(numbers)
    in_volts = np.array([conversion_factor(unit, "V") if unit in ("V", "mV") else np.nan for unit in units])
    with np.errstate(divide="ignore", invalid="ignore"):  # noise of zero: an infinite dynamic range
        dynamic_range = 20.0 * np.log10(full_scale_V / (in_volts * rms))
        spread = np.where(np.isnan(in_volts), np.nan, 20.0 / np.log(10.0) * rms_std / rms)
    return NoiseFloor(
        channels,
        units,
        rms,
        rms_std,
        pose_rms,
        samples,
        dynamic_range,
        spread,
        dynamic_range / DB_PER_BIT,
        spread / DB_PER_BIT,
        locked.rate_Hz,
    )


def held_poses(locked: Recording) -> Rows:
    """The number of the held pose (n,) that each sample belongs to, in order; -1 where the arm moves.

    A sample is held when no joint angle (or element of the tool's quaternion) leaves a range of ``HOLD_RANGE`` in the
    ``HOLD_S`` around it, and the readings have settled.
    """
    pose = locked.q if locked.q is not None else locked.tool_quaternion
    if pose is None:
        return np.zeros(len(locked), dtype=np.intp)
    if len(locked) < SHORTEST_POSE:
        return np.full(len(locked), -1, dtype=np.intp)
    window = max(3, min(len(locked), round(HOLD_S * locked.rate_Hz)))
    span = np.zeros(len(locked))
    for column in pose.T:
        if np.ptp(column) > 0.0:  # most joints are locked throughout
            highest = maximum_filter1d(column, window, mode="nearest")
            np.maximum(span, highest - minimum_filter1d(column, window, mode="nearest"), out=span)
    held = span <= HOLD_RANGE
    begins = held & ~np.concatenate([[False], held[:-1]])
    labels = np.where(held, np.cumsum(begins) - 1, -1)
    return np.where(unsettled(labels, locked.every_reading), -1, labels)


def _mean_std(squares: Array) -> Array:
    """Standard error (c,) of the mean of squared deviations (n, c), whatever their correlation in time.

    The larger of what independent Gaussian samples give and of the spread between ``_STRETCHES`` stretches, which
    are long against the correlation; so a floor is never claimed to be better known than white noise allows.
    """
    count = len(squares)
    mean = squares.mean(axis=0)
    white = mean * np.sqrt(2.0 / (count - 1))
    stretch = count // _STRETCHES
    if stretch < 2:
        return np.asarray(white)
    means = squares[: stretch * _STRETCHES].reshape(_STRETCHES, stretch, -1).mean(axis=1)
    return np.asarray(np.maximum(white, means.std(axis=0, ddof=1) / np.sqrt(_STRETCHES)))


def given_floor(noise: Mapping[str, ArrayLike] | ArrayLike) -> dict[str, Array]:
    """Noise as a caller gives it, by sensor: a mapping of sensor to (3,), or all six channels (6,) [recorded unit].

    Raises:
        RigError: another shape.
    """
    if isinstance(noise, Mapping):
        return {sensor: np.asarray(values, dtype=float) for sensor, values in noise.items()}
    values = np.asarray(noise, dtype=float)
    if values.shape != (len(CHANNELS),):
        raise RigError(
            f"noise: found an array of shape {values.shape}, expected ({len(CHANNELS)},) or one entry a sensor"
        )
    return {sensor: values[columns] for sensor, columns in COLUMNS_OF.items()}
