"""Cells of a log that hold no number: their rows are left out and said, and no reading is made up in their place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli_support import SMALL

from rig.errors import RigError
from rig.recording import Recording
from scenarios.importing import Imported, import_logs
from scenarios.loader import from_toml

ROWS = 600
POSES = tuple(f"q{joint}" for joint in range(1, 7))
Columns = dict[str, np.ndarray]


@pytest.fixture
def run() -> Recording:
    return from_toml(SMALL, "small.toml").simulate(0)


def columns(run: Recording) -> Columns:
    """The run as another program would log it."""
    assert run.q is not None
    found = {"t_s": run.t.copy()}
    found |= {f"q{joint + 1}_rad": run.q[:, joint].copy() for joint in range(6)}
    found |= {f"accel{axis + 1}_V": run.readings("accelerometer")[:, axis].copy() for axis in range(3)}
    found |= {f"mag{axis + 1}_V": run.readings("magnetometer")[:, axis].copy() for axis in range(3)}
    return found


def logged(path: Path, columns: Columns) -> Path:
    """A table in which NaN is an empty cell."""
    rows = [
        ",".join("" if np.isnan(cell) else repr(float(cell)) for cell in row)
        for row in zip(*columns.values(), strict=True)
    ]
    path.write_text("\n".join([",".join(columns), *rows]) + "\n")
    return path


def imported(folder: Path, columns: Columns) -> Imported:
    return import_logs([logged(folder / "log.csv", columns)], None, None)


def is_part_of(found: Recording, run: Recording, rows: np.ndarray) -> None:
    """Every value that came out was logged in that row: nothing is in between."""
    np.testing.assert_array_equal(found.accelerometer, run.accelerometer[rows])  # type: ignore[index]
    np.testing.assert_array_equal(found.magnetometer, run.magnetometer[rows])  # type: ignore[index]
    np.testing.assert_array_equal(found.q, run.q[rows])  # type: ignore[index]


@pytest.mark.parametrize("timed", [True, False])
def test_a_row_with_a_missing_cell_is_left_out_and_said(tmp_path: Path, run: Recording, timed: bool) -> None:
    table = columns(run)
    table["accel2_V"][5] = table["q2_rad"][77] = np.nan
    table["mag2_V"][[300, 301]] = np.nan
    if not timed:
        del table["t_s"]
    found = imported(tmp_path, table)
    is_part_of(found.recording, run, np.delete(np.arange(ROWS), [5, 77, 300, 301]))
    (line,) = [line for line in found.findings if "left out" in line]
    assert line == (
        f"{tmp_path / 'log.csv'}: 4 of {ROWS} rows left out, in which a cell holds no number: accel2_V (row 5),"
        " mag2_V (2, first row 300), q2_rad (row 77); rows are counted from 0"
    )
    assert found.recording.metadata.pose_rate_Hz is None


def test_readings_that_fail_together_are_not_made_up_either(tmp_path: Path, run: Recording) -> None:
    table = columns(run)
    lost = np.arange(100, 200)
    for axis in (1, 2, 3):
        table[f"mag{axis}_V"][lost] = np.nan
    found = imported(tmp_path, table)
    is_part_of(found.recording, run, np.delete(np.arange(ROWS), lost))
    assert any(f"100 of {ROWS} rows left out" in line for line in found.findings)


def test_poses_at_a_rate_of_their_own_are_interpolated_as_before(tmp_path: Path, run: Recording) -> None:
    table = columns(run)
    for name in POSES:
        table[f"{name}_rad"][np.arange(ROWS) % 4 > 0] = np.nan
    table["q3_rad"][40] = np.nan
    found = imported(tmp_path, table)
    assert len(found.recording) == ROWS - 3  # the last pose is in row 596
    np.testing.assert_array_equal(found.recording.accelerometer, run.accelerometer[: ROWS - 3])  # type: ignore[index]
    assert any("poses are interpolated" in line for line in found.said)
    (line,) = [line for line in found.findings if "left out" in line]
    assert "1 of 150 rows of joint left out, in which a cell holds no number: q3_rad (row 40)" in line


def test_sensors_in_rows_of_their_own_are_no_missing_cells(tmp_path: Path, run: Recording) -> None:
    """Each row holds what one sensor sent: three of five the magnetometer, two of five the accelerometer."""
    table = columns(run)
    of_mag = np.arange(ROWS) % 5 < 3
    for axis in (1, 2, 3):
        table[f"accel{axis}_V"][of_mag] = np.nan
        table[f"mag{axis}_V"][~of_mag] = np.nan
    for name in POSES:
        del table[f"{name}_rad"]
    found = imported(tmp_path, table)
    assert not [line for line in found.findings if "left out" in line]
    np.testing.assert_array_equal(found.recording.accelerometer, run.accelerometer[~of_mag][:-2])  # type: ignore[index]


def test_a_slow_temperature_costs_no_reading(tmp_path: Path, run: Recording) -> None:
    table = columns(run)
    table["temperature_degC"] = np.linspace(20.0, 26.0, ROWS)
    table["temperature_degC"][50:60] = np.nan
    found = imported(tmp_path, table)
    assert len(found.recording) == ROWS
    np.testing.assert_allclose(found.recording.temperature, np.linspace(20.0, 26.0, ROWS), atol=1e-12)
    assert any(f"temperature is missing in 10 of {ROWS} rows: interpolated there" in line for line in found.said)


def test_without_times_the_rows_of_two_logs_must_be_whole(tmp_path: Path, run: Recording) -> None:
    """A row that is left out of one of them would move all that follow."""
    table = columns(run)
    del table["t_s"]
    table["accel2_V"][5] = table["q2_rad"][77] = np.nan
    poses = {name: values for name, values in table.items() if name.startswith("q")}
    readings = {name: values for name, values in table.items() if not name.startswith("q")}
    paths = [logged(tmp_path / "imu.csv", readings), logged(tmp_path / "arm.csv", poses)]
    with pytest.raises(
        RigError, match=r"imu\.csv: 1 of 600 rows left out for a cell without a number, and without times .*expected"
    ):
        import_logs(paths, None, None)


def test_poses_without_a_row_in_common_with_readings_are_refused_without_times(tmp_path: Path, run: Recording) -> None:
    table = columns(run)
    del table["t_s"]
    for name in POSES:
        table[f"{name}_rad"][::2] = np.nan
    table["mag1_V"][1::2] = np.nan
    with pytest.raises(RigError, match=r"found no row with all of accel, mag, joint, expected still poses"):
        imported(tmp_path, table)
