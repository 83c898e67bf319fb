"""Columns of a log that came to nothing are listed: loudly where a sensor or the pose is missing."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli_support import SMALL, Rig

from rig.recording import Recording, read_recording
from scenarios.importing import Mapping, import_logs
from scenarios.loader import from_toml


@pytest.fixture
def run() -> Recording:
    return from_toml(SMALL, "small.toml").simulate(0)


def logged(path: Path, run: Recording, names: dict[str, str]) -> Path:
    """The run as a table without metadata, its columns renamed."""
    run.write(path)
    header, *rows = path.read_text().split("\n")[1:]
    path.write_text("\n".join([",".join(names.get(name, name) for name in header.split(",")), *rows]))
    return path


GERMAN = {f"accel{axis}_V": f"Beschl. {letter} [V]" for axis, letter in zip((1, 2, 3), "XYZ", strict=True)}
GERMAN |= {f"q{joint}_rad": f"Winkel {joint} [rad]" for joint in range(1, 7)}


def test_columns_that_may_be_what_is_missing_are_a_finding(rig: Rig, tmp_path: Path, run: Recording) -> None:
    log = logged(tmp_path / "log.csv", run, GERMAN)
    out = tmp_path / "out.parquet"
    shown = rig.done("import", log, "-o", out)
    (line,) = [line for line in shown.splitlines() if "not used" in line]
    assert line.startswith(f"! {log}: 9 columns not used: ")
    assert all(repr(name) in line for name in GERMAN.values())
    assert "no accelerometer and no pose was recognised: name the columns in --map MAP.toml" in line
    assert set(json.loads(rig.done("import", log, "--json"))["unused"][str(log)]) == set(GERMAN.values())


def test_columns_beside_a_whole_recording_are_only_said(tmp_path: Path, run: Recording) -> None:
    log = logged(tmp_path / "log.csv", run, {})
    header, *rows = log.read_text().split()
    log.write_text("\n".join([f"{header},gyro_x,state", *(f"{row},0.5,3" for row in rows)]) + "\n")
    found = import_logs([log], None, None)
    assert f"{log}: 2 columns not used: 'gyro_x', 'state'" in found.said
    assert not [line for line in found.findings if "not used" in line]
    assert found.unused == {str(log): ("gyro_x", "state")}


def test_a_log_of_which_all_is_used_says_nothing(tmp_path: Path, run: Recording) -> None:
    found = import_logs([logged(tmp_path / "log.csv", run, {})], None, None)
    assert not found.unused
    assert not [line for line in (*found.said, *found.findings) if "not used" in line]


def test_places_of_the_tool_beside_joints_are_not_used_although_they_are_mapped(tmp_path: Path, run: Recording) -> None:
    log = logged(tmp_path / "log.csv", run, {})
    header, *rows = log.read_text().split()
    places = ("px_mm", "py_mm", "pz_mm")
    log.write_text("\n".join([f"{header},{','.join(places)}", *(f"{row},1,2,3" for row in rows)]) + "\n")
    columns = dict(import_logs([log], None, None).mapping.columns)
    columns |= {name: f"{axis}_mm" for name, axis in zip(places, "xyz", strict=True)}
    assert import_logs([log], Mapping(columns), None).unused == {str(log): places}


def test_a_long_list_is_cut_on_the_screen_alone(tmp_path: Path, run: Recording) -> None:
    log = logged(tmp_path / "log.csv", run, {})
    header, *rows = log.read_text().split()
    names = [f"state{number}x" for number in range(40)]
    log.write_text("\n".join([",".join([header, *names]), *(row + ",1" * 40 for row in rows)]) + "\n")
    found = import_logs([log], None, None)
    assert found.unused[str(log)] == tuple(names)
    assert any(line.endswith("'state23x' and 16 more") for line in found.said), found.said


def test_motor_currents_that_are_mapped_are_recorded(tmp_path: Path, run: Recording) -> None:
    log = logged(tmp_path / "log.csv", run, {})
    header, *rows = log.read_text().split()
    log.write_text("\n".join([f"{header},I5,I2", *(f"{row},0.5,{number}" for number, row in enumerate(rows))]) + "\n")
    columns = {**import_logs([log], None, None).mapping.columns, "I5": "current5_A", "I2": "current2_A"}
    found = import_logs([log], Mapping(columns), None)
    assert not found.unused
    found.recording.write(tmp_path / "out.parquet")
    currents = read_recording(tmp_path / "out.parquet").currents
    np.testing.assert_array_equal(currents[5], 0.5)
    np.testing.assert_array_equal(currents[2], np.arange(len(run)))
