"""Poses of a slower log, repeated until the next one came: straight lines between them are nearer to the motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

import scenarios
from estimators.dispatch import calibrate
from estimators.gap.data.basefit import fitted_model, posed
from estimators.goodness import judged, judged_together, robust_calibrate
from estimators.goodness.residuals import residuals_of
from rig.arm import Arm
from rig.pose_nodes import quaternions
from rig.recording import Recording
from rig.recording.block_means import block_means, joined
from rig.recording.recording_files import scan_recording
from rig.recording.repeated_poses import evenly_posed, repeated, straight_between
from rig.stream.straight_poses import StraightPoses

EVERY = 5


@pytest.fixture(scope="module")
def run() -> Recording:
    return scenarios.load("ann-arbor").with_acquisition(decimation=25).simulate(seed=1)


def rows_of(count: int, uneven: bool) -> np.ndarray:
    """The row of the pose that stands in each of so many rows; of logs with clocks of their own, one more at times."""
    lengths = EVERY + (np.arange(count) % 7 == 3) * uneven
    starts = np.concatenate([[0], np.cumsum(lengths)])
    return starts[np.searchsorted(starts, np.arange(count), side="right") - 1]


@pytest.mark.parametrize("uneven", [False, True])
def test_joint_angles_are_the_logs_own_where_they_were_read(run: Recording, uneven: bool) -> None:
    assert run.q is not None
    own = rows_of(len(run), uneven)
    held = replace(run, q=run.q[own])
    found = repeated(held)
    assert found is not None
    np.testing.assert_array_equal(found.starts, np.unique(own))
    straight = straight_between(held)
    assert straight.q is not None
    kept = np.searchsorted(run.t, straight.t)
    nodes = found.starts[1:]
    at = 0.5 * (run.t[nodes] + run.t[nodes - 1]) if uneven else run.t[nodes]
    lines = np.stack([np.interp(straight.t, at, column[nodes]) for column in run.q.T], axis=1)
    np.testing.assert_allclose(straight.q, lines, atol=1e-12)
    assert len(run) - len(kept) < 3 * EVERY
    assert repeated(straight) is None
    assert straight_between(run) is run


@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize("size", [1, 3, 64, 999])
def test_a_streams_poses_are_those_of_the_whole(run: Recording, uneven: bool, size: int) -> None:
    """In batches of any size, over a pause: once some forty poses are known, and but for what waits at the end."""
    assert run.q is not None
    at = np.minimum(np.arange(2000), 1000) + np.maximum(np.arange(2000) - 1402, 0)
    readings = {sensor: run.readings(sensor)[at] for sensor in run.sensors}
    held = replace(run.select(slice(0, 2000)), q=run.q[at[rows_of(2000, uneven)]], **readings)
    straight, whole = StraightPoses(), straight_between(held)
    parts = [straight(held.select(slice(first, first + size))) for first in range(0, len(held), size)]
    found = joined([part for part in parts if part is not None])
    assert "straight lines are put between them" in straight.words
    assert (np.diff(found.t) > 0.0).all()
    assert set(whole.t) <= set(found.t)
    later = found.t > held.t[40 * EVERY + size]
    assert found.q is not None
    assert whole.q is not None
    own = np.searchsorted(whole.t, found.t[later])
    np.testing.assert_allclose(found.q[later], whole.q[own], atol=1e-9)


@pytest.mark.parametrize("own_joints", [True, False])
def test_a_streams_kinds_of_poses_are_asked_each_by_itself(run: Recording, arm: Arm, own_joints: bool) -> None:
    """Tool poses are held for seven rows; joint angles are each sample's own, or held for five."""
    assert run.q is not None
    tool = quaternions(run.rotations(arm).reshape(-1, 3, 3))[np.arange(len(run)) // 7 * 7]
    joints = run if own_joints else replace(run, q=run.q[rows_of(len(run), uneven=False)])
    stream, straight = replace(joints, tool_quaternion=tool), StraightPoses()
    parts = [straight(stream.select(slice(first, first + 50))) for first in range(0, 2000, 50)]
    found, true = joined([part for part in parts if part is not None]), straight_between(joints)
    assert straight.words
    later = found.t > run.t[300]
    assert later.sum() > 1600
    assert found.q is not None
    assert true.q is not None
    np.testing.assert_allclose(found.q[later], true.q[np.searchsorted(true.t, found.t[later])], atol=1e-9)


def test_a_stream_of_poses_of_its_own_is_as_it_is(run: Recording) -> None:
    straight = StraightPoses()
    batches = [run.select(slice(first, first + 50)) for first in range(0, 500, 50)]
    for batch in batches:
        given = straight(batch)
        assert given is not None
        np.testing.assert_array_equal(given.t, batch.t)
    assert not straight.words


def test_a_coarse_encoder_is_no_slower_log(run: Recording) -> None:
    """At 64 Hz, angles rounded to half a degree stand for some six rows: one joint's change while another's do not."""
    assert run.q is not None
    fine, rng = np.arange(32_000) / 16.0, np.random.default_rng(3)

    def finer(values: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(fine, np.arange(len(run)), column) for column in values.T], axis=1)

    readings = {name: finer(run.readings(name)) for name in run.sensors}
    readings = {name: each + 0.01 * rng.standard_normal(each.shape) for name, each in readings.items()}
    step = np.deg2rad(0.5)
    q = np.round(finer(run.q) / step) * step
    rounded = Recording(t=fine / 4.0, q=q, units=run.units, metadata=run.metadata, **readings)
    assert repeated(rounded) is None


def test_a_sensor_that_settles_in_each_pose_is_no_slower_log(run: Recording) -> None:
    """Poses are held for twenty rows, and a first-order lag of three is left of each move."""
    assert run.q is not None
    own = np.arange(len(run)) // 20 * 20
    settled = {
        name: lfilter([1.0 - np.exp(-1.0 / 3.0)], [1.0, -np.exp(-1.0 / 3.0)], run.readings(name)[own], axis=0)
        for name in run.sensors
    }
    assert repeated(replace(run, q=run.q[own], **settled)) is None


def test_one_lost_row_makes_no_clock_of_its_own(run: Recording) -> None:
    assert run.q is not None
    held = replace(run, q=run.q[rows_of(len(run), uneven=False)])
    found = repeated(held.select(np.arange(len(run)) != 3001))
    assert found is not None
    assert found.late == 0.0


def test_a_log_that_begins_anew_turns_no_joint_further_than_it_goes(run: Recording) -> None:
    """Half of the rows are gone, and joint 6 stands half a turn and more away where it goes on."""
    assert run.q is not None
    held = replace(run, q=run.q[rows_of(len(run), uneven=False)])
    assert held.q is not None
    apart = np.abs(held.q[1000] - held.q[:, None][4000:4200, 0]).max(axis=1)
    again = 4000 + int(np.argmax(apart)) // EVERY * EVERY
    rows = np.arange(len(run))
    straight = straight_between(held.select((rows < 1000) | (rows >= again)))
    assert straight.q is not None
    kept = np.searchsorted(run.t, straight.t)
    assert np.abs(straight.q - held.q[kept]).max() < np.pi
    assert not ((straight.t > run.t[1000 - EVERY]) & (straight.t < run.t[again])).any()


def test_each_kind_of_poses_is_asked_by_itself(run: Recording, arm: Arm) -> None:
    """Joint angles are held, and the tool's poses are each sample's own: or the other way round."""
    assert run.q is not None
    own = rows_of(len(run), uneven=False)
    tool = quaternions(run.rotations(arm).reshape(-1, 3, 3))
    one = straight_between(replace(run, q=run.q[own], tool_quaternion=tool))
    kept = np.searchsorted(run.t, one.t)
    np.testing.assert_array_equal(one.tool_quaternion, tool[kept])
    other = straight_between(replace(run, tool_quaternion=tool[own]))
    np.testing.assert_array_equal(other.q, run.q[np.searchsorted(run.t, other.t)])
    for each in (one, other):
        assert 0 < len(run) - len(each) < 3 * EVERY


def test_a_file_that_begins_at_rest_is_asked_where_the_arm_moves(run: Recording, tmp_path: Path) -> None:
    assert run.q is not None
    held = replace(run, q=run.q[rows_of(len(run), uneven=False)])
    rest = 3000
    at = np.maximum(np.arange(len(run) + rest) - rest, 0)
    readings = {sensor: run.readings(sensor)[at] for sensor in run.sensors}
    assert held.q is not None
    Recording(t=0.25 * np.arange(len(at)), q=held.q[at], units=run.units, metadata=run.metadata, **readings).write(
        tmp_path / "late.parquet"
    )
    straight, words = evenly_posed(scan_recording(tmp_path / "late.parquet", batch_rows=1000))
    assert isinstance(straight, Recording)
    assert ["each pose is repeated in 5 rows" in each for each in words] == [True]


def test_a_pause_on_one_clock_moves_no_pose(run: Recording) -> None:
    """The arm stands still for three poses' time, as the log says: lines begin where it moves on, and no pose is
    later."""
    assert run.q is not None
    q, rows = run.q.copy(), rows_of(len(run), uneven=False)
    paused = slice(200 * EVERY, 203 * EVERY)
    q[paused] = q[paused.start]
    straight = straight_between(replace(run, q=q[rows]))
    assert straight.q is not None
    node = rows[np.searchsorted(run.t, straight.t)] == np.searchsorted(run.t, straight.t)
    np.testing.assert_allclose(straight.q[node], q[np.searchsorted(run.t, straight.t)][node], atol=1e-12)


def test_angles_that_wrap_are_no_whole_turns(run: Recording) -> None:
    assert run.q is not None
    wrapped = np.mod(run.q + np.pi, 2.0 * np.pi) - np.pi
    rows = rows_of(len(run), uneven=False)
    one, other = (straight_between(replace(run, q=q[rows])).q for q in (run.q, wrapped))
    assert one is not None
    assert other is not None
    np.testing.assert_allclose(np.cos(other), np.cos(one), atol=1e-9)
    np.testing.assert_allclose(np.sin(other), np.sin(one), atol=1e-9)


def test_steps_below_the_noise_are_found(run: Recording) -> None:
    """Many of them tell, as the noise is the same whichever way the arm goes."""
    assert run.q is not None
    fast = scenarios.load("ann-arbor").with_acquisition(decimation=4).simulate(seed=2)
    assert fast.q is not None
    assert repeated(replace(fast, q=fast.q[np.arange(len(fast)) // 2 * 2])) is not None


def test_means_of_a_long_recording_are_made_of_steps_as_of_others(run: Recording, tmp_path: Path) -> None:
    """Where memory is short: poses that are repeated leave no rows out."""
    assert run.q is not None
    held = replace(run, q=run.q[rows_of(len(run), uneven=False)])
    held.write(tmp_path / "held.parquet")
    scan = scan_recording(tmp_path / "held.parquet")
    assert len(block_means(scan, 2, fitted_model(scan, None))) == len(run) // 2


def test_tool_poses_turn_about_one_axis(run: Recording, arm: Arm) -> None:
    assert run.q is not None
    rotation = run.rotations(arm).reshape(-1, 3, 3)
    own = rows_of(len(run), uneven=False)
    poses = replace(run, q=None, tool_quaternion=quaternions(rotation)[own])
    straight = straight_between(poses)
    kept = np.searchsorted(run.t, straight.t)
    off = (
        Rotation.from_matrix(rotation[kept]).inv() * Rotation.from_matrix(straight.rotations(None).reshape(-1, 3, 3))
    ).magnitude()
    node = own[kept] == kept
    assert off[node].max() < 1e-7  # rounding of unit quaternions, by arccos
    steps = (Rotation.from_matrix(rotation[:-1]).inv() * Rotation.from_matrix(rotation[1:])).magnitude()
    assert off.max() < EVERY * steps.max()  # no chord leads farther than the arm goes in it


def test_the_base_fit_leaves_less(run: Recording, arm: Arm) -> None:
    assert run.q is not None
    held = replace(run, q=run.q[rows_of(len(run), uneven=False)])

    def left(recording: Recording) -> float:
        fitted = calibrate(recording, noise="residuals", arm=arm)
        return float(residuals_of(recording, "accelerometer", fitted["accelerometer"], arm).values.std())

    assert left(posed(held, arm)[0]) < 0.5 * left(held)


def test_a_calibration_is_that_of_the_motion(run: Recording, tmp_path: Path) -> None:
    """A log that is held is half an interval late: joint 1's angle would be off by that, 30 standard deviations. From
    pose to pose the arm goes straight to a tenth of one: in a file of any size, in parts, and without outliers."""
    assert run.q is not None
    held = replace(run, q=run.q[rows_of(len(run), uneven=False)], name="held")
    held.write(tmp_path / "held.parquet")
    true = calibrate(run, noise="residuals")
    half = len(run) // 2
    halves = [replace(held.select(slice(*ends)), name=str(ends)) for ends in ((0, half), (half, None))]
    found = [calibrate(each, noise="residuals") for each in (held, tmp_path / "held.parquet", halves)]
    for one in [*found, robust_calibrate(held, noise="residuals")[0]]:
        for sensor, own in one.sensors.items():
            told = np.isfinite(spread := np.sqrt(np.diag(true[sensor].covariance)))
            assert (np.abs(own.values - true[sensor].values)[told] < spread[told]).all()
            assert sum("straight lines were put between them" in words for words in own.quality.warnings) >= 1
    for one in (judged(held, found[0]), judged_together(halves, found[2])):
        for own in one.sensors.values():
            assert own.quality.verdict is not None
            assert own.quality.verdict["good"]


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_an_arm_that_is_held_in_each_pose_is_no_slower_log(run: Recording, noise: float) -> None:
    """Its readings do not go on within a pose: but for noise of one in the root of the poses."""
    assert run.q is not None
    own = rows_of(len(run), uneven=False)
    rng = np.random.default_rng(2)
    readings = {
        sensor: run.readings(sensor)[own] + noise * rng.standard_normal((len(run), 3)) for sensor in run.sensors
    }
    still = replace(run, q=run.q[own], **readings)
    assert repeated(still) is None
    assert straight_between(still) is still
