"""Recordings in memory: checked, read-only, selected from; their metadata, units and rotations."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_examples import assert_same, example, tumble
from scipy.spatial.transform import Rotation

from rig.errors import RigError
from rig.recording import Metadata, Recording, read_recording
from rig.units import UNITS, conversion_factor


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"t": np.arange(40.0)[::-1]}, "row 1 (first row 0) has 38.0 after 39.0"),
        ({"t": np.zeros((40, 1))}, "t has shape (40, 1), expected (N,)"),
        ({"t": []}, "no samples"),
        ({"q": np.zeros((39, 6))}, "q has shape (39, 6), expected (40, N)"),
        ({"q": np.zeros(40)}, "q has shape (40,)"),
        ({"q": np.full((40, 6), math.nan)}, "q1_rad in row 0 (first row 0) is NaN"),
        ({"accelerometer": np.zeros((40, 2))}, "accelerometer has shape (40, 2), expected (40, 3)"),
        ({"accelerometer": "text"}, "accelerometer does not hold numbers"),
        ({"accelerometer": None, "magnetometer": None}, "no sensor"),
        ({"magnetometer": None, "units": {"magnetometer": "V"}}, "'magnetometer', which was not recorded"),
        ({"units": {"accelerometer": "uT"}}, "unknown unit 'uT' of the accelerometer, expected one of V"),
        ({"tool_position": np.zeros((40, 3))}, "partial pose"),
        ({"currents": {0: np.zeros(40)}}, "joint 0"),
        ({"currents": {2: np.zeros(4)}}, "current2 has shape (4,)"),
        ({"supply": np.full(40, math.inf)}, "supply_V in row 0"),
    ],
)
def test_arrays_that_make_no_recording(changes: dict[str, Any], complaint: str) -> None:
    with pytest.raises(RigError) as caught:
        example(name="mine", **changes)
    assert str(caught.value).startswith("mine: ")
    assert complaint in str(caught.value)


def test_the_arrays_are_read_only_and_the_callers_stay_writable() -> None:
    t, readings = np.arange(5.0), np.zeros((5, 3), order="F")
    recording = Recording(t=t, magnetometer=readings)
    for array in (recording.t, recording.readings("magnetometer")):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    assert t.flags.writeable
    assert readings.flags.writeable


def test_numbers_whose_powers_are_none_are_refused() -> None:
    assert len(Recording(t=np.arange(4.0), accelerometer=np.full((4, 3), 9e59))) == 4
    with pytest.raises(RigError, match=r"accel1_V in row 0 .* is 1.79.*e\+308, expected a number below 1e\+60"):
        Recording(t=np.arange(4.0), accelerometer=np.full((4, 3), np.finfo(float).max))


def test_selections() -> None:
    recording = tumble()
    assert_same(recording.select(slice(1, None, 3)), recording.select(np.arange(1, 40, 3)))
    mask = recording.t > 3.0
    assert_same(recording.select(mask), recording.select(slice(13, None)))
    np.testing.assert_array_equal(recording.select(mask).currents[5], recording.currents[5][13:])
    with pytest.raises(RigError, match="does not increase"):
        recording.select(np.array([3, 2]))
    with pytest.raises(RigError, match="no samples"):
        recording.select(slice(0, 0))


def test_summary_properties() -> None:
    recording = example()
    assert (recording.duration_s, recording.rate_Hz, recording.pose) == (9.75, 4.0, "joints")
    assert replace(recording, metadata=Metadata()).rate_Hz == 4.0
    assert "40 samples, 9.75 s, pose: joints, accelerometer [V], magnetometer [V]" in repr(recording)
    assert replace(tumble(), q=np.zeros((40, 6))).pose == "joints and tool"
    one = Recording(t=np.zeros(1), magnetometer=np.zeros((1, 3)))
    with pytest.raises(RigError, match="one sample has no rate"):
        _ = one.rate_Hz
    with pytest.raises(RigError, match="has no accelerometer, found magnetometer"):
        one.readings("accelerometer")
    with pytest.raises(RigError, match="nearest: 'magnetometer'"):
        one.unit("magnetometre")


def test_calibrated_readings_carry_their_units(tmp_path: Path) -> None:
    fields = {"accelerometer": np.full((40, 3), 9.8), "magnetometer": np.full((40, 3), 0.5)}
    for unit, column in ((None, "mag1_raw"), ("G", "mag1_G"), ("uT", "mag1_uT")):
        recording = replace(example(), metadata=Metadata(magnetic_field_unit=unit))
        recording.with_fields(fields).write(tmp_path / "out.parquet")
        found = read_recording(tmp_path / "out.parquet")
        assert {"accel1_m_s2", column} < set(found.table())
        np.testing.assert_array_equal(found.readings("accelerometer"), fields["accelerometer"])
        assert found.metadata == recording.metadata
    assert example().with_fields({"magnetometer": fields["magnetometer"]}).sensors == ("magnetometer",)


def test_rotations_of_quaternions_are_scipys() -> None:
    n = 10_000  # several blocks, the last one not full
    turns = Rotation.random(n, rng=np.random.default_rng(3))
    scaled = turns.as_quat(scalar_first=True) * np.linspace(0.9995, 1.0005, n)[:, None]
    expected = turns.as_matrix().reshape(n, 9)
    recording = Recording(t=np.arange(n, dtype=np.float64), tool_quaternion=scaled, accelerometer=np.zeros((n, 3)))
    # Entries of order one, from some ten roundings each.
    np.testing.assert_allclose(recording.rotations(None), expected, atol=10 * np.finfo(float).eps, rtol=0)


def test_rotations_need_a_pose_and_the_right_arm() -> None:
    arm_module = pytest.importorskip("rig.arm")
    arm = arm_module.Arm.a465()
    recording = example()
    expected = arm.poses(recording.q).R_base_tool.reshape(-1, 9)
    np.testing.assert_allclose(
        recording.rotations(arm), expected, atol=1e-13, rtol=0
    )  # six rotations of rounding 1e-15
    both = replace(tumble(), q=recording.q)
    np.testing.assert_array_equal(both.rotations(arm), recording.rotations(arm))
    np.testing.assert_array_equal(both.rotations(None), tumble().rotations(arm))
    with pytest.raises(RigError, match="an arm is needed"):
        recording.rotations(None)
    with pytest.raises(RigError, match="found 5 joint angles, expected 6"):
        replace(recording, q=np.zeros((40, 5))).rotations(arm)
    with pytest.raises(RigError, match="has no pose"):
        replace(recording, q=None).rotations(arm)


def test_unit_conversions() -> None:
    assert conversion_factor("g", "m_s2") == 9.80665
    assert conversion_factor("uT", "G") == 0.01
    assert conversion_factor("G", "uT") == 100.0
    assert conversion_factor("mV", "V") == 0.001
    assert all(conversion_factor(unit, unit) == 1.0 for units in UNITS.values() for unit in units)
    with pytest.raises(RigError, match="'V' cannot be converted to 'm_s2': expected one of V, mV"):
        conversion_factor("V", "m_s2")
    with pytest.raises(RigError, match="unknown unit 'gauss'"):
        conversion_factor("gauss", "G")


def test_metadata_survive_json() -> None:
    metadata = Metadata(gravity_m_s2=9.80292, rate_Hz=100, notes=["a", {"b": None}], extra={"sensor_serial": 7})
    assert Metadata.from_text(metadata.to_text(), "run") == metadata
    assert json.loads(Metadata().to_text())["format"] == "rig-recording/1"
    with pytest.raises(RigError, match="cannot be written as JSON"):
        Metadata(notes={1j})
    with pytest.raises(RigError, match="'arm', which has its own field"):
        Metadata(extra={"arm": "a465"})
    with pytest.raises(RigError, match="'x SERIAL', which is read as 'serial' misspelt"):
        Metadata(extra={"x SERIAL": 7})
    assert Metadata(serial=3, extra={"x SERIAL": 7}).extra == {"x SERIAL": 7}
