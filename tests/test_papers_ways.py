"""The papers' own procedures: quasi-Newton from one start, Levenberg-Marquardt from the data sheet, turns about"
" axes."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from cli_support import Rig

import estimators
import scenarios
from estimators.known_angle.quasi_newton import as_renk, quasi_newton
from estimators.known_angle.statistics import Statistics
from rig.arm import Arm
from rig.errors import RigError
from rig.maneuver import AxisRotations


def test_quasi_newton_ends_at_the_optimum() -> None:
    """Gradients by differences end a search where the cost is flat to some 1e-8 of itself: a tenth of a standard
    deviation is 1e-2 in chi-square, of some 20,000."""
    scenario = scenarios.load("ann-arbor")
    run = scenario.simulate(seed=3)
    for method in ("simultaneous", "separate"):
        calibration = estimators.calibrate(run, method=method, weighting="equal")  # type: ignore[arg-type]
        for end in as_renk(run, calibration).values():
            assert end.sigmas < 0.3
            assert end.cost_ratio == pytest.approx(1.0, abs=1e-5)
            assert end.evaluations > end.iterations


def test_a_search_that_ends_early_has_not_gone_so_far() -> None:
    run = scenarios.load("renk2005-accelerometer").simulate(seed=0)
    statistics = Statistics.from_rotations(run.rotations(Arm.a465()), run.readings("accelerometer"))
    whole, early = (quasi_newton(statistics, 9.8, relative_fall=fall) for fall in (None, 1e-2))
    assert early.iterations < whole.iterations
    assert early.cost > whole.cost


def test_turns_about_three_axes_end_where_they_began() -> None:
    maneuver = AxisRotations(turn_s=10.0, tilt_deg=30.0, rate_Hz=50.0)
    assert maneuver.duration_s == 30.0
    path = maneuver.trajectory(np.array([0.0, 10.0, 20.0, 30.0])).R_base_tool
    np.testing.assert_allclose(path, np.tile(path[0], (4, 1, 1)), atol=1e-12)
    halfway = maneuver.trajectory(np.array([5.0, 15.0, 25.0])).R_base_tool
    for axis, turned in enumerate(halfway):
        np.testing.assert_allclose(path[0].T @ turned, 2.0 * np.diag(np.eye(3)[axis]) - np.eye(3), atol=1e-12)
    with pytest.raises(RigError, match="turn_s"):
        replace(maneuver, turn_s=0.0)


@pytest.fixture(scope="module")
def tumbles(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("papers") / "tumble.parquet"
    scenarios.load("camps2009-accelerometer").simulate(seed=1).write(path)
    return str(path)


def test_levenberg_marquardt_from_the_data_sheet(tumbles: str, rig: Rig) -> None:
    found = {}
    for name, options in (("direct", ()), ("sheet", ("--start", "datasheet")), ("numbers", ("--start", "1.8,0"))):
        call = ["calibrate", tumbles, "--method", "ellipsoid", "--static-threshold", "0.0016", "--json", *options]
        found[name] = json.loads(rig.done(*call))["sensors"]["accelerometer"]
    bias = {name: np.array(sensor["bias"]) for name, sensor in found.items()}
    # The paper's own precision is 1e-2 V; both ways end within a hundredth of it, as their noise lets them.
    np.testing.assert_allclose(bias["sheet"], bias["direct"], atol=1e-3)
    np.testing.assert_allclose(bias["numbers"], bias["sheet"], atol=1e-6)
    assert found["sheet"]["samples"] > 600  # single readings at rest, not means of poses


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--start", "fast"), "expected 'datasheet', GAIN"),
        (("--start", "-1"), "expected 'datasheet', GAIN"),
        (("--start", "gyro=1"), "unknown recorded sensor of --start 'gyro'"),
        (("--static-threshold", "0"), "expected a positive variance"),
        (("--fminunc",), "calibrated without the attitude"),
    ],
)
def test_wrong_calls_are_refused(tumbles: str, rig: Rig, options: tuple[str, ...], message: str) -> None:
    assert message in rig.refused("calibrate", tumbles, *options)
