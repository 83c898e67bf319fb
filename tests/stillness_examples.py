"""Recordings that the tests of static detection share."""

from __future__ import annotations

from functools import cache

import numpy as np

from rig.acquisition import Acquisition
from rig.arm import Arm
from rig.directions import direction_from_angles
from rig.environment import Environment
from rig.maneuver import StaticPoses
from rig.recording import Metadata, Recording
from rig.sensor import TriaxialSensor
from rig.simulate import Rig

NOISE = (0.0134, 0.0136, 0.0146, 0.0085, 0.0068, 0.0117)
ACCELEROMETER = TriaxialSensor((0.142, 0.143, 0.141), (2.4, 2.5, 2.1), (85.0, -1.0, 1.0), (90.0, 1.0, 272.0))
MAGNETOMETER = TriaxialSensor((1.3, 1.33, 1.34), (2.4, 2.4, 2.7), (1.0, -86.0, -4.0), (270.0, 186.0, 1.0))
SKY = Environment(
    gravity_direction=tuple(direction_from_angles(90.0, 0.0)),
    magnetic_direction=tuple(direction_from_angles(60.0, 80.0)),
)


def rig(arm: Arm | None, magnetometer: bool = True) -> Rig:
    board = Acquisition(NOISE, decimation=1, pose="joints" if arm is not None else "none")
    return Rig(arm, SKY, ACCELEROMETER, MAGNETOMETER if magnetometer else None, board)


@cache
def stops() -> tuple[StaticPoses, Recording]:
    """Twenty poses of four seconds, at 100 Hz, with joint angles."""
    maneuver = StaticPoses(count=20, hold_s=4.0, move_s=3.0, seed=3)
    return maneuver, rig(Arm.a465()).simulate(maneuver, np.random.default_rng(1))


def at_rest(n: int, noise: float = 0.01, seed: int = 0, **changes: object) -> Recording:
    readings = np.random.default_rng(seed).normal(2.5, noise, (n, 3))
    contents = {"t": np.arange(n) / 100.0, "accelerometer": readings, "metadata": Metadata(rate_Hz=100.0), **changes}
    return Recording(**contents)  # type: ignore[arg-type]
