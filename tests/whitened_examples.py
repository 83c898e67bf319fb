"""Sweeps of Ann Arbor with effects, and one without any as the diagnosis whitens it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import scenarios
from estimators.gap.data.basefit import estimated_floor, set_up
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.discrepancy import Discrepancies
from estimators.gap.evidence.laplace import Linear
from rig.arm import Arm
from rig.channels import COLUMNS_OF, SENSORS
from rig.effects import make_effect
from rig.recording import Recording

#: A table that shakes: a tone.
SHAKING = make_effect(
    "vibration", {"where": "accelerometer", "amplitude_m_s2": 0.12, "freq_Hz": 37.3, "direction": (1.0, 1.0, 0.0)}
)


def recorded(seed: int, *effects: tuple[str, dict[str, object]], decimation: int = 100) -> Recording:
    scenario = scenarios.load("ann-arbor").with_acquisition(decimation=decimation)
    return scenario.with_effects([make_effect(*each) for each in effects]).simulate(seed=seed)


def louder(run: Recording, noise: np.ndarray) -> Recording:
    """With (n, 6) [V] added to the readings."""
    readings = {sensor: run.readings(sensor) + noise[:, columns] for sensor, columns in COLUMNS_OF.items()}
    return replace(run, **readings)


def noise_of(rest: Recording) -> np.ndarray:
    """(6,) standard deviation of the readings of a recording at rest, by their steps [V]."""
    readings = np.hstack([rest.readings(sensor) for sensor in SENSORS])
    return np.asarray(np.diff(readings, axis=0).std(axis=0) / np.sqrt(2.0))


@pytest.fixture(scope="module")
def data(arm: Arm) -> WhitenedData:
    run = recorded(1)
    return set_up(run, estimated_floor(run, arm), arm)


@pytest.fixture(scope="module")
def discrepancies(data: WhitenedData) -> Discrepancies:
    return Discrepancies.of(data, data)


def unexplained(left: np.ndarray) -> Linear:
    none = np.zeros(0)
    return Linear(left, np.zeros((len(left), 0)), none, none > 0, none, np.zeros(0, dtype=np.intp))
