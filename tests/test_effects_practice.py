"""The effects against recordings of an independent simulator, with the true calibration and the true parameters."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from rig.arm import Arm
from rig.arrays import Array
from rig.channels import CHANNELS
from rig.effects import make_effect
from rig.environment import Environment
from rig.pipeline import Pipeline
from rig.sensor import TriaxialSensor
from rig.signals import Signals

PRACTICE = Path(__file__).parents[1].parent / "shared" / "practice"
pytestmark = pytest.mark.skipif(not (PRACTICE / "truth.json").is_file(), reason="the practice recordings are not here")

#: Cases whose truth gives all of an effect's parameters. A pair is left out: its other half is not known in full.
COMPLETE = (2, 3, 6, 7, 8, 9, 13, 14, 16, 17, 18, 22, 23, 24, 28)


@cache
def truth() -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads((PRACTICE / "truth.json").read_text(encoding="utf-8"))
    return loaded


def columns(name: str) -> dict[str, Array]:
    table = pq.read_table(PRACTICE / f"{name}.parquet")
    return {column: table[column].to_numpy() for column in table.column_names}


def floor(case: str) -> Array:
    """(6,) [V] noise of the locked recording: the means of its poses removed."""
    table = columns(f"{case}.locked")
    readings = np.stack([table[f"{channel}_V"] for channel in CHANNELS], axis=1)
    angles = np.stack([table[f"q{joint}_rad"] for joint in range(1, 7)], axis=1)
    _, pose = np.unique(np.round(angles, 6), axis=0, return_inverse=True)
    pose = pose.ravel()
    means = np.array([readings[pose == number].mean(axis=0) for number in range(pose.max() + 1)])
    return np.asarray((readings - means[pose]).std(axis=0))


@pytest.mark.parametrize("number", COMPLETE)
def test_the_true_parameters_explain_the_recording(number: int) -> None:
    """The gain <m, r>/<m, m> of the effect's own change m in the residual r is one, within five standard deviations.

    Five: fifteen cases fail by chance once in 1e5. Of a floor with correlation time tau half the variance has the
    spectrum of an autoregression, which is largest at zero frequency: that enlarges the deviation at most by its root.
    """
    case = f"case{number:03d}"
    about = truth()[case]
    calibration = about["calibration"]
    (cause,) = about["effects"]
    table = columns(case)
    parameters = dict(cause["params"])
    if "at_fraction" in parameters:
        parameters["at_s"] = parameters.pop("at_fraction") * table["t_s"][-1]
    effect = make_effect(cause["name"], {"where": cause["where"], **parameters})
    environment = Environment(gravity_direction=tuple(calibration["g"]), magnetic_direction=tuple(calibration["B"]))
    accelerometer = TriaxialSensor.from_axes(calibration["S"], calibration["delta"], calibration["Pa"])
    magnetometer = TriaxialSensor.from_axes(calibration["M"], calibration["dm"], calibration["Pm"])
    recording = Signals(
        t=table["t_s"],
        arm=Arm.a465(),
        q_encoder=np.stack([table[f"q{joint}_rad"] for joint in range(1, 7)], axis=1),
        temperature=table["temperature_degC"],
    )
    readings = np.stack([table[f"{channel}_V"] for channel in CHANNELS], axis=1)
    rng = np.random.default_rng(0)
    plain = Pipeline(environment, accelerometer, magnetometer).expected(recording, rng).volts
    changed = Pipeline(environment, accelerometer, magnetometer, (effect,)).expected(recording, rng).volts
    sigma = floor(case)
    m, r = ((changed - plain) / sigma).ravel(), ((readings - plain) / sigma).ravel()
    tau = about["tau_colour_s"]
    decay = np.exp(-0.25 / tau) if tau else 0.0
    deviation = np.sqrt((0.5 + 0.5 * (1.0 + decay) / (1.0 - decay)) / (m @ m))
    gain = float(m @ r / (m @ m))
    assert deviation < 0.12, "the recording must be able to tell: eight deviations from no effect"
    assert abs(gain - 1.0) < 5.0 * deviation
