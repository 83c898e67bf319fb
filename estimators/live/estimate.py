"""The calibration of one sensor from everything that has come so far, by the estimators that are used offline.

With a pose: the sufficient statistics of the known-angle model, brought up to date in constant time and memory.
Without: the ellipsoid of the samples that are kept, all of them up to a bounded number (``ellipsoid.thinned``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import stdtrit

from estimators.coverage import Enough, Targets, enough_attitude_free, enough_known_angles
from estimators.ellipsoid.assembly import sensitivities_and_angles
from estimators.ellipsoid.calibrate import Options, fit_attitude_free
from estimators.ellipsoid.fit import EllipsoidFit
from estimators.ellipsoid.running import brought_up
from estimators.ellipsoid.thinned import Thinned
from estimators.known_angle.fit import SensorFit, fit_sensor
from estimators.known_angle.reported import report
from estimators.known_angle.statistics import Statistics
from estimators.live.cloud import Cloud
from estimators.live.stillness import StillStream
from estimators.live.window import SlidingSum
from rig.arrays import Array
from rig.channels import ACCELEROMETER
from rig.errors import RigError

#: Of the intervals that are shown and that the stop rule asks for.
LEVEL = 0.95
#: A reading of a field so many times too large shows no direction: it is no measurement.
_FARTHEST = 3.0
#: Without attitude all samples are fitted anew when there are so many times as many; in between sums are added.
_GROWTH = 1.1


@dataclass(frozen=True, eq=False)
class SensorEstimate:
    """What is known of a sensor now.

    Attributes:
        poses: how many still poses it comes from, None where from samples.
        samples: behind it.
        names, values, std: (p,) parameters in the recorded unit and degrees; a NaN cannot be told.
        problem: why the data cannot tell the parameters yet; None where they can.
        matrix, bias: field = matrix @ (reading - bias).
        noise: (3,) standard deviation of a reading [recorded unit].
        freedom: degrees of freedom behind the noise.
        magnitude: of the field.
        fit: the optimum.
        readings, counts: (m, 3), (m,) where the readings lie, thinned.
    """

    poses: int | None
    samples: int
    names: tuple[str, ...]
    values: Array
    std: Array
    problem: str | None
    matrix: Array
    bias: Array
    noise: Array
    freedom: float
    magnitude: float
    fit: SensorFit | EllipsoidFit
    readings: Array
    counts: Array

    @property
    def quantile(self) -> float:
        """Of Student's distribution: half an interval over a standard deviation."""
        return float(stdtrit(max(self.freedom, 1.0), 0.5 * (1.0 + LEVEL)))

    @cached_property
    def directions(self) -> Array:
        """(m, 3) unit vectors of the field in the sensor's frame, where the readings lie."""
        field = (self.readings - self.bias) @ self.matrix.T
        length = np.sqrt(np.square(field).sum(axis=1))
        return np.asarray(field / np.where(length > 0.0, length, 1.0)[:, None])

    @property
    def relative_noise(self) -> Array:
        """(3,) standard deviation of a reading as a share of the field."""
        return np.asarray(self.noise * np.sqrt(np.square(self.matrix).sum(axis=0)) / self.magnitude)

    def enough(self, to: float) -> Enough:
        """Whether every parameter's interval is within +-``to``.

        Args:
            to: half of the interval, relative (sensitivity), as a share of the field (offset) and in radians (angles).
        """
        share = to / self.quantile
        targets = Targets(share, share, float(np.degrees(share)), None)
        if isinstance(self.fit, SensorFit):
            targets = Targets(share, share, float(np.degrees(share)), float(np.degrees(share)))
            return enough_known_angles(self.fit.information, self.directions, targets)
        return enough_attitude_free(self.directions, self.relative_noise, targets, self.counts, self.fit.parameters)

    @property
    def told(self) -> bool:
        """Whether the data tell the parameters."""
        return self.problem is None


class AttitudeKnown:
    """One sensor on an arm."""

    def __init__(self, sensor: str, magnitude: float, span_s: float | None, field_points: Array) -> None:
        """Args as of ``SensorStream``."""
        self.sensor, self._magnitude, self._points = sensor, magnitude, field_points
        self.sums = SlidingSum(span_s)
        self.cloud = Cloud(span_s)

    def add(self, t_s: float, statistics: Statistics, readings: Array) -> None:
        """Samples by their statistics, and their readings (n, 3)."""
        self.sums.add(t_s, statistics)
        self.cloud.add(t_s, readings)

    def estimate(self) -> SensorEstimate:
        """Raises: RefusedFit, RigError: there is none yet."""
        total = self.sums.total
        if total is None:
            raise RigError(f"{self.sensor}: no samples yet")
        fit = fit_sensor(total, self._magnitude, name=self.sensor, refuse=False, field_points=self._points, noise=None)
        found = report(fit.parameters, fit.covariance, fit.method)
        gain = fit.parameters.gain
        singular = abs(float(np.linalg.det(fit.parameters.axes))) < 1e-9
        return SensorEstimate(
            None,
            fit.count,
            found.names,
            found.values,
            np.sqrt(np.diagonal(found.covariance)),
            fit.problem,
            np.full((3, 3), np.nan) if singular else np.asarray(np.linalg.inv(gain)),
            fit.parameters.offset,
            fit.noise,
            float(np.min(fit.degrees_of_freedom)),
            self._magnitude,
            fit,
            self.cloud.means,
            self.cloud.counts,
        )


class AttitudeFree:
    """One sensor turned by hand: the offline fit of the samples that are kept, brought up to date by what is new."""

    def __init__(self, sensor: str, magnitude: float, span_s: float | None, options: Options, rate_Hz: float) -> None:
        """Args:
        options: of the offline fit.
        rate_Hz: of the samples.
        """
        self.sensor, self._magnitude, self._options = sensor, magnitude, options
        #: An accelerometer feels motion too, so that it has to stand still; None: all readings count.
        self.still = StillStream(rate_Hz, span_s=span_s) if sensor == ACCELEROMETER else None
        self.cloud = Cloud(span_s)
        self._span_s, self._rows = span_s, 0
        self._before: Array | None = None
        self._known: SensorEstimate | None = None
        self._refused: RigError | None = None
        self._whole = _Whole(0, 0, 0, -1)

    def add(self, t: Array, readings: Array) -> None:
        """Samples (n, 3) at times (n,) [s]; repeated and absurd ones show no direction."""
        if self.still is not None:
            self.still.add(t, readings)
        used = readings
        again = (readings[1:] == readings[:-1]).all(axis=1)
        first_again = self._before is not None and bool((readings[0] == self._before).all())
        if first_again or again.any():
            used = readings[~np.concatenate([[first_again], again])]
        self._before = readings[-1].copy()
        if self._known is not None and self._known.told:
            field = (used - self._known.bias) @ self._known.matrix.T
            used = used[np.square(field).sum(axis=1) < (_FARTHEST * self._magnitude) ** 2]
        if len(used):
            self.cloud.add(float(t[-1]), used)

    def due(self, kept: Thinned) -> bool:
        """Whether all samples that are kept should be fitted anew, not only what is new be added."""
        whole, now = self._whole, self._now(kept)
        if now.pieces != whole.pieces or now.step != whole.step or (self._known is None and self._refused is None):
            return True
        return now.rows > _GROWTH * whole.rows or (self._span_s is not None and now.seen > whole.seen)

    def estimate(self, kept: Thinned, whole: bool) -> SensorEstimate:
        """Args:
        kept: the samples that count.
        whole: fit all of them; otherwise the last fit is brought up to date, if it can be.

        Raises:
            RefusedFit, RigError: there is none yet.
        """
        if not whole and self._refused is not None:
            raise self._refused
        known, now = self._known, self._now(kept)
        if not whole and known is not None:
            if known.poses is not None or known.fit.problem is not None:
                return known
            assert isinstance(known.fit, EllipsoidFit)
            new = now.rows - self._rows
            fit = known.fit if not new else brought_up(known.fit, kept.latest(self.sensor, new + 1))
            if fit is not None:
                self._rows = now.rows
                self._known = self._made(fit, None, self.cloud.means, self.cloud.counts)
                return self._known
        self._refused, self._known, self._whole, self._rows = None, None, now, now.rows
        try:
            self._known = self._fitted(kept)
        except RigError as error:
            self._refused = error
            raise
        return self._known

    def _fitted(self, kept: Thinned) -> SensorEstimate:
        if not len(kept):
            raise RigError(f"{self.sensor}: no samples yet")
        fitted = fit_attitude_free(kept.recording(), self.sensor, None, self._options, refuse=False)
        if fitted.counts is None:
            return self._made(fitted.fit, None, self.cloud.means, self.cloud.counts)
        return self._made(fitted.fit, len(fitted.counts), fitted.used.readings(self.sensor), fitted.counts)

    def _made(self, fit: EllipsoidFit, poses: int | None, readings: Array, counts: Array) -> SensorEstimate:
        names, values, derivative = sensitivities_and_angles(fit)
        covariance = derivative @ fit.covariance @ derivative.T
        problem = fit.problem
        if problem is None and self.still is not None and poses is None:
            problem = f"stood still in {len(self.still)} poses, expected more than {self._options.parameters}"
        return SensorEstimate(
            poses,
            fit.samples if poses is None else int(counts.sum()),
            names,
            values,
            np.sqrt(np.maximum(np.diagonal(covariance), 0.0)),
            problem,
            fit.matrix,
            fit.offset,
            fit.noise,
            float(fit.degrees_of_freedom),
            self._magnitude,
            fit,
            readings,
            counts,
        )

    def _now(self, kept: Thinned) -> _Whole:
        posed = self.still is not None and len(self.still) > self._options.parameters
        return _Whole(len(kept), kept.seen, kept.step, self.still.accepted if posed and self.still is not None else -1)


@dataclass(frozen=True)
class _Whole:
    """What there was when all samples were fitted: how many were kept, and had come, one of how many was kept, and the
    pieces of time through which the sensor rested."""

    rows: int
    seen: int
    step: int
    pieces: int
