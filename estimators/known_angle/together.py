"""One calibration over several recordings: maneuvers, days, poses and sweeps, each with its own noise and sampling.

The sensors, their mounting and the fields in the base frame are the same in all of them; what changes from one to the
next, such as the temperature, is an effect. Statistics of disjoint samples add, so that the joint fit is that of one
long recording; a recording's sums are weighed by one over the variance of its noise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.special import chdtrc

from estimators.calibration import Calibration, SensorCalibration
from estimators.known_angle.assemble import assemble
from estimators.known_angle.fit import SensorFit, fit_sensor
from estimators.known_angle.from_recording import (
    FieldPoints,
    Floors,
    Noise,
    PathLike,
    chosen_sensors,
    floors_of,
    points_of,
    reads_of,
    scanned,
    summarise,
)
from estimators.known_angle.identifiability import Information
from estimators.known_angle.model import Method, Weighting
from estimators.known_angle.statistics import Statistics
from estimators.loud_floor import loud_words
from estimators.p_words import p_words
from rig.arrays import Array
from rig.channels import SENSORS
from rig.errors import RigError, in_short
from rig.recording import Recording, RecordingScan
from rig.recording.repeated_poses import evenly_posed
from rig.units import conversion_factor

if TYPE_CHECKING:
    from rig.arm import Arm

#: Readings' worth of doubt that the noise of a short recording is other than that of the rest.
_LIKE_THE_REST: Final = 6.0
#: Relative change of the weights that ends their iteration, and how often they are found anew at most.
_SETTLED, _MOST = 1e-4, 30
#: A recording that disagrees with the others by less probability than this, over their number, is a warning.
P_VALUE_LIMIT: Final = 1e-4
#: Directions of the parameters that the other recordings tell less than this share of are no test of them.
_TESTED: Final = 1e-6


@dataclass(frozen=True)
class Part:
    """What one recording says about one sensor.

    Attributes:
        name: of the recording.
        statistics: of three channels [the first recording's unit].
        noise: (3,) standard deviation of its readings where that is known, else None. noise_std: (3,) of that.
    """

    name: str
    statistics: Statistics
    noise: Array | None
    noise_std: Array


@dataclass(frozen=True, eq=False)
class Joint:
    """The joint fit of one sensor.

    Attributes:
        fit: of all recordings. parts: these. weights: (r,) of their samples; on average one.
        noise: (r, 3) standard deviation of each one's readings.
    """

    fit: SensorFit
    parts: tuple[Part, ...]
    weights: Array
    noise: Array

    @property
    def residual_square(self) -> Array:
        """(r, 3) sum of squared residuals [recorded unit squared]."""
        theta = self.fit.parameters.coefficients
        return np.stack([_left(part.statistics, theta) for part in self.parts])

    def information(self, index: int) -> Information:
        """Of one recording, its own noise taken."""
        parameters, method = self.fit.parameters, self.fit.method
        return Information.of(self.parts[index].statistics.gram, parameters, self.noise[index], method)

    @property
    def covariance(self) -> Array:
        """(p, p) of the estimate, each recording with its own noise: the weights need not be the best ones."""
        assumed = self.fit.noise if self.fit.weighting == "likelihood" else np.ones(3)
        bread, meat = self.fit.information.covariance, np.zeros_like(self.fit.covariance)
        for part, weight, noise in zip(self.parts, self.weights, self.noise, strict=True):
            effective = np.square(assumed) / (weight * noise)
            meat += Information.of(part.statistics.gram, self.fit.parameters, effective, self.fit.method).matrix
        return np.asarray(bread @ meat @ bread)


def calibrate_together(
    runs: Sequence[Recording | PathLike],
    method: Method | None = None,
    noise: Noise | Sequence[Noise | None] | None = None,
    arm: Arm | None = None,
    field_points: FieldPoints = "down",
    weighting: Weighting = "likelihood",
    sensors: Sequence[str] | None = None,
    progress: Callable[[int], None] | None = None,
    stated: Mapping[str, Any] | None = None,
) -> Calibration:
    """Calibrate the sensors of several recordings at once.

    Args:
        runs: recordings with a pose, or their files; a sensor need not be in all of them.
        noise: as of ``estimators.calibrate``, for all of them or one entry each. None: the locked recording beside each
            file; where one has none, the residuals of each recording tell its own noise.
        method, arm, field_points, weighting, sensors, progress, stated: as of ``estimators.calibrate``.

    Returns:
        The calibration; ``extra["recordings"]`` says of each recording what it contributes and whether it agrees.

    Raises:
        RigError: as of ``estimators.calibrate``; recordings that cannot share a calibration.
        RefusedFit: all together cannot determine the parameters.
    """
    sources = [run if isinstance(run, Recording) else scanned(run, arm) for run in runs]
    if stated:
        sources = [replace(each, metadata=replace(each.metadata, **stated)) for each in sources]
    check_alike(sources)
    recorded = tuple(sensor for sensor in SENSORS if any(sensor in each.sensors for each in sources))
    given = _each(noise, len(runs))
    floors = [floors_of(None if isinstance(run, Recording) else run, own) for run, own in zip(runs, given, strict=True)]
    chosen = chosen_sensors(recorded, sensors)
    parts: dict[str, list[Part]] = {sensor: [] for sensor in chosen}
    units: dict[str, str] = {}
    arms, warnings = set(), list[str]()
    for source, floor in zip(sources, floors, strict=True):
        there = [sensor for sensor in chosen if sensor in source.sensors]
        if not there:
            continue
        source, repeats = evenly_posed(source)
        warnings += [f"{source.name}: {words}" for words in repeats]
        summed = summarise(source, there, arm, progress)
        arms.add(summed.arm)
        for position, sensor in enumerate(there):
            unit = units.setdefault(sensor, summed.units[sensor])
            columns = slice(3 * position, 3 * position + 3)
            parts[sensor].append(
                _part(source.name, summed.statistics.select(columns), floor, sensor, summed.units, unit)
            )
    results: dict[str, SensorCalibration] = {}
    told: dict[str, list[dict[str, Any]]] = {}
    points = {sensor: points_of(field_points, sensor, sources[0].metadata) for sensor in chosen}
    for sensor in chosen:
        magnitude = sources[0].metadata.magnitude(sensor)
        joint = fit_together(parts[sensor], magnitude, method or "simultaneous", weighting, points[sensor], sensor)
        known = all(part.noise is not None for part in parts[sensor])
        source_of_noise = floors[0].source if known else "residuals"
        spread = np.sqrt(np.mean([np.square(part.noise_std) for part in parts[sensor]], axis=0))
        own = assemble(
            joint.fit,
            unit=units[sensor],
            noise_source=source_of_noise,
            floor_std=spread if known else 0.0,
            field_points=points[sensor],
            reads=reads_of(sources[0].metadata, sensor),
            field_unit=sources[0].metadata.stated_field_unit(sensor),
        )
        told[sensor] = contributions(joint)
        count = sum(part.statistics.count for part in parts[sensor])
        rms = np.sqrt(joint.residual_square.sum(axis=0) / count)
        loud = loud_words(own.quality.chi_square, source_of_noise)
        results[sensor] = replace(own, fit_rms=rms).warned(*loud, *warnings, *_disagreements(told[sensor]))
    name = in_short([each.name for each in sources])
    known_arm = next((each for each in arms if each is not None), None)
    return Calibration(results, name, known_arm, {"recordings": told})


def fit_together(
    parts: Sequence[Part],
    magnitude: float,
    method: Method,
    weighting: Weighting,
    field_points: Sequence[float],
    sensor: str,
) -> Joint:
    """The joint fit of one sensor.

    Where every recording's noise is known its samples are weighed by that; else noise and weights are found from the
    residuals of each recording, in turn with the fit.

    Raises:
        RigError, RefusedFit: as of ``estimators.known_angle.fit.fit_sensor``.
    """
    counts = np.array([float(part.statistics.count) for part in parts])
    weights = np.ones(len(parts))

    def fitted(noise: Array | None) -> SensorFit:
        """Of the weighed sums; the weights are on average one, so that counts stay counts."""
        sums = [(part.statistics, weight) for part, weight in zip(parts, weights, strict=True)]
        return fit_sensor(
            reduce(add, [Statistics(x.count, w * x.gram, w * x.cross, w * x.square) for x, w in sums]),
            magnitude,
            method=method,
            noise=noise,
            weighting=weighting,
            field_points=field_points,
            name=f"{in_short([part.name for part in parts])}: {sensor}",
        )

    if all(part.noise is not None for part in parts):
        noise = np.stack([part.noise for part in parts if part.noise is not None])
        if weighting == "likelihood":
            weights = _normalised(1.0 / np.mean(np.square(noise / noise[0]), axis=1), counts)
        pooled = np.sqrt((counts * weights) @ np.square(noise) / counts.sum())
        return _settled(Joint(fitted(pooled), tuple(parts), weights, noise))
    for _ in range(_MOST):
        joint = _with_noise(fitted(None), parts, weights)
        if weighting == "equal":
            break
        fresh = _normalised(1.0 / np.mean(np.square(joint.noise / joint.noise[0]), axis=1), counts)
        change = float(np.abs(np.log(fresh / weights)).max())
        weights = fresh
        if change < _SETTLED:
            break
    return _settled(joint)


def contributions(joint: Joint) -> list[dict[str, Any]]:
    """What each recording says: its noise, its residuals, its share of what is told, whether it agrees with the others.

    The share is of the information about each parameter, averaged over the parameters. Agreement: the recording's score
    U at the joint optimum has covariance F - F C F, F its own information, C the covariance of the joint fit; U (F - F
    C F)^+ U is chi-square in the directions that other recordings tell as well.
    """
    squares = joint.residual_square
    informations = [joint.information(index).matrix for index in range(len(joint.parts))]
    total = sum(informations, start=np.zeros_like(informations[0]))
    told = np.diag(total) > 0.0
    covariance = np.asarray(np.linalg.pinv(total, rcond=1e-12, hermitian=True), dtype=float)
    theta = joint.fit.parameters.coefficients
    jacobian = joint.fit.parameters.jacobian(joint.fit.method)  # (3, 10, p)
    found = []
    for part, own, square, noise in zip(joint.parts, informations, squares, joint.noise, strict=True):
        data = part.statistics
        score = np.einsum("kip,ik,k->p", jacobian, data.cross - data.gram @ theta, np.asarray(noise**-2.0))
        chi_square, freedom = _against_the_rest(score, own, covariance)
        found.append(
            {
                "recording": part.name,
                "samples": data.count,
                "noise": [float(each) for each in noise],
                "fit_rms": [float(each) for each in np.sqrt(square / data.count)],
                "share": float(np.mean(np.diag(own)[told] / np.diag(total)[told])),
                "agreement": {
                    "chi_square": chi_square,
                    "degrees_of_freedom": freedom,
                    "p_value": float(chdtrc(freedom, chi_square)) if freedom else 1.0,
                },
            }
        )
    return found


def check_alike(sources: Sequence[Recording | RecordingScan]) -> None:
    """Refuse recordings that one calibration cannot hold for.

    Raises:
        RigError: two of one name, other fields, or an accelerometer that reads the other way.
    """
    first = sources[0]
    seen: dict[str, str] = {}
    for each in sources:
        where = str(each.path) if isinstance(each, RecordingScan) else each.origin or each.name
        if each.name in seen:
            again = "" if seen[each.name] == where else f" after {seen[each.name]}"
            raise RigError(f"{where}: found the name {each.name!r} again{again}, expected different recordings")
        seen[each.name] = where
        for key in ("gravity_m_s2", "magnetic_field", "magnetic_field_unit", "accelerometer_reads"):
            mine, other = getattr(each.metadata, key), getattr(first.metadata, key)
            if mine != other:
                raise RigError(
                    f"{where}: {key}: found {mine!r}, expected {other!r} as in {first.name}: one"
                    " calibration is for one place and one reading of it"
                )


def _part(name: str, statistics: Statistics, floors: Floors, sensor: str, units: Mapping[str, str], unit: str) -> Part:
    """In the unit of the first recording."""
    factor = conversion_factor(units[sensor], unit)
    scaled = Statistics(statistics.count, statistics.gram, factor * statistics.cross, factor**2 * statistics.square)
    floor = floors.of(sensor, units[sensor])
    if floor is None:
        return Part(name, scaled, None, np.zeros(3))
    return Part(name, scaled, factor * floor[0], factor * floor[1])


def _normalised(weights: Array, counts: Array) -> Array:
    return np.asarray(weights * counts.sum() / (weights @ counts))


def _with_noise(fit: SensorFit, parts: Sequence[Part], weights: Array) -> Joint:
    """With the noise of each recording from its own residuals; that of a short one is drawn towards the others'."""
    theta = fit.parameters.coefficients
    pooled = np.square(fit.noise)
    found = []
    for part, weight in zip(parts, weights, strict=True):
        own = Information.of(part.statistics.gram, fit.parameters, fit.noise / np.sqrt(weight), fit.method)
        leverage = np.einsum("ij,kij->k", fit.covariance, own.per_channel)
        freedom = np.maximum(part.statistics.count - leverage, 0.0)
        square = _left(part.statistics, theta)
        common = (float((square / pooled).sum()) + _LIKE_THE_REST / weight) / (float(freedom.sum()) + _LIKE_THE_REST)
        found.append(np.sqrt((square + _LIKE_THE_REST * common * pooled) / (freedom + _LIKE_THE_REST)))
    return Joint(fit, tuple(parts), weights, np.stack(found))


def _settled(joint: Joint) -> Joint:
    """With the covariance that the recordings' own noise makes."""
    return replace(joint, fit=replace(joint.fit, covariance=joint.covariance))


def _left(statistics: Statistics, theta: Array) -> Array:
    """(3,) sum of squared residuals."""
    own = statistics.square.diagonal() - 2.0 * np.einsum("ik,ik->k", theta, statistics.cross)
    return np.asarray(np.maximum(own + np.einsum("ik,ij,jk->k", theta, statistics.gram, theta), 0.0))


def _against_the_rest(score: Array, own: Array, covariance: Array) -> tuple[float, int]:
    """Chi-square of a recording's score at the joint optimum, and its degrees of freedom."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))  # of each parameter: one standard deviation
    unit = np.where(scale > 0.0, scale, np.inf)
    information, joint = own * np.outer(scale, scale), covariance / np.outer(unit, unit)
    spread = information - information @ joint @ information
    values, vectors = np.linalg.eigh(0.5 * (spread + spread.T))
    kept = values > _TESTED * max(float(np.trace(information)), 1e-300)
    along = vectors[:, kept].T @ (score * scale)
    return float(np.sum(along**2 / values[kept])), int(kept.sum())


def _disagreements(told: Sequence[Mapping[str, Any]]) -> list[str]:
    """In words."""
    found = []
    for each in told:
        test = each["agreement"]
        if test["p_value"] * len(told) < P_VALUE_LIMIT:
            found.append(
                f"{each['recording']} does not agree with the other recordings on one calibration (chi-square"
                f" {test['chi_square']:.3g} of {test['degrees_of_freedom']}, {p_words(test['p_value'])}): rig diagnose"
                " --together says what differs"
            )
    return found


def _each(noise: Noise | Sequence[Noise | None] | None, count: int) -> list[Noise | None]:
    """One entry for each recording."""
    several: Any = noise
    if isinstance(several, list | tuple) and not all(isinstance(each, float | int) for each in several):
        if len(several) != count:
            raise RigError(f"noise: found {len(several)} entries, expected one for each of {count} recordings")
        return list(several)
    return [several] * count
