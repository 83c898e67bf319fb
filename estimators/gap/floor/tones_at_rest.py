"""Tones of the readings at rest: no part of the floor, as spikes there are none; in the sweep they are a cause."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Final

import numpy as np
from scipy.fft import next_fast_len, rfft
from scipy.special import chdtri

from estimators.gap.diagnosis import TONE_AT_REST
from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.noise.spectrum import autoregression
from rig.arrays import Array, Rows
from rig.channels import CHANNELS, COLUMNS_OF
from rig.effects import EFFECTS

#: Tones at most; cycles in the longest pose at least: what is slower is a drift.
_MOST, _SLOWEST = 8, 4
#: Points of the spectrum for each of a pose's.
_FINER: Final = 4
#: p-value of what one channel has of a tone that another one hums with.
_CHANCE: Final = 1e-3
#: Readings of a pose at rest, at least.
_SHORTEST: Final = 40


def without_tones(channels: Sequence[Sequence[Array]]) -> list[tuple[list[Array], list[float]]]:
    """Of each channel readings (n,), one segment a pose, without tones that last; and their frequencies [cycles a
    sample]. What hums in one channel is looked for in the others.

    Args:
        channels: segments of each.
    """
    found = [_own_tones(segments) for segments in channels]
    heard = [each for _, own in found for each in own]
    return [_with_those(*each, heard) for each in found]


def toneless_readings(readings: Array, labels: Rows, columns: Sequence[int]) -> Array:
    """Readings (n, 6) without the tones of some channels: a hum is not what channels share from reading to reading."""
    found = readings.copy()
    poses = [labels == label for label in np.unique(labels) if label >= 0]
    every = without_tones([[readings[rows, column] for rows in poses] for column in columns])
    for column, (segments, _) in zip(columns, every, strict=True):
        for rows, left in zip(poses, segments, strict=True):
            found[rows, column] = left
    return found


def _own_tones(segments: Sequence[Array]) -> tuple[list[Array], list[float]]:
    """The same of one channel, where tones are likelier than noise that resonates.

    The Bayesian information criterion tells (Schwarz, Annals of Statistics 6, 1978): of tones with an amplitude and a
    phase in each pose beside an autoregression. All that are worth it beside white noise are tried together: a few
    lines of a hum are a resonance to an autoregression, as long as one is left.
    """
    left, found = list(segments), list[float]()
    ways: list[tuple[float, int, list[Array]]] = []
    for count in range(_MOST + 1):
        long = [each for each in left if len(each) >= _SHORTEST]
        if not long or not any(np.ptp(each) > 0.0 for each in long):
            break
        many = sum(map(len, long))
        cost = (2.0 * len(long) + 3.0) * float(np.log(many))
        highest = _highest(long)
        less = _without(long, highest)
        squares = sum(float(np.sum((each - each.mean()) ** 2)) for each in less)
        worth = many * np.log(max(squares, 1e-300) / many) + cost <= _as_noise(long, 0)
        if count or worth:  # else there is none to be held against others
            ways.append((_as_noise(long) + count * cost, count, left))
        if not worth:
            break
        found.append(highest)
        left = _put_back(left, less)
    _, count, left = min(ways, key=lambda way: way[:2], default=(0.0, 0, left))
    return left, found[:count]


def _with_those(left: list[Array], own: list[float], heard: Sequence[float]) -> tuple[list[Array], list[float]]:
    """Without those of some frequencies, too, that an amplitude and a phase in each pose show by more than chance."""
    long = [each for each in left if len(each) >= _SHORTEST]
    apart = 1.0 / max(map(len, long), default=1)
    others = [frequency for frequency in heard if not _near_any(frequency, own, apart)]
    if not others or not any(np.ptp(each) > 0.0 for each in long):
        return left, own
    found, before, by_chance = list(own), _as_noise(long), float(chdtri(2 * len(long), _CHANCE))
    for frequency in others:
        if _near_any(frequency, found, apart):
            continue
        less = _without(long, frequency)
        if (after := _as_noise(less)) + by_chance < before:
            found.append(frequency)
            long, before = less, after
    return _put_back(left, long), found


def _near_any(frequency: float, others: Sequence[float], apart: float) -> bool:
    return any(abs(frequency - each) < apart for each in others)


def _put_back(segments: Sequence[Array], less: Sequence[Array]) -> list[Array]:
    """Segments, those that are long enough as they have become."""
    cleared = iter(less)
    return [next(cleared) if len(each) >= _SHORTEST else each for each in segments]


def _as_noise(segments: Sequence[Array], order: int | None = None) -> float:
    """The criterion of an autoregression of an order, 0 of white noise; None: of the best one."""
    noise, many = autoregression(segments, order), sum(map(len, segments))
    return float(many * np.log(noise.sigma**2) + noise.order * np.log(many))


def _highest(segments: Sequence[Array]) -> float:
    """[cycles a sample] of the highest peak of the segments' spectra."""
    longest = max(map(len, segments))
    size = int(next_fast_len(_FINER * longest, real=True))
    power = np.sum([np.abs(rfft(each - each.mean(), size)) ** 2 for each in segments], axis=0)
    first = _SLOWEST * size // longest
    return float(first + np.argmax(power[first:])) / float(size)


def _without(segments: Sequence[Array], frequency: float) -> list[Array]:
    """Without a tone of this frequency, of each segment by least squares."""
    found = []
    for each in segments:
        turn = 2.0 * np.pi * frequency * np.arange(len(each))
        waves = np.column_stack([np.ones(len(each)), np.cos(turn), np.sin(turn)])
        fitted = np.linalg.lstsq(waves, each, rcond=None)[0]
        found.append(each - waves[:, 1:] @ fitted[1:])
    return found


def amplitude_of(segments: Sequence[Array], frequency: float) -> float:
    """Of a tone [cycles a sample] in segments (n,), root mean square over these."""
    long = [each for each in segments if len(each) >= _SHORTEST]
    pairs = zip(long, _without(long, frequency), strict=True)
    lost = sum(float(np.sum((each - each.mean()) ** 2) - np.sum((less - less.mean()) ** 2)) for each, less in pairs)
    return float(np.sqrt(2.0 * max(lost, 0.0) / max(sum(map(len, long)), 1)))


def made_by_an_effect(frequency_Hz: float, columns: Collection[int], rate_Hz: float, unsure_Hz: float) -> bool:
    """Whether an effect of the catalogue makes a tone on such channels: it is then a cause, and else the noise's own.

    Args:
        frequency_Hz: as it is seen. columns: the channels that have it.
        rate_Hz: of the readings, which folds higher ones. unsure_Hz: how well the frequency is known.
    """
    for effect in (each for each in EFFECTS.values() if each.tone):
        reached = {c for place in effect.places for c in range(6)[COLUMNS_OF.get(place, slice(0, 6))]}
        if set(columns) <= reached and (
            not effect.bands or any(_folded(frequency_Hz, band, rate_Hz, unsure_Hz) for band in effect.bands)
        ):
            return True
    return False


def _folded(frequency_Hz: float, band: tuple[float, float], rate_Hz: float, unsure_Hz: float) -> bool:
    """Whether readings so far apart may show a frequency of a band as another."""
    turns = rate_Hz * np.arange(np.ceil(band[1] / rate_Hz) + 1.0)
    near = np.concatenate([turns + frequency_Hz, turns - frequency_Hz])
    return bool(np.any((near >= band[0] - unsure_Hz) & (near <= band[1] + unsure_Hz)))


def tone_words(floors: Sequence[Sequence[ChannelNoise]]) -> list[str]:
    """What recordings at rest have of tones, for whoever reads of a hum.

    Args:
        floors: of each recording, of its channels.
    """
    heard: dict[tuple[str, bool], list[str]] = {}
    for floor in floors:
        for channel, noise in zip(CHANNELS, floor, strict=True):
            for each in noise.tones_Hz:
                channels = heard.setdefault((f"{each:.3g}", each in dict(noise.hums)), [])
                channels += [channel] if channel not in channels else []
    return [
        f"{TONE_AT_REST} of {each} Hz on {', '.join(channels)}: a hum of that frequency is there without motion"
        + ", is taken for noise, and out of the readings" * noise
        for (each, noise), channels in heard.items()
    ]
