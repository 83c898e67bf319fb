"""What Renk et al. say beside their tables: signs, ranges, units, and which readings are the most useful."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from rig.arrays import Array
from rig.channels import ACCELEROMETER
from scenarios.studies.coordinates import Coordinates
from scenarios.studies.settings import Settings, expected
from validation.paper.dip import dip_argument, dip_words
from validation.paper.published import Printed, parameter_table, renk, spread_table, unit_of
from validation.paper.rows import Statement
from validation.paper.simulated import drawn, scenario_of

_G: Final = 9.8  # as in the paper
_OUTPUT_V: Final = 5.0  # 0 to 5 V


def statements() -> Iterator[Statement]:
    """All of them."""
    yield _sign_of_the_example()
    yield _duration()
    yield _sensitivity()
    yield _range()
    yield _handedness()
    yield _units()
    yield _useful_readings()
    yield _dip()


def _say(about: str, says: str, finds: str, holds: bool) -> Statement:
    return Statement("renk", about, says, finds, holds)


def _about(axis: int, angle_deg: float) -> Array:
    """(3, 3) right-handed rotation about a coordinate axis."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[i, i], turn[i, j], turn[j, i], turn[j, j] = c, -s, s, c
    return turn


def _sign_of_the_example() -> Statement:
    """Gravity and an axis, before and after 180 deg about k and 90 deg about i; (10) is g . P."""
    turn = _about(0, 90.0) @ _about(2, 180.0)
    says, gives = [], []
    for axis, stated in ((2, (1, 0)), (0, (1, -1))):
        gravity, along = -np.eye(3)[axis], np.eye(3)[axis]
        says += list(stated)
        gives += [round(float(gravity @ along)), round(float(gravity @ turn @ along))]
    written = [", ".join(f"{value:+d}" if value else "0" for value in values) for values in (says, gives)]
    return _say(
        "the kinematic model's example",
        f"with gravity along -k, then -i, an axis that points the other way reads {written[0]} g before and after the"
        " turns",
        f"(10), the product of g and the axis, gives {written[1]} g: the example has the sign of a common"
        " accelerometer, a - g, the equations that of g - a",
        says == gives,
    )


def _duration() -> Statement:
    stated = Printed.of(renk()["duration_min"])
    minutes = renk()["all_samples"] / renk()["rate_Hz"] / 60.0
    return _say(
        "the maneuver",
        f"takes {stated.text} min",
        f"{renk()['all_samples']:,} samples at {renk()['rate_Hz']} Hz are {minutes:.2f} min",
        stated.rounds_from(minutes),
    )


def _sensitivity() -> Statement:
    nominal = _OUTPUT_V / (2.0 * renk()["range_g"])
    found = parameter_table("5").values("sensitivity") * _G
    above = found / nominal - 1.0
    return _say(
        "accelerometer, range",
        f"±{renk()['range_g']} g on 0-5 V, which is {nominal:g} V/g",
        f"Table 5 has {', '.join(f'{value:.3f}' for value in found)} V/g,"
        f" {', '.join(f'{value:.1%}' for value in above)} above it",
        bool((np.abs(above) < 0.05).all()),
    )


def _range() -> Statement:
    table = parameter_table("5")
    sensitivity, offset = table.values("sensitivity") * _G, table.values("offset")
    low, high = -offset / sensitivity, (_OUTPUT_V - offset) / sensitivity
    reach = ", ".join(f"{a:.2f} to {b:+.2f}" for a, b in zip(low, high, strict=True))
    worst = int(low.argmax())
    return _say(
        "accelerometer, range",
        f"each accelerometer measures ±{renk()['range_g']} g",
        f"with the sensitivities and offsets of Table 5 an output of 0-5 V reaches {reach} g: accelerometer"
        f" {worst + 1} is at 0 V at {low[worst]:.2f} g",
        bool((low <= -renk()["range_g"]).all() and (high >= renk()["range_g"]).all()),
    )


def _handedness() -> Statement:
    hands = {number: float(np.linalg.det(parameter_table(number).axes)) for number in ("5", "10")}
    words = {number: "right" if hand > 0.0 else "left" for number, hand in hands.items()}
    return _say(
        "Tables 5 and 10",
        "axes 1, 2, 3 of both sensors are those of one package",
        f"the accelerometers are {words['5']}-handed (determinant {hands['5']:+.3f}), the magnetometers"
        f" {words['10']}-handed ({hands['10']:+.3f}); with the sign of the paper's example the accelerometers' axes"
        " point the other way, and both are of one hand",
        hands["5"] * hands["10"] > 0.0,
    )


def _units() -> Statement:
    table = spread_table("12")
    wrong = {name: unit for name, unit in table.printed_units.items() if unit != unit_of(name, table.sensor)}
    return _say(
        "Table 12",
        f"{' and '.join(name.removesuffix('_deg') for name in wrong)} are in {' and '.join(set(wrong.values()))}",
        "they are angles in degrees, as those of the other magnetometers",
        not wrong,
    )


def _useful_readings() -> Statement:
    """Separate fits to the half of the sweep whose readings are nearest 90 deg, and to the other half."""
    settings = Settings.of(scenario_of(ACCELEROMETER), 2)
    rotations = expected(settings).rotations
    many = drawn(ACCELEROMETER)
    coordinates = Coordinates(many.truth, "separate")
    x = np.hstack([rotations, np.ones((len(rotations), 1))])
    turned = rotations.reshape(-1, 3, 3)
    ratios = []
    for k in range(3):
        cosine = np.abs(turned @ many.truth.axes[k] @ many.truth.fields[k])
        near = cosine <= np.median(cosine)
        stds = []
        for half in (near, ~near):
            spread = np.sqrt(coordinates.bound(x[half].T @ x[half], many.noise).diagonal())
            stds.append(dict(zip(coordinates.names, spread, strict=True)))
        names = [f"{stem.format(k + 1)}" for stem in ("sensitivity{}", "offset{}", "axis{}_beta_deg")]
        ratios.append([stds[0][name] / stds[1][name] for name in names])
    s, delta, beta = np.array(ratios).T

    def words(values: Array) -> str:
        return f"{values.min():.2f} to {values.max():.2f}"

    return _say(
        "the maneuver",
        "readings near 90° from gravity are the most useful",
        f"the half of the sweep nearest 90° leaves {words(beta)} times the standard deviation of beta that the other"
        f" half leaves, and {words(s)} times that of the sensitivity ({words(delta)} of the offset): true of the"
        " orientation, false of the sensitivity, and the offset does not care",
        bool((s < 1.0).all()),
    )


def _dip() -> Statement:
    dip = dip_argument()
    return _say(
        "magnetometer, fit error",
        "stray magnetic fields are one possible cause",
        dip_words(dip) + " The guess is supported by a number that the paper does not look at",
        dip.low > 0.0,
    )
