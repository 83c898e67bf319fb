"""Single readings that are off: what a cause at an uncertain instant does is no outlier."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import sawtooth
from scipy.stats import norm
from whitened_examples import louder, recorded

from estimators.gap.data.basefit import estimated_floor, set_up
from estimators.gap.data.defects import Defect, explained_away, find_defects, relieved
from estimators.gap.floor.channel_noise import sigmas
from rig.arm import Arm
from rig.effects import EFFECTS, Effect, make_effect
from rig.effects.readings import Readings


def step(at_s: float) -> Effect:
    return make_effect("bias_step", {"where": "accel2", "volts": 1.0, "at_s": at_s})


def test_readings_about_an_uncertain_instant_are_no_outliers() -> None:
    """A step of 70 standard deviations is taken to be two samples early: two readings are that far off."""
    arm, quiet = Arm.a465(), recorded(1)
    base = set_up(quiet, estimated_floor(quiet, arm), arm)
    data = set_up(recorded(1, ("bias_step", {"where": "accel2", "volts": 1.0, "at_s": 700.1})), base.floor, arm)
    seen = Defect("outliers", "acquisition", {}, np.zeros(data.readings.shape, dtype=bool), -50.0, np.zeros(6))
    early = 700.1 - 2.0 * data.interval_s

    def outliers(unsure: Sequence[Sequence[Effect]]) -> int:
        left = explained_away(data, [seen], base.pipeline, [step(early)], unsure=unsure)
        return int(sum(defect.affected.sum() for defect in left))

    assert outliers([]) == 2
    assert outliers([[step(early + by * data.interval_s)] for by in (-4.0, 4.0)]) == 0


def test_a_model_that_is_off_for_long_makes_no_outliers() -> None:
    """Readings of a floor with a memory that lie 25 standard deviations beside the model from the first one on, and one
    of them 12 from its neighbours: that one is an outlier, and no other. Of 40,000 readings none is 5.5 off by chance
    in 998 of a thousand recordings."""
    arm, quiet = Arm.a465(), recorded(1, decimation=25)
    base = set_up(quiet, estimated_floor(quiet, arm), arm)
    sigma = sigmas(base.whiteners)
    drift = np.outer(np.linspace(1.0, -1.0, len(quiet)), 25.0 * sigma)
    off = set_up(quiet, base.floor, arm)
    off = replace(off, readings=off.readings + drift)
    assert not [each for each in find_defects(off, np.zeros(6)) if each.effect == "outliers"]
    off.readings[3000, 4] += 12.0 * sigma[4]
    (found,) = [each for each in find_defects(off, np.zeros(6)) if each.effect == "outliers"]
    assert np.argwhere(found.affected).tolist() == [[3000, 4]]


def test_readings_beside_what_is_left_out_are_judged_by_what_is_there() -> None:
    """Readings 60 standard deviations beside the model, of which stretches are left out: none beside these is an
    outlier, and where the noise has long tails none is drawn in by more than such tails have (ten standard deviations
    of 40,000 readings: less than one in a million recordings)."""
    arm, quiet = Arm.a465(), recorded(1, decimation=25)
    base = set_up(quiet, estimated_floor(quiet, arm), arm)
    sigma = sigmas(base.whiteners)
    off = set_up(quiet, base.floor, arm)
    left_out = np.zeros(off.readings.shape, dtype=bool)
    left_out[:50] = left_out[-50:] = left_out[1000:1300] = True
    off = replace(off, readings=off.readings + 60.0 * sigma).without(left_out)
    assert not [each for each in find_defects(off, np.zeros(6)) if each.effect == "outliers"]
    tailed = replace(off, floor=tuple(replace(each, degrees=8.0) for each in off.floor))
    assert np.abs((relieved(tailed).readings - off.readings) / sigma).max() < 10.0


def test_a_level_of_clipping_is_known_to_a_step_of_the_converter() -> None:
    """Rounding is uniform: half a step is 1.73 standard deviations, whatever the level."""
    arm, quiet = Arm.a465(), recorded(1, decimation=25)
    floor = estimated_floor(quiet, arm)
    top = float(np.quantile(quiet.accelerometer[:, 2], 0.9))
    for level in top + 1.2207e-3 * np.array([0.0, 0.3, 0.45, 0.7]):
        clipped = recorded(1, ("saturation", {"where": "accel3", "level": float(level)}), decimation=25)
        defects = find_defects(set_up(clipped, floor, arm), np.zeros(6))
        (found,) = [each for each in defects if each.effect == "saturation"]
        value, std, _ = found.parameters["level"]
        assert abs(value - level) < 2.0 * std
        assert std < 1.2207e-3


def test_a_dozen_clipped_readings_in_noise_of_many_steps_are_found() -> None:
    """Which does not come to lie on one level by itself, so that fewer readings need be expected beyond it: what was
    asked for was 11.5. Without a level there is none: a chance of 1e-5 each."""
    below = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        expected = 1500.0 * sawtooth(np.linspace(0.0, 40.0, 1200) + rng.uniform(0.0, 6.0), 0.5)
        values = np.round(expected + 30.0 * rng.standard_normal(1200))
        level = float(np.sort(values)[-12])
        for each, there in ((values, False), (np.minimum(values, level), True)):
            every = np.tile(each[:, None], (1, 6))
            model = np.tile(expected[:, None], (1, 6))
            white = (every - model) / 30.0
            readings = Readings(every, model, np.full(6, 30.0), white, white > 99.0, np.ones(6), (np.inf,) * 6)
            assert (EFFECTS["saturation"].examined(readings, "accel1") is not None) is there
        below += float(norm.sf(level + 0.5, expected, 30.0).sum()) < 11.5
    assert below >= 5


def test_readings_that_a_level_clips_are_not_missed() -> None:
    """They stay at the level reading after reading. Forty readings of another channel that repeat its last one are
    dropouts, and no clipped one is, where no converter rounds."""
    arm, quiet = Arm.a465(), recorded(1, decimation=25)
    fine = 1.2207e-3 * (np.random.default_rng(1).random((len(quiet), 6)) - 0.5)
    quiet = louder(quiet, fine)
    floor = estimated_floor(quiet, arm)
    readings, field = quiet.accelerometer.copy(), quiet.magnetometer.copy()
    readings[:, 0] = np.minimum(readings[:, 0], np.quantile(readings[:, 0], 0.8))
    clipped = replace(quiet, accelerometer=readings)
    assert {each.effect for each in find_defects(set_up(clipped, floor, arm), np.zeros(6))} == {"saturation"}
    missed = np.arange(50, 4050, 100)
    field[missed, 1] = field[missed - 1, 1]
    both = find_defects(set_up(replace(clipped, magnetometer=field), floor, arm), np.zeros(6))
    (found,) = [each for each in both if each.effect == "dropouts"]
    assert np.argwhere(found.affected).tolist() == [[row, 4] for row in missed]


@pytest.mark.parametrize("seed", range(10))
def test_rows_that_a_coarse_converter_repeats_are_not_missed(seed: int) -> None:
    """Steps of three and a half times the noise, of an arm that rests half of the time: one of twelve rows repeats
    there by chance, and a twentieth of all more does where it is missed. False failures: the significance of the
    effect's own test, 1e-5."""
    rng, count, dropouts = np.random.default_rng(seed), 5000, EFFECTS["dropouts"]
    moved = np.cumsum(np.arange(count) // 100 % 2)
    expected = 100.0 * np.sin(rng.uniform(0.02, 0.06, 6) * moved[:, None])
    values = 3.5 * np.round((expected + rng.standard_normal((count, 6))) / 3.5)
    sigma = np.full(6, np.hypot(1.0, 3.5 / np.sqrt(12.0)))
    white, none = (values - expected) / sigma, np.zeros(values.shape, dtype=bool)
    assert dropouts.examined(Readings(values, expected, sigma, white, none, np.full(6, 3.5)), "acquisition") is None
    for row in np.sort(rng.choice(np.arange(1, count), count // 20, replace=False)):
        values[row] = values[row - 1]
    found = dropouts.examined(Readings(values, expected, sigma, white, none, np.full(6, 3.5)), "acquisition")
    assert found is not None
