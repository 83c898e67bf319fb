"""A seeded sample of hostile files, and commands killed at random moments.

``RIG_FUZZ`` and ``RIG_KILLS`` ask for more of either: inputs a call, and kills.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from cli_support import SMALL
from fuzzing import CALLS, Call, complaint_about, make_good

INPUTS = int(os.environ.get("RIG_FUZZ", "12"))
KILLS = int(os.environ.get("RIG_KILLS", "6"))


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("good")
    make_good(folder)
    return folder


@pytest.mark.filterwarnings("ignore")  # as the command does
@pytest.mark.parametrize("call", CALLS, ids=lambda call: f"{call.name}: {call.arguments[0]}")
def test_hostile_files(good: Path, call: Call) -> None:
    """None ends in a bug, hangs, leaves a file after a failure, or gives an error of 300 letters or more."""
    complaints = []
    for number in range(INPUTS):
        wrong = complaint_about(call, good, random.Random(f"{call.name} {call.arguments} {number}"))
        complaints += [f"{number}: {wrong}"] if wrong else []
    assert not complaints


FOUND = ((275, 1), (5777, 7), (882, 7), (6176, 7), (203, 3))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("number", "seed"), FOUND)
def test_what_was_found_stays_mended(good: Path, number: int, seed: int) -> None:
    """Inputs of longer runs that ended in a bug, or in a line without end."""
    assert complaint_about(CALLS[number % len(CALLS)], good, random.Random(f"{seed} {number}")) == ""


def started(folder: Path, *arguments: str) -> subprocess.Popen[bytes]:
    """A command in a session of its own, with signals as a terminal gives them."""

    def handlers() -> None:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)

    return subprocess.Popen(
        [sys.executable, "-m", "scenarios.cli", *arguments],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        preexec_fn=handlers,
        start_new_session=True,
        env={**os.environ, "TMPDIR": str(folder / "tmp"), "OMP_NUM_THREADS": "1"},
    )


def processes_of(session: int) -> list[int]:
    """Those that are still alive in a session (Linux)."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            found.append(int(stat.parent.name))
    return found


STUDY = "study consistency renk2005-table2 -o out/study --draws 10 --counts 2 --workers 1"
LONG = ("sweep small.toml -o out/run.parquet --locked", "demo -o out", STUDY)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")
@pytest.mark.parametrize("number", range(KILLS))
def test_a_kill_at_any_moment_tears_nothing(tmp_path: Path, number: int) -> None:
    """No torn file, no process, one line for a signal that can be heard; no temporary after the next run."""
    rng = random.Random(number)
    arguments = LONG[number % len(LONG)].split()
    how = rng.choice((signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP))
    for folder in ("out", "tmp"):
        (tmp_path / folder).mkdir()
    (tmp_path / "small.toml").write_text(SMALL)
    process = started(tmp_path, *arguments)
    time.sleep(rng.uniform(0.4, 3.0))  # after the interpreter's own start
    process.send_signal(how)
    _, err = process.communicate(timeout=60)
    if how != signal.SIGKILL:
        assert process.returncode in (0, 128 + how), err
        assert err.count(b"\n") == (process.returncode != 0), err
    deadline = time.monotonic() + 20.0
    while processes_of(process.pid) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not processes_of(process.pid)
    if how != signal.SIGKILL:
        assert not list(tmp_path.rglob("*.rig-*"))
    again = started(tmp_path, *arguments)
    _, err = again.communicate(timeout=300)
    assert (again.returncode, err) == (0, b"")
    assert not list(tmp_path.rglob("*.rig-*"))
    assert not list((tmp_path / "tmp").glob("rig-*"))
