"""What the text of Renk et al. says about its own numbers, checked against them and against the rig."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.special import chdtrc
from scipy.stats import chi2

from estimators.known_angle.agreement import common_field
from estimators.known_angle.identifiability import Information
from estimators.known_angle.model import SensorParameters
from estimators.noise import DB_PER_BIT, FULL_SCALE_V
from rig.arm import Arm
from rig.arrays import Array
from rig.channels import SENSORS
from rig.maneuver import TorusSweep
from scenarios.studies.coordinates import RADIAN_DEG
from validation.paper.published import (
    SEPARATE,
    SIMULTANEOUS,
    SPREADS,
    Printed,
    angle_table,
    parameter_table,
    renk,
    spread_table,
)
from validation.paper.renk import printed_bounds
from validation.paper.rows import Statement
from validation.paper.simulated import drawn

LEVEL: Final = 0.95


def statements() -> tuple[Statement, ...]:
    """All of them."""
    return (
        _kinematics(),
        *_speeds(),
        *(statement for sensor in SENSORS for statement in _noise(sensor)),
        *(_within(entry) for entry in renk()["within"]),
        *(_root_sum_square(sensor) for sensor in SENSORS),
        *(_one_standard_deviation(sensor) for sensor in SENSORS),
        *(_fields_agree(sensor) for sensor in SENSORS),
    )


def _kinematics() -> Statement:
    """Table 1 with (7) and (8), against the rig's arm."""
    q = TorusSweep().trajectory().q[::2500]
    theta = np.array([q[:, 0] + 0.5 * np.pi, *np.radians([[90.0], [-180.0], [0.0]]).repeat(len(q), 1), *q[:, 4:].T])
    theta[5] += np.pi
    product = np.tile(np.eye(3), (len(q), 1, 1))
    for twist, angle in zip(np.radians([90.0, 0.0, 0.0, 90.0, -90.0, 0.0]), theta, strict=True):
        cosine, sine, zero = np.cos(angle), np.sin(angle), np.zeros(len(q))
        entries = [
            [cosine, -sine * np.cos(twist), sine * np.sin(twist)],
            [sine, cosine * np.cos(twist), -cosine * np.sin(twist)],
            [zero, zero + np.sin(twist), zero + np.cos(twist)],
        ]
        product = product @ np.array(entries).transpose(2, 0, 1)
    error = float(np.abs(product.reshape(-1, 9) - Arm.a465().rotation_map.rotations(q)).max())
    return Statement(
        "renk",
        "Table 1, (7), (8)",
        "its Denavit-Hartenberg angles give the tool's orientation",
        f"the same as the rig's arm, to {'1e-12' if error < 1e-12 else f'{error:.1g}'}, over the whole sweep",
        error < 1e-12,
    )


def _speeds() -> Iterator[Statement]:
    document = renk()
    seconds = 60.0 * float(document["duration_min"])
    for joint in ("yaw", "pitch"):
        motion = document[joint]
        stated = Printed.of(motion["speed_deg_s"])
        speed = motion["range_deg"] * motion["passes"] / seconds
        holds = stated.rounds_from(speed)
        finds = f"{motion['range_deg']}° {motion['passes']} times in {seconds:.0f} s are {speed:.2f}°/s"
        if not holds:
            more = motion["passes"] + 1
            finds += f"; {more} times would be {motion['range_deg'] * more / seconds:.3f}°/s"
        yield Statement("renk", "the maneuver", f"{joint} turns at {stated.text}°/s on average", finds, holds)


def _noise(sensor: str) -> Iterator[Statement]:
    numbers = renk()[sensor]
    levels = np.array([float(text) for text in numbers["noise"]])
    ranges = 20.0 * np.log10(FULL_SCALE_V / levels)
    for name, values in (("dynamic_range_dB", ranges), ("bits", ranges / DB_PER_BIT)):
        stated = [Printed.of(text) for text in numbers[name]]
        # The noise is rounded too: to 0.05 mV, which is 0.05 / 6.8 of it at most.
        slack = float(20.0 * np.log10(1.0 + 5e-5 / levels.min())) / (DB_PER_BIT if name == "bits" else 1.0)
        what = "bits" if name == "bits" else "dB"
        yield Statement(
            "renk",
            f"{sensor}, noise",
            f"dynamic range {', '.join(one.text for one in stated)} {what}",
            f"20 log10(5 V / RMS){' / 6.02' if what == 'bits' else ''}:"
            f" {', '.join(f'{value:.2f}' if what == 'bits' else f'{value:.1f}' for value in values)}",
            all(one.rounds_from(value, slack) for one, value in zip(stated, values, strict=True)),
        )


def _within(entry: Mapping[str, Any]) -> Statement:
    """Differences that are said to be within a limit."""
    limit = Printed.of(entry["limit"])
    left, left_slack = _numbers(entry["left"])
    right, right_slack = np.array([entry.get("constant", np.nan)]), 0.0
    if "right" in entry:
        right, right_slack = _numbers(entry["right"])
        differences = np.abs(left - right)
    elif "constant" in entry:
        differences = np.abs(left - right)
    else:
        differences = np.abs(left[:, None] - left[None])
        right_slack = left_slack
    largest = float(differences.max())
    slack = left_slack + right_slack
    holds = largest <= limit.value + limit.half_unit + slack
    decimals = max(len(limit.text.partition(".")[2]), 2)
    finds = f"up to {largest:.{decimals}f}"
    if not holds and "right" in entry:
        worst = int(differences.argmax())
        towards = right[worst] + np.copysign(limit.value, left[worst] - right[worst])
        finds += (
            f": {right[worst]:.{decimals}f} and {limit.text} make {towards:.{decimals}f}, which is"
            f" {abs(left[worst] - towards):.{decimals}f} off the printed {left[worst]:.{decimals}f}"
        )
    return Statement("renk", entry["what"], f"within {limit.text}", finds, bool(holds))


def _numbers(place: Mapping[str, str]) -> tuple[Array, float]:
    """The numbers of a column, or of a table of angles, and the largest rounding among them."""
    if "column" in place:
        column = parameter_table(place["table"]).column(place["column"])
    else:
        column = tuple(angle_table(place["table"]).angles.values())
    return np.array([one.value for one in column]), max(one.half_unit for one in column)


def _root_sum_square(sensor: str) -> Statement:
    """The simultaneous fit's error against those of the separate ones."""
    numbers = renk()[sensor]
    separate = [Printed.of(text) for text in numbers["separate_error"]]
    together = Printed.of(numbers["simultaneous_error"])
    value = float(np.sqrt(sum(one.value**2 for one in separate)))
    slack = sum(one.value * one.half_unit for one in separate) / value
    same = together.rounds_from(value, slack)
    return Statement(
        "renk",
        f"{sensor}, fit error",
        f"{together.text} V is less than the sum of {', '.join(one.text for one in separate)} V, so the simultaneous"
        " estimates may be better",
        f"the root sum of squares of the separate errors is {value:.4f} V, {'the same' if same else 'another'}",
        not same,
    )


def _one_standard_deviation(sensor: str) -> Statement:
    """One subset's estimates against the means of 25."""
    table, spread = parameter_table(SIMULTANEOUS[sensor]), spread_table(SPREADS[sensor])
    beyond: list[str] = []
    for name, mean in spread.mean.items():
        std, bound = spread.std[name].value, printed_bounds(sensor)[name]
        if not np.isfinite(bound):  # gravity's psi, which means nothing
            continue
        column = name.removesuffix("_deg").rstrip("123")
        printed = table.column(column)[int(name.removesuffix("_deg")[-1]) - 1 if column not in ("phi", "psi") else 0]
        slack = printed.half_unit + mean.half_unit
        difference = abs(printed.value - mean.value)
        if difference - slack <= std:
            continue
        text = f"{column}{name.removesuffix('_deg')[len(column) :]} {difference / std:.1f}"
        if column in ("phi", "psi") and std < 0.1 * bound:
            text += f" (in radians {difference / (RADIAN_DEG * std):.1f})"
        beyond.append(text)
    return Statement(
        "renk",
        f"Tables {table.number} and {spread.number}",
        "every estimate of one subset is within one standard deviation of the mean of 25",
        f"beyond one: {', '.join(beyond)} standard deviations" if beyond else "so it is",
        not beyond,
    )


@dataclass(frozen=True)
class PublishedMisfit:
    """A channel's fit error, taken apart with the published scatter of 25 subsets.

    Attributes:
        sensor, channel: which; 0, 1, 2.
        noise, fit_error: as published [V].
        scatter: RMS over the channel's four parameters of standard deviation over bound.
        noise_like, noise_low, noise_high: the noise that would make such a scatter, with its interval [V].
        systematic: the rest of the fit error, root of the difference of squares [V].
    """

    sensor: str
    channel: int
    noise: float
    fit_error: float
    scatter: float
    noise_like: float
    noise_low: float
    noise_high: float
    systematic: float

    @property
    def share(self) -> float:
        """Of the fit error's square that is noise-like."""
        return min((self.noise_like / self.fit_error) ** 2, 1.0)


def misfits(sensor: str) -> tuple[PublishedMisfit, ...]:
    """How much of the published fit errors is noise-like, channel by channel."""
    numbers, spread, bounds = renk()[sensor], spread_table(SPREADS[sensor]), printed_bounds(sensor)
    many = drawn(sensor)
    covariance = Information.of(many.gram, many.truth, many.noise).covariance
    found = []
    for k in range(3):
        names = [f"sensitivity{k + 1}", f"offset{k + 1}", f"beta{k + 1}_deg", f"gamma{k + 1}_deg"]
        square = np.array([(spread.std[name].value / bounds[name]) ** 2 for name in names])
        block = covariance[4 * k : 4 * k + 4, 4 * k : 4 * k + 4]
        root = np.sqrt(block.diagonal())
        correlation = block / np.outer(root, root)
        # Four variances of 24 degrees of freedom each, less what their correlation takes (Satterthwaite).
        freedom = (renk()["subsets"] - 1) * 16.0 / np.square(correlation).sum()
        mean = float(square.mean())
        low, high = np.sqrt(freedom * mean / chi2.isf([0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL)], freedom))
        noise, error = float(numbers["noise"][k]), float(numbers["separate_error"][k])
        level = noise * float(np.sqrt(mean))
        found.append(
            PublishedMisfit(
                sensor,
                k,
                noise,
                error,
                float(np.sqrt(mean)),
                level,
                noise * float(low),
                noise * float(high),
                float(np.sqrt(max(error**2 - level**2, 0.0))),
            )
        )
    return tuple(found)


def _fields_agree(sensor: str) -> Statement:
    """The paper's own check, as a chi-square test: at the stated noise, and at what the subsets' scatter shows."""
    at_noise = field_chi_square(sensor, [float(text) for text in renk()[sensor]["noise"]])
    at_scatter = field_chi_square(sensor, [row.noise_like for row in misfits(sensor)])
    table = parameter_table(SEPARATE[sensor])
    apart = max(float(np.linalg.norm(table.fields[i] - table.fields[j])) for i, j in ((0, 1), (0, 2), (1, 2)))
    p_value = float(chdtrc(4, at_scatter))
    probability = f"p = {p_value:.1g}" if p_value > 1e-99 else "p < 1e-99"
    agree = p_value > 1e-3
    return Statement(
        "renk",
        f"Table {table.number}",
        "the separate fits find nearly one field direction, so the model has no fundamental problem",
        f"they lie up to {RADIAN_DEG * apart:.2f}° apart; chi-square against one direction, 4 degrees of freedom, is"
        f" {at_noise:.0f} at the stated noise and {at_scatter:.0f} ({probability}) at the noise that the 25 subsets"
        f" scatter by{'' if agree else ': the model misses something systematic, and the tables do not tell what'}",
        agree,
    )


def field_chi_square(sensor: str, noise: Sequence[float]) -> float:
    """Chi-square (4 degrees of freedom) of a published table's three fields against one direction.

    Args:
        sensor: which.
        noise: (3,) of a reading [V].
    """
    table = parameter_table(SEPARATE[sensor])
    many = drawn(sensor)
    parameters = SensorParameters(
        many.truth.reference_magnitude, table.values("sensitivity"), table.values("offset"), table.axes, table.fields
    )
    covariance = Information.of(many.gram, parameters, np.asarray(noise), "separate").covariance
    return common_field(parameters, covariance).chi_square
