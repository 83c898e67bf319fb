"""``rig calibrate`` and ``rig apply``: volts in, answers out."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from rig.errors import RigError
from rig.files import check_different, write_together
from scenarios.cli._options import (
    PATH,
    RECORDING_SUFFIXES,
    Choice,
    arm_options,
    check_output,
    check_picture,
    chosen_arm,
    counted,
    json_option,
    memory_option,
    numbers,
    print_json,
    progress_bar,
    tell,
    tell_written,
    without_locked,
)
from scenarios.cli._stated import (
    contradiction_words,
    parsed_start,
    stated_by_place,
    stated_metadata,
    stated_options,
    unit_of_field,
    with_assumptions,
)

if TYPE_CHECKING:
    from estimators import Calibration
    from estimators.known_angle.from_recording import FieldPoints, Noise
    from estimators.known_angle.model import Weighting
    from rig.arm import Arm
    from rig.recording import Recording, RecordingScan

#: Samples whose directions are drawn.
_DRAWN: Final = 100_000
#: Memory that a robust fit takes [bytes a sample].
_ROBUST: Final = 1000.0


@click.command(short_help="Calibrate the sensors of one recording or several.")
@click.argument("runs", type=PATH, nargs=-1, required=True, metavar="RUN...")
@click.option("-o", "--output", type=PATH, metavar="CAL", help="Write the calibration: .json.")
@click.option(
    "--method",
    type=Choice(("simultaneous", "separate", "ellipsoid")),
    help="One field for all axes (by default), or one each; or without the attitude (by default where none is there).",
)
@click.option(
    "--parameters", type=Choice(("6", "9")), help="Of the ellipsoid: without or, by default, with cross terms."
)
@arm_options
@click.option("--locked", type=PATH, metavar="F", help="Locked-arm recording, for the noise floor.")
@click.option("--noise", metavar="mV,mV,mV", help="Noise floor of each channel in mV: three numbers a sensor.")
@click.option("--field-points", type=Choice(("up", "down")), help="Which of two equal solutions; down by default.")
@click.option("--equal-weights", is_flag=True, help="All channels alike, as in the paper, not by their noise.")
@click.option("--still", is_flag=True, help="Only samples at which the arm is at rest, by its pose.")
@click.option("--robust", is_flag=True, help="Leave out outliers, as fits without the attitude always do.")
@click.option(
    "--start",
    "starts",
    multiple=True,
    metavar="datasheet|GAIN,OFFSET",
    help="Of the ellipsoid: search as Camps et al. (Levenberg-Marquardt) from the recording's stated values, or these.",
)
@click.option(
    "--static-threshold",
    type=float,
    metavar="V²",
    help="Of the ellipsoid: the accelerometer moves where its variance exceeds this; 0.0016 in Camps et al.",
)
@click.option("--fminunc", is_flag=True, help="Minimise as Renk et al. too (quasi-Newton), and compare.")
@click.option("--coverage", type=PATH, metavar="PLOT", help="Draw the directions seen and missing: .png, .svg, .pdf.")
@memory_option
@stated_options
@json_option
def calibrate(
    runs: tuple[Path, ...],
    output: Path | None,
    method: Any,
    parameters: str | None,
    arm_file: Path | None,
    tip: str | None,
    locked: Path | None,
    noise: str | None,
    field_points: Any,
    equal_weights: bool,
    still: bool,
    robust: bool,
    starts: tuple[str, ...],
    static_threshold: float | None,
    fminunc: bool,
    coverage: Path | None,
    gravity: float | None,
    field: str | None,
    at: str | None,
    date: str | None,
    as_json: bool,
) -> int:
    """Calibrate the sensors of RUN, a recording with joint angles, tool poses or, turned by hand, neither.

    A RUN.locked.parquet beside RUN.parquet is taken as the noise floor; without one the noise comes from the residuals.
    The verdict says whether the calibration is good and, if it is not, why. Several RUNs, poses and sweeps, of whatever
    days, give one calibration, each by its own noise; what each adds and whether it agrees is said.

    \b
    Example:
      rig calibrate run.parquet -o cal.json
      rig calibrate poses.parquet monday.parquet tuesday.parquet -o cal.json
      rig calibrate tumble.csv --method ellipsoid --parameters 6 --coverage tumble.png
      rig calibrate tumble.csv --method ellipsoid --start datasheet --static-threshold 0.0016
      rig calibrate run.csv --noise 13.4,13.6,14.6,8.5,6.8,11.7 --method separate
      rig calibrate mine.parquet --arm mine.urdf --tip sensor_link --gravity 9.8029 --field 55.2uT -o cal.json
      rig calibrate mine.parquet --at 42.28,-83.74,260 --date 2026-11-22 -o cal.json
    """
    several = without_locked(runs)
    check_different(several)
    run = several[0]
    check_output(output, (".json",), *several, locked, arm_file)
    check_picture(coverage, *several, locked, arm_file)
    if locked is not None and noise is not None:
        raise RigError("--locked and --noise: found both, expected one of them")
    import estimators
    from estimators.ellipsoid import Options
    from estimators.known_angle.from_recording import has_pose
    from rig.recording import Recording, locked_beside, scan_recording, whole_or_thinned

    arm = chosen_arm(arm_file, tip)
    scan = scan_recording(run, joints=None if arm is None else arm.dof)
    from scenarios.checking import unused_words

    stated = stated_metadata(gravity, field)
    by_place, words = stated_by_place(stated, at, date, scan.sensors, unit_of_field(scan))
    tell(unused_words(scan), *contradiction_words(stated, scan), words)
    stated |= by_place
    scan = replace(scan, metadata=replace(scan.metadata, **stated))
    attitude_free = method == "ellipsoid" or (method is None and not has_pose(scan))
    if len(several) > 1:
        single = {"--robust": robust, "--fminunc": fminunc, "--method ellipsoid": attitude_free}
        _refuse(single, f"found {len(several)} recordings, expected one")
    if attitude_free:
        without = f"{run} is calibrated without the attitude"
        of_attitude = {"--arm": arm is not None, "--equal-weights": equal_weights, "--fminunc": fminunc}
        _refuse(of_attitude, f"{without}, expected simultaneous or separate")
        _refuse({"--still": still}, f"{without}, which looks for rest by itself")
    else:
        of_none = {"--parameters": parameters, "--start": starts, "--static-threshold": static_threshold is not None}
        _refuse(of_none, f"{run} is calibrated by the attitude, expected with --method ellipsoid")
    if noise is None and locked is None and (robust or still):
        locked = locked_beside(run)
    floor = estimators.noise_floor(locked) if locked is not None else _given(noise, scan) if noise is not None else None
    points = field_points or "down"
    weighting: Weighting = "equal" if equal_weights else "likelihood"
    with progress_bar(f"calibrating {run if len(several) == 1 else f'{len(several)} recordings'}") as progress:
        source: Path | Recording = run
        if still and len(several) == 1:
            from estimators.stillness.at_rest import at_rest_samples

            source = at_rest_samples(scan.read())
        if len(several) > 1:
            judged, source = _together(several, method, floor, arm, points, weighting, still, stated)
            calibration = with_assumptions(judged, scan, stated)
        elif robust and not attitude_free:
            recording, thinned = (source, "") if isinstance(source, Recording) else whole_or_thinned(scan, _ROBUST)
            tell(thinned)
            calibration, _ = estimators.robust_calibrate(
                recording, method or "simultaneous", floor, arm, points, weighting
            )
        else:
            calibration = estimators.calibrate(
                source,
                method=method,
                noise=floor,
                arm=arm,
                field_points=points,
                weighting=weighting,
                attitude_free=Options(
                    parameters=6 if parameters == "6" else 9,
                    start=parsed_start(starts, scan),
                    static_threshold=static_threshold,
                    field_points=field_points,
                ),
                progress=counted(progress, scan.rows),
                stated=stated,
            )
        if len(several) == 1:
            calibration = with_assumptions(estimators.judged(source, calibration, arm), scan, stated)
        if fminunc:
            from estimators.known_angle.quasi_newton import as_renk

            ends = as_renk(source if isinstance(source, Recording) else scan, calibration, arm)
            extra = {**calibration.extra, "fminunc": {name: end.to_json() for name, end in ends.items()}}
            calibration = replace(calibration, extra=extra)
    write_together((coverage, partial(_draw_coverage, source, calibration, arm)), (output, calibration.write))
    if as_json:
        click.echo(calibration.to_text())
        return _status(calibration)
    from scenarios.terminal.calibration import calibration_report
    from scenarios.terminal.tables import show

    if method is None and attitude_free:
        click.echo(f"{run}: has no pose: calibrated by the magnitude of the fields, as by --method ellipsoid\n")
    show(calibration_report(calibration))
    tell_written(output, coverage)
    status = _status(calibration)
    if status and not attitude_free:
        from scenarios.diagnosing.task import given_arm

        together = " --together" if len(several) > 1 else ""
        command = shlex.join(["rig", "diagnose", *map(str, several), *given_arm(arm_file, tip)])
        click.echo(f"\nWhat is wrong: {command}{together} looks for the cause.")
    return status


def _refuse(options: Mapping[str, object], why: str) -> None:
    """Refuse the first of some options that was given."""
    if option := next((option for option, given in options.items() if given), None):
        raise RigError(f"{option}: {why}")


def _together(
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


def _status(calibration: Calibration) -> int:
    """The exit status: a calibration that is not good is written, and the answer is bad."""
    from scenarios.cli._app import BAD, DONE

    verdicts = [sensor.quality.verdict for sensor in calibration.sensors.values()]
    good = all(not isinstance(verdict, dict) or verdict.get("good", True) for verdict in verdicts)
    return DONE if good else BAD


def _draw_coverage(run: Path | Recording, calibration: Calibration, arm: Arm | None, path: Path) -> None:
    """The directions that the recording has shown each calibrated sensor, by stretches if it is long; those at rest of
    an accelerometer alone that was calibrated by them."""
    from estimators.goodness.judgement import at_rest
    from estimators.known_angle.from_recording import arm_or_named
    from rig.recording import thinned
    from scenarios.overlay import overlays
    from scenarios.plots import coverage_figure, save

    recording = thinned(run, _DRAWN)
    alone = calibration.sensors["accelerometer"] if recording.sensors == ("accelerometer",) else None
    if alone is not None and not alone.axes:
        still = at_rest(run, alone)
        recording = recording if still is None else still
    used = arm_or_named(arm, calibration.arm)
    save(coverage_figure(recording.t, overlays(recording, calibration, used)), path)


def _given(text: str, scan: RecordingScan) -> dict[str, list[float]]:
    """The noise floor of the command line, by sensor in the recorded unit."""
    from rig.units import conversion_factor

    expected = 3 * len(scan.sensors)
    values = numbers(text)
    if len(values) != expected or not all(0.0 < value < float("inf") for value in values):
        raise RigError(
            f"--noise: found {text!r}, expected {expected} positive numbers in mV, separated by commas, "
            f"for {' and '.join(scan.sensors)}"
        )
    factors = {sensor: conversion_factor("mV", scan.columns.units[sensor]) for sensor in scan.sensors}
    return {
        sensor: [factors[sensor] * value for value in values[3 * index : 3 * index + 3]]
        for index, sensor in enumerate(scan.sensors)
    }


@click.command(short_help="Turn a recording's volts into m/s² and field units.")
@click.argument("calibration", type=PATH, metavar="CAL")
@click.argument("run", type=PATH)
@click.option("-o", "--output", type=PATH, required=True, metavar="OUT", help="In field units: .parquet or .csv.")
@json_option
def apply(calibration: Path, run: Path, output: Path, as_json: bool) -> None:
    """Turn the readings of RUN into m/s² and field units with the calibration CAL.

    The accelerometer's field is g - a, or a - g where the recording states that; the magnetometer's the magnetic field,
    both in frame 6.

    \b
    Example:
      rig apply cal.json run.parquet -o fields.parquet
    """
    check_output(output, RECORDING_SUFFIXES, calibration, run)
    from estimators import Calibration
    from estimators.calibration.fields import apply_file
    from rig.recording import scan_recording

    found = Calibration.read(calibration)
    scan = scan_recording(run)
    with progress_bar(f"applying {calibration}") as progress:
        samples = apply_file(found, run, output, counted(progress, scan.rows))
    units = {sensor: scan.metadata.field_unit(sensor) for sensor in scan.sensors if sensor in found.sensors}
    if as_json:
        print_json({"recording": output, "samples": samples, "units": units})
    else:
        made = ", ".join(f"{sensor} [{unit}]" for sensor, unit in units.items())
        click.echo(f"{output}: {samples:,} samples, {made}")
