"""Which path the nodes of a log are of, told by readings that are late on it."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from estimators.gap.data.likely_path import likely_path
from rig.arrays import Array
from rig.channels import ACCELEROMETER, MAGNETOMETER
from rig.pose_nodes import PoseNodes

INTERVAL_S: Final = 0.08
LATE_S: Final = 0.03
DURATION_S: Final = 60.0
#: Noise of the readings [m/s^2, relative field].
NOISE: Final = 0.02
GRAVITY: Final = np.array([0.1, -0.2, -9.8])
FIELD: Final = np.array([0.4, 0.1, -0.9])
PHASES: Final = np.array([0.3, 1.1, 2.0])
SEEDS: Final = range(3)


def angles(t: Array) -> Array:
    """(n, 3) [rad] rotation vectors of a fast arm: some 1 rad/s."""
    return np.asarray(0.5 * np.sin(np.outer(t, [1.3, 1.9, 2.4]) + PHASES))


def place(t: Array) -> Array:
    """(n, 3) [m]: some 0.8 m/s and 2 m/s^2."""
    return np.asarray(0.4 * np.sin(np.outer(t, [1.7, 2.1, 2.6]) + PHASES))


def acceleration(t: Array) -> Array:
    return np.asarray(-(np.array([1.7, 2.1, 2.6]) ** 2) * place(t))


def readings(t: Array, rng: np.random.Generator) -> dict[str, Array]:
    """Of an accelerometer that is late, and a magnetometer that is not."""
    turned = Rotation.from_rotvec(angles(t - LATE_S)).inv()
    own = {
        ACCELEROMETER: turned.apply(GRAVITY - acceleration(t - LATE_S)),
        MAGNETOMETER: Rotation.from_rotvec(angles(t)).inv().apply(FIELD),
    }
    return {name: values + NOISE * rng.standard_normal(values.shape) for name, values in own.items()}


def nodes_of(rng: np.random.Generator, off_s: float, moved_m: float, turned_rad: float) -> PoseNodes:
    """Nodes with even stamps, read off_s off these, their positions and orientations noisy."""
    stamped = np.arange(0.0, DURATION_S, INTERVAL_S)
    read = stamped + off_s * rng.standard_normal(len(stamped))
    turns = Rotation.from_rotvec(angles(read)) * Rotation.from_rotvec(turned_rad * rng.standard_normal((len(read), 3)))
    moves = place(read) + moved_m * rng.standard_normal((len(read), 3))
    quaternion = turns.as_quat(scalar_first=True, canonical=False)
    sign = np.where(np.sum(quaternion[1:] * quaternion[:-1], axis=1) < 0.0, -1.0, 1.0)
    return PoseNodes(stamped, quaternion * np.concatenate([[1.0], np.cumprod(sign)])[:, None], moves)


def told(nodes: PoseNodes, rng: np.random.Generator, *sensors: str) -> PoseNodes:
    """The path that readings of all sensors, or of some, want."""
    t = np.arange(0.0, DURATION_S, 0.01)
    every = readings(t, rng)
    inner = np.minimum(t, DURATION_S - t) > 0.5
    return likely_path(nodes, t, {name: every[name] for name in sensors or every}, inner)


def errors(nodes: PoseNodes) -> tuple[float, float]:
    """Root mean square errors of the path's accelerations [m/s^2] and orientations [rad]."""
    t = np.arange(2.0, DURATION_S - 2.0, 0.01)
    wide = np.arange(1.0, DURATION_S - 1.0, 0.01)
    found = CubicSpline(wide, nodes.smooth(wide)[1], axis=0)(t, 2)
    turn = Rotation.from_matrix(nodes.smooth(t)[0]).inv() * Rotation.from_rotvec(angles(t))
    return float(np.sqrt(np.mean((found - acceleration(t)) ** 2))), float(np.sqrt(np.mean(turn.as_rotvec() ** 2)))


@pytest.mark.parametrize("seed", SEEDS)
def test_noise_of_the_nodes_is_smoothed_as_readings_want_it(seed: int) -> None:
    """Positions off by s = .5 mm make accelerations err by s sqrt(6) / T^2 = .19 m/s^2 at the nodes, of ten times the
    readings' noise; smoothing waves of two nodes and more leaves less than half, and of the orientations' 3 mrad less
    than four fifths."""
    rng = np.random.default_rng(seed)
    nodes = nodes_of(rng, 0.0, 5e-4, 3e-3)
    found = told(nodes, rng)
    (before, turned), (after, left) = errors(nodes), errors(found)
    assert before > 0.1
    assert after < 0.5 * before
    assert left < 0.8 * turned


@pytest.mark.parametrize("seed", SEEDS)
def test_times_that_readings_want_are_taken(seed: int) -> None:
    """Read 2 ms off: the path alone leaves errors that readings of a twentieth of the noise would tell."""
    rng = np.random.default_rng(seed)
    nodes = nodes_of(rng, 2e-3, 0.0, 0.0)
    found = told(nodes, rng)
    assert errors(found)[0] < 0.7 * errors(nodes)[0]


@pytest.mark.parametrize("seed", SEEDS)
def test_exact_nodes_stay_what_they_are(seed: int) -> None:
    """Smoothing waves of two nodes loses .1 % of an acceleration of 2.6 rad/s, which readings do not tell from none."""
    rng = np.random.default_rng(seed)
    nodes = nodes_of(rng, 0.0, 0.0, 0.0)
    found = told(nodes, rng)
    np.testing.assert_array_equal(found.read_s, nodes.t)
    assert max(found.smoothed) <= 1.0
    assert errors(found)[0] < 2.0 * errors(nodes)[0] + 0.02


def test_orientations_alone_are_smoothed_too() -> None:
    rng = np.random.default_rng(0)
    nodes = nodes_of(rng, 0.0, 0.0, 3e-3)
    bare = PoseNodes(nodes.t, nodes.quaternion, np.empty((0, 0)))
    found = told(bare, rng, MAGNETOMETER)
    assert found.smoothed[0] >= 1.0


def test_a_part_of_a_long_recording_tells_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    """Twenty seconds of sixty: the path is that of all, its accelerations less than half off as before."""
    monkeypatch.setattr("estimators.gap.data.likely_path._MOST", 2000)
    rng = np.random.default_rng(0)
    nodes = nodes_of(rng, 0.0, 5e-4, 0.0)
    assert errors(told(nodes, rng))[0] < 0.5 * errors(nodes)[0]


def test_readings_that_do_not_count_tell_nothing() -> None:
    rng = np.random.default_rng(0)
    nodes = nodes_of(rng, 0.0, 5e-4, 0.0)
    t = np.arange(0.0, DURATION_S, 0.01)
    assert likely_path(nodes, t, readings(t, rng), np.zeros(len(t), dtype=bool)) is nodes


def test_another_path_is_away_by_its_own() -> None:
    """How far a log is away from a path is asked for each strength of an effect, and kept; not for another path."""
    nodes = nodes_of(np.random.default_rng(0), 0.0, 0.0, 3e-3)
    t = np.arange(1.0, DURATION_S - 1.0, 0.01)
    logged = Rotation.from_rotvec(angles(t)).as_matrix()
    before = nodes.away(t, logged)[0]
    smooth = replace(nodes, read=nodes.read_s, smoothed=(4.0, 0.0))
    assert np.sqrt(np.mean(smooth.away(t, logged)[0] ** 2)) < 0.8 * np.sqrt(np.mean(before**2))


@pytest.mark.parametrize("reading", [np.nan, 0.0])
def test_of_an_axis_that_says_nothing_the_others_tell(reading: float) -> None:
    rng = np.random.default_rng(0)
    nodes = nodes_of(rng, 0.0, 5e-4, 0.0)
    t = np.arange(0.0, DURATION_S, 0.01)
    own = readings(t, rng)
    own[ACCELEROMETER][:, 1] = reading
    found = likely_path(nodes, t, own, np.minimum(t, DURATION_S - t) > 0.5)
    assert errors(found)[0] < 0.5 * errors(nodes)[0]


def test_nodes_on_another_clock_are_of_the_same_path() -> None:
    nodes = nodes_of(np.random.default_rng(0), 2e-3, 0.0, 0.0)
    t = np.arange(1.0, DURATION_S - 1.0, 0.01)
    np.testing.assert_allclose(nodes.later(5.0).smooth(t + 5.0)[1], nodes.smooth(t)[1], rtol=0.0, atol=1e-12)
