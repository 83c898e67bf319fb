"""Noise that channels share at rest: told there, and no cause in the sweep."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosed_recordings import scenario
from whitened_examples import data, louder, noise_of  # noqa: F401

import estimators
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.floor.shared import correlations, decorrelation
from rig.effects import make_effect
from rig.recording import Recording

#: Of a reference that all channels have, two of them inverted: a third of the variance of each.
SHARED = np.sqrt(0.35) * np.array([1.0, -1.0, 1.0, 1.0, 1.0, -1.0])
CORRELATION = np.outer(SHARED, SHARED) + 0.65 * np.eye(6)


def with_reference(run: Recording, rest: Recording, seed: int) -> Recording:
    """The readings with noise of a reference beside their own, three quarters as large as that is at rest."""
    noise = np.random.default_rng(seed).standard_normal((len(run), 1)) * np.sign(SHARED)
    return louder(run, 0.75 * noise * noise_of(rest))


@pytest.mark.parametrize("held", [1, 5])
def test_what_channels_share_is_told_from_the_steps_at_rest(held: int) -> None:
    """Of 3,000 readings and their steps, which tell as much as two thirds: .022 each, 15 of them to four and a half
    standard deviations. Readings beyond others by far, one in fifty, change it by a tenth at most, as they are in one
    step of twenty-five."""
    rng = np.random.default_rng(1)
    readings = rng.multivariate_normal(np.zeros(6), CORRELATION, 3000) * np.geomspace(1e-4, 1e-1, 6)
    labels = np.repeat(np.arange(held), 3000 // held)
    readings += labels[:, None]
    assert np.abs(correlations(readings, labels) - CORRELATION).max() < 4.5 * 0.022
    readings[::50] += 1000.0 * rng.standard_normal((60, 6))
    assert np.abs(correlations(readings, labels) - CORRELATION).max() < 4.5 * 0.022 + 0.1
    missing = readings.copy()
    missing[:, 3:] = np.nan
    own = correlations(missing, labels)
    assert np.array_equal(own[3:], np.eye(6)[3:])
    assert own[0, 1] < -0.2


def test_noise_of_each_channel_by_itself_is_shared_by_none() -> None:
    """Fifteen correlations that are none gain 7.5 on average, standard deviation 2.7, where 55 are asked: never."""
    rng = np.random.default_rng(2)
    for _ in range(200):
        readings = rng.standard_normal((1000, 6))
        assert np.array_equal(correlations(readings, np.zeros(1000, dtype=int)), np.eye(6))


@pytest.mark.parametrize("wanders", [0.0, 0.05])
def test_what_channels_share_at_some_frequencies_alone_is_not_shared_from_reading_to_reading(wanders: float) -> None:
    """A hum, or a fan whose phase wanders [rad a reading]: taken out of every reading it would put at all other
    frequencies what it takes out at its own."""
    rng = np.random.default_rng(5)
    labels = np.repeat(np.arange(3), 4000)
    turns = 2.0 * np.pi * 0.3 * np.arange(len(labels)) + np.cumsum(wanders * rng.standard_normal(len(labels)))
    readings = rng.standard_normal((len(labels), 6)) + 1.2 * np.sin(turns)[:, None]
    np.testing.assert_array_equal(correlations(readings, labels), np.eye(6))


def test_two_channels_that_are_the_same_at_rest_can_be_told_apart_in_the_sweep() -> None:
    """As of a column that was written twice: to one part in as many readings."""
    rng = np.random.default_rng(4)
    readings = rng.standard_normal((1500, 6))
    readings[:, 2] = readings[:, 1]
    found = correlations(readings, np.zeros(1500, dtype=int))
    assert found[1, 2] == pytest.approx(1.0 - 1.5 / 1499.0, rel=1e-9)
    assert np.linalg.eigvalsh(found)[0] > 0.5 / 1500.0


def test_whitened_readings_share_nothing(data: WhitenedData) -> None:
    """1,664 noises of six channels that share a reference: 15 correlations to .025 each, four and a half of that."""
    noise = np.random.default_rng(3).multivariate_normal(np.zeros(6), CORRELATION, len(data.base))
    sigma = np.sqrt([channel.variance for channel in data.floor])
    floor = tuple(replace(each, shared=tuple(row)) for each, row in zip(data.floor, CORRELATION.tolist(), strict=True))
    both = replace(data, floor=floor)
    white = both.whiten(noise * sigma).reshape(6, -1)
    assert np.abs(white @ white.T / white.shape[1] - np.eye(6)).max() < 4.5 * np.sqrt(2.0) * 0.025
    shares = decorrelation(floor, tuple(range(6)), both.noises, both.interval_s, both.count)
    assert shares is not None
    np.testing.assert_allclose(shares @ CORRELATION @ shares.T, np.eye(6), atol=1e-12)


def test_columns_of_some_channels_are_whitened_as_all_are(data: WhitenedData) -> None:
    """A change of three channels, and the calibration's tangent, to the last bits."""
    floor = tuple(replace(each, shared=tuple(row)) for each, row in zip(data.floor, CORRELATION.tolist(), strict=True))
    both = replace(data, floor=floor)
    change = both.change(
        [make_effect("field_gradient", {"where": "base", "gradient_per_m": (0.01, 0.0, 0.02, 0.0, 0.01)})]
    )
    columns = both.whiten_changes([change])
    assert columns.first == 3 * both.count
    np.testing.assert_allclose(columns.full(both.size)[:, 0], both.whiten(change), rtol=0, atol=1e-9)
    turned = both.tangent
    assert np.abs(both.absorbed.without(turned)).max() < 1e-7 * np.abs(turned).max()
    assert both.absorbed.rank == data.absorbed.rank
    alone = np.zeros_like(change)
    alone[:, 1] = 1.0
    np.testing.assert_allclose(turned[:, 5], both.whiten(alone), atol=1e-9)


def test_a_reference_that_all_channels_share_at_rest_and_in_the_sweep_is_no_cause() -> None:
    """Something without a name if it is not known from rest, or jitter of the clock. Of others 71 of 72 are called
    quiet: two of four that are not happen once in a thousand times."""
    quiet = 0
    for seed in range(4):
        run, rest = scenario().simulate(seed), scenario().simulate_locked(seed)
        run, rest = with_reference(run, rest, 10 + seed), with_reference(rest, rest, 20 + seed)
        quiet += estimators.diagnose(run, rest).verdict == "no-gap"
    assert quiet >= 3
