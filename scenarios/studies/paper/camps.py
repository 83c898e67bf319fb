"""Camps et al., Tables 1 to 4, beside the rig: their three tests, their estimator and its start, 600 readings each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from estimators.ellipsoid import Start, fit_ellipsoid
from rig.channels import SENSORS
from rig.maneuver import HandTumble
from scenarios.studies.paper.published import EllipsoidTable, camps, ellipsoid_table
from scenarios.studies.paper.rows import SIGMAS, Row, Statement, Word

Array = NDArray[np.float64]

#: Simulated experiments, each with its own tumble.
EXPERIMENTS: Final = 60
_SIX: Final = {"magnetometer": "1", "accelerometer": "2"}
_NINE: Final = {"magnetometer": "3", "accelerometer": "4"}
_TAIL: Final = 0.5 * 4.65e-4
_TESTS: Final = 3


@dataclass(frozen=True, eq=False)
class Tumbles:
    """Simulated experiments of one sensor, with the mean of the paper's nine-parameter tests as truth.

    Attributes:
        sensor: which. noise: of a reading [V], such that the median parameter scatters as in the paper's tests.
        estimates: 6 or 9 -> (m, p). names: 6 or 9 -> (p,).
        residual: RMS of |h| / H - 1 that six parameters leave on readings without noise.
        orthogonality_deg: (3,) angles between axes 1-2, 1-3, 2-3 of the truth [deg].
    """

    sensor: str
    noise: float
    estimates: dict[int, Array]
    names: dict[int, tuple[str, ...]]
    residual: float
    orthogonality_deg: Array


@cache
def tumbles(sensor: str) -> Tumbles:
    """The experiments of a sensor."""
    table = ellipsoid_table(_NINE[sensor])
    # The standard deviation of an estimate is proportional to the noise, so one level tells all of them.
    trial_noise = 1e-2
    scatter = _estimates(sensor, trial_noise)[0][9].std(axis=0)
    ratio = table.values.std(axis=1, ddof=1) / scatter
    freedom = _TESTS - 1
    noise = trial_noise * float(np.median(ratio) / np.sqrt(chi2.median(freedom) / freedom))
    estimates, names = _estimates(sensor, noise)
    gain, offset, field = _truth(sensor)
    away = _tumble(0, field) @ gain.T
    six = fit_ellipsoid(away + offset, field, parameters=6, start=_start(sensor), refuse=False, name=sensor)
    felt = (away + offset - six.offset) @ np.linalg.inv(six.gain).T
    residual = np.linalg.norm(felt, axis=1) / field - 1.0
    axes = gain / np.linalg.norm(gain, axis=1, keepdims=True)
    between = np.degrees(np.arccos([axes[0] @ axes[1], axes[0] @ axes[2], axes[1] @ axes[2]]))
    return Tumbles(sensor, noise, estimates, names, float(np.sqrt(np.mean(residual**2))), between)


def _estimates(sensor: str, noise: float) -> tuple[dict[int, Array], dict[int, tuple[str, ...]]]:
    gain, offset, field = _truth(sensor)
    found: dict[int, list[Array]] = {6: [], 9: []}
    names: dict[int, tuple[str, ...]] = {}
    for seed in range(EXPERIMENTS):
        exact = _tumble(seed, field) @ gain.T + offset
        readings = exact + noise * np.random.default_rng([seed, 2009]).standard_normal(exact.shape)
        six = fit_ellipsoid(readings, field, parameters=6, start=_start(sensor), refuse=False, name=sensor)
        nine = fit_ellipsoid(readings, field, parameters=9, start=_start(sensor), refuse=False, name=sensor)
        for fit in (six, nine):
            found[fit.parameters].append(fit.values)
            names[fit.parameters] = fit.names
    return {parameters: np.array(values) for parameters, values in found.items()}, names


def _truth(sensor: str) -> tuple[Array, Array, float]:
    """Gain (3, 3), offset (3,) and the field's magnitude."""
    mean = ellipsoid_table(_NINE[sensor]).values.mean(axis=1)
    xx, yy, zz, xy, xz, yz = mean[:6]
    gain = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])  # Camps (6)
    return gain, mean[6:], float(camps()[sensor]["field"])


def _start(sensor: str) -> Start:
    return Start(float(camps()[sensor]["nominal_gain"]), 0.0)


def _tumble(seed: int, field: float) -> Array:
    """(600, 3) the field in the sensor's frame during a tumble by hand."""
    count = camps()["readings"]
    rotations = HandTumble(seed=seed, duration_s=count / 5.0, rate_Hz=5.0).trajectory().R_base_tool
    return np.asarray(-field * rotations[:, 2, :])  # R^T f of a field that points down


def rows() -> tuple[Row, ...]:
    """Every row of Tables 1 to 4."""
    return tuple(row for number in ("1", "2", "3", "4") for row in _rows(ellipsoid_table(number)))


def _rows(table: EllipsoidTable) -> Iterator[Row]:
    many = tumbles(table.sensor)
    estimates, names = many.estimates[table.parameters], many.names[table.parameters]
    gain_unit = "V/G" if table.sensor == "magnetometer" else "V/g"
    high = float(np.sqrt(chi2.isf(_TAIL, _TESTS - 1) / (_TESTS - 1)))
    slip = column_in_row(table)
    for name, tests in table.rows.items():
        own = estimates[:, names.index(name)]
        values = np.array([one.value for one in tests])
        scatter = float(values.std(ddof=1) / own.std())
        # Means of three tests that scatter as these do, or as the rig's do.
        spread = max(float(values.std(ddof=1)), float(own.std())) / np.sqrt(_TESTS)
        sigmas = float((values.mean() - own.mean()) / spread)
        word: Word = "agrees"
        why = f"three tests scatter {scatter:.2g} times as much as the rig's"
        if name == slip:
            word, why = "differs", "the row holds test 1's column: the three gains of one test, not one gain of three"
        elif scatter > high:
            word, why = "differs", f"{why}: between tests something else changes than the noise"
        elif abs(sigmas) > SIGMAS:
            word, why = "differs", f"{abs(sigmas):.1f}σ from the rig's mean"
        unit = gain_unit if name.startswith("gain") else "V"
        text = ", ".join(one.text for one in tests)
        mean, std = float(own.mean()), float(own.std())
        yield Row("camps", table.number, name, "three tests", unit, text, mean, std, sigmas, word, why)


def column_in_row(table: EllipsoidTable) -> str | None:
    """The parameter whose three tests are printed as one test's three gains; None if there is none."""
    gains = ("gain11", "gain22", "gain33")
    for test in range(_TESTS):
        column = [table.rows[name][test].text for name in gains]
        for name in gains:
            if [one.text for one in table.rows[name]] == column:
                return name
    return None


def statements() -> tuple[Statement, ...]:
    """What the text says, checked."""
    return (*_precision(), *(_orthogonality(sensor) for sensor in SENSORS), _derivative(), _step())


def _precision() -> Iterator[Statement]:
    stated = float(camps()["precision"])
    for sensor in SENSORS:
        tables = [ellipsoid_table(number) for number in (_SIX[sensor], _NINE[sensor])]
        largest, name, number = max(
            (float(np.std([one.value for one in tests], ddof=1)), name, table.number)
            for table in tables
            for name, tests in table.rows.items()
            if name != column_in_row(table)
        )
        yield Statement(
            "camps",
            f"Tables {tables[0].number} and {tables[1].number}, {sensor}",
            f"gains and offsets are precise to about {stated:g}",
            f"the three tests scatter by up to {largest:.3f} ({name}, Table {number})",
            largest <= np.sqrt(10.0) * stated,
        )


def _orthogonality(sensor: str) -> Statement:
    many = tumbles(sensor)
    off = np.abs(many.orthogonality_deg - 90.0)
    pair = ("1-2", "1-3", "2-3")[int(off.argmax())]
    return Statement(
        "camps",
        f"Table {_NINE[sensor]}, {sensor}",
        "the axes are orthogonal enough for the six parameters in some uses",
        f"axes {pair} are {off.max():.2f}° off a right angle; six parameters leave {many.residual:.2%} of the field",
        bool(many.residual < float(camps()["precision"])),
    )


def _derivative() -> Statement:
    """(5): the derivative of e by an offset, against a central difference."""
    gain, offset, field = _truth("magnetometer")
    inverse = 1.0 / gain.diagonal()
    readings = _tumble(0, field) @ gain.T + offset

    def error(moved: Array) -> Array:
        return np.asarray(np.square((readings - moved) * inverse).sum(axis=1) - field**2)

    step = np.array([1e-5, 0.0, 0.0])
    numerical = (error(offset + step) - error(offset - step)) / 2e-5
    away = readings[:, 0] - offset[0]
    printed, mended = -2.0 * inverse[0] * away**2, -2.0 * inverse[0] ** 2 * away
    scale = np.linalg.norm(numerical)
    off = [float(np.linalg.norm(one - numerical) / scale) for one in (printed, mended)]
    return Statement(
        "camps",
        "(5)",
        "the derivative by an offset is -2 alpha' (V - beta)²",
        f"off by {off[0]:.0%} of a central difference; -2 alpha'² (V - beta) is off by less than"
        f" {'1e-6' if off[1] < 1e-6 else f'{off[1]:.0e}'}",
        off[0] < 1e-6,
    )


def _step() -> Statement:
    """The step of section 4: whether the sum of squares falls along it."""
    gain, offset, field = _truth("magnetometer")
    readings = _tumble(0, field) @ gain.T + offset
    inverse = 1.0 / np.full(3, float(camps()["magnetometer"]["nominal_gain"]))
    start = np.zeros(3)
    away = readings - start
    error = np.square(away * inverse).sum(axis=1) - field**2
    jacobian = np.hstack([2.0 * inverse * away**2, -2.0 * inverse**2 * away])
    q = np.linalg.solve(jacobian.T @ jacobian, jacobian.T @ error)

    def cost(step: Array) -> float:
        moved = np.square((readings - (start + step[3:])) * (inverse + step[:3])).sum(axis=1) - field**2
        return float(moved @ moved)

    before = float(error @ error)
    printed, mended = cost(q) / before, cost(-q) / before
    return Statement(
        "camps",
        "section 4",
        "the step q solves J'J q = J'e",
        f"from the data sheet's values the sum of squares becomes {printed:.2g} times as large after q, and"
        f" {mended:.2g} times after -q: the sign is minus",
        printed < 1.0,
    )
