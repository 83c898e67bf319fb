"""How strong an effect is to be: its projected, whitened signal-to-noise, and the strength that gives a wanted one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.optimize import brentq

from rig.arrays import Array
from rig.channels import CHANNELS, COLUMNS_OF, SENSORS
from rig.effects import Effect, Kind, apply_stage
from rig.effects.base import Stage
from rig.errors import RigError
from validation.blind.settings import RATE_HZ, Setting

Make = Callable[[float], Effect]

_TRIES: Final = 12
_STEP: Final = 2.0
_CLOSE: Final = 2e-3  # of the wanted signal-to-noise


def signal_to_noise(effects: tuple[Effect, ...], setting: Setting) -> float:
    """||M Z phi||/sigma of effects of one kind in a setting.

    For noise, the square root of twice the Kullback-Leibler divergence between the noise with and without it, which for
    small effects is the noncentrality of the score test as well; for effects on single readings, the norm of what they
    change in one realisation.
    """
    kinds = {effect.kind for effect in effects}
    if kinds == {Kind.MEAN}:
        return setting.projection.snr(setting.change(effects))
    if kinds == {Kind.NOISE}:
        return float(np.sqrt(sum(_divergence(effect, setting) for effect in effects)))
    if kinds == {Kind.DISTRIBUTION}:
        change = single_readings(effects, setting, np.random.default_rng(0))
        return float(np.linalg.norm(change / np.asarray(setting.floor.sigma_V)))
    raise RigError(f"effects of {len(kinds)} kinds at once: expected one")


def single_readings(effects: tuple[Effect, ...], setting: Setting, rng: np.random.Generator) -> Array:
    """(n, 6) [V] what effects on noisy readings change, in one realisation of the noise."""
    noisy = setting.ideal.volts + rng.standard_normal(setting.ideal.volts.shape) * setting.floor.sigma_V
    before = replace(setting.ideal, volts=noisy)
    return np.asarray(apply_stage(effects, Stage.ELECTRONIC, before, rng).volts - noisy)


def added_variance(effect: Effect, setting: Setting) -> Array:
    """(n, 6) [V^2] variance that a noise effect adds to each reading, on average over its realisations."""
    if effect.adds_in_time:
        return effect.added_variance(setting.ideal, replace(setting.rig.pipeline, effects=()))
    count = len(setting.ideal)
    variance = np.zeros((count, len(CHANNELS)))
    spectrum = effect.added_spectrum(_frequencies(count), 1.0 / RATE_HZ)
    strengths = _strengths(effect)
    touched = range(*effect.columns.indices(len(CHANNELS)))
    for column, strength in zip(touched, np.resize(strengths, len(touched)), strict=True):
        variance[:, column] = strength**2 * float(np.mean(spectrum))
    return variance


def strength_for(make: Make, wanted: float, setting: Setting) -> tuple[Effect, float]:
    """The effect at the strength that has the wanted signal-to-noise, and the signal-to-noise it has.

    Args:
        make: the effect by its strength, which is typical at one.

    Raises:
        RigError: no strength within the effect's bounds has it.
    """

    def excess(logarithm: float) -> float:
        ratio = signal_to_noise((make(float(np.exp(logarithm))),), setting) / wanted
        return float(np.log(max(ratio, 1e-9)))

    low = high = 0.0
    value = excess(0.0)
    for _ in range(_TRIES):  # it may stay the same for a while: single readings come whole
        if abs(value) < _CLOSE:
            break
        step = float(np.clip(-1.2 * value, -_STEP, _STEP))
        low, high = (high, high + step)
        before, value = value, excess(high)
        if before * value < 0.0:
            high = float(brentq(excess, min(low, high), max(low, high), xtol=_CLOSE))
            break
    else:
        raise RigError("the effect's signal-to-noise does not grow with its strength")
    effect = make(float(np.exp(high)))
    return effect, signal_to_noise((effect,), setting)


def _frequencies(count: int) -> Array:
    return np.arange(1, count // 2 + 1) / count


def _strengths(effect: Effect) -> Array:
    """The strengths of an effect; one where its spectrum has them already."""
    found = [np.atleast_1d(getattr(effect, each.name)) for each in effect.parameters() if each.strength]
    return np.concatenate(found) if found else np.ones(1)


def _divergence(effect: Effect, setting: Setting) -> float:
    sigma = np.asarray(setting.floor.sigma_V)
    count = len(setting.ideal)
    if effect.adds_in_time:
        ratio = added_variance(effect, setting) / sigma**2
        return float(np.sum(ratio - np.log1p(ratio)))
    frequency = _frequencies(count)
    added = effect.added_spectrum(frequency, 1.0 / RATE_HZ)
    touched = range(*effect.columns.indices(len(CHANNELS)))
    total = 0.0
    for column, strength in zip(touched, np.resize(_strengths(effect), len(touched)), strict=True):
        sensor = next(name for name in SENSORS if column in range(*COLUMNS_OF[name].indices(len(CHANNELS))))
        floor = setting.floor.spectrum(sensor, frequency, 1.0 / RATE_HZ) * sigma[column] ** 2
        ratio = strength**2 * added / floor
        total += 2.0 * float(np.sum(ratio - np.log1p(ratio)))
    return total
