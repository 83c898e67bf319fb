"""Defects of single readings, which no mean and no spectrum shows: spikes, repeats, a clipped range, a coarse
converter.

Each is told from the readings themselves. What is found is left out of everything that follows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.special import log_ndtr, ndtr, ndtri
from scipy.stats import binom

from estimators.gap.bench import Bench
from rig.channels import CHANNELS
from rig.effects import Effect
from rig.pipeline import Pipeline

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Largest p-value at which a defect counts, over all readings and channels.
SIGNIFICANT = 1e-5
#: A spike's neighbours: so many readings on either side.
_NEIGHBOURS = 3
#: A level is clipped at when it holds this many readings and this many times its neighbourhood's density.
_PILED, _DENSER = 4, 4.0
#: A converter's rounding that adds less than this share of the floor's variance is not felt.
_FELT = 0.005
#: So many outliers in a channel make others likely; then those count that noise makes once in five recordings.
_SEVERAL, _LESS = 3, 4.5


@dataclass(frozen=True)
class Defect:
    """One kind of defect.

    Attributes:
        effect, where: its name and place in the catalogue.
        parameters: by name: value, standard deviation (None where there is none), unit.
        affected: (n, 6) the readings to leave out; none for a coarse converter.
        log_p: logarithm of the p-value.
        gap: (6,) root mean square of what it adds to the readings [recorded unit].
    """

    effect: str
    where: str
    parameters: Mapping[str, tuple[Any, Any, str]]
    affected: Mask
    log_p: float
    gap: Array


def find_defects(bench: Bench, locked_step: Array) -> list[Defect]:
    """All defects of a recording.

    Args:
        bench: base fit.
        locked_step: (6,) the converter's step that the locked recording shows; it belongs to the floor.
    """
    found = [repeats(bench), *(clipping(bench, column) for column in bench.columns), coarse(bench, locked_step)]
    defects = [defect for defect in found if defect is not None]
    left = bench
    for defect in defects:
        left = left.without(defect.affected)
    spikes = outliers(left)
    return defects if spikes is None else [*defects, spikes]


def repeats(bench: Bench) -> Defect | None:
    """Rows that repeat the row before in every channel, more often than readings do by chance."""
    readings = bench.readings[:, bench.columns]
    count = len(readings)
    same = (readings[1:] == readings[:-1]).all(axis=1)
    alike = [np.count_nonzero(column[2:] == column[:-2]) for column in readings.T]
    chance = float(np.prod([(each + 1.0) / count for each in alike]))
    log_p = float(binom.logsf(same.sum() - 1, count, chance))
    if not same.any() or log_p > np.log(SIGNIFICANT):
        return None
    rows = np.concatenate([[False], same])
    share = float(rows.mean())
    differences = np.diff(bench.base.volts + 0.0, axis=0, prepend=bench.base.volts[:1])
    variance = np.array([2.0 * bench.whiteners[column].sigma ** 2 for column in range(len(CHANNELS))])
    gap = np.sqrt(share * (np.mean(differences**2, axis=0) + variance))
    deviation = np.sqrt(share * (1.0 - share) / count)
    affected = np.repeat(rows[:, None], len(CHANNELS), axis=1)
    parameters = {"share": (share, float(deviation), "relative")}
    return Defect("dropouts", "acquisition", parameters, affected, log_p, gap)


def clipping(bench: Bench, column: int) -> Defect | None:
    """A level at which one channel's readings pile up and beyond which there are none though some were expected."""
    values = bench.readings[:, column]
    sigma = bench.whiteners[column].sigma
    for sign in (1.0, -1.0):
        level = float((sign * values).max())
        piled = sign * values >= level - 1e-9 * max(1.0, abs(level))
        step = _step(values)
        below = sign * values > level - max(1.5 * step, 1e-3 * sigma)
        expected = float((below & ~piled).sum())  # on a lattice the next level, else a thousandth of the noise
        log_p = float(binom.logsf(piled.sum() - 1, len(values), max(expected, 1.0) / len(values)))
        above = ndtr((sign * bench.base.volts[:, column] - level - 0.5 * step) / sigma)
        log_p = max(log_p, -float(above.sum()))  # a signal that turns at a lattice's top level reaches none above it
        many = piled.sum() >= _PILED and piled.sum() >= _DENSER * max(expected, 0.5)
        if not many or log_p > np.log(SIGNIFICANT):
            continue
        affected = np.zeros_like(bench.readings, dtype=bool)
        affected[:, column] = sign * bench.base.volts[:, column] > level - 3.0 * sigma
        beyond = (sign * bench.base.volts[:, column] - level) / sigma
        lost = (beyond**2 + 1.0) * ndtr(beyond) + beyond * np.exp(-0.5 * beyond**2) / np.sqrt(2.0 * np.pi)
        gap = np.zeros(len(CHANNELS))
        gap[column] = sigma * np.sqrt(lost.mean())
        parameters = {"level": (sign * level, sigma / piled.sum(), "V")}
        return Defect("saturation", CHANNELS[column], parameters, affected | _piled(bench, column, piled), log_p, gap)
    return None


def _piled(bench: Bench, column: int, piled: Mask) -> Mask:
    affected = np.zeros_like(bench.readings, dtype=bool)
    affected[:, column] = piled
    return affected


def coarse(bench: Bench, locked_step: Array) -> Defect | None:
    """Readings on a coarser lattice than the locked recording's."""
    known = np.where(np.isfinite(locked_step[bench.columns]), locked_step[bench.columns], 0.0)
    grids = zip(bench.columns, known, strict=True)
    steps = np.array([_step(bench.readings[:, column], grid) for column, grid in grids])
    sigma = np.array([bench.whiteners[column].sigma for column in bench.columns])
    if not (steps > 1.5 * known).all() or steps.min() <= 0.0 or (steps**2 / 12.0 < _FELT * sigma**2).all():
        return None
    lsb = float(np.median(steps))
    gap = np.zeros(len(CHANNELS))
    gap[bench.columns] = np.sqrt(np.maximum(steps**2 - known**2, 0.0) / 12.0)
    parameters = {"lsb_V": (lsb, lsb * 1e-6, "V")}
    nothing = np.zeros_like(bench.readings, dtype=bool)
    return Defect("adc_quantisation", "acquisition", parameters, nothing, -np.inf, gap)


def _step(values: Array, grid: float = 0.0) -> float:
    """The step of the lattice that values lie on, to within a finer grid's rounding; zero where they lie on none."""
    levels = np.unique(values)
    if len(levels) > 0.7 * len(values) or len(levels) < 3:
        return 0.0
    differences = np.diff(levels)
    smallest = float(np.mean(differences[differences < 1.5 * differences.min()]))
    numbers = np.concatenate([[0.0], np.cumsum(np.round(differences / smallest))])
    slope, start = np.polyfit(numbers, levels, 1)
    off = float(np.abs(levels - start - slope * numbers).max())
    return float(slope) if off < 0.05 * slope + 0.75 * grid else 0.0


def lattice(readings: Array) -> Array:
    """(6,) the converter's step of each channel; zero where none shows, NaN where the channel is not there."""
    return np.array([_step(values) if np.isfinite(values[0]) else np.nan for values in readings.T])


def outliers(bench: Bench) -> Defect | None:
    """Readings that stand out from their neighbours by more than the noise can make them."""
    affected = np.zeros_like(bench.readings, dtype=bool)
    size = np.zeros(len(CHANNELS))
    log_p = 0.0
    limit = float(-ndtri(SIGNIFICANT / bench.size))
    for column in bench.columns:
        weights = bench.weights[:, column]
        residual = bench.whiteners[column](bench.residual[:, column]) * weights
        local = residual - median_filter(residual, 2 * _NEIGHBOURS + 1, mode="nearest")
        spread = float(np.sqrt(np.mean(np.clip(local, -4.0, 4.0) ** 2)))
        hit = np.abs(local) > max(limit * spread, 6.5)
        if np.count_nonzero(hit) >= _SEVERAL:  # there are spikes: those that stand out less belong to them
            hit = np.abs(local) > _LESS * spread
        affected[:, column] = hit
        if hit.any():
            size[column] = np.sqrt(np.sum((local[hit] / weights[hit]) ** 2)) * bench.whiteners[column].sigma
            log_p += float(np.sum(log_ndtr(-np.abs(local[hit]) / spread)) + np.log(bench.size))
    if not affected.any() or log_p > np.log(SIGNIFICANT):
        return None
    count = int(affected.sum())
    share = count / bench.size
    parameters = {"share": (share, float(np.sqrt(count)) / bench.size, "relative")}
    return Defect("outliers", "acquisition", parameters, affected, log_p, size / np.sqrt(len(bench.base)))


def explained_away(
    bench: Bench, defects: Sequence[Defect], pipeline: Pipeline, effects: Sequence[Effect], raised: Array | None = None
) -> list[Defect]:
    """The defects that are left once causes are known: a motion's peaks look like spikes until it is, as does jitter.

    Args:
        bench: of single samples, nothing left out. defects: those found before.
        pipeline, effects: the calibration with the causes in place, and these.
        raised: (n, 6) factor by which named noise exceeds the floor in time; None: there is none.
    """
    known = bool(effects) or raised is not None
    if not known or not any(defect.effect == "outliers" for defect in defects):
        return list(defects)
    others = [defect for defect in defects if defect.effect != "outliers"]
    base = pipeline.expected(bench.base, np.random.default_rng(0))
    volts = replace(pipeline, effects=tuple(effects)).carried(base, np.random.default_rng(0)).volts
    left = replace(masked(bench, others), readings=bench.readings - volts + bench.base.volts)
    again = outliers(left if raised is None else replace(left, weights=left.weights / raised))
    return others if again is None else [*others, again]


def masked(bench: Bench, defects: Sequence[Defect]) -> Bench:
    """The bench with the affected readings left out."""
    for defect in defects:
        bench = bench.without(defect.affected)
        if defect.effect == "adc_quantisation":  # its rounding error is white noise of variance step^2 / 12
            sigma = np.array([whitener.sigma for whitener in bench.whiteners])
            bench = replace(bench, weights=bench.weights * sigma / np.hypot(sigma, defect.gap))
    return bench
