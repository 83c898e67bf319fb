"""Noise that all channels share, against what it says it is: its strength, and what it is beside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from whitened_examples import data, discrepancies, louder, noise_of, recorded, unexplained  # noqa: F401

import scenarios
from estimators.gap.data.basefit import learn_floor, set_up
from estimators.gap.data.projection import Columns, project
from estimators.gap.data.steps import Step
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.common import beside, beside_other, common_noises, is_common, weighed_with
from estimators.gap.evidence.discrepancy import Discrepancies, weighed
from estimators.gap.evidence.laplace import Linear
from estimators.gap.evidence.terms import Errors, blocks_term
from estimators.gap.hypotheses.sources import sources
from estimators.gap.search.posterior import explain
from rig.arm import Arm
from rig.effects import EFFECTS, make_effect
from rig.pose_nodes import quaternions


def with_poses(data: WhitenedData, arm: Arm) -> WhitenedData:
    run = recorded(1)
    tool = replace(run, q=None, tool_quaternion=quaternions(arm.poses(run.q).R_base_tool))  # type: ignore[arg-type]
    return set_up(tool, data.floor, None)


def test_the_strength_of_an_error_that_all_channels_share_is_found(data: WhitenedData, arm: Arm) -> None:
    """Of the floor's size, from sample to sample or for as long as the effect remembers. The grid of amplitudes tells a
    strength to 6 %, 249 errors and more to 5 %: .4 is five standard deviations."""
    rng = np.random.default_rng(0)
    tried = set()
    for each in (data, with_poses(data, arm)):
        for noise in common_noises(each, ()):
            (item,) = [one for one in noise.effect.parameters() if one.strength]
            tau_s = getattr(noise.effect, "tau_s", 0.0)
            duration_s = float(np.ptp(each.t))
            pieces = each.count if tau_s < each.interval_s else max(8, int(duration_s / (2.0 * tau_s)))
            edges = np.linspace(0, each.count, pieces, endpoint=False).astype(int)
            piece = np.searchsorted(edges, np.arange(each.count), "right")
            whitened = noise.response / np.sqrt([channel.variance for channel in each.floor])[:, None]
            size = 1.0 / np.sqrt(np.mean(whitened**2))
            errors = size * rng.standard_normal((pieces + 1, noise.response.shape[2]))[piece]
            left = np.einsum("ncr,nr->cn", whitened, errors)[each.columns]
            ((_, found),) = beside(unexplained((left + rng.standard_normal(left.shape)).ravel()), [noise])
            strength = getattr(found.effect, item.name)
            assert strength == pytest.approx(size, rel=0.4)
            assert found.std[0] < 0.15 * size
            tried.add(type(noise.effect).name)
    assert tried == {name for name, effect in EFFECTS.items() if is_common(effect)}


def test_what_an_error_does_to_means_is_what_it_does_to_their_readings(data: WhitenedData) -> None:
    """Jitter of single readings, averaged: the squares of 832 means and more, each a sum of two, to five standard
    deviations; and the slope at their middle to a hundredth."""
    jitter = make_effect("timing_jitter", {"where": "acquisition", "sigma_s": 1e-3})
    means = data.averaged(2).pointwise()
    (found,) = [each for each in common_noises(means, ()) if each.effect.name == "timing_jitter"]
    moved = jitter.apply(data.base, np.random.default_rng(4)).volts - data.base.volts
    added = moved[: 2 * means.count].reshape(means.count, 2, -1).mean(axis=1)
    promised = 1e-6 * found.response[:, :, 0] ** 2
    ratio = np.sum(added**2, axis=0) / np.sum(promised, axis=0)
    spread = np.sqrt(2.0 * np.sum(promised**2, axis=0)) / np.sum(promised, axis=0)
    assert np.all(np.abs(ratio - 1.0) < 5.0 * spread + 0.01)
    assert found.single == pytest.approx(2.0, rel=1e-9)


def test_the_strength_of_common_noise_is_found_beside_what_has_no_name(
    data: WhitenedData, discrepancies: Discrepancies
) -> None:
    """Jitter as large as the floor beside a moving magnet of a signal-to-noise of 60: the grid of amplitudes tells it
    to 6 %, 1664 errors to 2 %, of which the course of the magnet takes a tenth at most."""
    (jitter,) = [each for each in common_noises(data, ()) if each.effect.name == "timing_jitter"]
    rng = np.random.default_rng(3)
    whitened = jitter.response / np.sqrt([channel.variance for channel in data.floor])[:, None]
    size = 1.0 / np.sqrt(np.mean(whitened**2))
    off = np.einsum("ncr,nr->cn", whitened, size * rng.standard_normal((data.count, whitened.shape[2])))[data.columns]
    (field,) = [each for each in sources(data) if each.name == "the magnetic field"]
    wave = (field.series[0] * np.cos(7.3 * np.linspace(0.0, 1.0, data.count) ** 2)).ravel()
    left = off.ravel() + rng.standard_normal(data.size) + 60.0 * wave / np.linalg.norm(wave)
    linear = unexplained(project(data.absorbed, left))
    told = [each for each in weighed(linear, discrepancies) if each.term.edges is None]
    ((log_mass, found, both),) = beside_other(linear, [jitter], data.absorbed, told)
    assert log_mass > told[0].log_mass + 100.0
    assert [each.log_mass for each in both] == sorted((each.log_mass for each in both), reverse=True)
    assert (both[0].term.source, both[0].term.course) == (field.name, "time")
    assert found.effect.strengths == pytest.approx(size, rel=0.2)
    quiet = unexplained(project(data.absorbed, left - off.ravel()))
    assert beside_other(quiet, [jitter], data.absorbed, told) == []


def test_common_noise_is_as_much_smaller_as_other_noise_makes_the_whitened_readings(data: WhitenedData) -> None:
    """A magnetometer twenty times louder in the second half, and at all frequencies an accelerometer four times: jitter
    as large as the floor is told from what is left. 832 errors and more show it to 4 %, the grid to 6: .3 is four
    standard deviations."""
    later = np.where(np.arange(data.count) < data.count // 2, 1.0, 0.05)
    steps = [Step(column, later, True) for column in (3, 4, 5)]
    steps += [Step(column, np.full(data.count, 0.25), False) for column in (0, 1, 2)]
    under = data.stepped(steps)
    (jitter,) = [each for each in common_noises(under, ()) if each.effect.name == "timing_jitter"]
    rng = np.random.default_rng(6)
    whitened = jitter.response / np.sqrt([channel.variance for channel in data.floor])[:, None]
    size = 3.0 / np.sqrt(np.mean(whitened**2))
    off = np.einsum("ncr,nr->cn", whitened, size * rng.standard_normal((data.count, whitened.shape[2])))[data.columns]
    left = data.after(steps, Columns(off.reshape(-1, 1), 0)).values + rng.standard_normal((data.size, 1))
    ((_, found),) = beside(unexplained(left[:, 0]), [jitter])
    assert found.effect.strengths == pytest.approx(size, rel=0.3)


@pytest.mark.parametrize("causes", [0, 2])
def test_two_terms_at_once_are_one_covariance(data: WhitenedData, discrepancies: Discrepancies, causes: int) -> None:
    """The evidence beside a noise in pieces and a slow course is that of the sum of both covariances, written out."""
    rng = np.random.default_rng(5)
    clock = next(each for each in sources(data) if each.name == "the clock")
    errors, own = Errors.of([replace(clock, kind="noise")]), slice(0, len(clock.series))
    noise = blocks_term(errors, replace(clock, kind="noise"), own, 40, 0.0)
    other = next(each for each in discrepancies.terms if each.source == "the magnetic field" and each.course == "time")
    tangent = project(data.absorbed, rng.standard_normal((data.size, causes)))
    left = project(data.absorbed, 3.0 * rng.standard_normal(data.size))
    owner, there = np.arange(causes), np.ones(causes, dtype=bool)
    linear = Linear(left, tangent, np.zeros(causes), there, np.ones(causes), owner)
    found = weighed_with(linear, noise, other, data.absorbed, [0, 3, 7])
    assert np.isneginf(found[1]).all()
    precision = linear.likeliest
    alone = linear.log_evidence(left @ left, tangent.T @ tangent, tangent.T @ left, precision)
    columns = np.column_stack([left, tangent])
    each_noise = noise.made(np.eye(len(noise.values)))
    each_other = project(data.absorbed, other.made(np.eye(len(other.values))))
    for i, j in ((0, 0), (3, 5), (7, 2)):
        both = np.hstack([np.sqrt(noise.variances[i]) * each_noise, np.sqrt(other.variances[j]) * each_other])
        core = np.eye(both.shape[1]) + both.T @ both
        gram = columns.T @ columns - columns.T @ both @ np.linalg.solve(core, both.T @ columns)
        logs = linear.log_evidence(gram[0, 0], gram[1:, 1:], gram[1:, 0], precision)
        expected = float(logs - alone) - 0.5 * np.linalg.slogdet(core)[1]
        assert found[i, j] == pytest.approx(expected, abs=1e-6 * float(left @ left))


def test_a_floor_is_moved_beside_fewer_effects_too(arm: Arm) -> None:
    """Beside a warm-up that does what a floor does, the floor is as it was learned: each that is weighed beside what
    leads is weighed beside nothing, too."""
    jitter = ("timing_jitter", {"where": "acquisition", "sigma_s": 0.03})
    drift = ("bias_warmup", {"where": "magnetometer", "coefficient": (0.05, -0.05, 0.05), "tau_s": 300.0})
    run, rest = recorded(1, jitter, drift, decimation=200), scenarios.load("ann-arbor").simulate_locked(seed=1)
    rng = np.random.default_rng(2)
    walks = louder(rest, 0.003 * noise_of(rest) * np.cumsum(rng.standard_normal((len(rest.t), 6)), axis=0))
    data = set_up(run, learn_floor(walks, float(np.median(np.diff(run.t)))), arm)
    without = [name for name in EFFECTS if name not in (jitter[0], drift[0])]
    found = explain(data, without).hypotheses
    moved = {one.state.name: set[tuple[str, ...]]() for one in found if one.state.steps and not one.other}
    for one in found:
        if one.state.name in moved and "timing_jitter@acquisition" in one.labels:
            moved[one.state.name].add(one.explanation.key)
    assert moved
    assert all(() in sets for sets in moved.values()), moved
