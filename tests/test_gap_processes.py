"""An error that changes irregularly with time: told from noise of single channels by its one direction."""

from __future__ import annotations

import numpy as np
import pytest
from whitened_examples import data, discrepancies, unexplained  # noqa: F401

from estimators.gap.data.projection import project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence import processes
from estimators.gap.evidence.discrepancy import Discrepancies, weighed
from estimators.gap.evidence.piecewise_spectrum import piecewise
from estimators.gap.evidence.processes import likeliest
from rig.arrays import Array
from rig.effects._numerics import gauss_markov


def band(rng: np.random.Generator, freedoms: int, count: int = 3000) -> Array:
    """(f, m) cosine transforms with a variance more in a band of 128 cosines."""
    found = np.zeros((freedoms, count))
    found[:, 255:383] = rng.standard_normal((freedoms, 128))
    return found


def test_one_direction_is_told_from_three_that_are_independent() -> None:
    """A band of one direction, seven times the noise, and one of the same power in all three directions by themselves:
    the one direction is found to the few degrees that 128 cosines tell, and gains more than three spectra, each by
    itself, do; the other gains less: twenty draws of twenty. Either way by some 80 to 100 nats, with a scatter of 10
    to 25."""
    direction = np.array([0.8, -0.5, np.sqrt(0.11)])
    for seed in range(20):
        rng = np.random.default_rng([41, seed])
        noise = rng.standard_normal((3, 3000))
        for together in (True, False):
            own = np.outer(direction, band(rng, 1)[0]) * np.sqrt(3.0) if together else band(rng, 3)
            waves = noise + 1.5 * own
            found = likeliest(waves)
            assert found is not None
            alone = sum(gain - cost for gain, cost, _ in map(piecewise, waves**2))
            assert bool(found.gain - found.cost > alone) is together
            if together:
                assert abs(float(found.direction @ direction)) > np.cos(np.radians(10.0))
                assert np.mean(found.excess[255:383] > 0.0) == 1.0


def test_white_noise_shows_no_process() -> None:
    """What the direction and the spectrum cost is more than what the best of them gains, in all but few of 60 draws:
    a Bayes factor exceeds e^3 in one of twenty at most (Markov)."""
    gains = []
    for seed in range(60):
        found = likeliest(np.random.default_rng([42, seed]).standard_normal((3, 3000)))
        gains.append(-np.inf if found is None else found.gain - found.cost)
    assert np.mean(np.array(gains) > 3.0) < 0.15


@pytest.mark.parametrize("together", [True, False], ids=["one direction", "each channel by itself"])
def test_irregular_errors_are_told_where_channels_share_them(
    data: WhitenedData, discrepancies: Discrepancies, together: bool
) -> None:
    """Offsets of the magnetometer of thirty standard deviations, with a memory of a hundredth of the recording: as one
    error where they are in one ratio; where each is by itself, no one direction has what three have."""
    rng = np.random.default_rng(11)
    tau = 0.01 * data.count
    walks = gauss_markov(np.arange(data.count, dtype=float), tau, rng.standard_normal((data.count, 3)))
    change = np.zeros((data.count, 6))
    change[:, 3:] = np.outer(walks[:, 0], [1.0, -0.6, 0.4]) if together else walks
    change = project(data.absorbed, data.whiten(change))
    noise = project(data.absorbed, rng.standard_normal(data.size))
    found = weighed(unexplained(noise + 30.0 * change / np.linalg.norm(change)), discrepancies)
    names = [(each.term.source, each.term.course) for each in found]
    sensor = ("the offsets of the magnetometer", processes.NAME)
    assert (names[0] == sensor) is together
