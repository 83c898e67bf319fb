"""The bound of a scenario, and what its maneuver can show of the catalogue's effects, as tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Final

import numpy as np
from rich.console import RenderableType, group
from rich.table import Table
from rich.text import Text

from estimators.design.isolability import SEEN, Isolability, Key
from estimators.design.maneuver_bound import Growth
from estimators.design.prediction import KnownAnglePrediction, Prediction
from rig.arrays import Array
from rig.units import per_field
from scenarios.bound import FreeGrowth, ScenarioBound, SensorBound
from scenarios.isolability import EffectsBound
from scenarios.terminal.calibration import symbol
from scenarios.terminal.tables import plus_minus, table

#: Minutes from the start whose bound is shown, and the end.
_SHOWN: Final = (1, 2, 3, 5, 10, 20, 30, 60)
#: Effects that leave each other less than this are one line.
_SAME: Final = 1.0
#: So many pairs are listed, the most alike first.
_PAIRS: Final = 12


@group()
def bound_report(bound: ScenarioBound) -> Iterable[RenderableType]:
    """What each sensor's parameters will be uncertain by, what stays open and why, and what the minutes pay."""
    for name, sensor in bound.sensors.items():
        yield from (*_sensor(name, sensor), Text(""), _minutes(sensor.growth, bound.time_s / 60.0), Text(""))
    for line in bound.given:
        yield Text(f"taken as given: {line}")
    if bound.left_out:
        yield Text(f"left out of the bound: {', '.join(bound.left_out)}", style="yellow")


def _sensor(name: str, bound: SensorBound) -> Iterable[RenderableType]:
    found = bound.prediction
    noise = ", ".join(f"{1e3 * value:.3g}" for value in found.noise)
    kind = "without attitude, symmetric gain" if found.method == "ellipsoid" else found.method
    title = Text(f"{name}  ", style="bold")
    yield title.append(f"{kind}, {found.samples:,} samples, noise {noise} mV", style="not bold")
    if isinstance(found, KnownAnglePrediction):
        yield _axes(found, bound.field_unit)
        yield from map(Text, _lines(found))
    else:
        yield _gain(found, bound.field_unit)
    yield Text(f"condition       {found.condition:.3g}")
    for parameter, why in found.untold.items():
        yield Text(f"cannot be told: {symbol(parameter)}: {why}", style="yellow")
    if found.problem is not None:
        yield Text(f"a calibration would be refused: {found.problem}", style="bold yellow")


def _axes(found: KnownAnglePrediction, field_unit: str) -> Table:
    rows = dict(zip(found.names, zip(found.values, found.std, strict=True), strict=True))
    columns = (f"S [{per_field('V', field_unit)}]", "δ [V]", "β [deg]", "γ [deg]", "axis, RMS angle [deg]")
    stems = ("sensitivity{}", "offset{}", "beta{}_deg", "gamma{}_deg")
    cells = (
        (str(k), *(plus_minus(*rows[stem.format(k)]) for stem in stems), _number(found.axis_std_deg[k - 1]))
        for k in (1, 2, 3)
    )
    return table("axis", *columns, numbers=columns, rows=cells)


def _gain(found: Prediction, field_unit: str) -> Table:
    rows = (
        (name, plus_minus(value, std), "V" if name.startswith("offset") else per_field("V", field_unit))
        for name, value, std in zip(found.names, found.values, found.std, strict=True)
    )
    return table("parameter", "value", "unit", numbers=("value",), rows=rows)


def _lines(found: KnownAnglePrediction) -> Iterable[str]:
    rows = dict(zip(found.names, zip(found.values, found.std, strict=True), strict=True))
    for index, spread in enumerate(found.field_std_deg):
        own = "" if len(found.field_std_deg) == 1 else str(index + 1)
        angles = ", ".join(f"{symbol(stem)} {plus_minus(*rows[f'{stem}{own}_deg'])}" for stem in ("phi", "psi"))
        yield f"{f'field{own}':<16}{angles} deg; RMS angle {_number(spread)} deg"
    pairs = ", ".join(f"{pair} ± {_number(std)}" for pair, std in found.angles_between_std_deg.items())
    yield f"angles of axes  {pairs} deg"


def _minutes(grown: Growth | FreeGrowth, minutes: Array) -> Table:
    """The worst of the axes after some of the intervals, and the share of what is learned in the end."""
    if isinstance(grown, Growth):
        columns = ["S [%]", "δ [mV]", "axis [deg]", "field [deg]"]
        series = [100.0 * grown.sensitivity, 1e3 * grown.offset, grown.axis_deg, grown.field_deg]
    else:
        columns = ["gain [% of the largest]", "offset [mV]"]
        series = [100.0 * grown.gain, 1e3 * grown.offset]
    columns = ["after [min]", *columns, "learned [%]"]
    series.append(100.0 * np.cumsum(grown.share)[:, None])
    shown = [int(np.argmin(np.abs(minutes - wanted))) for wanted in _SHOWN if wanted < minutes[-1]]
    rows = (
        (f"{minutes[row]:.3g}", *(_number(float(values[row].max())) for values in series))
        for row in sorted({*shown, len(minutes) - 1})
    )
    return table(*columns, numbers=columns, rows=rows)


def _number(value: float) -> str:
    return f"{value:.3g}" if np.isfinite(value) else "–"


def classes(found: Isolability) -> list[list[int]]:
    """Seen effects in groups of which each leaves the first less than one standard deviation, the best seen first."""
    order = [int(place) for place in np.argsort(-found.seen) if found.visible[place]]
    groups: list[list[int]] = []
    for place in order:
        own = next((group for group in groups if found.pairs[group[0], place] < _SAME), None)
        if own is None:
            groups.append([place])
        else:
            own.append(place)
    return groups


@group()
def isolability_report(found: EffectsBound) -> Iterable[RenderableType]:
    """Effects that are seen, by classes that cannot be told apart, and what changes if every joint moves."""
    here = found.here
    called = partial(names, own=found.names)
    groups = classes(here)
    yield Text(f"Of {len(here.effects)} effects of typical size {here.visible.sum()} are seen ({SEEN:g} σ or more)\n")
    rows: list[tuple[str | Text, ...]] = []
    for alike in groups:
        others = np.where(here.visible, here.apart[alike[0]], np.inf)
        others[alike] = np.inf
        nearest = int(np.argmin(others))
        told = bool(np.isfinite(others[nearest]))
        rows.append(
            (
                called([here.effects[place] for place in alike]),
                f"{here.seen[alike[0]]:.3g}",
                called([here.effects[nearest]]) if told else "–",
                Text(f"{others[nearest]:.3g}", style="" if others[nearest] >= SEEN else "yellow") if told else "–",
            )
        )
    yield table("effect", "seen [σ]", "best explained by", "left [σ]", numbers=("seen [σ]", "left [σ]"), rows=rows)
    hidden = [key for key, visible in zip(here.effects, here.visible, strict=True) if not visible]
    yield Text(f"\nEffects in one line cannot be told apart. Not seen: {called(hidden) or 'none'}.")
    for name, why in here.left_out.items():
        yield Text(f"Left out: {name.replace('_', ' ')}: {why}.")
    yield Text(f"{len(here.alike)} pairs of seen effects are not told apart ({SEEN:g} σ).")
    if found.moving is None:
        return
    locked = ", ".join(found.names.get(f"joint{number}", str(number)) for number in found.locked)
    yield Text(
        f"\nIf joints {locked} moved too (stops at random poses of all joints, in the same time):"
        f" {found.moving.visible.sum()} effects would be seen, {len(found.moving.alike)} pairs not told apart.",
        style="bold",
    )
    yield Text(f"Newly seen: {called(found.gained) or 'none'}.")
    parted = found.parted
    lines = [f"{called([one])} from {called([other])} ({sigmas:.3g} σ)" for one, other, sigmas in parted[:_PAIRS]]
    more = f"; and {len(parted) - _PAIRS} more" if len(parted) > _PAIRS else ""
    yield Text(f"Newly told apart: {'; '.join(lines) or 'none'}{more}.")


def names(keys: Sequence[Key], own: Mapping[str, str]) -> str:
    """Effects with their places, joints by the arm's ``own`` names: ``joint offset joint2, wrist_2; base rocking``."""
    places: dict[str, list[str]] = {}
    for effect, where in keys:
        places.setdefault(effect, []).append(own.get(where, where))
    return "; ".join(
        effect.replace("_", " ") + ("" if where in (["base"], ["supply"], ["mount"]) else f" {', '.join(where)}")
        for effect, where in places.items()
    )
