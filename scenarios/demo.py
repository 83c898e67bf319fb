"""The whole story on one scenario: sweep, locked arm, noise floor, calibration, truth, a fault found, pictures."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from rich.console import RenderableType
from rich.text import Text

import estimators
from estimators import Calibration, Diagnosis, NoiseFloor
from rig.effects import make_effect
from rig.files import made_folder, write_together
from rig.progress import Progress
from rig.recording import Recording
from scenarios.comparison import Compared, compare
from scenarios.gap_report.gap_residuals import GapResiduals, gap_residuals
from scenarios.gap_report.terminal import diagnosis_tables
from scenarios.loader import load
from scenarios.scenario import Scenario
from scenarios.terminal.calibration import calibration_report, comparison_table
from scenarios.terminal.tables import plus_minus

#: What the demo shows unless told otherwise.
SCENARIO: Final = "ann-arbor"

#: What goes wrong on the arm in the demo, and how many samples of its sweep make one of that recording.
FAULT: Final = ("backlash", {"where": "joint5", "width_rad": 0.02})
_FAULT_EVERY: Final = 2

#: 95 % of normal errors lie within so many standard deviations.
_WITHIN: Final = 1.96

Tell = Callable[[RenderableType], None]
Working = Callable[[str], AbstractContextManager[Progress]]


@dataclass(frozen=True)
class Demo:
    """What the demo made.

    Attributes:
        scenario: what was simulated.
        compared: every parameter of its calibration beside its truth.
        diagnosis: of the same sweep with play in a joint.
        files: what was written, by what it is.
        seconds: how long all of it took.
    """

    scenario: Scenario
    compared: tuple[Compared, ...]
    diagnosis: Diagnosis
    files: dict[str, Path]
    seconds: float


def run_demo(folder: Path, seed: int, tell: Tell, working: Working) -> Demo:
    """Run the demo and write recordings, calibration, diagnosis, plots and views into ``folder``.

    Args:
        folder: made where it is missing.
        seed: of the noise.
        tell: takes each part of the story as soon as it is known, to be printed.
        working: what to show, by its words, while something takes its time.

    Raises:
        RigError: the folder cannot be made or written to.
    """
    with made_folder(folder):
        return _told(folder, seed, tell, working)


def _told(folder: Path, seed: int, tell: Tell, working: Working) -> Demo:
    begin = time.perf_counter()
    scenario = load(SCENARIO)
    environment, maneuver = scenario.rig.environment, scenario.maneuver
    tell(_heading(1, "The arm sweeps a torus while the board samples six voltages"))
    tell(Text(f"  {scenario.title}"))
    tell(Text(f"  gravity {environment.gravity_m_s2:.3f} m/s², magnetic field {environment.magnetic_field:.4f} G"))
    with working("sweeping the torus") as progress:
        recording = scenario.simulate(seed, progress)
    samples, every = round(maneuver.duration_s * maneuver.rate_Hz), scenario.rig.acquisition.decimation
    tell(Text(f"  {samples:,} samples in {maneuver.duration_s:,.0f} s, every {every}th kept: {len(recording):,}"))

    tell(_heading(2, "The arm is locked and the noise floor read"))
    with working("locking the arm") as progress:
        locked = scenario.simulate_locked(seed, progress)
        floor = estimators.noise_floor(locked)
    for line in _floor_lines(locked, floor):
        tell(Text(line))

    tell(_heading(3, "Both sensors are calibrated from joint angles and volts alone\n"))
    with working("calibrating"):
        calibration = estimators.judged(recording, estimators.calibrate(recording, noise=floor))
    tell(calibration_report(calibration))

    compared = compare(scenario.truth, calibration)
    tell(_heading(4, "The truth, which only a simulation knows\n"))
    tell(comparison_table(compared))
    tell(Text(_verdict(compared)))

    tell(_heading(5, "A joint gets play, and a diagnosis finds it\n"))
    with working("diagnosing") as progress:
        fault = _faulty(scenario, seed, locked, progress)
    tell(diagnosis_tables(fault.diagnosis, fault.recording.units))

    tell(_heading(6, "To look at"))
    with working("drawing"):
        files = _write(folder, scenario, recording, locked, calibration, compared, fault)
    width = max(len(str(path)) for path in files.values())
    for what, path in files.items():
        tell(Text(f"  {path!s:<{width}}  {what}", no_wrap=True, overflow="ignore"))
    return Demo(scenario, compared, fault.diagnosis, files, time.perf_counter() - begin)


@dataclass(frozen=True)
class _Fault:
    """The sweep of a faulty arm, its diagnosis, and the residuals that it stands on."""

    recording: Recording
    diagnosis: Diagnosis
    residuals: GapResiduals


def _faulty(scenario: Scenario, seed: int, locked: Recording, progress: Progress) -> _Fault:
    every = _FAULT_EVERY * scenario.rig.acquisition.decimation
    faulty = scenario.with_effects([make_effect(*FAULT)]).with_acquisition(decimation=every)
    recording = replace(faulty.simulate(seed), name=f"{scenario.name}-fault")
    diagnosis = estimators.diagnose(recording, locked, progress=progress)
    return _Fault(recording, diagnosis, gap_residuals(recording, diagnosis, locked))


def _heading(number: int, words: str) -> Text:
    return Text(f"\n{number}  {words}", style="bold")


def _floor_lines(locked: Recording, floor: NoiseFloor) -> list[str]:
    poses, hold = len(floor.pose_samples), floor.pose_samples[0] / locked.rate_Hz
    lines = [f"  {poses} poses, {hold:.0f} s each at {locked.rate_Hz:,.0f} Hz: {len(locked):,} samples"]
    for sensor in locked.sensors:
        found = floor.of(sensor, "mV")
        if found is not None:
            values = ", ".join(plus_minus(rms, spread) for rms, spread in zip(*found, strict=True))
            lines.append(f"  {sensor:<14} {values} mV RMS")
    return lines


def _verdict(rows: Sequence[Compared]) -> str:
    errors = np.array([row.error_sigmas for row in rows if row.error_sigmas is not None])
    within = int((np.abs(errors) < _WITHIN).sum())
    untold = len(rows) - len(errors)
    extra = f"; {untold} cannot be told" if untold else ""
    return (
        f"  {within} of {len(errors)} errors within {_WITHIN} σ (expected {0.95 * len(errors):.1f}), "
        f"RMS {np.sqrt(np.square(errors).mean()):.2f} σ (expected 1){extra}"
    )


def _write(
    folder: Path,
    scenario: Scenario,
    recording: Recording,
    locked: Recording,
    calibration: Calibration,
    compared: Sequence[Compared],
    fault: _Fault,
) -> dict[str, Path]:
    from scenarios import plots
    from scenarios.overlay import overlays
    from scenarios.view import write_diagnosis_view, write_view

    arm, laid = scenario.rig.arm, overlays(recording, calibration, scenario.rig.arm)
    writers: tuple[tuple[str, str, Callable[[Path], None]], ...] = (
        ("the recording", ".parquet", recording.write),
        ("the arm locked", ".locked.parquet", locked.write),
        ("the calibration", ".json", calibration.write),
        ("truth, estimate and error", "-errors.png", partial(plots.save, plots.errors_figure(compared))),
        ("the sweep", "-sweep.png", partial(plots.save, plots.sweep_figure(recording, arm))),
        ("residuals", "-residuals.png", partial(plots.save, plots.residuals_figure(recording.t, laid))),
        ("directions seen", "-coverage.png", partial(plots.save, plots.coverage_figure(recording.t, laid))),
        (
            "all of it, moving, for the rerun viewer",
            ".rrd",
            lambda path: write_view(recording, calibration, path, arm),
        ),
        ("the recording of the faulty arm", "-fault.parquet", fault.recording.write),
        ("its diagnosis", "-fault.diagnosis.json", fault.diagnosis.write),
        (
            "the fault on the arm, for the rerun viewer",
            "-fault.rrd",
            lambda path: write_diagnosis_view(fault.diagnosis, fault.residuals, path),
        ),
    )
    files = {what: folder / f"{scenario.name}{suffix}" for what, suffix, _ in writers}
    write_together(*((files[what], write) for what, _, write in writers))  # none beside another run's
    return files
