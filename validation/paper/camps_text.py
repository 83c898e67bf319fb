"""What the text of Camps et al. says about its numbers and formulas, checked against them and against the rig."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from rig.arrays import Array
from rig.channels import MAGNETOMETER, SENSORS
from rig.maneuver import AxisRotations
from rig.threads import one_blas_thread
from validation.paper.camps import NINE, SIX, column_in_row, field_of_place, readings, truth, tumbles
from validation.paper.camps_joint import JointScatter, joint_scatter
from validation.paper.published import camps, ellipsoid_table
from validation.paper.rows import Statement

Function = Callable[[Array], Array]

#: A table whose three tests scatter otherwise than the rig's with less than this probability does not agree with it.
LEVEL: Final = 0.01
#: The hand's RMS speed in a slower tumble than the scenario's [deg/s].
SLOWER: Final = 60.0
_EVALUATIONS: Final = 1000
#: Directions on a grid, for (3).
_GRID: Final = 200


def statements() -> tuple[Statement, ...]:
    """All of them."""
    return (
        *_precision(),
        _magnitude(),
        *(_scatter(joint_scatter(number)) for number in ("1", "2", "3", "4")),
        _scatter(joint_scatter("1", SLOWER)),
        *(_orthogonality(sensor) for sensor in SENSORS),
        _gain_in_words(),
        _semi_axes(),
        _polar_angle(),
        _azimuth(),
        _quadratic(),
        _derivative(),
        _step(),
        _iterations(),
        _misprint_in_the_code(),
        *_turned_from_level(),
    )


def _say(about: str, says: str, finds: str, holds: bool) -> Statement:
    return Statement("camps", about, says, finds, holds)


def _precision() -> Iterator[Statement]:
    stated = float(camps()["precision"])
    for sensor in SENSORS:
        tables = [ellipsoid_table(number) for number in (SIX[sensor], NINE[sensor])]
        largest, name, number = max(
            (float(np.std([one.value for one in tests], ddof=1)), name, table.number)
            for table in tables
            for name, tests in table.rows.items()
            if name != column_in_row(table)
        )
        yield _say(
            f"Tables {tables[0].number} and {tables[1].number}, {sensor}",
            f"gains and offsets are precise to about {stated:g}",
            f"the three tests scatter by up to {largest:.3f} ({name}, Table {number})",
            largest <= np.sqrt(10.0) * stated,
        )


def _magnitude() -> Statement:
    """The stated magnitude of the field beside the Earth's there and then."""
    stated, earth = float(camps()["magnetometer"]["field"]), float(camps()["place"]["field_G"])
    gains = ellipsoid_table(NINE[MAGNETOMETER]).values[:3].mean()
    claim = float(camps()["precision"]) / float(gains)
    off = stated / earth - 1.0
    return _say(
        "3.1, magnitude of the field",
        f"it must be precisely known; undisturbed it is {stated:g} G here",
        f"IGRF-14 has {earth:.4f} G in {camps()['place']['name']}: {off:.1%} less, which makes every gain {off:.1%} too"
        f" small, {off / claim:.0f} times the stated precision ({claim:.2%} of a gain)",
        abs(off) < claim,
    )


def _scatter(found: JointScatter) -> Statement:
    names = "all parameters together" if found.left_out is None else f"all parameters but {found.left_out}, together"
    holds = min(found.level_p, found.unevenness_p, found.p_value) >= LEVEL
    finds = (
        f"{names}, rig tumbled at {found.speed_deg_per_s:g}°/s: they scatter {found.level:.2g} times as much as three"
        f" of the rig's (geometric mean, p = {found.level_p:.1g}), some by a factor {np.exp(found.unevenness):.1f} more"
        f" than others (p = {found.unevenness_p:.1g}); chi-square {found.chi_square:.0f} for {found.degrees_of_freedom}"
        f" degrees of freedom (p = {found.p_value:.1g}; all two-sided)"
    )
    if not holds:
        finds += (
            ": the three tests were more alike than three tumbles of the rig"
            if found.level < 1.0 and found.level_p < LEVEL
            else ": between tests something else changes than the noise"
        )
    return _say(
        f"Table {found.table}, {found.sensor}",
        "the method gives stable parameters",
        finds,
        holds,
    )


def _orthogonality(sensor: str) -> Statement:
    """What leaving the orthogonality errors out does to readings, against the stated precision of the offsets."""
    many = tumbles(sensor)
    gain, _, field = truth(sensor)
    stated = float(camps()["precision"])
    off = np.abs(many.orthogonality_deg - 90.0)
    pair = ("1-2", "1-3", "2-3")[int(off.argmax())]
    volts = float(np.abs(gain - np.diag(gain.diagonal())).max() * field)
    return _say(
        f"Table {NINE[sensor]}, {sensor}",
        "the orthogonality of the sensor is very good; its errors may be left out in some uses",
        f"axes {pair} are {off.max():.2f}° off a right angle, which moves a reading by up to {1e3 * volts:.1f} mV where"
        f" {1e3 * stated:g} mV is the stated precision; six parameters leave {many.residual:.2%} of the field",
        volts < stated,
    )


def _gain_in_words() -> Statement:
    """Section 7 gives the magnetometer's theoretical gain in words and in p0."""
    stated, used = camps()["magnetometer"]["gain_in_words"], camps()["magnetometer"]["nominal_gain"]
    return _say(
        "section 7, magnetometer",
        f"the theoretical gains are {stated}",
        f"its p0 has 1/{used}, as section 6.1 does: {stated} is the accelerometer's",
        stated == used,
    )


def _semi_axes() -> Statement:
    gain, offset, field = truth(MAGNETOMETER)
    reach = np.abs((readings(MAGNETOMETER, 0) - offset) @ np.linalg.inv(gain).T).max(axis=0) * gain.diagonal()
    return _say(
        "(2)",
        "the semi-axes of the ellipsoid are the gains",
        f"they are the gains times the field: the magnetometer's readings reach {reach.min():.1f} to"
        f" {reach.max():.1f} V from the centre, {field:g} of its gains of {gain.diagonal().min():.1f} to"
        f" {gain.diagonal().max():.1f} V/G",
        bool(np.allclose(reach, gain.diagonal(), rtol=0.05)),
    )


def _directions() -> Array:
    """(n, 3) directions with equal areas around them."""
    z, azimuth = np.meshgrid(
        (np.arange(_GRID) + 0.5) / _GRID * 2.0 - 1.0, (np.arange(_GRID) + 0.5) / _GRID * 2.0 * np.pi - np.pi
    )
    ring = np.sqrt(1.0 - z**2)
    return np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=-1).reshape(-1, 3)


def _polar_angle() -> Statement:
    h = _directions()
    theta = np.arctan(np.hypot(h[:, 0], h[:, 1]) / h[:, 2])
    lower = h[:, 2] < 0.0
    return _say(
        "(3), theta",
        "theta, between -90° and 90°, is the polar angle of the field",
        f"below the horizon ({lower.mean():.0%} of all directions) the arctangent is the polar angle less 180°: those"
        f" nearest the horizon land at {np.degrees(theta[lower]).min():.0f}°, the nadir at 0°, beside the zenith",
        bool((theta > 0.0).all()),
    )


def _azimuth() -> Statement:
    h = _directions()
    printed = np.arctan(h[:, 1] / h[:, 0])
    same = np.abs(printed - np.arctan2(h[:, 1], h[:, 0])) < 1e-9
    return _say(
        "(3), phi",
        "phi = arctan(hy/hx), between -180° and 180°",
        f"a plain arctangent ends at ±{np.degrees(np.abs(printed)).max():.0f}° and is right for {same.mean():.0%} of"
        " all directions: (hx, hy, hz) and (-hx, -hy, hz) fall on one point of the map, so that half the sphere unseen"
        " would not show; with the signs of both (atan2) all are right",
        bool(same.all()),
    )


def _problem(noisy: bool = False) -> tuple[Array, Array, Function]:
    """Readings (n, 3) [V] of the magnetometer, without noise or with the experiments', for what a search does at its
    end; p0, and e of (p) with six parameters."""
    gain, offset, field = truth(MAGNETOMETER)
    volts = (readings(MAGNETOMETER, 0) - offset) @ np.linalg.inv(gain).T * gain.diagonal() + offset
    if noisy:
        volts = volts + tumbles(MAGNETOMETER).noise * np.random.default_rng(2009).standard_normal(volts.shape)
    start = np.concatenate([np.full(3, 1.0 / float(camps()[MAGNETOMETER]["nominal_gain"])), np.zeros(3)])

    def error(p: Array) -> Array:
        return np.asarray(np.square((volts - p[3:]) * p[:3]).sum(axis=1) - field**2)

    return volts, start, error


def _jacobian(volts: Array, p: Array, printed: bool) -> Array:
    """(5) as it is printed, or mended."""
    away = volts - p[3:]
    by_offset = -2.0 * p[:3] * away**2 if printed else -2.0 * p[:3] ** 2 * away
    return np.hstack([2.0 * p[:3] * away**2, by_offset])


def _quadratic() -> Statement:
    """Along a line a quadratic function has one second derivative."""
    _, start, error = _problem()
    gain, offset, _ = truth(MAGNETOMETER)
    end = np.concatenate([1.0 / gain.diagonal(), offset])
    steps = np.linspace(0.0, 1.0, 21)
    cost = np.array([np.square(error(start + s * (end - start))).sum() for s in steps])
    second = np.diff(cost, 2)
    return _say(
        "section 4, S(p)",
        "the cost function is quadratic",
        f"it is of degree eight in p: from p0 to the solution its second derivative changes by a factor"
        f" {second.max() / second.min():.1f}; of degree two it would stay",
        bool(second.max() / second.min() - 1.0 < 1e-6),
    )


def _derivative() -> Statement:
    """(5): the derivative of e by an offset, against a central difference."""
    volts, start, error = _problem()
    step = np.zeros(6)
    step[3] = 1e-5
    numerical = (error(start + step) - error(start - step)) / 2e-5
    scale = np.linalg.norm(numerical)
    off = [
        float(np.linalg.norm(_jacobian(volts, start, printed)[:, 3] - numerical) / scale) for printed in (True, False)
    ]
    return _say(
        "(5)",
        "the derivative by an offset is -2 alpha' (V - beta)²",
        f"off by {off[0]:.0%} of a central difference; -2 alpha'² (V - beta) is off by less than"
        f" {'1e-6' if off[1] < 1e-6 else f'{off[1]:.0e}'}",
        off[0] < 1e-6,
    )


def _step() -> Statement:
    """The step of section 4: whether the sum of squares falls along it."""
    volts, start, error = _problem()
    e, jacobian = error(start), _jacobian(volts, start, printed=False)
    q = np.linalg.solve(jacobian.T @ jacobian, jacobian.T @ e)
    before = float(e @ e)
    printed, mended = (float(np.square(error(start + sign * q)).sum()) / before for sign in (1.0, -1.0))
    return _say(
        "section 4",
        "the step q solves J'J q = J'e",
        f"from the data sheet's values the sum of squares becomes {printed:.2g} times as large after q, and"
        f" {mended:.2g} times after -q: the sign is minus",
        printed < 1.0,
    )


def _iterations() -> Statement:
    noisy, start, error = _problem(noisy=True)
    by_formula = least_squares(error, start, lambda p: _jacobian(noisy, p, False), method="lm", max_nfev=_EVALUATIONS)
    evaluations = 0

    def counted(p: Array) -> Array:
        nonlocal evaluations
        evaluations += 1
        return error(p)

    least_squares(counted, start, method="lm", max_nfev=_EVALUATIONS)
    stated = int(camps()["iterations"])
    return _say(
        "section 6, iterations",
        f"about {stated}",
        f"Levenberg-Marquardt is there after {by_formula.nfev} steps; with derivatives by differences, as lmfit takes"
        f" them, it evaluates e {evaluations} times in all: the paper's number is neither",
        bool(max(by_formula.nfev, evaluations) > 0.5 * stated),
    )


def _misprint_in_the_code() -> Statement:
    """A search with (5) as it is printed."""
    noisy, start, error = _problem(noisy=True)
    with one_blas_thread():
        mended, printed = (
            least_squares(
                error, start, lambda p, as_is=as_is: _jacobian(noisy, p, as_is), method="lm", max_nfev=_EVALUATIONS
            )
            for as_is in (False, True)
        )
    volts = float(np.abs(printed.x[3:] - mended.x[3:]).max())
    return _say(
        "(5) in their code",
        "the results come from Levenberg-Marquardt with the derivatives of (5)",
        f"with (5) as printed it stalls at over {_floored(printed.cost / mended.cost):g} times the least sum of"
        f" squares, offsets over {_floored(volts):g} V off, where the tables repeat to {camps()['precision']} V: the"
        " misprint is not in their code",
        bool(volts < float(camps()["precision"])),
    )


def _floored(value: float) -> float:
    """Down to one digit: where a search without a gradient stalls, rounding decides the next."""
    unit = 10.0 ** np.floor(np.log10(value))
    return float(np.floor(value / unit) * unit)


def _turned_from_level() -> Iterator[Statement]:
    """Figure 3: full turns about three axes, from level; which parameters they can tell."""
    rotations = AxisRotations().trajectory().R_base_tool
    for sensor in SENSORS:
        h = np.einsum("nij,i->nj", rotations, field_of_place(sensor))
        told = {}
        for parameters in (6, 9):
            columns = [h[:, i] * h[:, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))][: parameters - 3]
            matrix = np.column_stack([*columns, h])
            values = np.linalg.svd(matrix / np.linalg.norm(matrix, axis=0).clip(1e-12), compute_uv=False)
            told[parameters] = int((values > 1e-9 * values[0]).sum()), float(values[0] / values[-1])
        words = ", ".join(
            f"{rank} of {parameters} parameters" + (f" (condition {condition:.0f})" if rank == parameters else "")
            for parameters, (rank, condition) in told.items()
        )
        yield _say(
            f"3.1 and Figure 3, {sensor}",
            "turning about X, Y and Z from level is enough",
            f"the {sensor} can tell {words}",
            all(rank == parameters for parameters, (rank, _) in told.items()),
        )
