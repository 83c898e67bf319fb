"""Stopping a maneuver when the parameters are known, and not before; refusing when they cannot be told."""

from __future__ import annotations

import numpy as np
import pytest
from directions import CUBE, spread
from kinematic_examples import TRUTHS, sweep_rotations, sweep_statistics
from scipy.spatial.transform import Rotation

import estimators
from estimators.coverage import (
    AttitudeFreeInformation,
    Targets,
    enough_attitude_free,
    enough_known_angles,
)
from estimators.known_angle.identifiability import Information
from estimators.known_angle.statistics import Statistics
from rig.arrays import Array
from rig.errors import RefusedFit, RigError
from rig.recording import Recording

# Information without attitude


@pytest.mark.parametrize("parameters", [6, 9])
def test_the_information_is_that_of_the_fields_magnitude(parameters: int) -> None:
    """Derivatives of |M (V - b)| / H by finite differences, with errors of 1e-6 of themselves at steps of 1e-5."""
    gain = np.array([[1.8, 0.02, -0.03], [0.02, 1.7, 0.04], [-0.03, 0.04, 1.9]])
    if parameters == 6:
        gain = np.diag(gain.diagonal())
    matrix, offset, H = np.linalg.inv(gain), np.array([0.1, -0.2, 0.3]), 0.47
    u = spread(50, 8)
    readings = H * u @ gain.T + offset
    sigma = 0.003

    def magnitude(x: Array) -> Array:
        change = np.diag(x[:3]).astype(float)
        if parameters == 9:
            for (i, j), a in zip(((0, 1), (0, 2), (1, 2)), x[3:6], strict=True):
                change[i, j] = change[j, i] = 0.5 * a
        moved = (np.eye(3) + change) @ matrix
        shift = np.linalg.solve(matrix, x[-3:] * H)
        return np.asarray(np.linalg.norm((readings - offset - shift) @ moved.T, axis=1) / H)

    step = 1e-5
    columns = [(magnitude(step * e) - magnitude(-step * e)) / (2.0 * step) for e in np.eye(parameters)]
    jacobian = np.stack(columns, axis=1)
    found = AttitudeFreeInformation.of(u, sigma, parameters=parameters)  # type: ignore[arg-type]
    assert found.matrix == pytest.approx(jacobian.T @ jacobian / sigma**2, rel=1e-5, abs=1e-4)
    assert len(found.names) == parameters
    assert found.covariance == pytest.approx(np.linalg.inv(found.matrix), rel=1e-9, abs=1e-15)
    assert found.undetermined == ()


def test_counts_are_so_many_readings() -> None:
    counts = np.arange(1, 27)
    found = AttitudeFreeInformation.of(CUBE, (0.01, 0.02, 0.03), counts)
    repeated = AttitudeFreeInformation.of(np.repeat(CUBE, counts, axis=0), (0.01, 0.02, 0.03))
    assert found.matrix == pytest.approx(repeated.matrix, abs=1e-12 * repeated.matrix.max())
    assert found.readings == repeated.readings == counts.sum()


@pytest.mark.parametrize(
    ("directions", "open_ones"),
    [
        (np.eye(3), {"sensitivity1", "offset1", "angle1-2"}),
        (
            np.array([[np.cos(a), np.sin(a), 0.0] for a in np.linspace(0, 6, 40)]),
            {"sensitivity3", "angle2-3", "offset3"},
        ),
        (CUBE[CUBE[:, 2] == 1.0], {"sensitivity3", "offset3"}),
    ],
    ids=["three", "a circle", "one"],
)
def test_what_directions_leave_open_is_named(directions: Array, open_ones: set[str]) -> None:
    found = AttitudeFreeInformation.of(directions, 0.01)
    assert open_ones <= set(found.undetermined)
    assert found.condition == np.inf
    assert all(found.std[name] == np.inf for name in open_ones)


def test_the_gain_of_a_direction_is_what_it_would_bring() -> None:
    """Rank-one update against adding the readings; both on top of a standard deviation of one for each parameter."""
    u, sigma, importance = CUBE[CUBE[:, 2] >= 0.0], 0.01, np.arange(1.0, 10.0)
    now = AttitudeFreeInformation.of(u, sigma)
    candidates = spread(5, 9)
    found = now.gain(candidates, sigma, importance, 4.0)
    before = np.linalg.inv(now.matrix + np.eye(9)).diagonal() @ importance
    for vector, gain in zip(candidates, found, strict=True):
        more = AttitudeFreeInformation.of(np.vstack([u, np.tile(vector, (4, 1))]), sigma)
        after = np.linalg.inv(more.matrix + np.eye(9)).diagonal() @ importance
        assert gain == pytest.approx(before - after, rel=1e-6)


# Enough


def test_enough_is_not_a_count() -> None:
    """Ten thousand readings of the whole sphere are enough where a million of a small cap are not."""
    sphere = spread(10_000, 10)
    cap = spread(1_000_000, 11)
    cap = cap[cap[:, 2] > 0.95]
    assert enough_attitude_free(sphere, 0.01).enough
    lacking = enough_attitude_free(np.repeat(cap, 40, axis=0), 0.01)
    assert not lacking.enough
    assert lacking.next_direction is not None
    assert lacking.next_direction[2] < 0.5


def test_as_much_again_as_it_says_is_just_enough() -> None:
    directions = spread(200, 12)
    now = enough_attitude_free(directions, 0.01)
    assert not now.enough
    assert now.more > 0.0
    for share, reached in ((1.001, True), (0.999, False)):
        later = enough_attitude_free(directions, 0.01, counts=np.full(200, share * (1.0 + now.more)))
        assert later.enough is reached
        assert later.worst == now.worst
    assert "times as much again would do" in str(now)


def test_targets_decide() -> None:
    directions = spread(2000, 13)
    assert enough_attitude_free(directions, 0.01, Targets(1e-2, 1e-2, 1.0)).enough
    strict = enough_attitude_free(directions, 0.01, Targets(1e-2, 1e-5, 1.0))
    assert not strict.enough
    assert strict.worst.startswith("offset")
    with pytest.raises(RigError, match=r"targets\.offset"):
        Targets(offset=0.0)


def test_following_the_advice_reaches_the_target() -> None:
    """From one pose on, each next one as advised; nine poses are the least that tell nine parameters."""
    poses = [np.array([0.0, 0.0, 1.0])]
    for _ in range(40):
        state = enough_attitude_free(np.array(poses), 0.002, counts=np.full(len(poses), 100.0))
        if state.enough:
            break
        assert state.next_direction is not None
        poses.append(state.next_direction)
    assert state.enough
    assert 9 <= len(poses) <= 26
    random = enough_attitude_free(spread(len(poses), 14), 0.002, counts=np.full(len(poses), 100.0))
    assert max(state.std.values()) < max(random.std.values())


def test_three_orientations_leave_open_what_is_missing() -> None:
    state = enough_attitude_free(np.eye(3), 1e-6)
    assert "sensitivity1" in state.untold
    assert "-z" in state.coverage.missing_names
    assert state.more == np.inf
    assert state.to_json()["more"] is None
    assert not enough_attitude_free(CUBE, 0.01).untold


def test_known_angles_need_what_the_bound_says() -> None:
    truth, noise = TRUTHS["table2"]
    directions = truth.fields[0] @ sweep_rotations(6656).reshape(-1, 3, 3)
    for scale in (1.0, 100.0):
        information = Information.of(sweep_statistics().gram, truth, scale * noise)
        state = enough_known_angles(information, directions)
        assert state.enough is (scale == 1.0)
        # Relative to S, hence the columns of the Jacobian as they are.
        assert state.std["sensitivity2"] == pytest.approx(np.sqrt(information.covariance[4, 4]))
        block = information.covariance[10:12, 10:12]
        assert state.std["axis3"] ** 2 == pytest.approx(np.linalg.eigvalsh(block)[-1])
        assert "field" not in state.target
    assert "field" in enough_known_angles(information, directions, Targets(field_deg=0.1)).target


def test_turns_about_one_axis_cannot_tell_all() -> None:
    truth, noise = TRUTHS["table2"]
    turns = Rotation.from_rotvec(np.outer(np.linspace(0.0, 6.0, 500), [0.0, 0.0, 1.0])).as_matrix()
    gram = Statistics.from_rotations(turns, np.zeros((500, 3))).gram
    state = enough_known_angles(Information.of(gram, truth, noise), truth.fields[0] @ turns)
    assert not state.enough
    assert state.untold


def test_a_refused_fit_names_what_is_missing() -> None:
    """Three orientations with known angles: gravity along three axes of frame 6."""
    turns = Rotation.from_euler("xyz", [[0.0, 0.0, 0.0], [90.0, 0.0, 0.0], [0.0, 90.0, 0.0]], degrees=True)
    each = Rotation.concatenate([turns[i % 3] for i in range(300)])
    truth, noise = TRUTHS["table2"]
    rotations = each.as_matrix().reshape(-1, 9)
    volts = np.column_stack([rotations, np.ones(300)]) @ truth.coefficients
    volts += np.random.default_rng(15).normal(size=volts.shape) * noise
    run = Recording(t=np.arange(300.0), tool_quaternion=each.as_quat(scalar_first=True), accelerometer=volts)
    with pytest.raises(RefusedFit) as caught:
        estimators.calibrate(run)
    refusal = caught.value
    assert "the field was seen in 25 % of 12 equal cells of frame 6: bring it along" in str(refusal)
    assert "+z" in str(refusal)
    assert "\n" not in str(refusal)
