"""Prescribed motions, sampled: of the joints of an arm, or of a sensor in a hand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from rig.arrays import Array
from rig.errors import RigError
from rig.memory import check_fits

#: Of a simulation, from its motion to its readings.
_BYTES_A_SAMPLE: Final = 600


@dataclass(frozen=True)
class JointTrajectory:
    """A motion of N joints at n instants.

    Attributes:
        t: (n,) [s].
        q: (n, N) [rad].
        qd: (n, N) [rad/s], the time derivative of ``q``.
        qdd: (n, N) [rad/s^2], the time derivative of ``qd``.
    """

    t: Array
    q: Array
    qd: Array
    qdd: Array

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True)
class PoseTrajectory:
    """A motion of the sensor itself at n instants, without joints.

    Attributes:
        t: (n,) [s].
        R_base_tool: (n, 3, 3) rotation from the sensor's frame to the base frame.
        position: (n, 3) [m], base frame.
        acceleration: (n, 3) [m/s^2], base frame, without gravity: the second time derivative of ``position``.
    """

    t: Array
    R_base_tool: Array
    position: Array
    acceleration: Array

    def __len__(self) -> int:
        return len(self.t)


def sample_times(duration_s: float, rate_Hz: float) -> Array:
    """(n,) [s]: 0, 1/rate, .. with n = duration times rate; the end itself belongs to the next sample.

    Raises:
        RigError: no sample, or more than fit into the memory that may be taken.
    """
    check_samples(duration_s, rate_Hz)
    return np.arange(round(duration_s * rate_Hz)) / rate_Hz


def check_samples(duration_s: float, rate_Hz: float, what: str = "duration_s") -> None:
    """Refuse a motion that could not be simulated; ``what`` states its duration, for the message.

    Raises:
        RigError: no sample, or more than fit into the memory that may be taken.
    """
    samples = duration_s * rate_Hz
    where = f"{what} {duration_s:g} s at rate_Hz {rate_Hz:g} Hz"
    check_fits(samples * _BYTES_A_SAMPLE, f"{where}, {samples:.6g} samples")
    if round(samples) < 1:
        raise RigError(f"{where}: found no sample, expected one or more")
