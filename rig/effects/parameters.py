"""The parameters of an effect, declared once: simulator, diagnosis, report and documentation read them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np

from rig.environment import MAGNITUDES

Value = float | tuple[float, ...]


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Attributes:
        name, unit: as in the catalogue.
        typical: typical size, in ``unit``; a starting point with a guess's weight.
        lower, upper: bounds, in ``unit``.
        size: number of components (1 for a scalar).
        strength: True where the effect vanishes with this parameter at ``neutral``; the others shape it.
        neutral: the value of a strength that changes nothing, zero but for a level that nothing reaches.
        spanned: values of a shape whose effects span, to first order in the strength, those of all other values: a sine
            and a cosine span every phase. Such a shape need not be searched.
        grid: values to search where a shape is not spanned; empty where they depend on the recording (``searched``).
        scatter: True where it is the strength of noise that a mean effect has beside the mean (``Effect.response``):
            it does not move the mean.
        by_axis: True where its components are those of single axes, of which one alone may be at fault.
        of_cosines: True where its components are those of cosines over the recording, from half a wave on: of a course
            that may be as smooth as any.
        unit_vector: True where only its direction counts, not its length.
        step: change of it, in ``unit``, over which a derivative is taken: small against any curvature, large against
            rounding.
    """

    name: str
    unit: str
    typical: float
    lower: float = -np.inf
    upper: float = np.inf
    size: int = 1
    strength: bool = True
    neutral: float = 0.0
    spanned: tuple[Value, ...] = ()
    grid: tuple[Value, ...] = ()
    scatter: bool = False
    by_axis: bool = False
    of_cosines: bool = False
    unit_vector: bool = False
    step: float = 0.0

    def holds(self, value: object) -> bool:
        """Whether a value is a float, or a tuple of as many as it should be, within bounds."""
        values = value if type(value) is tuple else (value,)
        if len(values) != self.size or (self.size > 1) is not (type(value) is tuple):
            return False
        low, high = max(self.lower, -MAGNITUDES[1]), min(self.upper, MAGNITUDES[1])
        return all(type(each) is float and low <= each <= high for each in values)


@lru_cache(maxsize=1024)
def parameters_of(effect: type) -> tuple[Parameter, ...]:
    """The parameters of an effect's class, in its order."""
    declared = ((item.name, item.metadata.get("parameter")) for item in dataclasses.fields(effect))
    return tuple(dataclasses.replace(own, name=name) for name, own in declared if own is not None)


@lru_cache(maxsize=1024)
def choices_of(effect: type) -> dict[str, tuple[str, ...]]:
    """The fields of an effect's class that are names, each with the names it may be."""
    return {item.name: item.metadata["choices"] for item in dataclasses.fields(effect) if "choices" in item.metadata}


def parameter(
    unit: str,
    typical: float,
    *,
    size: int = 1,
    strength: bool = True,
    neutral: float = 0.0,
    default: float | tuple[float, ...] | None = None,
    step: float | None = None,
    **more: Any,
) -> Any:
    """A dataclass field that is a parameter of the effect; a strength starts neutral, a shape at its typical size.

    Args:
        unit, typical, size, strength, neutral, more: as of ``Parameter``.
        default: where it starts otherwise.
        step: a thousandth of the typical size where it is None.
    """
    start: Any = default if default is not None else (neutral if strength else typical)
    if size > 1 and not isinstance(start, tuple):
        start = (start,) * size
    step = 1e-3 * typical if step is None else step
    own = Parameter("", unit, typical, size=size, strength=strength, neutral=neutral, step=step, **more)
    return dataclasses.field(default=start, metadata={"parameter": own})


def choice(choices: Sequence[str], default: str | None = None) -> Any:
    """A dataclass field that is one of several names; required where there is no default."""
    meta = {"choices": tuple(choices)}
    return dataclasses.field(metadata=meta) if default is None else dataclasses.field(default=default, metadata=meta)


QUADRATURE: Final = (0.0, np.pi / 2.0)


def frequency(typical: float) -> Any:
    """A dataclass field that is the frequency of a sine in time [Hz].

    Its step turns the sine by less than a hundredth of a cycle in a day: a recording tells frequencies as finely as it
    is long.
    """
    return parameter("Hz", typical, lower=0.0, upper=1000.0, strength=False, step=1e-7)


def phase() -> Any:
    """A dataclass field that is the phase of a sine [rad]."""
    return parameter("rad", np.pi, strength=False, default=0.0, spanned=QUADRATURE)
