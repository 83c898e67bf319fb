"""Coverage: equal cells, what is missing, and stopping when the parameters are known and not before."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from directions import CUBE, spread
from scipy.stats import chisquare

import estimators
import scenarios
from estimators.calibration import SensorCalibration
from estimators.coverage import (
    SphereCells,
    coverage,
    direction_name,
)
from estimators.coverage.seen import CELLS
from estimators.goodness.residuals import residuals_of
from rig.arm import Arm
from rig.arrays import Array
from rig.errors import RigError
from rig.recording import Recording
from validation.plots.camps_directions import spherical

# Cells


@pytest.mark.parametrize("count", [2, 3, 7, 12, 26, 100, *CELLS, 2500])
def test_cells_are_equal_and_know_their_middle(count: int) -> None:
    cells = SphereCells.of(count)
    areas = [(high - low) * (end - begin) for low, high, begin, end in map(cells.limits, range(count))]
    assert areas == pytest.approx([4.0 * np.pi / count] * count, rel=1e-11)
    assert cells.number(cells.centres).tolist() == list(range(count))
    assert cells.around.sum() == count


@pytest.mark.parametrize("count", CELLS)
def test_directions_fall_into_the_cell_they_lie_in(count: int) -> None:
    directions = np.concatenate([spread(5000, 1), CUBE, [[-1.0, 0.0, 0.0], [-1.0, -0.0, 0.0]]])
    cells = SphereCells.of(count)
    azimuth = np.arctan2(directions[:, 1], directions[:, 0]) % (2.0 * np.pi)
    for direction, around, number in zip(directions, azimuth, cells.number(directions), strict=True):
        low, high, begin, end = cells.limits(number)
        assert low - 1e-12 <= direction[2] <= high + 1e-12
        assert begin - 1e-12 <= around <= end + 1e-12


def test_even_directions_fill_cells_evenly() -> None:
    """A chi-square test that fails once in ten thousand of right partitions."""
    counts = np.bincount(SphereCells.of(162).number(spread(100_000, 2)), minlength=162)
    assert chisquare(counts).pvalue > 1e-4


@pytest.mark.parametrize("count", CELLS)
def test_a_hemisphere_is_half_of_the_cells(count: int) -> None:
    directions = spread(100_000, 3)
    assert coverage(directions[directions[:, 2] > 0.0], count).share == 0.5
    # 100,000 in 162 cells: one stays empty with the probability exp(-617).
    assert coverage(directions, count).share == 1.0


def test_cells_are_compact() -> None:
    """No slivers: the corners lie within 1.2 diagonals of a square as large, from the middle."""
    for count in CELLS:
        cells = SphereCells.of(count)
        for number, centre in enumerate(cells.centres):
            low, high, begin, end = cells.limits(number)
            for z, around in product((low, high), (begin, end)):
                radius = np.sqrt(1.0 - z * z)
                corner = np.array([radius * np.cos(around), radius * np.sin(around), z])
                angle = np.degrees(np.arccos(np.clip(corner @ centre, -1.0, 1.0)))
                assert angle < 1.2 * cells.width_deg / np.sqrt(2.0)


def test_fewer_than_two_cells_are_refused() -> None:
    with pytest.raises(RigError, match="2 or more"):
        SphereCells.of(1)


# Directions


def test_the_angles_are_those_of_camps() -> None:
    """(3): r, theta = arctan(sqrt(hx^2 + hy^2) / hz), phi = arctan(hy / hx), the latter over the full circle."""
    vectors = 0.47 * spread(1000, 4)
    x, y, z = vectors.T
    r, theta, phi = spherical(vectors)
    assert r == pytest.approx(np.full(1000, 0.47))
    assert theta == pytest.approx(np.arctan(np.sqrt(x * x + y * y) / z))
    assert np.tan(phi) == pytest.approx(y / x)
    assert np.sign(np.cos(phi)) == pytest.approx(np.sign(x))
    assert (np.abs(theta) <= np.pi / 2).all()
    assert spherical([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 2.0, 0.0]])[1] == pytest.approx([0.0, 0.0, np.pi / 2])


def test_directions_have_names() -> None:
    assert direction_name([0.0, 0.1, -0.9]) == "-z"
    assert direction_name([1.0, -1.1, 0.1]) == "+x-y"
    assert direction_name([-0.5, 0.5, 0.6]) == "-x+y+z"
    assert len({direction_name(vector) for vector in CUBE}) == 26
    with pytest.raises(RigError, match="not all zero"):
        direction_name([0.0, 0.0, 0.0])


def test_a_calibration_sees_the_field_in_frame_6(recording: Recording) -> None:
    scenario = scenarios.load("ann-arbor")
    calibration = estimators.calibrate(recording)
    arm = Arm.a465()
    true = recording.rotations(arm).reshape(-1, 3, 3).transpose(0, 2, 1) @ scenario.rig.environment.gravity
    found = residuals_of(recording, "accelerometer", calibration["accelerometer"], arm).directions
    # Gravity's direction is known to some 0.01 deg.
    assert found == pytest.approx(true / np.linalg.norm(true, axis=1)[:, None], abs=1e-3)
    # Without attitude: from the readings, whose noise is a hundredth of the field.
    alone = residuals_of(recording, "accelerometer", calibration["accelerometer"]).directions
    assert np.sum(alone * found, axis=1).min() > np.cos(0.1)


def test_a_fit_that_has_run_away_sees_one_side_only() -> None:
    """However small its residuals are: seen from its centre all readings are in one direction."""
    readings = spread(2000, 5)
    calibration = SensorCalibration(
        method="ellipsoid",
        unit="V",
        reference_magnitude=1.0,
        matrix=np.eye(3) / 50.0,
        bias=np.array([0.0, 0.0, -50.0]),
        parameters=(),
        values=np.empty(0),
        covariance=np.empty((0, 0)),
        identifiable={},
        samples=2000,
        fit_rms=np.zeros(3),
    )
    run = Recording(t=np.arange(2000.0), accelerometer=readings)
    away = coverage(residuals_of(run, "accelerometer", calibration).directions)
    assert away.share < 0.1  # one of twelve cells, the fewest there are
    assert away.hole_deg > 175.0
    honest = replace(calibration, matrix=np.eye(3), bias=np.zeros(3))
    assert coverage(residuals_of(run, "accelerometer", honest).directions).share == 1.0


# What has been seen


def test_the_largest_hole_is_found() -> None:
    """To the 2 degrees of half a fine cell's diagonal (4.1 degrees wide)."""
    axes = coverage(CUBE[np.sum(np.abs(CUBE) > 0.0, axis=1) == 1])
    assert axes.hole_deg == pytest.approx(np.degrees(np.arccos(1.0 / np.sqrt(3.0))), abs=3.0)
    assert np.abs(axes.hole) == pytest.approx(np.full(3, 1.0 / np.sqrt(3.0)), abs=0.05)
    directions = spread(50_000, 6)
    half = coverage(directions[directions[:, 0] < 0.0])
    assert half.hole_deg == pytest.approx(90.0, abs=3.0)
    assert half.hole == pytest.approx([1.0, 0.0, 0.0], abs=0.1)
    assert "+x" in half.missing_names
    assert coverage(directions).hole_deg < 5.0
    assert coverage([[0.0, 0.0, 1.0]]).hole_deg == pytest.approx(180.0, abs=3.0)


def test_missing_directions_are_those_never_seen() -> None:
    directions = spread(5000, 7)
    seen = coverage(directions[directions[:, 2] > -0.5])
    assert len(seen.missing) == (seen.counts == 0).sum() > 10
    assert (seen.missing[:, 2] < -0.45).all()
    assert seen.missing_names[0] in ("-z", "+x-z", "-x-z", "+y-z", "-y-z")
    assert seen.to_json()["share"] == seen.share == pytest.approx(0.75, abs=0.06)
    assert str(seen).startswith(f"{100 * seen.share:.0f} % of 162 equal cells seen; missing about ")


@pytest.mark.parametrize("parts", [1, 26, 200, 600, 10_000])
def test_few_directions_get_few_cells(parts: int) -> None:
    """Evenly spread ones fill nearly all of them, however few they are."""
    directions = CUBE if parts == 26 else SphereCells.of(max(2, parts)).centres
    found = coverage(directions)
    assert found.cells.count in CELLS
    assert found.share == 1.0 or parts == 1


def test_the_26_poses_of_a_cube_cover_the_sphere() -> None:
    assert coverage(CUBE).share == 1.0
    assert coverage(CUBE).hole_deg == pytest.approx(27.4, abs=3.0)  # between a face, an edge and a corner
    half = coverage(CUBE[CUBE[:, 2] >= 0.0])  # the equator's poses lie on the border of cells, and count for one side
    assert half.hole_deg == pytest.approx(90.0, abs=3.0)
    assert half.missing_names == ("-z",)


@pytest.mark.parametrize(
    ("directions", "match"),
    [
        (np.zeros((0, 3)), "found none"),
        (np.zeros((4, 3)), "found none"),
        (np.zeros(3), r"expected \(n, 3\)"),
        (np.array([[np.nan, 0.0, 1.0]]), "finite"),
    ],
)
def test_what_are_no_directions_is_refused(directions: Array, match: str) -> None:
    with pytest.raises(RigError, match=match):
        coverage(directions)
