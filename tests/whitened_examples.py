"""Sweeps of Ann Arbor with effects, and one without any as the diagnosis whitens it."""

from __future__ import annotations

import numpy as np
import pytest

import scenarios
from estimators.gap.data.basefit import estimated_floor, set_up
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.discrepancy import Discrepancies
from estimators.gap.evidence.laplace import Linear
from rig.arm import Arm
from rig.effects import make_effect
from rig.recording import Recording


def recorded(seed: int, *effects: tuple[str, dict[str, object]], decimation: int = 100) -> Recording:
    scenario = scenarios.load("ann-arbor").with_acquisition(decimation=decimation)
    return scenario.with_effects([make_effect(*each) for each in effects]).simulate(seed=seed)


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
