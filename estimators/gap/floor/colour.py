"""The colour of a channel's noise, learned at rest: white, or white plus a few exponentially correlated parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import minimize, minimize_scalar
from scipy.special import chdtri

from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.gap.floor.periodogram import Periodogram
from estimators.noise.equivalent_channels import equivalent_channels
from rig.arrays import Array

#: Twice the gain in log likelihood that two more parameters must bring before a part counts. The null distribution lies
#: below chi-square with two degrees of freedom, whose tail here is 0.7 %: a part that is not there costs little, since
#: tests weigh how well it is known; one that was overlooked looks like noise that the sweep has and rest had not.
COLOUR_THRESHOLD = 10.0
#: The same for a further part, on a floor that is known to be coloured: a chance of 2 %. One that is not there is
#: slower than the rest, and drifts of the sweep are taken for it. Parts at most: a spectrum of 1/f over the decades
#: that a recording covers takes three.
FURTHER_THRESHOLD = 8.0
_MOST = 3
#: A slow part that was not seen: its share of the colour, and how much slower than the slowest it is.
_SPARE, _SLOWER = 5e-3, 4.0
#: Prior standard deviation of the logarithm of a part's size in one channel about that of its board: the channels are
#: made by one process; and how far it is looked for.
APART, _LEAST_ALIKE = 0.7, 8.0
#: p-value below which channels do not share the shape of their noise.
SHARED_AT = 1e-3
#: The first steps of the search: a factor of e in the odds of a coloured share and in a correlation time.
_STEPS = np.array([1.0, 1.0])


@dataclass(frozen=True)
class Held:
    """Readings of one channel at rest.

    Attributes:
        segments: (n,) each about a mean of its own. interval_s: between samples.
        poses: that the segments are of, where several, of samples between each other's, are of one time.
    """

    segments: tuple[Array, ...]
    interval_s: float
    poses: int

    @property
    def count(self) -> int:
        """Degrees of freedom: samples less means."""
        return sum(len(segment) - 1 for segment in self.segments)

    @property
    def interleaved(self) -> float:
        """How many segments are of one time."""
        return len(self.segments) / max(self.poses, 1)

    @property
    def lasted(self) -> tuple[float, int]:
        """[s], and in how many poses: what is slow, series between each other show but once."""
        return self.count * self.interval_s / self.interleaved, self.poses

    @property
    def variance(self) -> float:
        """About the means of the segments."""
        return sum(float(np.sum((segment - segment.mean()) ** 2)) for segment in self.segments) / self.count

    @property
    def silent(self) -> bool:
        """Whether the readings of each pose are the same but for what squares in double precision do not tell."""
        told = float(np.sqrt(np.finfo(float).eps))
        return all(float(np.ptp(each)) <= told * float(np.abs(each).max()) for each in self.segments)

    @cached_property
    def periodogram(self) -> Periodogram:
        """Of its segments."""
        return Periodogram.of(self.segments)

    def rough_loss(self, point: Array) -> float:
        """Minus twice the log likelihood of the periodogram, at a point as in ``loss``; up to a constant."""
        parts = _shaped(point, 1.0, self).parts
        return self.periodogram.loss([(size, float(np.exp(-self.interval_s / tau_s))) for size, tau_s in parts])

    def loss(self, point: Array) -> tuple[float, float]:
        """Minus twice the restricted log likelihood at a point of ``_shaped``, up to a constant; the variance there.

        The means of the segments are integrated out (Harville, Biometrika 61, 1974).
        """
        whiten = _shaped(point, 1.0, self).whitener(self.interval_s)
        squares, spread = 0.0, 0.0
        for segment in self.segments:
            many = len(segment)
            y, one = whiten(np.stack([segment - segment.mean(), np.ones(many)]))
            known = float(one @ one)
            squares += float(y @ y) - float(y @ one) ** 2 / known
            spread += 2.0 * whiten.log_scale(many) + float(np.log(known / many))
        scale = squares / self.count
        return float(self.count * np.log(scale)) + spread, scale

    @property
    def white(self) -> ChannelNoise:
        """All of it white."""
        duration, holds = self.lasted
        return ChannelNoise(self.variance, samples=self.count, duration_s=duration, holds=holds)

    def at(self, point: Array) -> ChannelNoise:
        """The noise of this shape that is most likely."""
        return _shaped(point, self.loss(point)[1], self)


def held(poses: Sequence[Array], interval_s: float, stride: int = 1, most: int = 1) -> Held:
    """Readings (n,) of each pose at rest; segments of a single sample tell nothing.

    Args:
        interval_s: between readings. stride: of which one is taken. most: series between each other's of one pose.
    """
    series = [
        [np.asarray(readings[first::stride], dtype=float) for first in range(min(stride, most))] for readings in poses
    ]
    kept = [[each for each in own if len(each) > 1] for own in series]
    return Held(tuple(each for own in kept for each in own), stride * interval_s, sum(map(bool, kept)))


def fit_floor(channels: Sequence[Held], boards: Sequence[str] = ()) -> list[ChannelNoise]:
    """The most likely noise of each channel: white where a coloured part does not pay for its two parameters, neither
    in that channel nor, of one shape, in all of its board.

    Coloured channels share the shape of their spectrum unless the data speak against it: all of them, else those of one
    board. A shared shape is known better by the number of channels. Further coloured parts must pay as well.

    Args:
        boards: what each channel sits on; one board by default.
    """
    shapes: dict[int, Array] = {}
    for index, channel in enumerate(channels):
        if not channel.silent:
            point = _best([channel])
            if channel.count * float(np.log(channel.variance)) - channel.loss(point)[0] >= COLOUR_THRESHOLD:
                shapes[index] = _with_more([channel], point)
    found: dict[int, ChannelNoise] = {}
    boards = boards or [""] * len(channels)
    for board in sorted(set(boards)):  # what no channel shows by itself, all of a board may
        here = [index for index in range(len(channels)) if boards[index] == board and not channels[index].silent]
        if len(here) > 1 and not any(index in shapes for index in here):
            together = [channels[index] for index in here]
            point = _best(together)
            white = sum(each.count * float(np.log(each.variance)) for each in together)
            gain = white - sum(each.loss(point)[0] for each in together)
            if gain * _independent(together) >= COLOUR_THRESHOLD:
                shapes |= dict.fromkeys(here, _with_more(together, point))
    of_board = [[index for index in shapes if boards[index] == board] for board in sorted(set(boards))]
    for group in [list(shapes), *of_board]:
        fresh = [index for index in group if index not in found]
        common = _shared([channels[index] for index in fresh], [shapes[index] for index in fresh])
        if common is not None:
            found |= {index: channels[index].at(common) for index in fresh}
    for index, shape in shapes.items():
        found.setdefault(index, channels[index].at(shape))
    for index, channel in enumerate(channels):
        mates = [found[other] for other in shapes if boards[other] == boards[index]]
        if index not in shapes and mates and not channel.silent:
            found[index] = _as_mates(channel, mates)
    return [
        _with_spare(found[index], channels[index]) if index in found else channel.white
        for index, channel in enumerate(channels)
    ]


def _independent(channels: Sequence[Held]) -> float:
    """The share of channels that tell something of their own, where they share noise from reading to reading."""
    values = [np.concatenate([segment - segment.mean() for segment in channel.segments]) for channel in channels]
    if len({len(each) for each in values}) > 1:
        return 1.0
    return equivalent_channels(np.stack(values, axis=1)) / len(values)


def _as_mates(channel: Held, mates: Sequence[ChannelNoise]) -> ChannelNoise:
    """The noise of a channel whose colour does not pay, on a board on which that of others does.

    It is as coloured as the most alike of these, as far as its readings allow: what does not show may still be there.
    """
    points = [np.ravel([(np.log(size / mate.white), np.log(tau_s)) for size, tau_s in mate.parts]) for mate in mates]

    def moved(point: Array, shift: float) -> Array:
        return np.asarray(point + np.tile([shift, 0.0], len(point) // 2))

    found = []
    for point in points:
        way = minimize_scalar(
            lambda shift, point=point: (
                channel.rough_loss(moved(point, shift)) / channel.interleaved + (shift / APART) ** 2
            ),
            bounds=(-_LEAST_ALIKE, _LEAST_ALIKE),
            method="bounded",
        )
        found.append((float(way.fun), moved(point, float(way.x))))
    return channel.at(min(found, key=lambda one: one[0])[1])


def _with_spare(noise: ChannelNoise, source: Held) -> ChannelNoise:
    """With one more slow part, next to nothing, where parts are to spare.

    What tests of the sweep's noise then take for possible is any slow part that the recording at rest does not exclude.
    """
    if len(noise.parts) == _MOST:
        return noise
    slowest = max(tau_s for _, tau_s in noise.parts)
    longest = max(len(segment) for segment in source.segments) * source.interval_s
    spare = _SPARE * noise.coloured, max(_SLOWER * slowest, longest)
    return replace(noise, parts=(*noise.parts, spare), spare=True)


def _shared(channels: Sequence[Held], shapes: Sequence[Array]) -> Array | None:
    """The shape that several channels share, if what each loses by it is chance."""
    if len(channels) < 2:
        return None
    common = _with_more(channels, _best(channels))
    lost = sum(
        channel.loss(common)[0] - channel.loss(shape)[0] for channel, shape in zip(channels, shapes, strict=True)
    )
    free = max(2, sum(map(len, shapes)) - len(common))
    return common if lost / channels[0].interleaved < chdtri(free, SHARED_AT) else None  # as what is slow, shown once


def _best(channels: Sequence[Held]) -> Array:
    """The shape that is most likely for all these channels."""
    interval, longest = _span(channels)
    starts = [
        np.array([share, np.log(tau)])
        for share in (-2.0, 0.0, 2.0)
        for tau in np.geomspace(interval, longest / 10.0, 5)
    ]
    return _searched(channels, starts)[0]


def _with_more(channels: Sequence[Held], point: Array) -> Array:
    """The shape with further coloured parts, as long as these pay for themselves."""
    interval, longest = _span(channels)
    before = sum(channel.rough_loss(point) for channel in channels)
    while len(point) < 2 * _MOST:
        starts = [
            np.array([*point, point[0] + share, np.log(tau)])
            for share in (-1.5, 0.0)
            for tau in np.geomspace(interval, longest / 4.0, 6)
        ]
        found, loss = _searched(channels, starts)
        if before - loss < FURTHER_THRESHOLD:
            break
        point, before = found, loss
    return point


def _span(channels: Sequence[Held]) -> tuple[float, float]:
    """[s] between samples, and of the longest segment."""
    interval = channels[0].interval_s
    return interval, max(len(segment) for channel in channels for segment in channel.segments) * interval


def _searched(channels: Sequence[Held], starts: Sequence[Array]) -> tuple[Array, float]:
    """The likeliest shape from the best of some starts, and its loss."""
    interval, longest = _span(channels)

    def loss(point: Array) -> float:
        return sum(channel.rough_loss(point) for channel in channels) + _outside(point, interval, longest)

    start = min(starts, key=loss)
    steps = np.vstack([np.zeros(len(start)), np.diag(np.tile(_STEPS, len(start) // 2))])
    options = {"xatol": 1e-2, "fatol": 1e-2, "maxfev": 100 * len(start), "initial_simplex": start + steps}
    found = minimize(loss, start, method="Nelder-Mead", options=options)
    return np.asarray(found.x), float(found.fun)


def _shaped(point: Array, variance: float, source: Held) -> ChannelNoise:
    """At a point: for each coloured part the logarithm of its ratio to the white part, and that of its time."""
    ratios = np.exp(point[::2])
    unit = variance / (1.0 + float(ratios.sum()))
    parts = sorted(
        (float(np.exp(log_tau)), float(ratio) * unit) for ratio, log_tau in zip(ratios, point[1::2], strict=True)
    )
    sizes = tuple((size, tau_s) for tau_s, size in parts)
    duration, holds = source.lasted
    return ChannelNoise(unit, sizes, source.count, duration, holds=holds)


def _outside(point: Array, interval_s: float, longest_s: float) -> float:
    """A wall around what segments of this length and rate can tell."""
    low, high = np.log(interval_s / 3.0), np.log(longest_s)
    beyond = np.maximum(0.0, low - point[1::2]) + np.maximum(0.0, point[1::2] - high)
    return float(1e3 * np.sum(beyond + np.maximum(0.0, np.abs(point[::2]) - 12.0)))
