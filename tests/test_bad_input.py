"""Bad input through the command line: one line on stderr, the right exit status, nothing written."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import SMALL, Rig
from spoilt_recordings import BAD_FILES, BAD_TABLES, Spoil, table

import scenarios
from rig.recording import Metadata, Recording, read_recording
from scenarios.loader import from_toml

CALIBRATE = ("calibrate", "{run}", "-o", "out.json")
READERS = {  # every command that reads a recording
    "calibrate": CALIBRATE,
    "apply": ("apply", "cal.json", "{run}", "-o", "out.parquet"),
    "view": ("view", "{run}", "-o", "out.rrd"),
}


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what is in order: scenario, recording as Parquet and CSV, and its calibration."""
    import estimators

    folder = tmp_path_factory.mktemp("good")
    (folder / "small.toml").write_text(SMALL)
    recording = from_toml(SMALL, "small.toml").simulate(0)
    recording.write(folder / "run.parquet")
    recording.write(folder / "run.csv")
    estimators.calibrate(recording).write(folder / "cal.json")
    return folder


@dataclass(frozen=True)
class Bench:
    """A folder of its own for each test, with copies of what is in order, and the command line."""

    folder: Path
    rig: Rig

    def refused(self, *arguments: str | Path, status: int = 2) -> str:
        """The one line of a call that must fail and write nothing."""
        before = {path: path.stat().st_mtime_ns for path in self.folder.rglob("*")}
        line = self.rig.refused(*arguments, status=status)
        assert {path: path.stat().st_mtime_ns for path in self.folder.rglob("*")} == before
        return line


@pytest.fixture
def bench(here: Path, good: Path, rig: Rig) -> Bench:
    for path in good.iterdir():
        (here / path.name).write_bytes(path.read_bytes())
    return Bench(here, rig)


@pytest.mark.parametrize("command", READERS)
@pytest.mark.parametrize(("spoil", "expected"), BAD_TABLES.values(), ids=BAD_TABLES)
def test_a_bad_table(bench: Bench, command: str, spoil: Spoil, expected: str) -> None:
    bad = table(Path("run.csv"))
    spoil(bad)
    Path("bad.csv").write_text(bad.text())
    line = bench.refused(*(part.format(run="bad.csv") for part in READERS[command]))
    assert line.startswith("rig: bad.csv")
    assert re.search(expected, line, re.IGNORECASE), line


@pytest.mark.parametrize("command", READERS)
@pytest.mark.parametrize(("name", "make"), BAD_FILES.items(), ids=BAD_FILES)
def test_a_bad_file(bench: Bench, command: str, name: str, make: Callable[[Path], object]) -> None:
    make(Path(name))
    line = bench.refused(*(part.format(run=name) for part in READERS[command]))
    assert line.startswith(f"rig: {name}: ")


@pytest.mark.parametrize("joint", [1, 2, 3, 4, 5])
def test_a_joint_beyond_its_limit(bench: Bench, joint: int) -> None:
    bad = table(Path("run.csv"))
    bad.set(17, f"q{joint}_rad", "3.5")
    Path("bad.csv").write_text(bad.text())
    line = bench.refused(*(part.format(run="bad.csv") for part in CALIBRATE))
    assert f"joint{joint} is at 200.535 deg in sample 17" in line


def test_joint_6_may_run_on(bench: Bench) -> None:
    run = table(Path("run.csv"))
    run.set(17, "q6_rad", "3000.5")
    Path("far.csv").write_text(run.text())
    assert bench.rig.not_good("calibrate", "far.csv", "-o", "cal.json")


def held(recording: Recording, moving: int | None) -> Recording:
    """The recording as if one joint alone had moved, or none, with the volts of that."""
    assert recording.q is not None
    q = np.array(recording.q)
    for joint in range(q.shape[1]):
        if joint != moving:
            q[:, joint] = q[0, joint]
    scenario = scenarios.load("small.toml")
    from rig.arm import Arm

    field = Arm.a465().poses(q).R_base_tool.transpose(0, 2, 1) @ scenario.rig.environment.gravity
    assert scenario.rig.accelerometer is not None
    volts = scenario.rig.accelerometer.volts(field @ scenario.rig.accelerometer.axes.T)
    noisy = volts + 0.0134 * np.random.default_rng(0).standard_normal(volts.shape)
    return replace(recording, q=q, accelerometer=noisy, magnetometer=None, units={"accelerometer": "V"})


@pytest.mark.parametrize("moving", [None, 0, 5], ids=["no joint moves", "only joint 1", "only joint 6"])
def test_poses_that_cannot_determine_the_parameters(bench: Bench, moving: int | None) -> None:
    held(read_recording("run.parquet"), moving).write("held.parquet")
    line = bench.refused(*(part.format(run="held.parquet") for part in CALIBRATE), status=1)
    assert line.startswith("rig: held.parquet: accelerometer: ")
    assert "equal cells of frame 6: bring it along " in line  # how to do better
    bench.refused("calibrate", "held.parquet", "--json", status=1)


def test_fewer_samples_than_parameters(bench: Bench) -> None:
    read_recording("run.parquet").select(slice(0, 13)).write("short.parquet")
    line = bench.refused(*(part.format(run="short.parquet") for part in CALIBRATE))
    assert "found 13 samples for the 14 parameters" in line


def test_no_pose_at_all(bench: Bench) -> None:
    replace(read_recording("run.parquet"), q=None).write("tumble.parquet")
    for method in ("simultaneous", "separate"):
        line = bench.refused(*(part.format(run="tumble.parquet") for part in CALIBRATE), "--method", method)
        assert "has no pose, expected q1_rad..qN_rad or tool_qw..tool_qz" in line
        assert "'ellipsoid'" in line
    assert "--equal-weights: tumble.parquet is calibrated without the attitude" in bench.refused(
        "calibrate", "tumble.parquet", "--equal-weights"
    )


def test_an_arm_that_is_not_known(bench: Bench) -> None:
    run = read_recording("run.parquet")
    replace(run, metadata=Metadata(arm="puma")).write("puma.parquet")
    assert "'puma'" in bench.refused(*(part.format(run="puma.parquet") for part in CALIBRATE))


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--arm", "mine.urdf"], "mine.urdf: no such file"),
        (["--tip", "imu"], "--tip: found 'imu' without --arm"),
        (["--arm", "mine.urdf", "--tip", "imu"], "mine.urdf: no such file"),
        (["--arm", "run.csv", "--tip", "imu"], "run.csv: "),
        (["--noise", "13.4,13.6,14.6"], "--noise: found '13.4,13.6,14.6', expected 6 positive numbers in mV"),
        (["--noise", "a,b,c,d,e,f"], "--noise: found 'a,b,c,d,e,f', expected 6 positive numbers"),
        (["--noise", "1,2,3,4,5,-6"], "expected 6 positive numbers"),
        (["--noise", "1,2,3,4,5,nan"], "expected 6 positive numbers"),
        (["--noise", "1,2,3,4,5,6", "--locked", "run.csv"], "--locked and --noise: found both"),
        (["--locked", "none.parquet"], "none.parquet: "),
        (["--locked", "run.parquet"], "run.parquet: no pose is held"),
        (["--method", "simultanous"], "expected one of simultaneous, separate, ellipsoid (nearest: 'simultaneous')"),
        (["--parameters", "6"], "--parameters: run.parquet is calibrated by the attitude, expected with --method"),
        (["--coverage", "seen.txt"], "seen.txt: found suffix '.txt', expected .png or .svg or .pdf"),
        (["--parameters", "7"], "found '7', expected one of 6, 9"),
        (["--field-points", "sideways"], "found 'sideways', expected one of up, down"),
        (["--lockd", "run.csv"], "--locked"),
        (["--noise"], "requires an argument"),
    ],
)
def test_bad_options_of_calibrate(bench: Bench, arguments: list[str], expected: str) -> None:
    assert expected in bench.refused("calibrate", "run.parquet", "-o", "out.json", *arguments)


@pytest.mark.parametrize(
    ("output", "expected"),
    [
        ("out.txt", "found suffix '.txt', expected"),
        ("nowhere/out{suffix}", "folder nowhere does not exist"),
        ("folder{suffix}", "is a folder"),
    ],
)
@pytest.mark.parametrize(
    ("command", "suffix"),
    [
        (("sweep", "small.toml"), ".parquet"),
        (("calibrate", "run.parquet"), ".json"),
        (("apply", "cal.json", "run.parquet"), ".csv"),
        (("view", "run.parquet"), ".rrd"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_a_file_that_cannot_be_written(
    bench: Bench, command: tuple[str, ...], suffix: str, output: str, expected: str
) -> None:
    Path(f"folder{suffix}").mkdir()
    assert expected in bench.refused(*command, "-o", output.format(suffix=suffix))


def test_a_demo_that_has_nowhere_to_go(bench: Bench) -> None:
    assert "small.toml: the folder cannot be made: " in bench.refused("demo", "-o", "small.toml")


BAD_CALIBRATIONS = {
    "not JSON": ("{", "is not JSON"),
    "another format": ('{"format": "rig-calibration/9", "sensors": {}}', "expected 'rig-calibration/1'"),
    "no sensor": ('{"format": "rig-calibration/1", "sensors": {}}', "found no sensor"),
    "a list": ("[]", "expected"),
    "half a sensor": ('{"format": "rig-calibration/1", "sensors": {"magnetometer": {}}}', "sensors.magnetometer"),
    "empty": ("", "is not JSON"),
}


@pytest.mark.parametrize("command", ["apply", "view"])
@pytest.mark.parametrize(("text", "expected"), BAD_CALIBRATIONS.values(), ids=BAD_CALIBRATIONS)
def test_a_bad_calibration(bench: Bench, command: str, text: str, expected: str) -> None:
    Path("bad.json").write_text(text)
    arguments = {
        "apply": ("apply", "bad.json", "run.parquet", "-o", "out.parquet"),
        "view": ("view", "run.parquet", "--calibration", "bad.json", "-o", "out.rrd"),
    }
    line = bench.refused(*arguments[command])
    assert line.startswith("rig: bad.json")
    assert expected in line


@pytest.mark.parametrize(
    ("change", "expected"),
    [({"matrix": [[0.0] * 3] * 3}, "sensors.accelerometer.matrix"), ({"matrix": [[1e308] * 3] * 3}, "loses a")],
    ids=["zeros", "of rank one, and huge"],
)
def test_a_calibration_that_loses_a_direction(bench: Bench, change: dict[str, object], expected: str) -> None:
    content = json.loads(Path("cal.json").read_text())
    content["sensors"]["accelerometer"].update(change)
    Path("cal.json").write_text(json.dumps(content))
    for arguments in (("apply", "cal.json", "run.parquet", "-o", "out.parquet"), ("export", "cal.json", "--to", "c")):
        assert expected in bench.refused(*arguments)


def test_a_calibration_with_a_negative_sensitivity(bench: Bench) -> None:
    content = json.loads(Path("cal.json").read_text())
    content["sensors"]["magnetometer"]["axes"][1]["sensitivity"] *= -1
    Path("cal.json").write_text(json.dumps(content))
    line = bench.refused("export", "cal.json", "--to", "c")
    assert "magnetometer.axes[1].sensitivity: found -" in line


def test_links_that_lead_round_in_a_circle(bench: Bench) -> None:
    Path("loop.json").symlink_to("loop.json")
    assert "cannot be read" in bench.rig.refused("export", "loop.json", "--to", "c")


@pytest.mark.parametrize("text", ["time,ax,ay\n1,2,3\n", "t_s;accel1_V\n0;1\n"])
def test_a_log_that_is_no_recording_is_sent_to_import(bench: Bench, text: str) -> None:
    Path("log.csv").write_text(text)
    assert "rig import makes one of such a log" in bench.refused("calibrate", "log.csv")


def test_a_calibration_that_does_not_fit_the_recording(bench: Bench) -> None:
    run = read_recording("run.parquet")
    replace(run, units={**run.units, "accelerometer": "g"}).write("in-g.parquet")
    bench.refused("apply", "cal.json", "in-g.parquet", "-o", "out.parquet")
    content = json.loads(Path("cal.json").read_text())
    del content["sensors"]["accelerometer"]
    Path("half.json").write_text(json.dumps(content))
    replace(run, magnetometer=None, units={"accelerometer": "V"}).write("half.parquet")
    assert "expected a sensor that was calibrated: magnetometer" in bench.refused(
        "apply", "half.json", "half.parquet", "-o", "out.parquet"
    )
    assert "missing.json: no such file" in bench.refused("apply", "missing.json", "run.parquet", "-o", "out.parquet")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["smal.tml"], "unknown scenario 'smal.tml'"),
        (["ann-harbor"], "(nearest: 'ann-arbor')"),
        (["none.toml"], "none.toml: no such file, expected a scenario in TOML"),
        (["wrong.toml"], "wrong.toml: [maneuver] unknown key 'duration' with value 60.0, expected"),
        (["beyond.toml"], "scenario beyond: the maneuver: joint5 is at"),
        (["small.toml", "--engine", "dynamical"], "(nearest: 'dynamic')"),
        (["small.toml", "--motion", "inertal"], "(nearest: 'inertial')"),
        (["small.toml", "--seed", "-1"], "--seed"),
        (["small.toml", "--seed", "one"], "--seed"),
        (["small.toml", "--noise", "-1"], "noise factor: found -1.0, expected zero or a positive number"),
        (["small.toml", "--noise", "nan"], "noise factor: found nan"),
        (["small.toml", "--with", "none.json"], "none.json: no such file"),
        (["small.toml", "--with", "small.toml"], "small.toml: is not JSON"),
        (["small.toml", "--with", "cal.json"], "cal.json: found keys 'format, "),
        (["small.toml", "--with", "cause.json"], "cause.json: cause 1: unknown effect 'baklash': expected one of"),
    ],
)
def test_bad_sweeps(bench: Bench, arguments: list[str], expected: str) -> None:
    Path("wrong.toml").write_text(SMALL.replace("duration_s", "duration"))
    beyond = SMALL.replace("duration_s", 'limits_deg = "none"\npitch_centre_deg = 20.0\nduration_s')
    Path("beyond.toml").write_text(beyond)
    Path("cause.json").write_text('{"effect": "baklash", "where": "joint5", "parameters": {"width_rad": 0.01}}')
    assert expected in bench.refused("sweep", *arguments, "-o", "out.parquet", "--locked")


@pytest.mark.parametrize(
    ("cause", "expected"),
    [
        ({"effect": "backlash", "where": "joint5", "parameters": {"width": 0.01}}, "(nearest: 'width_rad')"),
        (
            {"effect": "backlash", "where": "joint7", "parameters": {}},
            "the arm has 6 joints, expected joint1 to joint6 (nearest: 'joint6')",
        ),
        ({"effect": "backlash", "parameters": {}}, "'where' is missing"),
        (
            {"effect": "backlash", "where": "joint5", "parameters": {"width_rad": "wide"}},
            "found 'wide', expected a finite",
        ),
        ({"effect": "backlash", "where": "joint5", "parameter": {}}, "(nearest: 'parameters')"),
        ({"effect": "backlash", "where": "joint5", "parameters": [1]}, "expected an object of parameters by name"),
        ({"effect": "backlash", "where": ["joint5"]}, "unknown place"),
        ({"effect": 5}, 'expected an object with "effect"'),
        ([3], 'cause 1: found 3, expected an object with "effect"'),
        (3, "found 3, expected"),
        ({"format": "rig-diagnosis/2", "causes": {}}, '"causes", a list of causes'),
        ({"format": "rig-diagnosis/1", "causes": []}, '"format": "rig-diagnosis/2"'),
        ({"format": "rig-diagnosis/2", "causes": [{}], "hypotheses": 3}, "hypotheses: found 3, expected a list"),
        ({"format": "rig-diagnosis/2", "causes": [{}], "hypotheses": [[]]}, 'objects with "causes"'),
    ],
    ids=str,
)
def test_bad_causes(bench: Bench, cause: object, expected: str) -> None:
    Path("cause.json").write_text(json.dumps(cause))
    line = bench.refused("sweep", "small.toml", "-o", "out.parquet", "--with", "cause.json")
    assert line.startswith("rig: cause.json: ")
    assert expected in line


def test_a_diagnosis_whose_causes_are_not_those_of_its_explanation(bench: Bench) -> None:
    cause = {"effect": "bakclash", "where": "joint5", "parameters": {"width_rad": 0.01}}
    explanation = {"causes": [["backlash", "joint5"]], "other": False, "probability": 1.0}
    content = {"format": "rig-diagnosis/2", "causes": [cause], "hypotheses": [explanation]}
    Path("found.json").write_text(json.dumps(content))
    line = bench.refused("sweep", "small.toml", "-o", "out.parquet", "--with", "found.json")
    assert "hypotheses[0]: found [['backlash', 'joint5']], expected what" in line


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["calibrat", "run.parquet"], "unknown command 'calibrat': expected one of demo, sweep, "),
        (["calibrat", "run.parquet"], "(nearest: 'calibrate'); see rig --help"),
        (["--jsn"], "no such option '--jsn'"),
        (["sweep"], "missing argument 'SCENARIO'; see rig sweep --help"),
        (["sweep", "ann-arbor"], "missing option '-o' / '--output'"),
        (["apply", "cal.json"], "missing argument 'RUN'"),
        (["scenarios", "ann-harbor"], "(nearest: 'ann-arbor')"),
        (["effects", "backlsh"], "(nearest: 'backlash')"),
        (["effects", "backlsh", "--json"], "(nearest: 'backlash')"),
        (["scenarios", "small.toml", "again"], "unexpected extra argument"),
        (["diagnose", "run.parquet", "--minutes", "nan"], "'--minutes': found 'nan', expected a finite number"),
        (["calibrate", "run.parquet", "--gravity", "nan"], "'--gravity': found 'nan', expected a finite number"),
        (["demo", "--seed", "x"], "'--seed': found 'x', expected a whole number"),
        (["sweep", "small.toml", "-o", "out.csv", "--noise", "x"], "'--noise': found 'x', expected a number"),
        (
            ["plan", "--seconds", "60", "-o", "out.toml", "--acceleration", "-3"],
            "'--acceleration': found -3.0, expected",
        ),
        (["replay", "run.parquet", "--speed", "max", "--from", "1e9"], "has no sample from 1e+09 s to any time"),
    ],
)
def test_bad_calls(bench: Bench, arguments: list[str], expected: str) -> None:
    assert expected in bench.refused(*arguments)


def test_a_disk_that_is_full_is_no_bug(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: Recording, path: object) -> None:
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr(Recording, "write", full)
    line = bench.refused("sweep", "small.toml", "-o", "out.parquet")
    assert line == "rig: out.parquet: cannot be written: No space left on device after 0 bytes; nothing was changed"


def test_of_two_files_neither_is_written_if_one_fails(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    write = Recording.write

    def fails_second(self: Recording, path: str | Path) -> None:
        if len(self) == 600:
            raise OSError(28, "No space left on device")
        write(self, path)

    monkeypatch.setattr(Recording, "write", fails_second)
    assert "No space left" in bench.refused("sweep", "small.toml", "-o", "out.parquet", "--locked")
