"""Lines, clocks, sources and the journal: nothing lost, and whatever is broken is said and survived."""

from __future__ import annotations

import json
import os
import socket
from pathlib import Path

import numpy as np
import pytest

from rig.errors import RigError
from rig.recording import Metadata, Recording, read_recording
from rig.stream import Clock, Feed, Journal, LineReader, open_source
from rig.stream.journal import mended
from rig.stream.sources import PipeSource
from scenarios.importing.mapping import Conventions, Mapping
from scenarios.live.mapped import renamed

HEADER = b"t_s,accel1_g,accel2_g,accel3_g\n"


def lines(count: int, first: int = 0) -> bytes:
    return b"".join(b"%.2f,%.4f,0.5,-1e-1\n" % (0.01 * i, 0.001 * i) for i in range(first, first + count))


def run_of(count: int = 50) -> Recording:
    rng = np.random.default_rng(0)
    return Recording(
        t=0.1 + 0.01 * np.arange(count),
        accelerometer=rng.standard_normal((count, 3)),
        magnetometer=rng.standard_normal((count, 3)),
        units={"accelerometer": "m_s2", "magnetometer": "uT"},
    )


@pytest.mark.parametrize("piece", [1, 7, 64, 100_000])
def test_lines_are_read_whatever_the_pieces(piece: int) -> None:
    text = b"\xef\xbb\xbf# rig: " + Metadata(gravity_m_s2=9.81).to_text().encode() + b"\n" + HEADER + lines(200)
    reader = LineReader("x")
    parts = [found for at in range(0, len(text), piece) if (found := reader.feed(text[at : at + piece]))]
    np.testing.assert_array_equal(
        np.concatenate([p["t_s"] for p in parts]), [float(f"{0.01 * i:.2f}") for i in range(200)]
    )
    assert reader.layout is not None
    assert reader.layout.metadata.gravity_m_s2 == 9.81
    assert reader.broken == 0


def test_a_broken_line_costs_itself_only() -> None:
    bad = [b"0.5,oops,1,2\n", b"0.5,1,2\n", b"\x00\xff garbage\n", b"1,2,3,4,5,6\n", b"\n", b"   \n"]
    text = HEADER + b"".join(lines(300, 300 * i) + broken for i, broken in enumerate(bad)) + lines(5, 1800)
    reader = LineReader("x")
    found = reader.feed(text)
    assert len(found["t_s"]) == 1805
    assert reader.broken == 4  # empty lines are no lines
    assert "0.5" in reader.example or "oops" in reader.example


@pytest.mark.parametrize("mark", [";", "\t", " ", "   "])
def test_other_separators_and_lines_without_a_header(mark: str) -> None:
    text = b"".join(mark.join(("0.1", "2", "3e-1", str(i))).encode() + b"\r\n" for i in range(40))
    reader = LineReader("x", names=("accel1_raw", "accel2_raw", "accel3_raw", "-"))
    found = reader.feed(text)
    assert set(found) == {"accel1_raw", "accel2_raw", "accel3_raw"}
    assert found["accel3_raw"].tolist() == [0.3] * 40


def test_json_lines_are_read_and_broken_ones_left_out() -> None:
    rows = [json.dumps({"t_s": i, "accel1_V": 1.0, "note": "x", "accel2_V": 2, "accel3_V": i}) for i in range(100)]
    rows[50] = '{"t_s": 50, "accel1_V": "no"}'
    rows[51] = "{broken"
    reader = LineReader("x")
    found = reader.feed(('{"rig": {"gravity_m_s2": 9.7}}\n' + "\n".join(rows) + "\n").encode())
    assert len(found["t_s"]) == 98
    assert reader.broken == 2
    assert reader.layout is not None
    assert reader.layout.metadata.gravity_m_s2 == 9.7


def test_a_header_that_comes_again_is_no_line() -> None:
    reader = LineReader("x")
    reader.feed(HEADER + lines(10) + b"0.1,0.")
    reader.restart()
    found = reader.feed(HEADER + lines(10, 10))
    assert len(found["t_s"]) == 10
    assert reader.broken == 1


def test_a_line_that_never_ends_does_not_fill_memory() -> None:
    reader = LineReader("x")
    reader.feed(HEADER)
    for _ in range(100):
        reader.feed(b"1" * 10_000)
    assert len(reader._rest) <= 1 << 16
    assert len(reader.feed(b"\n" + lines(3))["t_s"]) == 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"1,2,3,4\n", "expected column names"),
        (b"t_s,accel1_g,accel2_g\n1,2,3\n", "accel3_g"),
        (b"t_s,acel1_g,accel2_g,accel3_g\n", "accel1_g"),
        (b"hello\n", "no sensor"),
    ],
)
def test_a_first_line_that_makes_no_recording_is_refused(text: bytes, message: str) -> None:
    with pytest.raises(RigError, match=message):
        LineReader("x").feed(text)


def test_a_clock_goes_on_whatever_happens_to_it() -> None:
    clock = Clock()
    assert clock.tick(0.01 * np.arange(100)).words == ()
    repeated = clock.tick(np.array([0.99, 1.0, 1.0, 1.01]))
    assert repeated.t.tolist() == [1.0, 1.01]
    assert clock.left_out == 2
    (gap,) = clock.tick(np.array([5.0, 5.01])).words
    assert "a gap of 3.99 s" in gap
    back = clock.tick(0.01 * np.arange(100))
    assert "set back by" in back.words[0]
    assert len(back.t) == 96  # so many samples are needed to tell it from a few that came late
    assert (np.diff(back.t) > 0.0).all()
    assert back.t[0] > 5.01
    ahead = clock.tick(1e9 + 0.01 * np.arange(100))
    assert "set ahead" in ahead.words[0]
    assert ahead.t[-1] < 10.0


def test_samples_without_a_time_are_timed_by_the_rate() -> None:
    clock = Clock(rate_Hz=50.0)
    clock.last = 10.0  # as of a session that is resumed
    np.testing.assert_allclose(clock.made(3), [10.02, 10.04, 10.06])


def test_a_journal_opens_at_any_moment_and_closes_into_parquet(tmp_path: Path) -> None:
    run = run_of()
    journal = Journal(tmp_path / "run.parquet", run.metadata)
    for first in range(0, 50, 10):
        journal.write(run.select(slice(first, first + 10)))
        assert len(read_recording(tmp_path / "run.csv")) == first + 10
    assert journal.close() == tmp_path / "run.parquet"
    assert not (tmp_path / "run.csv").exists()
    found = read_recording(tmp_path / "run.parquet")
    assert np.array_equal(found.accelerometer, run.accelerometer)
    assert np.array_equal(found.t, run.t)


def test_a_torn_last_line_is_cut(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(HEADER + lines(20) + b"0.2,0.0")
    assert mended(path) == 7
    assert len(read_recording(path)) == 20
    assert mended(path) == 0


def _in_parts(journal: Journal, run: Recording) -> None:
    for first in range(0, len(run), 10):
        journal.write(run.select(slice(first, first + 10)))


@pytest.mark.skipif(os.name != "posix", reason="limits the size of a file")
@pytest.mark.parametrize("room", [100, 1000, 3000])
def test_a_full_disk_leaves_whole_lines(tmp_path: Path, room: int) -> None:
    """A part of a batch, or of the first lines, is taken back; a session that recorded nothing leaves no file."""
    import resource

    run = run_of()
    journal = Journal(tmp_path / "run.csv", run.metadata)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))
    try:
        with pytest.raises(RigError, match=r"run.csv: cannot be written: File too large after \d+ bytes"):
            _in_parts(journal, run)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    made = journal.close()
    assert (made is None) == (journal.total == 0) == (room < 3000)
    if made is None:
        assert list(tmp_path.iterdir()) == []
    else:
        assert np.array_equal(read_recording(made).t, run.t[: journal.total])


def test_a_journal_never_overwrites(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("mine")
    with pytest.raises(RigError, match="--resume"):
        Journal(tmp_path / "run.parquet", Metadata()).write(run_of())
    assert (tmp_path / "run.csv").read_text() == "mine"


def collected(feed: Feed, wanted: int, tries: int = 400) -> Recording | None:
    """All samples until so many are there."""
    parts = []
    for _ in range(tries):
        if (batch := feed.next(0.02)) is not None:
            parts.append(batch)
        if sum(map(len, parts)) >= wanted or feed.ended:
            break
    assert sum(map(len, parts)) == wanted
    return parts[-1] if parts else None


def test_a_pipe_ends_with_its_writer() -> None:
    reading, writing = os.pipe()
    os.write(writing, HEADER + lines(30) + b"9.0,1,2,3")  # the last line has no end
    os.close(writing)
    feed = Feed(PipeSource(reading))
    total = 0
    while not feed.ended:
        batch = feed.next(0.02)
        total += 0 if batch is None else len(batch)
    os.close(reading)
    assert total == 31


def test_a_growing_file_is_followed_and_may_be_replaced(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(HEADER + lines(30))
    feed = Feed(open_source(str(path)))
    collected(feed, 30)
    with path.open("ab") as file:
        file.write(lines(5, 30))
    collected(feed, 5)
    path.unlink()
    path.write_bytes(HEADER + lines(40, 100))
    collected(feed, 40)
    assert any("cut or replaced" in words for words in feed.words())
    feed.close()


def test_a_port_survives_its_sender() -> None:
    source = open_source("tcp:0")
    port = int(source.name.split(":")[1])
    feed = Feed(source)
    for place in range(2):
        with socket.create_connection(("127.0.0.1", port)) as sender:
            sender.sendall(HEADER + lines(30, 100 * place) + b"0.3,")
        collected(feed, 30)
        for _ in range(10):
            feed.next(0.01)
    words = feed.words()
    assert sum("has gone" in said for said in words) == 2
    assert feed.reader.broken == 1  # what was left of the first sender's last line; the second's may go on
    feed.close()


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals on this system")
def test_a_serial_port_is_read_and_looked_for_again_when_it_vanishes() -> None:
    master, slave = os.openpty()
    feed = Feed(open_source(f"serial:{os.ttyname(slave)}@115200"))
    os.write(master, HEADER + lines(30))
    collected(feed, 30)
    os.close(slave)
    os.close(master)
    for _ in range(20):
        feed.next(0.01)
    assert any("has gone" in words for words in feed.words())
    feed.close()


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("tcp:http", "port"),
        ("tcp:70000", "65535"),
        ("connect:0", "connect:5555"),
        ("serial:", "serial:DEVICE"),
        ("serial:/dev/none@fast", "serial:DEVICE"),
        ("serial:/dev/none", "cannot be opened"),
        ("nowhere.csv", "nowhere.csv"),
    ],
)
def test_a_source_that_cannot_be_opened_is_refused_in_a_line(source: str, message: str) -> None:
    with pytest.raises(RigError, match=message) as refused:
        open_source(source)
    assert len(str(refused.value)) < 300


def test_a_mapping_names_the_columns_of_a_stream(tmp_path: Path) -> None:
    """What needs a whole log, such as Euler angles, is rig import's."""
    columns = {"t": "t", "a": "-accel1_g", "j": "q2_deg", "s": "q3_m", "x": "x_mm", "w": "qw", "i": "current1_A"}
    own = Mapping({**columns, "T": "temperature_degC"}, Conventions(time_unit="ms"))
    (tmp_path / "map.toml").write_text(own.to_toml())
    names, _ = renamed(tmp_path / "map.toml")
    assert names == {
        "t": ("t_s", 1e-3),
        "a": ("accel1_g", -1.0),
        "j": ("q2_rad", pytest.approx(np.pi / 180.0)),
        "s": ("q3_m", 1.0),
        "x": ("tool_x_m", 1e-3),
        "w": ("tool_qw", 1.0),
        "i": ("current1_A", 1.0),
        "T": ("temperature_degC", 1.0),
    }
    for wrong, said in (
        (Mapping({"t": "t"}), "time_unit: found 'guess'"),
        (Mapping({"e": "euler1_deg"}), "rig import takes the rest"),
        (Mapping({}, Conventions(rotation="tool<-base")), "another convention of the pose"),
    ):
        (tmp_path / "map.toml").write_text(wrong.to_toml())
        with pytest.raises(RigError, match=said):
            renamed(tmp_path / "map.toml")
