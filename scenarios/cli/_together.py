"""Several recordings of a command: calibrated together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.errors import RigError

if TYPE_CHECKING:
    from estimators import Calibration
    from estimators.known_angle.from_recording import FieldPoints, Noise
    from estimators.known_angle.model import Weighting
    from rig.arm import Arm
    from rig.recording import Recording


def calibrated(
    runs: Sequence[Path],
    method: Any,
    noise: Noise | None,
    arm: Arm | None,
    field_points: FieldPoints,
    weighting: Weighting,
    still: bool,
    stated: Mapping[str, Any],
) -> tuple[Calibration, Recording]:
    """The joint calibration, judged, and the recordings one after another, for a picture of what they have seen.

    Raises:
        RigError: as of ``estimators.calibrate``, or a recording without a pose.
    """
    import estimators
    from estimators.goodness import as_one
    from estimators.known_angle.from_recording import has_pose
    from estimators.known_angle.together import calibrate_together
    from estimators.noise import noise_floor
    from rig.recording import locked_beside, scan_recording

    scans = [scan_recording(run, joints=None if arm is None else arm.dof) for run in runs]
    for scan in scans:
        if not has_pose(scan):
            raise RigError(f"{scan.path}: has no pose, expected joint angles or tool poses of every one of several")
    sources: list[Any] = list(runs)
    floors: list[Noise | None] = [noise] * len(runs)
    if still:
        from estimators.stillness.at_rest import at_rest_samples

        sources = [at_rest_samples(scan.read()) for scan in scans]
        beside = [locked_beside(run) for run in runs]
        if noise is None:
            floors = [None if each is None else noise_floor(each) for each in beside]
    calibration = calibrate_together(
        sources, method, floors, arm, field_points=field_points, weighting=weighting, stated=stated
    )
    used = [replace(each, metadata=replace(each.metadata, **stated)) for each in (sources if still else scans)]
    judged = estimators.judged_together(used, calibration, arm)
    sensors = [sensor for sensor in judged.sensors if all(sensor in each.sensors for each in used)]
    shown = sensors or list(judged.sensors)[:1]
    one = as_one([each for each in used if set(shown) <= set(each.sensors)], shown, judged, arm)
    return judged, one
