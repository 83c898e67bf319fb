"""What a maneuver can show of the catalogue's effects: what is known of the sweep by algebra, and by brute force."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import Rig

import estimators
import scenarios
from estimators.design.isolability import Isolability
from rig.effects import make_effect
from scenarios.isolability import EffectsBound, isolability_of
from scenarios.plan import poses, telling
from scenarios.terminal.bound import classes, names


@pytest.fixture(scope="module")
def sweep() -> EffectsBound:
    return isolability_of(scenarios.load("ann-arbor"))


def of(found: Isolability, effect: str, where: str) -> int:
    return found.effects.index((effect, where))


def test_what_a_calibration_takes_up_is_not_seen(sweep: EffectsBound) -> None:
    """On a sweep of joints 1, 5 and 6 about fixed axes a turn of the base's, or the tool's, frame is no error."""
    here = sweep.here
    for key in (("joint_offset", "joint1"), ("joint_offset", "joint6"), ("axis_misalignment", "joint2")):
        # Of typical sizes of thousandths of a radian, a second-order rest remains.
        assert here.seen[of(here, *key)] < 0.1
    assert here.seen[of(here, "joint_offset", "joint5")] > 20.0


def test_exact_twins_are_alike_and_part_when_every_joint_moves(sweep: EffectsBound) -> None:
    here, moving = sweep.here, sweep.moving
    assert sweep.locked == (2, 3, 4)
    assert moving is not None
    for one, other in (
        (("joint_offset", "joint2"), ("joint_offset", "joint5")),
        (("joint_offset", "joint4"), ("axis_misalignment", "joint1")),
        (("link_hard_iron", "link1"), ("link_hard_iron", "link4")),
    ):
        assert here.pairs[of(here, *one), of(here, *other)] < 0.5
        assert moving.pairs[of(moving, *one), of(moving, *other)] > 5.0
    assert moving.visible.sum() > here.visible.sum()
    assert ("joint_scale", "joint2") in sweep.gained
    assert (("joint_offset", "joint2"), ("joint_offset", "joint5")) in [pair[:2] for pair in sweep.parted]


def test_nothing_leaves_more_beside_another_than_alone(sweep: EffectsBound) -> None:
    here = sweep.here
    assert (here.apart <= here.seen[:, None] * (1.0 + 1e-9) + 1e-9).all()
    assert (here.apart.diagonal() < 1e-3 * np.maximum(here.seen, 1.0)).all()
    assert sum(map(len, classes(here))) == here.visible.sum()
    assert {"vibration", "mains_hum", "pose_interpolation"} <= set(here.left_out)


def test_the_sigmas_are_those_of_the_residuals() -> None:
    """An effect of typical size leaves just as much in a calibration of readings without noise: the root of its squares
    over the noise. The fit is linear in so small a change to a few per cent."""
    scenario = scenarios.load("ann-arbor")
    # One strength, one shape: a scale error of joint 5, and readings as dense as those that are looked at.
    effect = make_effect("joint_scale", {"where": "joint5", "scale": 1e-3})
    found = isolability_of(scenario, only=[("joint_scale", "joint5")]).here
    quiet = scenario.with_acquisition(noise_V=(0.0,) * 6, bits=None, range_V=None)
    run = replace(quiet, rig=replace(quiet.rig, effects=(effect,))).simulate(0)
    noise = np.hypot(scenario.rig.acquisition.noise_V, scenario.rig.acquisition.step_V / np.sqrt(12.0))
    given = {"accelerometer": noise[:3], "magnetometer": noise[3:]}
    calibration = estimators.calibrate(run, noise=given)
    rms = np.concatenate([calibration.sensors[name].fit_rms for name in given])
    left = np.sqrt(len(run) * np.square(rms / noise).sum())
    assert found.seen[0] == pytest.approx(left, rel=0.03)


def test_the_command_tells_it(rig: Rig, tmp_path: Path) -> None:
    text = rig.done("bound", "ann-arbor", "--effects", "-o", tmp_path / "effects.png")
    assert "Effects in one line cannot be told apart" in text
    assert "If joints 2, 3, 4 moved too" in text
    assert (tmp_path / "effects.png").stat().st_size > 10_000
    document = json.loads(rig.done("bound", "ann-arbor", "--effects", "--json"))
    assert document["format"] == "rig-isolability/1"
    assert len(document["separation_sigmas"]) == len(document["effects"])
    assert "has no arm" in rig.refused("bound", "camps2009-magnetometer", "--effects")


def test_effects_are_named_with_their_places() -> None:
    keys = [("joint_offset", "joint2"), ("base_dipole", "base"), ("joint_offset", "joint5")]
    assert names(keys, {}) == "joint offset joint2, joint5; base dipole"
    assert names(keys, {"joint5": "wrist_2"}) == "joint offset joint2, wrist_2; base dipole"


def test_a_plan_to_tell_causes_apart_says_how_far_apart_they_are(
    rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module, name, least in ((poses, "_CANDIDATES", 60), (telling, "_COUNTS", (10,)), (telling, "_CLIMBS", (5, 0))):
        monkeypatch.setattr(module, name, least)
    two = ("--tell", "backlash@joint5", "--tell", "joint_offset@joint5")
    text = rig.done("plan", "--seconds", "60", *two, "-o", tmp_path / "tell.toml")
    assert "What is left of each beside another [σ]." in text
    assert "joint offset joint5  backlash joint5" in text
