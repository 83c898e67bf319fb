"""The improved rig: a scenario with the recording's calibration, its maneuver and the causes of its gap."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from estimators.gap.data.basefit import all_readings, floor_of
from estimators.gap.data.defects import lattice
from estimators.gap.diagnosis import Diagnosis, Estimate
from estimators.gap.report.fitted_rig import FittedRig, delayed, known_to
from estimators.gap.share_words import chance
from rig.acquisition import Acquisition
from rig.arrays import Array
from rig.channels import ACCELEROMETER, CHANNELS, CHANNELS_OF, COLUMNS_OF, MAGNETOMETER
from rig.environment import Environment
from rig.errors import RigError
from rig.maneuver import HandTumble
from rig.recording import Recording
from rig.simulate import Rig, unfelt
from scenarios.gap_report.gap_residuals import GapResiduals
from scenarios.gap_report.words import alike_words, cause_title, explanation_words, sentence
from scenarios.loader import load
from scenarios.plan.closest_maneuver import closest_maneuver
from scenarios.scenario import Scenario

#: The rate at which the simulator runs [Hz]; a slower recording keeps every so many of its samples.
_RATE_HZ: Final = 100.0


@dataclass(frozen=True)
class ImprovedRig:
    """A scenario, and in words where it differs from what was recorded."""

    scenario: Scenario
    remarks: tuple[str, ...]

    def to_toml(self) -> str:
        """The scenario with the remarks as comments above it."""
        lines = [line for remark in self.remarks for line in textwrap.wrap(remark, 116)]
        return "".join(f"# {line}\n" for line in lines) + "\n" + self.scenario.to_toml()


def improved_rig(
    diagnosis: Diagnosis,
    residuals: GapResiduals,
    locked: Recording | None = None,
    base: FittedRig | None = None,
) -> ImprovedRig:
    """The rig of a recording.

    Args:
        residuals: of the diagnosed recording.
        locked: the locked recording, whose converter step is the rig's.
        base: the fitted rig that the recording was judged against, to which the causes are added.

    Raises:
        RigError: the arm cannot be named in a file.
    """
    recording = residuals.recording
    before, chosen = ((), ()) if base is None else (base.effects, base.fitted_to)
    known = () if base is None else (*base.std, *({} for _ in before[len(base.std) :]))
    arm = residuals.data.base.arm
    pipeline = residuals.calibrated
    felt = [(effect, std) for effect, std in zip(before, known, strict=True) if not unfelt(effect, pipeline.sensors)]
    every = max(1, round(_RATE_HZ / recording.rate_Hz))
    rate_Hz = every * recording.rate_Hz
    played = closest_maneuver(recording.t, recording.q, rate_Hz, arm)
    rig = Rig(
        arm=None if isinstance(played.maneuver, HandTumble) else arm,
        environment=_warming(pipeline.environment, recording),
        accelerometer=pipeline.accelerometer,
        magnetometer=pipeline.magnetometer,
        acquisition=_acquisition(residuals, locked, every),
        effects=(
            *(effect for effect, _ in felt),
            *(delayed(effect, -float(recording.t[0])) for effect in residuals.causes),
        ),
    )
    scenario = Scenario(
        name=diagnosis.recording,
        rig=rig,
        maneuver=played.maneuver,
        title=f"The rig of {diagnosis.recording} with the causes of its gap",
        description=sentence(diagnosis),
        source=f"Calibration and effects fitted to {recording.name} by rig diagnose.",
        fitted_to=tuple(dict.fromkeys((*chosen, recording.fingerprint))),
        fitted_std=(*(std for _, std in felt), *(known_to(effect, diagnosis) for effect in residuals.causes)),
        magnetic_field_unit=recording.metadata.magnetic_field_unit,  # type: ignore[arg-type]
    )
    return ImprovedRig(scenario, (played.difference, *_remarks(diagnosis, residuals, rig)))


def read_fitted_rig(path: Path) -> FittedRig:
    """The effects of a scenario's rig, to judge a recording against.

    Raises:
        RigError: as of ``scenarios.load``, or the rig has no effect.
    """
    scenario = load(path)
    if not scenario.rig.effects:
        raise RigError(f"{path}: found no effect, expected a fitted rig, as rig diagnose --save-scenario writes it")
    return FittedRig(path.stem, scenario.rig.effects, scenario.fitted_to, scenario.fitted_std)


def _acquisition(residuals: GapResiduals, locked: Recording | None, every: int) -> Acquisition:
    """Noise floor, converter step and decimation; the range is the board's where no reading leaves it."""
    recording = residuals.recording
    noise = np.zeros(len(CHANNELS))
    for sensor, sigma in floor_of(recording, residuals.floor).items():
        noise[COLUMNS_OF[sensor]] = sigma
    volts = [CHANNELS_OF[sensor] for sensor, unit in recording.units.items() if unit == "V"]
    in_volts = [CHANNELS.index(name) for names in volts for name in names]
    steps = lattice(all_readings(recording if locked is None else locked))[in_volts]
    steps = steps[steps > 0.0]
    readings = all_readings(recording)[:, in_volts]
    standard = Acquisition()
    low, high = standard.range_V or (-np.inf, np.inf)
    bits = standard.bits if len(steps) else None
    within = readings.size > 0 and low <= readings.min() and readings.max() <= high
    return Acquisition(
        noise_V=tuple(float(value) for value in noise),
        range_V=standard.range_V if within else None,
        bits=bits,
        full_scale_V=standard.full_scale_V if bits is None else float(f"{np.median(steps) * 2.0 ** (bits - 1):.6g}"),
        decimation=every,
        accelerometer_reads=recording.metadata.accelerometer_reads,
        pose="joints" if residuals.data.base.arm is not None else "tool",
        units=(recording.units.get(ACCELEROMETER, "V"), recording.units.get(MAGNETOMETER, "V")),
    )


def _warming(environment: Environment, recording: Recording) -> Environment:
    """The environment with the exponential that is nearest to the recorded temperature."""
    if recording.temperature is None:
        return environment
    elapsed = recording.t - recording.t[0]
    best: tuple[float, Array, float] | None = None
    for tau in np.geomspace(max(recording.duration_s / 50.0, 1.0), max(3.0 * recording.duration_s, 2.0), 40):
        columns = np.stack([np.ones_like(elapsed), -np.expm1(-elapsed / tau)], axis=1)
        values, *_ = np.linalg.lstsq(columns, recording.temperature, rcond=None)
        left = float(np.sum((recording.temperature - columns @ values) ** 2))
        if best is None or left < best[0]:
            best = (left, values, float(tau))
    assert best is not None
    return replace(
        environment,
        temperature_degC=float(np.round(best[1][0], 3)),
        temperature_rise_degC=float(np.round(best[1][1], 3)),
        temperature_tau_s=float(np.round(best[2], 1)),
    )


def _unfelt_numbers(estimate: Estimate) -> str:
    """Which numbers of a parameter the recording did not feel, in words; empty where it felt all."""
    if not isinstance(estimate.value, tuple):
        return "" if estimate.value is not None else "it is"
    numbers = [str(number) for number, value in enumerate(estimate.value, start=1) if value is None]
    if len(numbers) > 1:
        return f"numbers {', '.join(numbers[:-1])} and {numbers[-1]} are"
    return f"number {numbers[0]} is" if numbers else ""


def _remarks(diagnosis: Diagnosis, residuals: GapResiduals, rig: Rig) -> list[str]:
    remarks: list[str] = []
    for cause in diagnosis.leading:
        if cause.equivalent:
            title = cause_title(cause.effect, cause.where)
            remarks.append(f"To the recording the same as {title}: {alike_words(cause)}.")
        remarks += [
            f"{name} of {cause_title(cause.effect, cause.where)}: {unfelt_numbers} not felt by the recording: as in the"
            " fit, to which the other values and the calibration belong; other values would do the same."
            for name, estimate in cause.parameters.items()
            if estimate.fitted is not None and (unfelt_numbers := _unfelt_numbers(estimate))
        ]
    others = diagnosis.alternatives[1:] if diagnosis.verdict == "ambiguous" else ()
    if others:
        listed = "; ".join(f"{explanation_words(one)} ({chance(one.probability)})" for one in others)
        remarks.append(f"This is the likeliest explanation. Others that the recording allows: {listed}.")
    if diagnosis.verdict in ("partly", "unknown"):
        remarks.append("Part of the gap has no name, and is not in this rig; the causes may stand in for it.")
    coloured = [CHANNELS[column] for column in residuals.data.columns if residuals.floor[column].parts]
    if coloured:
        remarks.append(f"The noise floor of {', '.join(coloured)} is coloured; here it is white noise of the same RMS.")
    temperature = residuals.recording.temperature
    if temperature is not None:
        off = temperature - rig.environment.temperature(residuals.recording.t - residuals.recording.t[0])
        if (worst := float(np.abs(off).max())) > 0.5:
            remarks.append(
                f"The recorded temperature is up to {worst:.1f} degC off this warm-up; effects that follow it differ."
            )
    return remarks
