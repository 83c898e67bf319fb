"""R_base_tool as a function of cosines and sines, against MuJoCo and against products of rotations.

Everything agrees to 1e-13: the map rounds to about 1.5e-15 (largest of 20,000 poses against 64-bit mantissas), MuJoCo
likewise; a term left out would show as its coefficient, which is at least 1e-15 only where the geometry has no zero.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from arm_files import random_angles
from scipy.spatial.transform import Rotation

from rig.arm import Arm
from rig.arm.rotation_map import RotationMap, moving_joints
from rig.arrays import Array
from rig.errors import RigError
from rig.maneuver import TorusSweep

EXACT = 1e-13


@pytest.fixture(scope="module")
def rotation_map(arm: Arm) -> RotationMap:
    return arm.rotation_map


def product_of_exponentials(axes: Array, R_zero: Array, q: Array) -> Array:
    """(n, 9) by a chain of rotations, one matrix a joint."""
    total = Rotation.identity()
    for joint, axis in enumerate(axes):
        total = total * Rotation.from_rotvec(q[:, joint, None] * axis)
    return (total * Rotation.from_matrix(R_zero)).as_matrix().reshape(-1, 9)


def test_the_whole_sweep(arm: Arm, rotation_map: RotationMap) -> None:
    q = TorusSweep().trajectory().q[::7]
    assert moving_joints(q) == [0, 4, 5]
    expected = arm.poses(q).R_base_tool.reshape(-1, 9)
    found = rotation_map.rotations(q)
    assert found.flags.c_contiguous
    np.testing.assert_allclose(found, expected, rtol=0, atol=EXACT)


@pytest.mark.parametrize("moving", [m for k in range(7) for m in combinations(range(6), k)])
def test_any_joints_may_move(arm: Arm, rotation_map: RotationMap, moving: tuple[int, ...]) -> None:
    """Locked anywhere, not only at the sweep's right angles, and over many turns."""
    q = np.repeat(random_angles(1), 60, axis=0)
    q[:, moving] = random_angles(60, len(moving), seed=2, reach=400.0)
    assert moving_joints(q) == list(moving)
    np.testing.assert_allclose(rotation_map.rotations(q), arm.poses(q).R_base_tool.reshape(-1, 9), rtol=0, atol=EXACT)
    rotation, position = rotation_map.poses(q)
    np.testing.assert_allclose(rotation, arm.poses(q).R_base_tool, rtol=0, atol=EXACT)
    np.testing.assert_allclose(position, arm.poses(q).position, rtol=0, atol=EXACT)


def test_table_1_of_the_paper(rotation_map: RotationMap) -> None:
    """Renk (7), (8): theta1 = q1 + 90, theta5 = q5, theta6 = q6 + 180 deg, written without the map or MuJoCo."""
    q = np.tile(np.radians([0.0, 90.0, -90.0, 0.0, 0.0, 0.0]), (1000, 1))
    q[:, [0, 4, 5]] = random_angles(1000, 3)
    theta = np.zeros((1000, 6))
    theta[:] = [0.0, np.pi / 2, -np.pi, 0.0, 0.0, 0.0]
    theta[:, [0, 4, 5]] = q[:, [0, 4, 5]] + [np.pi / 2, 0.0, np.pi]
    total = np.eye(3)
    for joint, alpha in enumerate([np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0]):
        c, s, zero = np.cos(theta[:, joint]), np.sin(theta[:, joint]), np.zeros(1000)
        ca, sa = np.cos(alpha), np.sin(alpha)
        rows = [[c, -s * ca, s * sa], [s, c * ca, -c * sa], [zero, zero + sa, zero + ca]]
        total = total @ np.moveaxis(np.array(rows), -1, 0)
    np.testing.assert_allclose(rotation_map.rotations(q), total.reshape(-1, 9), rtol=0, atol=1e-12)


@pytest.mark.parametrize("joints", [1, 2, 3, 4, 7])
def test_arms_with_skew_axes(joints: int) -> None:
    """No axis at right angles to another: all products of cosines and sines are there."""
    rng = np.random.default_rng(joints)
    axes = rng.normal(size=(joints, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    R_zero = Rotation.random(rng=rng).as_matrix()
    q = random_angles(5000, joints)
    found = RotationMap(axes, R_zero).rotations(q)
    np.testing.assert_allclose(found, product_of_exponentials(axes, R_zero, q), rtol=0, atol=EXACT)


def test_small_misalignments_are_not_taken_for_rounding() -> None:
    """A twist of 1e-12 rad between the axes moves the result by as much."""
    axes = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    twisted = axes + np.array([[1e-12, 0.0, 0.0], [0.0, 0.0, 1e-12], [0.0, 1e-12, 0.0]])
    q = random_angles(500, 3)
    change = RotationMap(twisted, np.eye(3)).rotations(q) - RotationMap(axes, np.eye(3)).rotations(q)
    expected = product_of_exponentials(twisted, np.eye(3), q) - product_of_exponentials(axes, np.eye(3), q)
    np.testing.assert_allclose(change, expected, rtol=0, atol=1e-14)
    assert np.abs(change).max() > 5e-13


def test_special_angles(rotation_map: RotationMap) -> None:
    """The half-angle tangent runs to 1e16 at odd multiples of pi and the result does not mind."""
    special = np.pi / 2 * np.arange(-8, 9)
    special = np.concatenate([special, np.nextafter(special, np.inf), np.nextafter(special, -np.inf), 1e5 * special])
    q = np.zeros((len(special), 6))
    q[:, 5] = special
    columns = rotation_map.rotations(q).reshape(-1, 3, 3)
    start = rotation_map.rotations(np.zeros((1, 6))).reshape(3, 3)
    np.testing.assert_allclose((start.T @ columns)[:, 0, 0], np.cos(special), rtol=0, atol=1e-14)
    np.testing.assert_allclose((start.T @ columns)[:, 1, 0], np.sin(special), rtol=0, atol=1e-14)


@pytest.mark.parametrize("count", [1, 2, 4095, 4096, 4097])
@pytest.mark.parametrize("moving", [(0, 4, 5), (0, 1, 2, 3, 4, 5), ()])
def test_block_edges(rotation_map: RotationMap, count: int, moving: tuple[int, ...]) -> None:
    q = np.repeat(random_angles(1), count, axis=0)
    q[:, moving] = random_angles(count, len(moving), seed=3)
    found = rotation_map.rotations(q)
    for row in {0, count // 2, count - 1}:
        np.testing.assert_allclose(found[row], rotation_map.rotations(q[row : row + 1])[0], rtol=0, atol=EXACT)


@pytest.mark.parametrize("rows", [1, 7, 100, 5000])
def test_blocks_are_the_same_samples(rotation_map: RotationMap, rows: int) -> None:
    q = random_angles(703)
    whole = rotation_map.rotations(q)
    covered = 0
    for span, block in rotation_map.blocks(q, rows):
        assert span.start == covered
        np.testing.assert_allclose(block.T, whole[span], rtol=0, atol=EXACT)
        covered = span.stop
    assert covered == len(q)


def test_layouts(rotation_map: RotationMap) -> None:
    q = random_angles(500)
    expected = rotation_map.rotations(q)
    np.testing.assert_array_equal(rotation_map.rotations(np.asfortranarray(q)), expected)
    np.testing.assert_array_equal(rotation_map.rotations(np.repeat(q, 2, axis=0)[::2]), expected)
    assert rotation_map.rotations(np.empty((0, 6))).shape == (0, 9)


def test_wrong_shapes_are_refused(rotation_map: RotationMap) -> None:
    with pytest.raises(RigError, match=r"shape \(4, 5\), expected \(n, 6\)"):
        rotation_map.rotations(np.zeros((4, 5)))
    with pytest.raises(ValueError, match="rotations only"):
        RotationMap(rotation_map.axes, rotation_map.R_zero).poses(np.zeros((4, 6)))


def test_a_joint_that_moves_once_is_moving() -> None:
    """A single sample out of thousands, wherever it is, and by the least amount there is."""
    for row in (0, 1, 777, 4999):
        q = np.full((5000, 3), 0.7)
        q[row, 1] = np.nextafter(0.7, 1.0)
        assert moving_joints(q) == [1]
    assert moving_joints(np.full((5000, 3), 0.7)) == []
    assert moving_joints(np.full((1, 3), 0.7)) == []


def test_the_sweeps_map_has_only_the_products_that_do_not_vanish(rotation_map: RotationMap) -> None:
    """Joint 5 is at right angles to joints 1 and 6: of 27 products 13 have a coefficient."""
    from rig.arm.rotation_map import _terms, folded

    q = TorusSweep().trajectory(np.array([0.0, 1.0])).q
    axes, R_zero = folded(rotation_map.axes, rotation_map.R_zero, q[0], [0, 4, 5])
    assert _terms(tuple(axes.ravel().tolist()), tuple(R_zero.ravel().tolist())).coefficients.shape == (9, 13)
