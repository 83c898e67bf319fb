"""The parameters of a cause in words: what each is called, how large it is, and which of them mean nothing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from estimators.gap.readable_units import readable_unit
from rig.effects import EFFECTS
from rig.number_text import with_std

if TYPE_CHECKING:
    from estimators.gap.diagnosis import Cause, Estimate

#: What parameters are called, where their names are not words.
_CALLED: Final = {
    "amplitude_m_s2": "amplitude",
    "amplitude_rad": "amplitude",
    "at_s": "at",
    "chi": "susceptibility",
    "coefficient_per_degC": "coefficient",
    "delay_s": "delay",
    "droop_rad": "droop",
    "extra_sigma": "standard deviation",
    "fraction_of_full": "at full scale",
    "freq_Hz": "frequency",
    "gradient_per_m": "gradient",
    "half_width": "half-width",
    "jitter_s": "jitter",
    "lever_m": "lever",
    "lsb_V": "step",
    "node_interval_s": "interval of the nodes",
    "offset_rad": "offset",
    "phase_rad": "phase",
    "position_m": "position",
    "rotation_rad": "rotation",
    "sigma_V": "standard deviation",
    "sigma_rad": "standard deviation",
    "sigma_s": "standard deviation",
    "size_V": "size",
    "supply_V": "supply",
    "tau_s": "time constant",
    "tilt_rad": "tilt",
    "twist_rad": "twist",
    "volts": "jump",
    "width_rad": "width",
}
#: Why a phase or a direction means nothing.
_FAINT: Final = "its amplitude is not told from zero"
#: An amplitude below so many of its standard deviations may as well be zero.
_TOLD: Final = 2.0
#: So many sizes stand beside a cause's name.
_SIZES: Final = 2


def parameter_name(name: str) -> str:
    """What a parameter is called: "width" of ``width_rad``."""
    return _CALLED.get(name, name.replace("_", " "))


def told_parameters(cause: Cause) -> Mapping[str, Estimate]:
    """A cause's parameters as a reader is told them: no phase and no direction of an amplitude that may be zero.

    Both then have a value and a width in the fit, which say nothing about the rig: they count as not felt.
    """
    declared = EFFECTS[cause.effect].parameters() if cause.effect in EFFECTS else ()
    strengths = [cause.parameters[each.name] for each in declared if each.strength and each.name in cause.parameters]
    told = dict(cause.parameters)
    if len(strengths) != 1:
        return told
    faint = [_faint(value, std) for value, std in pairs(strengths[0])]
    for item in declared:
        if item.name in told and (item.spanned or item.unit_vector):
            told[item.name] = _without(told[item.name], faint)
    return told


def pairs(estimate: Estimate) -> list[tuple[float | None, float | None]]:
    """Each component of an estimate that is no name, with its standard deviation."""
    assert not isinstance(estimate.value, str)
    values = estimate.value if isinstance(estimate.value, tuple) else (estimate.value,)
    stds = estimate.std if isinstance(estimate.std, tuple) else (estimate.std,) * len(values)
    return list(zip(values, stds, strict=True))


def _faint(value: float | None, std: float | None) -> bool:
    return value is None or (std is not None and not abs(value) >= _TOLD * std)


def _without(estimate: Estimate, faint: list[bool]) -> Estimate:
    """An estimate without its components whose amplitude is faint; with one amplitude for all, all or none."""
    if isinstance(estimate.value, str) or not any(faint):
        return estimate
    values = estimate.value if isinstance(estimate.value, tuple) else (estimate.value,)
    gone = faint if len(faint) == len(values) else [all(faint)] * len(values)
    if not any(gone):
        return estimate
    left = tuple(None if without else value for value, without in zip(values, gone, strict=True))
    return replace(estimate, value=left if isinstance(estimate.value, tuple) else left[0], why=_FAINT)


def sizes_words(cause: Cause) -> str:
    """How large a cause is: "jump 48.24 +- 0.32 mV at 1493.88 +- 0.58 s"; empty where no single number says that."""
    words = ""
    sizes = [(name, text) for name, value in told_parameters(cause).items() if (text := _size(value))]
    for name, text in sizes[:_SIZES]:
        called = parameter_name(name)
        words += (" " if called == "at" else ", ") * bool(words) + f"{called} {text}"
    return words


def _size(estimate: Estimate) -> str:
    """One number that is known to a width, in units that people think in."""
    value, std = estimate.value, estimate.std
    if isinstance(value, tuple | str) or isinstance(std, tuple) or value is None or std is None:
        return ""
    known = math.isfinite(std) and std > 0.0
    scale, unit = readable_unit(estimate.unit, max(abs(value), std if known else 0.0))
    size = " +- ".join(with_std(scale * value, scale * std)) if known else f"{scale * value:.4g}"
    return f"{size} {'Hz as sampled' if unit == 'Hz' else unit}".rstrip()
