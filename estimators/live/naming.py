"""Which effect of the catalogue a change looks like: a score test of each on the residuals about it.

The effects' own classes make the templates: what one unit of a parameter, set in at the change, does to the readings.
Each is fitted to the residuals; a template's gain in log likelihood is charged by half the logarithm of the samples for
each of its columns (Schwarz, "Estimating the dimension of a model", 1978), which puts those that will do in order.

An effect is named only where it leaves noise as it was before the change: what explains most of a motion or of a knock
is not what happened. Otherwise the change stays unknown.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import chdtri

from estimators.live.noise_memory import exceeded
from estimators.live.reference import Reference, Residuals
from rig.arrays import Array
from rig.channels import ACCELEROMETER, CHANNELS_OF, COLUMNS_OF, MAGNETOMETER
from rig.effects import EFFECTS
from rig.effects.base import Effect
from rig.signals import Signals

#: Names within this of the best, in twice the log likelihood (odds of e^10), are named beside it; where these are more
#: than so many, none is.
_BESIDE: Final = 20.0
_MOST_NAMES: Final = 3
#: What an effect leaves is as before unless its spread, of samples or of means of so many, is so improbable. This share
#: of a change may be left in any case: a large one is not linear.
_AS_BEFORE: Final = 1e-3
_MEANS: Final = (1, 4, 16)
_LEFT: Final = 0.01
_TAU_S: Final = 30.0
#: The instant is looked for so far on either side [s], in so many steps.
_NEAR_S: Final = 0.25
_TRIED: Final = 25
#: Residuals beyond this many standard deviations are spikes, if they are this rare.
_SPIKE, _RARE = 6.0, 0.1


@dataclass(frozen=True)
class Likeness:
    """An effect that a change looks like.

    Attributes:
        name, where: of the catalogue.
        score: twice the gain in log likelihood, less what its columns cost.
        words: its size, where it has one.
    """

    name: str
    where: str
    score: float
    words: str = ""

    def __str__(self) -> str:
        """One phrase."""
        return f"{self.name} at {self.where}{f' ({self.words})' if self.words else ''}"


def likenesses(span: Residuals, at_s: float, sensor: str, reference: Reference, unit: str) -> list[Likeness]:
    """The effects that would do, the likeliest first, each at its likeliest place; none where too many would."""
    at_s = _refined(span, at_s, sensor, reference, unit)
    after = span.t >= at_s
    n, k = int(after.sum()), span.values.shape[1]
    if n < 4 or n == len(after):
        return []
    level = span.values[~after].mean(axis=0)
    changed, before = (span.values - level)[after], (span.values - level)[~after]
    found = [*_distribution(changed, before, span, sensor)]
    for name, where, columns, words in _templates(span, at_s, sensor, reference, unit):
        gain, sizes, left = _gain(span, at_s, columns)
        if not _noise_is_left(left[after], changed, before, len(columns)):
            continue
        said = words.format(*(f"{value:+.3g}" for value in sizes))
        found.append(Likeness(name, where, gain - float(np.log(n * k)) * len(columns), said))
    good = sorted((each for each in found if each.score > 0.0), key=lambda each: -each.score)
    good = [each for each in good if each.score > good[0].score - _BESIDE]
    best = {each.name: each for each in reversed(good)}
    return [each for each in good if best[each.name] is each] if len(best) <= _MOST_NAMES else []


def _noise_is_left(left: Array, changed: Array, before: Array, columns: int) -> bool:
    """Whether an effect that turns the residuals (n, k) of a change into ``left`` leaves noise as it was ``before``."""
    excess = float(np.square(changed).sum()) - changed.size
    if excess > 0.0 and float(np.square(left).sum()) - left.size < _LEFT * excess:
        return True
    for length in _MEANS:
        own, other = (_means(each, length) for each in (left, before))
        if own.size <= columns or len(other) < 2:
            continue
        usual = max(other.var(axis=0, ddof=1).mean(), before.var(axis=0, ddof=1).mean() / length)  # white at least
        ratio = np.square(own).sum() / (own.size - columns) / usual
        if exceeded(ratio, float(own.size - columns), float(other.size - other.shape[1])) < _AS_BEFORE:
            return False
    return True


def _means(values: Array, length: int) -> Array:
    """Of successive rows (n, k), so many at a time."""
    whole = len(values) // length * length
    return np.asarray(values[:whole].reshape(-1, length, values.shape[1]).mean(axis=1))


def _gain(span: Residuals, at_s: float, columns: list[Array]) -> tuple[float, Array, Array]:
    """By how much templates (n, k) lower the sum of squares about what was before the change, their sizes, and what is
    left (n, k)."""
    before = span.t < at_s
    if not before.any():
        return -np.inf, np.zeros(len(columns)), span.values
    left = (span.values - span.values[before].mean(axis=0)).ravel()
    flat = np.stack([(column - column[before].mean(axis=0)).ravel() for column in columns], axis=1)
    size = np.sqrt(np.square(flat).sum(axis=0))
    if not (size > 0.0).all():
        return -np.inf, np.zeros(len(columns)), left.reshape(span.values.shape)
    solution, *_ = np.linalg.lstsq(flat / size, left, rcond=1e-8)
    rest = left - flat / size @ solution
    gain = float(left @ left - rest @ rest)
    return gain, np.asarray(solution / size), rest.reshape(span.values.shape)


def _refined(span: Residuals, at_s: float, sensor: str, reference: Reference, unit: str) -> float:
    """The instant, among the samples near the one that was found, from which a shift explains most [s]."""
    near = np.flatnonzero(np.abs(span.t - at_s) <= _NEAR_S)
    best = -np.inf
    for tried in span.t[near[:: max(1, len(near) // _TRIED)]].tolist():
        templates = _templates(span, tried, sensor, reference, unit)
        gain, *_ = _gain(span, tried, next(columns for _, _, columns, _ in templates if len(columns) == 3))
        if gain > best:
            best, at_s = gain, tried
    return at_s


def _distribution(changed: Array, before: Array, span: Residuals, sensor: str) -> Iterator[Likeness]:
    """Effects on the spread of the residuals (n, k), which were ``before``."""
    n, k = changed.shape
    spikes = (np.abs(changed) > _SPIKE).any(axis=1)
    if spikes.any() and spikes.mean() < _RARE and _noise_is_left(changed[~spikes], changed[~spikes], before, 0):
        yield Likeness(
            "outliers", "acquisition", float(np.square(changed[spikes]).sum()), f"{int(spikes.sum())} of {n} samples"
        )
        return
    variance = np.maximum(np.square(changed).mean(axis=0), 1e-12)
    wide = variance > 1.0
    gain = float((n * (variance - 1.0 - np.log(variance)))[wide].sum())
    scaled = changed / np.sqrt(np.maximum(variance, 1.0))
    more = _successive(changed) - _successive(before)  # of a motion, not of noise
    alike = more > np.sqrt(chdtri(1.0, _AS_BEFORE) * (1.0 / changed.size + 1.0 / before.size))
    if wide.any() and not alike and _noise_is_left(scaled, scaled, before, k):
        names = CHANNELS_OF[sensor] if k == 3 else (sensor,)
        where = ", ".join(name for name, much in zip(names, variance > 1.3, strict=True) if much) or names[0]
        cost = float(wide.sum()) * np.log(n)
        yield Likeness("noise_excess", where, gain - cost, f"{np.sqrt(variance.max()):.2g} times the noise")
    if sensor == ACCELEROMETER and n >= 32:
        waves = np.fft.rfft(changed - changed.mean(axis=0), axis=0)
        power = (np.abs(waves) ** 2).sum(axis=1)
        peak = int(np.argmax(power))
        rate = (n - 1) / max(float(span.t[-1] - span.t[-n]), 1e-9)
        alone = np.zeros_like(waves)
        alone[peak] = waves[peak]
        if _noise_is_left(changed - np.fft.irfft(alone, n, axis=0), changed, before, 2 * k):
            cost = (2.0 * k + 1.0) * np.log(n * k)
            yield Likeness(
                "vibration", "accelerometer", 2.0 * float(power[peak]) / n - cost, f"{peak * rate / n:.1f} Hz"
            )


def _successive(values: Array) -> float:
    """The correlation of successive rows (n, k)."""
    return float((values[1:] * values[:-1]).sum() / max(np.square(values).sum(), 1e-300))


def _templates(
    span: Residuals, at_s: float, sensor: str, reference: Reference, unit: str
) -> Iterator[tuple[str, str, list[Array], str]]:
    """Name, place, what each column does to the residuals (n, k), and how to say its size."""
    volts = np.full((len(span), 6), np.nan)
    volts[:, COLUMNS_OF[sensor]] = span.readings
    signals, base = Signals(span.t, volts=volts), span.readings

    def residual(change: Array) -> Array:
        """Of a change (n, 3) of the readings."""
        if reference.parameters is not None:
            return np.asarray(change / reference.noise)
        along = span.directions @ reference.matrix
        sigma = np.sqrt(np.maximum(np.square(along) @ np.square(reference.noise), 1e-300))
        return np.asarray(((along * change).sum(axis=1) / sigma)[:, None])

    def applied(name: str, **values: object) -> Array:
        effect: Effect = EFFECTS[name].from_mapping(values)
        after = effect.apply(signals, np.random.default_rng(0))
        return residual(after.volts[:, COLUMNS_OF[sensor]] - base)

    channels = CHANNELS_OF[sensor]
    steps = [applied("bias_step", where=channel, volts=1.0, at_s=at_s) for channel in channels]
    for channel, step in zip(channels, steps, strict=True):
        yield "bias_step", channel, [step], "{} " + unit
    yield "bias_step", "-".join((channels[0], channels[2][-1])), steps, "{}, {}, {} " + unit
    after = (span.t >= at_s)[:, None]
    ratio = residual(base * after)
    yield "supply_ratiometric", "supply", [ratio], "{} of the reading"
    warm = [
        applied("bias_warmup", where=sensor, coefficient=tuple(unit_vector), tau_s=_TAU_S)
        for unit_vector in np.eye(3).tolist()
    ]
    yield "bias_warmup", sensor, warm, ""
    if reference.parameters is None:
        return
    theta = reference.parameters.coefficients
    rotation = span.terms[:, :9].reshape(-1, 3, 3)
    turns = []
    for axis in np.eye(3):
        slip = EFFECTS["mounting_slip"].from_mapping({"rotation_rad": tuple(1e-3 * axis), "at_s": at_s})
        turned = slip.apply(Signals(span.t, R_base_tool=rotation), np.random.default_rng(0)).R_base_tool
        turns.append(residual(1e3 * ((turned - rotation).reshape(-1, 9) @ theta[:9])))
    yield "mounting_slip", "mount", turns, "{}, {}, {} rad"
    if sensor == MAGNETOMETER:  # of a magnet in the base, what is seen while the sensor hardly moves on
        gain = reference.parameters.gain
        fields = [residual(after * (rotation[:, axis, :] @ gain.T)) for axis in range(3)]
        yield "base_dipole", "base", fields, "{}, {}, {} of field"
