"""Effects of the converter on sampled, noisy readings: what they do to the readings' distribution.

Each class simulates its effect, and knows by what single readings show it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.special import log_ndtr, ndtr, ndtri, xlogy
from scipy.stats import binom

from rig.channels import CHANNELS
from rig.effects.base import Effect, Kind, Stage, register
from rig.effects.electronic import mid_scale
from rig.effects.parameters import parameter
from rig.effects.readings import Finding, Readings
from rig.signals import Signals

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: A level that no reading reaches, whatever its unit.
_OUT_OF_REACH: Final = 1e12
#: Largest p-value at which an effect on single readings counts, over all readings and channels.
SIGNIFICANT: Final = 1e-5
#: A level is clipped at when it holds this many readings and this many times its neighbourhood's density.
_PILED, _DENSER = 4, 4.0
#: A converter's rounding that adds less than this share of the floor's variance is not felt.
_FELT: Final = 0.005
#: A spike's neighbours: so many readings on either side.
_NEIGHBOURS: Final = 3
#: So many outliers in a channel make others likely; then those count that noise makes once in five recordings.
_SEVERAL, _LESS = 3, 4.5
#: From so many deviations on readings stand out a little.
_TAIL: Final = 3.0
#: Readings count as equal that differ by less than this share of the noise, where no converter is known.
_ALIKE: Final = 1e-3


@register
@dataclass(frozen=True)
class Saturation(Effect):
    """A channel is clipped at a level: V -> min(V, level); a level below the middle clips from below.

    The middle is 2.5 V where the readings lie within 0 to 5 V, else the channel's mean. The output stage of a sensor on
    5 V saturates within 0.2 V of its rails; an amplifier set too high, anywhere; a guess.
    """

    name = "saturation"
    stage = Stage.ELECTRONIC
    kind = Kind.DISTRIBUTION
    places = CHANNELS

    level: float = parameter("V", 3.8, lower=-_OUT_OF_REACH, upper=_OUT_OF_REACH, neutral=_OUT_OF_REACH)

    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        volts = signals.volts.copy()
        clip = np.minimum if self.level >= mid_scale(volts[:, self.columns]) else np.maximum
        volts[:, self.columns] = clip(volts[:, self.columns], self.level)
        return replace(signals, volts=volts)

    @classmethod
    def examined(cls, readings: Readings, where: str) -> Finding | None:
        """A level at which the readings pile up and beyond which there are none though some were expected."""
        column = CHANNELS.index(where)
        values, sigma = readings.values[:, column], float(readings.sigma[column])
        step = lattice_step(values)
        for sign in (1.0, -1.0):
            level = float((sign * values).max())
            piled = sign * values >= level - 1e-9 * max(1.0, abs(level))
            below = sign * values > level - max(1.5 * step, _ALIKE * sigma)
            expected = float((below & ~piled).sum())  # on a lattice the next level, else a thousandth of the noise
            log_p = float(binom.logsf(piled.sum() - 1, len(values), max(expected, 1.0) / len(values)))
            beyond = (sign * readings.expected[:, column] - level) / sigma
            # a signal that turns at a lattice's top level reaches none above it
            log_p = max(log_p, -float(ndtr(beyond - 0.5 * step / sigma).sum()))
            many = piled.sum() >= _PILED and piled.sum() >= _DENSER * max(expected, 0.5)
            if not many or log_p > np.log(SIGNIFICANT):
                continue
            affected = np.zeros_like(readings.values, dtype=bool)
            affected[:, column] = piled | (sign * readings.expected[:, column] > level - 3.0 * sigma)
            lost = (beyond**2 + 1.0) * ndtr(beyond) + beyond * np.exp(-0.5 * beyond**2) / np.sqrt(2.0 * np.pi)
            added = np.zeros(len(CHANNELS))
            added[column] = sigma * np.sqrt(lost.mean())
            # a clipped reading says "at least"; without clipping it would say "here", to within the readings' grain
            width = max(step, _ALIKE * sigma) / sigma
            at = beyond[piled]
            ratio = float(np.sum(log_ndtr(at) + 0.5 * at**2 + 0.5 * np.log(2.0 * np.pi) - np.log(width)))
            effect = cls(where=where, level=sign * level)
            return Finding(effect, {"level": sigma / float(piled.sum())}, affected, log_p, ratio, added, _none())
        return None


@register
@dataclass(frozen=True)
class AdcQuantisation(Effect):
    """A coarser converter than stated: every reading is rounded to a multiple of lsb_V; zero rounds nothing.

    lsb_V is in the unit of the readings. 1.22 mV is the stated step of 14 bit over +-10 V (MathWorks, adquanserq8.c);
    eight times that is a worn 11 bit.
    """

    name = "adc_quantisation"
    stage = Stage.ELECTRONIC
    kind = Kind.DISTRIBUTION
    places = ("acquisition",)

    lsb_V: float = parameter("V", 10e-3, lower=0.0, upper=_OUT_OF_REACH)

    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        if self.lsb_V == 0.0:
            return signals
        return replace(signals, volts=np.round(signals.volts / self.lsb_V) * self.lsb_V)

    @classmethod
    def examined(cls, readings: Readings, where: str) -> Finding | None:
        """All channels on a coarser lattice than the one that is known: its step is no cause."""
        columns = readings.columns
        known = np.where(np.isfinite(readings.step[columns]), readings.step[columns], 0.0)
        steps = np.array(
            [lattice_step(readings.values[:, column], grid) for column, grid in zip(columns, known, strict=True)]
        )
        sigma = readings.sigma[columns]
        if not (steps > 1.5 * known).all() or steps.min() <= 0.0 or (steps**2 / 12.0 < _FELT * sigma**2).all():
            return None
        rounding = _none()
        rounding[columns] = np.maximum(steps**2 - known**2, 0.0) / 12.0
        lsb = float(np.median(steps))
        finer = np.maximum(known, _ALIKE * sigma)  # chance of a reading to lie on the coarse lattice: finer / step
        ratio = float(np.sum(len(readings.values) * np.log(np.maximum(steps / finer, 1.0))))
        nothing = np.zeros_like(readings.values, dtype=bool)
        effect = cls(where=where, lsb_V=lsb)
        return Finding(effect, {"lsb_V": lsb * 1e-6}, nothing, -np.inf, ratio, np.sqrt(rounding), rounding)


@register
@dataclass(frozen=True)
class Outliers(Effect):
    """Rare spikes: each reading of each channel, with probability ``share``, is off by +size_V or -size_V.

    size_V is in the unit of the readings. 1e-4 to 1e-3 of the readings, by a few tenths of a volt: a loose contact, a
    bit that is misread; a guess.
    """

    name = "outliers"
    stage = Stage.ELECTRONIC
    kind = Kind.DISTRIBUTION
    places = ("acquisition",)

    share: float = parameter("relative", 3e-4, lower=0.0, upper=1.0)
    size_V: float = parameter("V", 0.5, lower=0.0, upper=_OUT_OF_REACH, strength=False)

    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        shape = signals.volts.shape
        sign = np.where(rng.random(shape) < 0.5, -1.0, 1.0)
        return replace(signals, volts=signals.volts + self.size_V * sign * (rng.random(shape) < self.share))

    @classmethod
    def examined(cls, readings: Readings, where: str) -> Finding | None:
        """Readings that stand out from their neighbours by more than the noise can make them."""
        columns = readings.columns
        total = readings.white[:, columns].size
        affected = np.zeros_like(readings.values, dtype=bool)
        sizes = np.zeros(len(CHANNELS))
        log_p, ratio, spikes = 0.0, 0.0, []
        limit = float(-ndtri(SIGNIFICANT / total))
        for column in columns:
            white = readings.white[:, column]
            local = white - median_filter(white, 2 * _NEIGHBOURS + 1, mode="nearest")
            spread = float(np.sqrt(np.mean(np.clip(local, -4.0, 4.0) ** 2)))
            hit = np.abs(local) > max(limit * spread, 6.5)
            if np.count_nonzero(hit) >= _SEVERAL:  # there are spikes: those that stand out less belong to them
                hit = np.abs(local) > _LESS * spread
            hit &= ~readings.left_out[:, column]
            if _long_tailed(local, int(hit.sum())):  # no spikes, but noise that is not normal
                hit[:] = False
            affected[:, column] = hit
            if hit.any():
                sizes[column] = np.sqrt(np.sum(local[hit] ** 2)) * readings.sigma[column]
                log_p += float(np.sum(log_ndtr(-np.abs(local[hit]) / spread)) + np.log(total))
                spikes.append(np.abs(local[hit]) * readings.sigma[column])
            ratio += _mixture(local / spread, hit, readings)
        if not affected.any() or log_p > np.log(SIGNIFICANT):
            return None
        count = int(affected.sum())
        effect = cls(where=where, share=count / total, size_V=float(np.median(np.concatenate(spikes))))
        std: Mapping[str, float | None] = {"share": float(np.sqrt(count)) / total}
        return Finding(effect, std, affected, log_p, ratio, sizes / np.sqrt(len(readings.values)), _none())


def _long_tailed(local: Array, hits: int) -> bool:
    """Whether readings that stand out are the end of a long tail: then many stand out a little less, as spikes do not
    make them."""
    if not hits:
        return False
    between = len(local) * _standing_out(local)
    expected = len(local) * _of_normal_noise()
    return between > 1.2 * expected + 4.0 * np.sqrt(expected) and 2.0 * between > hits


def _standing_out(local: Array) -> float:
    """The share of readings that differ from their neighbours by three to 4.5 times what they typically do."""
    sizes = np.abs(local) / max(float(np.median(np.abs(local))) / float(ndtri(0.75)), 1e-300)
    return float(np.mean((sizes > _TAIL) & (sizes <= _LESS)))


@lru_cache(maxsize=1)
def _of_normal_noise() -> float:
    noise = np.random.default_rng(0).standard_normal(100_000)
    return _standing_out(noise - median_filter(noise, 2 * _NEIGHBOURS + 1, mode="nearest"))


def _mixture(white: Array, hit: Mask, readings: Readings) -> float:
    """Log likelihood ratio of a share of spikes of any size up to the largest, over noise alone."""
    count = int(hit.sum())
    if not count:
        return 0.0
    share = count / len(white)
    width = 2.0 * float(np.abs(white).max())
    density = readings.log_density or (lambda x: -0.5 * x**2 - 0.5 * np.log(2.0 * np.pi))
    noise = density(white)
    return float(np.sum(np.logaddexp(np.log1p(-share), np.log(share / width) - noise)))


@register
@dataclass(frozen=True)
class Dropouts(Effect):
    """A sample is missed: with probability ``share`` all channels repeat their last reading, which may be one already.

    1e-3 of the samples; a guess.
    """

    name = "dropouts"
    stage = Stage.ELECTRONIC
    kind = Kind.DISTRIBUTION
    places = ("acquisition",)

    share: float = parameter("relative", 1e-3, lower=0.0, upper=1.0)

    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        rows = np.arange(len(signals))
        rows[rng.random(len(signals)) < self.share] = 0  # the first reading has none before it
        return replace(signals, volts=signals.volts[np.maximum.accumulate(rows)])

    @classmethod
    def examined(cls, readings: Readings, where: str) -> Finding | None:
        """Rows that repeat the row before in every channel, more often than readings do by chance."""
        values = readings.values[:, readings.columns]
        count = len(values)
        same = (values[1:] == values[:-1]).all(axis=1)
        alike = [np.count_nonzero(column[2:] == column[:-2]) for column in values.T]
        chance = float(np.prod([(each + 1.0) / count for each in alike]))
        many = int(same.sum())
        log_p = float(binom.logsf(many - 1, count, chance))
        if not many or log_p > np.log(SIGNIFICANT):
            return None
        rows = np.concatenate([[False], same])
        share = float(rows.mean())
        differences = np.diff(readings.expected, axis=0, prepend=readings.expected[:1])
        added = np.sqrt(share * (np.mean(differences**2, axis=0) + 2.0 * readings.sigma**2))
        repeated = share + (1.0 - share) * chance
        ratio = float(xlogy(many, repeated / chance) + xlogy(count - many, (1.0 - repeated) / (1.0 - chance)))
        affected = np.repeat(rows[:, None], len(CHANNELS), axis=1)
        std = {"share": float(np.sqrt(share * (1.0 - share) / count))}
        return Finding(cls(where=where, share=share), std, affected, log_p, ratio, added, _none())


def lattice_step(values: Array, grid: float = 0.0) -> float:
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


def _none() -> Array:
    return np.zeros(len(CHANNELS))
