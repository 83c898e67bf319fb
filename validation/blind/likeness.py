"""Which other effects of the catalogue would leave as good as nothing of a change: the declared equivalents.

Computed from the truth: for every candidate the part of the true change, whitened and projected, that no strength and
no shape of the candidate explains. Below one standard deviation nobody can tell the two.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from rig.arrays import Array
from rig.effects import EFFECTS, Effect, Kind
from rig.signals import Signals, sampled
from validation.blind.projection import Projection
from validation.blind.settings import RATE_HZ, Setting

Label = tuple[str, str]

#: What is left of the true change, in standard deviations: below the first nobody can tell, below the second the data
#: may well mislead an honest judge.
TWIN, ALIKE = 1.0, 2.5

_STEP: Final = 1e-3  # of the typical strength, for derivatives
_THINNED: Final = 8  # every so many samples
_WITH_MEMORY: Final = ("latency", "sensor_lag", "hysteresis", "motion_acceleration")
_REFINED: Final = {"base_dipole": "position_m", "bias_warmup": "tau_s"}
_BENT: Final = {"latency": "delay_s", "sensor_lag": "tau_s"}  # strengths that the readings are not straight in
_ITERATIONS: Final = 80


@dataclass(frozen=True)
class Likeness:
    """What a candidate leaves of a change: ``left`` in standard deviations of the noise."""

    effect: str
    where: str
    left: float


def candidates(signals: Signals) -> Iterator[tuple[type[Effect], dict[str, str]]]:
    """Every mean effect at every place that a recording can show, with its names; none of the log."""
    for effect in EFFECTS.values():
        if effect.kind is not Kind.MEAN or effect.of_log or effect.lacking(signals):
            continue
        choices = effect.choices()
        for where, *names in itertools.product(effect.places_on(signals), *choices.values()):
            on_links = any(name.startswith("link") for name in names)
            if where not in names and not (on_links and signals.q_encoder is None):
                yield effect, {"where": where, **dict(zip(choices, names, strict=True))}


def small_steps(effect: type[Effect]) -> Iterator[tuple[dict[str, Any], float]]:
    """Each number of an effect's strengths at a thousandth of its typical size, those beside it zero; and that size."""
    for each in effect.parameters():
        size = _STEP * each.typical
        for part in range(each.size) if each.strength else ():
            yield {each.name: size if each.size == 1 else tuple(size * (k == part) for k in range(each.size))}, size


def at_zero(effect: type[Effect]) -> dict[str, Any]:
    """All strengths of an effect, zero."""
    return {each.name: 0.0 if each.size == 1 else (0.0,) * each.size for each in effect.parameters() if each.strength}


@dataclass(frozen=True)
class _Thinned:
    """A setting at every so many of its kept samples: enough to compare smooth changes of thousands of samples."""

    setting: Setting
    projection: Projection
    signals: Signals
    every: int = _THINNED

    @classmethod
    def of(cls, setting: Setting) -> _Thinned:
        signals = sampled(setting.ideal, slice(None, None, _THINNED))
        floor = replace(setting.floor, colours={})
        projection = Projection.of(setting.rig.pipeline, signals.R_base_tool, floor, _THINNED / RATE_HZ)
        return cls(setting, projection, signals)

    def change(self, effect: Effect) -> Array:
        """(m, 6) [V] what the effect changes; those with a memory are computed at all kept samples."""
        memory = effect.name in _WITH_MEMORY
        start = self.setting.ideal if memory else self.signals
        pipeline = replace(self.setting.rig.pipeline, effects=(effect,))
        change = pipeline.expected(start, np.random.default_rng(0), effect.stage).volts - start.volts
        return np.asarray(change[:: self.every] if memory else change)

    def columns(self, effect: type[Effect], fixed: dict[str, Any]) -> Array:
        """(m, 6, k) [V] derivatives of the readings by the strengths, at zero, of all spanning shapes."""
        found = []
        for span in effect.spanning():
            shape = {**span, **fixed}
            base = self.change(effect.from_mapping(at_zero(effect) | shape)) if effect.acts_at_zero else None
            if base is not None:
                found.append(base)
            for step, _ in small_steps(effect):
                change = self.change(effect.from_mapping(shape | step))
                found.append(change if base is None else change - base)
        return np.stack(found, axis=2)

    def left(self, effect: type[Effect], fixed: dict[str, Any], target: Array) -> float:
        """The norm of what the candidate leaves of the projected target (rows,)."""
        design = self.projection(self.columns(effect, fixed))
        size = np.linalg.norm(design, axis=0)
        design = design[:, size > 0.0] / size[size > 0.0]
        if not design.shape[1]:
            return float(np.linalg.norm(target))
        gram = design.T @ design
        values, vectors = np.linalg.eigh(gram)
        kept = values > 1e-9 * values[-1]
        explained = ((vectors[:, kept].T @ (design.T @ target)) ** 2 / values[kept]).sum()
        return float(np.sqrt(max(float(target @ target) - float(explained), 0.0)))

    def bent(self, effect: type[Effect], fixed: dict[str, str], target: Array) -> float:
        """The norm of what the candidate leaves at its best strength, with its change there: a delay of half a second
        is no multiple of a short one."""
        item = next(each for each in effect.parameters() if each.name == _BENT[effect.name])

        def left(value: float) -> float:
            change = self.change(effect.from_mapping({**fixed, item.name: value}))
            return float(np.linalg.norm(target - self.projection(change)))

        design = self.projection(self.columns(effect, fixed))[:, 0]
        start = _STEP * item.typical * float(design @ target) / max(float(design @ design), 1e-300)
        low, high = sorted((0.5 * start, 1.5 * start))
        bounds = max(low, item.lower), min(high, item.upper)
        if bounds[0] >= bounds[1]:
            return float(np.linalg.norm(target))
        return float(minimize_scalar(left, bounds=bounds, method="bounded").fun)

    def refined(self, effect: type[Effect], fixed: dict[str, str], start: dict[str, Any], target: Array) -> float:
        """The same with the shape moved off its grid, by the simplex of Nelder and Mead."""
        name = _REFINED[effect.name]
        bounds = next(each for each in effect.parameters() if each.name == name)

        def left(point: Array) -> float:
            inside = np.clip(point, bounds.lower, bounds.upper)
            value: Any = float(inside[0]) if bounds.size == 1 else tuple(float(x) for x in inside)
            return self.left(effect, {**fixed, name: value}, target)

        options = {"maxfev": _ITERATIONS}
        return float(minimize(left, np.atleast_1d(start[name]), method="Nelder-Mead", options=options).fun)


def likenesses(change: Array, setting: Setting, tone_Hz: float | None = None) -> list[Likeness]:
    """The candidates that leave less than ``ALIKE`` of a change (n, 6) [V], most alike first.

    Args:
        tone_Hz: frequency of the truth where it is a tone; tones are compared at that frequency only.
    """
    thinned = _Thinned.of(setting)
    seen = change[::_THINNED]
    target = thinned.projection(seen)
    scale = setting.projection.snr(change) / float(np.linalg.norm(target))  # coloured floors and thinning: all alike
    found: dict[Label, float] = {}
    for effect, fixed in candidates(setting.ideal):
        if effect.tone and (tone_Hz is None or not in_band(effect, tone_Hz)):
            continue
        shapes: list[dict[str, Any]] = [{"freq_Hz": tone_Hz}] if effect.tone else list(effect.searched(thinned.signals))
        elsewhere = seen * (np.abs(thinned.columns(effect, {**fixed, **shapes[0]})).max(axis=(0, 2)) == 0.0)
        if scale * thinned.projection.snr(elsewhere) > ALIKE:
            continue
        lefts = [thinned.left(effect, {**fixed, **shape}, target) for shape in shapes]
        best = int(np.argmin(lefts))
        left = lefts[best]
        if effect.name in _REFINED and scale * left > ALIKE:
            left = thinned.refined(effect, fixed, shapes[best], target)
        if effect.name in _BENT and scale * left > TWIN:
            left = min(left, thinned.bent(effect, fixed, target))
        label = (effect.name, fixed["where"])
        found[label] = min(scale * left, found.get(label, np.inf))
    ordered = sorted(found.items(), key=lambda item: item[1])
    return [Likeness(name, where, left) for (name, where), left in ordered if left < ALIKE]


def columns_at(effect: type[Effect], fixed: dict[str, Any], setting: Setting) -> Array:
    """(n, 6, k) [V] at all kept samples: derivatives by the strengths, at zero, of all spanning shapes."""
    whole = _Thinned(setting, setting.projection, setting.ideal, 1)
    return whole.columns(effect, fixed)


def in_band(effect: type[Effect], frequency_Hz: float) -> bool:
    """Whether a tone, sampled, could be one of the effect's: frequencies fold at half the sampling rate."""
    if not effect.bands:
        return True
    folded = abs((frequency_Hz + 0.5 * RATE_HZ) % RATE_HZ - 0.5 * RATE_HZ)
    grid = np.concatenate([np.linspace(low, high, 101) for low, high in effect.bands])
    near = np.abs(np.abs((grid + 0.5 * RATE_HZ) % RATE_HZ - 0.5 * RATE_HZ) - folded)
    return bool(near.min() < 0.01)
