"""Effects that are random, against the distributions they state.

Every interval leaves out 1e-7 of the distribution on either side. There are some three hundred in this file: one change
of its seeds in fifteen thousand fails by chance.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effects_rig import TIMES, made, pipeline, recording_for, signals, volts
from scipy.stats import binom, chi2, norm

from rig.arrays import Array
from rig.channels import CHANNELS
from rig.effects import EFFECTS, Effect, Kind, Stage, apply_stage
from rig.signals import Signals

TAIL = 1e-7
COUNT = 20_000
EVEN = np.arange(COUNT) * 0.25
UNEVEN = np.cumsum(np.random.default_rng(11).choice([0.01, 0.25, 1.0], COUNT))
SENSOR = {"accelerometer": slice(0, 3), "magnetometer": slice(3, 6)}


def noise(effect: Effect, t: Array, seed: int = 12) -> Array:
    """(n, 6) what the effect adds to readings of 2.5 V."""
    before = Signals(t=t, volts=np.full((len(t), 6), 2.5))
    return apply_stage((effect,), Stage.ELECTRONIC, before, np.random.default_rng(seed)).volts - 2.5


def assert_white(x: Array, sigma: float) -> None:
    """Independent samples (n,) of variance sigma^2: their mean square, mean and first two autocorrelations."""
    n = len(x)
    low, high = chi2.ppf([TAIL, 1.0 - TAIL], n) / n
    assert low <= np.mean(x**2) / sigma**2 <= high
    bound = norm.isf(TAIL) / np.sqrt(n)
    assert abs(np.mean(x)) <= sigma * bound
    for lag in (1, 2):  # sums of n products of independent normal numbers: normal to 1e-7 well within 10 %
        assert abs(np.mean(x[lag:] * x[:-lag])) <= 1.1 * sigma**2 * bound


def test_every_effect_that_is_not_of_the_mean_is_tried_here_or_with_the_formulas() -> None:
    here = {"noise_excess", "noise_coloured", "bias_random_walk", "timing_jitter", "outliers", "dropouts"}
    with_formulas, with_the_log = {"saturation", "adc_quantisation"}, {"pose_noise"}
    assert here | with_formulas | with_the_log == {
        name for name, effect in EFFECTS.items() if effect.kind is not Kind.MEAN
    }


@pytest.mark.parametrize("where", CHANNELS)
def test_excess_noise_is_white_and_as_large_as_it_says(where: str) -> None:
    added = noise(made("noise_excess", where, extra_sigma=4e-3), EVEN)
    column = CHANNELS.index(where)
    assert_white(added[:, column], 4e-3)
    assert not np.delete(added, column, axis=1).any()


@pytest.mark.parametrize("where", SENSOR)
@pytest.mark.parametrize("t", [EVEN, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("tau", [0.3, 5.0])
def test_coloured_noise_forgets_as_fast_as_it_says(where: str, t: Array, tau: float) -> None:
    """Its innovations (e_(k+1) - a e_k)/sqrt(1 - a^2) are white with the stated sigma, whatever the sampling."""
    sigma = np.array([3e-3, 5e-3, 8e-3])
    added = noise(made("noise_coloured", where, sigma_V=tuple(sigma), tau_s=tau), t)
    own = added[:, SENSOR[where]]
    decay = np.exp(-np.diff(t) / tau)[:, None]
    innovations = np.r_[own[:1], (own[1:] - decay * own[:-1]) / np.sqrt(1.0 - decay**2)]
    for axis in range(3):
        assert_white(innovations[:, axis], sigma[axis])
    crossed = innovations[:, 0] * innovations[:, 1] / sigma[0] / sigma[1]
    assert abs(crossed.mean()) <= 1.1 * norm.isf(TAIL) / np.sqrt(COUNT)
    assert not np.delete(added, SENSOR[where], axis=1).any()


def test_coloured_noise_is_stationary_from_its_first_sample() -> None:
    """Over 2000 recordings of three samples: variance sigma^2 at each, covariance sigma^2 a between neighbours."""
    effect = made("noise_coloured", "magnetometer", sigma_V=(1.0, 1.0, 1.0), tau_s=1.0)
    runs = np.array([noise(effect, np.array([0.0, 0.5, 2.5]), seed)[:, 3] for seed in range(2000)])
    low, high = chi2.ppf([TAIL, 1.0 - TAIL], 2000) / 2000
    for sample in range(3):
        assert low <= np.mean(runs[:, sample] ** 2) <= high
    for (first, second), a in {(0, 1): np.exp(-0.5), (1, 2): np.exp(-2.0)}.items():
        products = runs[:, first] * runs[:, second]  # variance 1 + a^2
        assert abs(products.mean() - a) <= 1.1 * norm.isf(TAIL) * np.sqrt((1.0 + a**2) / 2000)


@pytest.mark.parametrize("where", SENSOR)
@pytest.mark.parametrize("t", [EVEN, UNEVEN], ids=["even", "uneven"])
def test_a_random_walk_has_independent_steps_in_proportion_to_the_root_of_time(where: str, t: Array) -> None:
    rate = np.array([1e-4, 3e-4, 5e-4])
    added = noise(made("bias_random_walk", where, rate=tuple(rate)), t)
    own = added[:, SENSOR[where]]
    assert not own[0].any()
    steps = np.diff(own, axis=0) / np.sqrt(np.diff(t))[:, None]
    for axis in range(3):
        assert_white(steps[:, axis], rate[axis])
    assert not np.delete(added, SENSOR[where], axis=1).any()


def test_the_random_walks_allan_variance_rises_with_a_third_of_the_time() -> None:
    """sigma_A^2(tau) = rate^2 tau/3 (1 + 1/(2 m^2)) for averages of m samples of a sampled walk.

    Non-overlapping differences of neighbouring averages correlate with 1/4 next door: the variance of their mean square
    is at most 2 (1 + 2/16)/n times its square; a normal bound with half as much again for its skewness at n = 400.
    """
    added = noise(made("bias_random_walk", "accelerometer", rate=(1.0, 1.0, 1.0)), EVEN)[:, 0]
    for m in (10, 50):
        averages = added[: COUNT // m * m].reshape(-1, m).mean(axis=1)
        allan = 0.5 * np.mean(np.diff(averages) ** 2)
        expected = 0.25 * m / 3.0 * (1.0 + 0.5 / m**2)
        n = len(averages) - 1
        assert abs(allan / expected - 1.0) <= 1.5 * norm.isf(TAIL) * np.sqrt(2.25 / n)


@pytest.mark.parametrize(("name", "strength"), [("noise_excess", 1), ("noise_coloured", 3), ("bias_random_walk", 3)])
def test_the_stated_spectrum_is_that_of_what_is_added(name: str, strength: int) -> None:
    """The periodogram over the stated spectrum, in ten bands: chi-square of 2 m degrees over 2 m.

    A walk is not stationary: its steps are compared, whose spectrum is (2 sin pi f)^2 times its own. Leakage of the
    finite length moves the bands by about a memory over the length, 1 s over 5000 s.
    """
    one: float | tuple[float, ...] = 1.0 if strength == 1 else (1.0,) * strength
    effect = made(name, **{{"noise_excess": "extra_sigma", "noise_coloured": "sigma_V"}.get(name, "rate"): one})
    added = noise(effect, EVEN)[:, effect.columns][:, 0]
    frequency = np.fft.rfftfreq(COUNT)[1:-1]
    stated = effect.added_spectrum(frequency, 0.25)
    if name == "bias_random_walk":
        added = np.diff(added, prepend=0.0)
        stated = stated * (2.0 * np.sin(np.pi * frequency)) ** 2
    ratio = np.abs(np.fft.rfft(added)[1:-1]) ** 2 / COUNT / stated
    for band in np.array_split(ratio, 10):
        low, high = chi2.ppf([TAIL, 1.0 - TAIL], 2 * len(band)) / (2 * len(band))
        assert low * 0.99 <= band.mean() <= high * 1.01


def test_jitter_reads_all_channels_at_the_same_wrong_time() -> None:
    """At 0.1 ms a reading moves by its slope times the error in time, to (0.1 ms x the sweep's 0.5 rad/s)/2 of that."""
    sigma = 1e-4
    t = np.arange(3000) * 0.25
    clean = pipeline().expected(signals(t), np.random.default_rng(13)).volts
    moved = pipeline(made("timing_jitter", sigma_s=sigma)).expected(signals(t), np.random.default_rng(13)).volts
    error = moved - clean
    slope = np.stack([np.gradient(column, t, edge_order=2) for column in clean.T], axis=1)
    inner = slice(2, -2)  # times beyond the ends are held
    steep = np.abs(slope)
    best = np.argmax(steep, axis=1)
    rows = np.arange(len(t))
    # np.gradient's own error is h^2/6 of the third derivative: (0.25 s x 0.3 rad/s)^2/6 = 1e-3 of the slope.
    offset = (error[rows, best] / slope[rows, best])[inner]
    assert_white(offset, sigma)
    predicted = offset[:, None] * slope[inner]
    assert np.abs(error[inner] - predicted).max() < 0.02 * np.abs(error).max()


def test_outliers_are_as_rare_as_they_say_and_as_large() -> None:
    share, size = 2e-3, 0.4
    added = noise(made("outliers", share=share, size_V=size), EVEN)
    hit = added != 0.0
    np.testing.assert_allclose(np.abs(added[hit]), size, rtol=1e-12)
    total = hit.size
    assert binom.ppf(TAIL, total, share) <= hit.sum() <= binom.isf(TAIL, total, share)
    for column in range(6):
        assert binom.ppf(TAIL, COUNT, share) <= hit[:, column].sum() <= binom.isf(TAIL, COUNT, share)
    up = int((added > 0.0).sum())
    assert binom.ppf(TAIL, hit.sum(), 0.5) <= up <= binom.isf(TAIL, hit.sum(), 0.5)


@pytest.mark.parametrize("share", [0.01, 0.5])
def test_dropouts_repeat_the_last_reading_of_all_channels(share: float) -> None:
    readings = np.random.default_rng(14).random((COUNT, 6))
    before = Signals(t=EVEN, volts=readings)
    after = made("dropouts", share=share).apply(before, np.random.default_rng(15)).volts
    own = (after == readings).all(axis=1)
    repeated = np.r_[False, (after[1:] == after[:-1]).all(axis=1)]
    assert (own ^ repeated).all()  # one or the other, all six channels alike
    assert own[0]
    assert binom.ppf(TAIL, COUNT - 1, share) <= repeated.sum() <= binom.isf(TAIL, COUNT - 1, share)


def test_everything_dropped_is_the_first_reading() -> None:
    readings = np.random.default_rng(16).random((100, 6))
    after = made("dropouts", share=1.0).apply(Signals(t=EVEN[:100], volts=readings), np.random.default_rng(0)).volts
    assert (after == readings[0]).all()


@pytest.mark.parametrize("name", [name for name, effect in EFFECTS.items() if effect.kind is Kind.NOISE])
def test_noise_comes_from_the_generator_that_is_passed_in(name: str) -> None:
    def run(seed: int) -> Array:
        rng = np.random.default_rng(seed)
        through = pipeline(made(name)).expected(recording_for(made(name)), rng)
        return apply_stage((made(name),), Stage.ELECTRONIC, replace(through, volts=through.volts), rng).volts

    assert np.array_equal(run(1), run(1))
    assert not np.array_equal(run(1), run(2))
    assert run(1).shape == volts().shape == (len(TIMES), 6)
