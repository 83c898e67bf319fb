"""A cause has one strength everywhere; an image of something else has not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from whitened_examples import data  # noqa: F401

from estimators.gap.data.defects import Defect
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.hypotheses.noise_effects import fit_effect
from estimators.gap.hypotheses.prior import LENGTHS, Prior
from estimators.gap.hypotheses.score import Explained
from estimators.gap.hypotheses.stochastic import Left
from estimators.gap.report.homogeneity import (
    SCATTER,
    log_bayes_factor_of_noise,
    log_bayes_factor_of_readings,
    of_cells,
    of_strengths,
)
from estimators.gap.report.p_values import defect_probability
from rig.arrays import Array
from rig.effects import EFFECTS

CELLS, DRAWS = 16, 800


#: What is known of the strength in each cell; beside something else that can change steadily from cell to cell, too.
STEADY = (np.arange(CELLS) - 0.5 * (CELLS - 1)) / np.linalg.norm(np.arange(CELLS) - 0.5 * (CELLS - 1))
KNOWN = {"alone": 30.0 * np.eye(CELLS), "beside": 30.0 * np.eye(CELLS) - 29.0 * np.outer(STEADY, STEADY)}


def drawn(rng: np.random.Generator, known: Array) -> tuple[bool, Array]:
    """Whether it is a cause, and its strength in each cell, as the model has it."""
    apart = np.sqrt(3.0) * np.abs(np.subtract.outer(np.arange(CELLS), np.arange(CELLS))) / CELLS / rng.choice(LENGTHS)
    process = rng.choice(SCATTER) * rng.multivariate_normal(np.zeros(CELLS), (1.0 + apart) * np.exp(-apart))
    cause = bool(rng.random() < 0.5)
    error = np.linalg.solve(np.linalg.cholesky(known).T, rng.standard_normal(CELLS))
    return cause, cause * rng.standard_normal() + process + error


@pytest.mark.parametrize("beside", KNOWN)
def test_of_what_is_said_to_be_a_cause_so_many_are(beside: str) -> None:
    """The number of causes less the sum of their probabilities has variance sum p (1 - p); four standard deviations
    fail by chance once in 16,000, in four classes."""
    rng, known = np.random.default_rng(0), KNOWN[beside]
    cases = [drawn(rng, known) for _ in range(DRAWS)]
    is_cause = np.array([cause for cause, _ in cases])
    said = 1.0 / (1.0 + np.exp([-of_strengths(known, known @ (strength - 1.0)) for _, strength in cases]))
    for chosen in (said > 0.5, said <= 0.5):
        p = said[chosen]
        assert abs(is_cause[chosen].sum() - p.sum()) < 4.0 * np.sqrt(np.sum(p * (1.0 - p)))
    assert (said > 0.95).sum() > 0.1 * DRAWS


def test_what_something_else_can_do_as_well_is_no_sign_of_a_cause() -> None:
    """It takes all that is common to the cells, or what grows from cell to cell: then only the former is told."""
    common = np.full((CELLS, CELLS), 1.0 / CELLS)
    information = 1e4 / CELLS
    taken = information * (np.eye(CELLS) - common)
    assert abs(of_strengths(taken, taken @ np.linspace(-1.0, 1.0, CELLS))) < 1e-6
    drift = information * (np.eye(CELLS) - np.outer(STEADY, STEADY))
    assert of_strengths(drift, drift @ (2.0 * CELLS * STEADY)) > np.log(1e4)
    assert of_cells(1.0 + 2.0 * CELLS * STEADY, np.full(CELLS, information)) < np.log(10.0)


def test_what_grows_along_a_variable_is_no_cause_however_significant() -> None:
    """Both have the same mean, known to one part in a hundred."""
    rng = np.random.default_rng(1)
    information = np.full(CELLS, 1e4 / CELLS)
    noise = rng.standard_normal(CELLS) / np.sqrt(information)
    assert of_cells(1.0 + noise, information) > np.log(1e4)
    assert of_cells(np.linspace(0.0, 2.0, CELLS) + noise, information) < np.log(10.0)


def test_readings_that_are_off_where_a_joint_turns_round_are_an_image(data: WhitenedData) -> None:  # noqa: F811
    """Forty of them, anywhere or all within a twentieth of a joint's angles; two tell next to nothing."""
    rng = np.random.default_rng(2)
    there = np.zeros(data.count, dtype=bool)
    anywhere = there.copy()
    anywhere[rng.choice(data.count, 40, replace=False)] = True
    assert log_bayes_factor_of_readings(anywhere, data) > np.log(20.0)
    angle = data.base.q_encoder[:, 4]  # type: ignore[index]
    ends = there.copy()
    ends[rng.choice(np.flatnonzero(angle > np.quantile(angle, 0.95)), 40, replace=False)] = True
    assert log_bayes_factor_of_readings(ends, data) < -np.log(1e6)
    few = there.copy()
    few[[100, 900]] = True
    assert abs(log_bayes_factor_of_readings(few, data)) < np.log(3.0)


def test_a_limit_is_one_wherever_the_signal_reaches_it(data: WhitenedData) -> None:  # noqa: F811
    """Its readings are those of some poses alone: beside something outside the catalogue that is no doubt, as it is
    where spikes are at those."""
    prior = Prior({"saturation": {"saturation@accel3": 1.0}, "outliers": {"outliers@acquisition": 1.0}})
    high = data.readings[:, 2] > np.quantile(data.readings[:, 2], 0.95)
    affected = np.repeat(high[:, None], 6, axis=1)
    limit = Defect("saturation", "accel3", {}, affected, -100.0, np.zeros(6), anywhere=False)
    spikes = Defect("outliers", "acquisition", {}, affected, -100.0, np.zeros(6))
    assert defect_probability(limit, prior, data) > 0.999
    assert defect_probability(spikes, prior, data) < 1e-6


def test_a_single_cell_tells_nothing() -> None:
    assert abs(of_cells(np.ones(1), np.full(1, 1e4))) < np.log(10.0)


@pytest.mark.parametrize("in_time", [False, True])
@pytest.mark.parametrize("steady", [True, False])
def test_noise_that_comes_and_goes_is_no_noise_effect(in_time: bool, steady: bool, data: WhitenedData) -> None:  # noqa: F811
    """Three times the floor throughout, or five times it in a third of the time: the same mean square.

    The strength in each of 16 cells and more is known to a third: within that of one, or of zero and three.
    """
    there = np.ones(data.count) if steady else 3.0 * ((np.arange(data.count) * 9 // data.count) % 3 == 1)
    left = np.random.default_rng(0).standard_normal((len(data.columns), data.count)) * np.sqrt(1.0 + 8.0 * there)
    lefts = [Left(data, Explained(data.absorbed, left.ravel()))]
    fitted = fit_effect(EFFECTS["noise_excess"], "accel1", lefts[0])
    assert fitted is not None
    log_factor = log_bayes_factor_of_noise(replace(fitted, in_time=in_time), lefts)
    assert log_factor > np.log(50.0) if steady else log_factor < np.log(5.0)
