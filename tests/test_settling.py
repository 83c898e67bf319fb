"""Readings of held poses that come before the sensors have settled are no noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosed_recordings import recorded
from scipy.signal import lfilter

from estimators.noise import held_poses, noise_floor
from estimators.noise.settling import unsettled

POSES, SAMPLES = 6, 2000


def labels() -> np.ndarray:
    """Poses with ten samples between them in which the arm moves."""
    return np.concatenate([np.r_[np.full(10, -1), np.full(SAMPLES, number)] for number in range(POSES)])


def with_noise(kind: str, rng: np.random.Generator) -> np.ndarray:
    noise = rng.standard_normal((POSES * (SAMPLES + 10), 6))
    if kind == "walk":
        return np.cumsum(0.1 * noise, axis=0)
    if kind == "coloured":
        return np.asarray(noise + 2.0 * lfilter([0.05], [1.0, -0.99], noise[::-1], axis=0))
    if kind == "in common":
        return 0.3 * noise + rng.standard_normal((len(noise), 1))
    return np.asarray(rng.standard_t(4.0, noise.shape)) if kind == "long tails" else noise


@pytest.mark.parametrize("kind", ["white", "walk", "coloured", "long tails", "in common"])
def test_noise_alone_is_not_cut(kind: str) -> None:
    """One in a million for each of five lengths; long tails make that a hundred times as often: .05 in 100 draws.
    Were channels that share noise to count as many, one in 30 of them would be cut."""
    rng = np.random.default_rng(3)
    assert not any(unsettled(labels(), with_noise(kind, rng)).any() for _ in range(100))


@pytest.mark.parametrize("memory", [5.0, 20.0])
@pytest.mark.parametrize("swings", [False, True])
def test_what_decays_after_the_stop_is_cut(memory: float, swings: bool) -> None:
    """Of a hundred standard deviations less than one is left after ln(100) memories, and of means over all poses and
    channels less than their spread after at most three times as many."""
    rng = np.random.default_rng(4)
    values, own = with_noise("white", rng), labels()
    time = np.arange(float(SAMPLES))
    decay = np.exp(-time / memory) * (np.cos(time / 3.0) if swings else 1.0)
    for number in range(POSES):
        values[own == number] += 100.0 * np.outer(decay, rng.standard_normal(6))
    cut = unsettled(own, values)
    many = [int(cut[own == number].sum()) for number in range(POSES)]
    assert min(many) == max(many)
    assert 0.7 * np.log(100.0) * memory < many[0] < 3.0 * np.log(100.0) * memory
    assert not cut[own < 0].any()


def test_a_pause_beside_the_poses_changes_nothing() -> None:
    rng = np.random.default_rng(5)
    values, own = with_noise("white", rng), labels()
    for number in range(POSES):
        values[own == number] += 100.0 * np.exp(-np.arange(float(SAMPLES)) / 20.0)[:, None]
    alone = unsettled(own, values)
    short = np.concatenate([own, np.full(100, POSES)])
    beside = unsettled(short, np.concatenate([values, rng.standard_normal((100, 6))]))
    np.testing.assert_array_equal(beside[: len(own)], alone)
    assert beside[len(own) :].sum() <= 100 // 8


def test_the_noise_of_a_slow_sensor_is_that_of_its_readings_at_rest() -> None:
    _, locked = recorded()
    labels_of_it, before = held_poses(locked), noise_floor(locked)
    last = np.flatnonzero(labels_of_it == labels_of_it.max())[0]
    readings = np.array(locked.magnetometer)
    readings[last:] += 50.0 * before.rms[3:].max() * np.exp(-np.arange(len(locked) - last) / 30.0)[:, None]
    after = noise_floor(replace(locked, magnetometer=readings))
    np.testing.assert_allclose(after.rms, before.rms, rtol=0.05)
