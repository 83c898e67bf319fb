"""A recording beside what a scenario's rig makes of its own maneuver."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import chdtrc

from estimators.gap.data.basefit import on_likely_path, set_up, signals_of
from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.gap.report.fitted_rig import delayed
from rig.arrays import Array
from rig.channels import CHANNELS, CHANNELS_OF, COLUMNS_OF
from rig.effects import Kind
from rig.errors import RigError
from rig.recording import Recording
from scenarios.overlay import Overlay, field_name
from scenarios.scenario import Scenario
from scenarios.shown_units import shown_unit

#: The noise that a scenario states may be so much smaller than the real one: it is measured, or rounded.
_STATED: Final = 1.05


@dataclass(frozen=True)
class ChannelApart:
    """One channel of a recording beside its simulation [recorded unit].

    Attributes:
        channel, unit: what it is.
        sigma: the noise that the scenario states: its board's, its converter's and its effects'.
        mean, rms: of reading less simulation.
        rms_sigmas: RMS over sigma; None where the scenario states no noise. recalibrated_sigmas: the same once the
            calibration is fitted to the recording, the rig's effects in place; None where that fit is refused.
        p_value: the probability of that RMS, or more, by chance; the stated noise is taken to hold within 5 %.
    """

    channel: str
    unit: str
    sigma: float
    mean: float
    rms: float
    rms_sigmas: float | None
    recalibrated_sigmas: float | None
    p_value: float | None


def beside_simulation(recording: Recording, scenario: Scenario) -> tuple[tuple[ChannelApart, ...], dict[str, Overlay]]:
    """The channels, and for each sensor the differences laid over the recording, to be drawn.

    The scenario's rig, with its effects but without its noise, runs the recorded joint angles or poses.

    Raises:
        RigError: the recording has no pose, another arm, or a sensor or a unit that the scenario has not.
    """
    where = recording.origin or recording.name
    rig = scenario.rig
    _check(recording, scenario, where)
    begin_s = float(recording.t[0])
    effects = tuple(delayed(effect, begin_s) for effect in rig.effects)
    mean = tuple(effect for effect in effects if effect.kind is Kind.MEAN)
    signals = on_likely_path(recording, signals_of(recording, rig.arm))
    if signals.temperature is None:
        signals = replace(signals, temperature=rig.environment.temperature(recording.t - begin_s))
    rng = np.random.default_rng(0)  # mean effects draw nothing
    expected = replace(rig.pipeline, effects=mean).expected(signals, rng)
    variance = np.square(rig.acquisition.sigma)
    plain = replace(rig.pipeline, effects=())
    for effect in effects:
        if effect.kind is Kind.NOISE:
            variance = variance + np.nanmean(effect.added_variance(plain.expected(signals, rng), plain), axis=0)
    sigma = np.sqrt(variance)
    refitted = _recalibrated(recording, scenario, mean, sigma)
    rows, laid = [], {}
    for sensor in recording.sensors:
        columns = range(len(CHANNELS))[COLUMNS_OF[sensor]]
        left = recording.readings(sensor) - expected.volts[:, COLUMNS_OF[sensor]]
        for values, column in zip(left.T, columns, strict=True):
            rms = float(np.sqrt(np.mean(values**2)))
            known = sigma[column] > 0.0
            rows.append(
                ChannelApart(
                    channel=CHANNELS[column],
                    unit=recording.unit(sensor),
                    sigma=float(sigma[column]),
                    mean=float(values.mean()),
                    rms=rms,
                    rms_sigmas=rms / float(sigma[column]) if known else None,
                    recalibrated_sigmas=None if refitted is None or not known else float(refitted[column]),
                    p_value=float(chdtrc(len(values), np.sum((values / _STATED / sigma[column]) ** 2)))
                    if known
                    else None,
                )
            )
        rotation = expected.R_base_tool
        field = rig.environment.field(sensor)
        direction = field / np.linalg.norm(field)
        own = rig.pipeline.sensors[sensor]
        shown = shown_unit(recording.unit(sensor))
        band = shown.factor * np.where(
            sigma[list(columns)] > 0.0, sigma[list(columns)], np.sqrt(np.mean(left**2, axis=0))
        )
        laid[sensor] = Overlay(
            sensor,
            CHANNELS_OF[sensor],
            shown.name,
            shown.factor * left,
            band,
            direction @ rotation,
            own.axes,
            direction,
            field_name(sensor, None),
        )
    return tuple(rows), laid


def _check(recording: Recording, scenario: Scenario, where: str) -> None:
    rig = scenario.rig
    if recording.q is None and recording.tool_quaternion is None:
        raise RigError(f"{where}: has no pose, expected q1_rad..qN_rad or tool_qw..tool_qz, to simulate its maneuver")
    if recording.q is not None and (rig.arm is None or rig.arm.dof != recording.q.shape[1]):
        found = "no arm" if rig.arm is None else f"an arm of {rig.arm.dof} joints"
        raise RigError(
            f"scenario {scenario.name}: found {found}, expected {recording.q.shape[1]} joints, as {where} has"
        )
    for sensor in recording.sensors:
        if sensor not in rig.pipeline.sensors:
            raise RigError(f"scenario {scenario.name}: has no {sensor}, expected the sensors of {where}")
        if (unit := rig.acquisition.unit_of[sensor]) != recording.unit(sensor):
            raise RigError(f"{where}: found {sensor} in {recording.unit(sensor)}, expected {unit}, as the scenario's")


def _recalibrated(recording: Recording, scenario: Scenario, effects: tuple, sigma: Array) -> Array | None:  # type: ignore[type-arg]
    """(6,) RMS over sigma once the calibration is fitted; None where that is refused."""
    floor = tuple(ChannelNoise(max(float(each), 1e-12) ** 2) for each in sigma)
    try:
        data = set_up(recording, floor, scenario.rig.arm, effects)
    except RigError:
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.sqrt(np.mean(data.residual**2, axis=0)) / sigma)
