"""``rig live``: samples a second, memory, delays, what the display costs; and its monitor beside CUSUM."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
from scipy.optimize import brentq

from benchmarks._child import Spent, spent_by
from benchmarks._measure import Column, Goal, Report, Settings, Table
from estimators.live.residual_blocks import Blocks
from estimators.live.sensor_watch import SensorWatch
from rig.arrays import Array

TITLE = "rig live: throughput, memory, delays, and the monitor beside CUSUM"


_RATE_Hz: Final = 100.0
_BLOCK: Final = 10
_DAY_BLOCKS: Final = 864_000
_LONGEST_S: Final = 60.0
#: Shifts of a reading, in standard deviations of its noise.
_SHIFTS: Final = (0.1, 0.3, 1.0, 3.0)

# Sends lines of both sensors, turned through all directions, on standard output; at a rate, or as fast as they go.
_SENDER: Final = """
import sys, time
import numpy as np, pyarrow as pa, pyarrow.csv
count, rate = int(sys.argv[1]), float(sys.argv[2])
rng = np.random.default_rng(0)
def turned(t, k):
    u = np.stack([np.cos(.31 * t + k) + np.sin(.11 * t), np.sin(.23 * t + k) + np.cos(.07 * t),
                  np.cos(.17 * t + 2 * k) + np.sin(.05 * t + 1)], axis=1)
    return u / np.linalg.norm(u, axis=1)[:, None]
out = sys.stdout.buffer
out.write(b"t_s,accel1_V,accel2_V,accel3_V,mag1_V,mag2_V,mag3_V\\n")
size = 50_000 if rate == 0 else max(1, int(rate * .01))
lines = {}
begun, done = time.monotonic(), 0
while done < count:
    number = min(size, count - done)
    t = .001 * (done + np.arange(number))
    key = done // size % 8
    if key not in lines or rate:
        a = 9.8 * turned(t, 1) * [.14, .142, .139] + [2.3, 2.4, 2.1] + .013 * rng.standard_normal((number, 3))
        m = turned(t, 2) * [2.3, 2.4, 2.42] + [2.4, 2.4, 2.7] + .009 * rng.standard_normal((number, 3))
        lines[key] = np.round(np.hstack([a, m]), 5)
    table = pa.record_batch([pa.array(x) for x in (t, *lines[key][:number].T)], names=list("abcdefg"))
    sink = pa.BufferOutputStream()
    pa.csv.write_csv(table, sink, pa.csv.WriteOptions(include_header=False))
    if rate:
        time.sleep(max(0.0, begun + done / rate - time.monotonic()))
    out.write(sink.getvalue())
    out.flush()
    done += number
"""


def run(settings: Settings) -> Report:
    few, many = settings.of(400_000, 200_000), settings.of(10_000_000, 400_000)
    start, half, flood = (_session(count, 0.0) for count in (2_000, few, many))
    rate = (many - few) / (flood.cpu_s - half.cpu_s)
    grown = (flood.peak_MiB - half.peak_MiB) / (many - few) * 1e6
    seconds = settings.of(20, 5)
    begun = _session(2_000, 0.0, view=True)
    bare, shown = (_session(1000 * seconds, 1000.0, view=view) for view in (False, True))
    # Loading the viewer's stream takes as long as a quick session: the difference would be of what else runs.
    display = float("nan") if settings.quick else (shown.cpu_s - begun.cpu_s) / seconds
    delays = _delays(settings.of(200, 20))
    hours = settings.of(1000, 20)
    alarms, expected = _false_alarms(hours)
    by_norm = {kind: _cusum_alarms(hours, turned) for kind, turned in (("calibrated", False), ("raw", True))}
    watch = _delays_of_changes(settings.of(40, 5))
    costs = Table(
        "rig live, both sensors without a pose",
        (Column("what"), Column("found")),
        (
            (f"from {few:,} samples to {many:,} [thousand samples/s of processor time]", rate / 1e3),
            (f"peak memory of {many:,} samples [MiB]", flood.peak_MiB),
            ("more of it for a million samples more [MiB]", grown),
            ("share of a core at 1 kHz, no display", (bare.cpu_s - start.cpu_s) / seconds),
            ("share of a core at 1 kHz, with the viewer's stream", display),
            ("processor time before the first sample is seen, with the viewer's stream [s]", begun.cpu_s),
            ("from a line to an estimate with it, median [ms]", 1e3 * float(np.median(delays))),
            ("from a line to an estimate with it, 95 % [ms]", 1e3 * float(np.quantile(delays, 0.95))),
            (f"false alarms in {hours:,} hours of white noise, stated {expected:.1f}", float(alarms)),
            *(
                (f"the same of a CUSUM on the {kind} norm, its limit from white noise", float(number))
                for kind, number in by_norm.items()
            ),
        ),
        note="At 1 kHz: processor time beyond that of a session of 2,000 samples with the same display, alike to load;"
        " with the viewer's stream a quick run is too short to tell it."
        " Two floods' difference is free of both; what else runs on the machine moves processor time by some tenths."
        " The noise is drawn as block sums, which hold all that the monitor makes of white noise: exact in law.",
    )
    return Report(
        tables=(costs, watch),
        goals=(
            Goal("samples a second of one core, no display", rate, "at least", 200_000.0),
            Goal("peak memory [MiB]", flood.peak_MiB, "at most", 300.0),
            Goal("share of a core at 1 kHz with the display", display, "at most", 0.33),
            Goal("from a line to an estimate, 95 % [ms]", 1e3 * float(np.quantile(delays, 0.95)), "at most", 100.0),
            Goal("false alarms over those stated", alarms / expected, "at most", 1.0),
        ),
    )


def _session(count: int, rate: float, view: bool = False) -> Spent:
    """A sender into ``rig live``: its processor time [s] and its peak memory [MiB]."""
    with tempfile.TemporaryDirectory(prefix="rig-live-") as folder:
        sender = subprocess.Popen([sys.executable, "-c", _SENDER, str(count), str(rate)], stdout=subprocess.PIPE)
        command = [sys.executable, "-m", "scenarios.cli", "live", "-", "-o", "run.csv", "--keep-going", "--json"]
        command += ["--view-file", "run.rrd"] if view else []
        environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
        spent = spent_by(command, stdin=sender.stdout, stderr=subprocess.DEVNULL, cwd=folder, env=environment)
        sender.wait()
        return spent


def _delays(lines: int) -> Array:
    """(n,) from the writing of a line to the end of an estimate that holds it, at 100 lines a second [s]."""
    from rig.stream import Feed
    from rig.stream.sources import PipeSource
    from scenarios.live.session import Display, Plan, Session

    rng = np.random.default_rng(0)
    reading, writing = os.pipe()
    sent: list[float] = []
    seen: list[float] = []

    class Clocked(Display):
        def show(self, session: Session) -> None:
            seen.extend([time.monotonic()] * (session.samples - first - len(seen)))

    def line(number: int) -> bytes:
        u = rng.standard_normal((2, 3))
        u /= np.linalg.norm(u, axis=1)[:, None]
        values = (*(1.4 * u[0] + 2.4 + 0.013 * rng.standard_normal(3)), *(2.4 * u[1] + 2.5))
        return (f"{0.01 * number:.2f}," + ",".join(f"{value:.5f}" for value in values) + "\n").encode()

    first = 3000
    os.write(writing, b"t_s,accel1_V,accel2_V,accel3_V,mag1_V,mag2_V,mag3_V\n")
    with tempfile.TemporaryDirectory(prefix="rig-live-") as folder:
        session = Session(Feed(PipeSource(reading)), Path(folder) / "run.csv", Plan(stop=False), [Clocked()])
        for begin in range(0, first, 200):
            os.write(writing, b"".join(line(number) for number in range(begin, begin + 200)))
            upto = begin + 200
            session.run(lambda upto=upto: session.samples >= upto)
        seen.clear()

        def step() -> bool:
            if len(sent) < lines and (not sent or time.monotonic() - sent[-1] > 0.01):
                sent.append(time.monotonic())
                os.write(writing, line(first + len(sent)))
            return len(seen) >= lines or (len(sent) >= lines and time.monotonic() - sent[-1] > 2.0)

        session.run(step)
        session.close()
    os.close(writing)
    os.close(reading)
    return np.array(seen[:lines]) - np.array(sent[: len(seen)])


def _watch(seed: int, k: int, alarms_a_day: float) -> tuple[SensorWatch, np.random.Generator]:
    watch = SensorWatch("magnetometer", "V", _RATE_Hz, alarms_a_day / 10.0, 60.0, True)
    return watch, np.random.default_rng(seed)


def _blocks(rng: np.random.Generator, first: int, shift: Array) -> Blocks:
    """White noise, with the mean (m, k) of each block, in standard deviations of a reading."""
    m, k = shift.shape
    sums = _BLOCK * shift + np.sqrt(_BLOCK) * rng.standard_normal((m, k))
    squares = rng.chisquare(k * (_BLOCK - 1), m)
    u = rng.standard_normal((m, 3))
    t = 0.01 * _BLOCK * (first + 1.0 + np.arange(m))
    return Blocks(t, sums, squares, np.zeros((m, k)), u / np.linalg.norm(u, axis=1)[:, None])


def _false_alarms(hours: int) -> tuple[int, float]:
    """Changes that the monitor sees in white noise at ten a day, and how many were stated."""
    watch, rng = _watch(0, 3, 10.0)
    found = 0
    total = hours * 36_000
    for first in range(0, total, 20_000):
        found += sum(
            alarm.begins for alarm in watch.judge(_blocks(rng, first, np.zeros((min(20_000, total - first), 3))))
        )
    return found, 10.0 * hours / 24.0


def _cusum_alarms(hours: int, raw: bool) -> int:
    """False alarms of a CUSUM on the norm, begun anew after each, where ten a day are stated as for the monitor."""
    limit, found = _cusum_limit(0.5, 10.0), 0
    for hour in range(hours):
        rng = np.random.default_rng(hour)
        values = rng.standard_normal(36_000)
        if raw:
            norm = _raw_norm(_turned(0.1 * np.arange(36_000) + 100.0 * rng.random())) + values / np.sqrt(_BLOCK)
            values = (norm - norm[:600].mean()) / norm[:600].std()
        found += len(_cusum(values, 0.5, limit, again=True))
    return found


def _raw_norm(turned: Array) -> Array:
    """(n,) |h + b| of a sensor with offsets of a tenth of the field, in standard deviations of a reading."""
    return np.asarray(np.linalg.norm(turned + np.array([0.1, -0.06, 0.08]), axis=1) / 0.003)


def _cusum_limit(drift: float, alarms_a_day: float = 1.0) -> float:
    """Of a two-sided CUSUM of white standard normals with so many alarms; Siegmund, "Sequential Analysis" (1985)."""

    def run_length(h: float) -> float:
        b = h + 1.166
        return float((np.exp(2.0 * drift * b) - 2.0 * drift * b - 1.0) / (2.0 * drift**2)) / 2.0

    return float(brentq(lambda h: np.log(run_length(h) * alarms_a_day / _DAY_BLOCKS), 1.0, 60.0))


def _cusum(values: Array, drift: float, limit: float, again: bool = False) -> list[int]:
    """The first of values (m,) at which either sum exceeds the limit; ``again``: all, each sum begun anew after one."""
    up = down = 0.0
    found: list[int] = []
    for place, value in enumerate(values.tolist()):
        up += value - drift
        down -= value + drift
        if up < 0.0:
            up = 0.0
        if down < 0.0:
            down = 0.0
        if up > limit or down > limit:
            found.append(place)
            if not again:
                break
            up = down = 0.0
    return found


def _delays_of_changes(trials: int) -> Table:
    """A magnet put on a turning magnetometer: the monitor with and without attitude, CUSUM on norms."""
    drift = 0.5
    limit = _cusum_limit(drift)
    before, after = 1200, int(10 * _LONGEST_S)
    raw_limit = max(_raw_peak(trial) for trial in range(20))
    detectors: dict[str, Callable[[Array, Array, int], int | None]] = {
        "monitor, attitude known": lambda d, u, s: _monitored(np.tile(d, (len(u), 1)), s, before),
        "monitor, without attitude": lambda d, u, s: _monitored((u @ d)[:, None], s, before),
        "CUSUM, calibrated norm": lambda d, u, s: _norm_cusum(u @ d, s, before, drift, limit, None),
        "CUSUM, raw norm": lambda d, u, s: _norm_cusum(u @ d, s, before, drift, raw_limit, u),
    }
    rows = []
    for shift in _SHIFTS:
        delays: dict[str, list[float]] = {name: [] for name in detectors}
        for trial in range(trials):
            rng = np.random.default_rng(1000 + trial)
            d = rng.standard_normal(3)
            d *= shift * np.sqrt(3.0) / np.linalg.norm(d)
            u = _turned(0.1 * np.arange(before + after) + 100.0 * rng.random())
            for name, detect in detectors.items():
                place = detect(d, u, trial)  # after two minutes without a change, of which the first is for learning
                delays[name].append(_LONGEST_S if place is None else 0.1 * (place + 1))
        for name, found in delays.items():
            missed = float(np.mean(np.array(found) >= _LONGEST_S))
            rows.append((f"{shift:g}", name, float(np.median(found)), float(np.quantile(found, 0.9)), missed))
    return Table(
        "a magnet put on a turning magnetometer, 100 Hz: seconds until it is noticed, at one false alarm a day",
        (
            Column("shift [σ of a reading, RMS of channels]"),
            Column("detector"),
            Column("median [s]"),
            Column("90 % [s]"),
            Column("missed in 60 s"),
        ),
        tuple(rows),
        note="The raw norm is that of a sensor with offsets of a tenth of the field and noise of 0.3 % of it, held"
        " against its own mean and spread while it turns, its limit such that an hour of turning raises no alarm.",
    )


def _turned(t: Array) -> Array:
    """(n, 3) unit vectors of the field in a sensor that is turned by hand."""
    u = np.stack([np.cos((0.5 + 0.2 * k) * t + k) + np.sin(0.9 * t * (k + 1) / 3) for k in range(3)], axis=1)
    return np.asarray(u / np.linalg.norm(u, axis=1)[:, None])


def _raw_peak(seed: int) -> float:
    """The largest sum of a CUSUM on the raw norm in three minutes of turning without any change."""
    u = _turned(0.1 * np.arange(1800) + 100.0 * np.random.default_rng(seed).random())
    low, high = 0.0, 1e6
    while high - low > 0.01 * high:
        middle = 0.5 * (low + high) if low else max(high / 4.0, 1.0)
        if _norm_cusum(np.zeros(1800), seed, 200, 0.5, middle, u) is None:
            high = middle
        else:
            low = middle
    return high


def _monitored(shift: Array, seed: int, before: int) -> int | None:
    watch, rng = _watch(seed, shift.shape[1], 1.0)
    shift = np.where(np.arange(len(shift))[:, None] >= before, shift, 0.0)
    for alarm in watch.judge(_blocks(rng, 0, shift)):
        if alarm.begins and alarm.t_s > 0.1 * before:
            return round(10.0 * alarm.t_s) - before - 1
    return None


def _norm_cusum(along: Array, seed: int, before: int, drift: float, limit: float, turned: Array | None) -> int | None:
    rng = np.random.default_rng(seed)
    values = np.where(np.arange(len(along)) >= before, along, 0.0) + rng.standard_normal(len(along)) / np.sqrt(_BLOCK)
    spread = 1.0 / np.sqrt(_BLOCK)
    if turned is not None:
        values = values + _raw_norm(turned)
        values = values - values[:before].mean()
        spread = float(values[:before].std())
    return next(iter(_cusum(values[before:] / spread, drift, limit)), None)
