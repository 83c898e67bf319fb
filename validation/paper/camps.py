"""Camps et al., Tables 1 to 4, beside the rig: their three tests, their estimator and its start, 600 readings each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

import numpy as np
from scipy.stats import chi2, norm

from estimators.ellipsoid import Start, fit_ellipsoid
from estimators.ellipsoid.fit import Parameters
from estimators.stillness import CAMPS_THRESHOLD_V2, find_still
from rig.arrays import Array
from rig.channels import ACCELEROMETER, CHANNELS, COLUMNS_OF
from rig.maneuver import HandTumble
from rig.recording import Recording
from scenarios.loader import load
from scenarios.scenario import Scenario
from validation.paper.published import EllipsoidTable, camps, ellipsoid_table
from validation.paper.rows import SIGMAS, Row, Word

#: Simulated experiments, each with its own tumble.
EXPERIMENTS: Final = 60
TESTS: Final = 3
NINE: Final = {"magnetometer": "3", "accelerometer": "4"}
SIX: Final = {"magnetometer": "1", "accelerometer": "2"}
_TAIL: Final = float(norm.sf(SIGMAS))


@dataclass(frozen=True, eq=False)
class Tumbles:
    """Simulated experiments of one sensor, with the mean of the paper's nine-parameter tests as truth.

    Attributes:
        sensor: which.
        noise: of a reading [V], such that the median parameter of the nine scatters as in the paper's tests.
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
def tumbles(sensor: str, speed_deg_per_s: float | None = None) -> Tumbles:
    """The experiments of a sensor, at another RMS speed of the hand than the scenario's if one is given."""
    speed = speed_deg_per_s
    # The standard deviation of an estimate is proportional to the noise, so one level tells all of them.
    trial_noise = 1e-3
    scatter = _estimates(sensor, trial_noise, speed, (9,))[0][9].std(axis=0)
    ratio = ellipsoid_table(NINE[sensor]).values.std(axis=1, ddof=1) / scatter
    freedom = TESTS - 1
    noise = trial_noise * float(np.median(ratio) / np.sqrt(chi2.median(freedom) / freedom))
    estimates, names = _estimates(sensor, noise, speed)
    gain, _, field = truth(sensor)
    exact = readings(sensor, 0, speed_deg_per_s=speed)
    six = fit_ellipsoid(exact, field, parameters=6, start=data_sheet(sensor), refuse=False, name=sensor)
    felt = (exact - six.offset) @ np.linalg.inv(six.gain).T
    residual = np.linalg.norm(felt, axis=1) / field - 1.0
    axes = gain / np.linalg.norm(gain, axis=1, keepdims=True)
    between = np.degrees(np.arccos([axes[0] @ axes[1], axes[0] @ axes[2], axes[1] @ axes[2]]))
    return Tumbles(sensor, noise, estimates, names, float(np.sqrt(np.mean(residual**2))), between)


def _estimates(
    sensor: str, noise: float, speed: float | None, parameters: tuple[Parameters, ...] = (6, 9)
) -> tuple[dict[int, Array], dict[int, tuple[str, ...]]]:
    field = truth(sensor)[2]
    found: dict[int, list[Array]] = {number: [] for number in parameters}
    names: dict[int, tuple[str, ...]] = {}
    for seed in range(EXPERIMENTS):
        noisy = readings(sensor, seed, noise, speed)
        for number in parameters:
            fit = fit_ellipsoid(noisy, field, parameters=number, start=data_sheet(sensor), refuse=False, name=sensor)
            found[number].append(fit.values)
            names[number] = fit.names
    return {number: np.array(values) for number, values in found.items()}, names


def truth(sensor: str) -> tuple[Array, Array, float]:
    """Gain (3, 3) [V/G or V/g], offset (3,) [V] and the field's magnitude [G or g]."""
    mean = ellipsoid_table(NINE[sensor]).values.mean(axis=1)
    xx, yy, zz, xy, xz, yz = mean[:6]
    gain = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])  # Camps (6)
    return gain, mean[6:], float(camps()[sensor]["field"])


def data_sheet(sensor: str) -> Start:
    """Where the paper's estimator starts: the theoretical gain [V/G or V/g] and no offset."""
    return Start(float(camps()[sensor]["nominal_gain"]), 0.0)


@cache
def scenario_of(sensor: str) -> Scenario:
    """The paper's experiment: turned by hand; of the accelerometer, held still in between."""
    return load(f"camps2009-{sensor}")


def readings(sensor: str, seed: int, noise: float = 0.0, speed_deg_per_s: float | None = None) -> Array:
    """(600, 3) [V] single readings of the experiment; the accelerometer's at rest by the paper's threshold (6.2)."""
    made = _exact(sensor, seed, speed_deg_per_s)
    white = np.random.default_rng([seed, 0]).standard_normal((len(made), len(CHANNELS)))[:, COLUMNS_OF[sensor]]
    volts = made.readings(sensor) + noise * white
    if sensor == ACCELEROMETER:
        volts = volts[find_still(replace(made, accelerometer=volts), threshold=CAMPS_THRESHOLD_V2).still]
    count = int(camps()["readings"])
    return np.asarray(volts[np.linspace(0, len(volts) - 1, count).astype(int)])


def field_of_place(sensor: str) -> Array:
    """(3,) the unit vector that a sensor feels at the paper's place, x north, z up: gravity, or the dipping field."""
    dip = np.radians(float(camps()["place"]["dip_deg"]))
    return np.array([0.0, 0.0, -1.0] if sensor == ACCELEROMETER else [np.cos(dip), 0.0, -np.sin(dip)])


@cache
def _exact(sensor: str, seed: int, speed_deg_per_s: float | None) -> Recording:
    """The experiment without noise and converter."""
    scenario = scenario_of(sensor)
    assert isinstance(scenario.maneuver, HandTumble)
    speed = scenario.maneuver.speed_deg_per_s if speed_deg_per_s is None else speed_deg_per_s
    maneuver = replace(scenario.maneuver, seed=seed, speed_deg_per_s=speed)
    quiet = scenario.with_acquisition(noise_V=(0.0,) * 6, bits=None, range_V=None)
    return replace(quiet, maneuver=maneuver).simulate(seed)


def rows() -> tuple[Row, ...]:
    """Every row of Tables 1 to 4."""
    return tuple(row for number in ("1", "2", "3", "4") for row in _rows(ellipsoid_table(number)))


def _rows(table: EllipsoidTable) -> Iterator[Row]:
    many = tumbles(table.sensor)
    estimates, names = many.estimates[table.parameters], many.names[table.parameters]
    gain_unit = "V/G" if table.sensor == "magnetometer" else "V/g"
    slip = column_in_row(table)
    for name, tests in table.rows.items():
        own = estimates[:, names.index(name)]
        values = np.array([one.value for one in tests])
        scatter = float(values.std(ddof=1) / own.std())
        chance = two_sided(scatter)
        # Means of three tests that scatter as these do, or as the rig's do.
        spread = max(float(values.std(ddof=1)), float(own.std())) / np.sqrt(TESTS)
        sigmas = float((values.mean() - own.mean()) / spread)
        word: Word = "agrees"
        why = f"three tests scatter {scatter:.2g} times as much as the rig's (p = {chance:.2g}, two-sided)"
        if name == slip:
            word, why = "differs", "the row holds test 1's column: the three gains of one test, not one gain of three"
        elif chance < 2.0 * _TAIL:
            word, why = "differs", f"{why}: between tests something else changes than the noise"
        elif abs(sigmas) > SIGMAS:
            word, why = "differs", f"{abs(sigmas):.1f}σ from the rig's mean"
        unit = gain_unit if name.startswith("gain") else "V"
        text = ", ".join(one.text for one in tests)
        place = ("camps", table.number, name, "three tests", unit)
        yield Row.of_draws(place, text, own, sigmas, word, "by construction", why)


def two_sided(ratio: float) -> float:
    """The probability that three normal values scatter so far from what they should, more or less."""
    freedom = TESTS - 1
    tail = float(chi2.sf(freedom * ratio**2, freedom))
    return 2.0 * min(tail, 1.0 - tail)


def column_in_row(table: EllipsoidTable) -> str | None:
    """The parameter whose three tests are printed as one test's three gains; None if there is none."""
    gains = ("gain11", "gain22", "gain33")
    for test in range(TESTS):
        column = [table.rows[name][test].text for name in gains]
        for name in gains:
            if [one.text for one in table.rows[name]] == column:
                return name
    return None
