"""The diagnosis: quiet recordings are quiet, single causes are named, and what the catalogue lacks is unknown.

Strengths are five times what an explanation needs, so that a failure is a fault and not bad luck.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosed_recordings import scenario as small
from scipy.spatial.transform import Rotation

import estimators
import scenarios
from estimators.gap.data.projection import Basis, Columns, project
from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.gap.floor.colour import fit_floor, held
from estimators.gap.hypotheses.prior import Prior
from estimators.gap.hypotheses.same_places import alike
from estimators.gap.hypotheses.score import Explained, evidence
from estimators.gap.report.by_channel import MAY_BE_FLOOR
from rig.arm import Arm
from rig.effects import EFFECTS, make_effect
from rig.errors import RefusedFit, RigError
from rig.maneuver import LockedPoses
from rig.recording import Recording

SHARED = Path(__file__).parents[1].parent / "shared" / "practice"

CAUSES = {
    "backlash": {"where": "joint5", "width_rad": 0.0085},
    "joint_scale": {"where": "joint1", "scale": 0.0056},
    "field_gradient": {"where": "base", "gradient_per_m": (0.028, -0.014, 0.014, 0.028, 0.0)},
    "scale_cubic": {"where": "mag2", "fraction_of_full": -0.028},
    "channel_crosstalk": {"where": "mag1", "source": "accel3", "coefficient": 0.021},
    "bias_warmup": {"where": "magnetometer", "coefficient": (0.028, -0.014, 0.042), "tau_s": 240.0},
    "noise_coloured": {"where": "magnetometer", "sigma_V": (0.005, 0.005, 0.006), "tau_s": 2.0},
    "dropouts": {"where": "acquisition", "share": 0.006},
}

STEPS = ((0.03, 400.0), (-0.02, 900.0))


def recorded(seed: int, *effects: tuple[str, dict[str, object]]) -> Recording:
    """832 samples of the paper's sweep."""
    scenario = scenarios.load("ann-arbor").with_effects([make_effect(name, values) for name, values in effects])
    return scenario.with_acquisition(decimation=200).simulate(seed=seed)


@pytest.fixture(scope="module")
def locked() -> Recording:
    rig = scenarios.load("ann-arbor").with_acquisition(decimation=1).rig
    return rig.simulate(LockedPoses(hold_s=100.0, rate_Hz=20.0), np.random.default_rng(7))


def test_a_quiet_recording_has_no_gap(locked: Recording) -> None:
    found = estimators.diagnose(recorded(1), locked=locked)
    assert found.verdict == "no-gap"
    assert found.causes == ()
    told = {(each["effect"], each["where"]) for each in found.cannot_tell}
    assert {("joint_offset", "joint1"), ("joint_offset", "joint6"), ("backlash", "joint6")} <= told


def test_an_effect_that_is_there_twice_is_told_of_twice(locked: Recording) -> None:
    """Steps of accel2, each alone of a signal-to-noise above 20: an instant is known to a few samples of 2 s."""
    steps = [("bias_step", {"where": "accel2", "volts": volts, "at_s": at_s}) for volts, at_s in STEPS]
    found = estimators.diagnose(recorded(2, *steps), locked=locked)
    told = sorted(found.causes, key=lambda cause: cause.parameters["at_s"].value)
    assert [(cause.effect, cause.where) for cause in told] == [("bias_step", "accel2")] * 2
    for cause, (volts, at_s) in zip(told, STEPS, strict=True):
        assert cause.probability > 0.95
        assert abs(cause.parameters["volts"].value - volts) < 5.0 * cause.parameters["volts"].std
        assert abs(cause.parameters["at_s"].value - at_s) < 60.0


def test_a_floor_that_goes_on_slower_than_poses_at_rest_show_is_no_gap() -> None:
    """1/f over two decades, of which half a second at rest shows one; 19 of 20 draws were quiet."""
    times = (0.1, 0.4, 2.0, 10.0)
    noise = [
        make_effect("noise_coloured", {"where": where, "tau_s": tau_s, "sigma_V": (4e-3,) * 3})
        for where in ("accelerometer", "magnetometer")
        for tau_s in times
    ]
    scenario = small().with_effects(noise)
    found = estimators.diagnose(scenario.simulate(0), scenario.simulate_locked(0))
    assert found.verdict == "no-gap"


@pytest.mark.parametrize("there", [True, False])
def test_what_was_found_is_tried_on_a_second_maneuver(there: bool, locked: Recording) -> None:
    """A cause of a signal-to-noise of 100: of what it closes there all but a hundredth, or it makes a gap as large."""
    cause = ("joint_scale", {"where": "joint1", "scale": 0.056})
    first, second = recorded(2, cause), recorded(3, *[cause] * there)
    found = estimators.diagnose(first, locked=locked, maneuver2=second)
    assert found.closed_on == "both"
    assert found.closed_elsewhere == pytest.approx(1.0 if there else -1.0, abs=0.05)
    assert ("it makes the gap larger: it is not there" in found.sentence()) == (not there)


@pytest.mark.parametrize("name", CAUSES)
def test_a_single_cause_is_named_with_its_size(name: str, locked: Recording) -> None:
    values = CAUSES[name]
    found = estimators.diagnose(recorded(2, (name, values)), locked=locked)
    assert found.verdict == "named", found.sentence()
    (cause,) = found.established
    assert (cause.effect, cause.where) == (name, values["where"])
    assert found.remainder.verdict == "noise"
    assert found.closed.value is not None
    assert found.closed.value > 0.95
    for parameter, truth in values.items():
        estimate = cause.parameters.get(parameter)
        if estimate is None or estimate.std is None or isinstance(truth, str):
            continue
        errors = (np.asarray(estimate.value) - np.asarray(truth)) / np.asarray(estimate.std)
        assert np.all(np.abs(errors) < 5.0), (parameter, estimate)  # 5 sigma: false once in a million
    json.dumps(found.to_json(), allow_nan=False)


def test_two_causes_are_both_named(locked: Recording) -> None:
    effects = [("backlash", CAUSES["backlash"]), ("scale_cubic", CAUSES["scale_cubic"])]
    found = estimators.diagnose(recorded(3, *effects), locked=locked)
    assert set(found.hypotheses[0].causes) == {("backlash", "joint5"), ("scale_cubic", "mag2")}
    assert {(cause.effect, cause.where) for cause in found.established} == set(found.hypotheses[0].causes)
    assert found.verdict in ("named", "ambiguous")  # a third that noise suggests may have a tenth


@pytest.mark.parametrize("name", ["scale_cubic", "channel_crosstalk", "backlash"])
def test_what_the_catalogue_lacks_is_unknown(name: str, locked: Recording) -> None:
    found = estimators.diagnose(recorded(4, (name, CAUSES[name])), locked=locked, without=[name])
    assert found.posterior["other"] > 0.5, found.sentence()


def test_twins_are_one_explanation_and_the_moving_joint_comes_first(locked: Recording) -> None:
    found = estimators.diagnose(recorded(5, ("joint_offset", {"where": "joint5", "offset_rad": 0.007})), locked=locked)
    assert found.posterior["known"] > 0.9
    cause = found.causes[0]
    assert (cause.effect, cause.where) == ("joint_offset", "joint5")
    assert ("joint_offset", "joint2") in {(each["effect"], each["where"]) for each in cause.equivalent}
    assert sum(each["probability"] for each in cause.equivalent) < cause.probability


def test_of_places_that_do_the_same_the_likeliest_is_fitted() -> None:
    """What is stated is the size of the one that is named, whichever was scored first."""
    labels = ("joint_offset@joint2", "joint_offset@joint6")
    of_effect = {"effect": EFFECTS["joint_offset"]}
    tests = [SimpleNamespace(candidate=SimpleNamespace(label=label, **of_effect)) for label in labels]
    for each in tests:
        each.score = SimpleNamespace(statistic=9.0)
    (group,) = alike(tests, Prior({"joint_offset": dict(zip(labels, (0.2, 1.0), strict=True))}))  # type: ignore[arg-type]
    assert group == tests[::-1]


def test_without_a_locked_recording_the_floor_is_marked_as_estimated() -> None:
    found = estimators.diagnose(recorded(6))
    assert found.verdict == "no-gap"
    assert "estimated" in found.floor


def test_what_no_diagnosis_can_come_of_is_refused(locked: Recording) -> None:
    run = recorded(7)
    with pytest.raises(RigError, match="at least 200"):
        estimators.diagnose(run.select(slice(0, 50)), locked=locked)
    flat = np.array(run.accelerometer)
    flat[:, 1] = 2.5
    with pytest.raises(RefusedFit, match="accelerometer axis 2"):
        estimators.diagnose(replace(run, accelerometer=flat), locked=locked)
    with pytest.raises(RigError, match=r"unknown effect 'backlsh'.*nearest: 'backlash'"):
        estimators.diagnose(run, locked=locked, without=["backlsh"])


def test_the_whitener_whitens() -> None:
    noise = ChannelNoise(1.0, ((2.0, 1.5),))
    rng = np.random.default_rng(11)
    count, step = 200_000, 0.25
    decay = np.exp(-step / noise.parts[0][1])
    drive = rng.standard_normal(count) * np.sqrt(noise.coloured * (1 - decay**2))
    slow = np.zeros(count)
    for index in range(1, count):
        slow[index] = decay * slow[index - 1] + drive[index]
    white = noise.whitener(step)(slow + np.sqrt(noise.white) * rng.standard_normal(count))[100:]
    lags = [float(np.mean(white[:-lag] * white[lag:])) for lag in (1, 2, 5)]
    # standard error of a correlation 1 / sqrt(n): 5 of them fail once in 600,000 runs
    assert np.all(np.abs(lags) < 5.0 / np.sqrt(count))
    assert abs(white.var() - 1.0) < 5.0 * np.sqrt(2.0 / count)


def test_the_floor_is_white_where_it_is_white_and_coloured_where_it_is_not() -> None:
    rng = np.random.default_rng(12)
    white = held([rng.standard_normal(2000) for _ in range(3)], 0.05)
    decay = np.exp(-0.05)
    steps = rng.standard_normal((3, 2000)) * np.sqrt(1 - decay**2)
    slow = np.zeros_like(steps)
    for index in range(1, 2000):
        slow[:, index] = decay * slow[:, index - 1] + steps[:, index]
    both = held(list(slow + rng.standard_normal(slow.shape)), 0.05)
    found = fit_floor([white, both], ["one board", "another"])
    assert found[0].coloured == 0.0
    assert found[1].coloured > 0.0
    _, tau_s = max(found[1].parts)
    assert 0.4 < tau_s < 2.5  # three segments of 100 correlation times: a factor of 2.5 is 5 sigma
    # on one board what does not show may still be there: a part as slow has 40 times the white spectrum at its slowest,
    # which 300 correlation times tell to 8 %: more than .01 of the variance would have shown, five times that is asked
    beside, _ = fit_floor([white, both])
    assert 0.0 < beside.coloured < 0.05


def test_poses_of_two_samples_tell_how_loud_the_noise_is() -> None:
    """They have no frequencies; the variance of 400 differences is known to 1 / sqrt(200), five of which are 35 %."""
    pairs = 0.02 * np.random.default_rng(0).standard_normal((400, 2))
    (found,) = fit_floor([held(list(pairs), 0.1)])
    assert abs(found.variance / 0.02**2 - 1.0) < 0.35


def test_the_score_is_the_projected_chi_square() -> None:
    rng = np.random.default_rng(13)
    basis = np.linalg.qr(rng.standard_normal((500, 4)))[0]
    columns = rng.standard_normal((500, 3))
    residual = project(basis, rng.standard_normal(500))
    score = Explained(Basis(((slice(0, 500), basis),), 500), residual).score(Columns(columns, 0))
    left = project(basis, columns)
    fitted = left @ np.linalg.lstsq(left, residual, rcond=None)[0]
    assert score.rank == 3
    assert score.statistic == pytest.approx(fitted @ fitted, rel=1e-9)
    assert evidence(score.rank, score.rank) == 0.0


@pytest.mark.skipif(not SHARED.is_dir(), reason="the practice recordings are not here")
@pytest.mark.parametrize("case", ["case006", "case014", "case034", "case046"])
def test_practice_recordings(case: str) -> None:
    truth = json.loads((SHARED / "truth.json").read_text())[case]
    found = estimators.diagnose(SHARED / f"{case}.parquet")
    wanted = {(effect["name"], effect["where"]) for effect in truth["effects"]}
    same = [
        {(cause.effect, cause.where), *((each["effect"], each["where"]) for each in cause.equivalent)}
        for cause in found.causes
    ]
    assert all(any(each in places for places in same) for each in wanted)
    assert found.verdict != "no-gap" or not wanted


def test_causes_are_searched_beside_a_clock_that_jitters() -> None:
    """Jitter of hundreds of times the floor, beside play of a signal-to-noise of a hundred: found without it, sets of
    effects do a part of what it does, and stay. In four draws of four nothing else was certain."""
    few = [name for name in EFFECTS if name not in ("hysteresis", "timing_jitter", "joint_scale", "supply_ratiometric")]
    play = make_effect("hysteresis", {"where": "mag1", "half_width": 0.03})
    jitter = make_effect("timing_jitter", {"where": "acquisition", "sigma_s": 0.03})
    for seed in range(4):
        rig = small().with_effects((play, jitter))
        found = estimators.diagnose(rig.simulate(seed), locked=small().simulate_locked(seed), without=few)
        assert {(cause.effect, cause.where) for cause in found.causes if cause.probability >= 0.95} == {
            ("hysteresis", "mag1"),
            ("timing_jitter", "acquisition"),
        }


def test_noise_that_may_be_the_floor_is_said_not_to_be_told() -> None:
    few = [name for name in EFFECTS if name not in ("noise_coloured", "noise_excess", "timing_jitter", "joint_scale")]
    rig = small()
    for rest, expected in ((None, {"noise_coloured", "noise_excess"}), (rig.simulate_locked(0), set())):
        found = estimators.diagnose(rig.simulate(0), locked=rest, without=few)
        assert {each["effect"] for each in found.cannot_tell if each["why"] == MAY_BE_FLOOR} == expected


def test_what_lacks_joint_angles_is_not_told_at_any_joint(arm: Arm) -> None:
    """A log of the tool's poses says nothing of joints and links: no effect of theirs was looked for."""
    few = [name for name in EFFECTS if name not in ("backlash", "link_hard_iron", "sensor_lag")]
    run = small().simulate(0)
    turns = Rotation.from_matrix(run.rotations(arm).reshape(-1, 3, 3)).as_quat(scalar_first=True)
    posed = replace(run, q=None, tool_quaternion=turns)
    found = estimators.diagnose(posed, without=few)
    assert {(each["effect"], each["where"]) for each in found.cannot_tell} >= {
        ("backlash", "joints"),
        ("link_hard_iron", "links"),
    }
