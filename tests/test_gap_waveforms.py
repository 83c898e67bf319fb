"""Any slow course of what a supply acts on is the supply's, also one that jumps or a spectrum tell better than cosines
do; a fast one is something that the catalogue does not have."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from diagnosed_recordings import recorded

import estimators
from estimators.gap.diagnosis import Diagnosis
from rig.arrays import Array
from rig.effects import EFFECTS

WITHOUT = [name for name in EFFECTS if name not in ("supply_ratiometric", "bias_warmup", "scale_temperature")]


def sag(elapsed: Array) -> Array:
    """Falls within a hundredth of the recording, recovers within a tenth."""
    since = elapsed - 0.45
    return np.asarray(np.where(since < 0.0, 0.0, np.minimum(since / 0.01, 1.0) * np.exp(-since / 0.1)))


def sine(elapsed: Array) -> Array:
    """Five and a half periods a recording."""
    return np.asarray(np.sin(11.0 * np.pi * elapsed + 1.0))


def ramp(elapsed: Array) -> Array:
    return np.asarray(elapsed)


def chatter(elapsed: Array) -> Array:
    """Between two values, some sixty times."""
    times = np.sort(np.random.default_rng(5).uniform(0.0, 1.0, 60))
    return np.asarray(np.searchsorted(times, elapsed) % 2, dtype=float)


def diagnosed(course: Callable[[Array], Array], size: float, seed: int) -> Diagnosis:
    run, locked = recorded(seed=seed)
    change = 1.0 + size * course((run.t - run.t[0]) / (run.t[-1] - run.t[0]))[:, None]
    assert run.accelerometer is not None
    assert run.magnetometer is not None
    changed = replace(run, accelerometer=run.accelerometer * change, magnetometer=run.magnetometer * change)
    return estimators.diagnose(changed, locked, without=WITHOUT)


@pytest.mark.parametrize(("course", "size"), [(sag, 0.02), (sine, 0.005), (ramp, 0.01)])
def test_a_supply_that_changes_slowly_is_no_unknown_thing(course: Callable[[Array], Array], size: float) -> None:
    """Some 2.4 V in noise of .013 and .009 V: a signal-to-noise of 30 and more. Three draws of three; another cause
    beside it, which noise may be, is not asked about."""
    for seed in range(3):
        found = diagnosed(course, size, seed)
        assert (found.causes[0].effect, found.causes[0].probability > 0.99) == ("supply_ratiometric", True)
        assert found.posterior["other"] < 0.1


def test_a_supply_that_chatters_is_no_slow_waveform() -> None:
    found = diagnosed(chatter, 0.02, 0)
    assert found.posterior["other"] > 0.9
