"""Attitude-free calibration beside the packages people use: time, and error against truth over many draws.

The sensor is the accelerometer of Renk et al. (Table 5, noise of 13.4, 13.6, 14.6 mV), its readings brought to g as its
data sheet would have it (2.5 V, 1.4 V/g), since some peers need readings near the unit sphere. Errors are of two kinds,
neither of which depends on the frame that a package chooses for the sensor: of the offset (length of the vector), and
of the field's magnitude, RMS over the whole sphere, when the calibration is applied to readings without noise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

import scenarios
from benchmarks._measure import Call, Cell, Column, Goal, Report, Settings, Table, Timing, interleaved, timing_table
from benchmarks._peers import Peer, ours, peers
from rig.arrays import Array
from rig.channels import ACCELEROMETER, COLUMNS_OF

TITLE = "attitude-free calibration, beside what people use today"

_DATA_SHEET: Final = (2.5, 1.4)  # V, V/g
_SIZES: Final = (6_656, 166_400)
_HELD: Final = 256  # samples a pose
_HAND: Final = 0.1  # rad: how far a hand is off
_MILLI: Final = 1e3


def run(settings: Settings) -> Report:
    truth = Truth.of("renk2005-accelerometer")
    tables, goals, times = [], [], {}
    for size in _SIZES if not settings.quick else _SIZES[:1]:
        timings, table, goal = _timed(truth, size, settings)
        times[f"{size:,} samples"] = timings
        tables.append(table)
        goals.append(goal)
    for case in _CASES:
        table, goal = _judged(truth, case, settings)
        tables.append(table)
        goals.append(goal)
    return Report(tuple(tables), tuple(goals), times)


@dataclass(frozen=True, eq=False)
class Truth:
    """The sensor: reading = gain h + offset + noise, |h| = 1 g.

    Attributes:
        gain: (3, 3) symmetric, in the frame in which it is. offset: (3,) [g]. noise: (3,) standard deviations [g].
    """

    gain: Array
    offset: Array
    noise: Array

    @classmethod
    def of(cls, scenario: str) -> Truth:
        """The accelerometer of a scenario, in g."""
        loaded = scenarios.load(scenario)
        sensor = loaded.truth.accelerometer
        assert sensor is not None
        zero, scale = _DATA_SHEET
        rows = np.array(sensor.sensitivity)[:, None] * sensor.axes * loaded.rig.environment.gravity_m_s2 / scale
        left, lengths, _ = np.linalg.svd(rows)
        noise = np.array(loaded.rig.acquisition.noise_V[COLUMNS_OF[ACCELEROMETER]]) / scale
        return cls((left * lengths) @ left.T, (np.array(sensor.offset) - zero) / scale, noise)

    def readings(self, directions: Array, rng: np.random.Generator, counts: int = 1) -> Array:
        """(n, 3) [g] of directions (n, 3), each the mean of so many samples."""
        clean = directions @ self.gain + self.offset
        return np.asarray(clean + rng.standard_normal(clean.shape) * (self.noise / np.sqrt(counts)))

    @cached_property
    def sphere(self) -> Array:
        """(2000, 3) directions evenly over the sphere (golden spiral), on which calibrations are judged."""
        number = np.arange(2000) + 0.5
        z = 1.0 - number / 1000.0
        angle = np.pi * (1.0 + np.sqrt(5.0)) * number
        across = np.sqrt(1.0 - z * z)
        return np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)

    def errors(self, matrix: Array, centre: Array) -> tuple[float, float]:
        """Of the offset, and RMS of the field's magnitude over the sphere [g]."""
        field = (self.sphere @ self.gain + self.offset - centre) @ matrix.T
        excess = np.sqrt(np.square(field).sum(axis=1)) - 1.0
        return float(np.linalg.norm(centre - self.offset)), float(np.sqrt(np.mean(excess**2)))

    def bound(self, directions: Array, counts: int = 1) -> tuple[float, float]:
        """The least RMS of both errors that an unbiased estimate of the nine parameters can have [g].

        The directions are unknown; what a reading tells without them is its distance from the ellipsoid. With
        u = gain^-1 (V - offset) the constraint is |u| = 1, its gradients follow from du.
        """
        gradient, across = self._gradient(directions)
        variance = np.square(across) @ (np.square(self.noise) / counts)
        covariance = np.linalg.inv(gradient.T @ (gradient / variance[:, None]))
        everywhere, _ = self._gradient(self.sphere)
        magnitude = np.einsum("ni,ij,nj->n", everywhere, covariance, everywhere).mean()
        return float(np.sqrt(covariance[6:, 6:].trace())), float(np.sqrt(magnitude))

    def _gradient(self, directions: Array) -> tuple[Array, Array]:
        """(n, 9) of |u| by gain 11, 22, 33, 12, 13, 23 and offset; (n, 3) by the reading."""
        across = directions @ np.linalg.inv(self.gain)
        x, y, z = directions.T
        p, q, r = across.T
        gain = np.stack([p * x, q * y, r * z, p * y + q * x, p * z + r * x, q * z + r * y], axis=1)
        return -np.concatenate([gain, across], axis=1), across


@dataclass(frozen=True)
class Case:
    """Directions and how they are sampled.

    Attributes:
        name: for people. directions: of the sensor, anew in each draw. counts: samples averaged into each reading.
    """

    name: str
    directions: Callable[[np.random.Generator], Array]
    counts: int = 1


def on_sphere(rng: np.random.Generator, count: int) -> Array:
    """(n, 3) uniformly random directions."""
    vectors = rng.standard_normal((count, 3))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def _on_hemisphere(rng: np.random.Generator) -> Array:
    directions = on_sphere(rng, _SIZES[0])
    directions[:, 2] = np.abs(directions[:, 2])
    return directions


def _poses(rng: np.random.Generator) -> Array:
    """(26, 3): the faces, edges and corners of a cube, as a hand sets them: each some degrees off.

    Exact ones come in opposite pairs, so that the mean of all readings is the centre: which would reward those who take
    it for the centre always, and are wrong by a tenth of the field otherwise.
    """
    grid = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
    grid = grid[np.any(grid != 0.0, axis=1)]
    grid /= np.linalg.norm(grid, axis=1, keepdims=True)
    grid += _HAND * rng.standard_normal(grid.shape)
    return np.asarray(grid / np.linalg.norm(grid, axis=1, keepdims=True))


_CASES: Final = (
    Case("full sphere, 6,656 samples", lambda rng: on_sphere(rng, _SIZES[0])),
    Case("hemisphere, 6,656 samples", _on_hemisphere),
    Case(f"26 poses of {_HELD} samples, each averaged", _poses, _HELD),
    Case(f"26 poses of {_HELD} samples, none averaged", lambda rng: np.repeat(_poses(rng), _HELD, axis=0)),
)


def _timed(truth: Truth, size: int, settings: Settings) -> tuple[dict[str, Timing], Table, Goal]:
    rng = np.random.default_rng([settings.seed, size])
    readings = truth.readings(on_sphere(rng, size), rng)
    everyone = [ours(), *peers(float(truth.noise.mean()))]
    answered = [peer for peer in everyone if peer.estimate(readings) is not None]
    rows = np.ascontiguousarray(_monomials(readings))
    calls: dict[str, Call] = {peer.name: _bound(peer, readings) for peer in answered}
    calls["bare pass: Gram product of the monomials"] = lambda: rows @ rows.T
    timings = interleaved(calls, settings.rounds_of(15, 3))
    own, *others = [peer.name for peer in answered]
    fastest = min(others, key=lambda name: timings[name].median)
    errors = {peer.name: truth.errors(*found) for peer in answered if (found := peer.estimate(readings)) is not None}
    further: dict[str, Mapping[str, Cell]] = {
        "covariance": {peer.name: "yes" if peer.covariance else "no" for peer in answered},
        "offset error [mg]": {name: _MILLI * error[0] for name, error in errors.items()},
        "field error [mg]": {name: _MILLI * error[1] for name, error in errors.items()},
    }
    bound = truth.bound(on_sphere(np.random.default_rng(settings.seed), size))
    table = timing_table(
        f"{size:,} samples over the full sphere",
        timings,
        beside=[fastest, "bare pass: Gram product of the monomials"],
        further=further,
        note="Errors of this one draw; the bounds of their RMS: "
        f"{_MILLI * bound[0]:.3g} and {_MILLI * bound[1]:.3g} mg.",
    )
    ratio = timings[own].over(timings[fastest])
    return (
        timings,
        table,
        Goal(f"{size:,} samples with covariance, over the fastest peer ({fastest})", ratio, "at most", 2.0),
    )


def _bound(peer: Peer, readings: Array) -> Call:
    prepared = peer.prepare(readings)
    return lambda: peer.call(prepared)


def _monomials(readings: Array) -> Array:
    """(10, n): what every algebraic fit sums the products of."""
    x, y, z = readings.T
    return np.stack([x * x, y * y, z * z, y * z, x * z, x * y, x, y, z, np.ones_like(x)])


@dataclass(frozen=True, eq=False)
class _Score:
    """How far one way is off over all draws: (2,), of the offset and of the field [g].

    Attributes:
        rms: root mean square error. uncertainty: its standard error.
        lost: draws without an answer.
    """

    rms: Array
    uncertainty: Array
    lost: int

    @classmethod
    def of(cls, errors: Sequence[tuple[float, float] | None]) -> _Score:
        """From the errors of each draw, None where there was no answer."""
        answered = [error for error in errors if error is not None]
        if len(answered) < 2:
            return cls(np.full(2, np.nan), np.full(2, np.nan), len(errors) - len(answered))
        square = np.square(answered)
        rms = np.sqrt(square.mean(axis=0))
        uncertainty = square.std(axis=0, ddof=1) / (2.0 * rms * np.sqrt(len(square)))
        return cls(rms, uncertainty, len(errors) - len(answered))


def _judged(truth: Truth, case: Case, settings: Settings) -> tuple[Table, Goal]:
    draws = settings.of(200, 20)
    rng = np.random.default_rng([settings.seed, 2])
    counts = None if case.counts == 1 else np.full(len(case.directions(rng)), float(case.counts))
    own, *others = everyone = [ours(counts=counts), *peers(float(truth.noise.mean() / np.sqrt(case.counts)))]
    errors: dict[str, list[tuple[float, float] | None]] = {peer.name: [] for peer in everyone}
    bounds = []
    for _ in range(draws):
        directions = case.directions(rng)
        readings = truth.readings(directions, rng, case.counts)
        bounds.append(truth.bound(directions, case.counts))
        for peer in everyone:
            estimate = peer.estimate(readings)
            errors[peer.name].append(None if estimate is None else truth.errors(*estimate))
    scores = {name: _Score.of(each) for name, each in errors.items()}
    always = [peer.name for peer in others if not scores[peer.name].lost]
    behind, notes = [], []
    for kind, what in enumerate(("offset", "field")):
        best = min(always, key=lambda name: scores[name].rms[kind])
        steps = float((scores[own.name].rms[kind] - scores[best].rms[kind]) / scores[best].uncertainty[kind])
        behind.append(steps)
        notes.append(f"{what}: {best}, from which ours is {steps:+.1f} of its standard errors")
    note = f"The best peer that always answers in {'; '.join(notes)}."
    table = _score_table(f"{case.name}: {draws} draws", scores, np.sqrt(np.mean(np.square(bounds), axis=0)), note)
    what = f"{case.name}: RMS error behind the best peer's, in its standard errors"
    return table, Goal(what, max(behind), "at most", 2.0)


def _score_table(title: str, scores: Mapping[str, _Score], bound: Array, note: str) -> Table:
    columns = (
        Column("call", ""),
        Column("offset RMS [mg]"),
        Column("± offset", ".2g"),
        Column("offset / bound"),
        Column("field RMS [mg]"),
        Column("± field", ".2g"),
        Column("field / bound"),
        Column("no answer", "d"),
    )
    rows: list[tuple[Cell, ...]] = []
    for name, score in scores.items():
        cells: list[Cell] = [name]
        for kind in (0, 1):
            rms, uncertainty = float(score.rms[kind]), float(score.uncertainty[kind])
            cells += [_MILLI * rms, _MILLI * uncertainty, rms / float(bound[kind])]
        rows.append((*cells, score.lost))
    limits = _MILLI * bound
    rows.append(("limit: Cramér–Rao bound", float(limits[0]), None, 1.0, float(limits[1]), None, 1.0, None))
    return Table(title, columns, tuple(rows), note)
