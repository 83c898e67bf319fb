"""Renk et al., Tables 2 to 12, row by row beside the rig."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.stats import chi2, f

from rig.arrays import Array
from rig.directions import elevation_azimuth_basis
from scenarios.studies.coordinates import RADIAN_DEG
from validation.paper.published import (
    SEPARATE,
    SIMULTANEOUS,
    STEMS,
    ParameterTable,
    Printed,
    angle_table,
    parameter_table,
    renk,
    spread_table,
    unit_of,
)
from validation.paper.rows import SIGMAS, Row, Word
from validation.paper.simulated import Drawn, displacement_deg, drawn, noiseless, subsets

#: A ratio of standard deviations is held against chi-square at the level of ``SIGMAS``.
_TAIL: Final = 0.5 * 4.65e-4
_PAIRS: Final = {"1-2": (0, 1), "1-3": (0, 2), "2-3": (1, 2)}


def rows() -> tuple[Row, ...]:
    """Every row of Tables 2 to 12, in their order."""
    kinds: dict[str, Callable[[str], Iterator[Row]]] = {
        "2": _truth,
        "3": _separate,
        "4": _angles,
        "5": _simultaneous,
        "6": _angles,
        "7": _spread,
        "8": _separate,
        "9": _angles,
        "10": _simultaneous,
        "11": _angles,
        "12": _spread,
    }
    return tuple(row for number, kind in kinds.items() for row in kind(number))


def _truth(number: str) -> Iterator[Row]:
    """The truth of the simulated data is found from data without noise."""
    table, found = parameter_table(number), noiseless()
    for k in range(3):
        for column, printed in zip(table.columns, table.rows[k], strict=True):
            value = found[STEMS[column].format(k + 1)]
            angle = column in ("beta", "gamma")
            difference = (value - printed.value + 180.0) % 360.0 - 180.0 if angle else value - printed.value
            word: Word = "agrees" if abs(difference) < 1e-9 * max(abs(printed.value), 1.0) else "differs"
            why = "found again without noise to nine digits" if word == "agrees" else f"off by {difference:.1g}"
            place = _place(table, column, f"{k + 1}")
            rig = printed.value + difference
            yield Row(*place, printed.text, rig, np.nan, np.nan, word, "by construction", why)


def _separate(number: str) -> Iterator[Row]:
    """Separate estimates from the same data as the simultaneous ones, which are the rig's truth."""
    table = parameter_table(number)
    other = parameter_table({"3": "5", "8": "10"}[number])
    many = drawn(table.sensor)
    values = many.values("separate")
    for k in range(3):
        apart = many.between_methods(k)
        for column in ("beta", "gamma", "sensitivity", "offset"):
            printed, reference = table.column(column)[k], other.column(column)[k]
            own = values[STEMS[column].format(k + 1)]
            # On the sphere an azimuth counts by the cosine of the elevation.
            factor = np.cos(np.radians(other.values("beta")[k])) if column == "gamma" else 1.0
            rounding = np.hypot(printed.half_unit, reference.half_unit) / np.sqrt(3.0)
            difference = printed.value - reference.value
            sigmas = float(difference / np.hypot(apart[column] / factor, rounding))
            word: Word = "agrees" if abs(sigmas) <= SIGMAS else "differs"
            why = f"{abs(sigmas):.1f}σ from Table {other.number}, for two fits to the same data"
            yield Row.of_draws(_place(table, column, f"{k + 1}"), printed.text, own, sigmas, word, "tested", why)
        yield _direction(table, other, many, k)


def _direction(table: ParameterTable, other: ParameterTable, many: Drawn, k: int) -> Row:
    """The field of one channel beside that of all: phi and psi together, as psi alone means nothing near the pole."""
    published, common = table.fields[k], other.fields[k]
    along = elevation_azimuth_basis(common)
    offset = RADIAN_DEG * along @ (published - common)
    covariance = many.fields_apart(k) + np.eye(2) * (table.half_units("phi")[k] ** 2 / 3.0)
    distance = float(np.sqrt(offset @ np.linalg.solve(covariance, offset)))
    # The distance of a two-dimensional normal error is of length: its probability as that of a one-dimensional one.
    sigmas = _normal_sigmas(distance)
    apart = displacement_deg(published, common)
    word: Word = "agrees" if sigmas <= SIGMAS else "differs"
    spread = float(np.sqrt(0.5 * np.trace(many.fields_apart(k))))
    why = (
        f"its field lies {apart:.3f}° from the common one, where {spread:.3f}° is its uncertainty: {distance:.0f} times"
    )
    if word == "agrees":
        why = f"its field lies {apart:.3f}° from the common one, uncertain by {spread:.3f}°"
    text = f"{table.column('phi')[k].text}, {table.column('psi')[k].text}"
    own = many.values("separate")[f"phi{k + 1}_deg"]
    return Row.of_draws(_place(table, "phi, psi", f"{k + 1}"), text, own, sigmas, word, "tested", why)


def _normal_sigmas(distance: float) -> float:
    """How far off a one-dimensional normal error is that is as improbable as a two-dimensional distance."""
    if distance > 30.0:
        return distance
    return float(np.sqrt(chi2.isf(chi2.sf(distance**2, 2), 1)))


def _simultaneous(number: str) -> Iterator[Row]:
    """The simultaneous estimates: the rig's truth, found again on average, with the scatter of one experiment."""
    table = parameter_table(number)
    many = drawn(table.sensor)
    values = many.values("simultaneous")
    for k in range(3):
        for column in ("beta", "gamma", "sensitivity", "offset"):
            own = values[STEMS[column].format(k + 1)]
            printed = table.column(column)[k]
            yield _found_again(table, f"{k + 1}", column, printed, own)
    phi, psi = table.column("phi")[0], table.column("psi")[0]
    folded = Printed(phi.text, 180.0 - phi.value, phi.half_unit) if phi.value > 90.0 else phi
    spread = many.bound("simultaneous")["field_phi_deg"]
    if displacement_deg(table.fields[0], np.array([0.0, 0.0, -1.0])) < 2.0 * spread:
        place = _place(table, "phi", "all")
        own = values["phi_deg"]
        yield Row.of_draws(place, folded.text, own, np.nan, "is the rig's truth", "by construction", "")
        why = "gravity lies along joint 1 within its uncertainty, so psi means nothing"
        untold = Row.of_draws(
            _place(table, "psi", "all"), psi.text, values["psi_deg"], np.nan, "cannot be told", "by construction", why
        )
        yield replace(untold, rig=np.nan)
        return
    for column, printed in (("phi", phi), ("psi", psi)):
        yield _found_again(table, "all", column, printed, values[f"{column}_deg"])


def _found_again(table: ParameterTable, item: str, column: str, printed: Printed, own: Array) -> Row:
    sigmas = float((own.mean() - printed.value) / (own.std() / np.sqrt(len(own))))
    word: Word = "is the rig's truth" if abs(sigmas) <= SIGMAS else "differs"
    why = "" if word != "differs" else f"the mean of {len(own)} experiments is off by {sigmas:.1f} standard errors"
    return Row.of_draws(_place(table, column, item), printed.text, own, sigmas, word, "by construction", why)


def _angles(number: str) -> Iterator[Row]:
    """Angles between axes follow from beta and gamma, which are printed too."""
    table = angle_table(number)
    source = parameter_table(table.from_table)
    own = drawn(table.sensor).angles_between("separate" if source.method == "separate" else "simultaneous")
    for pair, printed in table.angles.items():
        value, slack = recomputed_angle(source, *_PAIRS[pair])
        word: Word = "agrees" if printed.rounds_from(value, slack) else "differs"
        why = f"beta and gamma of Table {source.number} give {value:.4f}"
        if word == "differs":
            why += f" (their rounding moves it by {slack:.1g} at most)"
            others = {SEPARATE[table.sensor], SIMULTANEOUS[table.sensor]} - {source.number}
            fits = [
                one for one in others if printed.rounds_from(*recomputed_angle(parameter_table(one), *_PAIRS[pair]))
            ]
            why += "".join(f"; it does follow from Table {one}" for one in fits)
        sigmas = float((printed.value - own[pair].mean()) / own[pair].std())
        place = ("renk", number, pair, "angle between", "deg")
        yield Row.of_draws(place, printed.text, own[pair], sigmas, word, "arithmetic", why)


def recomputed_angle(table: ParameterTable, i: int, j: int) -> tuple[float, float]:
    """The angle between two axes from their printed angles, and how far these angles' rounding can move it [deg]."""
    axes = table.axes
    angle = float(np.degrees(np.arccos(axes[i] @ axes[j])))
    slack = 0.0
    for k, towards in ((i, axes[j]), (j, axes[i])):
        along = np.abs(elevation_azimuth_basis(axes[k]) @ towards)
        turn = np.cos(np.radians(table.values("beta")[k])) * table.half_units("gamma")[k]
        slack += float(along[0] * table.half_units("beta")[k] + along[1] * turn)
    return angle, slack / np.sin(np.radians(angle))


def _spread(number: str) -> Iterator[Row]:
    """The standard deviations of 25 subsets, beside the bound and beside the rig's own 25 subsets."""
    table = spread_table(number)
    simulated = {row.parameter: row for row in subsets(table.sensor).parameters}
    bounds = printed_bounds(table.sensor)
    for name, std in table.std.items():
        quantity, item = _named(name)
        place = ("renk", number, item, quantity, unit_of(name, table.sensor))
        one = simulated[name]
        text = f"{table.mean[name].text} ± {std.text}"
        bound = bounds[name]
        if not np.isfinite(bound):
            why = f"gravity lies along joint 1; the rig's 25 subsets scatter by {one.std:.0f}° as well"
            yield Row(*place, text, np.nan, one.std, np.nan, "cannot be told", "tested", why)
            continue
        word, why = on_spread(std.value / bound, name)
        yield Row(*place, text, one.mean, one.std, np.nan, word, "tested", why)


def printed_bounds(sensor: str) -> dict[str, float]:
    """Parameter -> root of the bound of one subset, in the paper's angles; infinite for gravity's psi.

    Gravity's phi is taken as the displacement along it: the paper's runs on beyond 90 degrees.
    """
    many = drawn(sensor)
    spread = many.bound("simultaneous")
    result = {}
    for k in range(3):
        result[f"sensitivity{k + 1}"] = spread[f"sensitivity{k + 1}"]
        result[f"offset{k + 1}"] = spread[f"offset{k + 1}"]
        result[f"beta{k + 1}_deg"] = spread[f"axis{k + 1}_beta_deg"]
        cosine = float(np.hypot(*many.truth.axes[k, :2]))
        result[f"gamma{k + 1}_deg"] = spread[f"axis{k + 1}_gamma_deg"] / cosine
    cosine = float(np.hypot(*many.truth.fields[0, :2]))
    result["phi_deg"] = spread["field_phi_deg"]
    far = np.degrees(cosine) > 2.0 * spread["field_psi_deg"]
    result["psi_deg"] = spread["field_psi_deg"] / cosine if far else np.inf
    return result


def ratio_limits(count: int) -> tuple[float, float]:
    """Between which a standard deviation of so many values lies, over the true one, as ``SIGMAS`` has it."""
    freedom = count - 1
    low, high = chi2.isf([1.0 - _TAIL, _TAIL], freedom)
    return float(np.sqrt(low / freedom)), float(np.sqrt(high / freedom))


def spread_limits() -> tuple[float, float]:
    """95 % of the ratios of two standard deviations over the subsets, of one distribution."""
    freedom = renk()["subsets"] - 1
    low, high = np.sqrt(f.ppf([0.025, 0.975], freedom, freedom))
    return float(low), float(high)


def on_spread(ratio: float, name: str) -> tuple[Word, str]:
    """The verdict on a standard deviation over its bound."""
    low, high = ratio_limits(renk()["subsets"])
    if low <= ratio <= high:
        return "agrees", f"{ratio:.2f} times the bound, which allows {low:.2f} to {high:.2f}"
    if name.endswith("_deg") and low <= ratio * RADIAN_DEG <= high:
        return (
            "differs",
            f"{ratio:.3f} times the bound, which no estimator reaches; read as radians {ratio * RADIAN_DEG:.2f} times:"
            " most likely a slip of the unit",
        )
    if ratio > high:
        return "differs", f"{ratio:.1f} times the bound: more than the stated noise makes"
    return "differs", f"{ratio:.3f} times the bound, which no unbiased estimator reaches"


def _named(name: str) -> tuple[str, str]:
    """Quantity and item of a parameter: sensitivity2 is the sensitivity of 2."""
    stem = name.removesuffix("_deg")
    quantity = stem.rstrip("123")
    return quantity, stem[len(quantity) :] or "all"


def _place(table: ParameterTable, column: str, item: str) -> tuple[str, str, str, str, str]:
    """Where a number stands, and its unit: what a ``Row`` begins with."""
    return "renk", table.number, item, column, unit_of(column, table.sensor)
