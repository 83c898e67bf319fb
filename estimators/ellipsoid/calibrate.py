"""From a recording without attitude to the calibration of its sensors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np

from estimators.calibration import SensorCalibration
from estimators.ellipsoid.alignment import Alignment, align
from estimators.ellipsoid.assembly import assemble
from estimators.ellipsoid.fit import EllipsoidFit, Parameters, fit_ellipsoid
from estimators.ellipsoid.levenberg import Start
from estimators.ellipsoid.thinned import Thinned
from estimators.stillness import average_poses, find_still
from estimators.stillness.poses import counts_of
from rig.arrays import Array
from rig.channels import ACCELEROMETER, MAGNETOMETER
from rig.errors import RefusedFit, RigError, check_name, unknown_name
from rig.recording import Recording, RecordingScan

Rest = Literal["auto", "all", "poses"]
Floor = tuple[Array, Array]

#: What ``rest`` may be.
RESTS: Final[tuple[Rest, ...]] = ("auto", "all", "poses")
#: Samples of a file that are fitted. More would sharpen nothing that matters, as what limits a calibration of so many
#: readings is not their noise, and this many fit into memory whatever the file's length.
MOST_SAMPLES: Final = 1 << 20


@dataclass(frozen=True, kw_only=True)
class Options:
    """How to calibrate without attitude.

    Attributes:
        parameters: 6, Camps (1), or 9, Camps (6).
        relative: take the fields' magnitudes to be one, whatever the metadata say.
        robust: leave out outliers.
        rest: of the accelerometer "auto" takes the poses in which it is at rest if there are enough of them, and all
            samples otherwise; "poses" and "all" insist.
        start: sensor -> where the paper's own estimator starts, to be used instead; it takes single readings.
        static_threshold: the accelerometer moves where the variance in a window exceeds it, as in Camps et al., 6.2
            [recorded unit squared]; None: chosen from the data.
        common_frame: bring both sensors into the accelerometer's frame.
        field_points: where the magnetic field points, as of ``alignment.align``.

    Raises:
        RigError: an unknown option.
    """

    parameters: Parameters = 9
    relative: bool = False
    robust: bool = True
    rest: Rest = "auto"
    start: Mapping[str, Start] = field(default_factory=dict)
    static_threshold: float | None = None
    common_frame: bool = True
    field_points: Literal["down", "up"] | None = None

    def __post_init__(self) -> None:
        check_name("rest", self.rest, RESTS)
        if self.field_points not in (None, "down", "up"):
            raise unknown_name("field_points", str(self.field_points), ("down", "up"))
        if self.static_threshold is not None and not 0.0 < self.static_threshold < np.inf:
            raise RigError(f"static_threshold: found {self.static_threshold:g}, expected a positive variance")
        if self.parameters not in (6, 9):
            raise RigError(f"parameters: found {self.parameters}, expected 6 or 9")


@dataclass(frozen=True, eq=False)
class AttitudeFree:
    """What a recording without attitude tells.

    Attributes:
        sensors: by name.
        extra: for ``Calibration.extra``: ``alignment`` of the two frames, or why there is none.
    """

    sensors: dict[str, SensorCalibration]
    extra: dict[str, Any]


def calibrate_attitude_free(
    source: Recording | RecordingScan,
    sensors: Sequence[str],
    floors: Mapping[str, Floor | None] | None = None,
    noise_source: str = "given",
    options: Options | None = None,
    progress: Callable[[int], None] | None = None,
) -> AttitudeFree:
    """Calibrate each sensor by the magnitude of its field, and bring both into one frame.

    Args:
        source: a recording whose pose, if it has one, is not used; means over poses if its metadata hold the counts as
            ``pose_samples`` (``estimators.stillness``).
        sensors: which of the recorded ones.
        floors: sensor -> noise of a sample and its own standard deviation, (3,) each [recorded unit]; None: from the
            residuals.
        noise_source: where the floors come from.
        options: None: the default ones.
        progress: called with the number of samples of every batch that is read.

    Raises:
        RigError: fewer readings than parameters.
        RefusedFit: the readings cannot determine the parameters, or the sensor is never at rest.
    """
    chosen = Options() if options is None else options
    recording = source if isinstance(source, Recording) else read_thinned(source, progress)
    given = {} if floors is None else floors
    fitted = {sensor: fit_attitude_free(recording, sensor, given.get(sensor), chosen) for sensor in sensors}
    aligned, extra = _aligned(fitted, recording, chosen)
    if progress is not None and isinstance(source, Recording):
        progress(len(source))
    results: dict[str, SensorCalibration] = {}
    for sensor, own in fitted.items():
        floor = given.get(sensor)
        made = assemble(
            own.fit,
            own.used.readings(sensor),
            unit=recording.units[sensor],
            noise_source=noise_source,
            floor_std=None if floor is None else floor[1],
            counts=own.counts,
            R_common_own=None if aligned is None or sensor != MAGNETOMETER else aligned.R_accelerometer_magnetometer,
            field_unit=recording.metadata.stated_field_unit(sensor),
        )
        results[sensor] = made.warned(*own.notes)
    return AttitudeFree(results, extra)


@dataclass(frozen=True, eq=False)
class Fitted:
    """The fit of one sensor, and what it was made of.

    Attributes:
        fit: the fit.
        used: the samples, or the means over poses.
        counts: (n,) samples behind each mean; None: single samples.
        notes: what to say about it.
    """

    fit: EllipsoidFit
    used: Recording
    counts: Array | None
    notes: tuple[str, ...] = ()


def fit_attitude_free(
    recording: Recording, sensor: str, floor: Floor | None, options: Options, refuse: bool = True
) -> Fitted:
    """The fit of one sensor of a recording: of an accelerometer by the poses in which it rests, if there are enough.

    Args:
        recording, sensor, floor, options: as of ``calibrate_attitude_free``.
        refuse: as of ``fit_ellipsoid``.

    Raises:
        RigError, RefusedFit: as ``calibrate_attitude_free``.
    """
    used, counts = recording, counts_of(recording)
    notes: tuple[str, ...] = ()
    if sensor == ACCELEROMETER and counts is None and options.rest != "all":
        still, notes = _at_rest(recording, options)
        used, counts = (recording, None) if still is None else still
    counts = None if sensor in options.start else counts
    fit = fit_ellipsoid(
        used.readings(sensor),
        1.0 if options.relative else recording.metadata.magnitude(sensor),
        parameters=options.parameters,
        noise=None if floor is None else floor[0],
        counts=counts,
        start=options.start.get(sensor),
        robust=options.robust,
        refuse=refuse,
        name=f"{recording.origin or recording.name}: {sensor}",
    )
    return Fitted(fit, used, counts, notes)


def _at_rest(recording: Recording, options: Options) -> tuple[tuple[Recording, Array] | None, tuple[str, ...]]:
    """The means over the poses in which the accelerometer is at rest with their counts, and what to say about it."""
    try:
        still = find_still(recording, sensors=[ACCELEROMETER], threshold=options.static_threshold)
        if ACCELEROMETER in options.start:
            single = recording.select(still.still)
            return (single, np.ones(len(single))), (f"{len(single):,} single readings at rest, as in the paper",)
        poses = average_poses(recording, still)
    except RigError as error:
        if options.rest == "poses":
            raise
        found = "it is never at rest" if isinstance(error, RefusedFit) else "it is too short to tell when it is at rest"
        return None, (f"{found}: all samples were taken, as if gravity alone had acted",)
    if len(poses) <= options.parameters:
        if options.rest == "poses":
            raise RefusedFit(
                f"{recording.origin or recording.name}: {ACCELEROMETER}: at rest in {len(poses)} poses, expected more"
                f" than the {options.parameters} parameters"
            )
        return None, (
            f"it is at rest in {len(poses)} poses only: all samples were taken, as if gravity alone had acted",
        )
    return (poses.recording, poses.counts.astype(float)), ()


def _aligned(
    fitted: Mapping[str, Fitted], recording: Recording, options: Options
) -> tuple[Alignment | None, dict[str, Any]]:
    """The alignment of both sensors' frames, and what to say about it."""
    if not options.common_frame or set(fitted) != {ACCELEROMETER, MAGNETOMETER}:
        return None, {}
    at_rest = fitted[ACCELEROMETER].used
    try:
        found = align(
            fitted[ACCELEROMETER].fit,
            fitted[MAGNETOMETER].fit,
            at_rest.readings(ACCELEROMETER),
            at_rest.readings(MAGNETOMETER),
            options.field_points,
            recording.metadata.accelerometer_reads,
        )
    except RefusedFit as refused:
        return None, {"alignment": {"refused": str(refused)}}
    return found, {"alignment": found.to_json()}


def read_thinned(
    scan: RecordingScan,
    progress: Callable[[int], None] | None = None,
    at_most: int | None = None,
    span_s: float | None = None,
) -> Recording:
    """Time and readings of a file in memory: all of it, or of its last ``span_s`` seconds; of more than ``at_most``
    every so many."""
    kept = Thinned(MOST_SAMPLES if at_most is None else at_most, span_s)
    for batch in scan:
        kept.add(batch)
        if progress is not None:
            progress(len(batch))
    return kept.recording()
