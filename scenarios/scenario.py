"""A scenario: a rig, what it does, and the truth that a calibration is to find."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Final

import numpy as np

from estimators.known_angle.model import SensorParameters, parameter_names
from rig.arm import Arm
from rig.channels import ACCELEROMETER, COLUMNS_OF, MAGNETOMETER, SENSORS
from rig.effects import Effect
from rig.effects.parameters import Value
from rig.environment import Environment
from rig.errors import RigError, check_name
from rig.maneuver import MANEUVERS, LockedPoses, Maneuver
from rig.maneuver.fitting import fitted, unlimited
from rig.progress import Progress
from rig.recording import Recording
from rig.sensor import TriaxialSensor
from rig.simulate import Rig
from scenarios.toml_tables import ArmTable, FieldUnit, RunTable
from scenarios.writer import set_fields, toml_document


@dataclass(frozen=True)
class Truth:
    """The parameters that made a recording.

    Attributes:
        accelerometer, magnetometer: at least one of the two.
        magnetic_field_unit: of the environment's magnetic field; None: relative.
    """

    environment: Environment
    accelerometer: TriaxialSensor | None
    magnetometer: TriaxialSensor | None
    magnetic_field_unit: FieldUnit | None = None

    @property
    def sensors(self) -> dict[str, TriaxialSensor]:
        """The sensors that are there, by name."""
        both = {ACCELEROMETER: self.accelerometer, MAGNETOMETER: self.magnetometer}
        return {name: sensor for name, sensor in both.items() if sensor is not None}

    def values(self, sensor: str, field_points: str = "down") -> dict[str, float]:
        """The 14 parameters of a sensor by their names in a calibration.

        (f, P) and (-f, -P) give the same volts: as in a calibration, the one whose field points down in the base frame
        (z < 0), or up, is given.

        Args:
            sensor: "accelerometer" or "magnetometer".
            field_points: "down" or "up".

        Returns:
            sensitivity1, offset1, beta1_deg, gamma1_deg, .., gamma3_deg, phi_deg, psi_deg.

        Raises:
            RigError: the scenario has no such sensor.
        """
        check_name("sensor", sensor, self.sensors)
        truth, environment = self.sensors[sensor], self.environment
        towards = environment.gravity_direction if sensor == ACCELEROMETER else environment.magnetic_direction
        turned = towards[2] > 0.0 if field_points == "down" else towards[2] < 0.0
        sign = -1.0 if turned else 1.0
        fields = np.tile(sign * np.asarray(towards), (3, 1))
        sensitivity, offset = np.array(truth.sensitivity), np.array(truth.offset)
        own = SensorParameters(1.0, sensitivity, offset, sign * truth.axes, fields)
        return dict(zip(parameter_names("simultaneous"), own.values("simultaneous").tolist(), strict=True))


#: What is stated of a sensor, under ``nominal`` in a recording's metadata.
NOMINAL: Final = ("sensitivity", "offset")


@dataclass(frozen=True)
class Scenario(RunTable):
    """A rig with the maneuver it makes, and what the top of its file says.

    Attributes:
        name: short, as a file's name without suffix.
        rig: arm, surroundings, sensors, acquisition, effects.
        locked: the maneuver of the locked-arm recording that gives the noise floor.
        magnetic_field_unit: unit of the environment's magnetic field; None: relative, as in Renk et al.
        datasheets: sensor -> data sheet in models/sensors.
        nominal: sensor -> stated sensitivity [V per m/s^2 or field unit] and offset [V].
        fitted_std: of the rig's first effects, standard deviations of their parameters by name, where fitted.
    """

    name: str
    rig: Rig
    maneuver: Maneuver
    locked: LockedPoses = field(default_factory=LockedPoses)
    magnetic_field_unit: FieldUnit | None = None
    datasheets: Mapping[str, str] = field(default_factory=dict)
    nominal: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    fitted_std: tuple[Mapping[str, Value], ...] = ()

    @property
    def truth(self) -> Truth:
        """What a calibration of this scenario's recording is to find."""
        return Truth(self.rig.environment, self.rig.accelerometer, self.rig.magnetometer, self.magnetic_field_unit)

    def simulate(self, seed: int | None = None, progress: Progress | None = None) -> Recording:
        """The recording of the maneuver; the same seed gives the same recording.

        Raises:
            RigError: a joint beyond its limit, or a maneuver that does not suit the rig.
        """
        seed = self.seed if seed is None else seed
        rng = np.random.default_rng([seed, 0])
        try:
            recording = self.rig.simulate(self.maneuver, rng, self.engine, self.motion, progress, name=self.name)
        except RigError as error:
            raise RigError(f"scenario {self.name}: {error}") from error
        return self._noted(recording, f"{self.name}, seed {seed}, {self.engine} engine, {self.motion} motion")

    def simulate_locked(self, seed: int | None = None, progress: Progress | None = None) -> Recording:
        """The locked-arm recording: poses held still, every sample kept, noise independent of ``simulate``'s.

        Raises:
            RigError: the scenario has no arm to lock.
        """
        if self.rig.arm is None:
            raise RigError(f"scenario {self.name}: found no arm, expected one that can be locked")
        seed = self.seed if seed is None else seed
        rig = self.with_acquisition(decimation=1).rig
        name = f"{self.name}.locked"
        recording = rig.simulate(self.locked, np.random.default_rng([seed, 1]), progress=progress, name=name)
        return self._noted(recording, f"{self.name}, seed {seed}, locked poses")

    def with_arm(self, arm: Arm, kind: str | None = None) -> Scenario:
        """The scenario on another arm, with a maneuver and locked poses that suit it.

        Args:
            arm: to take the place of the scenario's.
            kind: of the maneuver, one of ``MANEUVERS``; the scenario's own by default.

        Raises:
            RigError: the arm cannot make the maneuver, or has not the place of an effect.
        """
        maneuver: Any = self.maneuver
        if kind is not None and kind != self.kind:
            chosen: type[Any] = MANEUVERS[kind]
            maneuver = chosen() if arm.is_a465 else chosen(**unlimited(chosen))
        for effect in self.rig.effects:
            if misplaced := effect.misplaced_on(arm.dof, arm.slides):
                raise RigError(f"scenario {self.name}: effect {effect.name} at {effect.where}: {misplaced}")
        return replace(
            self,
            rig=replace(self.rig, arm=arm),
            maneuver=fitted(maneuver, arm),
            locked=fitted(LockedPoses(hold_s=self.locked.hold_s, rate_Hz=self.locked.rate_Hz), arm),
        )

    @property
    def kind(self) -> str:
        """The maneuver's name among ``MANEUVERS``; empty where it has none."""
        return next((name for name, cls in MANEUVERS.items() if type(self.maneuver) is cls), "")

    def with_effects(self, effects: Iterable[Effect]) -> Scenario:
        """The scenario with further effects, after those it has."""
        return replace(self, rig=replace(self.rig, effects=(*self.rig.effects, *effects)))

    def with_acquisition(self, **changes: Any) -> Scenario:
        """The scenario with other values of its ``Acquisition``, by their names.

        Raises:
            RigError: as of ``Acquisition``.
        """
        return replace(self, rig=replace(self.rig, acquisition=replace(self.rig.acquisition, **changes)))

    def scaled_noise(self, factor: float) -> Scenario:
        """The scenario with the standard deviation of its white noise times ``factor``.

        Raises:
            RigError: the factor is negative or not finite.
        """
        if not (np.isfinite(factor) and factor >= 0):
            raise RigError(f"noise factor: found {factor}, expected zero or a positive number")
        return self.with_acquisition(noise_V=tuple(factor * sigma for sigma in self.rig.acquisition.noise_V))

    def to_toml(self) -> str:
        """The scenario as a file that loads to the same rig; fields' directions are written as vectors.

        Raises:
            RigError: its maneuver or arm has no place in a file.
        """
        return toml_document(_tables(self))

    def _noted(self, recording: Recording, notes: str) -> Recording:
        metadata = replace(recording.metadata, notes=notes, magnetic_field_unit=self.magnetic_field_unit)
        if self.nominal:
            stated = {name: dict(zip(NOMINAL, values, strict=True)) for name, values in self.nominal.items()}
            metadata = replace(metadata, extra={**metadata.extra, "nominal": stated})
        return replace(recording, metadata=metadata)


def _tables(scenario: Scenario) -> Iterable[tuple[str, dict[str, Any]]]:
    texts = {key: getattr(scenario, key) for key in ("title", "description", "source")}
    run = {"engine": scenario.engine, "motion": scenario.motion, "seed": scenario.seed}
    fitted = {"fitted_to": scenario.fitted_to} if scenario.fitted_to else {}
    yield "", {**{key: text for key, text in texts.items() if text}, **fitted, **run}
    yield "[arm]", set_fields(ArmTable.of(scenario.rig.arm)) or {"model": "a465"}
    if not scenario.kind:
        kind = type(scenario.maneuver).__name__
        raise RigError(f"maneuver {kind} cannot be written: expected one of {', '.join(MANEUVERS)}")
    yield "[maneuver]", {"kind": scenario.kind, **set_fields(scenario.maneuver)}
    unit = {"magnetic_field_unit": scenario.magnetic_field_unit} if scenario.magnetic_field_unit else {}
    yield "[environment]", {**asdict(scenario.rig.environment), **unit}
    acquisition = scenario.rig.acquisition
    for name, sensor in scenario.truth.sensors.items():
        sheet: dict[str, Any] = {"datasheet": scenario.datasheets[name]} if name in scenario.datasheets else {}
        if name in scenario.nominal:
            sheet |= {f"nominal_{key}": value for key, value in zip(NOMINAL, scenario.nominal[name], strict=True)}
        if name == ACCELEROMETER and acquisition.accelerometer_reads == "a-g":
            sensor = sensor.turned()
        key = "noise_V" if acquisition.units[SENSORS.index(name)] == "V" else "noise"
        yield f"[{name}]", {**asdict(sensor), key: acquisition.noise_V[COLUMNS_OF[name]], **sheet}
    written = {key: value for key, value in asdict(acquisition).items() if key != "noise_V"}
    if set(written["units"]) == {"V"}:  # volts need no word
        del written["units"]
    if written["accelerometer_reads"] == "g-a":
        del written["accelerometer_reads"]
    yield "[acquisition]", written
    if locked := set_fields(scenario.locked):
        yield "[locked]", locked
    for index, effect in enumerate(scenario.rig.effects):
        known = scenario.fitted_std[index] if index < len(scenario.fitted_std) else {}
        yield f"[[effects.{effect.name}]]", {**asdict(effect), **{f"{name}_std": std for name, std in known.items()}}
