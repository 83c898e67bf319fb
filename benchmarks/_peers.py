"""The packages that people fit ellipsoids with today, behind one call.

They are imported only when asked for, and one that is missing is left out. Every call's result is brought to a matrix W
and a centre b with field = W (reading - b), outside the timing.
"""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.baselines import li_griffiths
from estimators.ellipsoid import fit_ellipsoid
from rig.arrays import Array


@dataclass(frozen=True)
class Peer:
    """A way to fit an ellipsoid.

    Attributes:
        name: of the package and its call.
        prepare: brings readings (n, 3) into the form that the call takes, outside the timing.
        call: the calibration.
        interpret: from its result to (W, b).
        scaled: whether W has the field's magnitude; otherwise it is given it afterwards, from the same readings.
        covariance: whether the result holds one.
    """

    name: str
    call: Callable[[Any], Any]
    interpret: Callable[[Any], tuple[Array, Array]]
    prepare: Callable[[Array], Any] = lambda readings: readings
    scaled: bool = True
    covariance: bool = False

    def estimate(self, readings: Array) -> tuple[Array, Array] | None:
        """(W, b); None where it raises, or finds no real and finite ellipsoid."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                matrix, centre = self.interpret(self.call(self.prepare(readings)))
            except Exception:  # whatever a peer raises
                return None
        if np.iscomplexobj(matrix) or not (np.isfinite(matrix).all() and np.isfinite(centre).all()):
            return None
        if not self.scaled:
            matrix = matrix / np.sqrt(np.mean(np.square((readings - centre) @ matrix.T).sum(axis=1)))
        return matrix, centre


def ours(noise: Array | None = None, counts: Array | None = None) -> Peer:
    """The project's own, with its covariance; ``counts`` of averaged poses."""
    return Peer(
        "torusrig fit_ellipsoid",
        lambda readings: fit_ellipsoid(readings, noise=noise, counts=counts),
        lambda fit: (fit.matrix, fit.offset),
        covariance=True,
    )


def peers(noise: float) -> list[Peer]:
    """Those that are installed, and the textbook fit; for a field of magnitude one.

    Args:
        noise: the standard deviation of a reading, for those that ask for it.
    """
    found = [Peer("textbook (Li, Griffiths)", li_griffiths.fit, lambda result: result)]
    with contextlib.suppress(ImportError):
        found += _magyc(noise)
    with contextlib.suppress(ImportError):
        found += _mag_cal()
    with contextlib.suppress(ImportError):
        found += _magcc()
    with contextlib.suppress(ImportError):
        found += _magcal()
    return found


def _magyc(noise: float) -> list[Peer]:
    if not hasattr(np, "Inf"):
        setattr(np, "Inf", np.inf)  # noqa: B010  # gone since NumPy 2.0; twostep_hsi wants it
    from magyc import ellipsoid_fit, ellipsoid_fit_fang, twostep_hsi

    def inverted(result: Any) -> tuple[Array, Array]:
        return np.linalg.inv(result[1]), result[0]

    reference = np.array([1.0, 0.0, 0.0])
    return [
        Peer("magyc ellipsoid_fit", ellipsoid_fit, inverted, scaled=False),
        Peer("magyc ellipsoid_fit_fang", ellipsoid_fit_fang, inverted, scaled=False),
        Peer(
            "magyc twostep_hsi",
            lambda readings: twostep_hsi(readings, reference, measurement_noise_std=noise),
            inverted,
        ),
    ]


def _mag_cal() -> list[Peer]:
    from mag_cal import Sensor

    def call(readings: Array) -> Any:
        sensor = Sensor(axes="+X+Y+Z")
        sensor.fit_ellipsoid(readings)
        return sensor

    return [Peer("circuitpython-mag-cal fit_ellipsoid", call, lambda sensor: (sensor.transform.T, sensor.centre))]


def _magcc() -> list[Peer]:
    from magcc.magcc import calibrate_lm, calibrate_lse

    def interpreted(result: Any) -> tuple[Array, Array]:
        return result[1], result[0]

    return [
        Peer("magcc calibrate_lse", lambda readings: calibrate_lse(readings, 1.0), interpreted),
        Peer("magcc calibrate_lm", lambda readings: calibrate_lm(readings, 1.0), interpreted),
    ]


def _magcal() -> list[Peer]:
    from magcal import MagnetometerCalibrator

    def call(readings: list[list[float]]) -> Any:
        calibrator = MagnetometerCalibrator()
        calibrator.raw_data = readings
        with contextlib.redirect_stdout(io.StringIO()):
            return calibrator.calibrate()

    return [
        Peer(
            "magcal calibrate",
            call,
            lambda result: (result["transform_matrix"], result["center"]),
            prepare=lambda readings: readings.tolist(),
        )
    ]
