"""The ellipsoid fit against the Cramer-Rao bound and against its own covariance, by many draws.

Of 4,000 draws a variance is known to sqrt(2 / 4,000) = 2.2 % and a coverage of 95 % to 0.34 %. Were the estimator
exactly as it claims, one of the 54 variances would leave [.89, 1.11] (4.9 standard deviations) with probability 5e-5
and one of the 54 coverages [93.4, 96.6] % (4.6) with 2e-4: a false failure in some 4,000 sets of draws. The seeds are
the cases' numbers.
"""

from __future__ import annotations

import ellipsoid_examples as example
import numpy as np
import pytest
from scipy.special import stdtrit

from estimators.ellipsoid import fit_ellipsoid

Array = example.Array

DRAWS = 4_000
CASES = [
    ("sphere", 6, (1.0, 1.0, 1.0), False),
    ("sphere", 9, (1.0, 1.0, 1.0), False),
    ("hemisphere", 6, (1.0, 1.0, 1.0), False),
    ("hemisphere", 9, (1.0, 1.0, 1.0), False),
    ("cube", 6, (1.0, 1.0, 1.0), False),
    ("cube", 9, (1.0, 1.0, 1.0), False),
    ("hemisphere", 9, (0.85, 0.68, 1.17), True),  # the ratios of the 3DM's magnetometers
]


def directions_of(kind: str, count: int) -> Array:
    rng = np.random.default_rng(2009)
    return example.cube() if kind == "cube" else getattr(example, kind)(rng, count)


@pytest.mark.parametrize(("case", "kind", "parameters", "ratio", "known"), [(i, *case) for i, case in enumerate(CASES)])
def test_variance_is_the_bound_and_intervals_hold(
    case: int, kind: str, parameters: int, ratio: tuple[float, ...], known: bool
) -> None:
    rng = np.random.default_rng(case)
    gain = example.gain_of(parameters)
    directions = directions_of(kind, 400)
    noise = example.NOISE * np.array(ratio)
    exact = directions @ gain + example.OFFSET
    errors, spreads = np.empty((DRAWS, parameters)), np.empty((DRAWS, parameters))
    disturbed = 0
    for draw in range(DRAWS):
        fit = fit_ellipsoid(
            exact + noise * rng.standard_normal(exact.shape), parameters=parameters, noise=noise if known else None
        )
        errors[draw], spreads[draw] = fit.values, fit.std
        disturbed += fit.dropped.outliers > 0
    errors -= example.truth(parameters)
    ratio_to_bound = errors.var(axis=0, ddof=1) / example.bound(directions, gain, noise).diagonal()
    width = 1.959963984540054 if known else stdtrit(len(exact) - parameters, 0.975)
    coverage = 100.0 * (np.abs(errors) < width * spreads).mean(axis=0)
    assert ((ratio_to_bound > 0.89) & (ratio_to_bound < 1.11)).all(), ratio_to_bound
    assert ((coverage > 93.4) & (coverage < 96.6)).all(), coverage
    # One data set in a thousand has an outlier; more than 14 of 4,000 do with probability 2e-5.
    assert disturbed <= 14


def test_averaging_poses_with_counts_is_worth_their_samples() -> None:
    """26 poses of 5 or 40 samples: means with counts have the bound of all samples. 3,000 draws know a variance to
    2.6 %; the limits are 5 standard deviations away, so of 18 figures one fails in some 1e5 sets."""
    rng = np.random.default_rng(26)
    counts = np.where(np.arange(26) % 2, 40, 5)
    directions = example.cube()
    exact = directions @ example.GAIN + example.OFFSET
    bound = example.bound(np.repeat(directions, counts, axis=0), example.GAIN, np.full(3, example.NOISE))
    noise = example.NOISE / np.sqrt(counts)[:, None]
    errors = np.empty((3000, 9))
    scaled = np.empty((3000, 9))
    for draw in range(len(errors)):
        fit = fit_ellipsoid(exact + noise * rng.standard_normal(exact.shape), counts=counts)
        errors[draw] = fit.values - example.truth(9)
        scaled[draw] = fit.covariance.diagonal()
    assert errors.var(axis=0, ddof=1) / bound.diagonal() == pytest.approx(np.ones(9), abs=0.13)
    # The variance of a sample comes from 17 degrees of freedom: its mean over the draws is known to 0.6 %, and the
    # covariance is linear in it.
    assert scaled.mean(axis=0) / bound.diagonal() == pytest.approx(np.ones(9), abs=0.04)


@pytest.mark.parametrize("kind", ["sphere", "hemisphere"])
def test_noise_does_not_bias_it(kind: str) -> None:
    """20,000 readings, 150 draws: the mean error is known to 0.08 standard deviations; 0.45 is 5.5 of these. The plain
    algebraic fit is off by more than one standard deviation on the hemisphere, which shows that the test can fail."""
    rng = np.random.default_rng(150)
    directions = directions_of(kind, 20_000)
    exact = directions @ example.GAIN + example.OFFSET
    spread = np.sqrt(example.bound(directions, example.GAIN, np.full(3, example.NOISE)).diagonal())
    errors, plain = [], []
    for _ in range(150):
        readings = exact + example.NOISE * rng.standard_normal(exact.shape)
        errors.append(fit_ellipsoid(readings).values - example.truth(9))
        plain.append(example.li_griffiths(readings) - example.OFFSET)
    assert (np.abs(np.mean(errors, axis=0)) < 0.45 * spread).all()
    if kind == "hemisphere":
        assert np.abs(np.mean(plain, axis=0) / spread[6:]).max() > 1.0


@pytest.mark.parametrize("kind", ["sphere", "hemisphere", "cube"])
def test_it_errs_no_more_than_the_usual_fit(kind: str) -> None:
    """RMS offset error over 200 draws within two standard errors (6 %) of Li and Griffiths' on the same readings."""
    rng = np.random.default_rng(200)
    exact = directions_of(kind, 1000) @ example.GAIN + example.OFFSET
    own, usual = np.zeros(200), np.zeros(200)
    for draw in range(200):
        readings = exact + example.NOISE * rng.standard_normal(exact.shape)
        own[draw] = np.square(fit_ellipsoid(readings).offset - example.OFFSET).sum()
        usual[draw] = np.square(example.li_griffiths(readings) - example.OFFSET).sum()
    assert np.sqrt(own.mean()) < 1.06 * np.sqrt(usual.mean())
