"""The calibration contract ``rig-calibration/1``: what was found out about each sensor, and how to use it.

JSON has no NaN: what cannot be told is null there and NaN here. Numbers are written with all their digits, so a
calibration that is written and read again is the same to the last bit.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, Self

import numpy as np
from scipy.special import ndtri, stdtrit

from estimators._json import Reader, dump
from estimators.calibration.parts import AxisCalibration, FieldDirection, Quality
from estimators.calibration.table import summary
from rig.arrays import Array
from rig.channels import MAGNETOMETER, READS, SENSORS
from rig.documents import parse_json, plain, read_bytes
from rig.errors import RigError, check_name, shown, unknown_name
from rig.files import write_text
from rig.units import FIELD_UNITS, UNITS, parameter_unit

#: The format of a calibration, version included.
FORMAT: Final = "rig-calibration/1"
_NO_NUMBERS: Final = np.empty(0)


@dataclass(frozen=True, eq=False, kw_only=True)
class SensorCalibration:
    """One sensor's calibration.

    Attributes:
        method: "simultaneous", "separate", or that of an attitude-free estimator.
        unit: the recorded unit of ``offset`` and ``bias``.
        field_unit: of the field: "m_s2", or "G", "uT", "nT" of a magnetic one; None: it was relative, or not said.
        reads: of an accelerometer, "g-a" or "a-g": its field, and the one along which its axes lie; None: "g-a".
        reference_magnitude: of the field [m/s^2, field unit].
        matrix, bias: (3, 3), (3,): field = matrix @ (reading - bias), in frame 6; the accelerometer's field is what it
            ``reads``. The matrix is NaN where two axes are parallel.
        parameters, values: (p,) names and estimates: angles in degrees, the rest in recorded and field units.
        covariance: (p, p) of ``values``; NaN in rows and columns of what cannot be told.
        identifiable: per parameter True, or why it cannot be told.
        samples: how many it comes from.
        fit_rms: (3,) root mean square residual of each channel [recorded unit].
        axes: the three axes; empty if attitude-free.
        angles_between_deg, angles_between_std_deg: ``1-2``, ``1-3``, ``2-3``.
        field_direction: of the field; for separate fits the one all three agree on best; None if attitude-free.
        vector_parameters, vector_values, vector_covariance: as ``parameters`` with the components of unit vectors in
            place of angles; whatever could be fitted can be told in this form.
        noise: (3,) standard deviation of a reading that the covariance rests on [recorded unit].
        noise_source: "locked recording", "given" or "residuals".
        noise_degrees_of_freedom: (3,) where the noise was estimated from residuals.
        weighting: of the channels: "likelihood", by the inverse of each one's variance, or "equal", as in the paper;
            None for separate fits.
        convention: which of (f, P), (-f, -P) was chosen.
        quality: whether it is good.
        extra: further JSON keys, which are kept as they are.
    """

    method: str
    unit: str
    reference_magnitude: float
    matrix: Array
    bias: Array
    parameters: tuple[str, ...]
    values: Array
    covariance: Array
    identifiable: Mapping[str, bool | str]
    samples: int
    fit_rms: Array
    axes: tuple[AxisCalibration, ...] = ()
    angles_between_deg: Mapping[str, float] = field(default_factory=dict)
    angles_between_std_deg: Mapping[str, float] = field(default_factory=dict)
    field_direction: FieldDirection | None = None
    vector_parameters: tuple[str, ...] = ()
    vector_values: Array = field(default_factory=lambda: _NO_NUMBERS)
    vector_covariance: Array = field(default_factory=lambda: np.empty((0, 0)))
    noise: Array | None = None
    noise_source: str | None = None
    noise_degrees_of_freedom: Array | None = None
    weighting: str | None = None
    convention: str | None = None
    quality: Quality = field(default_factory=Quality)
    reads: str | None = None
    field_unit: str | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)

    @property
    def fit_rms_root_sum_square(self) -> float:
        """Root of the summed squares of ``fit_rms``: the paper's data-fit error of a simultaneous fit [recorded
        unit]."""
        return float(np.sqrt(np.square(self.fit_rms).sum()))

    @property
    def sensitivity(self) -> Array:
        """(3,) S [recorded unit per field unit]; not of attitude-free calibrations."""
        return np.array([axis.sensitivity for axis in self.axes])

    @property
    def offset(self) -> Array:
        """(3,) delta [recorded unit]; not of attitude-free calibrations."""
        return np.array([axis.offset for axis in self.axes])

    @property
    def axis_vectors(self) -> Array:
        """(3, 3) unit vectors P_k as rows, frame 6; not of attitude-free calibrations."""
        return np.array([axis.axis for axis in self.axes])

    def warned(self, *words: str) -> Self:
        """With further warnings of its quality, behind those it has."""
        return replace(self, quality=replace(self.quality, warnings=(*self.quality.warnings, *words)))

    def unit_of(self, name: str) -> str:
        """The unit of a parameter of either form as readers write it: "V/G", "V/field" without ``field_unit``."""
        return parameter_unit(name, self.unit, self.field_unit)

    def value(self, name: str) -> float:
        """The estimate of a parameter; of either form, angles or components."""
        return float(self._row(name)[0])

    def std(self, name: str) -> float:
        """The standard deviation of a parameter, of either form; NaN where it cannot be told."""
        return float(self._row(name)[1])

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """A confidence interval: normal, or Student's where the noise was estimated (with the fewest degrees of any
        channel)."""
        value, std = self._row(name)
        upper = 0.5 * (1.0 + level)
        freedom = self.noise_degrees_of_freedom
        width = ndtri(upper) if freedom is None else stdtrit(float(np.min(freedom)), upper)
        return float(value - width * std), float(value + width * std)

    def _row(self, name: str) -> tuple[float, float]:
        for names, values, covariance in (
            (self.parameters, self.values, self.covariance),
            (self.vector_parameters, self.vector_values, self.vector_covariance),
        ):
            if name in names:
                row = names.index(name)
                return float(values[row]), float(np.sqrt(covariance[row, row]))
        raise unknown_name("parameter", name, (*self.parameters, *self.vector_parameters))

    def to_json(self) -> dict[str, Any]:
        """The contract's object."""

        def some(*names: str) -> dict[str, Any]:
            return {name: getattr(self, name) for name in names}

        content = some("method", "unit", "reference_magnitude")
        if self.axes:
            content |= some("axes", "angles_between_deg", "angles_between_std_deg")
        if self.field_direction is not None:
            content["field"] = self.field_direction
        content |= {**some("matrix", "bias"), "use": "field = matrix @ (reading - bias)"}
        content |= some("fit_rms", "fit_rms_root_sum_square", "parameters", "values", "covariance", "identifiable")
        content |= some("samples", "quality")
        stated = some("noise", "noise_degrees_of_freedom", "noise_source", "weighting", "convention")
        stated |= some("reads", "field_unit")
        content |= {name: value for name, value in stated.items() if value is not None}
        if self.vector_parameters:
            content |= some("vector_parameters", "vector_values", "vector_covariance")
        found: dict[str, Any] = plain(content | dict(self.extra))
        return found

    @classmethod
    def read(cls, reader: Reader, field_units: Sequence[str]) -> Self:
        """From the contract's object.

        Args:
            reader: of the object.
            field_units: those its field may have. The only one holds where the object, of before there was the key,
                does not say it.

        Raises:
            RigError: a key is missing or holds something else.
        """
        axes = tuple(AxisCalibration.read(item) for item in reader.items("axes")) if reader.plain("axes") else ()
        if len(axes) not in (0, 3):
            raise RigError(f"{reader.where}.axes: found {len(axes)}, expected three")
        parameters = reader.strings("parameters")
        p = len(parameters)
        direction = reader.optional("field")
        found = None if direction is None else FieldDirection.read(direction)
        identifiable = reader.within("identifiable")
        for name, told in identifiable.content.items():
            if told is not True and not isinstance(told, str):
                raise RigError(f"{identifiable.where}.{name}: found {told!r}, expected true or the reason why not")
        vector_parameters = reader.strings("vector_parameters", missing=())
        v = len(vector_parameters)
        return cls(
            method=reader.text("method"),
            unit=_unit(reader),
            reference_magnitude=reader.number("reference_magnitude"),
            matrix=_invertible(reader.array("matrix", (3, 3), missing=math.nan, required=True), reader.where),
            bias=reader.array("bias", (3,)),
            parameters=parameters,
            values=reader.array("values", (p,), missing=math.nan)
            if "values" in reader.content
            else _values(parameters, axes, found),
            covariance=reader.covariance("covariance", p, required=True),
            identifiable=dict(identifiable.content),
            samples=reader.whole("samples"),
            fit_rms=reader.array("fit_rms", (3,)),
            axes=axes,
            angles_between_deg=reader.numbers("angles_between_deg"),
            angles_between_std_deg=reader.numbers("angles_between_std_deg"),
            field_direction=found,
            vector_parameters=vector_parameters,
            vector_values=reader.array("vector_values", (v,)) if v else _NO_NUMBERS,
            vector_covariance=reader.covariance("vector_covariance", v),
            noise=_optional(reader, "noise"),
            noise_source=reader.optional_text("noise_source"),
            noise_degrees_of_freedom=_optional(reader, "noise_degrees_of_freedom"),
            weighting=reader.optional_text("weighting"),
            convention=reader.optional_text("convention"),
            reads=_reads(reader),
            field_unit=_field_unit(reader, field_units),
            quality=Quality() if (quality := reader.optional("quality")) is None else Quality.read(quality),
            extra={name: value for name, value in reader.content.items() if name not in _KNOWN},
        )


_KNOWN: Final = frozenset(
    (
        *(name for name in SensorCalibration.__dataclass_fields__ if name not in ("field_direction", "extra")),
        *("field", "use", "fit_rms_root_sum_square"),
    )
)


def _invertible(matrix: Array, where: str) -> Array:
    largest = np.abs(matrix).max()
    if np.isfinite(largest) and np.linalg.matrix_rank(matrix / max(largest, 1e-300)) < 3:
        raise RigError(f"{where}.matrix: found one that loses a direction, expected one with an inverse")
    return matrix


def _optional(reader: Reader, name: str) -> Array | None:
    return None if reader.plain(name) is None else reader.array(name, (3,))


def _reads(reader: Reader) -> str | None:
    found = reader.optional_text("reads")
    if found is not None and found not in READS:
        raise RigError(f"{reader.where}.reads: found {found!r}, expected {' or '.join(READS)}")
    return found


def _unit(reader: Reader) -> str:
    """The recorded unit: one that recordings can have."""
    found = reader.text("unit", missing="V")
    if found not in (known := sorted({unit for units in UNITS.values() for unit in units})):
        raise RigError(f"{reader.where}.unit: {unknown_name('unit', found, known)}")
    return found


def _field_unit(reader: Reader, known: Sequence[str]) -> str | None:
    found = reader.optional_text("field_unit")
    if found is not None and found not in known:
        raise RigError(f"{reader.where}.field_unit: {unknown_name('unit', found, known)}")
    return known[0] if len(known) == 1 else found


def _values(names: tuple[str, ...], axes: tuple[AxisCalibration, ...], common: FieldDirection | None) -> Array:
    """Estimates in the order of ``names``, of a file that has them only in ``axes`` and ``field``."""
    known: dict[str, float] = {}
    directions = {"": common} | {str(k): axis.field for k, axis in enumerate(axes, 1)}
    for k, axis in enumerate(axes, 1):
        known |= {f"sensitivity{k}": axis.sensitivity, f"offset{k}": axis.offset}
        known |= {f"beta{k}_deg": axis.beta_deg, f"gamma{k}_deg": axis.gamma_deg}
    for suffix, direction in directions.items():
        if direction is not None:
            known |= {f"phi{suffix}_deg": direction.phi_deg, f"psi{suffix}_deg": direction.psi_deg}
    return np.array([known.get(name, math.nan) for name in names])


@dataclass(frozen=True, eq=False)
class Calibration:
    """What is known about the sensors of one recording.

    Attributes:
        sensors: "accelerometer", "magnetometer" -> its calibration.
        recording: the name of the recording it comes from.
        arm: the arm whose kinematics gave the orientations; None from tool poses.
        extra: further JSON keys, which are kept as they are; ``recordings``, of several calibrated together: sensor ->
            what each of them adds (``estimators.known_angle.together.contributions``).
    """

    sensors: Mapping[str, SensorCalibration]
    recording: str = ""
    arm: str | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)

    def __getitem__(self, sensor: str) -> SensorCalibration:
        """The calibration of one sensor.

        Raises:
            RigError: there is none.
        """
        check_name("calibrated sensor", sensor, self.sensors)
        return self.sensors[sensor]

    def with_field_unit(self, unit: str | None) -> Self:
        """With the magnetic field's unit, where the calibration does not say it itself.

        Args:
            unit: "G", "uT" or "nT"; None: not known.
        """
        own = self.sensors.get(MAGNETOMETER)
        if own is None or own.field_unit is not None:
            return self
        return replace(self, sensors={**self.sensors, MAGNETOMETER: replace(own, field_unit=unit)})

    def __str__(self) -> str:
        """A readable table."""
        return summary(self)

    def to_json(self) -> dict[str, Any]:
        """The contract's object."""
        content = {
            "format": FORMAT,
            "recording": self.recording,
            "arm": self.arm,
            "sensors": {name: sensor.to_json() for name, sensor in self.sensors.items()},
        }
        return content | dict(self.extra)

    def to_text(self) -> str:
        """The contract's text: ``to_json``, indented."""
        return dump(self.to_json())

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the contract's file, whole or not at all."""
        write_text(path, self.to_text())

    @classmethod
    def from_text(cls, text: str | bytes, where: str = "calibration") -> Self:
        """Read the contract's text.

        Raises:
            RigError: not JSON, another format, or a key that is missing or holds something else; ``where`` begins it.
        """
        content = parse_json(text, where, "a calibration")
        reader = Reader(content, where)
        if (found := reader.plain("format")) != FORMAT:
            raise RigError(f"{where}: format: found {shown(found)}, expected {FORMAT!r}")
        inside = reader.within("sensors")
        if not inside.content:
            raise RigError(f"{inside.where}: found no sensor, expected {' or '.join(SENSORS)}")
        for name in inside.content:
            if name not in SENSORS:
                raise RigError(f"{inside.where}: {unknown_name('sensor', name, SENSORS)}")
        return cls(
            sensors={name: SensorCalibration.read(inside.within(name), FIELD_UNITS[name]) for name in inside.content},
            recording=reader.text("recording", missing=""),
            arm=reader.optional_text("arm"),
            extra={
                name: value for name, value in content.items() if name not in ("format", "recording", "arm", "sensors")
            },
        )

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Self:
        """Read the contract's file.

        Raises:
            RigError: no such file, or as of ``from_text``.
        """
        return cls.from_text(read_bytes(path, "a calibration"), str(path))
