"""What to do next where a recording cannot split its causes: shown to work by doing it.

The promised chi-square has a 95 % interval; here it is stretched to 4.5 standard deviations, which noise leaves with
a probability of 7e-6 a pair.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arm_files import written
from cli_support import SMALL, Rig
from diagnosed_recordings import by_hand, cause

import estimators
import scenarios
from estimators.gap.data.basefit import set_up
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.diagnosis import Cause, Diagnosis
from estimators.gap.evidence.refine import refit
from estimators.gap.report.separation import Explanation, contest, rivals
from rig.arm import Arm
from rig.arm.clearance import Clearance
from rig.effects import EFFECTS, Effect, make_effect
from rig.maneuver import StaticPoses, TorusSweep
from rig.recording import Recording
from scenarios.diagnosing.improved_rig import improved_rig
from scenarios.gap_report import gap_residuals
from scenarios.gap_report.gap_residuals import GapResiduals
from scenarios.gap_report.maneuver_words import described
from scenarios.loader import from_toml
from scenarios.plan.closest_maneuver import closest_maneuver
from scenarios.plan.maneuver_family import Family, family
from scenarios.plan.next_maneuver import NextManeuver, Search, _lasting, next_maneuver, next_step
from scenarios.plan.undecided import identical_pairs, undecided_words
from scenarios.scenario import Scenario

#: 4.5 standard deviations over the 1.96 of the interval.
STRETCH = 4.5 / 1.96

OFFSET = {"where": "joint4", "offset_rad": 0.02}
TWIST = {"effect": "axis_misalignment", "where": "joint1", "probability": 0.5}


def recorded(effect: Effect) -> tuple[Scenario, Recording, Recording]:
    scenario = from_toml(SMALL, "small.toml").with_effects([effect])
    return scenario, scenario.simulate(0), scenario.simulate_locked(0)


def proposed(
    diagnosis: Diagnosis, run: Recording, locked: Recording
) -> tuple[GapResiduals, Scenario, NextManeuver | None]:
    residuals = gap_residuals(run, diagnosis, locked)
    rig = improved_rig(diagnosis, residuals, locked).scenario
    return residuals, rig, next_maneuver(diagnosis, residuals, rig)


def measured(data: WhitenedData, truth: Explanation, rival: Explanation) -> float:
    """The chi-square by which the rival fits a recording worse than the truth, both refitted to it."""
    mine, others = (refit(each.fits, data).explained.residual for each in (truth, rival))
    return float(others @ others - mine @ mine)


def test_the_next_maneuver_splits_twins_as_it_promises() -> None:
    """An offset of joint 4 and a twist of joint 1's axis are one and the same while joints 2 to 4 are locked."""
    truth = make_effect("joint_offset", OFFSET)
    scenario, run, locked = recorded(truth)
    named = cause("joint_offset", "joint4", (TWIST,), offset_rad=(0.02, 1e-3, "rad"))
    residuals, calibrated, found = proposed(by_hand(causes=(named,)), run, locked)
    assert found is not None
    assert max(found.recorded) < 0.1
    made = from_toml(found.to_toml(calibrated), "next.toml")
    again = replace(scenario, maneuver=made.maneuver).simulate(1)
    assert again.duration_s <= run.duration_s + 0.1
    data = set_up(again, residuals.floor, Arm.a465())
    right, wrong = contest(residuals.data, by_hand(causes=(named,)))
    assert [(effect.name, effect.where) for effect in wrong.effects] == [(TWIST["effect"], TWIST["where"])]
    worse = measured(data, right, wrong)
    promise = next(pair for pair in found.separations if pair.truth[0].name == "joint_offset")
    middle, half = 0.5 * (promise.high + promise.low), 0.5 * (promise.high - promise.low)
    assert abs(worse - middle) < STRETCH * half
    assert worse > 25.0


def test_what_no_maneuver_can_split_is_said() -> None:
    """The axes of joints 2 and 3 are parallel at every pose: their offsets are one. Joint 5's is another."""
    _, run, locked = recorded(make_effect("joint_offset", {"where": "joint5", "offset_rad": 0.03}))
    named = cause("joint_offset", "joint5", offset_rad=(0.03, 1e-3, "rad"))
    others = tuple((("joint_offset", where),) for where in ("joint2", "joint3"))
    _, _, found = proposed(by_hand("ambiguous", (named,), rivals=others), run, locked)
    assert found is not None
    (pair,) = found.alike
    assert {effect.where for one in pair for effect in one} == {"joint2", "joint3"}
    split = {(each.truth[0].where, each.rival[0].where) for each in found.separations}
    assert split == {("joint5", "joint2"), ("joint5", "joint3"), ("joint2", "joint5"), ("joint3", "joint5")}
    assert "No maneuver tried separates" in found.why


def advised(truth: Effect, *sets: tuple[Cause, ...]) -> str:
    """What is said to do next of a recording of an effect, where these sets are as likely."""
    _, run, locked = recorded(truth)
    others = tuple(tuple((each.effect, each.where) for each in one) for one in sets[1:])
    diagnosis = by_hand("ambiguous", sets[0], rivals=others)
    words, scenario = next_step(diagnosis, gap_residuals(run, diagnosis, locked), None)
    assert scenario is None
    assert "maneuver" not in words
    return str(words["why"])


def test_twins_of_every_pose_are_said_to_be_that() -> None:
    """The axes of joints 2 and 3 are parallel at every pose; more time would not help."""
    truth = make_effect("joint_offset", {"where": "joint2", "offset_rad": 0.03})
    named = [(cause("joint_offset", where, offset_rad=(0.03, 1e-3, "rad")),) for where in ("joint2", "joint3")]
    words = advised(truth, *named)
    assert words.startswith(
        "No maneuver of this arm tells these apart, which do the same to the readings in every pose"
    )
    assert "(the axes of joint2 and joint3 are parallel in every pose)" in words
    assert "--minutes" not in words


def test_only_what_is_the_same_in_every_pose_is_called_so() -> None:
    _, run, locked = recorded(make_effect("joint_offset", {"where": "joint2", "offset_rad": 0.03}))
    named = cause("joint_offset", "joint2", offset_rad=(0.03, 1e-3, "rad"))
    sets = ("joint3", "joint4", "joint5")
    diagnosis = by_hand("ambiguous", (named,), rivals=tuple((("joint_offset", where),) for where in sets))
    residuals = gap_residuals(run, diagnosis, locked)
    group = contest(residuals.data, diagnosis)
    assert len(group) == 4
    arm = residuals.data.base.arm
    assert arm is not None
    (pair,) = identical_pairs(residuals, arm, group)
    assert [effect.where for one in pair for effect in one] == ["joint2", "joint3"]
    words = undecided_words(residuals, diagnosis)
    assert "joint 2" in words
    assert "Of the others: no maneuver that was tried" in words


def test_a_set_within_another_is_not_called_its_twin() -> None:
    effects = [make_effect("joint_offset", {"where": where, "offset_rad": 0.03}) for where in ("joint4", "joint5")]
    run, locked = from_toml(SMALL, "small.toml").with_effects(effects).simulate(0), recorded(effects[0])[2]
    both = tuple(cause("joint_offset", where, offset_rad=(0.03, 1e-3, "rad")) for where in ("joint4", "joint5"))
    diagnosis = by_hand("ambiguous", both, rivals=((("joint_offset", "joint4"),),))
    residuals = gap_residuals(run, diagnosis, locked)
    assert residuals.data.base.arm is not None
    assert not identical_pairs(residuals, residuals.data.base.arm, contest(residuals.data, diagnosis))


@pytest.mark.parametrize(
    ("other", "words"), [("joint3", "No maneuver of this arm"), ("joint5", "No maneuver is proposed")]
)
def test_what_all_explanations_have_hides_no_twins(other: str, words: str) -> None:
    """The arm's own acceleration depends on the motion, so that no maneuver is tried; the offsets do not."""
    lever = cause("motion_acceleration", "accelerometer", lever_m=((0.1, 0.0, 0.0), (1e-3,) * 3, "m"))
    offsets = [cause("joint_offset", where, offset_rad=(0.03, 1e-3, "rad")) for where in ("joint2", other)]
    truth = make_effect("joint_offset", {"where": "joint2", "offset_rad": 0.03})
    assert advised(truth, *[(each, lever) for each in offsets]).startswith(words)


def test_sets_are_told_apart_and_a_smaller_one_only_as_the_wrong_one() -> None:
    """A set with one more cause than the truth never fits worse: the pair is asked in one direction."""
    effects = [
        make_effect("joint_scale", {"where": "joint1", "scale": 0.01}),
        make_effect("backlash", {"where": "joint5", "width_rad": 0.05}),
    ]
    scenario = from_toml(SMALL, "small.toml").with_effects(effects)
    run, locked = scenario.simulate(0), scenario.simulate_locked(0)
    causes = (
        cause("backlash", "joint5", width_rad=(0.05, 4e-4, "rad")),
        cause("joint_scale", "joint1", probability=0.6, scale=(0.01, 1e-3, "relative")),
    )
    smaller = (("backlash", "joint5"),)
    diagnosis = by_hand("ambiguous", causes, rivals=(smaller,))
    assert rivals(diagnosis) == ((("backlash", "joint5"), ("joint_scale", "joint1")), smaller)
    _, _, found = proposed(diagnosis, run, locked)
    assert found is not None
    (pair,) = found.separations
    assert [len(pair.truth), len(pair.rival)] == [2, 1]
    assert found.why.startswith(
        "If “backlash of joint 5 and joint scale of joint 1” is true, “backlash of joint 5” fits"
    )


def test_a_board_that_warms_as_its_bias_does_is_recorded_in_another_room() -> None:
    """A bias that follows the temperature and one that follows the time since the start are one in every maneuver."""
    coefficient = (3e-3, -3e-3, 3e-3)
    truth = make_effect("bias_temperature", {"where": "accelerometer", "coefficient_per_degC": coefficient})
    scenario = from_toml(SMALL, "small.toml").with_effects([truth])
    environment = replace(scenario.rig.environment, temperature_rise_degC=20.0, temperature_tau_s=30.0)
    scenario = replace(scenario, rig=replace(scenario.rig, environment=environment))
    run, locked = scenario.simulate(0), scenario.simulate_locked(0)
    values = {"coefficient_per_degC": (coefficient, (1e-4,) * 3, "V/degC")}
    named = cause("bias_temperature", "accelerometer", **values)
    rising = (("bias_warmup", "accelerometer"),)
    _, calibrated, found = proposed(by_hand("ambiguous", (named,), rivals=(rising,)), run, locked)
    assert found is not None
    assert found.warmer_degC > 0.0
    assert max(found.recorded) < 1.0
    made = from_toml(found.to_toml(calibrated), "next.toml")
    warmer = made.rig.environment.temperature_degC
    assert warmer == calibrated.rig.environment.temperature_degC + found.warmer_degC
    room = replace(environment, temperature_degC=environment.temperature_degC + found.warmer_degC)
    again = replace(replace(scenario, rig=replace(scenario.rig, environment=room)).simulate(1), name="warmer")
    without = [name for name in EFFECTS if name not in ("bias_temperature", "bias_warmup")]
    told = estimators.diagnose([run, again], [locked, locked], without=without)
    assert [each.effect for each in told.leading] == ["bias_temperature"]
    assert told.posterior["nothing"] < 1e-6


def test_a_room_is_not_praised_for_what_more_readings_tell(monkeypatch: pytest.MonkeyPatch) -> None:
    search = object.__new__(Search)
    monkeypatch.setattr(search, "_warm", True, raising=False)
    monkeypatch.setattr(search, "_calibrates", lambda _: True)
    monkeypatch.setattr(search, "_table", lambda _, rooms=(0.0,): np.array([20.0 * len(rooms)]))
    assert search.in_another_room(StaticPoses()) is None


def test_where_a_recording_decides_nothing_is_contested() -> None:
    assert rivals(by_hand()) == ()
    assert rivals(by_hand("no-gap", ())) == ()
    assert rivals(by_hand("unknown")) == ()


def test_a_maneuver_of_the_family_keeps_within_limits_and_clear_of_the_table() -> None:
    sweep = TorusSweep(duration_s=600.0, rate_Hz=4.0)
    motion = sweep.trajectory()
    room = Family.of(Arm.a465(), motion.t, motion.q)
    assert room.rolls
    allowed = [each for each in family(room, sweep) if room.allows(each)]
    assert len({each.joints for each in allowed if isinstance(each, TorusSweep)}) > 5
    assert any(isinstance(each, StaticPoses) for each in allowed)
    nearer = Clearance.of(Arm.a465(), margin_m=0.0)  # between the instants that were looked at
    for each in allowed:
        path = each.trajectory(np.linspace(0.0, each.duration_s, 333))
        Arm.a465().check_limits(path.q, "the maneuver")
        assert not nearer.touching(path.q).any()
        assert each.duration_s <= sweep.duration_s + 1e-6
        assert f"{each.duration_s / 60.0:.3g} minutes" in described(each)


def test_a_joint_that_slides_stops_where_it_did_in_another_time(tmp_path: Path) -> None:
    arm = Arm.from_file(written(tmp_path, "scara"))
    poses = ((10.0, 20.0, 0.05, 30.0), (40.0, -20.0, 0.12, 60.0))
    played = StaticPoses(poses_deg=poses, limits_deg=None, slides=(3,))
    longer = _lasting(played, 2.0 * played.duration_s, arm)
    assert isinstance(longer, StaticPoses)
    np.testing.assert_allclose(longer.poses_deg or (), 2 * poses, rtol=1e-14)


def test_the_command_writes_a_scenario_that_runs(rig: Rig, here: Path) -> None:
    _, run, locked = recorded(make_effect("joint_offset", OFFSET))
    run.write("run.parquet")
    locked.write("run.locked.parquet")
    text = rig.done("diagnose", "run.parquet", "--out", "o", "--minutes", "0.5")
    assert "o/run.next.toml: written" in text
    found = json.loads(Path("o/run.diagnosis.json").read_text())
    assert found["verdict"] == "named"  # either, which do the same
    assert found["next"]["scenario"] == "run.next.toml"
    assert found["next"]["minutes"] <= 0.5
    assert found["next"]["separates"]
    assert "What to do next" in Path("o/run.html").read_text()
    assert scenarios.load("o/run.next.toml").maneuver.duration_s <= 30.0
    rig.done("sweep", "o/run.next.toml", "-o", "again.parquet")
    assert "--minutes" in rig.refused("diagnose", "run.parquet", "--minutes", "0")


@pytest.mark.parametrize("name", ["a465", "ur5e", "iiwa"])
def test_what_may_be_proposed_can_be_made_and_calibrated(name: str, tmp_path: Path) -> None:
    """Not so the sweeps of parallel joints, from which no calibration comes."""
    arm = Arm.a465() if name == "a465" else Arm.from_file(written(tmp_path, name))
    scenario = from_toml(SMALL, "small.toml").with_arm(arm).with_effects([make_effect("joint_offset", OFFSET)])
    run, locked = scenario.simulate(0), scenario.simulate_locked(0)
    assert run.q is not None
    diagnosis = by_hand(causes=(cause("joint_offset", "joint4", (TWIST,), offset_rad=(0.02, 1e-3, "rad")),))
    residuals = gap_residuals(run, diagnosis, locked, arm)
    room = Family.of(arm, run.t, run.q)
    search = Search(residuals, None, contest(residuals.data, diagnosis), room)
    sweep = closest_maneuver(run.t, run.q, run.rate_Hz, arm).maneuver
    assert isinstance(sweep, TorusSweep)
    family_of = list(family(room, sweep))
    can_be_made = [each for each in family_of if room.allows(each)]
    allowed = [each for each in can_be_made if search.allowed(each)]
    assert any(isinstance(each, TorusSweep) for each in allowed)
    assert any(isinstance(each, StaticPoses) for each in allowed)
    for seed, each in enumerate(can_be_made):
        again = replace(scenario, maneuver=replace(each, rate_Hz=10.0 * each.rate_Hz)).simulate(seed)
        arm.check_speeds(np.diff(again.q, axis=0) / np.diff(again.t)[:, None], "the proposal")
        if each in allowed:
            estimators.calibrate(again, arm=arm)
    assert len(allowed) < len(can_be_made) or name == "a465"
