"""What a calibration leaves of its readings, in standard deviations, and how it depends on the parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from estimators.calibration import SensorCalibration
from estimators.coverage.attitude_free_information import design_rows
from estimators.known_angle.model import METHODS, Method, SensorParameters
from estimators.stillness.poses import counts_of
from rig.arrays import Array, Mask
from rig.channels import CHANNELS_OF
from rig.errors import RigError
from rig.recording import Recording
from rig.threads import one_blas_thread

if TYPE_CHECKING:
    from rig.arm import Arm


@dataclass(frozen=True, eq=False)
class Part:
    """What some successive samples say about a small change of the parameters.

    Attributes:
        information: (p, p) Fisher information. score: (p,) derivative of the log likelihood.
        square: sum of squared standardised residuals.
    """

    information: Array
    score: Array
    square: float


@dataclass(frozen=True, eq=False)
class Residuals:
    """The residuals of one sensor.

    Attributes:
        sensor: which one.
        names: (k,) the three channels; or, without attitude, the field's magnitude.
        t: (n,) [s].
        values: (n, k) reading less the model's reading [recorded unit]; without attitude, magnitude less its expected
            value [field unit].
        sigma: (k,) or (n, k) standard deviation of the values that the calibration rests on; less for averaged poses.
        sigma_given: whether it comes from elsewhere than these residuals.
        directions: (n, 3) unit vectors of the field in the sensor's frame.
        parameters: p that were fitted.
        readings: that the samples are the means of; as many as samples if they are single ones.
        part: of the samples from one number up to another.
        change: (n, k) of the model's readings, for a small change (p,) of the parameters [of the values].
    """

    sensor: str
    names: tuple[str, ...]
    t: Array
    values: Array
    sigma: Array
    sigma_given: bool
    directions: Array
    parameters: int
    readings: float
    part: Callable[[int, int], Part]
    change: Callable[[Array], Array]

    def __len__(self) -> int:
        """How many samples."""
        return len(self.values)

    @property
    def standardised(self) -> Array:
        """(n, k) values / sigma."""
        return self.values / self.sigma


def residuals_of(
    recording: Recording, sensor: str, calibration: SensorCalibration, arm: Arm | None = None
) -> Residuals:
    """The residuals of a calibrated sensor; by attitude if calibration and recording know it, else by magnitude.

    Args:
        recording: with readings of the sensor.
        calibration: of it.
        arm: for joint angles.

    Raises:
        RigError: readings and calibration differ in unit, or the calibration has no matrix where it needs one.
    """
    where = recording.origin or recording.name
    if recording.unit(sensor) != calibration.unit:
        raise RigError(
            f"{where}: the {sensor} is recorded in {recording.unit(sensor)}, expected the calibration's"
            f" {calibration.unit}"
        )
    known = recording.tool_quaternion is not None or (recording.q is not None and arm is not None)
    if calibration.axes and calibration.field_direction is not None and known:
        return _by_attitude(recording, sensor, calibration, arm)
    return _by_magnitude(recording, sensor, calibration, where)


def fitted_parameters(calibration: SensorCalibration) -> SensorParameters:
    """The parameters of a calibration that knows the attitude."""
    assert calibration.field_direction is not None
    common = calibration.field_direction.vector
    fields = [common if axis.field is None else axis.field.vector for axis in calibration.axes]
    return SensorParameters(
        calibration.reference_magnitude,
        calibration.sensitivity,
        calibration.offset,
        calibration.axis_vectors,
        np.array(fields),
    )


def selected(recording: Recording, rows: Mask) -> Recording:
    """Some of the samples, and their counts if they are means over poses."""
    counts = counts_of(recording)
    part = recording.select(rows)
    if counts is None:
        return part
    extra = {**recording.metadata.extra, "pose_samples": counts[rows].tolist()}
    return replace(part, metadata=replace(part.metadata, extra=extra))


def noise_of(calibration: SensorCalibration) -> Array:
    """(3,) standard deviation of a reading that a calibration rests on [recorded unit], above zero."""
    noise = calibration.fit_rms if calibration.noise is None else calibration.noise
    least = np.finfo(float).eps * max(float(np.abs(calibration.bias).max()), np.finfo(float).tiny)
    return np.maximum(noise, least)  # a fit without noise may leave nothing at all


def _by_attitude(recording: Recording, sensor: str, calibration: SensorCalibration, arm: Arm | None) -> Residuals:
    """Renk (13), (19): V_k = S_k |f| f^T R P_k + delta_k."""
    parameters = fitted_parameters(calibration)
    method: Method = "separate" if calibration.method == METHODS[1] else "simultaneous"
    assert calibration.field_direction is not None
    seen = np.kron(calibration.field_direction.vector, np.eye(3))  # vec R by rows -> R^T f
    count = len(recording)
    terms = np.ones((10, count))  # [vec R, 1]
    values, directions = np.empty((3, count)), np.empty((3, count))
    with one_blas_thread():
        for rows, block in recording.rotation_blocks(arm):
            terms[:9, rows] = block
            np.matmul(parameters.coefficients.T, terms[:, rows], out=values[:, rows])
            np.matmul(seen, block, out=directions[:, rows])
    np.subtract(recording.readings(sensor).T, values, out=values)
    sigma = noise_of(calibration)
    jacobian = parameters.jacobian(method) / sigma[:, None, None]
    counts = counts_of(recording)
    root = None if counts is None else np.sqrt(counts)

    def part(first: int, stop: int) -> Part:
        own, left = terms[:, first:stop], values[:, first:stop] / sigma[:, None]
        if root is not None:
            own, left = own * root[first:stop], left * root[first:stop]
        with one_blas_thread():
            gram, score = own @ own.T, own @ left.T
        information = (jacobian.swapaxes(1, 2) @ (gram @ jacobian)).sum(axis=0)
        return Part(information, np.einsum("kip,ik->p", jacobian, score), float(np.square(left).sum()))

    def change(step: Array) -> Array:
        with one_blas_thread():
            return np.asarray(((sigma[:, None] * (jacobian @ step)) @ terms).T)

    return Residuals(
        sensor,
        CHANNELS_OF[sensor],
        recording.t,
        values.T,
        sigma if root is None else sigma / root[:, None],
        calibration.noise_source not in (None, "residuals"),
        directions.T,
        jacobian.shape[2],
        float(len(recording) if counts is None else counts.sum()),
        part,
        change,
    )


def by_magnitude(
    readings: Array, matrix: Array, sigma: Array, reference: float, counts: Array | None = None
) -> tuple[Array, Array, Array]:
    """|M V| - H, whose noise is that of the readings along the field; Camps (2), (7).

    Noise across the field makes it longer: with its variance t of both components together, by t / (2 H).

    Args:
        readings: (n, 3) V, less their offset [recorded unit]. matrix: (3, 3) M. reference: H [field unit].
        sigma: (3,) standard deviation of a single reading [recorded unit]. counts: (n,) that each is the mean of.

    Returns:
        The field's directions (n, 3), and of its length less H the variance (n,) and the value (n,), freed of t.
    """
    fields = readings @ matrix.T
    magnitude = np.sqrt(np.square(fields).sum(axis=1))
    directions = fields / np.where(magnitude > 0.0, magnitude, 1.0)[:, None]
    noise = np.square(sigma)
    variance = np.square(directions @ matrix) @ noise
    across = float((np.square(matrix) @ noise).sum()) - variance
    if counts is not None:
        variance, across = variance / counts, across / counts
    return directions, variance, magnitude - reference - across / (2.0 * reference)


def _by_magnitude(recording: Recording, sensor: str, calibration: SensorCalibration, where: str) -> Residuals:
    matrix = calibration.matrix
    if not np.isfinite(matrix).all():
        raise RigError(f"{where}: the calibration of the {sensor} has no matrix, expected one")
    reference = calibration.reference_magnitude
    counts = counts_of(recording)
    directions, variance, away = by_magnitude(
        recording.readings(sensor) - calibration.bias, matrix, noise_of(calibration), reference, counts
    )
    sigma = np.sqrt(np.where(variance > 0.0, variance, 1.0))[:, None]
    values = away[:, None]
    diagonal = np.count_nonzero(matrix - np.diag(matrix.diagonal())) == 0
    number = 6 if diagonal else 9

    def rows_of(first: int, stop: int) -> Array:
        # The derivative of the reading, not of its residual: hence the sign.
        return np.asarray(-reference * design_rows(directions[first:stop], number) / sigma[first:stop])

    def part(first: int, stop: int) -> Part:
        rows = rows_of(first, stop)
        left = values[first:stop, 0] / sigma[first:stop, 0]
        return Part(rows.T @ rows, rows.T @ left, float(left @ left))

    def change(step: Array) -> Array:
        return np.asarray((rows_of(0, len(values)) @ step)[:, None] * sigma)

    return Residuals(
        sensor,
        (f"{sensor}_magnitude",),
        recording.t,
        values,
        sigma,
        calibration.noise_source not in (None, "residuals"),
        directions,
        number,
        float(len(recording) if counts is None else counts.sum()),
        part,
        change,
    )
