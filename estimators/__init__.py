"""Volts in, answers out.

``run`` is a ``rig.Recording``; ``calibrate``, ``diagnose``, ``is_it_good`` and ``judged`` also take the path of one.

- ``calibrate(run)``: a ``Calibration``, of a ``SensorCalibration`` for each sensor: sensitivities, offsets and axes
  with their covariance, and what the run cannot tell. A list of runs makes one calibration. It is kept in a file by
  ``.write(path)`` and ``Calibration.read(path)``.
- ``robust_calibrate(run)``: the same without outliers, and which these are.
- ``is_it_good(run, calibration)``: ``Goodness`` of each sensor with the reasons, and the ``Coverage`` of directions;
  ``judged(run, calibration)`` writes it into the calibration, ``judged_together(runs, calibration)`` of several runs.
- ``apply(calibration, run)``: readings as fields [m/s^2, unit of the magnetic field].
- ``diagnose(run)``: a ``Diagnosis``: where a run disagrees with the model, and which unmodelled effects cause it.
- ``noise_floor(locked)``: the noise of a recording at rest, a ``NoiseFloor``.
- ``still_poses(run)``: when the sensor stood still, and what it read.

``estimators.ellipsoid`` (no attitude), ``estimators.coverage`` (directions seen) and ``estimators.stillness``: more.
The diagnosis is imported when it is first asked for: that takes as long as everything else together.
"""

from typing import TYPE_CHECKING, Any

from estimators import coverage, ellipsoid, stillness
from estimators.calibration import Calibration, SensorCalibration
from estimators.calibration.fields import apply
from estimators.coverage import Coverage
from estimators.dispatch import calibrate
from estimators.goodness import Goodness, is_it_good, judged, judged_together, robust_calibrate
from estimators.noise import NoiseFloor, noise_floor
from estimators.stillness import still_poses

if TYPE_CHECKING:
    from estimators.gap import Diagnosis, diagnose

__all__ = [
    "Calibration",
    "Coverage",
    "Diagnosis",
    "Goodness",
    "NoiseFloor",
    "SensorCalibration",
    "apply",
    "calibrate",
    "coverage",
    "diagnose",
    "ellipsoid",
    "is_it_good",
    "judged",
    "judged_together",
    "noise_floor",
    "robust_calibrate",
    "still_poses",
    "stillness",
]


def __getattr__(name: str) -> Any:
    if name in ("Diagnosis", "diagnose"):
        from estimators import gap

        return getattr(gap, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(__all__)
