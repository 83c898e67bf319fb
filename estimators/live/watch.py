"""The monitors of all sensors of a stream (``estimators.live.sensor_watch``)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Self

import numpy as np

from estimators.calibration import Calibration
from estimators.known_angle.from_recording import arm_of, has_pose
from estimators.live.alarm import Alarm
from estimators.live.estimate import SensorEstimate
from estimators.live.reference import Reference
from estimators.live.sensor_watch import WINDOWS, SensorWatch
from rig.channels import ACCELEROMETER
from rig.errors import RigError
from rig.recording import Recording

if TYPE_CHECKING:
    from rig.arm import Arm


class Watch:
    """The monitors of all sensors.

    Attributes:
        sensors: by name.
        alarms_a_day: that are false, on average, at most.
        alarms: all changes so far. arm: for joint angles.
    """

    def __init__(self, sensors: Mapping[str, SensorWatch], arm: Arm | None, alarms_a_day: float) -> None:
        """Args: as of ``of``."""
        self.sensors = dict(sensors)
        self.alarms_a_day = alarms_a_day
        self.alarms: list[Alarm] = []
        self.arm = arm

    @classmethod
    def of(
        cls,
        first: Recording,
        calibration: Calibration | None,
        arm: Arm | None,
        alarms_a_day: float = 1.0,
        learn_s: float = 60.0,
    ) -> Self:
        """A monitor of a stream.

        Args:
            first: samples of it.
            calibration: to be watched; None: the estimates that ``refer`` gives.
            arm: for joint angles; None: the A465 where the metadata name it.
            alarms_a_day: false ones, on average, at most.
            learn_s: how long the noise's memory is learnt [s].

        Raises:
            RigError: no sensor of the stream was calibrated, in another unit, or a rate that is not positive.
        """
        if not 0.0 < alarms_a_day < np.inf:
            raise RigError(f"alarms a day: found {alarms_a_day:g}, expected a positive number")
        posed = has_pose(first)
        names = [s for s in first.sensors if calibration is None or s in calibration.sensors]
        if calibration is not None and not names:
            raise RigError(
                f"{first.origin}: found {', '.join(first.sensors)}, expected a sensor that was calibrated:"
                f" {', '.join(calibration.sensors)}"
            )
        tests = len(names) * (2 * len(WINDOWS) + 2)
        watches = {}
        for sensor in names:
            unit = first.unit(sensor)
            fixed = calibration is not None
            rests = sensor == ACCELEROMETER and not posed
            watches[sensor] = SensorWatch(sensor, unit, first.rate_Hz, alarms_a_day / tests, learn_s, fixed, rests)
            if calibration is not None:
                own = calibration[sensor]
                if own.unit != unit:
                    raise RigError(
                        f"{first.origin}: the {sensor} comes in {unit}, expected the calibration's {own.unit}"
                    )
                watches[sensor].refer(Reference.of_calibration(own, posed))
        used = None
        if any(w.reference is None or w.reference.parameters is not None for w in watches.values()) and posed:
            used = arm_of(first, arm, first.origin)
        return cls(watches, used, alarms_a_day)

    def refer(self, estimates: Mapping[str, SensorEstimate]) -> None:
        """What is known of each sensor now, where that is what is watched."""
        for sensor, found in estimates.items():
            if found.told and np.isfinite(found.matrix).all():
                self.sensors[sensor].refer(Reference.of_estimate(found))

    def add(self, batch: Recording) -> list[Alarm]:
        """Take samples up; what there is to say."""
        found = []
        for watch in self.sensors.values():
            found += watch.add(batch, self.arm)
        for alarm in found:
            if alarm.begins:
                self.alarms.append(alarm)
            elif alarm.kind == "named":
                places = [i for i, old in enumerate(self.alarms) if old.sensor == alarm.sensor]
                if places:
                    self.alarms[places[-1]] = replace(self.alarms[places[-1]], names=alarm.names)
        return found
