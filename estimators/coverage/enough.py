"""When a maneuver may stop: as soon as the parameters would be known as well as they have to be.

The rule asks the Fisher information of what was recorded so far for the standard deviation of each parameter, and
compares it with a target. The number of samples, or of cells, does not enter: a million readings of one hemisphere are
not enough where the other one is needed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from estimators.coverage.attitude_free_information import AttitudeFreeInformation, Parameters
from estimators.coverage.cells import SphereCells
from estimators.coverage.direction_names import direction_name
from estimators.coverage.seen import Coverage, coverage
from estimators.known_angle.identifiability import Information
from estimators.known_angle.model import columns_by_name
from rig.arrays import Array
from rig.documents import plain
from rig.errors import RigError

_CANDIDATES: Final = 500
#: Beyond a tenth of itself (of a radian) a parameter cannot be told: a data sheet knows it better.
UNTOLD: Final = 0.1


@dataclass(frozen=True)
class Targets:
    """How well the parameters have to be known: standard deviations.

    Attributes:
        sensitivity: relative. offset: share of the field (1e-3: one milligram).
        axis_deg: of an axis in frame 6, or of the angle between two axes [deg].
        field_deg: of the field's direction in the base frame [deg]; None: it does not matter.

    Raises:
        RigError: a value that is not positive.
    """

    sensitivity: float = 1e-3
    offset: float = 1e-3
    axis_deg: float = 0.1
    field_deg: float | None = None

    def __post_init__(self) -> None:
        for name in ("sensitivity", "offset", "axis_deg", "field_deg"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise RigError(f"targets.{name}: found {value}, expected a positive number")

    def of(self, name: str) -> float | None:
        """The target of a parameter by its name, relative or in radians."""
        if name.startswith("sensitivity"):
            return self.sensitivity
        if name.startswith("offset"):
            return self.offset
        degrees = self.field_deg if name.startswith("field") else self.axis_deg
        return None if degrees is None else float(np.radians(degrees))


@dataclass(frozen=True, eq=False)
class Enough:
    """Whether it is enough now.

    Attributes:
        enough: every parameter reaches its target.
        std, target: per parameter, relative (sensitivity, offset as a share of the field) or in radians; infinite
            where it cannot be told.
        worst: the parameter farthest from its target. ratio: its standard deviation over its target.
        more: how many times as much again, of the same mix of directions, would be enough; zero where it is enough,
            infinite where no amount of it would be.
        coverage: the directions seen so far and those still missing, in the sensor's frame.
        next_direction: (3,) unit vector from which readings would tell most; None where only the missing directions
            are known.
    """

    enough: bool
    std: Mapping[str, float]
    target: Mapping[str, float]
    worst: str
    ratio: float
    more: float
    coverage: Coverage
    next_direction: Array | None = None

    @property
    def untold(self) -> tuple[str, ...]:
        """The parameters that cannot be told."""
        return tuple(name for name, value in self.std.items() if value > UNTOLD)

    def __str__(self) -> str:
        """One line."""
        toward = "" if self.next_direction is None else f"; most would be told with the field along {self._next()}"
        if self.enough:
            return f"enough: {self.worst} has {self.ratio:.3g} of its target's standard deviation"
        if self.untold:
            return f"not enough: {', '.join(self.untold)} cannot be told{toward}"
        return (
            f"not enough: {self.worst} has {self.ratio:.3g} times its target's standard deviation, {self.more:.2g}"
            f" times as much again would do{toward}"
        )

    def _next(self) -> str:
        assert self.next_direction is not None
        x, y, z = self.next_direction
        return f"{direction_name(self.next_direction)} ({x:+.2f}, {y:+.2f}, {z:+.2f})"

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {name: plain(value) for name, value in vars(self).items() if name != "coverage"}


def enough_attitude_free(
    directions: ArrayLike,
    noise: ArrayLike,
    targets: Targets | None = None,
    counts: ArrayLike | None = None,
    parameters: Parameters = 9,
) -> Enough:
    """The rule without attitude.

    Args:
        directions: (n, 3) unit vectors of the field in the sensor's frame, seen from the fitted centre.
        noise: standard deviation of a reading as a share of the field: one number, or (3,).
        targets: None: the defaults.
        counts: (n,) readings in each direction, of averaged poses; None: one.
        parameters: nine or six.
    """
    wanted = Targets() if targets is None else targets
    information = AttitudeFreeInformation.of(directions, noise, counts, parameters)
    target = {name: value for name in information.names if (value := wanted.of(name)) is not None}
    importance = np.array([1.0 / target[name] ** 2 for name in information.names])
    candidates = SphereCells.of(_CANDIDATES).centres
    a_pose = information.readings / len(np.asarray(directions))
    gain = information.gain(candidates, noise, importance, a_pose)
    return _verdict(information.std, target, coverage(directions), candidates[int(np.argmax(gain))])


def enough_known_angles(information: Information, directions: ArrayLike, targets: Targets | None = None) -> Enough:
    """The rule with the arm's attitude.

    Args:
        information: of the fit so far (``SensorFit.information``), or of a plan.
        directions: (n, 3) unit vectors of the field in frame 6, for what is missing.
        targets: None: the defaults.
    """
    wanted = Targets() if targets is None else targets
    columns = columns_by_name(information.method)
    std = {name: _largest(information.covariance[own, own]) for name, own in columns.items()}
    std |= dict.fromkeys(information.undetermined(), np.inf)
    target = {name: value for name in std if (value := wanted.of(name)) is not None}
    return _verdict(std, target, coverage(directions), None)


def _largest(block: Array) -> float:
    """The standard deviation of a number, or of a direction along its least certain way [rad]."""
    return float(np.sqrt(max(0.0, float(np.linalg.eigvalsh(block)[-1]))))


def _verdict(std: Mapping[str, float], target: Mapping[str, float], seen: Coverage, best: Array | None) -> Enough:
    ratios = {name: std[name] / target[name] for name in target}
    worst = max(ratios, key=lambda name: ratios[name])
    ratio = ratios[worst]
    more = max(0.0, ratio**2 - 1.0)  # the variance falls as 1 / n
    return Enough(ratio <= 1.0, dict(std), target, worst, ratio, more, seen, best)
