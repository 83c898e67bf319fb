"""A stream, a sliding window and merged parts give the calibration of one pass; in any unit, from joints or poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import reduce
from itertools import accumulate
from operator import add
from pathlib import Path

import numpy as np
import pytest
from kinematic_examples import MAGNETOMETER_NOISE, TRUTHS, readings, sweep_angles, sweep_rotations

from estimators import Calibration, calibrate, noise_floor
from estimators.known_angle.fit import SensorFit, fit_sensor
from estimators.known_angle.from_recording import summarise
from estimators.known_angle.statistics import Statistics
from rig.arm import Arm
from rig.pose_nodes import quaternions
from rig.recording import Metadata, Recording, RecordingWriter, scan_recording
from rig.units import conversion_factor

EPS = np.finfo(float).eps
TRUTH, NOISE = TRUTHS["table5"]


def noisy(seed: int = 0) -> np.ndarray:
    rotations = sweep_rotations()
    return readings(rotations, TRUTH) + NOISE * np.random.default_rng(seed).standard_normal((len(rotations), 3))


def blocks(size: int, seed: int = 0) -> list[Statistics]:
    rotations, volts = sweep_rotations(), noisy(seed)
    return [
        Statistics.from_rotations(rotations[start : start + size], volts[start : start + size])
        for start in range(0, len(rotations), size)
    ]


def fit(statistics: Statistics) -> SensorFit:
    return fit_sensor(statistics, 9.8, noise=NOISE)


def apart(found: SensorFit, expected: SensorFit) -> float:
    """The largest difference of any parameter, in units of S |g|, S |g|, rad, rad: those of rounding."""
    a, b = found.parameters, expected.parameters
    size = b.scales[:, 1]
    return max(
        float(np.abs(a.sensitivity / b.sensitivity - 1.0).max()),
        float(np.abs((a.offset - b.offset) / size).max()),
        float(np.abs(a.axes - b.axes).max()),
        float(np.abs(a.fields - b.fields).max()),
    )


#: What rounding may do: sums of n terms by blocks lose some eps of themselves, readings are two to four times S |g|,
#: and the sweep's condition is 4.
ROUNDING = 1e3 * EPS


def test_a_stream_is_one_pass() -> None:
    """Whatever comes in at a time: single samples, blocks, all."""
    whole = fit(Statistics.from_rotations(sweep_rotations(), noisy()))
    for size in (1, 17, 1000):
        *_, total = accumulate(blocks(size))
        found = fit(total)
        assert found.count == whole.count
        assert apart(found, whole) < ROUNDING
        std = np.sqrt(whole.covariance.diagonal())
        assert np.abs((found.covariance - whole.covariance) / np.outer(std, std)).max() < ROUNDING
        # What is left of readings' squares of 40,000 V^2, good to some eps, over residuals of 1.2 V^2.
        assert found.residual_square == pytest.approx(whole.residual_square, rel=1e-9)


def test_a_stream_can_be_asked_at_any_time() -> None:
    """After every block: the calibration of what has come so far, ever more certain."""
    rotations, volts = sweep_rotations(), noisy()
    deviations = []
    for total in accumulate(blocks(832)):
        now = fit(total)
        expected = fit(Statistics.from_rotations(rotations[: total.count], volts[: total.count]))
        assert apart(now, expected) < ROUNDING
        deviations.append(np.sqrt(now.covariance.diagonal()))
    assert (np.diff(np.array(deviations), axis=0) < 0.0).all()


def test_parts_merge_in_any_order() -> None:
    """As a cluster gives them back."""
    parts = blocks(256)
    whole = fit(Statistics.from_rotations(sweep_rotations(), noisy()))
    for seed in range(3):
        order = np.random.default_rng(seed).permutation(len(parts))
        assert apart(fit(reduce(add, [parts[i] for i in order])), whole) < ROUNDING


def test_a_file_is_read_in_batches_without_a_trace(tmp_path: Path) -> None:
    """From memory, from a file whole or in batches of seven samples, and from a file written in pieces."""
    recording = recorded()
    expected = calibrate(recording)
    recording.write(tmp_path / "run.parquet")
    with RecordingWriter(tmp_path / "pieces.parquet") as writer:
        for start in range(0, len(recording), 1000):
            writer.write(recording.select(slice(start, start + 1000)))
    for name in ("run.parquet", "pieces.parquet"):
        assert_same(calibrate(tmp_path / name), expected)
    summed = summarise(scan_recording(tmp_path / "run.parquet", batch_rows=7), recording.sensors)
    together = summarise(recording, recording.sensors)
    assert summed.statistics.gram == pytest.approx(together.statistics.gram, rel=1e-12, abs=1e-9)


# --- units and poses -------------------------------------------------------------------------------------------------


def recorded(units: Mapping[str, str] | None = None, scale: Mapping[str, float] | None = None) -> Recording:
    """The paper's two sensors on its sweep, readings in volts times ``scale``, named ``units``."""
    rotations = sweep_rotations()
    field = TRUTHS["table10"][0]
    rng = np.random.default_rng(1)
    magnetometer = readings(rotations, field) + MAGNETOMETER_NOISE * rng.standard_normal((len(rotations), 3))
    scale = scale or {}
    return Recording(
        t=np.arange(len(rotations)) / 4.0,
        q=sweep_angles(),
        accelerometer=noisy() * scale.get("accelerometer", 1.0),
        magnetometer=magnetometer * scale.get("magnetometer", 1.0),
        units=units or {},
        metadata=Metadata(rate_Hz=4.0),
    )


def assert_same(
    found: Calibration, expected: Calibration, scale: Mapping[str, float] | None = None, tolerance: float = 1e-6
) -> None:
    """Within ``tolerance`` of a standard deviation, with everything in the recorded unit times ``scale``."""
    for sensor in expected.sensors:
        factor = (scale or {}).get(sensor, 1.0)
        a, b = found[sensor], expected[sensor]
        sizes = np.array([factor if name.startswith(("sensitivity", "offset")) else 1.0 for name in b.parameters])
        std = sizes * np.sqrt(b.covariance.diagonal())
        told = np.isfinite(std)
        assert (np.isfinite(np.sqrt(a.covariance.diagonal())) == told).all()
        assert np.abs((a.values - sizes * b.values) / std)[told].max() <= tolerance
        spread = np.outer(std, std)[np.ix_(told, told)]
        difference = a.covariance - np.outer(sizes, sizes) * b.covariance
        assert np.abs(difference[np.ix_(told, told)] / spread).max() <= tolerance
        for name in ("fit_rms", "noise", "bias"):
            assert getattr(a, name) == pytest.approx(factor * getattr(b, name), rel=max(tolerance, 1e-15))
        assert a.matrix == pytest.approx(b.matrix / factor, rel=max(tolerance, 1e-15), abs=1e-12 / factor)


UNITS = [
    ({"accelerometer": "mV", "magnetometer": "mV"}, {"accelerometer": 1e3, "magnetometer": 1e3}),
    ({"accelerometer": "g", "magnetometer": "G"}, {"accelerometer": 0.7, "magnetometer": 0.4}),
    ({"accelerometer": "m_s2", "magnetometer": "uT"}, {"accelerometer": 7.0, "magnetometer": 42.0}),
    ({"accelerometer": "raw", "magnetometer": "raw"}, {"accelerometer": 819.2, "magnetometer": 819.2}),
]


@pytest.mark.parametrize("method", ["simultaneous", "separate"])
@pytest.mark.parametrize(("units", "scale"), UNITS, ids=lambda value: "-".join(map(str, value.values())))
def test_results_follow_the_unit(method: str, units: Mapping[str, str], scale: Mapping[str, float]) -> None:
    """Numbers c times as large, whatever they are called: S, delta, noise and residuals are c times as large, their
    covariances c^2, angles the same. Only the last digits know, which the search ends in: 1e-6 of a standard deviation.
    """
    found = calibrate(recorded(units, scale), method=method)  # type: ignore[arg-type]
    assert_same(found, calibrate(recorded(), method=method), scale)  # type: ignore[arg-type]
    assert {sensor: found[sensor].unit for sensor in units} == dict(units)


def test_a_power_of_two_changes_a_last_digit_at_most() -> None:
    """Multiplication by 1024 is exact, and so are the sums. Of the search only norms that mix the field's direction
    with readings differ: 1e-11 of a standard deviation is 1e-15 of the value."""
    scale = {"accelerometer": 1024.0, "magnetometer": 1.0 / 64.0}
    assert_same(calibrate(recorded(None, scale)), calibrate(recorded()), scale, tolerance=1e-11)


def test_a_floor_in_another_unit_is_converted() -> None:
    """The run in volts, the locked recording in millivolts."""
    run = recorded()
    rng = np.random.default_rng(2)
    q = np.repeat(sweep_angles()[:2], 1000, axis=0)
    still = {"t": np.arange(2000) / 1000.0, "q": q, "metadata": Metadata(rate_Hz=1000.0)}
    volts = {"accelerometer": NOISE * rng.standard_normal((2000, 3))}
    in_volts = noise_floor(Recording(**still, **volts))  # type: ignore[arg-type]
    factor = 1.0 / conversion_factor("mV", "V")
    millivolts = {"accelerometer": factor * volts["accelerometer"]}
    in_millivolts = noise_floor(Recording(**still, **millivolts, units={"accelerometer": "mV"}))  # type: ignore[arg-type]
    expected = calibrate(run, noise=in_volts, sensors=["accelerometer"])
    assert_same(calibrate(run, noise=in_millivolts, sensors=["accelerometer"]), expected)


@pytest.mark.parametrize("method", ["simultaneous", "separate"])
def test_tool_poses_give_what_joint_angles_give(method: str) -> None:
    """Quaternions of the same orientations, of either sign: R to a few eps."""
    run = recorded()
    turns = quaternions(sweep_rotations().reshape(-1, 3, 3))
    turns *= np.random.default_rng(3).choice([-1.0, 1.0], (len(turns), 1))
    expected = calibrate(run, method=method)  # type: ignore[arg-type]
    tool = replace(run, q=None, tool_quaternion=turns)
    found = calibrate(tool, method=method)  # type: ignore[arg-type]
    assert_same(found, expected)
    assert (expected.arm, found.arm) == ("a465", None)
    # With both, an arm that is named has the word; without, the tool.
    both = replace(run, tool_quaternion=np.roll(turns, 1000, axis=0))
    assert_same(calibrate(both, method=method, arm=Arm.a465()), expected)  # type: ignore[arg-type]


def test_tool_poses_and_any_unit_stream_from_a_file(tmp_path: Path) -> None:
    run = recorded(*UNITS[2])
    tool = replace(run, q=None, tool_quaternion=quaternions(sweep_rotations().reshape(-1, 3, 3)))
    for name in ("tool.parquet", "tool.csv"):
        tool.write(tmp_path / name)
        assert_same(calibrate(tmp_path / name), calibrate(recorded()), UNITS[2][1])
