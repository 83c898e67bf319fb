"""The log evidence of effects as they are linearised, against what it is in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import scenarios
from estimators.gap.data.basefit import estimated_floor, set_up
from estimators.gap.evidence.laplace import Linear
from estimators.gap.hypotheses.prior import LENGTHS, scales
from estimators.gap.hypotheses.shapes import shape_prior
from rig.arm import Arm
from rig.effects import EFFECTS


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


def test_effects_that_are_one_but_for_rounding_have_an_evidence_alone_as_among_others() -> None:
    rng = np.random.default_rng(3)
    tangent = 1e6 * rng.standard_normal((40, 1)) @ np.ones((1, 2))
    left, precision = rng.standard_normal(40), np.ones(2)
    linear = Linear(left, tangent, np.zeros(2), np.ones(2, dtype=bool), np.ones(2), np.arange(2))
    square, gram, moment = np.array(left @ left), linear.gram, tangent.T @ left
    alone = linear.log_evidence(square, gram, moment, precision)
    both = linear.log_evidence(np.stack([square] * 2), np.stack([gram] * 2), np.stack([moment] * 2), precision)
    assert np.isfinite(alone)
    assert both == pytest.approx(np.full(2, alone), rel=1e-12)


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
    for scale, weight in zip(*scales(np.sqrt(3.0)), strict=True):
        variance = float(scale) ** 2
        own = 0.5 * np.array(fault) ** 2 * variance / (1.0 + variance) - 0.5 * np.log1p(variance)
        logs += [weight + np.log(0.5) + own.sum(), *(weight + np.log(0.5 / 3.0) + own)]
    expected = np.logaddexp.reduce(logs) - 0.5 * left @ left
    allowed = 1e-6 * (float(scales(np.sqrt(3.0))[0][-1]) ** 2 + float(left @ left))
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
    for scale, weight in zip(*scales(np.sqrt(3.0)), strict=True):
        for length in LENGTHS:
            fall = 1.0 / (3.0 / length**2 + (np.pi * np.array([1.0, 2.0, 3.0])) ** 2)
            variance = float(scale) ** 2 * fall**2 / np.mean(fall**2)
            own = 0.5 * np.array(course) ** 2 * variance / (1.0 + variance) - 0.5 * np.log1p(variance)
            logs.append(weight - np.log(len(LENGTHS)) + float(own.sum()))
    expected = np.logaddexp.reduce(logs) - 0.5 * left @ left
    assert linear.averaged[0] == pytest.approx(expected, abs=1e-9)
    alike = replace(linear, orders=None).averaged[0]
    assert (linear.averaged[0] > alike) == (course[1] == 0.0)


def test_the_likeliest_precisions_are_those_of_the_course_that_is() -> None:
    """A first cosine a hundred times the second: a long memory, whose third has all but none."""
    tangent = np.linalg.qr(np.random.default_rng(3).standard_normal((40, 3)))[0]
    owner, there = np.zeros(3, dtype=np.intp), np.ones(3, dtype=bool)
    left = tangent @ np.array([30.0, 0.3, 0.0])
    linear = Linear(left, tangent, np.zeros(3), there, np.ones(3), owner, orders=np.array([1, 2, 3]))
    first, _, third = linear.likeliest
    assert third / first == pytest.approx(((3.0 / 0.25 + 9.0 * np.pi**2) / (3.0 / 0.25 + np.pi**2)) ** 2)


def test_scales_beyond_those_expected_are_as_much_less_likely_as_they_are_larger() -> None:
    """A strength of 1,000 typical sizes costs the logarithm of how far that is beyond 30, not its square."""
    scale, weight = scales(10.0, 1000.0)
    assert scale[0] == pytest.approx(0.5)
    assert scale[-1] > 1000.0 > scale[-2]
    np.testing.assert_allclose(np.diff(np.log(scale)), np.log(3.0))
    within = scale <= 30.0
    np.testing.assert_allclose(np.exp(weight[within] - weight[0]), 1.0)
    last = scale[within][-1]
    np.testing.assert_allclose(np.exp(weight[~within] - weight[0]), last / scale[~within])
    further = np.exp(weight[-1]) / (3.0 - 1.0)  # a geometric series from there on
    assert np.exp(weight).sum() + further == pytest.approx(1.0)
    np.testing.assert_array_equal(scales(10.0)[0], scale[within])


@pytest.mark.parametrize("strength", [25.0, 2500.0])
def test_a_strength_far_beyond_what_is_typical_is_no_worse_than_one_that_is(strength: float) -> None:
    """Felt with a signal-to-noise of one a typical size; fitted exactly: the evidence falls with its logarithm."""
    tangent = np.zeros((10, 1))
    tangent[0] = 1.0
    owner, there = np.zeros(1, dtype=np.intp), np.ones(1, dtype=bool)
    left = np.zeros(10)
    found = Linear(left, tangent, np.array([strength]), there, np.ones(1), owner).averaged[0]
    assert -0.5 * 9.0 - 2.0 * np.log(3.0 * strength) < found < -np.log(strength)


@pytest.mark.parametrize("effect", ["joint_eccentricity", "base_rocking"])
def test_a_phase_has_half_a_turn(effect: str, arm: Arm) -> None:
    """A strength has either sign: a density of one over pi, that of a normal number of this width at its middle."""
    run = scenarios.load("ann-arbor").with_acquisition(decimation=200).simulate(0)
    data = set_up(run, estimated_floor(run, arm), arm)
    (phase,) = [item for item in EFFECTS[effect].parameters() if item.name == "phase_rad"]
    where = EFFECTS[effect].places[0]
    away, width = shape_prior(EFFECTS[effect].from_mapping({"where": where}), phase, data)
    assert not away.any()
    np.testing.assert_allclose(np.sqrt(2.0 * np.pi) * width * phase.typical, np.pi)
