"""When the nodes of a log were read, recovered from how smooth the motion is."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from rig.arrays import Array
from rig.pose_nodes import PoseNodes
from rig.read_times import read_times

INTERVAL_S = 0.07
SCATTER_S = 0.008
SEEDS = range(5)


def path(t: Array) -> Array:
    """(m, 3) [m]: some 0.4 m/s and 0.7 m/s^2, by sines of a few seconds."""
    turning, phase = np.array([1.3, 1.7, 2.1]), np.array([0.3, 1.1, 2.0])
    return np.asarray(0.2 * np.sin(turning * t[:, None] + phase))


def acceleration(t: Array) -> Array:
    turning = np.array([1.3, 1.7, 2.1])
    return np.asarray(-path(t) * turning**2)


def missed(at: Array, read: Array) -> float:
    """[m/s^2] root mean square error of the path's acceleration, where nodes read at ``read`` are put at ``at``."""
    found = CubicSpline(at, path(read), axis=0)(at, 2)
    return float(np.sqrt(np.mean((found - acceleration(read))[10:-10] ** 2)))


def drawn(seed: int, evenly: bool) -> tuple[Array, Array]:
    """When nodes were read, and their stamps."""
    rng = np.random.default_rng(seed)
    read = np.arange(300) * INTERVAL_S
    if not evenly:
        read = np.cumsum(INTERVAL_S * rng.choice([1.0, 1.0, 1.0, 1.3, 0.8], 300))
    return read, read + SCATTER_S * rng.standard_normal(300)


@pytest.mark.parametrize("evenly", [True, False])
@pytest.mark.parametrize("seed", SEEDS)
def test_the_acceleration_of_the_motion_comes_back(seed: int, evenly: bool) -> None:
    """Stamps off by s = 8 ms at v = 0.2 m/s a component are an error of v s sqrt(6) / T^2 = 0.8 m/s^2 and more, larger
    than the motion's own acceleration; a smooth path must leave less than a third of it. Read evenly, stamps are known
    to s / sqrt(13), which alone makes it that."""
    read, stamped = drawn(seed, evenly)
    found = read_times(stamped, [path(read)])[0]
    assert np.all(np.diff(found) > 0.0)
    assert missed(stamped, read) > 0.8
    assert missed(found, read) < missed(stamped, read) / 3.0


@pytest.mark.parametrize("seed", SEEDS)
def test_what_a_clock_stamps_before_or_after_its_ticks_is_found_by_the_path_alone(seed: int) -> None:
    """Read 8 ms off even stamps: what a smooth path is rough by tells of it, and must leave less than a third."""
    read, stamped = drawn(seed, evenly=True)[1], np.arange(300) * INTERVAL_S
    found = read_times(stamped, [path(read)])[0]
    assert np.all(np.diff(found) > 0.0)
    assert missed(stamped, read) > 0.8
    assert missed(found, read) < missed(stamped, read) / 3.0


@pytest.mark.parametrize("hurried", [True, False])
def test_even_stamps_are_taken_as_they_are(hurried: bool) -> None:
    """Of steady motion, and of one that starts and stops within two intervals, at the same speed in between."""
    t = np.arange(300) * INTERVAL_S
    ramp, move, rest = 0.14, 1.4, 0.35
    into = t % (move + rest)
    way = np.clip(into, 0.0, move)
    gone = np.where(
        way < ramp,
        0.5 * way**2 / ramp,
        np.where(way > move - ramp, move - ramp - 0.5 * (move - way) ** 2 / ramp, way - 0.5 * ramp),
    )
    whole = (t // (move + rest)) * (move - ramp) + gone
    along = np.outer(whole, [0.4, 0.2, 0.1]) + 0.1 * np.sin(np.outer(whole, [1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(read_times(t, [along if hurried else path(t)])[0], t)


def test_few_nodes_are_taken_as_they_are() -> None:
    t = np.array([0.0, 0.06, 0.15, 0.2])
    np.testing.assert_array_equal(read_times(t, [path(t)])[0], t)


def test_stops_and_straight_lines_break_nothing() -> None:
    """Standing still, a start within one interval, a constant speed: times rise and stay near the stamps."""
    read, stamped = drawn(0, evenly=True)
    along = np.clip(read - 7.0, 0.0, 5.0)
    found = read_times(stamped, [np.outer(along, [1.0, 0.5, 0.0])])[0]
    assert np.all(np.diff(found) > 0.0)
    assert np.abs(found - stamped).max() < 2.0 * INTERVAL_S


def test_orientations_alone_tell_the_times_too() -> None:
    read, stamped = drawn(1, evenly=False)
    half = 0.5 * read + 0.1 * np.sin(read)
    turns = np.stack([np.cos(half), np.sin(half), np.zeros(300), np.zeros(300)], axis=1)
    nodes = PoseNodes(stamped, turns, np.empty((0, 0)))
    before, after = (np.diff(at - read, n=2)[10:-10] for at in (stamped, nodes.read_s))
    assert np.sqrt(np.mean(after**2)) < 0.3 * np.sqrt(np.mean(before**2))
