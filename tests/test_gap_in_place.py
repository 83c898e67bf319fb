"""The calibration's freedom beside effects that are in place: it takes what it takes of what the sensors feel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from whitened_examples import data, recorded  # noqa: F401

from estimators.gap.data import tangent
from estimators.gap.data.basefit import estimated_floor, set_up
from estimators.gap.data.rebase import rebased
from estimators.gap.data.tangent import stepped
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.converge import converged
from estimators.gap.evidence.laplace import linearised
from estimators.gap.evidence.refine import Fitted, refit
from estimators.gap.hypotheses.candidates import all_candidates
from rig.arm import Arm
from rig.effects import make_effect

SLIP = ("mounting_slip", {"where": "mount", "rotation_rad": (-0.01, 0.02, 0.05), "at_s": 300.0})
SOFT = ("link_soft_iron", {"where": "link5", "chi": (0.02, 0.03, -0.01, 0.02, 0.03, -0.02)})
HARD = ("link_hard_iron", {"where": "link1", "field": (0.0, 0.02, 0.01)})
LATE = ("latency", {"where": "magnetometer", "delay_s": 0.3})
SLOW = ("sensor_lag", {"where": "magnetometer", "tau_s": 0.7})
BENT = ("scale_cubic", {"where": "mag2", "fraction_of_full": 0.02})
SUPPLY = ("supply_ratiometric", {"where": "supply", "waveform": (0.02, -0.01, 0.01, *(0.0,) * 21)})
LEVER = ("motion_acceleration", {"where": "accelerometer", "lever_m": (0.05, 0.02, 0.1)})


@pytest.mark.parametrize(
    "effects",
    [(), (SLIP, HARD, LEVER), (SLIP, SOFT), (LATE, SLOW, BENT), (SUPPLY, SLOW)],
    ids=["nothing", "slip, hard iron, lever", "slip, soft iron", "latency, lag, cubic", "supply, lag"],
)
def test_the_tangent_beside_effects_is_the_derivative_of_the_readings(
    data: WhitenedData,  # noqa: F811
    effects: tuple[tuple[str, dict[str, object]], ...],
) -> None:
    """By central differences, to their rounding of some volts over the step, and to a millionth, the tangent's step."""
    made = [make_effect(*each) for each in effects]
    beside = data.around(data.pipeline, made)
    found = beside.calibration
    every = tangent.size(list(found.values()))
    for number in range(every):
        step = np.zeros(every)
        step[number] = 1e-5
        ahead, behind = (
            replace(stepped(data.pipeline, sign * step), effects=tuple(made))
            .expected(data.base, np.random.default_rng(0))
            .volts
            for sign in (1.0, -1.0)
        )
        slope = (ahead - behind) / 2e-5
        for column, own in found.items():
            here = own.numbers.index(number) if number in own.numbers else None
            expected = np.zeros(len(slope)) if here is None else own.values[:, here]
            np.testing.assert_allclose(
                slope[:, column], expected, rtol=0.0, atol=(4e-6 if effects else 1e-8) * np.abs(slope).max() + 1e-9
            )
    step = np.random.default_rng(0).standard_normal(every)
    change = beside.recalibrated(step)
    for column, own in found.items():
        expected = own.values @ step[own.numbers]
        np.testing.assert_allclose(change[:, column], expected, rtol=0.0, atol=1e-5 * np.abs(expected).max())


def test_what_the_calibration_takes_is_not_told_beside_a_slip(arm: Arm) -> None:
    """A soft iron of link 5 that is alike all round joint 6's axis is a gain of two axes, whether the sensor has
    slipped since or not: what is told of it keeps more than three quarters of any prior. The slip's own angle is its,
    to five standard deviations."""
    slip: dict[str, object] = {"where": "mount", "rotation_rad": (-0.002, 0.002, 0.03), "at_s": 300.0}
    iron: dict[str, object] = {"where": "link5", "chi": (0.0, 0.0, 0.0, 0.0, 0.002, -0.0025)}
    run = recorded(0, ("mounting_slip", slip), ("link_soft_iron", iron))
    whitened = set_up(run, estimated_floor(run, arm), arm)
    candidates = {each.label: each for each in all_candidates(whitened)}
    start = [
        Fitted(candidates["mounting_slip@mount"], np.array([0.0, 0.0, 0.02]), {"at_s": 300.0}),
        Fitted(candidates["link_soft_iron@link5"], np.array([0.0, 0.0, 0.0, 0.0, 0.001, -0.001]), {}),
    ]
    found = converged(start, whitened)
    assert found.data.in_place
    linear = linearised(found)
    prior = 10.0  # typical sizes
    covariance = np.linalg.inv(linear.gram + np.eye(len(linear.gram)) / prior**2)
    alike = np.zeros(len(covariance))
    alike[3:5] = np.sqrt(0.5)
    assert alike @ covariance @ alike > (0.75 * prior) ** 2
    turned, std = found.fits[0].values[2], 1e-3 * np.sqrt(covariance[2, 2])
    assert abs(turned - 0.03) < 5.0 * std < 0.005


def test_what_nothing_feels_goes_back_to_nothing(arm: Arm) -> None:
    """A soft iron that is alike all round is a gain, beside a slow sensor too: half the field of it, where a fit may
    have left it, goes back to less than what is typical; what it does to one direction alone stays what is told."""
    slow: dict[str, object] = {"where": "magnetometer", "tau_s": 0.7}
    iron: dict[str, object] = {"where": "link5", "chi": (0.0, 0.0, 0.0, 0.004, 0.002, -0.0025)}
    run = recorded(0, ("sensor_lag", slow), ("link_soft_iron", iron))
    whitened = set_up(run, estimated_floor(run, arm), arm)
    beside = whitened.around(whitened.pipeline, [make_effect("sensor_lag", slow)])
    candidates = {each.label: each for each in all_candidates(whitened)}
    start = [
        Fitted(candidates["sensor_lag@magnetometer"], np.array([0.7]), {}),
        Fitted(candidates["link_soft_iron@link5"], np.array([0.5, 0.5, 0.5, 0.0, 0.0, 0.0]), {}),
    ]
    found = refit(start, beside)
    chi = found.fits[1].values
    assert abs(chi[:3].mean()) < found.fits[1].scale[0]
    linear = linearised(found)
    std = found.fits[1].scale[3] * np.sqrt(np.linalg.inv(linear.gram + 1e-4 * np.eye(len(linear.gram)))[4, 4])
    assert abs(chi[3] - 0.004) < 5.0 * std < 0.004


def test_a_step_keeps_a_sensitivity_of_any_unit_and_its_sign(data: WhitenedData) -> None:  # noqa: F811
    """A field in nT that is read in T has 1e-9: no step leaves it as it is, and one beyond nothing stays above that."""
    assert data.pipeline.magnetometer is not None
    x, y, z = (1e-12 * each for each in data.pipeline.magnetometer.sensitivity)
    small = (x, y, z)
    pipeline = replace(data.pipeline, magnetometer=replace(data.pipeline.magnetometer, sensitivity=small))
    found = tangent.of_readings(data.base, pipeline)
    nothing = np.zeros(tangent.size(list(found.values())))
    kept = tangent.stepped(pipeline, nothing).magnetometer
    assert kept is not None
    assert kept.sensitivity == pytest.approx(small, rel=1e-12, abs=0.0)
    beyond = nothing.copy()
    beyond[found[3].numbers[0]] = -2.0 * small[0]
    less = tangent.stepped(pipeline, beyond).magnetometer
    assert less is not None
    assert 0.0 < less.sensitivity[0] < small[0]


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("link", ["link1", "link3"])
def test_what_a_set_is_said_to_leave_was_attained(seed: int, link: str, arm: Arm) -> None:
    """Soft iron in the place of a strong hard iron doubles the field, and halves the gains: beyond the calibration's
    tangent, which promised two fifths of what is left. Around the calibration that fits best beside it, to one."""
    run = recorded(seed, ("link_hard_iron", {"where": "link2", "field": (0.3, -0.15, 0.1)}))
    whitened = set_up(run, estimated_floor(run, arm), arm)
    (candidate,) = [each for each in all_candidates(whitened) if each.label == f"link_soft_iron@{link}"]
    found = converged([Fitted(candidate, np.full(6, 1e-3), {})], whitened)
    effects = [fit.effect for fit in found.fits]
    there = rebased(found.data, effects)
    left = there.whiten(there.residual - there.change(effects))
    assert abs(found.misfit + found.short - float(left @ left)) < 1.0
    assert found.misfit < 0.1 * float(whitened.whitened @ whitened.whitened)


@pytest.mark.parametrize("seed", range(2))
def test_a_fit_that_does_not_get_there_is_charged_with_what_it_attained(seed: int, arm: Arm) -> None:
    """Soft iron of another link, which is far from what a strong hard iron does: fitted again from there it leaves no
    more, and what its effects leave around the best calibration beside them is what it is charged with, to a tenth."""
    run = recorded(seed, ("link_hard_iron", {"where": "link2", "field": (0.6, -0.3, 0.2)}))
    whitened = set_up(run, estimated_floor(run, arm), arm)
    (candidate,) = [each for each in all_candidates(whitened) if each.label == "link_soft_iron@link5"]
    found = converged([Fitted(candidate, np.full(6, 1e-3), {})], whitened)
    effects = [fit.effect for fit in found.fits]
    around = found.data.around(found.data.pipeline, effects)
    left = around.whiten(around.residual - around.change(effects))
    assert found.short > 1.0
    assert found.attained == pytest.approx(float(left @ left), rel=0.1)
    assert converged(found.fits, found.data).attained < 1.001 * found.attained
