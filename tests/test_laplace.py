"""The log evidence of effects as they are linearised, against what it is in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimators.gap.evidence.laplace import Linear
from estimators.gap.hypotheses.prior import LENGTHS


@pytest.mark.parametrize("alike", [0.0, 0.9, 1.0 - 1e-13])
def test_the_evidence_of_effects_is_that_of_a_normal_vector(alike: float) -> None:
    """Two that hardly differ, and others: the determinant and the square of what they make, by the whole covariance."""
    rng = np.random.default_rng(3)
    tangent = rng.standard_normal((40, 3)) * [3.0, 3.0, 0.1]
    tangent[:, 1] = alike * tangent[:, 0] + np.sqrt(1.0 - alike**2) * tangent[:, 1]
    left, point, precision = rng.standard_normal(40), np.array([0.5, -0.2, 1.0]), np.array([1.0, 0.1, 0.04])
    linear = Linear(left, tangent, point, np.ones(3, dtype=bool), np.ones(3), np.arange(3))
    found = float(linear.log_evidence(float(left @ left), linear.gram, tangent.T @ left, precision))
    covariance = np.eye(40) + (tangent / precision) @ tangent.T
    off = left + tangent @ point  # the strengths are normal about zero
    expected = -0.5 * off @ np.linalg.solve(covariance, off) - 0.5 * np.linalg.slogdet(covariance)[1]
    assert found == pytest.approx(float(expected), rel=1e-9)


@pytest.mark.parametrize("fault", [(0.0, 6.0, 0.0), (5.0, -4.0, 6.0)])
def test_one_axis_alone_or_all_of_them_are_averaged(fault: tuple[float, ...]) -> None:
    """Strengths that do not overlap: each has an evidence of its own, (1 + v)^-1/2 exp(z^2/2 v/(1 + v)) for z standard
    deviations and a prior of variance v. What is held to a thousandth of its scale is left out: (v + z^2) 1e-6."""
    rng = np.random.default_rng(3)
    tangent = np.linalg.qr(rng.standard_normal((40, 3)))[0]
    left = tangent @ np.array(fault)
    owner, there = np.zeros(3, dtype=np.intp), np.ones(3, dtype=bool)
    linear = Linear(left, tangent, np.zeros(3), there, np.ones(3), owner, by_axis=there)
    logs = []
    for scale in linear.grids[0]:
        variance = float(scale) ** 2
        own = 0.5 * np.array(fault) ** 2 * variance / (1.0 + variance) - 0.5 * np.log1p(variance)
        logs += [np.log(0.5) + own.sum(), *(np.log(0.5 / 3.0) + own)]
    expected = np.logaddexp.reduce(logs) - np.log(len(linear.grids[0])) - 0.5 * left @ left
    allowed = 1e-6 * (float(linear.grids[0][-1]) ** 2 + float(left @ left))
    assert linear.averaged[0] == pytest.approx(expected, abs=allowed)
    all_alike = replace(linear, by_axis=~there).averaged[0]
    assert (linear.averaged[0] > all_alike) == (sum(value != 0.0 for value in fault) == 1)


@pytest.mark.parametrize("course", [(4.0, 0.0, 0.0), (2.0, -8.0, 5.0)])
def test_cosines_of_a_course_are_those_of_a_process_of_any_memory(course: tuple[float, ...]) -> None:
    """Strengths that do not overlap: each has an evidence of its own, (1 + v)^-1/2 exp(z^2/2 v/(1 + v)), v in
    proportion to the squares of a Matern process' coefficients."""
    tangent = np.linalg.qr(np.random.default_rng(3).standard_normal((40, 3)))[0]
    left = tangent @ np.array(course)
    owner, there = np.zeros(3, dtype=np.intp), np.ones(3, dtype=bool)
    linear = Linear(left, tangent, np.zeros(3), there, np.ones(3), owner, orders=np.array([1, 2, 3]))
    logs = []
    for scale in linear.grids[0]:
        for length in LENGTHS:
            fall = 1.0 / (3.0 / length**2 + (np.pi * np.array([1.0, 2.0, 3.0])) ** 2)
            variance = float(scale) ** 2 * fall**2 / np.mean(fall**2)
            own = 0.5 * np.array(course) ** 2 * variance / (1.0 + variance) - 0.5 * np.log1p(variance)
            logs.append(float(own.sum()))
    expected = np.logaddexp.reduce(logs) - np.log(len(logs)) - 0.5 * left @ left
    assert linear.averaged[0] == pytest.approx(expected, abs=1e-9)
    alike = replace(linear, orders=None).averaged[0]
    assert (linear.averaged[0] > alike) == (course[1] == 0.0)
