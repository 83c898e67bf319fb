"""Stated parameters beside the true ones: how often an interval holds the truth."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from rig.effects import EFFECTS
from validation.blind.truth import TrueCause, Truth

_WIDTH: Final = 1.959964  # standard deviations, two-sided 95 %
#: Of a sine the pair (amplitude, phase) is the same as (-amplitude, phase + pi); of a tone known modulo the sampling.
_UNSIGNED: Final = ("amplitude_rad", "amplitude_m_s2", "amplitude", "tilt_rad")
_PASSED_OVER: Final = ("phase_rad", "direction", "freq_Hz", "order", "waveform", "supply_V", "size_V", "jitter_s")


@dataclass(frozen=True)
class Stated:
    """One number of a cause: its effect and name, and how many standard deviations it is from the truth."""

    effect: str
    name: str
    z: float

    @property
    def holds(self) -> bool:
        """Whether the 95 % interval holds the truth."""
        return abs(self.z) <= _WIDTH


def stated(truth: Truth, answer: Mapping[str, Any]) -> Iterator[Stated]:
    """Every number with a standard deviation of every cause that carries the true name at the true place."""
    for true in truth.visible:
        found = _said(true, answer.get("causes", ()))
        if found is None or true.name != true.effect:  # another form has no such parameters
            continue
        tone = EFFECTS[true.effect].tone
        for name, value in true.parameters.items():
            estimate = found.get("parameters", {}).get(name)
            if estimate is None or name in _PASSED_OVER or isinstance(value, str):
                continue
            unsigned = name in _UNSIGNED and (tone or "phase_rad" in true.parameters)
            yield from _numbers(true.effect, name, value, estimate, unsigned)


def _said(true: TrueCause, causes: Iterable[Mapping[str, Any]]) -> Mapping[str, Any] | None:
    """The answer's cause of the true name at the true place; of several the one with the true names of sensors, axes
    and frames, such as the source of a crosstalk, else the likeliest; None where there is none."""
    named = {name: value for name, value in true.parameters.items() if isinstance(value, str)}

    def fits(cause: Mapping[str, Any]) -> tuple[int, float]:
        parameters = cause.get("parameters", {})
        same = [(parameters.get(name) or {}).get("value") == value for name, value in named.items()]
        return sum(same), float(cause.get("probability", 1.0))

    copies = [cause for cause in causes if (cause["effect"], cause["where"]) == (true.effect, true.where)]
    return max(copies, key=fits, default=None)


def _numbers(effect: str, name: str, value: Any, estimate: Mapping[str, Any], unsigned: bool) -> Iterator[Stated]:
    true, said, std = (np.atleast_1d(np.asarray(each)) for each in (value, estimate.get("value"), estimate.get("std")))
    if said.shape != true.shape or std.shape != true.shape:
        return
    for real, found, deviation in zip(true, said, std, strict=True):
        if found is None or deviation is None or not deviation > 0.0:  # not felt: nothing is claimed
            continue
        difference = abs(found) - abs(real) if unsigned else found - real
        yield Stated(effect, name, float(difference / deviation))
