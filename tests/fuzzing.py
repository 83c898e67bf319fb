"""Hostile files made of good ones, and what every command must do with them.

The mutations know what they are in: numbers become extreme ones, names and lines are lost, doubled or swapped, brackets
nest without end, and bits of anything flip. ``python tests/fuzzing.py SECONDS [SEED [NAME]]`` runs for as long as it is
told, of calls whose name has NAME in it.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import random
import re
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from cli_support import SMALL
from imperfect_recordings import imperfect, locked_imperfect

LONGEST: Final = 300
PATIENCE_S: Final = 60

NUMBERS: Final = (
    *("0", "-0", "1e308", "-1e308", "1e999", "5e-324", "nan", "inf", "-1", "3", "true", "null", '""', "[]", "{}", "''"),
    *("9" * 400, "0x" + "f" * 300, "1" * 5000, "1_000", "٣", "1e-400", "2147483648", "9223372036854775808", "-1e-12"),
)
TEXTS: Final = (
    *("", "\x1b[31m", "\x00", "a" * 100_000, "é", "\ud800", "../../x", "/etc/passwd", "$HOME", "\r\n", "\n" * 50),
    *("[" * 5000, "{" * 5000, "a." * 3000, '"' * 50, "#", "NaN", "none", "q1_rad,", "mag1_uT", "accel1_V", "t_s"),
    *("Infinity", "<!--", "-"),
)
_NUMBER: Final = re.compile(r"-?\d+(?:\.\d+)?(?:e-?\d+)?")
_WORD: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*")


def mutated_text(text: str, rng: random.Random) -> bytes:
    """One to three changes of a text."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        text = rng.choice(_TEXT_WAYS)(text, rng)
    return text.encode("utf-8", "surrogatepass")


def mutated_bytes(content: bytes, rng: random.Random) -> bytes:
    """Flipped, lost, doubled or foreign bytes."""
    data = bytearray(content)
    way = rng.randrange(6)
    at = rng.randrange(max(len(data), 1))
    if way <= 1 and data:
        for _ in range(rng.choice((1, 1, 8, 200))):
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    elif way == 2:
        del data[at:]
    elif way == 3:
        del data[at : at + rng.choice((1, 10, 1000))]
    elif way == 4:
        data[at:at] = rng.randbytes(rng.choice((1, 4, 300)))
    else:
        data[at:at] = data[max(0, at - rng.choice((4, 100, 5000))) : at]
    return bytes(data)


def _numbers(text: str, rng: random.Random) -> str:
    return _replaced(_NUMBER, text, rng, rng.choice(NUMBERS))


def _words(text: str, rng: random.Random) -> str:
    words = _WORD.findall(text) or [""]
    return _replaced(_WORD, text, rng, rng.choice((*TEXTS, rng.choice(words), rng.choice(words))))


def _replaced(pattern: re.Pattern[str], text: str, rng: random.Random, by: str) -> str:
    found = list(pattern.finditer(text))
    if not found:
        return by
    chosen = rng.choice(found)
    return f"{text[: chosen.start()]}{by}{text[chosen.end() :]}"


def _lines(text: str, rng: random.Random) -> str:
    lines = text.split("\n")
    at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    way = rng.randrange(4)
    if way == 0:
        del lines[at]
    elif way == 1:
        lines.insert(other, lines[at])
    elif way == 2:
        lines[at], lines[other] = lines[other], lines[at]
    else:
        del lines[at:]
    return "\n".join(lines)


def _letters(text: str, rng: random.Random) -> str:
    at = rng.randrange(len(text) + 1)
    return f"{text[:at]}{rng.choice(TEXTS)}{text[at + rng.choice((0, 1, 5)) :]}"


_TEXT_WAYS: Final = (_numbers, _numbers, _numbers, _words, _words, _lines, _letters)


def mutated_table(table: pa.Table, rng: random.Random) -> pa.Table:
    """A column lost, doubled, renamed, of another type, or with values that occur."""
    names = table.column_names
    index = rng.randrange(len(names))
    values = table.column(index).to_numpy().copy()
    way = rng.randrange(9) if values.dtype.kind == "f" else rng.choice((0, 1, 2, 7))
    if way == 0:
        return table.remove_column(index)
    if way == 1:
        return table.append_column(names[index], table.column(index))
    if way == 2:
        return table.rename_columns(
            [rng.choice(TEXTS)[:2000].replace("\ud800", "") if n == index else name for n, name in enumerate(names)]
        )
    if way == 3:
        kind = rng.choice((pa.string(), pa.int64(), pa.float32(), pa.bool_()))
        column = [None if rng.random() < 0.1 else str(v) for v in values] if kind == pa.string() else values.astype(int)
        with contextlib.suppress(pa.ArrowException):
            return table.set_column(index, names[index], pa.array(column).cast(kind, safe=False))
        return table
    if way == 4:
        values[rng.randrange(len(values))] = rng.choice((np.nan, np.inf, 1e308, -1e308, 5e-324, 1e18))
    elif way == 5:
        values[:] = rng.choice((0.0, values[0], 1e308, 1e-320, -1.0))
    elif way == 6:
        values = values * rng.choice((1e300, 1e-300, -1.0, 1e9, 0.0))
    elif way == 7:
        return table.slice(0, rng.choice((0, 1, 2, 5, 13, 40)))
    else:
        values = table.column(rng.randrange(len(names))).to_numpy().copy()
    return table.set_column(index, names[index], pa.array(values))


@dataclass(frozen=True)
class Call:
    """A command and the file that is spoilt before it is called.

    Attributes:
        name: of the format.
        file: relative to the folder.
        arguments: of the command line.
        spoil: from the good folder's file to the bad content.
        slow: with the tests, one input for so many of others: it takes seconds where the file is good enough.
        keeps: what is sound stays where the rest is refused: a stream's recording, a diagnosis without its scenario.
    """

    name: str
    file: str
    arguments: tuple[str, ...]
    spoil: Callable[[Path, random.Random], bytes]
    slow: int = 1
    keeps: bool = False


def text_of(path: Path, rng: random.Random) -> bytes:
    """A spoilt text file, one time in five by its bytes."""
    if rng.random() < 0.2:
        return mutated_bytes(path.read_bytes(), rng)
    return mutated_text(path.read_text(), rng)


def table_of(path: Path, rng: random.Random) -> bytes:
    """A spoilt Parquet file, by its bytes or by what it holds."""
    if rng.random() < 0.4:
        return mutated_bytes(path.read_bytes(), rng)
    table = pq.read_table(path)
    metadata = dict(table.schema.metadata or {})
    if rng.random() < 0.3 and b"rig" in metadata:
        metadata[b"rig"] = mutated_text(metadata[b"rig"].decode(), rng)
        table = table.replace_schema_metadata(metadata)
    else:
        table = mutated_table(table, rng).replace_schema_metadata(metadata)
    sink = io.BytesIO()
    pq.write_table(table, sink)
    return sink.getvalue()


_CALIBRATE: Final = ("calibrate", "run.csv", "--json")
_LIVE: Final = ("live", "log.csv", "--idle", "0.05")
_PLAN: Final = ("plan", "--seconds", "8", "-o", "out.toml")
_DIAGNOSE: Final = ("diagnose", "sweep.parquet", "--save-scenario", "out.toml", "--json")
CALLS: Final = (
    Call("recording, CSV", "run.csv", _CALIBRATE, text_of),
    Call("recording, CSV", "run.csv", ("noise", "run.csv"), text_of),
    Call("recording, Parquet", "run.parquet", ("calibrate", "run.parquet", "-o", "out.json"), table_of),
    Call("recording, Parquet", "run.parquet", ("calibrate", "run.parquet", "--method", "ellipsoid"), table_of),
    Call("recording, Parquet", "run.parquet", ("apply", "cal.json", "run.parquet", "-o", "out.parquet"), table_of),
    Call("locked recording", "run.locked.parquet", ("noise", "run.locked.parquet", "--json"), table_of),
    Call("locked recording", "run.locked.parquet", ("calibrate", "run.parquet"), table_of),
    Call("scenario", "small.toml", ("bound", "small.toml"), text_of),
    Call("scenario", "small.toml", ("sweep", "small.toml", "-o", "out.parquet", "--memory", "256M"), text_of),
    Call("calibration", "cal.json", ("export", "cal.json", "--to", "c"), text_of),
    Call("calibration", "cal.json", ("export", "cal.json", "--to", "yaml", "-o", "out.yaml"), text_of),
    Call("calibration", "cal.json", ("apply", "cal.json", "run.csv", "-o", "out.csv"), text_of),
    Call("cause", "cause.json", ("sweep", "small.toml", "-o", "out.csv", "--with", "cause.json"), text_of),
    Call("diagnosis", "found.json", ("sweep", "small.toml", "-o", "out.csv", "--with", "found.json"), text_of),
    Call("URDF", "arm.urdf", ("calibrate", "run.csv", "--arm", "arm.urdf", "--tip", "imu"), text_of),
    Call("study", "study/study.json", ("view", "study", "-o", "out.rrd"), text_of),
    Call("study", "study/tables.json", ("view", "study", "-o", "out.rrd"), text_of),
    Call("study", "study/summary.parquet", ("view", "study", "-o", "out.rrd"), table_of),
    Call("sealed set", "set/manifest.json", ("blind", "score", "set"), text_of),
    Call("import map", "map.toml", ("import", "log.csv", "-o", "out.parquet", "--map", "map.toml"), text_of),
    Call("log", "log.csv", ("import", "log.csv", "-o", "out.parquet"), text_of),
    Call("log, to check", "log.csv", ("check", "log.csv"), text_of),
    Call("stream", "log.csv", (*_LIVE, "-o", "out.parquet"), text_of, keeps=True),
    Call(
        "stream, calibrated",
        "cal.json",
        (*_LIVE, "-o", "out.parquet", "--calibration", "cal.json"),
        text_of,
        keeps=True,
    ),
    Call("stream, mapped", "map.toml", (*_LIVE, "-o", "out.csv", "--map", "map.toml"), text_of, keeps=True),
    Call("recording, as a stream", "run.parquet", ("replay", "run.parquet", "--speed", "max"), table_of),
    Call("recording, to show", "run.parquet", ("view", "run.parquet", "-o", "out.rrd"), table_of),
    Call(
        "URDF, to show", "arm.urdf", ("view", "run.csv", "--arm", "arm.urdf", "--tip", "imu", "-o", "out.rrd"), text_of
    ),
    Call("URDF, to plan", "arm.urdf", (*_PLAN, "--arm", "arm.urdf", "--tip", "imu"), text_of, slow=100),
    Call("scenario, to plan", "small.toml", (*_PLAN, "small.toml"), text_of, slow=100),
    Call("recording, to diagnose", "run.parquet", ("diagnose", "run.parquet", "--out", "out"), table_of),
    Call("weights", "prior.toml", ("diagnose", "run.parquet", "--prior", "prior.toml"), text_of),
    Call("imperfect recording", "sweep.parquet", _DIAGNOSE, imperfect, slow=12, keeps=True),
    Call("imperfect recording, alone", "alone.parquet", ("diagnose", "alone.parquet"), imperfect, slow=12),
    Call("imperfect locked recording", "sweep.locked.parquet", _DIAGNOSE, locked_imperfect, slow=12, keeps=True),
)


def make_good(folder: Path) -> None:
    """One good file of every format."""
    from rig.assets import model_path
    from scenarios.cli._app import run

    (folder / "small.toml").write_text(SMALL.replace("decimation = 10", "decimation = 50"))
    (folder / "cause.json").write_text(
        '{"effect": "backlash", "where": "joint5", "parameters": {"width_rad": {"value": 0.005, "std": 1e-4}}}'
    )
    (folder / "sweep.toml").write_text(SMALL.replace("duration_s = 60.0", "duration_s = 80.0"))
    (folder / "prior.toml").write_text("# of this arm\n[effects]\nbacklash = 5\nsensor_lag = 0.2\nstray_dipole = 0\n")
    shutil.copy(model_path("a465/a465.urdf"), folder / "arm.urdf")
    with _quietly(folder):
        assert run(["sweep", "small.toml", "-o", "run.parquet", "--locked"]) == 0
        assert run(["sweep", "small.toml", "-o", "run.csv"]) == 0
        assert run(["sweep", "sweep.toml", "-o", "sweep.parquet", "--locked"]) == 0
        shutil.copy("sweep.parquet", "alone.parquet")
        assert run(["calibrate", "run.parquet", "-o", "cal.json"]) in (0, 1)
        assert run(["study", "subsets", "run.parquet", "--subsets", "3", "-o", "study"]) == 0
        for name in ("out.csv", "log.csv"):
            shutil.copy("run.csv", name)
        text = (folder / "log.csv").read_text().split("\n", 1)[1]  # without the metadata
        (folder / "log.csv").write_text(text)
        assert run(["import", "log.csv", "-o", "imported.parquet", "--map", "map.toml"]) in (0, 1)
    cause = json.loads((folder / "cause.json").read_text())
    place = [cause["effect"], cause["where"]]
    diagnosis: dict[str, Any] = {
        "format": "rig-diagnosis/2", "verdict": "named", "causes": [cause],
        "hypotheses": [{"causes": [place], "other": False, "probability": 0.97}],
    }  # fmt: skip
    (folder / "found.json").write_text(json.dumps(diagnosis))
    (folder / "set").mkdir()
    digest = "0" * 64
    case = {"name": "case000", "recording": "case000.parquet", "locked": "case000.locked.parquet"}
    hashes = {"recording_sha256": digest, "locked_sha256": digest, "commitment": digest}
    (folder / "set" / "manifest.json").write_text(json.dumps({"format": "rig-blind/1", "cases": [{**case, **hashes}]}))


def complaint_about(call: Call, good: Path, rng: random.Random) -> str:
    """What a command did wrong with a spoilt file; "" where nothing. The file is kept as ``spoilt`` in that case."""
    with tempfile.TemporaryDirectory(prefix="rig-fuzz-") as name:
        folder = Path(name)
        shutil.copytree(good, folder, dirs_exist_ok=True)
        (folder / "out.csv").unlink(missing_ok=True)
        spoilt = call.spoil(good / call.file, rng)
        (folder / call.file).write_bytes(spoilt)
        wrong = _wrong(call, folder)
        if wrong and (keep := os.environ.get("RIG_FUZZ_KEEP")):
            Path(keep).mkdir(exist_ok=True)
            (Path(keep) / f"{abs(hash(spoilt)):x}-{Path(call.file).name}").write_bytes(spoilt)
        return f"{call.name}: rig {' '.join(call.arguments)}: {wrong}" if wrong else ""


def _wrong(call: Call, folder: Path) -> str:
    from scenarios.cli._app import run

    before = _files(folder)
    with _quietly(folder) as told:
        try:
            with _in_time():
                status = run(list(call.arguments))
        except _TooLong:
            return f"took more than {PATIENCE_S} s"
        except BaseException as error:
            return f"raised {type(error).__name__}: {error}"
    lines = told[1].getvalue().splitlines()
    if status not in (0, 1, 2):
        return f"exit status {status}: {lines[-1] if lines else ''}"
    if status == 2 and sum(line.startswith("rig: ") for line in lines) not in (1, 2):  # a remark may come first
        return f"{len(lines)} lines: {told[1].getvalue()[:500]}"
    if any(len(line) >= LONGEST or not line.isprintable() for line in lines):
        return f"a line of {max(map(len, lines))} letters: {max(lines, key=len)[:500]!r}"
    new = _files(folder) - before
    if status == 2 and new and not call.keeps:
        return f"left {sorted(new)}"
    if any(".rig-" in name for name in new):
        return f"left temporaries {sorted(new)}"
    return ""


def _files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


class _TooLong(BaseException):
    """Not one that anything catches."""


@contextlib.contextmanager
def _in_time() -> Iterator[None]:
    """So much of the processor's time, or twenty times as much of the clock's: the machine may be busy."""
    begun = time.process_time()
    alarms = 0

    def late(number: int, frame: FrameType | None) -> None:
        nonlocal alarms
        alarms += 1
        if time.process_time() - begun > PATIENCE_S or alarms == 20:
            raise _TooLong
        signal.alarm(PATIENCE_S)

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(PATIENCE_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


@contextlib.contextmanager
def _quietly(folder: Path) -> Iterator[tuple[io.TextIOWrapper, io.StringIO]]:
    out, err = io.TextIOWrapper(io.BytesIO(), "utf-8"), io.StringIO()  # some commands write bytes
    with contextlib.chdir(folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        yield out, err


def main() -> int:
    """Run for so many seconds; print what went wrong."""
    seconds, seed = float(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0
    calls = [call for call in CALLS if len(sys.argv) < 4 or sys.argv[3] in call.name]
    import traceback
    import warnings

    from scenarios.cli import _app

    def told(error: Exception) -> int:
        print("".join(traceback.format_exception(error)[-3:]), file=sys.__stdout__, flush=True)
        return _app.BUG

    _app._bug = told
    warnings.simplefilter("ignore")
    sys.unraisablehook = lambda found: None  # as the command has it
    end, tried, found = time.monotonic() + seconds, 0, 0
    with tempfile.TemporaryDirectory() as name:
        make_good(Path(name))
        while time.monotonic() < end:
            call = calls[tried % len(calls)]
            wrong = complaint_about(call, Path(name), random.Random(f"{seed} {tried}"))
            tried += 1
            if wrong:
                found += 1
                print(f"{seed} {tried - 1}: {wrong}", flush=True)
    print(f"{tried} inputs, {found} complaints")
    return int(found > 0)


if __name__ == "__main__":
    sys.exit(main())
