"""Logs as they come: read, mapped, joined, and held against what a wrong convention would do."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arm_files import UR5E_NAMES, written
from bag_examples import write_bag
from cli_support import Rig
from rosbags.rosbag2 import StoragePlugin
from scipy.spatial.transform import Rotation

import estimators
import scenarios
from rig.arm import Arm
from rig.errors import RigError
from rig.maneuver import TorusSweep
from rig.recording import Recording, read_recording
from scenarios.importing import Imported, Mapping, import_logs
from scenarios.importing.mapping import Conventions, Stated, read_mapping
from scenarios.importing.quantities import unit_word

SHARED = Path(__file__).parents[2] / "shared"
G_PER_VOLT = 1.0 / (0.1425 * 9.80665)  # the scenario's accelerometer, about 0.1425 V/(m/s^2)
UT_PER_VOLT = 100.0 / 2.4


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    return Arm.from_file(written(tmp_path_factory.mktemp("arm"), "ur5e"))


@pytest.fixture(scope="module")
def run(arm: Arm) -> Recording:
    """A sweep in g and uT, by a chip that reads up at rest, offsets about zero."""
    sweep = TorusSweep(duration_s=300.0, yaw_passes=5, pitch_passes=3)
    swept = replace(scenarios.load("ann-arbor"), maneuver=sweep).with_arm(arm).simulate(seed=4)
    return replace(
        swept,
        accelerometer=-G_PER_VOLT * (swept.accelerometer - [2.4, 2.4, 2.1]),
        magnetometer=UT_PER_VOLT * (swept.magnetometer - [2.4, 2.4, 2.7]) * [1, 1, -1],
        units={"accelerometer": "g", "magnetometer": "uT"},
    )


def table(run: Recording) -> dict[str, np.ndarray]:
    """The run as another program would log it."""
    columns = {"Timestamp [ms]": 1e3 * run.t + 1.7e12}
    columns |= {f"{name}_joint (deg)": np.degrees(run.q[:, joint]) for joint, name in enumerate(UR5E_NAMES)}
    columns |= {f"Acc {axis} [g]": run.accelerometer[:, k] for k, axis in enumerate("XYZ")}
    columns |= {f"Mag {axis} [uT]": run.magnetometer[:, k] for k, axis in enumerate("XYZ")}
    return columns


def write_text(path: Path, columns: dict[str, np.ndarray], delimiter: str = ",", comma: bool = False) -> Path:
    rows = [delimiter.join(columns)]
    for values in zip(*columns.values(), strict=True):
        row = delimiter.join(repr(float(value)) for value in values)
        rows.append(row.replace(".", ",") if comma else row)
    path.write_text("\n".join(rows) + "\n")
    return path


def imported(
    paths: list[Path], arm: Arm | None, columns: dict[str, str] | None = None, **conventions: object
) -> Imported:
    base = Mapping({}, Conventions(**conventions), Stated(gravity_m_s2=9.8, magnetic_field=55.0))  # type: ignore[arg-type]
    return import_logs(paths, None if columns is None else replace(base, columns=columns), arm, base)


def same(found: Recording, run: Recording, tolerance: float = 1e-9) -> None:
    np.testing.assert_allclose(found.t, run.t - run.t[0], atol=3e-4)  # milliseconds since 1970 in a double
    np.testing.assert_allclose(found.q, run.q, atol=tolerance)
    np.testing.assert_allclose(found.accelerometer, run.accelerometer, atol=tolerance)
    np.testing.assert_allclose(found.magnetometer, run.magnetometer, atol=1e2 * tolerance)


@pytest.mark.parametrize(("delimiter", "comma"), [(",", False), (";", True), ("\t", True), ("\t", False)])
def test_a_text_table_with_foreign_names_is_read_by_itself(
    tmp_path: Path, run: Recording, arm: Arm, delimiter: str, comma: bool
) -> None:
    found = imported([write_text(tmp_path / "log.txt", table(run), delimiter, comma)], arm)
    same(found.recording, run)
    assert found.mapping.columns["wrist_2_joint (deg)"] == "q5_deg"
    assert found.recording.units == {"accelerometer": "g", "magnetometer": "uT"}
    assert found.recording.metadata.accelerometer_reads == "a-g"
    assert not [line for line in found.findings if line.startswith(("poses", "accelerometer"))]
    assert any("accelerometer: reads +1 g upward at rest" in line for line in found.said)
    calibration = estimators.calibrate(found.recording, arm=arm)
    assert np.isfinite(calibration["accelerometer"].covariance[0, 0])


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        *(("joint1 [Grad]", "deg"), ("giunto1 (gradi)", "deg"), ("q1 (Deg)", "deg"), ("q1_rad", "rad")),
        *(("gradient_1", ""), ("comrade", ""), ("winkel_grad", "deg"), ("q1 [degrés]", "deg"), ("q1 [Rad]", "rad")),
    ],
)
def test_the_unit_of_an_angle_is_a_word_of_its_own(name: str, unit: str) -> None:
    assert unit_word(name, ("deg", "rad")) == unit


def test_a_time_of_another_language_is_known_by_its_unit(tmp_path: Path, run: Recording, arm: Arm) -> None:
    """What rises in milliseconds is the time; what stays, or comes and goes in seconds, is not."""
    columns = tool_table(run, arm)
    t = columns.pop("t")
    columns = {"frist_s": np.cos(t), "dauer_ms": np.ones_like(t), "zeit_ms": 1e3 * t, **columns}
    found = imported([write_text(tmp_path / "log.csv", columns)], arm)
    assert found.mapping.columns["zeit_ms"] == "t"
    np.testing.assert_allclose(found.recording.t - found.recording.t[0], run.t - run.t[0], atol=1e-6)


def test_the_mapping_file_is_written_once_and_read_again(rig: Rig, tmp_path: Path, run: Recording, arm: Arm) -> None:
    log = write_text(tmp_path / "log.csv", table(run))
    call = ("import", log, "-o", tmp_path / "run.parquet", "--map", tmp_path / "map.toml", "--arm", arm.file)
    assert "written; confirm or change it" in rig.done(*call, "--gravity", "9.81", "--field", "55uT")
    mapping = read_mapping(tmp_path / "map.toml")
    assert (mapping.metadata.gravity_m_s2, mapping.metadata.magnetic_field_unit) == (9.81, "uT")
    text = (tmp_path / "map.toml").read_text().replace('"accel1_g"', '"-accel1_g"')
    (tmp_path / "map.toml").write_text(text)
    document = json.loads(rig.done(*call, "--json"))
    assert any("left-handed" in line or "mirrored" in line for line in document["findings"])
    turned = read_recording(tmp_path / "run.parquet", joints=6)
    np.testing.assert_allclose(turned.accelerometer[:, 0], -run.accelerometer[:, 0])
    assert turned.metadata.gravity_m_s2 == 9.81


def test_a_recording_that_cannot_be_written_leaves_no_mapping(
    rig: Rig, tmp_path: Path, run: Recording, arm: Arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(recording: Recording, path: Path) -> None:
        raise RigError("the disk is full")

    log = write_text(tmp_path / "log.csv", table(run))
    monkeypatch.setattr(Recording, "write", fail)
    call = ("import", log, "-o", tmp_path / "run.parquet", "--map", tmp_path / "map.toml", "--arm", arm.file)
    assert rig(*call, "--gravity", "9.81", "--field", "55uT").status == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.csv"]


def test_two_files_on_one_clock_are_joined(tmp_path: Path, run: Recording, arm: Arm) -> None:
    """Poses at a third of the rate: between them the joints are within the parabola that a line leaves out."""
    columns = table(run)
    sensors = {name: values for name, values in columns.items() if "joint" not in name}
    poses = {name: values[::3] for name, values in columns.items() if "joint" in name or "Time" in name}
    found = imported([write_text(tmp_path / "imu.csv", sensors), write_text(tmp_path / "arm.csv", poses)], arm)
    recording = found.recording
    assert recording.metadata.pose_rate_Hz == pytest.approx(4.0 / 3.0, rel=1e-3)
    count = len(recording)
    bent = np.abs(np.diff(run.q, 2, axis=0)).max()  # q'' dt^2; over three steps a line is off by 9/8 of it
    np.testing.assert_allclose(recording.q, run.q[:count], atol=9 / 8 * bent + 1e-6)
    np.testing.assert_allclose(recording.accelerometer, run.accelerometer[:count], atol=1e-12)


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP], ids=["bag", "mcap"])
@pytest.mark.parametrize("clock_s", [0.0, 40.0])
def test_a_ros_bag_is_the_recording(
    tmp_path: Path, run: Recording, arm: Arm, storage: StoragePlugin, clock_s: float
) -> None:
    part = run.select(slice(0, 600))
    path = write_bag(tmp_path / "bag", part, storage, clock_s, [f"{name}_joint" for name in UR5E_NAMES])
    if storage is StoragePlugin.MCAP:
        path = next(path.glob("*.mcap"))
    found = imported([path], arm, **({"clock_offset_s": "auto"} if clock_s else {}))
    recording = found.recording
    first = round(float(recording.t[0] - part.t[0]) * 4)
    count = len(recording)
    assert count > 0.7 * len(part)
    late = 0.02 if clock_s else 1e-6  # the estimated offset, at the joints' fastest
    bent = np.abs(np.diff(part.q, 2, axis=0)).max() / 2
    fastest = np.abs(np.diff(part.q, axis=0)).max() * 4.0
    row = int(np.argmin(np.abs(part.accelerometer - recording.accelerometer[0] / 9.80665).sum(axis=1)))
    np.testing.assert_allclose(recording.q, part.q[row : row + count], atol=bent + late * fastest)
    np.testing.assert_allclose(recording.magnetometer, part.magnetometer[row : row + count], atol=1e-6)
    assert first == 0
    if clock_s:
        assert any(line.startswith("two clocks: -40.0") for line in found.findings), found.findings


def tool_table(run: Recording, arm: Arm) -> dict[str, np.ndarray]:
    turns = arm.poses(run.q).R_base_tool
    quaternion = Rotation.from_matrix(turns).as_quat(scalar_first=True)
    columns = {"t": run.t, **{f"q{part}": quaternion[:, k] for k, part in enumerate("wxyz")}}
    columns |= {f"r{i + 1}{j + 1}": turns[:, i, j] for i in range(3) for j in range(3)}
    euler = Rotation.from_matrix(turns).as_euler("ZYX")
    columns |= {name: euler[:, k] for k, name in enumerate(("yaw", "pitch", "roll"))}
    columns |= {f"j{k + 1}": run.q[:, k] for k in range(6)}
    columns |= {f"a{axis}": run.accelerometer[:, k] for k, axis in enumerate("xyz")}
    columns |= {f"m{axis}": run.magnetometer[:, k] for k, axis in enumerate("xyz")}
    return columns


AXES = tuple(enumerate("xyz", start=1))
READINGS = {
    "t": "t",
    **{f"a{axis}": f"accel{k}_g" for k, axis in AXES},
    **{f"m{axis}": f"mag{k}_uT" for k, axis in AXES},
}
QUATERNION = {f"q{part}": f"q{part}" for part in "wxyz"}
MATRIX = {f"r{i}{j}": f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)}
EULER = {"yaw": "euler1_rad", "pitch": "euler2_rad", "roll": "euler3_rad"}
JOINTS = {f"j{k}": f"q{k}_rad" for k in range(1, 7)}
TRANSPOSED = {f"r{i}{j}": f"r{j}{i}" for i in (1, 2, 3) for j in (1, 2, 3)}
ROLLED = dict(zip(QUATERNION, ("qx", "qy", "qz", "qw"), strict=True))

#: What is wrong: the columns, the conventions, and what must be said, or refused with.
WRONG: dict[str, tuple[dict[str, str], dict[str, object], str]] = {
    "matrix transposed": (TRANSPOSED, {}, "transposed"),
    "matrix stated the other way": (MATRIX, {"rotation": "tool<-base"}, "transposed"),
    "matrix with two columns exchanged": ({**MATRIX, "r11": "r12", "r12": "r11"}, {}, "no rotations"),
    "matrix left-handed": ({**MATRIX, **{f"r3{j}": f"-r3{j}" for j in (1, 2, 3)}}, {}, "left-handed"),
    "quaternion of the other order": (ROLLED, {}, "quaternion in the order"),
    "quaternion of the other direction": (QUATERNION, {"rotation": "tool<-base"}, "transposed"),
    "Euler angles of another order": (EULER, {"euler": "XYZ"}, "euler = "),
    "Euler angles about fixed axes": (EULER, {"euler": "zyx"}, "euler = "),
    "radians as degrees": ({f"j{k}": f"q{k}_deg" for k in range(1, 7)}, {}, "in radians, not degrees"),
    "a joint of the other sign": ({**JOINTS, "j5": "-q5_rad"}, {}, "wrist_2_joint of the other sign"),
    "the roll of the other sign": ({**JOINTS, "j6": "-q6_rad"}, {}, "wrist_3_joint of the other sign"),
    "two joints exchanged": ({**JOINTS, "j5": "q6_rad", "j6": "q5_rad"}, {}, "wrist_2_joint and wrist_3_joint"),
    "joints in reverse": ({f"j{k}": f"q{7 - k}_rad" for k in range(1, 7)}, {}, "in reverse order"),
    "two sensor axes exchanged": ({**JOINTS, "ax": "accel2_g", "ay": "accel1_g"}, {}, "mirrored"),
    "a mirrored axis of the magnetometer": ({**JOINTS, "mz": "-mag3_uT"}, {}, "magnetometer: left-handed"),
    "sensor axes turned round": (
        {**JOINTS, "ax": "accel2_g", "ay": "accel3_g", "az": "accel1_g"},
        {},
        "axes in the tool",
    ),
    "g as m/s^2": ({**JOINTS, **{f"a{a}": f"accel{k}_m_s2" for k, a in enumerate("xyz", 1)}}, {}, "its unit?"),
    "uT as G": ({**JOINTS, **{f"m{a}": f"mag{k}_G" for k, a in enumerate("xyz", 1)}}, {}, "its unit?"),
    "a joint that is missing": ({k: v for k, v in JOINTS.items() if k != "j3"}, {}, "part 3 is missing"),
    "a reading down stated as up": (JOINTS, {"accelerometer_reads": "g-a"}, "axes are left-handed"),
    "a column that is not there": ({**JOINTS, "temp": "temperature_degC"}, {}, "no log has a column 'temp'"),
    "a convention that is none": (EULER, {"euler": "ZYQ"}, "expected three axes"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_mapping_is_named_or_refused(tmp_path: Path, run: Recording, arm: Arm, case: str) -> None:
    poses, conventions, expected = WRONG[case]
    path = write_text(tmp_path / "log.csv", tool_table(run, arm))
    try:
        found = imported([path], arm, {**READINGS, **poses}, **conventions)
        # where the sensor's axes point is no mistake: a calibration finds them
        findings = found.said if expected == "axes in the tool" else found.findings
    except RigError as refused:
        findings = (str(refused),)
    assert any(expected in line for line in findings), findings


@pytest.mark.parametrize("poses", [QUATERNION, MATRIX, EULER, JOINTS], ids=["quaternion", "matrix", "euler", "joints"])
def test_a_right_mapping_is_not_doubted(tmp_path: Path, run: Recording, arm: Arm, poses: dict[str, str]) -> None:
    found = imported([write_text(tmp_path / "log.csv", tool_table(run, arm))], arm, {**READINGS, **poses})
    assert not [line for line in found.findings if line.startswith("poses")], found.findings


def test_a_late_clock_is_stated(tmp_path: Path, run: Recording, arm: Arm) -> None:
    columns = tool_table(run, arm)
    sensors = {name: values for name, values in columns.items() if name in READINGS}
    poses = {"t": columns["t"] + 0.2, **{name: columns[name] for name in JOINTS}}
    paths = [write_text(tmp_path / "imu.csv", sensors), write_text(tmp_path / "arm.csv", poses)]
    found = imported(paths, arm, {**READINGS, **JOINTS})
    assert any(line.startswith("clock: the readings follow the poses best with -0.") for line in found.findings)


def test_the_papers_angles_fill_in_the_locked_joints(tmp_path: Path) -> None:
    run = scenarios.load("renk2005-accelerometer").simulate(seed=0).select(slice(None, None, 20))
    columns = {"t": run.t}
    columns |= {
        f"theta{joint}_deg": np.degrees(run.q[:, joint - 1]) + zero for joint, zero in ((1, 90), (5, 0), (6, 180))
    }
    columns |= {f"accel{k + 1}_V": run.accelerometer[:, k] for k in range(3)}
    found = imported([write_text(tmp_path / "log.csv", columns)], Arm.a465(), angles="renk2005")
    np.testing.assert_allclose(found.recording.q, run.q, atol=1e-9)


@pytest.mark.skipif(not SHARED.is_dir(), reason="the measured data sets are not here")
def test_a_measured_log_needs_no_editing() -> None:
    folder = SHARED / "realdata" / "kuka_lbr"
    found = import_logs([folder / "0-calibration_fts-accel.csv"], None, None)
    assert found.recording.metadata.accelerometer_reads == "a-g"
    calibration = estimators.calibrate(found.recording)["accelerometer"]
    assert calibration.axes is not None
    np.testing.assert_allclose(calibration.values[0] * 9.8, 1.007, atol=0.01)  # g/g, as found by other means
    moving = import_logs([folder / "1-baseline_accel.csv", folder / "1-baseline_orientations.csv"], None, None)
    assert moving.recording.metadata.pose_rate_Hz == pytest.approx(99.2, abs=0.5)


def test_what_a_recording_leaves_open_is_said_and_can_be_stated(
    rig: Rig, tmp_path: Path, run: Recording, arm: Arm
) -> None:
    path = tmp_path / "bare.csv"
    run.write(path)
    lines = path.read_text().splitlines()
    lines[1] += ",theta1"
    path.write_text("\n".join([lines[1], *(f"{line},0.5" for line in lines[2:])]) + "\n")
    result = rig("calibrate", path, "--arm", arm.file, "--json")
    assert "columns not used: theta1 (Renk's angles? rig import --angles renk2005 takes them)" in result.err
    first = json.loads(result.out)["sensors"]["accelerometer"]
    assert any("gravity is not stated: 9.8 m/s^2 taken" in text for text in first["quality"]["warnings"])
    second = json.loads(rig("calibrate", path, "--arm", arm.file, "--gravity", "9.9", "--json").out)
    second = second["sensors"]["accelerometer"]
    assert not any("is not stated" in text for text in second["quality"]["warnings"])
    assert second["values"][0] == pytest.approx(first["values"][0] * 9.8 / 9.9, rel=1e-6)
    assert rig("check", path, "--arm", arm.file).status == 1


def test_what_nobody_stated_is_not_stated_by_the_import(rig: Rig, tmp_path: Path, run: Recording, arm: Arm) -> None:
    log = write_text(tmp_path / "log.csv", table(run))
    made, own = tmp_path / "run.parquet", written(tmp_path, "ur5e")
    rig.done("import", log, "--arm", own, "-o", made)
    assert read_recording(made).metadata.assumed == ("gravity_m_s2", "magnetic_field")
    found = json.loads(rig("check", made, "--arm", own, "--json").out)["findings"]
    assert sum("is not stated" in line for line in found) == 2
    shown = rig("calibrate", made, "--arm", own, "--json")
    assert "gravity is not stated: 9.8" in shown.out
    assert "gravity is not stated" not in rig("calibrate", made, "--arm", own, "--gravity", "9.81", "--json").out
    rig.done("import", log, "--arm", own, "-o", made, "--gravity", "9.81", "--field", "55uT")
    assert read_recording(made).metadata.assumed == ()
    known = read_recording(made).metadata
    with pytest.raises(RigError, match=r"metadata assumed: found .*expected a list of gravity_m_s2, magnetic_field"):
        replace(known, assumed=("rate_Hz",))


def test_check_reads_diagnoses_and_causes(rig: Rig, tmp_path: Path) -> None:
    cause = {"effect": "backlash", "where": "joint5", "parameters": {"width_rad": 0.01}}
    assert "effects      backlash at joint5" in rig.done("check", written_json(tmp_path, cause))
    assert "nearest: 'backlash'" in rig.refused("check", written_json(tmp_path, {**cause, "effect": "bakclash"}))
    half = {"format": "rig-diagnosis/2", "verdict": "named"}
    assert "no 'where'" in rig.refused("check", written_json(tmp_path, half))
    for content in (None, 5, "x", {}):
        assert "or a cause" in rig.refused("check", written_json(tmp_path, content))


def written_json(folder: Path, content: object) -> Path:
    path = folder / "some.json"
    path.write_text(json.dumps(content))
    return path


def test_a_table_of_blanks_has_its_names_in_a_comment(tmp_path: Path, run: Recording, arm: Arm) -> None:
    """As ``numpy.savetxt`` writes it."""
    columns = {
        name.replace(" [", "_").replace(" (", "_").rstrip("])").replace(" ", "_"): x for name, x in table(run).items()
    }
    np.savetxt(tmp_path / "log.txt", np.column_stack(list(columns.values())), header=" ".join(columns))
    same(imported([tmp_path / "log.txt"], arm).recording, run)
    (tmp_path / "bad.txt").write_text("# a b\n1 2\n3 4 5\n")
    with pytest.raises(RigError, match=r"bad\.txt: not a table of numbers"):
        imported([tmp_path / "bad.txt"], arm)


def test_a_log_without_times_is_of_poses_held_still(tmp_path: Path, run: Recording, arm: Arm) -> None:
    columns = {name: values for name, values in table(run).items() if "Timestamp" not in name}
    found = imported([write_text(tmp_path / "log.csv", columns)], arm)
    assert found.recording.metadata.still_poses
    np.testing.assert_array_equal(found.recording.t, np.arange(len(run)))
    assert any(line.startswith("no time: each of the") for line in found.said)


def test_an_arm_that_is_not_the_rigs_own_is_asked_for(rig: Rig, here: Path, run: Recording) -> None:
    """Six joints that are numbered: within the limits of the rig's own arm they are taken for its, beyond them not."""
    own = scenarios.load("./small.toml").simulate(0)
    for recording, name in ((run, "unknown"), (own, "a465")):
        columns = {"t [s]": run.t[:500], **{f"Acc {x} [g]": run.accelerometer[:500, k] for k, x in enumerate("XYZ")}}
        columns |= {f"q{k + 1} [rad]": recording.q[:500, k] for k in range(6)}
        found = imported([write_text(here / "log.csv", columns)], None)
        assert found.recording.metadata.arm == name
        assert any("without --arm FILE" in line and ("a465" in line) == (name == "a465") for line in found.findings)
    replace(found.recording, q=run.q[:500]).write("other.parquet")
    refused = rig.refused("calibrate", "other.parquet")
    assert "of arm 'a465'; the model of another arm is stated by --arm FILE" in refused


def test_degrees_under_the_name_of_radians_are_said(tmp_path: Path) -> None:
    """Of an arm that nobody stated; the sweep itself, of more than 100 rad, is as it should be."""
    swept = scenarios.load("ann-arbor").simulate(seed=0)
    assert np.ptp(swept.q[:, 5]) > 100.0
    for factor, wrong in ((1.0, False), (np.degrees(1.0), True)):
        columns = {"t [s]": swept.t, **{f"Acc {axis} [V]": swept.accelerometer[:, k] for k, axis in enumerate("XYZ")}}
        columns |= {f"q{k + 1} [rad]": factor * swept.q[:, k] for k in range(6)}
        found = imported([write_text(tmp_path / "log.csv", columns)], None)
        assert any("degrees" in line for line in found.findings) == wrong


def test_three_angles_of_a_pose_are_known_by_their_names(tmp_path: Path, run: Recording, arm: Arm) -> None:
    columns = {name: x for name, x in tool_table(run, arm).items() if name[0] in "tamyp" or name == "roll"}
    found = imported([write_text(tmp_path / "log.csv", columns)], arm, euler="ZYX")
    turns = Rotation.from_quat(found.recording.tool_quaternion, scalar_first=True)
    expected = Rotation.from_matrix(arm.poses(run.q).R_base_tool)
    assert (turns.inv() * expected).magnitude().max() < 1e-6
