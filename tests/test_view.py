"""The rerun view: what is in the file, that it is true to the recording, and that it looks right when it opens."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import Chunk, RrdReader
from scipy.spatial.transform import Rotation
from view_examples import calibration, tool_poses, view  # noqa: F401  (fixtures)

import estimators
from estimators.calibration import Calibration
from rig.arm import Arm
from rig.channels import ACCELEROMETER, CHANNELS, CHANNELS_OF, MAGNETOMETER, SENSORS
from rig.errors import RigError
from rig.recording import Recording
from scenarios.decimation import evenly
from scenarios.overlay import overlays
from scenarios.sensor_motion import motion
from scenarios.view import write_view
from scenarios.view.viewer import viewer_environment, viewer_program
from scenarios.view.write import BRISTLES, FRAMES, POINTS, SAMPLES

SECOND_NS = 1_000_000_000
#: Poses are stored in single precision: seven rotations and offsets of at most 1 m multiplied up, half an ulp each.
SINGLE = 7 * 4 * float(np.finfo(np.float32).eps)

needs_unix = pytest.mark.skipif(sys.platform == "win32", reason="stands in for the viewer with a shell script")


def chunks(path: Path) -> list[Chunk]:
    return list(RrdReader(path).stream())


def entities(path: Path) -> set[str]:
    return {chunk.entity_path for chunk in chunks(path)}


def column(path: Path, entity: str, component: str) -> tuple[np.ndarray, list]:
    """Times [s] and values of a component of a moving entity, in the order of time."""
    times, values = [], []
    for chunk in chunks(path):
        batch = chunk.to_record_batch()
        if chunk.entity_path == entity and not chunk.is_static and component in batch.schema.names:
            times += [
                int(at.value) if hasattr(at, "value") else int(at) for at in batch.column("t").cast("int64").to_pylist()
            ]
            values += batch.column(component).to_pylist()
    order = np.argsort(times, kind="stable")
    return np.array(times)[order] / SECOND_NS, [values[row] for row in order]


def static(path: Path, entity: str, component: str) -> list:
    for chunk in chunks(path):
        batch = chunk.to_record_batch()
        if chunk.entity_path == entity and chunk.is_static and component in batch.schema.names:
            return batch.column(component).to_pylist()[0]
    raise AssertionError(f"no static {component} on {entity}")


def scalars(path: Path, entity: str) -> tuple[np.ndarray, np.ndarray]:
    times, values = column(path, entity, "Scalars:scalars")
    return times, np.array(values)


def joint_transforms(path: Path, arm: Arm) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (m,), rotations (m, N, 3, 3) and positions (m, N, 3) of the links, multiplied up joint by joint."""
    rotation, position, times = np.eye(3)[None], np.zeros((1, 3)), np.zeros(0)
    rotations, positions = [], []
    for name in arm.joint_names:
        times, quaternions = column(path, f"/transforms/{name}", "Transform3D:quaternion")
        _, translations = column(path, f"/transforms/{name}", "Transform3D:translation")
        step = Rotation.from_quat(np.array(quaternions)[:, 0]).as_matrix()
        position = position + np.einsum(
            "mij,mj->mi", np.broadcast_to(rotation, step.shape), np.array(translations)[:, 0]
        )
        rotation = rotation @ step
        rotations.append(rotation)
        positions.append(position)
    return times, np.stack(rotations, axis=1), np.stack(positions, axis=1)


def test_the_viewer_itself_finds_the_file_sound(view: Path) -> None:
    done = subprocess.run(
        [str(viewer_program()), "rrd", "verify", str(view)], env=viewer_environment(), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert "without error" in done.stdout + done.stderr


def test_everything_is_in_the_file(view: Path) -> None:
    found = entities(view)
    wanted = {f"/transforms/joint{number}" for number in range(1, 7)} | {"/transforms/sensor"}
    wanted |= {f"/sweep/{part}" for part in ("bristles", "path", "sensor", "fields")}
    for sensor in SENSORS:
        for channel in CHANNELS_OF[sensor]:
            wanted |= {
                f"/readings/{sensor}/{channel}",
                f"/residuals/{sensor}/{channel}",
                f"/residuals/{sensor}/{channel}/band",
                f"/directions/{sensor}/{channel}/seen",
                f"/directions/{sensor}/{channel}/now",
            }
    assert wanted <= found
    assert any(path.startswith("/arm/a465/visual_geometries/link6/") for path in found)


def test_the_one_timeline_spans_the_recording(view: Path, recording: Recording) -> None:
    assert {name for chunk in chunks(view) for name in chunk.timeline_names} == {"t"}
    for entity, component in (
        ("/transforms/joint1", "Transform3D:quaternion"),
        ("/readings/magnetometer/mag3", "Scalars:scalars"),
    ):
        times, _ = column(view, entity, component)
        assert times[[0, -1]] == pytest.approx(recording.t[[0, -1]], abs=1e-9)  # the file counts nanoseconds


def test_the_arm_is_where_mujoco_puts_it(view: Path, recording: Recording) -> None:
    arm = Arm.a465()
    times, rotation, position = joint_transforms(view, arm)
    rows = evenly(len(recording), FRAMES)
    assert len(times) == len(rows) == FRAMES
    expected = arm.link_poses(recording.q[rows])
    assert np.abs(rotation - expected.rotation).max() < SINGLE
    assert np.abs(position - expected.position).max() < SINGLE


def test_the_sensor_and_its_bristles_are_where_the_arm_holds_them(view: Path, recording: Recording) -> None:
    arm = Arm.a465()
    rows = evenly(len(recording), FRAMES)
    poses = arm.poses(recording.q[rows])
    _, translations = column(view, "/transforms/sensor", "Transform3D:translation")
    _, matrices = column(view, "/transforms/sensor", "Transform3D:mat3x3")
    assert np.abs(np.array(translations)[:, 0] - poses.position).max() < SINGLE
    stored = np.array(matrices)[:, 0].reshape(-1, 3, 3).swapaxes(1, 2)  # column by column
    assert np.abs(stored - poses.R_base_tool).max() < SINGLE
    kept = rows[evenly(len(rows), BRISTLES)]
    strips = np.array(static(view, "/sweep/bristles", "LineStrips3D:strips"))
    wrist = arm.link_poses(recording.q[kept]).position[:, 4]  # frame 5 lies in the wrist
    assert np.abs(strips - np.stack([wrist, arm.poses(recording.q[kept]).position], axis=1)).max() < SINGLE
    # The torus: wrists on a circle of the forearm's 330.2 mm about joint 1, sensors 106.2 mm from them.
    assert np.hypot(*strips[:, 0, :2].T) == pytest.approx(0.3302, abs=1e-6)
    assert np.linalg.norm(strips[:, 1] - strips[:, 0], axis=1) == pytest.approx(0.1062, abs=1e-6)


@pytest.mark.parametrize("channel", CHANNELS)
def test_readings_residuals_and_band(channel: str, view: Path, recording: Recording, calibration: Calibration) -> None:
    sensor = ACCELEROMETER if channel in CHANNELS_OF[ACCELEROMETER] else MAGNETOMETER
    k = CHANNELS_OF[sensor].index(channel)
    times, values = scalars(view, f"/readings/{sensor}/{channel}")
    assert np.array_equal(values[:, 0], recording.readings(sensor)[:, k])  # short enough to be shown as it is
    assert times == pytest.approx(recording.t, abs=1e-9)
    part = calibration[sensor]
    times, values = scalars(view, f"/residuals/{sensor}/{channel}")
    # The file's residuals, in mV, are those the fit itself reports.
    assert np.sqrt(np.square(values).mean()) == pytest.approx(1e3 * part.fit_rms[k], rel=1e-9)
    _, band = scalars(view, f"/residuals/{sensor}/{channel}/band")
    three = 3e3 * part.noise[k]
    assert band == pytest.approx(np.array([[three, -three]] * 2))
    assert static(view, f"/readings/{sensor}/{channel}", "SeriesLines:names") == [f"{channel} [V]"]
    assert static(view, f"/residuals/{sensor}/{channel}", "SeriesLines:names") == [f"{channel} [mV]"]


def test_the_spheres_hold_the_directions_the_sensor_saw(
    view: Path, recording: Recording, calibration: Calibration
) -> None:
    rows = evenly(len(recording), POINTS)
    R = Arm.a465().poses(recording.q[rows]).R_base_tool
    for sensor in SENSORS:
        field = calibration[sensor].field_direction.vector
        points = np.array(static(view, f"/directions/{sensor}/{CHANNELS_OF[sensor][0]}/seen", "Points3D:positions"))
        assert np.abs(points - np.einsum("nij,i->nj", R, field)).max() < SINGLE


def test_a_long_recording_keeps_its_peaks_and_stays_small(
    recording: Recording, calibration: Calibration, tmp_path: Path
) -> None:
    times = np.arange(166_400) / 100.0
    again = np.arange(166_400) % len(recording)
    readings = recording.accelerometer[again].copy()
    readings[77_777, 1] = 4.99  # one sample of 166,400
    long = Recording(t=times, q=recording.q[again], accelerometer=readings)
    path = tmp_path / "long.rrd"
    write_view(long, calibration, path)
    at, values = scalars(path, "/readings/accelerometer/accel2")
    assert len(at) <= SAMPLES + 2
    assert values.max() == 4.99
    assert at[values[:, 0].argmax()] == pytest.approx(777.77, abs=1e-9)
    assert at[[0, -1]] == pytest.approx(times[[0, -1]], abs=1e-9)
    assert path.stat().st_size < 10e6
    assert len(column(path, "/transforms/joint6", "Transform3D:quaternion")[0]) == FRAMES


def test_the_blueprint_shows_the_whole_time(view: Path, recording: Recording) -> None:
    reader = RrdReader(view)
    [store] = reader.blueprints()
    ranges, classes, timelines = [], [], []
    for chunk in reader.stream(store=store):
        batch = chunk.to_record_batch()
        for name, into in (
            ("TimeAxis:view_range", ranges),
            ("ViewBlueprint:class_identifier", classes),
            ("TimePanelBlueprint:timeline", timelines),
        ):
            if name in batch.schema.names:
                into += batch.column(name).to_pylist()[0]
    assert sorted(classes) == ["3D"] * 3 + ["TimeSeries"] * 8  # readings, three residuals and spheres a sensor; the arm
    assert timelines == ["t"]
    assert len(ranges) == 8
    for shown in ranges:
        span = np.array([shown["start"], shown["end"]], dtype=float) / SECOND_NS
        assert span == pytest.approx(recording.t[[0, -1]])


def test_tool_poses_show_the_sensor_without_an_arm(tool_poses: Recording, tmp_path: Path) -> None:
    path = tmp_path / "tool.rrd"
    write_view(tool_poses, estimators.calibrate(tool_poses), path)
    found = entities(path)
    assert {"/sweep/bristles", "/transforms/sensor", "/residuals/magnetometer/mag1"} <= found
    assert not any(entity.startswith(("/arm", "/transforms/joint")) for entity in found)
    kept = evenly(len(tool_poses), FRAMES)[evenly(FRAMES, BRISTLES)]
    strips = np.array(static(path, "/sweep/bristles", "LineStrips3D:strips"))
    assert np.abs(strips[:, 1] - tool_poses.tool_position[kept]).max() < SINGLE


def test_an_attitude_alone_makes_a_sphere_of_bristles(tool_poses: Recording) -> None:
    rows = evenly(len(tool_poses), 50)
    found = motion(replace(tool_poses, tool_position=None), None, rows)
    assert found.root == pytest.approx(np.zeros((50, 3)))
    assert found.tip == pytest.approx(0.1 * found.R_base_tool[:, :, 2])


def test_without_any_pose_there_are_magnitudes(recording: Recording, calibration: Calibration, tmp_path: Path) -> None:
    hand = replace(recording, q=None, metadata=replace(recording.metadata, arm="none"))
    path = tmp_path / "hand.rrd"
    write_view(hand, calibration, path)
    found = entities(path)
    assert "/residuals/accelerometer/accelerometer_magnitude" in found
    assert not any(entity.startswith(("/sweep", "/arm", "/transforms")) for entity in found)
    laid = overlays(hand, calibration, None)[MAGNETOMETER]
    assert laid.field is None
    # Magnitudes have the readings' noise along the field: their RMS is the predicted sigma within the sampling error of
    # an RMS of 6,656 samples, 1/sqrt(2n) = 0.9 %; five times that fails once in 2 million runs. (The fit's own errors
    # are some 1e-2 of the noise.)
    assert np.sqrt(np.square(laid.residuals).mean()) == pytest.approx(laid.sigma[0], rel=0.045)


def test_without_a_calibration_there_are_readings(recording: Recording, tmp_path: Path) -> None:
    path = tmp_path / "plain.rrd"
    write_view(recording, None, path)
    found = entities(path)
    assert {"/directions/accelerometer/readings/seen", "/readings/accelerometer/accel1", "/sweep/bristles"} <= found
    assert not any(entity.startswith(("/residuals", "/sweep/fields")) for entity in found)
    points = np.array(static(path, "/directions/accelerometer/readings/seen", "Points3D:positions"))
    assert np.abs(points).max() == pytest.approx(1.0, abs=0.02)  # half the range of the widest channel


def test_an_arm_without_shapes_is_a_stick_figure(
    recording: Recording, calibration: Calibration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("scenarios.view.geoms.shapes_of", lambda arm: [])
    arm = replace(Arm.a465(), urdf=None)
    path = tmp_path / "sticks.rrd"
    monkeypatch.setattr("scenarios.view.write.FRAMES", 20)
    write_view(recording, calibration, path, arm)
    times, strips = column(path, "/arm", "LineStrips3D:strips")
    assert len(times) == 20
    rows = evenly(len(recording), 20)
    points = np.array(strips)[:, 0]
    assert points.shape == (20, 8, 3)  # base, six links, sensor
    assert np.abs(points[:, 1:7] - arm.link_poses(recording.q[rows]).position).max() < SINGLE
    assert np.abs(points[:, 7] - arm.poses(recording.q[rows]).position).max() < SINGLE


def test_separate_fits_are_laid_over_with_a_field_each(recording: Recording) -> None:
    separate = estimators.calibrate(recording, method="separate")
    for sensor, laid in overlays(recording, separate, Arm.a465()).items():
        assert np.sqrt(np.square(laid.residuals).mean(axis=0)) == pytest.approx(
            1e3 * separate[sensor].fit_rms, rel=1e-9
        )


def test_a_single_sample_can_be_seen(recording: Recording, calibration: Calibration, tmp_path: Path) -> None:
    path = tmp_path / "one.rrd"
    write_view(recording.select(slice(0, 1)), calibration, path)
    assert len(column(path, "/transforms/joint1", "Transform3D:quaternion")[0]) == 1


def test_nothing_is_written_when_something_is_wrong(
    recording: Recording, calibration: Calibration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "wrong.rrd"
    lost = replace(Arm.a465(), urdf=tmp_path / "lost.urdf")
    with pytest.raises(RigError, match=r"lost\.urdf"):
        write_view(recording, calibration, path, lost)
    other = replace(Arm.a465(), joint_names=("joint1", "joint2", "joint3", "joint4", "joint5", "wrist"))
    with pytest.raises(RigError, match="no joint 'wrist'"):
        write_view(recording, calibration, path, other)
    in_millivolts = replace(recording, units={ACCELEROMETER: "mV"})
    with pytest.raises(RigError, match="recorded in mV, expected the calibration's V"):
        write_view(in_millivolts, calibration, path)
    with pytest.raises(RigError, match="does not exist"):
        write_view(recording, calibration, tmp_path / "no" / "where.rrd")
    monkeypatch.setenv("RERUN", "off")
    with pytest.raises(RigError, match="RERUN=off"):
        write_view(recording, calibration, path)
    assert list(tmp_path.iterdir()) == []


@needs_unix
def test_a_view_that_does_not_fit_is_no_view(recording: Recording, tmp_path: Path) -> None:
    """As on a full disk: one line, status 2 and no file, where the viewer's library reports success."""
    recording.write(tmp_path / "run.parquet")
    program = (
        "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))\n"
        "from scenarios.cli import main; main()"
    )
    command = [sys.executable, "-c", program, "view", "run.parquet", "-o", "run.rrd"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("rig: run.rrd: cannot be written whole (is the disk full?): 300000 bytes were; ")
    assert done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["run.parquet"]
