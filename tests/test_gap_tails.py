"""Noise that is not normal: long tails and coarse converters are floors, not spikes and not missed samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimators.gap.floor.rounded import rounded_floor
from rig.effects import EFFECTS, Readings
from rig.effects.converter import lattice_step
from rig.effects.tails import (
    beside_neighbours,
    drawn_in,
    level_spread,
    scale_of,
    student,
    tails_of,
    variance_beside_neighbours,
)

COUNT = 6000


def readings(noise: np.ndarray, expected: np.ndarray, step: float = 0.0) -> Readings:
    """Of six channels (n, 6); noise of variance one."""
    values = expected + noise
    values = np.round(values / step) * step if step else values
    nothing = np.zeros(noise.shape, dtype=bool)
    sigma = np.full(6, np.sqrt(1.0 + step**2 / 12.0))
    return Readings(values, expected, sigma, (values - expected) / sigma, nothing, np.full(6, step))


@pytest.mark.parametrize("degrees", [3.0, 4.0, 6.0])
def test_the_degrees_of_long_tails_are_found(degrees: float) -> None:
    """6,000 samples tell three from five degrees, and six from eleven, by a log likelihood above 20."""
    values = np.random.default_rng(1).standard_t(degrees, COUNT)
    found, scale, _ = student(values)
    assert 0.6 * degrees <= found <= 1.7 * degrees
    assert scale == pytest.approx(1.0, abs=0.08)  # four standard deviations of the scale with the degrees free


def test_the_scale_of_many_values_is_told_from_groups_of_them() -> None:
    """Next to the likeliest of the values one by one: a tenth of its standard error at the true degrees."""
    values = np.random.default_rng(3).standard_t(4.0, 400_000)
    square = 1.0
    for _ in range(60):
        square = float(np.mean(5.0 * values**2 / (4.0 + values**2 / square)))
    assert scale_of(values, 4.0) == pytest.approx(np.sqrt(square), rel=0.1 / np.sqrt(len(values)))


def test_normal_noise_has_no_long_tails() -> None:
    values = np.random.default_rng(2).standard_normal(COUNT)
    assert student(values)[0] >= 16.0  # at which it is as good as normal
    assert np.isinf(tails_of(beside_neighbours(values), None)[0]) or tails_of(beside_neighbours(values), None)[0] >= 16


def test_spikes_are_told_from_long_tails() -> None:
    rng, outliers = np.random.default_rng(3), EFFECTS["outliers"]
    still = np.zeros((COUNT, 6))
    assert outliers.examined(readings(np.sqrt(0.6) * rng.standard_t(5.0, (COUNT, 6)), still), "acquisition") is None
    noise = rng.standard_normal((COUNT, 6))
    noise[np.arange(500, 5500, 500), 2] += 10.0  # a chance of 1e-8 each to fall below what stands out
    found = outliers.examined(readings(noise, still), "acquisition")
    assert found is not None
    assert np.flatnonzero(found.affected[:, 2]).tolist() == list(range(500, 5500, 500))
    assert int(found.affected.sum()) == 10


@pytest.mark.parametrize("size", [5.4, 8.0])
def test_spikes_just_beyond_the_noise_are_no_long_tails(size: float) -> None:
    """One reading in 300, off by so many deviations to either side: 20 draws, in which tails were never likelier."""
    rng = np.random.default_rng(7)
    for _ in range(20):
        spikes = size * rng.choice([-1.0, 1.0], COUNT) * (rng.random(COUNT) < 1.0 / 300.0)
        values = rng.standard_normal(COUNT) + spikes
        assert np.isinf(tails_of(beside_neighbours(values), None)[0])


def long_tailed(kind: str, rng: np.random.Generator, count: int) -> np.ndarray:
    """Student's t, by its degrees; Laplace's; or normal noise of which one reading in ten is four times as large."""
    if kind == "mixture":
        return np.where(rng.random(count) < 0.1, 4.0, 1.0) * rng.standard_normal(count)
    return rng.laplace(size=count) if kind == "laplace" else rng.standard_t(float(kind), count)


@pytest.mark.parametrize("kind", ["3", "4", "8", "mixture", "laplace"])
def test_the_level_of_long_tails_scatters_as_is_said(kind: str) -> None:
    """Of 600 recordings at rest, its limit learned in each: 6 % of the variance for one deviation, 10 % with what a
    kurtosis of seven adds; four of these."""
    rng, found = np.random.default_rng(6), []
    every = long_tailed(kind, rng, 200_000)
    degrees, scale, _ = student(every)
    for _ in range(600):
        values = long_tailed(kind, rng, 3000)
        found.append(float(np.mean(drawn_in(values, degrees, scale_of(values, degrees)) ** 2)))
    scatter = np.var(found) / np.mean(found) ** 2 / (2.0 / 3000)
    assert scatter == pytest.approx(level_spread(every, degrees, scale), rel=0.4)
    assert level_spread(every, np.inf, scale) == 1.0


@pytest.mark.parametrize("kind", ["4", "mixture", "laplace"])
def test_tails_drawn_in_have_the_variance_that_the_floor_expects(kind: str) -> None:
    """Both variances and the ratio to 0.9 % each (a kurtosis of 4.5): four standard deviations."""
    rng = np.random.default_rng(4)
    at_rest, moving = long_tailed(kind, rng, 40_000), long_tailed(kind, rng, 40_000)
    degrees, scale, _ = student(at_rest)
    local = beside_neighbours(moving)
    there = moving + drawn_in(local, degrees, scale_of(local, degrees)) - local
    ratio = np.mean(there**2) / np.mean(drawn_in(at_rest, degrees, scale) ** 2)
    assert ratio == pytest.approx(variance_beside_neighbours(at_rest, degrees, scale), abs=0.06)


@pytest.mark.parametrize("size", [0.15, 0.3, 0.5])
def test_a_coarse_converter_hides_noise_at_rest_and_makes_it_in_motion(size: float) -> None:
    """Three poses between levels: the variance in motion is the noise's and a twelfth of the step's square."""
    rng = np.random.default_rng(5)
    poses = [np.round(place + size * rng.standard_normal(2000)) for place in (0.1, 0.45, 0.8)]
    found = rounded_floor(poses, 1.0, 300.0)
    true = size**2 + 1.0 / 12.0
    assert found.white == pytest.approx(true, abs=4.0 * true * np.sqrt(2.0 / found.samples))


def test_levels_that_repeat_are_no_missed_samples() -> None:
    """A slow signal on a converter with a step of three deviations repeats a level in all channels now and then."""
    rng, dropouts = np.random.default_rng(6), EFFECTS["dropouts"]
    path = 40.0 * np.sin(np.outer(np.linspace(0.0, 20.0, COUNT), 1.0 + 0.1 * np.arange(6)))
    own = readings(rng.standard_normal((COUNT, 6)), path, step=3.0)
    assert (own.values[1:] == own.values[:-1]).all(axis=1).sum() > 10
    assert dropouts.examined(own, "acquisition") is None
    own.values[700:4700:20] = own.values[699:4699:20]
    found = dropouts.examined(own, "acquisition")
    assert found is not None


def test_the_step_of_a_coarse_converter_has_the_width_that_its_levels_show() -> None:
    """Written to a thousandth of the floor, a step of eight tenths: six standard deviations, of a millionth or so."""
    rng, converter = np.random.default_rng(8), EFFECTS["adc_quantisation"]
    own = readings(rng.standard_normal((COUNT, 6)), 20.0 * np.sin(np.linspace(0.0, 60.0, COUNT))[:, None], 0.8123457)
    found = converter.examined(replace(own, values=np.round(own.values, 3), step=np.full(6, 1e-3)), "acquisition")
    assert found is not None
    std = found.std["lsb_V"]
    assert std is not None
    assert 1e-7 < std < 1e-4
    assert abs(found.effect.strengths[0] - 0.8123457) < 6.0 * std


def test_a_coarse_converter_is_found_beside_a_clipped_range() -> None:
    """Clipped behind the converter, at a level that is none of its own."""
    rng, converter = np.random.default_rng(8), EFFECTS["adc_quantisation"]
    own = readings(rng.standard_normal((COUNT, 6)), 20.0 * np.sin(np.linspace(0.0, 60.0, COUNT))[:, None], 0.8)
    clipped = replace(own, values=np.minimum(own.values, [18.1, *[np.inf] * 5]), step=np.full(6, 1e-3))
    found = converter.examined(clipped, "acquisition")
    assert found is not None
    assert found.effect.strengths[0] == pytest.approx(0.8, rel=1e-9)
    level = EFFECTS["saturation"].examined(clipped, "accel1")
    assert level is not None
    assert level.effect.strengths == pytest.approx(18.1)


@pytest.mark.parametrize("levels", [3, 4, 5, 9])
def test_few_levels_have_a_step(levels: int) -> None:
    """As of a coarse converter at rest."""
    assert lattice_step(np.repeat(0.8 * np.arange(levels), 50)) == pytest.approx(0.8, rel=1e-12)
