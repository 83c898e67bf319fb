"""``rig diagnose`` as a user calls it: files, words, exit status, many recordings, bad ones, and what comes after."""

from __future__ import annotations

import json
import os
import re
import shlex
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace
from multiprocessing import active_children
from pathlib import Path

import numpy as np
import pytest
from cli_support import Rig
from diagnosed_recordings import backlash, only, recorded, write_small

import scenarios
from estimators import Calibration
from estimators.gap import diagnose
from rig.assets import model_path
from rig.effects import make_effect
from rig.errors import RefusedFit, RigError
from rig.recording import Recording, read_recording
from scenarios.causes import read_causes
from scenarios.diagnosing import batch
from scenarios.diagnosing.batch import Outcome, Task, outcomes
from scenarios.workers import Workers

KEYS = {"format", "recordings", "samples", "seconds", "verdict", "causes", "where", "closed", "remainder"}
KEYS |= {"posterior", "omitted", "hypotheses", "calibration_shift", "cannot_tell", "next"}


def listed(folder: Path | str) -> set[str]:
    return {path.name for path in Path(folder).iterdir()}


def test_a_recording_is_diagnosed_and_its_rig_improved(rig: Rig, here: Path) -> None:
    write_small(here, backlash())
    text = rig.done("diagnose", "run.parquet", "--save-scenario", "better.toml")
    assert "Backlash of joint 5" in text
    assert "diagnosis/run.html" in text
    assert listed("diagnosis") == {"run.diagnosis.json", "run.calibration.json", "run.html"}
    found = json.loads(Path("diagnosis/run.diagnosis.json").read_text())
    assert set(found) >= KEYS
    assert found["format"] == "rig-diagnosis/2"
    assert found["verdict"] == "named"
    (cause,) = found["causes"]
    width = cause["parameters"]["width_rad"]
    assert (cause["effect"], cause["where"]) == ("backlash", "joint5")
    # Six deviations, and what ten samples at the reversals do, where encoder and simulator see different directions
    assert abs(width["value"] - 0.05) < 6.0 * width["std"] + 0.02 * 0.05
    assert "<svg" in Path("diagnosis/run.html").read_text()

    made = scenarios.load("better.toml")
    assert made.rig.effects == (make_effect("backlash", {"where": "joint5", "width_rad": width["value"]}),)
    rig.done("sweep", "better.toml", "-o", "again.parquet")
    assert len(read_recording("again.parquet")) == 600
    said = json.loads(
        rig.done("sweep", "small.toml", "--with", "diagnosis/run.diagnosis.json", "-o", "x.parquet", "--json")
    )
    assert said["effects"] == [{"effect": "backlash", "where": "joint5"}]


@pytest.mark.parametrize(
    "effect",
    [
        make_effect("mounting_slip", {"where": "mount", "rotation_rad": (0.05, 0.02, -0.03), "at_s": 31.0}),
        make_effect("channel_crosstalk", {"where": "mag1", "coefficient": 0.05, "source": "accel3"}),
    ],
    ids=lambda effect: effect.name,
)
def test_vectors_and_names_come_back_from_a_real_diagnosis(rig: Rig, here: Path, effect: object) -> None:
    write_small(here, effect)  # type: ignore[arg-type]
    found = json.loads(rig.done("diagnose", "run.parquet", "--out", "o", "--json"))
    assert found == json.loads(Path("o/run.diagnosis.json").read_text())
    assert found["causes"][0]["effect"] == effect.name  # type: ignore[attr-defined]
    rig.done("sweep", "small.toml", "--with", "o/run.diagnosis.json", "-o", "x.parquet")
    again = read_causes("o/run.diagnosis.json")[0]
    assert type(again) is type(effect)
    for name, parameter in found["causes"][0]["parameters"].items():
        assert getattr(again, name) == pytest.approx(_tuple(parameter["value"]))


def test_a_digital_sensors_rig_is_written_and_runs(rig: Rig, here: Path) -> None:
    for run, name in zip(recorded(backlash()), ("run", "run.locked"), strict=True):
        replace(run, units={"accelerometer": "g", "magnetometer": "uT"}).write(f"{name}.parquet")
    result = rig("diagnose", "run.parquet", "--save-scenario", "better.toml", "--out", "o", *only("backlash"))
    assert result.status == 0
    assert "better.toml: written" in result.out
    corrected = Calibration.read("o/run.calibration.json")
    assert {name: sensor.unit for name, sensor in corrected.sensors.items()} == {
        "accelerometer": "g",
        "magnetometer": "uT",
    }
    assert corrected["magnetometer"].field_unit == "G", "as the recording's field is stated"
    rig.done("sweep", "better.toml", "-o", "again.parquet")
    assert read_recording("again.parquet").units == {"accelerometer": "g", "magnetometer": "uT"}


def test_a_rig_that_no_scenario_can_describe_does_not_cost_the_diagnosis(
    rig: Rig, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> None:
        raise RigError("arm mine cannot be written: expected one that was read from a file")

    monkeypatch.setattr("scenarios.diagnosing.batch.improved_rig", refused)
    write_small(here, backlash())
    result = rig("diagnose", "run.parquet", "--save-scenario", "better.toml", "--out", "o", *only("backlash"))
    assert result.status == 2
    assert result.err.startswith("rig: better.toml: not written, but the diagnosis is: ")
    assert result.err.endswith("arm mine cannot be written: expected one that was read from a file\n")
    assert result.err.count("\n") == 1
    assert "Backlash of joint 5" in result.out
    assert "better.toml" not in result.out
    assert listed("o") == {"run.diagnosis.json", "run.calibration.json", "run.html"}
    assert not Path("better.toml").exists()


def _tuple(value: object) -> object:
    return tuple(value) if isinstance(value, list) else value


def test_bad_recordings_do_not_stop_the_others(rig: Rig, here: Path) -> None:
    write_small(here, name="quiet")
    run, locked = recorded()
    constant = np.array(run.accelerometer)
    constant[:, 1] = 2.5
    replace(run, accelerometer=constant).write("constant.parquet")
    locked.write("constant.locked.parquet")
    files = sorted(path.name for path in here.glob("*.parquet"))  # as a shell expands *.parquet
    result = rig("diagnose", *files, "missing.parquet", "--out", "deep/o", "--jobs", "2", "--json", *only("backlash"))
    assert result.status == 2
    found = {"quiet.diagnosis.json", "quiet.calibration.json", "quiet.html", "fleet.csv", "fleet.json", "fleet.html"}
    assert listed("deep/o") == found
    refused, quiet, missing = json.loads(result.out)
    assert quiet["verdict"] == "no-gap"
    assert refused["recordings"] == ["constant"]
    assert "axis 2" in refused["error"]
    assert "no such file" in missing["error"]
    lines = result.err.splitlines()
    assert len(lines) == 2
    assert all(line.startswith("rig: ") for line in lines)
    assert "locked" not in result.err


def test_the_exit_status_is_that_of_the_worst(rig: Rig, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    errors = {"a": RefusedFit("a.csv: no answer"), "b": RigError("no file's name"), "c": ValueError("two\nlines")}

    def fail(task: Task, progress: object = None) -> Outcome:
        raise errors[task.run.stem]

    monkeypatch.setattr(batch, "carry_out", fail)
    monkeypatch.delenv("RIG_DEBUG", raising=False)
    for names, status in (("a", 1), ("ab", 2), ("abc", 70)):
        runs = [f"{name}.csv" for name in names]
        result = rig("diagnose", *runs, "--jobs", "1")
        assert result.status == status, result
        assert len(result.err.splitlines()) == len(runs)
    assert "rig: b.csv: no file's name" in result.err
    assert "c.csv: this is a bug in rig" in result.err
    assert "two lines" in result.err


def spoilt(change: Callable[[Recording], Recording]) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        run, locked = recorded()
        change(run).write(path)
        locked.write(path.with_name(f"{path.stem}.locked.parquet"))

    return make


def clip(run: Recording) -> Recording:
    return replace(run, magnetometer=np.clip(run.magnetometer, 2.45, 2.46))  # type: ignore[arg-type, type-var]


def copy(run: Recording) -> Recording:
    return replace(run, accelerometer=np.asarray(run.accelerometer)[:, [0, 0, 2]])


def nan_channel(path: Path) -> None:
    run, _ = recorded()
    run.write(path)
    head, names, *rows = path.read_text().splitlines()
    column = names.split(",").index("mag2_V")
    cut = [row.split(",") for row in rows]
    path.write_text(
        "\n".join([head, names, *(",".join([*row[:column], "nan", *row[column + 1 :]]) for row in cut), ""])
    )


BAD = {
    "short": ("run.parquet", spoilt(lambda run: run.select(slice(150))), 2, "150 samples"),
    "pose-less": ("run.parquet", spoilt(lambda run: replace(run, q=None)), 2, "no pose"),
    "constant": ("run.parquet", spoilt(lambda run: replace(run, accelerometer=np.full((600, 3), 2.5))), 1, "constant"),
    "clipped throughout": ("run.parquet", spoilt(clip), 1, "readings|clipped|respond"),
    "NaN channel": ("run.csv", nan_channel, 2, "mag2_V.*NaN"),
    "no recording": ("run.parquet", lambda path: path.write_text("hello"), 2, "run.parquet"),
    "a copied axis": ("run.parquet", spoilt(copy), 1, "accel1 equals accel2: one of them is a copy"),
    "in degrees": ("run.parquet", spoilt(lambda run: replace(run, q=np.degrees(run.q))), 2, "joint.*deg"),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("case", BAD)
def test_bad_recordings_are_refused_in_one_line_and_leave_nothing(rig: Rig, here: Path, case: str) -> None:
    name, make, status, words = BAD[case]
    make(here / name)
    message = rig.refused("diagnose", name, "--out", "o", status=status)
    assert re.search(words, message), message
    assert not (here / "o").exists()


WRONG = {
    "unknown effect": (["--without", "backlsh"], "backlash"),
    "no such locked": (["--locked", "nothing.parquet"], "nothing.parquet"),
    "no such maneuver": (["--maneuver2", "nothing.parquet"], "nothing.parquet"),
    "scenario's suffix": (["--save-scenario", "x.json"], ".toml"),
    "scenario's folder": (["--save-scenario", "no/x.toml"], "no"),
    "one scenario for two": (["--save-scenario", "x.toml", "other.parquet"], "expected one"),
    "out is a file": (["--out", "small.toml"], "is a file"),
    "out below a file": (["--out", "small.toml/o"], "is a file"),
    "the same name twice": (["x/run.parquet"], "different names"),
    "no processes": (["--jobs", "0"], "jobs"),
    "here and on a cluster": (["--jobs", "2", "--cluster", "tcp://127.0.0.1:9"], "expected one of them"),
    "a recording named as the page of all": (["fleet.parquet"], "fleet.html"),
    "no such prior": (["--prior", "nothing.toml"], "nothing.toml"),
    "prior of an unknown effect": (["--prior", "wrong.toml"], "backlash"),
    "prior with a negative weight": (["--prior", "negative.toml"], "effects.backlash"),
    "no prior": (["--prior", "small.toml"], "[effects]"),
    "a tip without its arm": (["--tip", "imu"], "--arm"),
    "the prior written over": (["--prior", "p.toml", "--save-scenario", "p.toml"], "p.toml: is the file"),
    "the arm written over": (["--arm", "arm.toml", "--save-scenario", "x/../arm.toml"], "arm.toml: is the file"),
    "the prior in the results": (["--prior", "x/run.next.toml", "--out", "x"], "run.next.toml: is the file"),
    "the scenario in the next one": (["--out", "x", "--save-scenario", "x/run.next.toml"], "expected another name"),
    "results that cannot be written": (["--out", "blocked"], "run.html: is a folder"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_calls_are_refused_before_any_work(
    rig: Rig, here: Path, monkeypatch: pytest.MonkeyPatch, case: str
) -> None:
    def work(*arguments: object) -> Iterator[object]:
        raise AssertionError("worked")

    monkeypatch.setattr(batch, "outcomes", work)
    (here / "wrong.toml").write_text("[effects]\nbacklsh = 2\n")
    (here / "negative.toml").write_text("[effects]\nbacklash = -1\n")
    (here / "x").mkdir()
    (here / "blocked" / "run.html").mkdir(parents=True)
    for name in ("p.toml", "arm.toml", "x/run.next.toml"):
        (here / name).write_text("[effects]\nbacklash = 2\n")
    options, words = WRONG[case]
    assert words in rig.refused("diagnose", "run.parquet", *options)


def test_files_are_written_all_or_none(rig: Rig, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write = Path.write_text

    def full(self: Path, text: str, **options: str) -> int:
        if ".diagnosis" in self.name:
            raise RigError("disk full")
        return write(self, text, **options)

    write_small(here)
    monkeypatch.setattr(Path, "write_text", full)
    assert "disk full" in rig.refused("diagnose", "run.parquet", "--out", "o", "--save-scenario", "better.toml")
    assert not Path("o").exists()
    assert not Path("better.toml").exists()


def outcome_or_death(task: Task, progress: object = None) -> str | RefusedFit:
    """Stands for a diagnosis in a worker: one is killed, one fails, the others answer."""
    if task.run.name == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if task.run.name == "fails":
        return RefusedFit("no answer")
    return task.run.name


def test_a_printed_step_runs_as_it_is_printed_with_an_arm_of_ones_own(rig: Rig, here: Path) -> None:
    """But for the name of the recording: the arm and its tip are in the command, quoted for a shell."""
    write_small(here, backlash())
    arm = here / "my arm.urdf"
    arm.write_bytes(Path(model_path("a465/a465.urdf")).read_bytes())
    shown = rig.done("diagnose", "run.parquet", "--arm", arm, "--tip", "imu", *only("backlash"))
    (step, *_) = json.loads(Path("diagnosis/run.diagnosis.json").read_text())["next"]["steps"]
    assert step in " ".join(shown.split())
    command = step[step.index("rig diagnose RUN") : step.index(", then")]
    words = ["run.parquet" if word == "RUN" else word for word in shlex.split(command)][1:]
    assert words[2:6] == ["--arm", str(arm), "--tip", "imu"]
    rig.done(*words, *only("backlash"))
    assert Path("improved.toml").is_file()
    page = Path("diagnosis/run.html").read_text()
    assert "<span>--tip</span> <span>imu</span> <span>--save-scenario</span>" in page


def test_without_an_arm_of_ones_own_a_step_names_none(rig: Rig, here: Path) -> None:
    write_small(here, backlash())
    assert "--arm" not in rig.done("diagnose", "run.parquet", *only("backlash"))


def test_only_the_next_maneuver_of_an_earlier_diagnosis_is_removed(rig: Rig, here: Path) -> None:
    write_small(here)
    (here / "o").mkdir()
    (here / "o" / "run.next.toml").write_text("mine")
    rig.done("diagnose", "run.parquet", "--out", "o", *only("backlash"))
    assert (here / "o" / "run.next.toml").read_text() == "mine"
    rig.done("diagnose", "run.parquet", "--out", "o", *only("backlash"))
    assert listed("o") == {"run.diagnosis.json", "run.calibration.json", "run.html"}


def test_a_killed_process_costs_its_own_recording_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batch, "_attempt", outcome_or_death)
    names = ["a", "killed", "fails", "b", "c"]
    shares: list[float] = []
    found = dict(outcomes([Task(Path(name)) for name in names], Workers(2), shares.append))
    assert [found[number] for number in (0, 3, 4)] == ["a", "b", "c"]
    assert isinstance(found[2], RefusedFit)
    assert isinstance(found[1], RigError)
    assert "killed" in str(found[1])
    assert shares[-1] == 1.0
    assert shares == sorted(shares)


def test_an_interrupt_ends_the_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batch, "_attempt", outcome_or_death)

    def interrupt(share: float) -> None:
        raise KeyboardInterrupt

    before = {child.pid for child in active_children()}  # of other tests of this process
    with pytest.raises(KeyboardInterrupt):
        list(outcomes([Task(Path(name)) for name in "abcd"], Workers(2), interrupt))
    for child in [each for each in active_children() if each.pid not in before]:
        child.join(10.0)
        with pytest.raises(ProcessLookupError):  # is_alive() cannot tell where the pool's own thread saw the end
            os.kill(child.pid or 0, 0)


def test_effects_are_drawn(rig: Rig, here: Path) -> None:
    assert "step.png: written" in rig.done("effects", "bias_step", "-o", "step.png", "--where", "mag3")
    assert Path("step.png").read_bytes().startswith(b"\x89PNG")
    assert "mean" in rig.done("effects")
    assert "joint9" in rig.refused("effects", "backlash", "-o", "x.png", "--where", "joint9")
    assert "NAME" in rig.refused("effects", "-o", "x.png")
    assert "-o" in rig.refused("effects", "backlash", "--where", "joint1")
    assert ".png" in rig.refused("effects", "backlash", "-o", "x.jpeg")
    assert not Path("x.png").exists()


def test_an_arm_that_nobody_knows_is_not_taken_for_the_a465(rig: Rig, here: Path) -> None:
    run = scenarios.load("renk2005-table2").simulate(0)
    replace(run, metadata=replace(run.metadata, arm="ur5e")).write("foreign.parquet")
    assert "arm 'ur5e' is not built in, expected its model (--arm FILE)" in rig.refused("diagnose", "foreign.parquet")
    with pytest.raises(RigError, match="arm 'ur5e' is not built in"):
        diagnose("foreign.parquet")


def test_what_is_not_felt_is_replayed_as_it_was_fitted(tmp_path: Path) -> None:
    """A warm-up far slower than the recording has no time constant to report; its rate means nothing without one."""
    estimates = {
        "coefficient": {"value": [0.01, 0.02, 0.03], "std": [1e-3, 1e-3, 1e-3], "unit": "V"},
        "tau_s": {"value": None, "std": None, "unit": "s", "why": "not felt", "fitted": 5e4},
    }
    cause = {"effect": "bias_warmup", "where": "magnetometer", "parameters": estimates}
    (tmp_path / "cause.json").write_text(json.dumps(cause), encoding="utf-8")
    (effect,) = read_causes(tmp_path / "cause.json")
    assert effect == make_effect(
        "bias_warmup", {"where": "magnetometer", "coefficient": (0.01, 0.02, 0.03), "tau_s": 5e4}
    )
