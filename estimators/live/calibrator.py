"""All sensors of a stream, calibrated as it comes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from estimators.coverage import Enough, direction_name
from estimators.ellipsoid.calibrate import Options as EllipsoidOptions
from estimators.ellipsoid.fit import Parameters
from estimators.ellipsoid.thinned import Thinned
from estimators.known_angle.from_recording import arm_of, has_pose, points_of, statistics_of
from estimators.live.estimate import AttitudeFree, AttitudeKnown, SensorEstimate
from rig.arrays import Array
from rig.channels import ACCELEROMETER
from rig.errors import RigError
from rig.recording import Recording
from rig.threads import one_blas_thread

if TYPE_CHECKING:
    from rig.arm import Arm


#: No direction may be farther from one that was seen, without attitude [deg]: of six faces none is farther than 55.
HOLE_DEG: Final = 65.0
#: Of longer streams without attitude every second sample is used, or every fourth, .., live and at the end, so that
#: memory does not grow.
MOST_SAMPLES: Final = 1 << 17


@dataclass(frozen=True)
class Options:
    """How to calibrate a stream.

    Attributes:
        to: half of the interval that every parameter is to have: relative, as a share of the field, in radians.
        forget_s: length of a sliding window [s]; None: everything counts.
        parameters: of a fit without attitude.
        attitude: whether recorded poses are used.
        field_points: sensor -> a vector within 90 degrees of the field, base frame; down where nothing is said.

    Raises:
        RigError: a number that is not positive.
    """

    to: float = 1e-3
    forget_s: float | None = None
    parameters: Parameters = 9
    attitude: bool = True
    field_points: Mapping[str, tuple[float, float, float]] | None = None

    def __post_init__(self) -> None:
        for name in ("to", "forget_s"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < np.inf:
                raise RigError(f"{name}: found {value:g}, expected a positive number")


@dataclass(frozen=True, eq=False)
class SensorState:
    """Where a sensor's calibration stands.

    Attributes:
        sensor: which one.
        estimate: None where there is none yet, and ``problem`` says why.
        problem: why the data do not tell it.
        rule: the stop rule's answer; None without an estimate.
        enough: whether it may stop.
        turn: what to do next, in a few words.
    """

    sensor: str
    estimate: SensorEstimate | None
    problem: str | None
    rule: Enough | None
    enough: bool
    turn: str

    @property
    def interval(self) -> float:
        """Half of the widest interval that the rule asks about; infinite where one cannot be told."""
        if self.rule is None or self.estimate is None or not self.estimate.told:
            return np.inf
        return self.rule.std[self.rule.worst] * self.estimate.quantile

    @property
    def seen(self) -> float:
        """The share of the sphere that was seen."""
        return 0.0 if self.rule is None else self.rule.coverage.share


class Calibrator:
    """Takes samples up, and tells what they say so far; its memory does not grow."""

    def __init__(self, first: Recording, options: Options, arm: Arm | None = None) -> None:
        """Args:
        first: samples of the stream, which say what it holds; they are not taken up yet.
        options: how.
        arm: for joint angles; None: the A465 where the metadata name it.

        Raises:
            RigError: joint angles of an arm that is not known.
        """
        self.options = options
        self.sensors = first.sensors
        self.posed = has_pose(first) and options.attitude
        self.arm = arm_of(first, arm, first.name) if self.posed else None
        self.samples = 0
        self._fitted_at = -1
        self._metadata = first.metadata
        self._units = dict(first.units)
        self._known: dict[str, AttitudeKnown] = {}
        self._free: dict[str, AttitudeFree] = {}
        self._kept = Thinned(MOST_SAMPLES, options.forget_s)
        points = options.field_points or {}
        for sensor in first.sensors:
            magnitude = first.metadata.magnitude(sensor)
            if self.posed:
                towards = np.array(points_of(points, sensor, first.metadata))
                self._known[sensor] = AttitudeKnown(sensor, magnitude, options.forget_s, towards)
            else:
                own = EllipsoidOptions(parameters=options.parameters)
                self._free[sensor] = AttitudeFree(sensor, magnitude, options.forget_s, own, first.rate_Hz)

    def add(self, batch: Recording) -> None:
        """Take samples up.

        Raises:
            RigError: a joint beyond its limit.
        """
        self.samples += len(batch)
        t_s = float(batch.t[-1])
        if self.posed:
            readings = [batch.readings(sensor) for sensor in self.sensors]
            with one_blas_thread():
                total = statistics_of(batch, self.arm, readings, batch.name)
            for place, sensor in enumerate(self.sensors):
                part = total.select(slice(3 * place, 3 * place + 3))
                self._known[sensor].add(t_s, part, batch.readings(sensor))
            return
        self._kept.add(batch)
        for sensor, stream in self._free.items():
            stream.add(batch.t, batch.readings(sensor))

    @property
    def forgotten_s(self) -> float:
        """With a pose: samples up to this time do not count any more [s]."""
        return max((each.sums.forgotten_s for each in self._known.values()), default=-np.inf)

    def estimate(self, sensor: str, whole: bool = True) -> SensorEstimate:
        """What is known of a sensor now.

        Without attitude and without ``whole`` the last fit is brought up to date by the sums of what is new
        (``ellipsoid.running``); all samples are fitted now and then, but never those of two sensors at once.

        Raises:
            RefusedFit, RigError: nothing yet.
        """
        with one_blas_thread():
            if self.posed:
                return self._known[sensor].estimate()
            stream = self._free[sensor]
            if not whole and self._fitted_at != self.samples and stream.due(self._kept):
                whole, self._fitted_at = True, self.samples
            return stream.estimate(self._kept, whole)

    def state(self, sensor: str, last: SensorState | None = None, whole: bool = True) -> SensorState:
        """Where a sensor stands, with the stop rule: that of ``last``, if there is one, which takes longer to ask.

        ``whole`` as of ``estimate``.
        """
        try:
            estimate = self.estimate(sensor, whole)
        except RigError as error:
            return SensorState(sensor, None, str(error).split(f"{sensor}: ", 1)[-1], None, False, self._begin())
        if not np.isfinite(estimate.matrix).all() or not len(estimate.readings):
            return SensorState(sensor, estimate, estimate.problem, None, False, self._begin())
        if last is not None and last.rule is not None:
            return SensorState(sensor, estimate, estimate.problem, last.rule, last.enough, last.turn)
        rule = estimate.enough(self.options.to)
        wide = not self.posed and rule.coverage.hole_deg > HOLE_DEG
        enough = rule.enough and not wide and estimate.told
        toward = rule.coverage.hole if wide or rule.next_direction is None else rule.next_direction
        turn = "" if enough else self.turn(sensor, np.asarray(toward))
        return SensorState(sensor, estimate, estimate.problem, rule, enough, turn)

    def up(self, sensor: str, directions: Array) -> Array:
        """Which way up is in the sensor's frame, for directions (n, 3) of the field, or of readings.

        With a pose, or in volts, they follow what the metadata say; without a pose those of a chip, in g, m/s^2 or
        counts, are taken to be a - g, up at rest.
        """
        volts = self._units[sensor] in ("V", "mV")
        follows_g = (self.posed or volts) and self._metadata.accelerometer_reads == "g-a"
        return -directions if follows_g else directions

    def turn(self, sensor: str, direction: Array) -> str:
        """The field along a direction (3,) of the sensor's frame, in words."""
        if self.posed:
            return f"bring the field along {direction_name(direction)} of frame 6"
        if sensor == ACCELEROMETER:
            return f"point {direction_name(self.up(sensor, direction))} up and hold it still"
        return f"point {direction_name(direction)} along the field"

    def _begin(self) -> str:
        return "move the arm through its sweep" if self.posed else "turn it slowly, about every axis"
