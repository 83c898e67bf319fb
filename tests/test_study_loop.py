"""The loop's study: hidden rigs are as is said, each is played to its end, and the page counts rightly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from cli_support import Rig
from diagnosed_recordings import by_hand, cause

from estimators.gap import Diagnosis
from rig.errors import RigError
from rig.maneuver import StaticPoses
from rig.recording import Recording
from scenarios.workers import Workers
from validation.loop import play, run
from validation.loop.judge import Judged
from validation.loop.play import MOST, Settings, Step, named, trial
from validation.loop.rigs import HiddenRig, drawn, hidden_rig
from validation.loop.run import make_loop
from validation.loop.summary import summaries

drawn_once = cache(hidden_rig)
SMALL = Settings(rigs=2, samples=400, seed=3)
POSES = StaticPoses(poses_deg=((0, 90, -90, 0, 0, 0), (60, 60, -60, 20, 40, 90)), hold_s=1.0, move_s=49.0)


def said(rig: HiddenRig, *, twin: bool = False, right: bool = True) -> Diagnosis:
    effect, where = rig.cause if right else rig.alike[0]
    other = {"effect": rig.alike[0][0], "where": rig.alike[0][1], "probability": 0.4}
    return by_hand("named", causes=(cause(effect, where, (other,) if twin else ()),))


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> dict[int, tuple[bool, bool]]:
    """Number of recordings -> whether a twin is left, and whether the cause is right; the rig is as it would be."""
    played: dict[int, tuple[bool, bool]] = {}
    rigs: list[HiddenRig] = []

    def hidden(seed: int, number: int, samples: int) -> HiddenRig:
        rigs.append(drawn_once(seed, number, samples))
        return rigs[-1]

    def judged(runs: Sequence[Recording], locked: Recording) -> Judged:
        assert len({run.name for run in runs}) == len(runs)
        twin, right = played.get(len(runs), (True, True))
        return Judged(said(rigs[-1], twin=twin, right=right), lambda: (POSES, False) if len(runs) < 3 else None)

    monkeypatch.setattr(play, "hidden_rig", hidden)
    monkeypatch.setattr(play, "judged", judged)
    return played


def steps_of(settings: Settings, number: int = 0) -> list[Step]:
    return [Step(**row) for row in trial(settings, number).to_pylist()]


def test_a_hidden_rig_has_a_cause_that_its_first_maneuver_takes_for_another() -> None:
    rig = drawn_once(3, 0, 400)
    assert rig.effect.name in drawn()
    assert rig.alike
    assert rig.cause not in rig.alike
    assert len(rig.recording(0)) == 400
    again = hidden_rig(3, 0, 400)
    np.testing.assert_array_equal(again.recording(0).accelerometer, rig.recording(0).accelerometer)
    moved = rig.on(POSES)
    assert moved.setting.rig == rig.setting.rig
    assert moved.recording(1).duration_s == pytest.approx(POSES.duration_s, abs=0.5)
    assert not any(each.endswith("_step") for each in drawn())


def test_a_rig_is_played_until_one_name_is_left(script: dict[int, tuple[bool, bool]]) -> None:
    script[2] = (False, True)
    steps = steps_of(SMALL)
    assert [(step.strategy, step.step, step.ended) for step in steps] == [
        (strategy, number, end) for strategy in play.STRATEGIES for number, end in ((1, ""), (2, "named"))
    ]
    assert [step.names for step in steps[:2]] == [2, 1]
    assert all(step.rightly for step in steps if step.ended)
    assert steps[1].minutes == pytest.approx(steps[0].minutes + POSES.duration_s / 60.0)


def test_a_rig_is_given_up_or_has_no_maneuver(script: dict[int, tuple[bool, bool]]) -> None:
    ends = {each.strategy: each.last[0] for each in summaries(steps_of(SMALL))}
    assert (ends["proposed"].ended, ends["proposed"].step) == ("no maneuver", 3)
    assert (ends["torus"].ended, ends["torus"].step) == ("given up", MOST)
    script[1] = (False, False)
    wrong = summaries(steps_of(SMALL))
    assert all(each.ends == {"rightly": 0, "wrongly": 1, "no maneuver": 0, "given up": 0} for each in wrong)
    assert not wrong[0].open


def test_only_one_name_is_a_name() -> None:
    rig = drawn_once(3, 0, 400)
    assert named(said(rig))
    assert not named(said(rig, twin=True))
    assert not named(by_hand("ambiguous"))
    assert not named(by_hand("unknown"))


def test_the_summary_counts_minutes_of_all_open_rigs() -> None:
    first = Step(0, "proposed", 1, "a", "b", 20.0, 1, 7.0, "torus sweep", "named", 0.95, 2, "a@b", True, "")
    steps = [
        first,
        replace(first, step=2, minutes=14.0, names=1, ended="named"),
        replace(first, rig=1),
        replace(first, rig=1, step=3, minutes=21.0, ended="no maneuver"),
        replace(first, rig=2, names=1, ended="named"),
    ]
    (found,) = summaries(steps)
    assert found.ends == {"rightly": 2, "wrongly": 0, "no maneuver": 1, "given up": 0}
    assert (found.rightly.hits, found.rightly.count) == (2, 3)
    assert (found.rightly_open.hits, found.rightly_open.count) == (1, 2)
    assert found.added_maneuvers == 1.0
    assert found.added_minutes == found.minutes_a_name == pytest.approx(7.0 + 14.0)
    np.testing.assert_allclose(found.share(np.array([0.0, 7.0, 14.0])), [0.0, 1 / 3, 2 / 3])


def test_the_study_goes_on_and_makes_its_page(script: dict[int, tuple[bool, bool]], tmp_path: Path, rig: Rig) -> None:
    script[2] = (False, True)
    command = ("study", "loop", "-o", str(tmp_path), "--rigs", "2", "--samples", "400", "--seed", "3", "--workers", "0")
    text = rig.done(*command)
    assert "proposed" in text
    page = (tmp_path / "loop.md").read_text()
    assert "2 of 2 of the rigs that the first recording left open end with the right name, after 1 more" in page
    assert (tmp_path / "loop" / "loop.png").read_bytes().startswith(b"\x89PNG")
    script[2] = (True, True)  # would be another study, were anything made again
    rig.done(*command)
    assert (tmp_path / "loop.md").read_text() == page
    assert "found a study with seed 3" in rig.refused(*command[:-3], "4", *command[-2:])


def test_a_loop_writes_through_no_link_and_leaves_nothing_where_it_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(settings: Settings, number: int) -> None:
        raise RigError("no such rig")

    monkeypatch.setattr(run, "trial", fails)
    with pytest.raises(RigError, match="no such rig"):
        make_loop(tmp_path / "out", SMALL, Workers(0))
    assert not list(tmp_path.iterdir())
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "loop").mkdir()
    (tmp_path / "loop" / "study").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(RigError, match="study: is a link"):
        make_loop(tmp_path, SMALL, Workers(0))
    assert not list((tmp_path / "elsewhere").iterdir())


def test_a_forged_table_is_refused_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def forged(settings: Settings, number: int) -> pa.Table:
        return pa.table([pa.array(["joint5"])] * 2, names=["where", "where"])

    monkeypatch.setattr(run, "trial", forged)
    with pytest.raises(RigError, match=r"study: (its tables do not make one study|no study that can be read)"):
        make_loop(tmp_path, SMALL, Workers(0))
