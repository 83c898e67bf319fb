"""Logs with bad cells, bad times or odd line ends: refused in one line that names the file, or said to be left out."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import SMALL, Rig
from diagnosed_recordings import recorded

import estimators
from rig.effects import EFFECTS
from rig.errors import RigError
from rig.recording import Metadata, read_recording
from scenarios.importing import Mapping, import_logs
from scenarios.importing.mapping import Conventions
from scenarios.loader import from_toml

ROWS = 600


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A recording as another program would log it, without metadata."""
    path = tmp_path / "log.csv"
    from_toml(SMALL, "small.toml").simulate(0).write(path)
    path.write_text(path.read_text().split("\n", 1)[1])
    return path


def spoil(log: Path, row: int, cell: str, column: str = "t_s") -> None:
    """Change one cell."""
    names, *rows = [line.split(",") for line in log.read_text().splitlines()]
    rows[row][names.index(column)] = cell
    log.write_text("\n".join(map(",".join, [names, *rows])) + "\n")


def without(log: Path, beginning: str) -> Path:
    """The log without the columns whose names begin so, in a file of that name."""
    rows = [line.split(",") for line in log.read_text().splitlines()]
    kept = [column for column, name in enumerate(rows[0]) if not name.startswith(beginning)]
    path = log.with_name(f"{beginning}.csv")
    path.write_text("\n".join(",".join(row[column] for column in kept) for row in rows) + "\n")
    return path


@pytest.mark.parametrize(
    ("cell", "message"),
    [
        ("1e300", "in row 50 (first row 0) is 1e+300, expected a number below 1e+60"),
        ("inf", "in row 50 (first row 0) is inf, expected a number"),
        ("soon", "holds 'soon' in row 50 (first row 0), expected seconds"),
    ],
)
def test_a_bad_time_of_one_log_of_two_is_named_with_its_file(rig: Rig, log: Path, cell: str, message: str) -> None:
    joints = without(without(log, "accel"), "mag")
    imu = without(log, "q")
    spoil(imu, 50, cell)
    for order in ((imu, joints), (joints, imu), (imu,)):
        assert rig.refused("import", *order, "-o", log.with_name("out.parquet")) == f"rig: {imu}: t_s {message}"
    assert not log.with_name("out.parquet").exists()


def test_a_row_without_a_time_is_said_to_be_left_out(log: Path) -> None:
    spoil(log, 50, "")
    found = import_logs([log], None, None)
    assert len(found.recording) == ROWS - 1
    assert f"{log}: t_s is missing in 1 of {ROWS} rows, such as row 50 (first row 0): left out" in found.findings


def test_times_that_go_back_are_counted(log: Path) -> None:
    spoil(log, 50, "-1")
    found = import_logs([log], None, None)
    assert f"{log}: time goes back once, first at row 50 (first row 0): sorted" in found.findings
    assert found.recording.metadata.findings == (f"{log}: time goes back once, first at row 50 (first row 0): sorted",)


def test_a_stamp_that_is_no_time_is_refused_and_an_early_one_is_a_gap(rig: Rig, log: Path) -> None:
    spoil(log, 50, "1e15")
    line = rig.refused("import", log, "-o", log.with_name("out.parquet"))
    assert line == (
        f"rig: {log}: t_s in row 50 (first row 0) is 1e+15, in s by the name 't_s': expected times below 1e+11 s, or"
        " another --time-unit"
    )
    assert rig.refused("import", log, "--time-unit", "ms").endswith("or another --time-unit")
    spoil(log, 50, "1e6")
    (gap,) = [line for line in import_logs([log], None, None).findings if "gap" in line]
    assert gap == f"a gap of {1e6 - 59.9:.4g} s after row {ROWS - 2}; the median step is 0.1 s"


def test_what_the_import_found_stays_with_the_recording(rig: Rig, log: Path) -> None:
    out = log.with_name("out.parquet")
    spoil(log, 50, "1e6")
    rig.done("import", log, "-o", out, "--gravity", "9.8", "--field", "1G")
    went_back = f"{log}: time goes back once, first at row 51 (first row 0): sorted"
    gap = f"a gap of {1e6 - 59.9:.4g} s after row {ROWS - 2}; the median step is 0.1 s"
    assert read_recording(out).metadata.findings == (went_back, gap)
    checked = rig("check", out, "--json")
    assert checked.status == 1
    findings = json.loads(checked.out)["findings"]
    assert f"rig import found: {went_back}" in findings
    assert sum("a gap of" in line for line in findings) == 1  # check looks for that itself
    again = log.with_name("again.csv")
    read_recording(out).write(again)
    assert read_recording(again).metadata.findings == (went_back, gap)


def test_findings_of_another_kind_are_refused(log: Path) -> None:
    with pytest.raises(RigError, match="metadata findings: found 'a word', expected a list of texts"):
        Metadata(findings="a word")  # type: ignore[arg-type]


def test_a_diagnosis_repeats_what_the_import_found() -> None:
    run, locked = recorded()
    found = replace(run, metadata=replace(run.metadata, findings=("poses: the other sign",)))
    few = [name for name in EFFECTS if name != "joint_offset"]
    assert "rig import found: poses: the other sign" in estimators.diagnose(found, locked, without=few).warnings


def test_a_text_in_a_column_that_is_wanted_is_named(rig: Rig, log: Path) -> None:
    spoil(log, 7, "abc", "mag2_V")
    line = rig.refused("import", log, "-o", log.with_name("out.parquet"))
    assert line == f"rig: {log}: mag2_V holds 'abc' in row 7 (first row 0), expected a number"
    columns = {"t_s": "t"} | {f"accel{axis}_V": f"accel{axis}_V" for axis in (1, 2, 3)}
    assert len(import_logs([log], Mapping(columns), None).recording) == ROWS  # it is not asked for


def test_a_cell_that_is_no_utf8_is_named_too(rig: Rig, log: Path) -> None:
    spoil(log, 7, "abc", "mag2_V")
    log.write_bytes(log.read_bytes().replace(b"abc", b"a\xffc"))
    line = rig.refused("import", log, "-o", log.with_name("out.parquet"))
    assert line.startswith(f"rig: {log}: mag2_V holds 'a")
    assert line.endswith("in row 7 (first row 0), expected a number")


def test_numbers_with_decimal_commas_beside_a_text_are_numbers(rig: Rig, log: Path) -> None:
    log.write_text(log.read_text().replace(",", ";").replace(".", ","))
    same = import_logs([log], None, None).recording
    text = log.read_text().splitlines()
    log.write_text(
        "\n".join([f"{text[0]};note", *(f"{row};{'x' if n % 3 else '1,5'}" for n, row in enumerate(text[1:]))])
    )
    np.testing.assert_array_equal(import_logs([log], None, None).recording.accelerometer, same.accelerometer)


def test_an_empty_column_of_times_is_not_taken_for_none(rig: Rig, log: Path) -> None:
    names, *rows = log.read_text().splitlines()
    log.write_text("\n".join([names, *(f",{row.split(',', 1)[1]}" for row in rows)]) + "\n")
    assert rig.refused("import", log, "-o", log.with_name("o.csv")) == f"rig: {log}: t_s is empty, expected seconds"


def test_line_ends_of_old_macs_are_read_by_the_import_alone(rig: Rig, log: Path) -> None:
    same = import_logs([log], None, None).recording
    log.write_bytes(log.read_bytes().replace(b"\n", b"\r"))
    np.testing.assert_array_equal(import_logs([log], None, None).recording.accelerometer, same.accelerometer)
    line = rig.refused("check", log)
    assert line.endswith("its lines end with a carriage return alone, expected line feeds; rig import reads them")


def test_a_header_without_end_is_not_called_a_comment(rig: Rig, tmp_path: Path) -> None:
    (tmp_path / "wide.csv").write_text(",".join(f"c{number}" for number in range(200_000)) + "\n")
    line = rig.refused("import", tmp_path / "wide.csv", "-o", tmp_path / "out.csv")
    assert line.endswith("wide.csv: has a line of more than 65536 bytes, expected a table of numbers")


def test_a_stated_offset_of_the_clock_holds_within_one_log_too(rig: Rig, log: Path) -> None:
    plain = import_logs([log], None, None).recording
    late = import_logs([log], None, None, Mapping(conventions=Conventions(clock_offset_s=0.5))).recording
    # Poses half a second later: a row's reading meets the pose of five rows before.
    np.testing.assert_allclose(late.q, plain.q[: len(late)], atol=1e-9)  # type: ignore[index]
    np.testing.assert_array_equal(late.accelerometer, plain.accelerometer[5:])  # type: ignore[index]
    line = rig.refused("import", log, "-o", log.with_name("out.csv"), "--clock-offset", "1e30")
    assert "do not overlap" in line


def test_rows_that_begin_with_the_newest_are_sorted(log: Path) -> None:
    """Some loggers write so: it once was a log without times, of poses held still."""
    names, *rows = log.read_text().splitlines()
    upright = import_logs([log], None, None)
    log.write_text("\n".join(["time" + names[len("t_s") :], *reversed(rows)]) + "\n")
    found = import_logs([log], None, None)
    assert any(f"time goes back {len(rows) - 1} times" in line for line in found.findings)
    np.testing.assert_array_equal(found.recording.t, upright.recording.t)
    np.testing.assert_array_equal(found.recording.accelerometer, upright.recording.accelerometer)


def test_a_header_that_is_not_utf_8_keeps_its_units(tmp_path: Path) -> None:
    """A spreadsheet's micro sign is one byte: read as nothing, it once left tesla."""
    t = np.arange(ROWS) / 20.0
    turned = np.stack([np.cos(t), np.sin(t), np.full(ROWS, 0.5)], axis=1)
    values = np.hstack([t[:, None], 9.0 * turned, 40.0 * turned])
    header = (
        "Zeit [s];" + ";".join(f"a{axis} [m/s²]" for axis in "xyz") + ";" + ";".join(f"B{axis} [µT]" for axis in "xyz")
    )
    lines = [header, *(";".join(f"{value:.6f}".replace(".", ",") for value in row) for row in values)]
    path = tmp_path / "log.csv"
    for encoding in ("cp1252", "utf-8"):
        path.write_bytes("\n".join(lines).encode(encoding))
        found = import_logs([path], None, None).recording
        assert found.units == {"accelerometer": "m_s2", "magnetometer": "uT"}
        np.testing.assert_allclose(found.magnetometer, values[:, 4:], atol=1e-5)


def test_times_as_dates_are_named(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,ax,ay,az\n" + "".join(f"2026-01-05T10:00:{second:02d},1,2,3\n" for second in range(60)))
    with pytest.raises(RigError, match=r"holds '2026-01-05T10:00:.*', expected times in seconds$"):
        import_logs([path], None, None)
