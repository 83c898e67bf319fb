"""Recordings that are valid, and not as one would wish: what occurs on real rigs, one to three things at a time.

Every one of them must be diagnosed or refused in words.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from rig.arm import Arm
from rig.arrays import Array
from rig.recording import Recording, read_recording

Generator = np.random.Generator
Spoil = Callable[[Recording, Generator], Recording]


def imperfect(path: Path, rng: random.Random) -> bytes:
    """A recording with one to three imperfections, as a Parquet file."""
    found = read_recording(path)
    numbers = np.random.default_rng(rng.getrandbits(32))
    for name in rng.sample(list(IMPERFECT), rng.choice((1, 1, 2, 3))):
        found = IMPERFECT[name](found, numbers)
    return written(found, path)


def written(recording: Recording, beside: Path) -> bytes:
    """The bytes of its file."""
    file = beside.with_name("imperfect.parquet")
    recording.write(file)
    content = file.read_bytes()
    file.unlink()
    return content


def _one_sensor(change: Callable[[Array, Generator], Array]) -> Spoil:
    """Readings (n, 3) of one sensor, or of both."""

    def spoil(run: Recording, rng: Generator) -> Recording:
        both = rng.random() < 0.5
        accelerometer, magnetometer = run.accelerometer, run.magnetometer
        if accelerometer is not None and (both or rng.random() < 0.5 or magnetometer is None):
            accelerometer = change(np.array(accelerometer), rng)
        elif magnetometer is not None:
            magnetometer = change(np.array(magnetometer), rng)
        if both and magnetometer is not None:
            magnetometer = change(np.array(run.magnetometer), rng)
        return replace(run, accelerometer=accelerometer, magnetometer=magnetometer)

    return spoil


def _one_channel(change: Callable[[Array, Generator], Array]) -> Spoil:
    """Readings (n,) of one channel."""

    def spoil(readings: Array, rng: Generator) -> Array:
        column = rng.integers(3)
        readings[:, column] = change(readings[:, column], rng)
        return readings

    return _one_sensor(spoil)


def _timed(change: Callable[[Array, Generator], Array]) -> Spoil:
    return lambda run, rng: replace(run, t=change(np.array(run.t), rng))


def _jointed(change: Callable[[Array, Generator], Array]) -> Spoil:
    return lambda run, rng: run if run.q is None else replace(run, q=change(np.array(run.q), rng))


def _kept(choose: Callable[[int, Generator], Array]) -> Spoil:
    return lambda run, rng: run.select(np.sort(choose(len(run), rng)))


def _saturated(x: Array, rng: Generator) -> Array:
    """12 % of the readings at one end of the range, or at either."""
    low, high = rng.choice([[0.0, 0.88], [0.12, 1.0], [0.06, 0.94]])
    return np.clip(x, *np.quantile(x, [low, high]))


def _pink(x: Array, rng: Generator) -> Array:
    n = len(x)
    spectrum = np.fft.rfft(rng.standard_normal(n)) / np.maximum(np.arange(n // 2 + 1), 1.0) ** rng.choice([0.5, 1.0])
    noise = np.fft.irfft(spectrum, n)
    return np.asarray(x + rng.choice([0.1, 1.0, 10.0]) * 0.01 * noise / noise.std())


def _held(readings: Array, rng: Generator) -> Array:
    """A slow sensor, recorded quickly."""
    every = rng.choice([2, 5, 20])
    return np.asarray(readings[np.arange(len(readings)) // every * every])


def _spikes(x: Array, rng: Generator) -> Array:
    some = rng.random(len(x)) < rng.choice([0.002, 0.05, 0.4])
    return np.where(some, x + rng.choice([0.1, 5.0, 1e6]) * rng.standard_normal(len(x)), x)


def _coarse(x: Array, rng: Generator) -> Array:
    step = rng.choice([0.05, 0.2, 0.5]) * np.ptp(x)
    return np.asarray(np.round(x / step) * step) if step > 0.0 else x


def _stepped(x: Array, rng: Generator) -> Array:
    return x + np.where(np.arange(len(x)) < rng.integers(len(x)), 0.0, rng.choice([0.01, 1.0]))


def _turned(x: Array, rng: Generator) -> Array:
    return np.where(np.arange(len(x)) < len(x) // 2, x, -x)


def _two_a_pose(run: Recording, rng: Generator) -> Recording:
    """Static poses with two samples each."""
    return _again(run, np.repeat(np.sort(rng.choice(len(run), len(run) // 2, replace=False)), 2), rng)


def _again(run: Recording, rows: Array, rng: Generator) -> Recording:
    """Some samples, one after another, some of them several times with new noise."""
    noisy = _one_sensor(lambda x, rng: x + 0.01 * rng.standard_normal(x.shape))
    values = {"accelerometer": run.accelerometer, "magnetometer": run.magnetometer}
    picked = {name: None if x is None else np.asarray(x)[rows] for name, x in values.items()}
    poses = {"q": run.q, "tool_quaternion": run.tool_quaternion, "tool_position": run.tool_position}
    turned = {name: None if x is None else np.asarray(x)[rows] for name, x in poses.items()}
    return noisy(replace(run.select(slice(0, len(rows))), **picked, **turned), rng)


def _by_tool(run: Recording, rng: Generator) -> Recording:
    """The tool's poses in place of the joint angles, or beside them."""
    if run.q is None:
        return run
    matrices = run.rotations(Arm.a465()).reshape(-1, 3, 3)
    turns = Rotation.from_matrix(matrices).as_quat(scalar_first=True)
    return replace(run, q=run.q if rng.random() < 0.3 else None, tool_quaternion=turns)


def _constants(run: Recording, rng: Generator) -> Recording:
    """Auxiliary columns that do not move."""
    one = np.ones(len(run))
    return replace(
        run,
        supply=rng.choice([0.0, 5.0, -1.0]) * one,
        temperature=rng.choice([0.0, 25.0, -273.0]) * one,
        currents={int(joint): rng.choice([0.0, 2.0]) * one for joint in (1, 5)},
    )


def _auxiliary(run: Recording, rng: Generator) -> Recording:
    n = len(run)
    return replace(
        run,
        supply=np.where(rng.random(n) < 0.5, 0.0, 5.0),
        temperature=25.0 + np.cumsum(rng.standard_normal(n)),
        currents={2: np.full(n, 1e-12), 5: rng.standard_normal(n) * rng.choice([1e-9, 1.0, 1e6])},
    )


def _otherwise_stated(run: Recording, rng: Generator) -> Recording:
    changes: list[dict[str, object]] = [
        {"gravity_m_s2": 1.0}, {"magnetic_field": 50.0}, {"rate_Hz": 1.0}, {"accelerometer_reads": "a-g"},
        {"pose_rate_Hz": 2.0}, {"magnetic_field": 1e-9}, {"gravity_m_s2": 1e6},
    ]  # fmt: skip
    return replace(run, metadata=replace(run.metadata, **changes[rng.integers(len(changes))]))  # type: ignore[arg-type]


def _in_other_units(run: Recording, rng: Generator) -> Recording:
    unit, factor = [("mV", 1e3), ("raw", 6553.6), ("uT", 50.0), ("g", 0.1)][rng.integers(4)]
    accelerometer, magnetometer = run.accelerometer, run.magnetometer
    units = dict(run.units)
    if accelerometer is not None and unit != "uT":
        accelerometer, units["accelerometer"] = np.round(factor * np.asarray(accelerometer), 3), unit
    if magnetometer is not None and unit != "g":
        magnetometer, units["magnetometer"] = np.round(factor * np.asarray(magnetometer), 3), unit
    return replace(run, accelerometer=accelerometer, magnetometer=magnetometer, units=units)


def _alone(run: Recording, rng: Generator) -> Recording:
    """One sensor of the two."""
    sensor = run.sensors[rng.integers(len(run.sensors))]
    left = {"accelerometer": run.accelerometer, "magnetometer": run.magnetometer}
    left = {name: values if name == sensor else None for name, values in left.items()}
    return replace(run, **left, units={sensor: run.unit(sensor)})


def _hum(x: Array, rng: Generator) -> Array:
    return np.asarray(x + rng.choice([0.01, 1.0]) * np.sin(rng.uniform(0.01, 3.0) * np.arange(len(x))))


def _two_rates(run: Recording, rng: Generator) -> Recording:
    """The second part at a lower rate."""
    first = int(rng.integers(len(run) // 4, 3 * len(run) // 4))
    return run.select(np.concatenate([np.arange(first), np.arange(first, len(run), rng.choice([2, 5, 10]))]))


def _one_pose(run: Recording, rng: Generator) -> Recording:
    """The arm never left its first pose."""
    return _again(run, np.full(len(run), rng.integers(len(run))), rng)


def _few_poses(run: Recording, rng: Generator) -> Recording:
    """Fewer poses than parameters, each held for long."""
    count = rng.choice([2, 4, 9])
    return _again(run, np.sort(rng.choice(len(run), count, replace=False)).repeat(len(run) // count), rng)


def _wandering(q: Array, rng: Generator) -> Array:
    """All joints move, as the readings do not know."""
    steps = rng.choice([1e-4, 1e-2]) * rng.standard_normal(q.shape)
    limits = np.array([np.inf, 0.5, 0.5, 1.0, 0.2, np.inf])
    return np.asarray(q + np.clip(np.cumsum(steps, axis=0), -limits, limits))


def _counts(run: Recording, rng: Generator) -> Recording:
    """Whole numbers of a converter."""
    per_volt = rng.choice([100.0, 6553.6, 2.0**20])
    readings = {sensor: np.round(per_volt * np.asarray(run.readings(sensor))) for sensor in run.sensors}
    return replace(run, **readings, units=dict.fromkeys(run.sensors, "raw"))


def _turned_once(run: Recording, rng: Generator) -> Recording:
    """The sensor comes loose and is mounted anew, another way around."""
    return _one_sensor(lambda x, rng: np.where(np.arange(len(x))[:, None] < len(x) // 2, x, x[:, [1, 2, 0]]))(run, rng)


def _backwards(run: Recording, rng: Generator) -> Recording:
    """One sensor's readings in the wrong order."""
    return _one_sensor(lambda x, rng: x[::-1].copy())(run, rng)


def _beating(x: Array, rng: Generator) -> Array:
    """Readings that are right for a while, then frozen, by turns."""
    every = int(rng.choice([20, 200]))
    rows = np.arange(len(x))
    return np.asarray(x[np.where(rows // every % 2 == 0, rows, rows // every * every)])


def _heavy(x: Array, rng: Generator) -> Array:
    return np.asarray(x + 0.01 * rng.standard_t(rng.choice([1.0, 2.0, 3.0]), len(x)))


def _glued(x: Array, rng: Generator) -> Array:
    """An axis copied from another, or nearly."""
    own, other = rng.choice(3, 2, replace=False)
    x[:, own] = x[:, other] + rng.choice([0.0, 1e-9, 0.01]) * rng.standard_normal(len(x))
    return x


def _wrapped(x: Array, rng: Generator) -> Array:
    """A converter that runs over."""
    width = rng.choice([0.3, 0.7, 0.95]) * np.ptp(x)
    return np.asarray(np.mod(x, width)) if width > 0.0 else x


IMPERFECT: Final[dict[str, Spoil]] = {
    "saturated": _one_channel(_saturated),
    "saturated everywhere": _one_sensor(lambda x, rng: np.stack([_saturated(each, rng) for each in x.T], axis=1)),
    "700 to 750 rows": _kept(lambda n, rng: np.arange(min(n, rng.integers(700, 751)))),
    "200 rows": _kept(lambda n, rng: np.arange(min(n, 200))),
    "constant auxiliary columns": _constants,
    "odd auxiliary columns": _auxiliary,
    "a floor of 1/f": _one_sensor(lambda x, rng: np.stack([_pink(each, rng) for each in x.T], axis=1)),
    "a channel of 1/f": _one_channel(_pink),
    "a gap in the middle": _kept(
        lambda n, rng: np.delete(np.arange(n), slice(n // 3, n // 3 + rng.integers(1, n // 2)))
    ),
    "every other sample lost": _kept(lambda n, rng: np.flatnonzero(rng.random(n) < 0.6)),
    "repeated readings": _one_sensor(_held),
    "two samples a pose": _two_a_pose,
    "one sensor": _alone,
    "huge offsets": _one_sensor(lambda x, rng: x + rng.choice([1e3, -1e6, 1e9], 3)),
    "a dead channel": _one_channel(lambda x, rng: np.full(len(x), rng.choice([0.0, 2.5]))),
    "a channel that only makes noise": _one_channel(lambda x, rng: 2.5 + 0.01 * rng.standard_normal(len(x))),
    "coarse steps": _one_sensor(lambda x, rng: np.stack([_coarse(each, rng) for each in x.T], axis=1)),
    "a coarse channel": _one_channel(_coarse),
    "small readings": _one_sensor(lambda x, rng: x * rng.choice([1e-3, 1e-12])),
    "large readings": _one_sensor(lambda x, rng: x * rng.choice([1e3, 1e12])),
    "other units": _in_other_units,
    "loud": _one_sensor(lambda x, rng: x + rng.choice([0.3, 30.0]) * rng.standard_normal(x.shape)),
    "a loud channel": _one_channel(lambda x, rng: x + 10.0 * rng.standard_normal(len(x))),
    "drift": _one_channel(lambda x, rng: x + rng.choice([1e-3, 0.1]) * np.cumsum(rng.standard_normal(len(x)))),
    "spikes": _one_channel(_spikes),
    "steps": _one_channel(_stepped),
    "a sign that changes": _one_channel(_turned),
    "hum": _one_channel(_hum),
    "a flipped axis": _one_channel(lambda x, rng: -x),
    "swapped axes": _one_sensor(lambda x, rng: x[:, [1, 0, 2]]),
    "a mixed channel": _one_sensor(lambda x, rng: np.column_stack([x[:, 0], x[:, 1], x[:, 0] + 1e-4 * x[:, 2]])),
    "still for half the time": lambda run, rng: _again(run, np.minimum(np.arange(len(run)), len(run) // 2), rng),
    "jittering times": _timed(lambda t, rng: np.sort(t + 0.3 * np.median(np.diff(t)) * rng.uniform(-1, 1, len(t)))),
    "Unix time": _timed(lambda t, rng: t + 1.7e9),
    "fast": _timed(lambda t, rng: t * 1e-6),
    "slow": _timed(lambda t, rng: t * 1e5),
    "a pause": _timed(lambda t, rng: t + np.where(np.arange(len(t)) < len(t) // 2, 0.0, rng.choice([10.0, 1e6]))),
    "coarse angles": _jointed(lambda q, rng: np.round(q / 0.05) * 0.05),
    "noisy angles": _jointed(lambda q, rng: q + rng.choice([1e-4, 0.05]) * rng.standard_normal(q.shape)),
    "a joint that wraps": _jointed(lambda q, rng: np.column_stack([q[:, :5], (q[:, 5] + np.pi) % (2 * np.pi) - np.pi])),
    "a joint at rest": _jointed(lambda q, rng: np.where(np.arange(6) == rng.choice([0, 4, 5]), q[0], q)),
    "an arm at rest": _jointed(lambda q, rng: np.tile(q[0], (len(q), 1))),
    "angles held": _jointed(_held),
    "tool poses": _by_tool,
    "otherwise stated": _otherwise_stated,
    "two rates": _two_rates,
    "one pose": _one_pose,
    "few poses": _few_poses,
    "all joints move": _jointed(_wandering),
    "counts": _counts,
    "mounted anew": _turned_once,
    "backwards": _backwards,
    "frozen by turns": _one_sensor(_beating),
    "no variance": _one_channel(_heavy),
    "a copied axis": _one_sensor(_glued),
    "a converter that runs over": _one_channel(_wrapped),
    "digital offsets": _one_sensor(lambda x, rng: np.round(x, 2) + rng.choice([4096.0, -32768.0, 2.0**31])),
}


def locked_imperfect(path: Path, rng: random.Random) -> bytes:
    """A recording at rest with an imperfection, of which a part may be all that there is."""
    found = read_recording(path)
    if rng.random() < 0.4:
        found = found.select(slice(0, rng.choice((2, 3, 10, 50, len(found) // 2))))
    name = rng.choice([name for name in IMPERFECT if "rows" not in name and name != "two samples a pose"])
    return written(IMPERFECT[name](found, np.random.default_rng(rng.getrandbits(32))), path)
