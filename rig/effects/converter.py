"""Effects of the converter on sampled, noisy readings: what they do to the readings' distribution.

Each class simulates its effect, and knows by what single readings show it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import gammainc, ndtr
from typing_extensions import override

from rig.arrays import Array, Mask
from rig.channels import CHANNELS, COLUMNS_OF
from rig.effects.base import Effect, Kind, Stage, register
from rig.effects.electronic import mid_scale
from rig.effects.parameters import parameter
from rig.effects.readings import Finding, Readings
from rig.effects.tails import beside_neighbours, limit, log_tail, tails_of
from rig.signals import Signals

#: A level that no reading reaches, whatever its unit.
_OUT_OF_REACH: Final = 1e12
#: Largest p-value at which an effect on single readings counts, over all readings and channels.
SIGNIFICANT: Final = 1e-5
#: A level is clipped at when it holds this many readings and this many times its neighbourhood's density.
_PILED, _DENSER = 4, 4.0
#: Noise of so many steps of a converter spreads over its levels.
_SPREADS: Final = 3.0
#: A converter's rounding that adds less than this share of the floor's variance is not felt.
_FELT: Final = 0.005
#: A reading is no outlier by itself within so many deviations of its neighbours, whatever the tails.
_STANDS_OUT: Final = 6.5
#: So many outliers in a channel make others likely; then those count that noise makes once in five recordings.
_SEVERAL, _LESS = 3, 4.5
#: A step is fine that is this share of the noise; noise is no less than that share of a step.
_FINE: Final = 1e-3
#: A chance as good as none.
_NEVER: Final = 1e-12
#: Readings count as equal to a limit that differ by less than this share of the noise, where no converter is known.
_ALIKE: Final = 1e-3
#: Where this share of single readings repeats the last one, the log is faster than what it logs. By chance they repeat
#: so many times as often as noise about a model makes them, which may be off by a gap.
_STALE, _UNSURE = 0.1, 2.0


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

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        volts = signals.volts.copy()
        clip = np.minimum if self.level >= mid_scale(volts[:, self.columns]) else np.maximum
        volts[:, self.columns] = clip(volts[:, self.columns], self.level)
        return replace(signals, volts=volts)

    @classmethod
    def examined(cls, readings: Readings, where: str) -> Finding | None:
        """A level at which the readings pile up and beyond which there are none though some were expected."""
        from scipy.stats import binom  # takes a third of a second, which only the diagnosis needs

        column = CHANNELS.index(where)
        values, sigma = readings.values[:, column], float(readings.sigma[column])
        step = lattice_step(values)
        for sign in (1.0, -1.0):
            level = float((sign * values).max())
            piled = sign * values >= level - 1e-9 * max(1.0, abs(level))
            below = sign * values > level - max(1.5 * step, _ALIKE * sigma)
            expected = float((below & ~piled).sum())  # on a lattice the next level, else a thousandth of the noise
            piled_up = float(binom.logsf(piled.sum() - 1, len(values), max(expected, 1.0) / len(values)))
            beyond = (sign * readings.expected[:, column] - level) / sigma
            # a signal that turns at a lattice's top level reaches none above it
            none_beyond = -float(ndtr(beyond - 0.5 * step / sigma).sum())
            # noise of many steps does not pile up by itself: half of what is asked for is enough then
            log_p = max(piled_up, (2.0 if sigma > _SPREADS * step else 1.0) * none_beyond)
            many = piled.sum() >= _PILED and piled.sum() >= _DENSER * max(expected, 0.5)
            if not many or log_p > np.log(SIGNIFICANT):
                continue
            affected = np.zeros_like(readings.values, dtype=bool)
            affected[:, column] = piled | (sign * readings.expected[:, column] > level - 3.0 * sigma)
            lost = (beyond**2 + 1.0) * ndtr(beyond) + beyond * np.exp(-0.5 * beyond**2) / np.sqrt(2.0 * np.pi)
            added = np.zeros(len(CHANNELS))
            added[column] = sigma * np.sqrt(lost.mean())
            effect = cls(where=where, level=sign * level)
            # a converter rounds the level, too
            std = float(np.hypot(sigma / float(piled.sum()), step / np.sqrt(12.0)))
            return Finding(effect, {"level": std}, affected, log_p, added, anywhere=False)
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

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        if self.lsb_V == 0.0:
            return signals
        return replace(signals, volts=np.round(signals.volts / self.lsb_V) * self.lsb_V)

    @classmethod
    def examined(cls, readings: Readings, where: str) -> Finding | None:
        """All channels on a coarser lattice than the one that is known: its step is no cause."""
        columns = readings.columns
        known = np.where(np.isfinite(readings.step[columns]), readings.step[columns], 0.0)
        found = [_lattice(readings.values[:, column], grid) for column, grid in zip(columns, known, strict=True)]
        steps, stds = np.array(found).T
        sigma = readings.sigma[columns]
        if not (steps > 1.5 * known).all() or steps.min() <= 0.0 or (steps**2 / 12.0 < _FELT * sigma**2).all():
            return None
        rounding = np.zeros(len(CHANNELS))
        rounding[columns] = np.maximum(steps**2 - known**2, 0.0) / 12.0
        lsb = float(np.median(steps))
        nothing = np.zeros_like(readings.values, dtype=bool)
        effect = cls(where=where, lsb_V=lsb)
        return Finding(effect, {"lsb_V": float(np.median(stds))}, nothing, -np.inf, np.sqrt(rounding))


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

    @override
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
        log_p, spikes = 0.0, []
        every = {column: beside_neighbours(readings.white[:, column]) for column in columns}
        if not any((np.abs(local) > _STANDS_OUT).any() for local in every.values()):
            return None
        tails = {column: tails_of(local, readings.degrees[column]) for column, local in every.items()}
        least = {
            column: max(limit(SIGNIFICANT / total, tails[column][0]) * tails[column][1], _STANDS_OUT)
            for column in columns
        }
        several = sum(np.count_nonzero(np.abs(every[column]) > least[column]) for column in columns) >= _SEVERAL
        for column, local in every.items():
            degrees, scale = tails[column]
            # where there are spikes, in whichever channel, those that stand out less belong to them
            hit = np.abs(local) > (limit(float(ndtr(-_LESS)), degrees) * scale if several else least[column])
            hit &= ~readings.left_out[:, column]
            affected[:, column] = hit
            if hit.any():
                sizes[column] = np.sqrt(np.sum(local[hit] ** 2)) * readings.sigma[column]
                log_p += float(np.sum(log_tail(local[hit] / scale, degrees)) + np.log(total))
                spikes.append(np.abs(local[hit]) * readings.sigma[column])
        if not affected.any() or log_p > np.log(SIGNIFICANT):
            return None
        count = int(affected.sum())
        effect = cls(where=where, share=count / total, size_V=float(np.median(np.concatenate(spikes))))
        std: Mapping[str, float | None] = {"share": float(np.sqrt(count)) / total}
        return Finding(effect, std, affected, log_p, sizes / np.sqrt(len(readings.values)))


@register
@dataclass(frozen=True)
class Dropouts(Effect):
    """A sample is missed: with probability ``share`` all channels repeat their last reading, which may be one already.

    A recording shows it, too, where each channel misses some by itself.

    1e-3 of the samples; a guess.
    """

    name = "dropouts"
    stage = Stage.ELECTRONIC
    kind = Kind.DISTRIBUTION
    places = ("acquisition",)

    share: float = parameter("relative", 1e-3, lower=0.0, upper=1.0)

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        rows = np.arange(len(signals))
        rows[rng.random(len(signals)) < self.share] = 0  # the first reading has none before it
        return replace(signals, volts=signals.volts[np.maximum.accumulate(rows)])

    @classmethod
    def examined(cls, readings: Readings, where: str) -> Finding | None:
        """Rows that repeat the row before in every channel, more often than readings do by chance; else single readings
        that repeat their channel's last one, but for what is left out already."""
        from scipy.stats import poisson

        values = readings.values[:, readings.columns]
        repeats = values[1:] == values[:-1]
        same = repeats.all(axis=1)
        many = int(same.sum())
        log_p = float(poisson.logsf(many - 1, _repeat_by_chance(readings)))
        affected = np.zeros(readings.values.shape, dtype=bool)
        if many and log_p <= np.log(SIGNIFICANT):
            affected[1:] = same[:, None]
        else:
            clipped = readings.left_out[:, readings.columns]
            by_noise = sum(float(np.exp(_log_alike(readings, column)).sum()) for column in readings.columns)
            apart = (values[2:] == values[:-2]) & ~(repeats[1:] | repeats[:-1] | clipped[2:])
            repeats &= ~clipped[1:]
            many = int(repeats.sum())
            log_p = float(poisson.logsf(many - 1, _UNSURE * max(by_noise, float(apart.sum()))))
            if not 0 < many < _STALE * repeats.size or log_p > np.log(SIGNIFICANT):
                return None
            affected[1:, readings.columns] = repeats
        share = float(affected[:, readings.columns].mean())
        differences = np.diff(readings.expected, axis=0, prepend=readings.expected[:1])
        added = np.sqrt(share * (np.mean(differences**2, axis=0) + 2.0 * readings.sigma**2))
        std = {"share": share * float(np.sqrt((1.0 - share) / many))}
        return Finding(cls(where=where, share=share), std, affected, log_p, added)


def _repeat_by_chance(readings: Readings) -> float:
    """How many rows repeat the row before in every channel where nothing is missed.

    A channel repeats where both readings round to one level: for a step d, over all places of the lattice, with chance
    E max(0, 1 - |D|/d), D the difference of the two before rounding. Rows two apart, of which no dropout repeats one
    alone, tell where that is not what happens. So do channels that repeat while others do not, as in a log that is
    faster than what it logs: now and then they do so together.
    """
    columns = readings.columns
    values = readings.values[:, columns]
    count = len(values)
    repeats = values[1:] == values[:-1]
    log_chance = np.zeros(count - 1)
    for sensor in COLUMNS_OF.values():
        own = [place for place, column in enumerate(columns) if sensor.start <= column < sensor.stop]
        together = sum((_as_seen(_log_alike(readings, columns[k]), repeats, [k]) for k in own), np.zeros(count - 1))
        log_chance += _as_seen(together, repeats, own)
    apart = (values[2:] == values[:-2]).all(axis=1) & ~repeats[1:].all(axis=1)
    return max(float(np.exp(log_chance).sum()), float(apart.sum())) + _NEVER * count


def _log_alike(readings: Readings, column: int) -> Array:
    """(n - 1,) logarithm of the chance that a channel's reading and the next round to one level."""
    values = readings.values[:, column]
    step = lattice_step(values) or float(np.diff(np.unique(values[np.isfinite(values)])).min(initial=1.0))
    # the noise before rounding: that of readings holds what rounding adds
    spread = float(np.sqrt(2.0 * max(readings.sigma[column] ** 2 - step**2 / 12.0, (_FINE * step) ** 2)))
    change = np.diff(readings.expected[:, column])
    if step < _FINE * spread:  # the density of D at zero, a step wide: the differences below would be rounding
        density = np.exp(-0.5 * (change / spread) ** 2) / (np.sqrt(2.0 * np.pi) * spread)
        return np.asarray(np.log(np.clip(step * density, _NEVER, 1.0)))

    def above(shift: float) -> Array:
        """E max(0, D + shift)."""
        at = (change + shift) / spread
        return np.asarray(spread * (at * ndtr(at) + np.exp(-0.5 * at**2) / np.sqrt(2.0 * np.pi)))

    return np.asarray(np.log(np.clip((above(step) - 2.0 * above(0.0) + above(-step)) / step, _NEVER, 1.0)))


def _as_seen(log_chance: Array, repeats: Mask, own: list[int]) -> Array:
    """(n - 1,) the chance that channels ``own`` of (n - 1, c) repeat, or the share in which they do where that is more
    often; told by rows that no dropout repeats, in which not all other channels repeat."""
    others = np.delete(repeats, own, axis=1)
    fresh = ~others.all(axis=1)
    seen, expected = int(repeats[fresh][:, own].all(axis=1).sum()), float(np.exp(log_chance[fresh]).sum())
    if not seen or gammainc(seen, expected) > SIGNIFICANT:  # the chance that a Poisson count is as large
        return log_chance
    return np.full_like(log_chance, np.log(seen / fresh.sum()))


def lattice_step(values: Array) -> float:
    """The step of the lattice that values lie on; zero where they lie on none."""
    return _lattice(values, 0.0)[0]


def _lattice(values: Array, grid: float) -> tuple[float, float]:
    """``lattice_step`` to within a finer grid's rounding, and its standard deviation by how the levels scatter about
    it, no less than rounding."""
    levels = np.unique(values)
    if len(levels) > 0.7 * len(values) or len(levels) < 3:
        return 0.0, 0.0
    if len(levels) > 4:
        levels = levels[1:-1]  # where a channel is clipped need not be on it
    differences = np.diff(levels)
    smallest = float(np.mean(differences[differences < 1.5 * differences.min()]))
    numbers = np.concatenate([[0.0], np.cumsum(np.round(differences / smallest))])
    slope, start = np.polyfit(numbers, levels, 1)
    off = levels - start - slope * numbers
    if not np.abs(off).max() < 0.05 * slope + 0.75 * grid:
        return 0.0, 0.0
    scatter = max(float(np.sqrt(np.sum(off**2) / (len(levels) - 2))), float(np.spacing(np.abs(levels).max())))
    return float(slope), scatter / float(np.sqrt(len(levels)) * numbers.std())
