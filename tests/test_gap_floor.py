"""The floor: noise of one and two colours, whitened, averaged over blocks, and how well it is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter
from scipy.stats import chi2, kstest

from estimators.gap.data.blocks import block_means, block_size
from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.gap.floor.learned import Learned, Spectrum, parts
from estimators.gap.floor.moved_together import moved_together
from estimators.gap.floor.periodogram import Periodogram

DT = 0.25
WHITE = ChannelNoise(2.0, samples=6000, duration_s=300.0)
ONE = ChannelNoise(1.0, ((1.0, 0.8),), samples=6000, duration_s=300.0)
TWO = ChannelNoise(1.0, ((0.6, 0.5), (0.4, 6.0)), samples=6000, duration_s=300.0)
QUICK = ChannelNoise(1.0, ((0.6, 0.01), (0.4, 6.0)), samples=6000, duration_s=300.0)
#: Of a floor that drifts for as long as a recording lasts.
SLOW = ChannelNoise(1.0, ((0.05, 15.5), (0.3, 585.0), (0.002, 2340.0)), samples=36_000, duration_s=1800.0)
#: Neighbours still share something, means over blocks hardly.
BETWEEN = ChannelNoise(0.01, ((0.2, DT / 8.0), (0.1, 0.7)), samples=6000, duration_s=300.0)


def drawn(noise: ChannelNoise, count: int, interval_s: float, rng: np.random.Generator) -> np.ndarray:
    """A stationary draw: every part started from its own distribution."""
    total = np.sqrt(noise.white) * rng.standard_normal(count)
    for size, tau_s in noise.parts:
        decay = np.exp(-interval_s / tau_s)
        drive = np.sqrt(size * (1.0 - decay**2)) * rng.standard_normal(count)
        drive[0] = np.sqrt(size) * rng.standard_normal()
        total += lfilter([1.0], [1.0, -decay], drive)
    return total


@pytest.mark.parametrize("noise", [WHITE, ONE, TWO])
def test_the_whitener_whitens_the_covariance(noise: ChannelNoise) -> None:
    count = 400
    covariance = toeplitz(noise.autocovariance(DT * np.arange(count)))
    whitener = noise.whitener(DT)
    matrix = whitener(np.eye(count)).T
    white = matrix @ covariance @ matrix.T
    # exact at first; then the filter has forgotten its start to 1 %, whose square is left
    first = whitener.start
    np.testing.assert_allclose(white[:first, :first], np.eye(first), atol=1e-9)
    np.testing.assert_allclose(white, np.eye(count), atol=2e-3)


@pytest.mark.parametrize("noise", [ONE, TWO])
def test_the_scale_is_the_determinants(noise: ChannelNoise) -> None:
    count = 300
    _, expected = np.linalg.slogdet(toeplitz(noise.autocovariance(DT * np.arange(count))))
    # each innovation's deviation is the stationary one to the square of what the filter remembers
    assert 2.0 * noise.whitener(DT).log_scale(count) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("noise", [ONE, TWO, SLOW])
def test_the_response_is_one_over_the_spectrum(noise: ChannelNoise) -> None:
    """Where three parts are slow, to the rounding of the filter's coefficients, which nearly cancel at 0.004 Hz: to
    1e-16 over (2 pi 0.001)^2 0.017, its square root of the spectrum."""
    frequency = np.linspace(1e-3, 0.5, 200)
    found = parts(noise, frequency, DT).at(np.zeros(1 + 2 * len(noise.parts)))
    np.testing.assert_allclose(noise.whitener(DT).response(frequency) * found, 1.0, rtol=1e-8)


def test_a_channel_that_is_not_there_has_no_response_and_no_warning() -> None:
    assert np.isnan(ChannelNoise(np.nan).whitener(DT).response(np.array([0.1, 0.4]))).all()


@pytest.mark.parametrize("noise", [WHITE, ONE, TWO, QUICK, BETWEEN])
@pytest.mark.parametrize("block", [2, 5, 20])
def test_means_over_blocks_have_the_averaged_noise(noise: ChannelNoise, block: int) -> None:
    count = 40
    fine = toeplitz(noise.autocovariance(DT * np.arange(block * count)))
    mean = np.kron(np.eye(count), np.full((1, block), 1.0 / block))
    exact = mean @ fine @ mean.T
    averaged = noise.averaged(block, DT).autocovariance(block * DT * np.arange(count))
    np.testing.assert_allclose(averaged, exact[0], rtol=1e-9, atol=1e-6 * exact[0, 0])  # below that a part looks white
    assert np.all(np.isfinite(noise.averaged(block, DT).whitener(block * DT)(np.ones(500))))


def test_block_means_leave_out_what_is_not_kept() -> None:
    values = np.arange(12.0)
    kept = np.ones(12, dtype=bool)
    kept[[0, 4, 5, 6, 7]] = False
    np.testing.assert_allclose(block_means(values, 4, kept), [2.0, 0.0, 9.5])
    assert block_size(6656, DT) == 1
    assert 8 <= block_size(166_400, 0.01) <= 21


def test_the_expected_periodogram_is_the_mean_of_many() -> None:
    rng = np.random.default_rng(1)
    decay, length, many = np.exp(-DT / 3.0), 256, 4000
    segments = [drawn(ChannelNoise(1e-12, ((1.0, 3.0),)), length, DT, rng) for _ in range(many)]
    found = Periodogram.of(segments)
    ratio = found.power / found.counts / found.exponential(decay)
    # removing each segment's mean takes from the lowest frequency only; elsewhere a mean of exponentials: 5 sigma
    assert np.all(np.abs(ratio[3:] - 1.0) < 5.0 / np.sqrt(found.counts[3:]) + 0.02)


@pytest.mark.parametrize("noise", [WHITE, ONE, TWO])
def test_noise_like_the_floor_is_no_excess(noise: ChannelNoise) -> None:
    """Over 200 draws of the floor itself the gain of an added white part stays below its chi-square bound.

    A one-sided chi-square of one degree of freedom exceeds 15.1 once in 20,000: 200 draws fail once in 100 runs.
    """
    rng = np.random.default_rng(2)
    count = 2048
    frequency = np.arange(1, count) / (2.0 * count)
    shares = parts(noise, frequency, DT)
    total = shares.at(np.zeros(1 + 2 * len(noise.parts)))
    whitened = shares.times(1.0 / total)
    gains = []
    for _ in range(200):
        spectrum = Spectrum(Learned(noise), whitened, rng.standard_normal(count - 1) ** 2, np.ones(count - 1))
        gains.append(spectrum.added(1.0 / total)[1])
    assert max(gains) < 15.1
    assert np.mean(np.array(gains) > chi2.isf(0.1, 1)) < 0.1  # the floor's own uncertainty only lowers it


def test_an_excess_on_a_coloured_floor_is_measured() -> None:
    """The added variance is recovered within its own deviation: 40 draws, their pulls standard normal."""
    rng = np.random.default_rng(3)
    count, extra = 4096, 0.5
    frequency = np.arange(1, count) / (2.0 * count)
    shares = parts(ONE, frequency, DT)
    total = shares.at(np.zeros(3))
    pulls = []
    for _ in range(40):
        power = (1.0 + extra / total) * rng.standard_normal(count - 1) ** 2
        found, gain, spread = Spectrum(Learned(ONE), shares.times(1.0 / total), power, np.ones(count - 1)).added(
            1.0 / total
        )
        assert gain > 10.0
        # the floor is the truth here, not learned: its freedom widens the deviation, so that pulls are narrower
        pulls.append((found - extra) / spread)
    assert np.abs(np.mean(pulls)) < 4.0 / np.sqrt(40)
    assert kstest(np.array(pulls), "norm").statistic < 0.4


def slower(extra: float, rng: np.random.Generator, count: int) -> Spectrum:
    """Of a channel that was white at rest: its sweep, with a part slower than that shows, so many times the white."""
    noise = ChannelNoise(1.0, ((1e-6, 100.0),), samples=6000, duration_s=300.0, holds=3)
    frequency = np.arange(1, count) / (2.0 * count)
    floor = parts(noise, frequency, DT)
    power = (1.0 + extra * floor.coloured[0] / 1e-6) * rng.standard_normal(count - 1) ** 2
    return Spectrum(Learned(noise, 1), floor, power, np.ones(count - 1))


def test_what_rest_did_not_show_is_alike_in_the_channels_of_a_sensor() -> None:
    """Forty draws of three channels: where all have the slow part it is likelier that they have it together than that
    each has one by itself, by what two more free sizes cost, and where one alone has, it is not."""
    rng, gains = np.random.default_rng(8), {0.1: [], 0.0: []}  # type: ignore[var-annotated]
    for extra in (0.1, 0.0) * 40:
        spectra = [slower(0.1, rng, 4096), slower(extra, rng, 4096), slower(extra, rng, 4096)]
        apart = sum(moved_together([each])[1] + fit(each, moved_together([each])[0][0]) for each in spectra)
        points, price = moved_together(spectra)
        gains[extra].append(price + sum(fit(each, at) for each, at in zip(spectra, points, strict=True)) - apart)
    for extra, sign in ((0.1, 1.0), (0.0, -1.0)):
        own = sign * np.array(gains[extra])
        assert own.mean() > 5.0 * own.std() / np.sqrt(40), extra


def fit(spectrum: Spectrum, point: np.ndarray) -> float:
    """Log likelihood of the sweep."""
    total = spectrum.floor.at(point)
    return -0.5 * float(spectrum.counts @ np.log(total) + np.sum(spectrum.power / total))


def test_a_part_as_slow_as_a_pose_was_held_may_be_far_quicker() -> None:
    """At rest three parts up to 13.7 s were taken for two, the slower as slow as a pose was held. A sweep shows that it
    is about as slow as the slowest there is: its logarithm scatters by .5, the median of 20 by .13, and half as much
    again is three of these."""
    truth = ChannelNoise(1.0, tuple((0.35, tau_s) for tau_s in (0.55, 2.74, 13.7)))
    known = ChannelNoise(1.0, ((0.59, 0.92), (0.76, 99.4)), samples=6000, duration_s=300.0, holds=3)
    rng, count, times = np.random.default_rng(12), 6656, []
    frequency = np.arange(1, count) / (2.0 * count)
    true, floor = (parts(noise, frequency, DT) for noise in (truth, known))
    for _ in range(20):
        power = true.at(np.zeros(7)) * rng.standard_normal(count - 1) ** 2
        moved, _ = Spectrum(Learned(known), floor, power, np.ones(count - 1)).alone
        times.append(moved[4])
    assert 2.74 < 99.4 * np.exp(np.median(times)) < 1.5 * 13.7
