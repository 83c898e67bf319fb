"""The parts of a sensor's calibration: a field's direction, one axis, and its quality."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Self

from estimators._json import AsJson, Reader
from rig.arrays import Array
from rig.documents import plain
from rig.errors import RigError

#: Residuals against the floor less probable than this are a warning.
P_VALUE_LIMIT: Final = 1e-3
#: Beyond this condition the last digits of the readings decide the answer.
CONDITION_LIMIT: Final = 1e6


@dataclass(frozen=True, eq=False)
class FieldDirection:
    """The direction of gravity or of the magnetic field.

    Attributes:
        phi_deg, psi_deg: Renk (12) [deg].
        vector: (3,) unit vector, base frame. covariance: (3, 3) of it, of rank 2.
    """

    phi_deg: float
    psi_deg: float
    vector: Array
    covariance: Array

    def to_json(self) -> dict[str, Any]:
        """The contract's object."""
        own = {"phi_deg": self.phi_deg, "psi_deg": self.psi_deg}
        return {**own, "vector": plain(self.vector), "vector_covariance": plain(self.covariance)}

    @classmethod
    def read(cls, reader: Reader) -> Self:
        """From the contract's object."""
        return cls(
            reader.number("phi_deg"),
            reader.number("psi_deg"),
            reader.array("vector", (3,)),
            reader.array("vector_covariance", (3, 3), missing=math.nan),
        )


@dataclass(frozen=True, eq=False)
class AxisCalibration:
    """One axis of a sensor.

    Attributes:
        sensitivity: S [recorded unit per field unit]. offset: delta [recorded unit].
        beta_deg, gamma_deg: Renk (6) [deg].
        axis: (3,) unit vector, frame 6. covariance: (3, 3) of it, of rank 2.
        field: its own field direction, in separate fits.
    """

    sensitivity: float
    offset: float
    beta_deg: float
    gamma_deg: float
    axis: Array
    covariance: Array
    field: FieldDirection | None = None

    def to_json(self) -> dict[str, Any]:
        """The contract's object."""
        content: dict[str, Any] = {
            "sensitivity": self.sensitivity,
            "offset": self.offset,
            "beta_deg": self.beta_deg,
            "gamma_deg": self.gamma_deg,
            "axis": plain(self.axis),
            "axis_covariance": plain(self.covariance),
        }
        return content if self.field is None else {**content, "field": self.field.to_json()}

    @classmethod
    def read(cls, reader: Reader) -> Self:
        """From the contract's object."""
        own = reader.optional("field")
        sensitivity = reader.number("sensitivity")
        if sensitivity <= 0.0:
            raise RigError(f"{reader.where}.sensitivity: found {sensitivity:g}, expected a positive number")
        return cls(
            sensitivity,
            reader.number("offset"),
            reader.number("beta_deg"),
            reader.number("gamma_deg"),
            reader.array("axis", (3,)),
            reader.array("axis_covariance", (3, 3), missing=math.nan),
            None if own is None else FieldDirection.read(own),
        )


@dataclass(frozen=True, eq=False)
class Quality(AsJson):
    """Whether a calibration is good.

    Attributes:
        chi_square: residuals against the noise floor: ``value``, ``degrees_of_freedom``, ``p_value``, and
            ``residual_over_floor`` of each channel; None without a floor.
        condition: of the Fisher information scaled to a unit diagonal; infinite where something is not told.
        field_agreement: of separate fits: ``chi_square``, ``degrees_of_freedom``, ``p_value`` of one common field.
        coverage, repeats, clipped, outliers: what the readings themselves show, where that was looked for.
        verdict: of ``estimators.judged``: whether it is ``good``, in words (``text``), with ``reasons``, ``remarks``
            and each test's figures; None where it was not asked.
        warnings: in words.
    """

    chi_square: Mapping[str, Any] | None = None
    condition: float = math.inf
    field_agreement: Mapping[str, Any] | None = None
    coverage: Any = None
    repeats: Any = None
    clipped: Any = None
    outliers: Any = None
    verdict: Mapping[str, Any] | None = None
    warnings: tuple[str, ...] = ()

    def condemned(self, reasons: Sequence[str]) -> Self:
        """With a verdict of not good for these ``reasons``, where there is a verdict at all."""
        if self.verdict is None:
            return self
        text = f"not good: because {'; '.join(reasons)}"
        return replace(self, verdict={**self.verdict, "good": False, "reasons": list(reasons), "text": text})

    @classmethod
    def read(cls, reader: Reader) -> Self:
        """From the contract's object."""
        return cls(
            reader.plain("chi_square"),
            reader.number("condition", missing=math.inf),
            reader.plain("field_agreement"),
            reader.plain("coverage"),
            reader.plain("repeats"),
            reader.plain("clipped"),
            reader.plain("outliers"),
            None if (verdict := reader.optional("verdict")) is None else _verdict(verdict),
            reader.strings("warnings", missing=()),
        )


def _verdict(reader: Reader) -> Mapping[str, Any]:
    if not isinstance(reader.plain("good"), bool):
        raise RigError(f"{reader.where}.good: found {reader.plain('good')!r}, expected true or false")
    reader.text("text")
    reader.strings("reasons")
    return reader.content
