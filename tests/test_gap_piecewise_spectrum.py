"""A spectrum in bands that are halved where that is likelier: lines, slopes, and nothing."""

from __future__ import annotations

import numpy as np
import pytest

from estimators.gap.evidence.piecewise_spectrum import piecewise

COUNT = 6655


def squares(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(COUNT) ** 2


def test_of_white_noise_no_band_is_worth_its_cost() -> None:
    """Some 800 bands at most could be; one in 5,000 draws has one that gains 9 nats beyond what finding it costs."""
    for seed in range(100):
        gain, cost, levels = piecewise(squares(seed))
        assert gain <= cost + 9.0
        assert np.count_nonzero(levels == 1.0) > 0.9 * COUNT


@pytest.mark.parametrize("middle", [300, 2050, 5000])
def test_a_line_that_wanders_is_a_narrow_band(middle: int) -> None:
    """A hundred cosines of ten times the floor: half of 100 (10 - 1 - ln 10), 335 nats, to three standard deviations of
    such a sum, 140 nats, and a twentieth for its edges; the level outside is one."""
    true = np.ones(COUNT)
    true[middle - 50 : middle + 50] = 10.0
    for seed in range(5):
        gain, cost, levels = piecewise(true * squares(seed))
        assert gain - cost > 335.0 - 140.0 - 17.0 - 40.0
        assert np.median(levels[middle - 40 : middle + 40]) > 5.0
        assert np.all(levels[np.abs(np.arange(COUNT) - middle) > 200] == 1.0)


def test_a_spectrum_that_falls_needs_no_halves() -> None:
    """A walk of the floor's size at a hundredth of the band: seven octaves that are raised, each fitted to its own
    draws, tell as much as the walk's own shape to a tenth, and cost six nats each at most."""
    place = np.arange(1.0, COUNT + 1.0)
    true = 1.0 + (0.01 * COUNT / place) ** 2
    for seed in range(5):
        power = true * squares(seed)
        gain, cost, _ = piecewise(power)
        own = 0.5 * float(np.sum(power - np.log(true) - power / true))
        assert gain == pytest.approx(own, rel=0.1)
        assert cost < 42.0


def test_a_tone_is_worth_more_as_one() -> None:
    """All of its power in one cosine: as a band of sixteen it gains less than half of that power, by 40 nats."""
    power = squares(1)
    power[3000] += 900.0
    gain, cost, _ = piecewise(power)
    assert 0.0 < gain - cost < 0.5 * 900.0 - 40.0


def test_levels_fall_as_far_as_they_may() -> None:
    quiet = 0.25 * squares(2)
    assert np.all(piecewise(quiet)[2] == 1.0)
    assert piecewise(quiet, least=1e-6)[2].mean() == pytest.approx(0.25, rel=0.1)  # 6,655 squares: to 2 %
    assert piecewise(np.ones(1)) == (0.0, 0.0, np.ones(1))
