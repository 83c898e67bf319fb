"""Recordings on disk: what is read is what was written, whole or in batches."""

from __future__ import annotations

import math
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from recording_examples import SUFFIXES, assert_same, example, refusal, tumble, write_parquet

from rig.errors import RigError
from rig.recording import Metadata, Recording, RecordingWriter, locked_beside, read_recording, scan_recording
from rig.units import UNITS

PRACTICE = Path(__file__).parents[1].parent / "shared" / "practice"
NUMBERS = st.floats(-1e59, 1e59)
#: [s]; no two are closer than 1e-60.
TIMES = NUMBERS.map(lambda time: round(time, 20))


@st.composite
def recordings(draw: st.DrawFn) -> Recording:
    n = draw(st.integers(1, 12))

    def array(*shape: int) -> Any:
        return hnp.arrays(np.float64, (n, *shape), elements=NUMBERS)

    t = draw(st.lists(TIMES, min_size=n, max_size=n, unique=True).map(sorted).filter(lambda t: not 1e11 < t[0] < 1e19))
    sensors = draw(st.sets(st.sampled_from(sorted(UNITS)), min_size=1))
    tool = draw(st.booleans())
    turns = draw(hnp.arrays(np.float64, (n, 4), elements=st.floats(-1.0, 1.0)))
    turns[np.linalg.norm(turns, axis=1) < 0.1] = [1.0, 0.0, 0.0, 0.0]
    texts = st.text(max_size=8)
    return Recording(
        t=np.array(t),
        q=draw(st.none() | st.just(6).flatmap(array)),
        tool_quaternion=turns / np.linalg.norm(turns, axis=1, keepdims=True) if tool else None,
        tool_position=draw(st.none() | array(3)) if tool else None,
        accelerometer=draw(array(3)) if "accelerometer" in sensors else None,
        magnetometer=draw(array(3)) if "magnetometer" in sensors else None,
        units={sensor: draw(st.sampled_from(UNITS[sensor])) for sensor in sensors},
        temperature=draw(st.none() | array()),
        currents=draw(st.dictionaries(st.integers(1, 9), array(), max_size=2)),
        supply=draw(st.none() | array()),
        metadata=Metadata(
            gravity_m_s2=draw(st.floats(1e-60, 1e60)),
            magnetic_field=draw(st.floats(1e-60, 1e60)),
            rate_Hz=draw(st.none() | st.floats(1e-3, 1e5)),
            notes=draw(st.none() | texts | st.lists(texts)),
            magnetic_field_unit=draw(st.sampled_from([None, "G", "uT"])),
            extra={
                f"of my own: {key}": value
                for key, value in draw(st.dictionaries(texts, NUMBERS | texts, max_size=2)).items()
            },
        ),
    )


@pytest.mark.parametrize("suffix", SUFFIXES)
@given(recording=recordings(), batch_rows=st.integers(1, 13))
@settings(deadline=None, max_examples=60)
def test_any_recording_comes_back_exactly(suffix: str, recording: Recording, batch_rows: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"run{suffix}"
        recording.write(path)
        found = read_recording(path)
        assert_same(found, recording)
        assert found.name == "run"
        batches = list(scan_recording(path, batch_rows=batch_rows))
    assert max(map(len, batches)) <= batch_rows
    assert [batch.first_row for batch in batches] == np.cumsum([0, *map(len, batches[:-1])]).tolist()
    for name, column in recording.table().items():
        assert np.concatenate([batch.table()[name] for batch in batches]).tobytes() == column.tobytes()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_batches_are_written_as_one_recording(tmp_path: Path, suffix: str) -> None:
    whole = tumble(1000)
    with RecordingWriter(tmp_path / f"run{suffix}") as writer:
        for first in range(0, 1000, 300):
            writer.write(whole.select(slice(first, first + 300)))
    assert_same(read_recording(tmp_path / f"run{suffix}"), whole)


def test_other_number_types_and_degrees_are_converted(tmp_path: Path) -> None:
    degrees = np.array([-170.0, 0.0, 90.0], dtype=np.float32)
    columns: dict[str, Any] = {f"q{joint}_deg": degrees for joint in range(1, 7)}
    columns |= {f"accel{axis}_raw": np.array([32768, -3, axis], dtype=np.int32) for axis in (1, 2, 3)}
    columns |= {"t_s": pa.array([1, 2, 3], pa.uint8()), "gyro1_rad_s": ["any", "thing", "else"], "q1_rad_s": [0, 0, 0]}
    found = read_recording(write_parquet(tmp_path / "run.parquet", columns))
    assert found.q is not None
    np.testing.assert_array_equal(found.q, np.radians(np.tile(degrees.astype(float)[:, None], 6)))
    np.testing.assert_array_equal(found.readings("accelerometer"), [[32768] * 3, [-3] * 3, [1, 2, 3]])
    np.testing.assert_array_equal(found.t, [1.0, 2.0, 3.0])
    assert found.units == {"accelerometer": "raw"}
    assert found.metadata == Metadata()  # there was none


def test_plain_csv_of_a_user(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(
        b'\xef\xbb\xbft_s, "mag1_uT", mag2_uT, mag3_uT, label, label\r\n0, 1e1, 20, -.5, a, b\r\n\r\n1,"2", 3, 4, ,'
    )
    found = read_recording(path)
    np.testing.assert_array_equal(found.readings("magnetometer"), [[10.0, 20.0, -0.5], [2.0, 3.0, 4.0]])
    assert (found.unit("magnetometer"), found.pose, found.rate_Hz) == ("uT", "none", 1.0)


def test_lines_may_be_taken_out_of_a_csv(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    example().write(path)
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:12]))
    assert_same(read_recording(path), example().select(slice(0, 10)))


def test_memory_does_not_grow_with_the_recording(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    n = 400_000
    columns: dict[str, Any] = {f"accel{axis}_V": np.random.default_rng(axis).normal(size=n) for axis in (1, 2, 3)}
    pq.write_table(pa.table({"t_s": np.arange(n) * 1.0, **columns}), path, row_group_size=n, use_dictionary=False)
    before = pa.total_allocated_bytes()
    held = [pa.total_allocated_bytes() - before for _ in scan_recording(path, batch_rows=4096)]
    assert len(held) == math.ceil(n / 4096)
    # Of the table's 12.8 MB: three batches of 131 kB, and per column a page of 1 MiB as read, and as unpacked.
    assert max(held) < 9.5e6


def test_a_scan_can_be_repeated_and_left(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    example().write(path)
    scan = scan_recording(path, batch_rows=16)
    assert (scan.rows, scan.name, scan.sensors) == (40, "run", ("accelerometer", "magnetometer"))
    iterator = iter(scan)
    first = next(iterator)
    iterator.close()  # type: ignore[attr-defined]
    assert [len(batch) for batch in scan] == [16, 16, 8]
    assert_same(next(iter(scan)), first)


def write_batches(path: Path, *batches: Recording | BaseException) -> None:
    with RecordingWriter(path) as writer:
        for batch in batches:
            if isinstance(batch, BaseException):
                raise batch
            writer.write(batch)


def test_nothing_is_written_when_writing_fails(tmp_path: Path) -> None:
    for suffix in SUFFIXES:
        path = tmp_path / f"run{suffix}"
        with pytest.raises(RigError, match="does not exist"):
            example().write(tmp_path / "no" / f"run{suffix}")
        with pytest.raises(RigError, match="a batch has the columns"):
            write_batches(path, example(), tumble())
        with pytest.raises(KeyboardInterrupt):
            write_batches(path, example(), KeyboardInterrupt())
        write_batches(path)  # no batch, no file
    with pytest.raises(RigError, match=r"unknown ending '.npz'"):
        example().write(tmp_path / "run.npz")
    assert list(tmp_path.iterdir()) == []


def test_locked_recording_beside_a_run(tmp_path: Path) -> None:
    run = tmp_path / "case.v2.parquet"
    assert locked_beside(run) is None
    other = tmp_path / "case.v2.locked.csv"
    other.touch()
    assert locked_beside(run) == other
    same = tmp_path / "case.v2.locked.parquet"
    same.touch()
    assert locked_beside(run) == same
    assert locked_beside(tmp_path / "case.v2.csv") == other
    assert locked_beside(same) is None


def test_arms_with_another_number_of_joints(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    seven = replace(example(), q=np.zeros((40, 7)))
    seven.write(path)
    assert "found q1..q7, expected q1..q6" in refusal(path)
    assert read_recording(path, joints=7).q is not None
    assert "q8_rad is missing" in refusal(path, lambda run: read_recording(run, joints=8))
    replace(seven, metadata=Metadata(arm="iiwa")).write(path)
    assert_same(read_recording(path), replace(seven, metadata=Metadata(arm="iiwa")))


@pytest.mark.skipif(not PRACTICE.is_dir(), reason="the practice recordings are not beside this checkout")
def test_recordings_of_an_independent_program() -> None:
    runs = sorted(path for path in PRACTICE.glob("case*.parquet") if ".locked" not in path.name)
    assert len(runs) == 48
    for path in runs:
        run, locked = read_recording(path), locked_beside(path)
        assert locked is not None
        held = read_recording(locked)
        assert (run.pose, run.units, held.units) == ("joints", {"accelerometer": "V", "magnetometer": "V"}, run.units)
        assert run.metadata.rate_Hz == 4.0
        assert held.metadata.rate_Hz == 20.0
        assert len(held) == 6000
