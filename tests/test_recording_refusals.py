"""What is no recording is refused in one line that names the file and the place."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recording_examples import SUFFIXES, columns_of, example, refusal, scan_all, tumble, write_parquet

from rig.errors import RigError
from rig.recording import read_recording


def without(*names: str) -> Callable[[dict[str, Any]], dict[str, Any]]:
    return lambda columns: {name: column for name, column in columns.items() if name not in names}


def renamed(old: str, new: str) -> Callable[[dict[str, Any]], dict[str, Any]]:
    return lambda columns: {new if name == old else name: column for name, column in columns.items()}


def with_value(name: str, row: int, value: float | None) -> Callable[[dict[str, Any]], dict[str, Any]]:
    return lambda columns: {
        key: [value if key == name and at == row else float(number) for at, number in enumerate(column)]
        for key, column in columns.items()
    }


BAD_COLUMNS = [
    (without("t_s"), "t_s"),
    (renamed("t_s", "time_s"), "nearest: 'time_s'"),
    (without("q3_rad"), "partial pose: q3_rad is missing"),
    (without("q6_rad"), "partial pose: q6_rad is missing"),
    (renamed("q1_rad", "q1_rads"), "nearest: 'q1_rad'"),
    (renamed("q1_rad", "q1"), "unknown column 'q1'"),
    (renamed("q1_rad", "Q1_rad"), "nearest: 'q1_rad'"),
    (renamed("q2_rad", "q1_deg"), "in rad and in deg"),
    (renamed("temperature_degC", "q7_rad"), "too many joint angles"),
    (without("accel2_V"), "accel2_V' is missing"),
    (without("mag1_V", "mag3_V"), "mag1_V' is missing"),
    (renamed("accel1_V", "accel1_v"), "nearest: 'accel1_V'"),
    (renamed("accel1_V", "accel1_volts"), "unknown unit 'volts'"),
    (renamed("mag1_V", "mag1_g"), "unknown unit 'g'"),
    (renamed("accel1_V", "accel1_mV"), "one unit"),
    (renamed("accel1_V", "acel1_V"), "nearest: 'accel1_V'"),
    (renamed("accel1_V", "accel1"), "unknown column 'accel1'"),
    (without(*(f"{s}{axis}_V" for s in ("accel", "mag") for axis in (1, 2, 3))), "no sensor"),
    (renamed("temperature_degC", "temperature_K"), "nearest: 'temperature_degC'"),
    (renamed("supply_V", "supply_mV"), "nearest: 'supply_V'"),
    (renamed("current1_A", "current1_mA"), "nearest: 'current1_A'"),
    (renamed("supply_V", "tool_x_m"), "partial pose: tool_y_m is missing"),
    (renamed("supply_V", "tool_qw"), "partial pose: tool_qx is missing"),
    (with_value("accel2_V", 31, math.nan), "accel2_V in row 31 (first row 0) is NaN"),
    (with_value("q5_rad", 0, math.inf), "q5_rad in row 0 (first row 0) is inf"),
    (with_value("mag3_V", 39, -math.inf), "mag3_V in row 39 (first row 0) is -inf"),
    (with_value("temperature_degC", 7, None), "temperature_degC in row 7 (first row 0) is NaN (or missing)"),
    (with_value("current5_A", 8, math.nan), "current5_A in row 8"),
    (with_value("t_s", 9, math.nan), "t_s in row 9"),
    (with_value("t_s", 21, 5.0), "t_s does not increase: row 21 (first row 0) has 5.0 after 5.0"),
    (with_value("t_s", 1, 1e-303), "row 1 (first row 0) has 1e-303 after 0.0, expected at least 1e-60 s more"),
    (with_value("t_s", 22, -1.0), "row 22 (first row 0) has -1.0 after 5.25"),
]


@pytest.mark.parametrize("read", [read_recording, scan_all])
@pytest.mark.parametrize(("change", "complaint"), BAD_COLUMNS, ids=[complaint for _, complaint in BAD_COLUMNS])
def test_bad_columns_of_a_parquet_file(
    tmp_path: Path, change: Callable[[dict[str, Any]], dict[str, Any]], complaint: str, read: Callable[[Path], object]
) -> None:
    path = write_parquet(tmp_path / "run.parquet", change(columns_of(example())))
    assert complaint in refusal(path, read)


@pytest.mark.parametrize(("change", "complaint"), BAD_COLUMNS, ids=[complaint for _, complaint in BAD_COLUMNS])
def test_bad_columns_of_a_csv_file(
    tmp_path: Path, change: Callable[[dict[str, Any]], dict[str, Any]], complaint: str
) -> None:
    columns = change(columns_of(example()))
    rows = [
        ",".join("" if value is None else str(value) for value in row) for row in zip(*columns.values(), strict=True)
    ]
    path = tmp_path / "run.csv"
    path.write_text("\n".join([",".join(columns), *rows]))
    assert complaint in refusal(path)


def test_time_must_increase_from_batch_to_batch(tmp_path: Path) -> None:
    columns = with_value("t_s", 7, 1.5)(columns_of(example()))
    columns["t_s"][8:] = np.arange(32) + 2.0
    path = write_parquet(tmp_path / "run.parquet", columns)
    assert "row 7 (first row 0) has 1.5 after 1.5" in refusal(path, scan_all)  # row 7 begins the second batch


@pytest.mark.parametrize("read", [read_recording, scan_all])
@pytest.mark.parametrize("norm", [0.0, 0.99, 1.002, 2.0, 1e50])
def test_a_quaternion_must_be_a_rotation(tmp_path: Path, norm: float, read: Callable[[Path], object]) -> None:
    columns = columns_of(tumble())
    for name in ("tool_qw", "tool_qx", "tool_qy", "tool_qz"):
        columns[name] = columns[name] * np.where(np.arange(40) == 11, norm, 1.0)
    message = refusal(write_parquet(tmp_path / "run.parquet", columns), read)
    assert f"tool_qw..tool_qz in row 11 (first row 0) has the norm {norm:.6g}, expected 1" in message


def test_a_quaternion_may_be_rounded_to_three_decimals(tmp_path: Path) -> None:
    # The worst case: all four components are rounded in the direction in which they already point.
    columns = columns_of(tumble(1)) | {name: [0.5005] for name in ("tool_qw", "tool_qx", "tool_qy", "tool_qz")}
    found = read_recording(write_parquet(tmp_path / "run.parquet", columns))
    np.testing.assert_allclose(found.rotations(None), [[0, 0, 1, 1, 0, 0, 0, 1, 0]], atol=4 * np.finfo(float).eps)


def test_columns_that_do_not_hold_numbers_or_occur_twice(tmp_path: Path) -> None:
    columns = columns_of(example(3))
    path = write_parquet(tmp_path / "run.parquet", columns | {"accel1_V": ["1", "2", "3"]})
    assert "'accel1_V' holds string, expected numbers" in refusal(path)
    path = write_parquet(tmp_path / "bool.parquet", columns | {"mag1_V": [True, False, True]})
    assert "'mag1_V' holds bool, expected numbers" in refusal(path)
    path = write_parquet(tmp_path / "null.parquet", columns | {"mag1_V": [None] * 3})
    assert "mag1_V in row 0 (first row 0) is NaN (or missing)" in refusal(path)
    path = tmp_path / "twice.parquet"
    pq.write_table(pa.Table.from_arrays([pa.array([0.0])] * 5, ["t_s", "mag1_V", "mag2_V", "mag3_V", "mag2_V"]), path)
    assert "'mag2_V' occurs 2 times" in refusal(path)


BAD_METADATA = [
    ({"format": "rig-recording/2"}, "expected 'rig-recording/1'"),
    ({"gravity_m_s2": 0.0}, "gravity_m_s2: found 0.0, expected a positive number"),
    ({"gravity_m_s2": 5e-324}, "gravity_m_s2: found 5e-324, expected a positive number, no extreme one"),
    ({"magnetic_field": 1e308}, "found 1e+308, expected a positive number, no extreme one"),
    ({"gravity_m_s2": "9.8"}, "expected a positive number"),
    ({"gravity_m_s2": True}, "expected a positive number"),
    ({"gravity_m_s2": 10**400}, "an integer of 401 digits is beyond the floating-point range"),
    ({"arm": "\x1b[31mred"}, "arm: found '\\x1b[31mred', expected the name of an arm"),
    ({"serial": "\x1b]0;title\x07"}, "serial: found '\\x1b]0;title"),
    ({"magnetic_field": -1}, "magnetic_field: found -1"),
    ({"rate_Hz": 0}, "rate_Hz: found 0"),
    ({"rate_hz": 100}, "unknown metadata key 'rate_hz' (nearest: 'rate_Hz')"),
    ({"magnetic_field_unit": "T"}, "expected one of G, nT, uT"),
    ({"arm": 465}, "arm: found 465"),
    ([1], "a JSON list, expected an object"),
    ('{"gravity_m_s2": NaN}', "NaN is not JSON"),
    ("{", "metadata: is not JSON"),
    ("[" * 100_000, "metadata: is not JSON"),
]


def with_metadata(path: Path, encoded: bytes) -> Path:
    """A recording whose metadata are these bytes."""
    if path.suffix == ".parquet":
        write_parquet(path, columns_of(example()), encoded)
    else:
        example().write(path)
        path.write_bytes(b"# rig: " + encoded + b"\n" + path.read_bytes().split(b"\n", 1)[1])
    return path


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(("content", "complaint"), BAD_METADATA, ids=[complaint for _, complaint in BAD_METADATA])
def test_bad_metadata(tmp_path: Path, suffix: str, content: Any, complaint: str) -> None:
    text = content if isinstance(content, str) else json.dumps(content)
    assert complaint in refusal(with_metadata(tmp_path / f"run{suffix}", text.encode()))


@pytest.mark.parametrize(
    ("suffix", "complaint"), [(".parquet", "is not a whole Parquet file"), (".csv", "not UTF-8 text (byte 7 of a line")]
)
def test_metadata_that_are_no_text(tmp_path: Path, suffix: str, complaint: str) -> None:
    assert complaint in refusal(with_metadata(tmp_path / f"run{suffix}", b"\xff"))


def test_files_that_are_no_recordings(tmp_path: Path) -> None:
    for suffix in SUFFIXES:
        path = tmp_path / f"run{suffix}"
        assert "no such file" in refusal(path)
        path.touch()
        assert "is empty" in refusal(path)
        path.write_bytes(bytes(range(256)) * 8)
        assert "is not a" in refusal(path)
    example().write(tmp_path / "good.parquet")
    assert "nearest: 'good.parquet'" in refusal(tmp_path / "god.parquet")
    assert "no such file" in refusal(tmp_path / "no" / "run.csv")
    (tmp_path / "folder.csv").mkdir()
    assert "is a folder" in refusal(tmp_path / "folder.csv")
    (tmp_path / "run.txt").touch()
    assert "unknown ending '.txt', expected .parquet or .csv" in refusal(tmp_path / "run.txt")
    assert "no samples" in refusal(write_parquet(tmp_path / "none.parquet", {n: [0.0][:0] for n in example().table()}))
    for text in (",".join(example().table()), ",".join(example().table()) + "\n\n\n"):
        (tmp_path / "none.csv").write_text(text)
        assert "no samples" in refusal(tmp_path / "none.csv")
    (tmp_path / "comment.csv").write_text("# made by hand\nt_s\n")
    assert "begins with '# made by hand', expected '# rig: {json}'" in refusal(tmp_path / "comment.csv")


def test_csv_cells_that_are_wrong(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    example().write(path)
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join([*lines[:7], lines[7].replace("1.25,", "1.25 s,", 1), *lines[8:]]))
    assert ": t_s in row 5 (first row 0) holds '1.25 s', expected a number" in refusal(path)
    path.write_text("".join([*lines[:7], "1,2\n", *lines[8:]]))
    assert "truncated or damaged: found 2 cells in row 5 (first row 0), expected 17" in refusal(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_truncation_is_noticed(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run{suffix}"
    example(4).write(path)
    content = path.read_bytes()
    last_row = content.rstrip(b"\n").rfind(b"\n") + 1
    for size in range(0, len(content) - 1, 7 if suffix == ".parquet" else 1):
        path.write_bytes(content[:size])
        # A CSV that ends with a whole row, or within its very last number, cannot be told from a shorter one.
        whole_rows = suffix == ".csv" and content[:size].endswith(b"\n") and content[:size].count(b"\n") > 2
        last_number = suffix == ".csv" and size > last_row and content[:size].count(b",") == content.count(b",")
        if not (whole_rows or last_number):
            refusal(path)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("damaged")
    for suffix in SUFFIXES:
        example(30).write(path / f"intact{suffix}")
    return path


DAMAGE = st.tuples(st.floats(0.0, 1.0), st.sampled_from(["set", "insert", "delete"]), st.binary(min_size=1, max_size=8))


@pytest.mark.parametrize("suffix", SUFFIXES)
@given(damages=st.lists(DAMAGE, min_size=1, max_size=4), tail=st.booleans())
@settings(deadline=None, max_examples=150)
def test_damaged_files_are_refused(
    folder: Path, suffix: str, damages: Sequence[tuple[float, str, bytes]], tail: bool
) -> None:
    content = (folder / f"intact{suffix}").read_bytes()
    path = folder / f"run{suffix}"
    damaged = bytearray(content)
    for place, kind, change in damages:
        # The Parquet footer and the CSV's first lines are where structure is.
        structure = (len(damaged) - min(len(damaged), 4000), len(damaged)) if suffix == ".parquet" else (0, 400)
        first, last = structure if tail else (0, len(damaged))
        at = first + int(place * max(0, last - first - 1))
        end = at if kind == "insert" else at + len(change)
        damaged[at:end] = b"" if kind == "delete" else change
    path.write_bytes(damaged)
    try:
        found = read_recording(path)
    except RigError as error:
        assert str(error).startswith(str(path))  # noqa: PT017
        assert "\n" not in str(error)  # noqa: PT017
    else:  # what is read must still be a recording, and where there are checksums, the same one
        if suffix == ".parquet" and not tail:
            known = {column.tobytes() for column in example(30).table().values()}
            assert {column.tobytes() for column in found.table().values()} <= known


@pytest.mark.parametrize(
    ("unit", "factor"),
    [("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9)],
    ids=lambda value: str(value),
)
def test_unix_time_in_another_unit_is_recognised(tmp_path: Path, unit: str, factor: float) -> None:
    path = tmp_path / "run.csv"
    run = example()
    replace(run, t=run.t + 1.7e9).write(path)  # Unix time in seconds is as good as any
    assert len(read_recording(path)) == len(run)
    table = path.read_text().splitlines()
    rows = [line.split(",", 1) for line in table[2:]]
    path.write_text("\n".join([*table[:2], *(f"{float(t) * factor!r},{rest}" for t, rest in rows), ""]))
    with pytest.raises(RigError, match=f"looks like Unix time in {unit}, expected seconds: divide it by"):
        read_recording(path)
