"""The bound of one sensor's parameters: what the best calibration from these samples will be uncertain by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from estimators.known_angle.model import Method
from rig.arrays import Array
from rig.documents import plain


@dataclass(frozen=True, eq=False)
class Prediction:
    """The bound of one sensor's parameters, in the order and units of a calibration; angles in degrees.

    Attributes:
        method: of the calibration; of an ellipsoid's the parameters are ``gain11`` .. [recorded unit per field unit]
            and ``offset1`` .. [recorded unit].
        samples: n. noise: (3,) standard deviation of a reading [recorded unit].
        names, values: (p,) parameters. std: (p,) their standard deviations; NaN where they cannot be told.
        untold: name -> why it cannot be told.
        condition: of the Fisher information scaled to a unit diagonal; infinite where something is not told.
        problem: why a calibration from these samples would be refused; None where it would not.
    """

    method: Method | Literal["ellipsoid"]
    samples: int
    noise: Array
    names: tuple[str, ...]
    values: Array
    std: Array
    untold: Mapping[str, str]
    condition: float
    problem: str | None

    def to_json(self) -> dict[str, Any]:
        """A JSON object; what cannot be told is null."""
        own = {name: plain(getattr(self, name)) for name in ("method", "samples", "noise", "condition", "problem")}
        rows = zip(self.names, plain(self.values), plain(self.std), strict=True)
        told = {name: {"value": value, "std": std, "told": self.untold.get(name, True)} for name, value, std in rows}
        return {**own, "parameters": told}


@dataclass(frozen=True, eq=False)
class KnownAnglePrediction(Prediction):
    """The bound of a calibration at known angles, of its directions too.

    Attributes:
        axis_std_deg: (3,) root mean square angle between each axis and its estimate [deg]; NaN where it is not told.
        field_std_deg: the same of the field: (1,), or (3,) of separate fits.
        angles_between_std_deg: of the angles between axes, by ``1-2``, ``1-3``, ``2-3`` [deg].
    """

    axis_std_deg: Array
    field_std_deg: Array
    angles_between_std_deg: Mapping[str, float]

    def to_json(self) -> dict[str, Any]:
        """A JSON object; what cannot be told is null."""
        own = ("axis_std_deg", "field_std_deg", "angles_between_std_deg")
        return {**super().to_json(), **{name: plain(getattr(self, name)) for name in own}}
