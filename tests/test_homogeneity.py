"""A cause has one strength everywhere; an image of something else has not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.gap.hypotheses.prior import LENGTHS
from estimators.gap.report.homogeneity import SCATTER, of_cells

Array = NDArray[np.float64]

CELLS, DRAWS = 16, 800


def drawn(rng: np.random.Generator, information: Array) -> tuple[bool, Array]:
    """Whether it is a cause, and its strength in each cell, as the model has it."""
    apart = np.sqrt(3.0) * np.abs(np.subtract.outer(np.arange(CELLS), np.arange(CELLS))) / CELLS / rng.choice(LENGTHS)
    process = rng.choice(SCATTER) * rng.multivariate_normal(np.zeros(CELLS), (1.0 + apart) * np.exp(-apart))
    cause = bool(rng.random() < 0.5)
    return cause, cause * rng.standard_normal() + process + rng.standard_normal(CELLS) / np.sqrt(information)


def test_of_what_is_said_to_be_a_cause_so_many_are() -> None:
    """The number of causes less the sum of their probabilities has variance sum p (1 - p); four standard deviations
    fail by chance once in 16,000, in two classes."""
    rng = np.random.default_rng(0)
    information = np.full(CELLS, 30.0)
    cases = [drawn(rng, information) for _ in range(DRAWS)]
    is_cause = np.array([cause for cause, _ in cases])
    said = 1.0 / (1.0 + np.exp([-of_cells(strength, information) for _, strength in cases]))
    for chosen in (said > 0.5, said <= 0.5):
        p = said[chosen]
        assert abs(is_cause[chosen].sum() - p.sum()) < 4.0 * np.sqrt(np.sum(p * (1.0 - p)))
    assert (said > 0.95).sum() > 0.1 * DRAWS


def test_what_grows_along_a_variable_is_no_cause_however_significant() -> None:
    """Both have the same mean, known to one part in a hundred."""
    rng = np.random.default_rng(1)
    information = np.full(CELLS, 1e4 / CELLS)
    noise = rng.standard_normal(CELLS) / np.sqrt(information)
    assert of_cells(1.0 + noise, information) > np.log(1e4)
    assert of_cells(np.linspace(0.0, 2.0, CELLS) + noise, information) < np.log(10.0)


def test_a_single_cell_tells_nothing() -> None:
    assert abs(of_cells(np.ones(1), np.full(1, 1e4))) < np.log(10.0)
