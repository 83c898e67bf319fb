"""The sections of a scenario: their keys, and what becomes of them."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Final, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from rig.arm import Arm
from rig.arrays import Array
from rig.assets import models_root
from rig.directions import direction_from_angles
from rig.environment import Environment
from rig.errors import RigError, check_name
from rig.sensor import TriaxialSensor, Triple
from rig.simulate import Engine, Motion

ARMS: Final = ("a465", "none")

FieldUnit = Literal["G", "uT", "nT"]


@dataclass(frozen=True, kw_only=True)
class RunTable:
    """The top of the file: what the scenario is, and how it runs by itself.

    Attributes:
        title: one line.
        description: what is to be seen.
        source: where the numbers come from.
        fitted_to: fingerprints of the recordings that calibration and effects were fitted to, as rig diagnose writes
            them: no recording is judged by a rig that it chose.
        engine: "kinematic" puts the joints where the maneuver wants them; "dynamic" lets position actuators drive them.
        motion: of the kinematic engine: "quasi-static" leaves the sensor's own acceleration out, "inertial" has it.
        seed: where a simulation names none.
    """

    title: str = ""
    description: str = ""
    source: str = ""
    fitted_to: tuple[str, ...] = ()
    engine: Engine = "kinematic"
    motion: Motion = "quasi-static"
    seed: int = 0

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise RigError(f"seed: found {self.seed}, expected an integer, zero or above")


@dataclass(frozen=True)
class ArmTable:
    """``[arm]``: a model that comes with the package, or a file and what in it carries the sensor.

    Attributes:
        model: "a465", or "none" for a sensor in a hand.
        file: path of a URDF or MJCF file, or of a folder with one; a scenario file's relative path starts at its own
            folder.
        tip: the link of a URDF, the site or body of an MJCF, whose frame is the sensor's; by default the arm's end.
    """

    model: str = "a465"
    file: str | None = None
    tip: str | None = None

    def __post_init__(self) -> None:
        if self.file is None and self.tip is not None:
            raise RigError(f"file: is missing, expected the arm's file beside tip = {self.tip!r}")
        check_name("model", self.model, ARMS)

    @classmethod
    def of(cls, arm: Arm | None) -> ArmTable:
        """What a file says of an arm; its path is absolute, as the text may be saved anywhere.

        Raises:
            RigError: the arm has neither a name of the package nor a file.
        """
        if arm is None:
            return cls(model="none")
        if arm.file is not None:
            return cls(file=str(arm.file.absolute()), tip=arm.tip)
        if arm.name not in ARMS:
            raise RigError(f"arm {arm.name} cannot be written: expected one that was read from a file")
        return cls(model=arm.name)

    def arm(self, folder: Path) -> Arm | None:
        """The arm; relative paths start at ``folder``."""
        if self.file is not None:
            return Arm.from_file(folder / self.file, self.tip)
        return Arm.a465() if self.model == "a465" else None


@dataclass(frozen=True)
class SensorTable:
    """``[accelerometer]`` and ``[magnetometer]``: the true parameters, Renk (6), (13), (19), and the noise.

    Attributes:
        sensitivity: of each axis, reading per unit of field [V/(m/s^2), V/field unit].
        offset: of each axis, its reading in no field [V].
        beta_deg: elevation of each axis in the tool frame [deg], Renk (6).
        gamma_deg: azimuth of each axis in the tool frame [deg], Renk (6).
        noise_V: standard deviation of each axis' white noise [V]; of readings in another unit, as before ``noise`` was
            known, in that.
        noise: the same, in the unit of the readings (``units`` of ``[acquisition]``); instead of ``noise_V``.
        datasheet: the sensor's file in models/sensors, without ``.toml``; for the reader.
        nominal_sensitivity: of all axes, as its maker and its electronics state it, in the unit of ``sensitivity``;
            goes with the recording, as the start of estimators that need one.
        nominal_offset: the same of the offset, in the unit of ``offset``.
    """

    sensitivity: Triple
    offset: Triple
    beta_deg: Triple
    gamma_deg: Triple
    noise_V: Triple = (0.0, 0.0, 0.0)
    noise: Triple | None = None
    datasheet: str | None = None
    nominal_sensitivity: float | None = None
    nominal_offset: float = 0.0

    def __post_init__(self) -> None:
        if self.nominal_sensitivity is not None and self.nominal_sensitivity <= 0.0:
            raise RigError(f"nominal_sensitivity: found {self.nominal_sensitivity:g}, expected a positive number")
        if self.datasheet is not None:
            known = sorted(path.stem for path in (models_root() / "sensors").glob("*.toml"))
            check_name("datasheet", self.datasheet, known)
        if min(self.noise_V) < 0:
            raise RigError(f"noise_V: found {list(self.noise_V)}, expected three numbers, none negative")
        if self.noise is not None and min(self.noise) < 0:
            raise RigError(f"noise: found {list(self.noise)}, expected three numbers, none negative")
        if self.noise is not None and any(self.noise_V):
            raise RigError("noise: found beside noise_V, expected one or the other")

    @property
    def noise_of_readings(self) -> Triple:
        """The noise in the unit of the readings, under whichever name it stands."""
        return self.noise_V if self.noise is None else self.noise

    def sensor(self) -> TriaxialSensor:
        """The sensor without its noise, which is the acquisition's."""
        return TriaxialSensor(self.sensitivity, self.offset, self.beta_deg, self.gamma_deg)


@dataclass(frozen=True)
class EnvironmentTable:
    """``[environment]``: magnitudes, and directions in the base frame as vectors or by the angles of Renk (12).

    Attributes:
        gravity_m_s2: magnitude of gravity [m/s^2].
        gravity_direction: a vector of any length, base frame; by default straight down.
        gravity_phi_deg: instead of a vector: gravity's elevation [deg], with ``gravity_psi_deg``.
        gravity_psi_deg: instead of a vector: gravity's azimuth [deg], with ``gravity_phi_deg``.
        magnetic_field: magnitude of the magnetic field, in the unit that the sensitivities are per.
        magnetic_field_unit: "G", "uT" or "nT"; None: the magnitude is relative.
        magnetic_direction: a vector of any length, base frame; by default along x.
        magnetic_phi_deg: instead of a vector: the field's elevation [deg], with ``magnetic_psi_deg``.
        magnetic_psi_deg: instead of a vector: the field's azimuth [deg], with ``magnetic_phi_deg``.
        temperature_degC: T of the board's temperature T + rise (1 - exp(-t/tau)) [degC].
        temperature_rise_degC: rise of the board's temperature [degC].
        temperature_tau_s: tau of the board's temperature [s].
    """

    gravity_m_s2: float = 9.8
    gravity_direction: Triple | None = None
    gravity_phi_deg: float | None = None
    gravity_psi_deg: float | None = None
    magnetic_field: float = 1.0
    magnetic_field_unit: FieldUnit | None = None
    magnetic_direction: Triple | None = None
    magnetic_phi_deg: float | None = None
    magnetic_psi_deg: float | None = None
    temperature_degC: float = Environment.temperature_degC
    temperature_rise_degC: float = Environment.temperature_rise_degC
    temperature_tau_s: float = Environment.temperature_tau_s

    def environment(self) -> Environment:
        """The environment; directions that are not stated are ``Environment``'s own."""
        gravity = _direction("gravity", self.gravity_direction, self.gravity_phi_deg, self.gravity_psi_deg)
        magnetic = _direction("magnetic", self.magnetic_direction, self.magnetic_phi_deg, self.magnetic_psi_deg)
        stated = {item.name: getattr(self, item.name) for item in fields(Environment)}
        stated["gravity_direction"] = gravity or Environment.gravity_direction
        stated["magnetic_direction"] = magnetic or Environment.magnetic_direction
        return Environment(**stated)


def _direction(name: str, vector: Triple | None, phi_deg: float | None, psi_deg: float | None) -> Triple | None:
    if vector is not None and (phi_deg is not None or psi_deg is not None):
        raise RigError(f"{name}_direction: found beside {name}_phi_deg or {name}_psi_deg, expected one or the other")
    if phi_deg is None and psi_deg is None:
        return vector
    if phi_deg is None or psi_deg is None:
        missing = "phi" if phi_deg is None else "psi"
        raise RigError(f"{name}_{missing}_deg: is missing, expected {name}_phi_deg and {name}_psi_deg together")
    return _triple(direction_from_angles(phi_deg, psi_deg))


@dataclass(frozen=True)
class EarthTable:
    """``[environment.earth]``: the Earth's field where the arm stands, and how its base stands there.

    The base stands level with its x axis on the compass heading ``base_yaw_deg``, then leans by ``base_tilt_deg``
    towards the heading ``base_tilt_azimuth_deg``; headings are clockwise from true north.

    Attributes:
        north_G: the field towards true north [G].
        east_G: the field towards the east [G].
        down_G: the field downwards [G].
        base_yaw_deg: heading of the base's x axis [deg].
        base_tilt_deg: by which the base leans [deg].
        base_tilt_azimuth_deg: heading towards which it leans [deg].
    """

    north_G: float
    east_G: float
    down_G: float
    base_yaw_deg: float = 0.0
    base_tilt_deg: float = 0.0
    base_tilt_azimuth_deg: float = 0.0

    def __post_init__(self) -> None:
        for name in ("base_yaw_deg", "base_tilt_deg", "base_tilt_azimuth_deg"):
            if not abs(getattr(self, name)) <= 360.0:
                raise RigError(f"{name}: found {getattr(self, name):g}, expected -360 to 360")

    @property
    def R_local_base(self) -> Array:
        """(3, 3) rotation from the base frame to north, west, up."""
        azimuth = self.base_tilt_azimuth_deg
        turns = [-azimuth, self.base_tilt_deg, azimuth - self.base_yaw_deg]
        return np.asarray(Rotation.from_euler("ZYZ", turns, degrees=True).as_matrix())

    def environment(self, rest: Environment) -> Environment:
        """The environment with this field; gravity's magnitude and the temperature are those of ``rest``."""
        field = np.array([self.north_G, -self.east_G, -self.down_G])
        magnitude = float(np.linalg.norm(field))
        if magnitude == 0.0:
            raise RigError("north_G, east_G, down_G: found a field of zero, expected at least one that is not")
        return replace(
            rest,
            gravity_direction=_triple(-self.R_local_base[2]),
            magnetic_field=magnitude,
            magnetic_direction=_triple(field @ self.R_local_base),
        )


def _triple(vector: Array) -> Triple:
    x, y, z = vector
    return float(x), float(y), float(z)
