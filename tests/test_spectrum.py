"""Noise at rest: Allan deviation and its terms, spectrum, whiteness and autoregression, against known noise."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from cli_support import SMALL, Rig
from scipy.signal import butter, fftconvolve, freqz, lfilter

import scenarios
from estimators import calibrate
from estimators.noise.allan import allan_deviation
from estimators.noise.allan_model import allan_model
from estimators.noise.allan_terms import TERMS, NoiseTerms, fit_terms
from estimators.noise.spectrum import autocovariance, autoregression, power_spectrum, whiteness
from estimators.noise.study import study_noise
from rig.errors import RigError
from rig.recording import Metadata, Recording

RATE = 100.0


def flicker_filter(count: int) -> np.ndarray:
    """Fractional integration of order one half: h_0 = 1, h_k = h_{k-1} (k - 1/2) / k (Kasdin 1995)."""
    k = np.arange(1, count)
    return np.concatenate([[1.0], np.cumprod((k - 0.5) / k)])


def records(
    rng: np.random.Generator,
    n: int = 20_000,
    Q: float = 0.0,
    N: float = 0.0,
    B: float = 0.0,
    K: float = 0.0,
    R: float = 0.0,
) -> list[np.ndarray]:
    """Three records of the standard terms, sampled at ``RATE``, made in the time domain."""
    made = []
    for _ in range(3):
        white = N * np.sqrt(RATE) * rng.standard_normal(n)
        rounding = Q * RATE * np.diff(rng.standard_normal(n + 1))
        walk = K / np.sqrt(RATE) * np.cumsum(rng.standard_normal(n))
        pink = fftconvolve(rng.standard_normal(2 * n), B * flicker_filter(n))[n : 2 * n] if B else 0.0
        made.append(white + rounding + walk + pink + R * np.arange(n) / RATE)
    return made


# --- Allan deviation -------------------------------------------------------------------------------------------------


def test_the_overlapping_deviation_is_that_of_the_published_test_data() -> None:
    """NIST Special Publication 1065, section 12.4: a 1000-point set from a congruential generator and its overlapping
    Allan deviation at averages of 1, 10 and 100. Of these the octaves have the first; the definition written out below
    gives all three, and every octave."""
    numbers = [1234567890]
    for _ in range(999):
        numbers.append(16807 * numbers[-1] % 2147483647)
    x = np.array(numbers) / 2147483647.0
    found = allan_deviation([x], 1.0)
    assert found.deviation[0] == pytest.approx(2.922319e-1, rel=2e-7)
    for average, expected in ((10, 9.159953e-2), (100, 3.241343e-2)):
        assert by_definition(x, average) == pytest.approx(expected, rel=2e-7)
    for average, deviation in zip(found.averaged, found.deviation, strict=True):
        assert deviation == pytest.approx(by_definition(x, int(average)), rel=1e-12)


def by_definition(x: np.ndarray, m: int) -> float:
    """Means of m neighbours, differences of those next to each other, all of them."""
    means = np.convolve(x, np.full(m, 1.0 / m), mode="valid")
    return float(np.sqrt(0.5 * np.mean(np.square(means[m:] - means[:-m]))))


def test_records_are_pooled_by_their_differences() -> None:
    rng = np.random.default_rng(0)
    parts = [rng.standard_normal(200), rng.standard_normal(1000) + 5.0]
    found = allan_deviation(parts, RATE)
    squares = [np.square(by_definition(part, 4)) * (len(part) - 7) for part in parts]
    assert found.deviation[2] == pytest.approx(np.sqrt(sum(squares) / (193 + 993)), rel=1e-12)
    assert found.tau_s[2] == pytest.approx(0.04)
    assert found.averaged[-1] == 128  # a sixth of the longest
    with pytest.raises(RigError, match="records of 10, 20 samples, expected one of 24 or more"):
        allan_deviation([np.zeros(10), np.zeros(20)], RATE)


@pytest.mark.parametrize(("column", "power"), [(0, -2), (1, -1), (2, 0), (3, 1)])
def test_expected_variances_are_those_of_the_standard(column: int, power: int) -> None:
    """3 Q^2/tau^2, N^2/tau, (2 ln 2/pi) B^2, K^2 tau/3, per sample: exactly, but that a sampled walk has
    (2 m^2 + 1) / (6 m), and that flicker reaches its plateau within 1 % at averages of 16 and more."""
    averaged = (1, 2, 4, 8, 16, 32, 64)
    found = allan_model((4096,), averaged).variances[:, column]
    m = np.array(averaged, dtype=float)
    unit = (3.0, 1.0, 2.0 * np.log(2.0) / np.pi, 1.0 / 3.0)[column]
    expected = unit * m**power
    if column == 3:
        expected = (2.0 * m**2 + 1.0) / (6.0 * m)
    tolerance = 1e-9 if column != 2 else 0.01
    large = slice(4, None) if column == 2 else slice(None)
    assert np.abs(found[large] / expected[large] - 1.0).max() < tolerance


def test_degrees_of_freedom_of_white_noise_are_the_known_ones() -> None:
    """Of one sample's average: autocorrelation -1/2 at a lag of one, so M / (1 + 2/4). Of longer ones within 5 % of the
    empirical formula (3 (n - 1) / 2 m - 2 (n - 2) / n) 4 m^2 / (4 m^2 + 5) of NIST SP 1065, table 5, which is itself
    good to a few per cent."""
    n = 4096
    averaged = (1, 2, 4, 8, 16, 32, 64, 128)
    model = allan_model((n,), averaged)
    white = np.array([0.0, 1.0, 0.0, 0.0])
    freedom = 2.0 * model.variances[:, 1] ** 2 / model.covariance(white).diagonal()
    assert freedom[0] == pytest.approx((n - 1) / 1.5, rel=1e-3)
    m = np.array(averaged[1:], dtype=float)
    known = (1.5 * (n - 1) / m - 2.0 * (n - 2) / n) * 4.0 * m**2 / (4.0 * m**2 + 5.0)
    assert np.abs(freedom[1:] / known - 1.0).max() < 0.05


def test_covariance_of_allan_variances_is_the_scatter_of_many() -> None:
    """600 records of four noises at once: variances scatter by sqrt(2/600) = 6 %, correlations by 4 %; 8 + 28
    comparisons at five of these, which fail by chance once in 40,000."""
    rng = np.random.default_rng(1)
    n, draws = 1024, 600
    coefficients = np.array([0.5, 1.0, 0.3, 1e-3])
    filters = np.sqrt(coefficients)
    squares = []
    for _ in range(draws):
        x = filters[1] * rng.standard_normal(n) + filters[0] * np.diff(rng.standard_normal(n + 1))
        x += filters[3] * np.cumsum(rng.standard_normal(n))
        x += fftconvolve(rng.standard_normal(8 * n), filters[2] * flicker_filter(7 * n))[7 * n : 8 * n]
        squares.append(np.square(allan_deviation([x], 1.0).deviation))
    table = np.array(squares)
    model = allan_model((n,), (1, 2, 4, 8, 16, 32, 64, 128))
    expected = model.covariance(coefficients)
    assert np.abs(table.mean(axis=0) / (model.variances @ coefficients) - 1.0).max() < 0.1
    ratio = table.var(axis=0) / expected.diagonal()
    assert np.abs(ratio - 1.0)[:6].max() < 5.0 * 0.06
    size = np.sqrt(expected.diagonal())
    difference = np.corrcoef(table.T) - expected / np.outer(size, size)
    assert np.abs(difference[:6, :6]).max() < 5.0 * 0.042


def fitted(seed: int, **made: float) -> NoiseTerms:
    return fit_terms(allan_deviation(records(np.random.default_rng(seed), **made), RATE))


CASES = {
    "white": {"N": 1.0},
    "white and flicker": {"N": 1.0, "B": 1.0},
    "white and walk": {"N": 1.0, "K": 1.0},
    "white and rounding": {"N": 1.0, "Q": 0.05},
    "white and ramp": {"N": 1.0, "R": 0.1},
    "rounding, white, flicker": {"Q": 0.1, "N": 1.0, "B": 1.0},
}
LETTERS = {"Q": "quantisation", "N": "white", "B": "bias_instability", "K": "random_walk", "R": "ramp"}


@pytest.mark.parametrize("case", CASES)
def test_terms_come_back_with_their_uncertainty(case: str) -> None:
    """Twenty data sets a case, far enough from nothing that each term is seen. Another one appears in one data set of
    300, so two of twenty have one by chance once in 500. Values lie within 4.5 standard deviations, and these are not
    too small: the mean square of twenty normalised errors is 1 within 4.5 times sqrt(2/20). Some 160 comparisons at 1
    in 140,000."""
    made = CASES[case]
    errors: dict[str, list[float]] = {letter: [] for letter in made if letter != "R"}
    others = 0
    for seed in range(20):
        found = fitted(seed, **made)
        for letter, name in LETTERS.items():
            if letter in made:
                term = found[name]
                assert term.seen, (name, seed)
                if letter == "R":  # a line does not scatter: its error is that of the noise across it, 1 % here
                    assert term.value == pytest.approx(made["R"], rel=0.05)
                else:
                    errors[letter].append((term.value - made[letter]) / term.std)
            else:
                others += found[name].seen
    assert others <= 1
    for letter, values in errors.items():
        assert np.abs(values).max() < 4.5, letter
        assert np.mean(np.square(values)) < 1.0 + 4.5 * np.sqrt(2.0 / 20.0), letter


def test_intervals_of_the_deviation_cover() -> None:
    """120 white data sets, nine averages: 95 % within five standard errors of 2 %."""
    rng = np.random.default_rng(3)
    expected = None
    inside = []
    for _ in range(120):
        measured = allan_deviation(records(rng, n=2000, N=1.0), RATE)
        low, high = measured.interval(fit_terms(measured).degrees_of_freedom)
        expected = measured.tau_s**-0.5
        inside.append((low <= expected) & (expected <= high))
    share = np.mean(inside, axis=0)
    assert np.abs(share - 0.95).max() < 5.0 * 0.02
    assert np.mean(share) == pytest.approx(0.95, abs=0.02)


def test_upper_limits_of_what_is_not_there_hold_and_are_not_empty() -> None:
    """White noise over 200 s three times: a walk of .2 unit/sqrt(s) would stand out."""
    for seed in range(20):
        found = fitted(seed, N=1.0)
        assert [name for name in TERMS if found[name].seen] == ["white"]
        assert 0.0 < found["random_walk"].upper < 0.2


def test_what_is_none_of_the_terms_is_said_to_be_none() -> None:
    """First-order Gauss-Markov noise has a hump in its Allan deviation, which no standard term has."""
    rng = np.random.default_rng(4)
    made = [lfilter([1.0], [1.0, -0.9], rng.standard_normal(20_000)) + rng.standard_normal(20_000) for _ in range(3)]
    assert fit_terms(allan_deviation(made, RATE)).p_value < 1e-10
    assert fitted(5, N=1.0, K=1.0).p_value > 1e-5


def test_noise_of_zero_has_no_terms() -> None:
    found = fit_terms(allan_deviation([np.full(100, 2.5)], RATE))
    assert not any(found[name].seen for name in TERMS)


# --- spectrum, whiteness, autoregression -----------------------------------------------------------------------------


def test_white_noise_has_a_flat_spectrum_of_twice_its_square() -> None:
    """Its mean over all frequencies is known to sqrt(2 / n) = .6 %; single values scatter as their degrees of freedom
    say."""
    rng = np.random.default_rng(6)
    made = records(rng, N=0.3)
    found = power_spectrum(made, RATE, segment=256)
    inner = found.density[2:-2]
    assert inner.mean() == pytest.approx(2.0 * 0.3**2, rel=5.0 * np.sqrt(2.0 / 60_000))
    assert np.var(inner / inner.mean()) == pytest.approx(2.0 / found.degrees_of_freedom, rel=5.0 * np.sqrt(2.0 / 40.0))
    assert found.frequency_Hz[-1] == RATE / 2.0
    variance = np.mean([record.var() for record in made])
    assert np.sum(found.density) * found.frequency_Hz[1] == pytest.approx(variance, rel=0.02)
    assert np.array_equal(found.amplitude**2, found.density) or np.allclose(found.amplitude**2, found.density)
    with pytest.raises(RigError, match="at most 20 samples in a record"):
        power_spectrum([np.zeros(20)], RATE)


def test_whiteness_has_its_stated_distribution_under_white_noise() -> None:
    """2,000 data sets of pooled records: the p-values are uniform; Kolmogorov's distance exceeds this once in 8,000."""
    rng = np.random.default_rng(7)
    draws = 2000
    p_values = np.sort([whiteness([rng.standard_normal(n) for n in (700, 1300)]).p_value for _ in range(draws)])
    assert np.abs(p_values - (np.arange(draws) + 0.5) / draws).max() < 2.2 / np.sqrt(draws)


def test_whiteness_of_what_a_fitted_model_leaves_counts_its_coefficients() -> None:
    """The same after an autoregression of order two was fitted to noise that has one."""
    rng = np.random.default_rng(8)
    draws = 1000
    p_values = []
    for _ in range(draws):
        made = lfilter([1.0], [1.0, -0.5, 0.3], rng.standard_normal(2100))[100:]
        model = autoregression([made], order=2)
        tested = whiteness([model.whiten(made - made.mean())], fitted=2)
        assert tested.degrees_of_freedom == tested.lags - 2
        p_values.append(tested.p_value)
    distance = np.abs(np.sort(p_values) - (np.arange(draws) + 0.5) / draws).max()
    assert distance < 2.2 / np.sqrt(draws)


def test_coloured_noise_is_not_white() -> None:
    rng = np.random.default_rng(9)
    made = [lfilter([1.0], [1.0, -0.2], rng.standard_normal(5000)) for _ in range(3)]
    assert whiteness(made).p_value < 1e-10
    assert "Ljung-Box" in json.dumps(whiteness(made).to_json())
    with pytest.raises(RigError, match="every record is constant"):
        whiteness([np.full(100, 2.0)])
    with pytest.raises(RigError, match="3 lags, expected more than 5"):
        whiteness(made, lags=3, fitted=5)


def test_an_autoregression_comes_back_and_whitens() -> None:
    """Coefficients to sqrt((1 - a2^2) / n) = .4 %, five of them; order one above is chosen once in 1,000 data sets of
    this length, a lower one never."""
    rng = np.random.default_rng(10)
    sigma = 0.02
    made = [sigma * lfilter([1.0], [1.0, -0.6, 0.25], rng.standard_normal(20_200))[200:] for _ in range(3)]
    found = autoregression(made)
    assert found.order == 2
    assert found.coefficients == pytest.approx([0.6, -0.25], abs=5.0 * 0.004)
    assert found.sigma == pytest.approx(sigma, rel=5.0 / np.sqrt(120_000))
    whitened = [found.whiten(record - record.mean()) for record in made]
    assert len(whitened[0]) == 20_000 - 2
    assert whiteness(whitened, fitted=2).p_value > 1e-6
    assert np.var(whitened) == pytest.approx(1.0, rel=5.0 * np.sqrt(2.0 / 60_000))
    measured = power_spectrum(made, RATE, segment=256)
    model = found.density(measured.frequency_Hz, RATE)
    deviation = (measured.density / model - 1.0)[3:-3] / np.sqrt(2.0 / measured.degrees_of_freedom)
    assert np.sqrt(np.mean(np.square(deviation))) < 1.3
    table = np.stack(made, axis=1)
    assert found.whiten(table).shape == (19_998, 3)
    assert autoregression([rng.standard_normal(20_000)]).order == 0
    with pytest.raises(RigError, match="found order 40"):
        autoregression([np.arange(30.0)], order=40)


def test_autocovariance_is_that_of_the_definition() -> None:
    rng = np.random.default_rng(11)
    parts = [rng.standard_normal(n) for n in (50, 81)]
    centred = [part - part.mean() for part in parts]
    expected = [sum(float(c[: len(c) - lag] @ c[lag:]) for c in centred) / 131 for lag in range(6)]
    assert autocovariance(parts, 5) == pytest.approx(expected, abs=1e-14)


# --- the whole study -------------------------------------------------------------------------------------------------


def locked(**changes: np.ndarray) -> Recording:
    """Two poses of 20 s at 100 Hz; accelerometer 1 walks, 2 is white, 3 is differenced rounding."""
    rng = np.random.default_rng(12)
    n = 4000
    readings = rng.normal(0.0, 0.01, (n, 3))
    readings[:, 0] += np.cumsum(rng.normal(0.0, 1e-3, n))
    readings[:, 2] += 0.05 * np.diff(rng.standard_normal(n + 1))
    q = np.zeros((n, 6))
    q[n // 2 :, 5] = 1.0
    contents = {"t": np.arange(n) / RATE, "accelerometer": readings, **changes}
    return Recording(q=q, metadata=Metadata(rate_Hz=RATE), name="still", **contents)


def test_a_study_tells_each_channel_apart() -> None:
    study = study_noise(locked())
    assert study.rate_Hz == pytest.approx(RATE)
    assert [len(study.channels), len(study.floor.pose_samples)] == [3, 2]
    walk, white, rounding = (study.channels[f"accel{k}"] for k in (1, 2, 3))
    assert walk.terms["random_walk"].value == pytest.approx(1e-3 * np.sqrt(RATE), rel=0.5)
    assert white.whiteness.p_value > 1e-4
    assert white.autoregression.order == 0
    assert white.terms["white"].value == pytest.approx(0.01 / np.sqrt(RATE), rel=0.1)
    assert rounding.terms["quantisation"].value == pytest.approx(0.05 / RATE, rel=0.1)
    said = json.loads(json.dumps(study.to_json(), allow_nan=False))
    assert said["channels"]["accel1"]["terms"]["random_walk"]["unit"] == "V/sqrt(s)"
    assert said["channels"]["accel1"]["terms"]["quantisation"]["unit"] == "V s"
    assert said["channels"]["accel1"]["rms"] == pytest.approx(study.floor.rms[0])


def test_a_study_warns_of_uneven_time_and_stuck_channels() -> None:
    t = np.arange(4000) / RATE
    t[2500:] += 0.5 / RATE
    t[1000] += 0.3 / RATE
    readings = np.random.default_rng(13).normal(0.0, 0.01, (4000, 3))
    readings[:, 1] = 2.5
    study = study_noise(locked(t=t, accelerometer=readings))
    assert list(study.channels) == ["accel1", "accel3"]
    assert "accel2 reads a constant" in study.warnings[1]
    assert "not evenly spaced" in study.warnings[0]
    with pytest.raises(RigError, match="no pose is held for 100 samples"):
        study_noise(locked(), poses=np.arange(4000) // 50)


def test_rig_noise_prints_draws_and_speaks_json(rig: Rig, tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(SMALL)
    scenario = scenarios.load(tmp_path / "small.toml")
    scenario.simulate_locked(0).write(tmp_path / "still.parquet")
    calibrate(scenario.simulate(0)).write(tmp_path / "cal.json")
    text = rig.done(
        "noise", tmp_path / "still.parquet", "--calibration", tmp_path / "cal.json", "-o", tmp_path / "n.png"
    )
    assert "dynamic range [dB]" in text
    assert "dynamic range and bits: of a range of 5 V, as in Renk et al.; a recording states none" in " ".join(
        text.split()
    )
    assert "(m/s²)/√Hz" in text
    assert (tmp_path / "n.png").stat().st_size > 20_000
    said = json.loads(rig.done("noise", tmp_path / "still.parquet", "--json"))
    noise = scenario.rig.acquisition.noise_V
    white = [said["channels"][name]["terms"]["white"]["value"] for name in said["channels"]]
    # Two poses of 2,000 samples: RMS known to 1.1 %; the converter's rounding adds .4 % at most.
    assert white == pytest.approx([sigma / np.sqrt(1000.0) for sigma in noise], rel=0.06)
    assert "no such file" in rig.refused("noise", tmp_path / "none.parquet")


def test_a_band_that_a_filter_has_emptied_stays_empty() -> None:
    """Four poles' noise at .35 of the highest frequency falls by 56 dB to .8 of it: Burg's method tells that to 3 dB
    (40 coefficients of 8000 readings: sqrt(2 40 / 8000), .4 dB, for one deviation, and what so few leave of the
    filter's zeros, 1 dB), while autocovariances of pieces leak 23 dB more into it."""
    numerator, denominator = butter(4, 0.35)
    noise = lfilter(numerator, denominator, np.random.default_rng(3).standard_normal(8400))[400:]
    records, places = np.split(noise, 20), np.pi * np.array([0.1, 0.7, 0.8])
    true = 10.0 * np.log10(np.abs(freqz(numerator, denominator, places)[1]) ** 2)

    def spectrum_dB(method: Literal["yule-walker", "burg"]) -> np.ndarray:
        found = autoregression(records, highest=40, method=method)
        _, response = freqz([found.sigma], [1.0, *-found.coefficients], places)
        return np.asarray(10.0 * np.log10(np.abs(response) ** 2))

    assert spectrum_dB("burg") == pytest.approx(true, abs=3.0)
    assert spectrum_dB("yule-walker")[2] > true[2] + 10.0
    sizes = [autoregression(records, order, method="burg").sigma for order in (0, 3, 30)]
    assert sizes[0] == pytest.approx(float(np.std(noise)), rel=0.02)
    assert sizes == sorted(sizes, reverse=True)
