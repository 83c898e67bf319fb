"""A command that is asked to end cleans up, says so in one line, and ends with the status that shells expect."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from cli_support import SMALL

#: A command line whose work is to write half a file, to say so, and to wait; ``MANNER`` is where.
PROGRAM = """
import sys, time
from scenarios.cli import _signals
_signals.install()
import scenarios.cli._app as app
from rig.files import atomic_path

def wait():
    with atomic_path("out.csv") as temporary:
        temporary.write_text("half")
        print("ready", flush=True)
        {manner}

class Swallowing:
    def __del__(self):
        time.sleep(600)

app.cli.main = lambda *_, **__: wait()
app.main()
"""
MANNERS = {
    "asleep": "time.sleep(600)",
    "where it is lost": "value = Swallowing(); del value; time.sleep(600)",
    "importing": "import slow; time.sleep(600)",
}
WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated", signal.SIGHUP: "hung up"}


def start(program: str, folder: Path, *ignored: int) -> subprocess.Popen[str]:
    """A Python program with its signals as a terminal would give them, but for those that are ignored: the shell that
    runs the tests may ignore some itself."""

    def handlers() -> None:
        for number in WORDS:
            signal.signal(number, signal.SIG_IGN if number in ignored else signal.SIG_DFL)

    return subprocess.Popen(
        [sys.executable, "-c", program],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=handlers,
    )


@pytest.mark.parametrize("number", WORDS, ids=WORDS.values())
@pytest.mark.parametrize("manner", MANNERS)
def test_a_signal_ends_the_command(tmp_path: Path, number: signal.Signals, manner: str) -> None:
    (tmp_path / "slow.py").write_text("import time\ntime.sleep(0.5)\n")
    process = start(PROGRAM.format(manner=MANNERS[manner]), tmp_path)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.1)
        process.send_signal(number)
        out, err = process.communicate(timeout=30)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 128 + number
    assert (out, err) == ("", f"rig: {WORDS[number]}\n")
    assert {path.name for path in tmp_path.iterdir()} <= {"slow.py", "__pycache__"}


OUTSIDE = {
    "before the command line is read": ("with _signals.heard(): raise _signals.Ending(15)", "rig: terminated\n"),
    "after all was said": (
        "import scenarios.cli._app as app\ndef run(*_): raise _signals.Ending(15)\napp.run = run\napp.main()",
        "",
    ),
}


@pytest.mark.parametrize("when", OUTSIDE)
def test_an_end_outside_of_the_command_is_no_traceback(tmp_path: Path, when: str) -> None:
    program, said = OUTSIDE[when]
    process = start(f"from scenarios.cli import _signals\n{program}", tmp_path)
    assert process.communicate(timeout=60) == ("", said)
    assert process.returncode == 128 + signal.SIGTERM


def test_what_was_ignored_at_the_start_stays_ignored(tmp_path: Path) -> None:
    """As for ``nohup`` and for the background jobs of a shell without job control."""
    program = PROGRAM.format(manner="time.sleep(1.0); sys.exit(7)")
    process = start(program, tmp_path, signal.SIGINT, signal.SIGHUP)
    try:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGHUP)
        process.communicate(timeout=30)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 7


def rig(folder: Path, *arguments: str, **settings: str) -> subprocess.CompletedProcess[bytes]:
    """The installed command; bytes, as not all is UTF-8."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("LC_", "LANG"))}
    command = [sys.executable, "-m", "scenarios.cli", *arguments]
    return subprocess.run(command, cwd=folder, env={**environment, **settings}, capture_output=True, check=False)


def test_names_that_are_not_utf_8(tmp_path: Path) -> None:
    name = os.fsdecode(b"caf\xe9 $HOME.toml")
    (tmp_path / name).write_text(SMALL)
    run = os.fsdecode(b"caf\xe9.parquet")
    for extra in ((), ("--json",)):
        done = rig(tmp_path, "sweep", name, "-o", run, *extra)
        assert (done.returncode, done.stderr) == (0, b"")
        assert done.stdout
    refused = rig(tmp_path, "calibrate", os.fsdecode(b"n\xe9.parquet"))
    assert refused.returncode == 2
    assert refused.stderr.startswith(rb"rig: n\xe9.parquet: no such file")


def test_libraries_get_names_that_they_can_take(tmp_path: Path) -> None:
    """Titles of plots and views, and files that are opened by a library itself; with any locale."""
    odd = os.fsdecode(b"caf\xe9")
    (tmp_path / f"{odd}.toml").write_text(SMALL)
    (tmp_path / f"{odd}.csv").write_text("t,ax,ay,az\n" + "".join(f"{n / 10},{n % 3},1.0,9.0\n" for n in range(30)))
    (tmp_path / odd).mkdir()
    lines = (
        ("sweep", f"{odd}.toml", "-o", f"{odd}.parquet", "--locked"),
        ("noise", f"{odd}.locked.parquet", "-o", "noise.png"),
        ("view", f"{odd}.parquet", "-o", f"{odd}.rrd"),
        ("import", f"{odd}.csv", "-o", "imported.parquet"),
        ("view", f"{odd}.parquet", "-o", f"{odd}/view.rrd"),
    )
    program = (
        "import json, sys; from scenarios.cli import _app; _app._open_standard_streams();"
        "sys.exit(sum(_app.run(line) for line in json.loads(sys.argv[1])))"
    )
    command = [sys.executable, "-W", "ignore", "-c", program, json.dumps(lines)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, check=False)
    assert done.returncode == 2, done.stderr
    assert (
        done.stderr == b"rig: caf\\xe9/view.rrd: the viewer's files need a folder whose name is UTF-8, found another\n"
    )
    (tmp_path / "caf\u00e9").mkdir()
    ascii_only = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    viewed = rig(tmp_path, "view", f"{odd}.parquet", "-o", "caf\u00e9/view.rrd", **ascii_only)
    assert (viewed.returncode, viewed.stderr) == (0, b"")


def test_terminals_without_a_letter(tmp_path: Path) -> None:
    """Nor a window for plots."""
    (tmp_path / "small.toml").write_text(SMALL)
    for arguments in (("bound", "small.toml", "-o", "bound.png"), ("effects",), ("effects", "--json")):
        done = rig(tmp_path, *arguments, PYTHONIOENCODING="ascii", MPLBACKEND="none")
        assert (done.returncode, done.stderr) == (0, b""), arguments
        assert done.stdout.isascii()


def test_closed_streams(tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(SMALL)
    for closed in (">&-", "2>&-", "<&-", ">&- 2>&- <&-"):
        command = f"'{sys.executable}' -m scenarios.cli sweep small.toml -o run.parquet {closed}"
        assert subprocess.run(["sh", "-c", command], cwd=tmp_path, capture_output=True, check=False).returncode == 0
        assert (tmp_path / "run.parquet").stat().st_size > 10_000


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_output_that_cannot_be_written(tmp_path: Path) -> None:
    command = f"'{sys.executable}' -m scenarios.cli effects >/dev/full"
    done = subprocess.run(["sh", "-c", command], cwd=tmp_path, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (2, b"rig: standard output: No space left on device\n")
