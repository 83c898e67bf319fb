"""A monitor of calibrated readings: does the calibration still hold, and if not, since when and what has changed?

Residuals are summed over blocks of a tenth of a second. Over windows of 1, 4, 16 and 64 blocks two chi-squares are
formed, of the residuals' mean (a shift) and of their squares (noise); over a minute a third, of their means by
direction. Each test has its share of the false alarms that are allowed, by Bonferroni's bound: sliding windows overlap,
so that there are fewer than stated.

Real noise has a memory, and its variance is not quite the calibration's. Both are learnt from the first minute, and the
memory until enough independent windows have shown it, of a running estimate ever on. Each window is held against what
the others were (``noise_memory``): the tests begin at once, hardly sensitive, and gain with what is known.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from estimators.live.alarm import Alarm
from estimators.live.direction_means import PART, PARTS, ByDirection
from estimators.live.naming import Likeness, likenesses
from estimators.live.noise_memory import CERTAIN, Memory, exceeded
from estimators.live.reference import Reference, Residuals
from estimators.live.residual_blocks import LEAST, Blocks, Rested, within
from estimators.live.stuck import Stuck
from estimators.p_words import p_words
from rig.arrays import Array, Rows
from rig.recording import Recording

if TYPE_CHECKING:
    from rig.arm import Arm


BLOCK_S: Final = 0.1
#: Where a sensor has to rest, a block has so many samples at least: their variance tells it.
_RESTS: Final = 3
#: Lengths of the windows, in blocks; each is looked at four times while it slides by its length.
WINDOWS: Final = (1, 4, 16, 64)
_PER_LENGTH: Final = 4
_DAY_S: Final = 86400.0
#: A change is over when no window up to the one that showed it, or up to this many blocks, has been as improbable as
#: this for so long [s].
_SHORT: Final = 4
_STILL_THERE: Final = 1e-3
_CALM_S: Final = 1.0
#: A tenth more variance is no change.
_MORE_NOISE: Final = 1.1
#: Noise that is remembered for ever moves the means of windows as readings: by no more than so many times the variance
#: that the reference states, whatever is still to be learnt.
_SLOW: Final = 4.0
#: What a window may add to the noise's own history, over what is known of it: noise itself hardly ever has more.
_CAPPED: Final = 10.0
#: While the memory is still learnt after the first minute, so many blocks are judged at a time.
_AT_A_TIME: Final = 64
#: The change is named once so many seconds after it are known, and so many samples, and again when more are; so much
#: before it is kept.
_NAMED_S: Final = (1.0, 8.0)
_NAMED: Final = 16
_KEPT_S: Final = 20.0
_KEPT: Final = 4096
#: An estimate that predicts readings worse than this (in variances of a reading) judges nothing.
_VAGUE: Final = 1.0


@dataclass(frozen=True, eq=False)
class _Tests:
    """One window's tests: mean squares (d,) of the mean and of the squares' deviation, over those of white noise; the
    first block over the limit with its probability and words, the least probability, and of the longest window's
    standardised means (m, k) those that do not overlap."""

    place: int
    ratio: Array
    deviation: Array
    first: int | None
    p: float
    words: str
    least: float
    apart: Array


class SensorWatch:
    """The monitor of one sensor.

    Attributes:
        sensor: which one.
        alarmed: the change that lasts, if any.
        memory: of the windows' means. swing: of their squares. level: the noise's variance over the reference's.
        by_direction: the residuals' means.
    """

    def __init__(
        self,
        sensor: str,
        unit: str,
        rate_Hz: float,
        tests_a_day: float,
        learn_s: float,
        fixed: bool,
        rests: bool = False,
    ) -> None:
        """Args:
        rate_Hz: of the samples.
        tests_a_day: false alarms a day for each of the sensor's tests.
        learn_s: how long the noise's memory is learnt [s].
        fixed: whether the reference is a given calibration.
        rests: whether it may be judged only where it rests, as an accelerometer that is turned by hand.
        """
        self.sensor, self._unit = sensor, unit
        self.alarmed: Alarm | None = None
        self.level = 1.0
        self.reference: Reference | None = None
        self._block = max(_RESTS if rests else 1, round(BLOCK_S * rate_Hz))
        self._rests = rests
        self._block_s = self._block / rate_Hz
        self._rate_Hz = rate_Hz
        self._chance = tests_a_day / _DAY_S
        self._learn_s, self._fixed = learn_s, fixed
        self._begun_s: float | None = None
        self._learnt = learn_s <= 0.0
        self.memory = Memory((*WINDOWS, PARTS * PART), self._chance, len(WINDOWS) - 1)
        self.swing = Memory(WINDOWS, self._chance, len(WINDOWS) - 1)
        if self._learnt:
            self.memory.known()
            self.swing.known()
        self._blocks = Blocks.empty(3)
        self._rested = Rested(self._block_s)
        self._rests_s: deque[float] = deque()
        self._number = 0
        self._squares = np.zeros(2)  # of residuals, and their degrees of freedom
        self.by_direction = ByDirection(self._block)
        self._kept: deque[Residuals] = deque()
        self._kept_count = 0
        self._rest: Residuals | None = None
        self._calm_s = np.nan
        self._watched = _SHORT
        self._named = len(_NAMED_S)
        self.stuck = Stuck(sensor, self._chance / rate_Hz)

    def refer(self, reference: Reference) -> None:
        """What readings are held against from now on; not while a change lasts, which it would take up."""
        if self.alarmed is None:
            self.reference = reference

    def add(self, batch: Recording, arm: Arm | None) -> list[Alarm]:
        """Take samples up; what there is to say."""
        found: list[Alarm] = []
        if self._begun_s is None:
            self._begun_s = float(batch.t[0])
        readings = batch.readings(self.sensor)
        stopped = self.stuck.add(batch.t, readings)
        if stopped is not None:
            found += self._raise(stopped)
        if self.reference is None or not np.isfinite(self.reference.matrix).all():
            return found
        residuals = self.reference.residuals(batch, self.sensor, arm)
        self._keep(residuals)
        if self._rest is not None and self._rest.values.shape[1] == residuals.values.shape[1]:
            residuals = self._rest.then(residuals)
        blocks = Blocks.of(residuals, self._block)
        self._rest = residuals.pick(slice(len(blocks) * self._block, None))
        if not len(blocks):
            return found
        if self._rests:
            blocks = self._rested.through(blocks, residuals.readings, self._block)
            self._rests_s.extend(blocks.t.tolist())
            while self._rests_s and self._rests_s[0] < self._kept[0].t[0]:
                self._rests_s.popleft()
        if not self._fixed:
            blocks = blocks.pick(blocks.predicted.max(axis=1) <= _VAGUE)
        return [*found, *self.judge(blocks)]

    def judge(self, blocks: Blocks) -> list[Alarm]:
        """Take up the next blocks, which ``add`` makes of samples; what there is to say."""
        found: list[Alarm] = []
        if self._begun_s is None and len(blocks):
            self._begun_s = float(blocks.t[0])
        if self._blocks.sums.shape[1] != blocks.sums.shape[1]:
            self._blocks = Blocks.empty(blocks.sums.shape[1])
        while len(blocks):
            count, said = self._take(blocks)
            found += said
            blocks = blocks.pick(slice(count, None))
        return found

    def _take(self, blocks: Blocks) -> tuple[int, list[Alarm]]:
        """Test the next blocks, all at once while nothing happens; how many were taken, and what there is to say."""
        free = self.alarmed is None and self._learnt
        if not free:
            blocks = blocks.pick(slice(0, 1))
        elif not (self._fixed and self.memory.settled.all()):
            blocks = blocks.pick(slice(0, _AT_A_TIME))
        tests = self._tests(blocks)
        count = len(blocks)
        worst = min((test for test in tests if test.first is not None), key=lambda test: test.first or 0, default=None)
        if worst is not None and worst.first is not None and self.alarmed is None:
            count = worst.first + 1
            tests = self._tests(blocks.pick(slice(0, count)))
        if self.alarmed is None and (self._learnt or worst is None):  # of what may be a change no more than a share
            self._take_up(tests, blocks.squares[:count])
        taken = blocks.pick(slice(0, count))
        self._blocks = self._blocks.then(taken).pick(slice(-WINDOWS[-1], None))
        self._number += count
        now = float(taken.t[-1])
        self._learn(now)
        if worst is not None and self.alarmed is None:
            worst = min((test for test in tests if test.first is not None), key=lambda test: test.p, default=worst)
            self._watched = max(WINDOWS[worst.place], _SHORT)
            change = Alarm("change", now, self._since(self._blocks), self.sensor, worst.words, worst.p)
            return count, self._raise(change)
        calm = all(test.least > _STILL_THERE for test in tests if WINDOWS[test.place] <= self._watched)
        by_direction = self._directions(taken) if self._fixed else []
        return count, [*by_direction, *self._settle(now, calm)]

    @property
    def _freedom(self) -> float:
        """Degrees of freedom of a block's squares."""
        return float((self._block - (self._block >= LEAST)) * self._blocks.sums.shape[1])

    def _tests(self, blocks: Blocks) -> list[_Tests]:
        """Every window's tests that are due with these blocks."""
        joined = self._blocks.then(blocks)
        before, k = len(self._blocks), blocks.sums.shape[1]
        numbers = self._number + 1 + np.arange(len(blocks))
        sums = np.concatenate([np.zeros((1, k)), np.cumsum(joined.sums, axis=0)])
        squares = np.concatenate([[0.0], np.cumsum(joined.squares)])
        predicted = np.concatenate([np.zeros((1, k)), np.cumsum(joined.predicted, axis=0)])
        found = []
        for place, length in enumerate(WINDOWS):
            hop = max(1, length // _PER_LENGTH)
            due = np.flatnonzero((numbers % hop == 0) & (before + 1 + np.arange(len(blocks)) >= length))
            if not len(due):
                continue
            end = before + 1 + due
            count = float(length * self._block)
            model = (predicted[end] - predicted[end - length]) / length
            mean = (sums[end] - sums[end - length]) / count
            standard = mean / np.sqrt(1.0 / count + model)
            shift = np.square(standard).mean(axis=1)
            noise = squares[end] - squares[end - length]
            if self._block < LEAST:  # about the window's mean instead
                noise = noise - count * np.square(mean).sum(axis=1)
            apart = standard[numbers[due] % length == 0] if place == len(WINDOWS) - 1 else standard[:0]
            found.append(self._judged(place, due, shift, noise, apart))
        return found

    def _judged(self, place: int, due: Rows, shift: Array, noise: Array, apart: Array) -> _Tests:
        """Mean squares (d,) of the mean, and squares, against their limits; ``apart`` as of ``_Tests``."""
        length, k = WINDOWS[place], apart.shape[1]
        freedom = length * self._freedom - (k if self._block < LEAST else 0.0)
        level = self.level if self._block >= LEAST else 1.0  # of few samples it holds the mean's own square
        remembered = _SLOW * level * length * self._block  # all of the noise, through all of the window
        p_shift = np.minimum(
            self.memory.chance_of(place, shift, float(k)), exceeded(shift / remembered, float(k), CERTAIN)
        )
        p_noise = np.ones(len(noise))
        deviation = np.zeros(len(noise))
        if freedom > 0.0:
            deviation = np.square(noise / self.level - freedom) / (2.0 * freedom)
            known = (CERTAIN if self._learn_s <= 0.0 else self._squares[1]) / self.swing.ratio.max()
            more = noise / (freedom * self.level * _MORE_NOISE)
            p_noise = exceeded(more, freedom / float(self.swing.ratio[place]), known)
        both = np.minimum(p_shift, p_noise)
        limit = self._chance * max(1, length // _PER_LENGTH) * self._block_s
        over = np.flatnonzero(both < limit)
        least = float(both.min())
        if not len(over):
            return _Tests(place, shift, deviation, None, 1.0, "", least, apart)
        first = int(over[0])
        what = "the residuals' mean" if p_shift[first] <= p_noise[first] else "the residuals' squares"
        p = float(both[first])
        words = f"{what} over {length * self._block_s:.1f} s ({p_words(p)})"
        return _Tests(place, shift, deviation, int(due[first]), p, words, least, apart)

    def _take_up(self, tests: list[_Tests], squares: Array) -> None:
        """The noise's own history; of what may be a change no more than a share."""
        k = float(self._blocks.sums.shape[1])
        for test in tests:
            self.memory.follow(test.apart)
            windows = len(test.ratio) / min(_PER_LENGTH, WINDOWS[test.place])
            for memory, values, degrees in ((self.memory, test.ratio, k), (self.swing, test.deviation, 1.0)):
                most = memory.most(test.place, degrees)
                memory.add(test.place, float(np.minimum(values, most).mean()) * windows, windows, degrees)
        if self._fixed and self._learnt:
            return
        cap = _CAPPED * self.level * self._freedom if self._learnt else np.inf
        self._squares += np.minimum(squares, cap).sum(), len(squares) * self._freedom

    def _learn(self, now: float) -> None:
        """Widen the tests by what the windows were so far: until that is known; of a running estimate, ever again."""
        assert self._begun_s is not None
        if self.memory.settled.all() and self.swing.settled.all():
            return
        settle = self._fixed and self._learnt
        self.memory.learn(float(self._blocks.sums.shape[1]), settle)
        self.swing.learn(1.0, settle)
        if self._squares[1] > 0.0:
            self.level = max(1.0, float(self._squares[0] / self._squares[1]))
        self._learnt = self._learnt or now - self._begun_s >= self._learn_s

    def _since(self, blocks: Blocks) -> float:
        """Where a change of the mean most likely lies: the split of the blocks with the largest step."""
        before = float(self._block) * np.arange(len(blocks))
        after = float(self._block) * len(blocks) - before
        later = np.cumsum(blocks.sums[::-1], axis=0)[::-1]
        step = later / after[:, None] - (later[0] - later) / np.maximum(before, 1.0)[:, None]
        weight = after * np.maximum(before, 1.0) / (after + before)
        place = int(np.argmax(weight * np.square(step).sum(axis=1)))
        return float(blocks.t[place]) - self._block_s + 0.5 / self._rate_Hz

    def _raise(self, change: Alarm) -> list[Alarm]:
        """Of a change while another lasts the name alone is news."""
        if self.alarmed is not None:
            if not change.names:
                return []
            self.alarmed, self._named = replace(self.alarmed, names=change.names), len(_NAMED_S)
            return [replace(self.alarmed, kind="named", t_s=change.t_s)]
        if self.memory.beyond:
            doubt = "of noise remembered for longer than it was seen: more alarms than stated may come"
            change = replace(change, test=f"{change.test}, {doubt}")
        self.alarmed = change
        self._named = len(_NAMED_S) if change.names else 0
        self._calm_s = change.t_s
        return [change]

    def _settle(self, now: float, calm: bool) -> list[Alarm]:
        """Name a change that lasts, and end one that is over."""
        found: list[Alarm] = []
        change = self.alarmed
        if change is None:
            return found
        due = self._named < len(_NAMED_S) and now - change.since_s >= max(_NAMED_S[self._named], _NAMED / self._rate_Hz)
        if due and self._kept:
            known = self._kept[0].t[0] < change.since_s
            names = tuple(self._names(change.since_s, now)) if known else change.names
            if not self._named or [each.name for each in names] != [each.name for each in change.names]:
                change = self.alarmed = replace(change, names=names)
                found.append(replace(change, kind="named", t_s=now))
            self._named += 1
        if not calm or self.stuck.stuck:
            self._calm_s = now
        elif now - self._calm_s > _CALM_S:
            found.append(replace(change, kind="over", t_s=now, since_s=self._calm_s))
            self.alarmed = None
            self._blocks = self._blocks.pick(slice(0, 0))
            self.by_direction.clear()
            self._number = 0
        return found

    def _names(self, since_s: float, now: float) -> list[Likeness]:
        assert self.reference is not None
        width = self._kept[-1].values.shape[1]
        if any(part.values.shape[1] != width for part in self._kept):
            return []
        span = self._kept[0].then(*list(self._kept)[1:])
        span = replace(span, values=span.values / np.sqrt(self.memory.ratio[0] * self.level))
        rows = span.t <= now
        if self._rests:  # a motion is no effect
            rows &= within(span.t, np.array(self._rests_s), self._block_s - 0.5 / self._rate_Hz)
        return likenesses(span.pick(rows), since_s, self.sensor, self.reference, self._unit)

    def _keep(self, residuals: Residuals) -> None:
        part = residuals.pick(slice(None, None, max(1, int(_KEPT_S * self._rate_Hz) // _KEPT)))
        self._kept.append(part)
        self._kept_count += len(part)
        begin = residuals.t[-1] - _KEPT_S
        while len(self._kept) > 1 and (self._kept_count > _KEPT or self._kept[0].t[-1] < begin):
            self._kept_count -= len(self._kept.popleft())

    def _directions(self, blocks: Blocks) -> list[Alarm]:
        """The test of the means by direction, over the last minute of blocks."""
        found: list[Alarm] = []
        for now in self.by_direction.add(blocks):
            if self.alarmed is not None:
                continue
            ratio = float(self.memory.ratio[-1])
            square, degrees = self.by_direction.mean_square(ratio)
            p = float(self.memory.chance_of(-1, np.array(square), degrees))
            if self.by_direction.whole:
                most = self.memory.most(-1, degrees)
                self.memory.add(len(WINDOWS), min(square, most) / PARTS, 1.0 / PARTS, degrees)
            if p < self._chance * PART * self._block_s:
                words = f"the residuals toward {self.by_direction.worst} ({p_words(p)})"
                found += self._raise(Alarm("change", now, now - PART * self._block_s, self.sensor, words, p))
        return found
