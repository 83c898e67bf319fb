"""Both sensors in one frame: the angle between gravity and the magnetic field is constant, whatever the attitude.

Each sensor calibrated by itself has a frame of its own. With a, m the unit vectors of the two fields in these frames
and R the rotation between them, a^T R m = c for all samples. That is linear in the entries of R, so the data enter
through the mean and the covariance of a m^T alone.

What this tells: R (three numbers) and the angle between the fields. What it cannot tell:
- how the common frame lies in the housing: any rotation of both leaves all readings as they are;
- the handedness of the sensors: (R, c) and (-R, -c) fit alike. R is taken to be a rotation; if only one of the two has
  left-handed axes, or the accelerometer reads other than stated, that is minus the true R, and the angle is 180 degrees
  less the true one. Where it is known whether the magnetic field points down or up, that decides, and R may be a
  reflection.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Final, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from estimators.ellipsoid.fit import EllipsoidFit
from estimators.ellipsoid.monomials import products
from estimators.ellipsoid.used_rows import spread_rows
from rig.arrays import Array
from rig.channels import READS
from rig.errors import RefusedFit
from rig.threads import one_blas_thread

#: Standard deviation of the rotation about any axis, or of the angle, beyond which the answer is none.
UNCERTAINTY_LIMIT_DEG: Final = 5.0
#: Of the angle between the fields from 0 or 180 degrees: nearer than this its noise is no longer normal.
PARALLEL_LIMIT_DEG: Final = 5.0
#: Two minima closer than this in chi-square are one the data cannot choose between.
AMBIGUOUS_CHI_SQUARE: Final = 12.0
#: Two minima further apart than this are two.
_APART_DEG: Final = 1.0
_STARTS: Final = 8
_STEPS: Final = 50
_SAMPLE: Final = 20_000


@dataclass(frozen=True, eq=False)
class Alignment:
    """How the frames of the two sensors lie, and the angle between the two fields.

    Attributes:
        R_accelerometer_magnetometer: (3, 3) takes vectors of the magnetometer's own frame to the accelerometer's. Of
            determinant -1 if the field's direction was stated and only one of the sensors has left-handed axes.
        angle_deg: between the two fields [deg]; the accelerometer's is what it ``reads``: at rest 90 less the dip of
            g - a, and 90 and the dip of a - g.
        covariance: (4, 4) of small rotations about the accelerometer's axes and the angle [deg^2], with the uncertainty
            of both calibrations.
        residual_deg: root mean square of the angle's residual [deg].
        samples: how many were used.
        field_points: of the magnetic field, as stated. reads: the accelerometer, as stated, "g-a" or "a-g".
    """

    R_accelerometer_magnetometer: Array
    angle_deg: float
    covariance: Array
    residual_deg: float
    samples: int
    field_points: Literal["down", "up"] | None = None
    reads: str = READS[0]

    @property
    def angle_std_deg(self) -> float:
        """Standard deviation of the angle [deg]."""
        return float(np.sqrt(self.covariance[3, 3]))

    def to_json(self) -> dict[str, Any]:
        """An object for ``Calibration.extra``."""
        return {
            "R_accelerometer_magnetometer": self.R_accelerometer_magnetometer.tolist(),
            "angle_deg": self.angle_deg,
            "angle_std_deg": self.angle_std_deg,
            "covariance_deg2": self.covariance.tolist(),
            "residual_deg": self.residual_deg,
            "samples": self.samples,
            "field_points": self.field_points,
            "cannot_tell": [_HOUSING, _hand(self.reads) if self.field_points is None else _HAND_BY_FIELD],
        }


def align(
    accelerometer: EllipsoidFit,
    magnetometer: EllipsoidFit,
    readings_a: Array,
    readings_m: Array,
    field_points: Literal["down", "up"] | None = None,
    reads: str = READS[0],
) -> Alignment:
    """The rotation between the sensors' frames, from readings taken together.

    Args:
        accelerometer, magnetometer: their calibrations.
        readings_a, readings_m: (n, 3) of both at the same instants [recorded units], the accelerometer at rest.
        field_points: where the magnetic field points, "down" on the northern hemisphere; None: both sensors are taken
            to have axes of the same hand.
        reads: the accelerometer: "g-a" or "a-g".

    Raises:
        RefusedFit: the attitudes do not tell the rotation.
    """
    with one_blas_thread():
        data = _Products.of(accelerometer, magnetometer, readings_a, readings_m)
        minima = data.minima()
        cost, R = minima[0]
        # Noise shortens the mean of unit vectors: by its variance, of one direction, each.
        c = float(data.mean @ R.ravel()) / ((1.0 - data.noise[0]) * (1.0 - data.noise[1]))
        sine = float(np.sqrt(max(1.0 - c * c, 0.0)))
        if sine < np.sin(np.radians(PARALLEL_LIMIT_DEG)):
            raise RefusedFit(
                f"alignment: the two fields are within {PARALLEL_LIMIT_DEG:g} deg of parallel, where the angle between"
                " them tells too little: expected a place away from the magnetic poles, and from iron"
            )
        raw = float(R.ravel() @ data.raw @ R.ravel())  # the variance of a^T R m, noise included
        variance = max(raw, np.finfo(float).eps ** 2) * data.count / max(data.count - 4, 1)
        scale = np.degrees(np.array([1.0, 1.0, 1.0, -1.0 / sine]))
        covariance = scale[:, None] * data.spread(R, variance) * scale
    worst = float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1]))
    if worst > UNCERTAINTY_LIMIT_DEG:
        raise RefusedFit(
            f"alignment: the rotation between the sensors is uncertain by {worst:.2g} deg, expected at most"
            f" {UNCERTAINTY_LIMIT_DEG:g}: {_WANTED}"
        )
    for other_cost, other in minima[1:]:
        if data.count * (other_cost - cost) < AMBIGUOUS_CHI_SQUARE * variance:
            apart = np.degrees(Rotation.from_matrix(other @ R.T).magnitude())
            raise RefusedFit(f"alignment: two rotations {apart:.0f} deg apart fit alike: {_WANTED}")
    if field_points is not None and (c < 0.0) != ((field_points == "up") != (reads == READS[1])):
        R, c = -R, -c
    residual = float(np.degrees(np.sqrt(variance)) / sine)
    return Alignment(R, float(np.degrees(np.arccos(c))), covariance, residual, data.count, field_points, reads)


_WANTED: Final = "turn the sensors about at least two axes, through more attitudes"
_HOUSING: Final = "how the common frame lies in the housing: no rotation of both sensors changes a reading"


def _hand(reads: str) -> str:
    other = " - ".join(READS[1 - READS.index(reads)].split("-"))
    return (
        f"handedness: if only one of the sensors has left-handed axes, or the accelerometer reads {other}, the true"
        " rotation is minus this one and the true angle 180 deg less this one; where the magnetic field points decides"
    )


_HAND_BY_FIELD: Final = "whether both sensors have right-handed axes, or both left-handed ones"


@dataclass(frozen=True, eq=False)
class _Products:
    """The directions of both fields and the statistics of their products.

    Attributes:
        a, m: (n, 3) unit vectors, each in its sensor's frame.
        mean: (9,) of vec(a m^T). covariance: (9, 9) of it, freed of noise. raw: (9, 9) with it.
        noise: variances of the two directions' noise along any tangent.
        fits: of the two sensors.
    """

    a: Array
    m: Array
    mean: Array
    covariance: Array
    raw: Array
    noise: tuple[float, float]
    fits: tuple[EllipsoidFit, EllipsoidFit]

    @classmethod
    def of(cls, accelerometer: EllipsoidFit, magnetometer: EllipsoidFit, first: Array, second: Array) -> _Products:
        fields, noise = [], []
        for fit, readings in ((accelerometer, first), (magnetometer, second)):
            field = fit.field_of(readings)
            fields.append(field / np.linalg.norm(field, axis=1)[:, None])
            noise.append(float(np.square(fit.matrix * fit.noise / fit.reference_magnitude).sum()) / 3.0)
        a, m = fields
        n = len(a)
        products = (a[:, :, None] * m[:, None, :]).reshape(n, 9)
        mean = products.mean(axis=0)
        square = products.T @ products / n
        raw = square - np.outer(mean, mean)
        added = noise[0] * (np.kron(np.eye(3), m.T @ m / n) - square) + noise[1] * (
            np.kron(a.T @ a / n, np.eye(3)) - square
        )
        return cls(a, m, mean, raw - added, raw, (noise[0], noise[1]), (accelerometer, magnetometer))

    @property
    def count(self) -> int:
        """n."""
        return len(self.a)

    def minima(self) -> list[tuple[float, Array]]:
        """The local minima of the variance of a^T R m over all rotations, the best first."""
        starts = _rotations()
        flat = starts.reshape(-1, 9)
        costs = np.einsum("ki,ij,kj->k", flat, self.covariance, flat)
        found: list[tuple[float, Array]] = []
        for index in np.argsort(costs)[:_STARTS]:
            cost, R = self._descend(starts[index])
            turns = [np.degrees(Rotation.from_matrix(R @ other.T).magnitude()) for _, other in found]
            if all(turn > _APART_DEG for turn in turns):
                found.append((cost, R))
        return sorted(found, key=lambda item: item[0])

    def _descend(self, R: Array) -> tuple[float, Array]:
        """Levenberg-Marquardt in rotations of the accelerometer's frame."""
        cost = float(R.ravel() @ self.covariance @ R.ravel())
        damping = 1e-3 * float(np.trace(self.covariance))
        for _ in range(_STEPS):
            turned = np.stack([(generator @ R).ravel() for generator in _GENERATORS], axis=1)
            gradient = turned.T @ self.covariance @ R.ravel()
            hessian = turned.T @ self.covariance @ turned
            step = -np.linalg.solve(hessian + damping * np.eye(3), gradient)
            after = Rotation.from_rotvec(step).as_matrix() @ R
            lower = float(after.ravel() @ self.covariance @ after.ravel())
            if lower < cost:
                R, cost, damping = after, lower, 0.1 * damping
                if float(np.abs(step).max()) < 1e-9:
                    break
            else:
                damping = max(10.0 * damping, 1e-15)
                if damping > 1e6:
                    break
        return cost, R

    def spread(self, R: Array, variance: float) -> Array:
        """(4, 4) covariance of small rotations and of c, with the uncertainty of both sensors' parameters.

        Args:
            R: the optimum.
            variance: of a^T R m, noise included.

        Raises:
            RefusedFit: nothing but noise tells the rotation about some axis.
        """
        normal, through = self._normal(R)
        values = np.linalg.eigvalsh(normal)
        # Noise moves the directions about and seems to tell the rotation where they stay: at most half may be it.
        if not values[0] > max(2.0 * self.count * sum(self.noise), 1e-9 * values[-1]):
            raise RefusedFit(f"alignment: these attitudes do not tell the rotation between the sensors: {_WANTED}")
        inverse = np.linalg.inv(normal)
        covariance = inverse * variance
        for part, fit in zip(through, self.fits, strict=True):
            gain = inverse @ part
            covariance += gain @ fit.covariance @ gain.T
        return np.asarray(covariance)

    def _normal(self, R: Array) -> tuple[Array, tuple[Array, Array]]:
        """(4, 4) sum of J^T J over the samples, J the derivative of a^T R m - c by small rotations and by c, and the
        (4, p) sums of J^T D, D that by each sensor's parameters ``likelihood.parameter_names``."""
        pick = spread_rows(self.count, _SAMPLE)
        a, m = (self.a, self.m) if pick is None else (self.a[pick], self.m[pick])
        share = self.count / len(a)
        turned = m @ R.T
        J = np.column_stack([np.cross(turned, a), -np.ones(len(a))])
        sums = []
        for unit, other, fit in ((a, turned, self.fits[0]), (m, a @ R, self.fits[1])):
            # the unit vector changes by the part of -matrix (d gain h + d offset) / |h| at right angles to it
            across = other - (unit * other).sum(axis=1)[:, None] * unit
            by_reading = -across @ fit.matrix / fit.reference_magnitude
            by_gain = fit.reference_magnitude * products(by_reading, unit)[:, : fit.parameters - 3]
            sums.append(share * J.T @ np.column_stack([by_gain, by_reading]))
        return share * J.T @ J, (sums[0], sums[1])


@cache
def _rotations() -> Array:
    """(k, 3, 3) rotations some 20 degrees apart, always the same; the cost has no detail below that."""
    return np.asarray(Rotation.random(1000, rng=np.random.default_rng(0)).as_matrix())


_GENERATORS: Final = -np.array(
    [[[0, 0, 0], [0, 0, 1], [0, -1, 0]], [[0, 0, -1], [0, 0, 0], [1, 0, 0]], [[0, 1, 0], [-1, 0, 0], [0, 0, 0]]],
    dtype=float,
)
