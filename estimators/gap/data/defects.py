"""Defects of single readings, which no mean and no spectrum shows: spikes, repeats, a clipped range, a coarse
converter.

Each is told from the readings themselves, by the class that simulates it. What is found is left out of everything that
follows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from scipy.ndimage import median_filter
from scipy.special import ndtri

from estimators.gap.data.whitened import WhitenedData
from estimators.gap.floor.channel_noise import sigmas
from rig.arrays import Array, Mask
from rig.channels import CHANNELS
from rig.effects import EFFECTS, Effect, Finding, Kind, Readings
from rig.effects.converter import lattice_step
from rig.effects.tails import beside_neighbours, drawn_in, tails_of
from rig.pipeline import Pipeline

#: Found last, in the readings that the others have left.
_LAST: Final = "outliers"
#: So many readings on either side tell how far readings differ there.
_NEARBY: Final = 25


@dataclass(frozen=True)
class Defect:
    """One kind of defect.

    Attributes:
        effect, where: its name and place in the catalogue.
        parameters: by name: value, standard deviation (None where there is none), unit.
        affected: (n, 6) the readings to leave out; none for a coarse converter.
        log_p: logarithm of the p-value.
        gap: (6,) root mean square of what it adds to the readings [recorded unit].
        anywhere: whether each reading may be affected alike, not those of some levels alone.
    """

    effect: str
    where: str
    parameters: Mapping[str, tuple[Any, Any, str]]
    affected: Mask
    log_p: float
    gap: Array
    anywhere: bool = True


def find_defects(data: WhitenedData, locked_step: Array) -> list[Defect]:
    """All defects of a recording.

    Args:
        data: base fit.
        locked_step: (6,) the converter's step that the locked recording shows; it belongs to the floor.
    """
    defects, left = list[Defect](), data
    for name in (name for name, effect in EFFECTS.items() if effect.kind is Kind.DISTRIBUTION and name != _LAST):
        found = _examined(name, left, locked_step)  # what a level clips repeats it, and is not missed
        for defect in found:
            left = left.without(defect.affected)
        defects += found
    return [*defects, *_spikes(left, locked_step)]


def _spikes(data: WhitenedData, step: Array) -> list[Defect]:
    """Readings that stand out from those around them: a model that is off for longer makes none."""
    return _examined(_LAST, replace(data, readings=data.readings - _slow(data)), step)


def _examined(name: str, data: WhitenedData, step: Array) -> list[Defect]:
    effect = EFFECTS[name]
    readings = readings_of(data, step)
    places = [where for where in effect.places if where not in CHANNELS or CHANNELS.index(where) in data.columns]
    found = [effect.examined(readings, where) for where in places]
    return [_defect(each) for each in found if each is not None]


def readings_of(data: WhitenedData, step: Array) -> Readings:
    """The readings beside the base fit."""
    white = np.zeros_like(data.readings)
    for column in data.columns:
        own = data.whiteners[column](data.residual[:, column]) * data.weights[:, column]
        white[:, column] = data.gaps[column].filled(own)
    sigma = sigmas(data.whiteners)
    degrees = tuple(channel.degrees for channel in data.floor)
    return Readings(data.readings, data.modelled, sigma, white, data.weights == 0.0, step, degrees)


def _defect(finding: Finding) -> Defect:
    effect = finding.effect
    parameters = {
        item.name: (getattr(effect, item.name), finding.std[item.name], item.unit)
        for item in effect.parameters()
        if item.name in finding.std
    }
    return Defect(
        effect.name, effect.where, parameters, finding.affected, finding.log_p, finding.added, finding.anywhere
    )


def lattice(readings: Array) -> Array:
    """(6,) the converter's step of each channel; zero where none shows, NaN where the channel is not there."""
    return np.array([lattice_step(values) if np.isfinite(values[0]) else np.nan for values in readings.T])


def explained_away(
    data: WhitenedData,
    defects: Sequence[Defect],
    pipeline: Pipeline,
    effects: Sequence[Effect],
    raised: Array | None = None,
    other: bool = False,
    unsure: Sequence[Sequence[Effect]] = (),
) -> list[Defect]:
    """The defects that are left once causes are known: a motion's peaks look like spikes until it is, as does jitter.

    Args:
        data: of single samples, nothing left out. defects: those found before.
        pipeline, effects: the calibration with the causes in place, and these.
        raised: (n, 6) factor by which named noise exceeds the floor in time; None: there is none.
        other: whether something without a name is left: then the floor is no measure, but what is around a reading.
        unsure: the effects as they may be as well: readings that these change, at an instant, are no spikes beside it.
    """
    known = bool(effects) or raised is not None or other
    if not known or not any(defect.effect == _LAST for defect in defects):
        return list(defects)
    others = [defect for defect in defects if defect.effect != _LAST]
    base = pipeline.expected(data.base, np.random.default_rng(0))

    def with_causes(causes: Sequence[Effect]) -> Array:
        return replace(pipeline, effects=(*data.given, *causes)).carried(base, np.random.default_rng(0)).volts

    volts = with_causes(effects)
    left = replace(masked(data, others), readings=data.readings - volts + data.modelled)
    judged = left if raised is None else replace(left, weights=left.weights / raised)
    if other:
        judged = replace(judged, weights=judged.weights / _around(readings_of(judged, np.zeros(6))))
    sigma = sigmas(data.whiteners)
    for each in unsure:
        judged = judged.without(np.abs(with_causes(each) - volts) > sigma)
    return [*others, *_spikes(judged, np.zeros(left.readings.shape[1]))]


def relieved(data: WhitenedData) -> WhitenedData:
    """The data with the ends of long tails drawn in, where the floor has such: what squares make of them is no gap.

    Judged beside their neighbours, so that whatever is slow stays; as the floor was (``drawn_in``).
    """
    readings = data.readings.copy()
    white = readings_of(data, np.zeros(len(CHANNELS))).white
    for column in data.columns:
        if data.floor[column].relieved:
            local = beside_neighbours(white[:, column])
            less = drawn_in(local, *tails_of(local, data.floor[column].degrees)) - local
            readings[:, column] += less * data.whiteners[column].sigma * (data.weights[:, column] > 0.0)
    return replace(data, readings=readings)


def _slow(data: WhitenedData) -> Array:
    """(n, 6) running median of what is left of the readings [recorded unit]."""
    found = np.zeros_like(data.readings)
    for column in data.columns:
        found[:, column] = median_filter(data.residual[:, column], size=2 * _NEARBY + 1, mode="reflect")
    return found


def _around(readings: Readings) -> Array:
    """(n, 6) standard deviation, at least one, by how far whitened readings differ from their neighbours nearby."""
    spread = np.ones_like(readings.white)
    for white, left_out, own in zip(readings.white.T, readings.left_out.T, spread.T, strict=True):
        if not left_out.all():
            there = white[~left_out]
            steps = np.abs(np.diff(there, prepend=there[1:2])) / np.sqrt(2.0)
            own[~left_out] = median_filter(steps, size=2 * _NEARBY + 1, mode="reflect") / float(ndtri(0.75))
    return np.maximum(spread, 1.0)


def masked(data: WhitenedData, defects: Sequence[Defect]) -> WhitenedData:
    """The data with the affected readings left out."""
    for defect in defects:
        data = data.without(defect.affected)
        if defect.effect == "adc_quantisation":  # its rounding error is white noise of variance step^2 / 12
            sigma = sigmas(data.whiteners)
            data = replace(data, weights=data.weights * sigma / np.hypot(sigma, defect.gap))
    return relieved(data)
