"""Noise at rest whose spectrum does not fall: told there, whitened, and no cause in the sweep."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.fft import dct
from scipy.signal import iirnotch, lfilter
from whitened_examples import louder

import estimators
import scenarios
from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.gap.floor.colour import fit_floor, held
from estimators.gap.floor.resonant import resonant
from estimators.gap.floor.tones_at_rest import tone_words, without_tones
from rig.arrays import Array
from rig.maneuver import LockedPoses
from rig.recording import Recording

POSES, HELD, DT = 7, 200, 0.25
#: An autoregression with a resonance at .14 cycles a sample; and what neighbours are unlike in.
KINDS = {"resonance": [1.0, -1.1, 0.85], "blue": [1.0, 0.5]}


def at_rest(noise: Array) -> list[Array]:
    return list(np.split(noise, POSES))


def learned(noise: Array, interval_s: float = DT, rate_Hz: float = 1.0 / DT) -> ChannelNoise:
    """As ``learn_floor`` does for a channel."""
    (known,) = fit_floor([held(at_rest(noise), 1.0 / rate_Hz)])
    return resonant(at_rest(noise), rate_Hz, interval_s, known)


@pytest.mark.parametrize("kind", ["white", "long tails", "falling", "1/f"])
def test_noise_whose_spectrum_falls_is_as_it_was(kind: str) -> None:
    """The criterion asks for 1.5 log 1400 + 3 = 13.9 in log likelihood of the first coefficient, which white noise
    gives once in 10 million draws. Falling noise is told as another in 2 of 400, so three of 60 once in 300 runs."""
    rng, told = np.random.default_rng(0), 0
    for _ in range(60):
        noise = rng.standard_t(4.0, POSES * HELD) if kind == "long tails" else rng.standard_normal(POSES * HELD)
        if kind == "falling":
            noise = noise + lfilter([1.0], [1.0, -0.9], rng.standard_normal(POSES * HELD))
        if kind == "1/f":
            turns = np.fft.rfft(rng.standard_normal(POSES * HELD))
            noise = noise + 2.0 * np.fft.irfft(turns / np.sqrt(np.maximum(np.arange(len(turns)), 1.0) / len(turns)))
        told += bool(learned(noise).lags)
    assert told < 3


def test_a_falling_floor_with_a_part_too_many_is_as_it_was() -> None:
    """A part that hardly pays is no reason for other noise: none of 20 draws, where every part counted against the
    floor would have it so in two of three."""
    known = ChannelNoise(1.0, ((1.1, 0.45), (0.14, 100.0)), samples=6000, duration_s=300.0, holds=3)
    rng, decay = np.random.default_rng(4), np.exp(-0.05 / 0.45)
    for _ in range(20):
        drive = np.sqrt(1.1 * (1.0 - decay**2)) * rng.standard_normal((3, 2200))
        poses = (rng.standard_normal((3, 2200)) + lfilter([1.0], [1.0, -decay], drive))[:, 200:]
        assert resonant(list(poses), 20.0, DT, known) is known


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("block", [1, 3])
def test_noise_of_another_spectrum_is_whitened_by_what_rest_tells(kind: str, block: int) -> None:
    """Of 30,000 samples: variance one to 1400 samples' 4 % and autocorrelations of nothing, four deviations wide; also
    of means over blocks."""
    rng = np.random.default_rng(1)
    found = learned(lfilter([1.0], KINDS[kind], rng.standard_normal(POSES * HELD)))
    assert found.lags
    sweep = lfilter([1.0], KINDS[kind], rng.standard_normal(30000 * block)).reshape(-1, block).mean(axis=1)
    white = found.averaged(block, DT).whitener(DT * block)(sweep)
    assert np.mean(white**2) == pytest.approx(1.0, abs=0.16)
    for lag in range(1, 12):
        assert abs(np.mean(white[lag:] * white[:-lag])) < 4.0 * np.sqrt(1.0 / 1400.0 + 1.0 / 30000.0)


def test_a_band_that_is_missing_is_told_by_seconds_of_samples() -> None:
    """Within a tenth of a hertz of where a wide notch leaves nothing, whitened noise has .56 of the power, .09 from one
    draw to the next; an autoregression of thirty samples leaves .35 of it."""
    coefficients, rng, power = iirnotch(0.9, 0.8, fs=10.0), np.random.default_rng(5), []
    for _ in range(8):
        found = learned(lfilter(*coefficients, rng.standard_normal(POSES * 1400)), 0.1, 10.0)
        white = found.whitener(0.1)(lfilter(*coefficients, rng.standard_normal(20_000)))
        frequency = np.fft.rfftfreq(len(white), 0.1)
        power.append(np.mean(np.abs(np.fft.rfft(white)[np.abs(frequency - 0.9) < 0.1]) ** 2) / len(white))
    assert np.mean(power) > 0.45


@pytest.mark.parametrize("block", [1, 4])
def test_noise_that_rings_and_drifts_is_whitened_as_both(block: int) -> None:
    """An autoregression of thirty seconds does not hold a drift of minutes beside a resonance. As both, what is left
    has variance one among slow cosines and the rest, to four deviations of what 8000 readings at rest tell of it: of
    the drift a third, of the rest a tenth."""
    rng = np.random.default_rng(6)

    def drawn(count: int) -> Array:
        ring = lfilter([1.0], KINDS["resonance"], rng.standard_normal(count))
        decay = np.exp(-DT / 60.0)
        drive = np.sqrt(1.0 - decay**2) * rng.standard_normal(count)
        drive[0] /= np.sqrt(1.0 - decay**2)
        return np.asarray(ring + 1.5 * lfilter([1.0], [1.0, -decay], drive))

    poses = [drawn(2000) for _ in range(4)]
    (known,) = fit_floor([held(poses, DT)])
    found = resonant(poses, 1.0 / DT, DT, known)
    assert found.lags
    assert found.parts
    sweep = drawn(30_000 * block).reshape(-1, block).mean(axis=1)
    power = dct(found.averaged(block, DT).whitener(DT * block)(sweep), norm="ortho") ** 2
    assert np.mean(power[1:600]) == pytest.approx(1.0, abs=0.33)
    assert np.mean(power[3000:]) == pytest.approx(1.0, abs=0.1)


def test_what_was_sampled_less_often_or_at_odd_times_does_not_tell() -> None:
    noise = lfilter([1.0], KINDS["resonance"], np.random.default_rng(2).standard_normal(POSES * HELD))
    assert learned(noise, interval_s=DT).lags
    assert not learned(noise, interval_s=0.4 * DT).lags
    assert not learned(noise, interval_s=1.4 * DT).lags


def test_a_resonance_at_rest_is_told_at_the_rate_of_the_sweep() -> None:
    """Ten times as many readings at rest: of those as far apart as the sweep's, to four deviations of their 1400."""
    every = np.repeat(lfilter([1.0], KINDS["resonance"], np.random.default_rng(4).standard_normal(POSES * HELD)), 10)
    found = resonant(at_rest(every), 10.0 / DT, DT, ChannelNoise(float(np.var(every)), samples=1400, duration_s=350.0))
    assert found.lags[1] / found.lags[0] == pytest.approx(1.1 / 1.85, abs=0.1)


def test_a_tone_at_rest_is_no_part_of_the_floor_and_a_resonance_is_no_tone() -> None:
    """A tone of half the noise's size: what is left has the noise's variance, to four deviations of 1400 samples."""
    rng = np.random.default_rng(6)
    noise = rng.standard_normal(POSES * HELD)
    hum = 0.7 * np.sin(2.0 * np.pi * 0.137 * np.arange(POSES * HELD) + 1.0)
    ((segments, (heard,)),) = without_tones([at_rest(noise + hum)])
    left = np.concatenate(segments)
    assert heard == pytest.approx(0.137, abs=0.5 / HELD)
    assert np.var(left) == pytest.approx(1.0, abs=0.16)
    assert not learned(left).lags
    resonances = [at_rest(lfilter([1.0], kind, noise)) for kind in KINDS.values()]
    assert all(heard == [] for _, heard in without_tones(resonances))
    floor = [ChannelNoise(1.0), *[ChannelNoise(1.0, tones_Hz=(0.1371,))] * 2, *[ChannelNoise(1.0)] * 3]
    (words,) = tone_words([floor])
    assert words.startswith("the recording at rest has a tone of 0.137 Hz on accel2, accel3: ")


@pytest.mark.parametrize("kind", ["white", "long tails", "walk"])
def test_noise_is_no_tone(kind: str) -> None:
    """A tone must gain 8.5 log 1400 = 62 in log likelihood."""
    rng = np.random.default_rng(7)
    for _ in range(60):
        noise = rng.standard_t(4.0, POSES * HELD) if kind == "long tails" else rng.standard_normal(POSES * HELD)
        segments = at_rest(np.cumsum(noise) if kind == "walk" else noise)
        assert without_tones([segments])[0][1] == []


def test_lines_of_one_hum_are_tones() -> None:
    """Three lines are a resonance to an autoregression as long as two of them are left. Each is worth 1400 log 1.25
    = 312, for 17 log 1400 = 123."""
    rng = np.random.default_rng(8)
    time, lines = np.arange(POSES * HELD), (0.137, 0.211, 0.333)
    hum = np.sum([np.sin(2.0 * np.pi * line * time + line) for line in lines], axis=0)
    ((_, heard),) = without_tones([at_rest(0.7 * hum + rng.standard_normal(POSES * HELD))])
    np.testing.assert_allclose(sorted(heard), lines, atol=0.5 / HELD)


def test_what_hums_in_one_channel_is_looked_for_in_the_others() -> None:
    """By chance it is worth 36 there, once in a thousand; by itself it must be worth 123; that of the second channel
    is worth 80."""
    rng = np.random.default_rng(9)
    hum = np.sin(2.0 * np.pi * 0.25 * np.arange(POSES * HELD) + 1.0)
    noise = rng.standard_normal(POSES * HELD)
    (beside,) = np.concatenate(at_rest(noise)).reshape(1, -1)
    for rows in np.arange(POSES * HELD).reshape(POSES, HELD):  # with nothing at that frequency
        waves = np.exp(0.5j * np.pi * rows)
        beside[rows] -= 2.0 * np.real(np.vdot(waves, beside[rows]) / HELD * waves)
    faint = beside + np.sqrt(2.0 * np.expm1(80.0 / len(hum)) * np.var(beside)) * hum
    loud = hum + rng.standard_normal(POSES * HELD)
    assert without_tones([at_rest(faint)])[0][1] == []
    (_, of_loud), (_, of_faint), (_, of_none) = without_tones([at_rest(each) for each in (loud, faint, beside)])
    assert of_loud == of_faint == pytest.approx([0.25], abs=0.5 / HELD)
    assert of_none == []


def test_colour_that_no_channel_shows_a_board_may() -> None:
    """Three channels whose slow part, a fifth as large as the white one, lasts for six of 210 readings: where none
    shows it by itself, which is so in four of ten, all together do in two of three. Of some fifteen of forty, less than
    a quarter would be once in 5,000 runs."""
    found = []
    decay = float(np.exp(-1.0 / 6.0))
    for seed in range(40):
        rng = np.random.default_rng(seed)
        slow = lfilter([np.sqrt(0.2 * (1.0 - decay**2))], [1.0, -decay], rng.standard_normal((3, 3, 1070)))[..., 1000:]
        channels = [held(list(own), DT) for own in slow + rng.standard_normal((3, 3, 70))]
        alone, together = (fit_floor(channels, boards) for boards in (list("abc"), list("aaa")))
        if not any(noise.parts for noise in alone):
            found.append(all(noise.parts for noise in together))
    assert len(found) > 5
    assert np.mean(found) > 0.25


def ringing(run: Recording, seed: int) -> Recording:
    """The readings with noise that rings at .14 cycles a reading, six times as large as their own."""
    noise = lfilter([1.0], KINDS["resonance"], np.random.default_rng(seed).standard_normal((len(run), 6)), axis=0)
    return louder(run, 0.05 * noise)


def test_noise_that_rings_at_rest_and_in_the_sweep_is_no_cause() -> None:
    """It was a hum or something without a name, with more than .99 in seven of seven."""
    scenario, still = (scenarios.load("ann-arbor").with_acquisition(decimation=each) for each in (100, 1))
    quiet = []
    for seed in range(3):
        run = scenario.simulate(seed)
        rate_Hz = 1.0 / float(np.median(np.diff(run.t)))
        rest = still.rig.simulate(LockedPoses(hold_s=300.0 / rate_Hz, rate_Hz=rate_Hz), np.random.default_rng(seed))
        found = estimators.diagnose(ringing(run, 10 + seed), ringing(rest, 20 + seed))
        assert not [cause for cause in found.causes if cause.probability > 0.95]
        quiet.append(found.posterior["nothing"])
    assert np.mean(quiet) > 0.8
