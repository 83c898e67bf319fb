"""What one cause must not be mistaken for: its twins elsewhere, itself in another form, a clock, an outlier."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import estimators
import scenarios
from estimators.gap.basefit import learn_floor, set_up
from estimators.gap.defects import readings_of
from estimators.gap.diagnosis import Diagnosis
from rig.arm import Arm
from rig.effects import EFFECTS, Effect, make_effect
from rig.recording import Recording
from scenarios.blind.outside import ClockDrift


@pytest.fixture(scope="module")
def arm() -> Arm:
    return Arm.a465()


def recorded(seed: int, *effects: Effect, decimation: int = 100) -> tuple[Recording, Recording]:
    """A sweep with effects, and the arm at rest without them."""
    base = scenarios.load("ann-arbor")
    rig = replace(base.rig, acquisition=replace(base.rig.acquisition, decimation=decimation))
    quiet = replace(base, rig=rig)
    run = quiet.with_effects(effects).simulate(seed=seed)
    return run, quiet.simulate_locked(seed=seed)


def diagnosed(arm: Arm, seed: int, *effects: Effect, decimation: int = 100) -> Diagnosis:
    run, locked = recorded(seed, *effects, decimation=decimation)
    return estimators.diagnose(run, locked, arm=arm)


def test_a_strong_cause_beside_another_keeps_its_twins(arm: Arm) -> None:
    """With joints 2 to 4 locked, links 1 to 4 are one body: whichever carries the iron, none is named alone."""
    found = diagnosed(
        arm,
        5,
        make_effect("joint_eccentricity", {"where": "joint5", "amplitude_rad": 0.02, "phase_rad": 0.3}),
        make_effect("link_hard_iron", {"where": "link4", "field": (0.05, 0.03, 0.04)}),
    )
    sets = [{cause.where, *(str(each["where"]) for each in cause.equivalent)} for cause in found.causes]
    assert {"link1", "link2", "link3", "link4"} in sets
    assert found.verdict == "ambiguous"


def test_a_warmup_in_two_stages_is_not_two_causes(arm: Arm) -> None:
    first = {"where": "accelerometer", "coefficient": (0.4, -0.3, 0.5), "tau_s": 60.0}
    second = {"where": "accelerometer", "coefficient": (0.15, -0.12, 0.2), "tau_s": 450.0}
    found = diagnosed(arm, 6, make_effect("bias_warmup", first), make_effect("bias_warmup", second))
    assert found.verdict == "unknown" or {cause.effect for cause in found.causes} <= {"bias_warmup"}


def test_a_clock_that_drifts_is_no_scale_of_the_joint_that_rolls_on(arm: Arm) -> None:
    found = diagnosed(arm, 7, ClockDrift("acquisition", 3e-5), decimation=25)
    assert found.verdict == "unknown"


def test_one_repeated_row_is_a_dropout(arm: Arm) -> None:
    """No chance repeats six readings: a single row does."""
    run, locked = recorded(8)
    bench = set_up(run, learn_floor(locked, float(np.median(np.diff(run.t)))), arm)
    dropouts, step = EFFECTS["dropouts"], np.zeros(6)
    assert dropouts.examined(readings_of(bench, step), "acquisition") is None
    readings = bench.readings.copy()
    readings[700] = readings[699]
    found = dropouts.examined(readings_of(replace(bench, readings=readings), step), "acquisition")
    assert found is not None
    assert np.flatnonzero(found.affected.all(axis=1)).tolist() == [700]


def test_each_sensor_has_its_own_latency_though_one_is_earlier(arm: Arm) -> None:
    """Beside a delay of both the accelerometer is early, which no low-pass can be: two delays, each with its value.

    Five standard deviations: one in a million a delay.
    """
    delays = {"accelerometer": 0.1, "magnetometer": 0.4}
    each = [make_effect("latency", {"where": where, "delay_s": delay}) for where, delay in delays.items()]
    found = diagnosed(arm, 9, *each, decimation=25)
    assert {(cause.effect, cause.where) for cause in found.causes} == {("latency", where) for where in delays}
    assert found.remainder == "noise"
    for cause in found.causes:
        estimate = cause.parameters["delay_s"]
        assert abs(estimate.value - delays[cause.where]) < 5.0 * estimate.std
