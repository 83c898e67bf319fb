"""The truth of a case: what is sealed, and what the scorer reads again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Self

from rig.arrays import Array
from rig.effects import Effect
from rig.environment import Environment
from rig.maneuver import TorusSweep
from rig.pipeline import Pipeline
from rig.sensor import TriaxialSensor
from validation.blind.floors import Colour, Floor
from validation.blind.settings import Setting

Label = tuple[str, str]

#: Weaker than this, signal over noise, nobody is asked to see it.
VISIBLE = 4.0


@dataclass(frozen=True)
class TrueCause:
    """One thing that is there.

    Attributes:
        name: of the effect, form, mechanism or outside effect.
        effect, where: what it should be called; empty where no catalogue has a name for it.
        families: further names in the catalogue that are as right, each with its place.
        parameters: as they were drawn; for the record.
        snr: projected, whitened signal-to-noise.
        beyond: the same with all other causes projected out as well.
        twins: (effect, where) that nobody could tell from it at this strength.
        alike: those that the data could well mistake for it.
    """

    name: str
    effect: str
    where: str
    snr: float
    beyond: float
    families: tuple[Label, ...] = ()
    parameters: Mapping[str, Any] = field(default_factory=dict)
    twins: tuple[Label, ...] = ()
    alike: tuple[Label, ...] = ()

    @property
    def visible(self) -> bool:
        """Whether somebody can be asked to see it."""
        return self.beyond >= VISIBLE

    @property
    def likely(self) -> set[Label]:
        """Names that an honest judge may come to at this strength, right or not."""
        return self.right | set(self.twins) | set(self.alike)

    @property
    def right(self) -> set[Label]:
        """All names that are right."""
        if not self.effect:  # whatever is as good as it is not its name
            return set()
        own = {(self.effect, self.where)}
        return own | set(self.families) | set(self.twins)


@dataclass(frozen=True)
class Truth:
    """A case's truth.

    Attributes:
        case: its name. stratum: where it belongs. wanted: the strengths that were asked for.
        causes: what is there.
        gap_V: (6,) RMS of what the calibration cannot take up, channel by channel [V].
        floor, environment, accelerometer, magnetometer: of the rig. sweep: of the maneuver, in words.
        laboratory, floor_kind: by their names.
        change_sha256: of the file with the true change of the expected readings.
    """

    case: str
    stratum: str
    wanted: tuple[float, ...]
    causes: tuple[TrueCause, ...]
    gap_V: tuple[float, ...]
    floor: Floor
    environment: Environment
    accelerometer: TriaxialSensor
    magnetometer: TriaxialSensor
    sweep: str = ""
    laboratory: str = "sweep"
    floor_kind: str = "white"
    change_sha256: str = ""

    @classmethod
    def of(
        cls, case: str, stratum: str, wanted: tuple[float, ...], causes: tuple[TrueCause, ...], gap: Array, rig: Setting
    ) -> Self:
        """With the rig's own numbers from a setting."""
        accelerometer, magnetometer = rig.rig.accelerometer, rig.rig.magnetometer
        assert accelerometer is not None
        assert magnetometer is not None
        sweep = rig.maneuver
        words = f"all joints, {sweep.duration_s:g} s"
        if isinstance(sweep, TorusSweep):
            words = f"{sweep.yaw_passes} x {sweep.pitch_passes} passes in {sweep.duration_s:g} s"
            words += f", {sweep.roll_deg_per_s:g} deg/s"
        gap_V = tuple(float(value) for value in gap)
        environment = rig.rig.environment
        return cls(
            case,
            stratum,
            wanted,
            causes,
            gap_V,
            rig.floor,
            environment,
            accelerometer,
            magnetometer,
            words,
            rig.laboratory.name,
        )

    @property
    def visible(self) -> tuple[TrueCause, ...]:
        """The causes that somebody can be asked to see, strongest first."""
        return tuple(sorted((each for each in self.causes if each.visible), key=lambda each: -each.beyond))

    @property
    def pipeline(self) -> Pipeline:
        """The true sensors and fields, without effects."""
        return Pipeline(self.environment, self.accelerometer, self.magnetometer)

    def to_json(self) -> dict[str, Any]:
        """Plain numbers, names and lists."""
        return asdict(self)

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> Self:
        """As written by ``to_json``."""
        values = dict(document)
        colours = {
            sensor: tuple(Colour(**each) for each in parts) for sensor, parts in values["floor"]["colours"].items()
        }
        values["floor"] = Floor(tuple(values["floor"]["sigma_V"]), colours, values["floor"]["degrees"])
        values["environment"] = Environment(**_tuples(values["environment"]))
        for sensor in ("accelerometer", "magnetometer"):
            values[sensor] = TriaxialSensor(**_tuples(values[sensor]))
        values["causes"] = tuple(_cause(each) for each in values["causes"])
        return cls(**{**values, "wanted": tuple(values["wanted"]), "gap_V": tuple(values["gap_V"])})


def parameters_of(effect: Effect) -> dict[str, Any]:
    """An effect's own fields, without its place."""
    return {key: value for key, value in asdict(effect).items() if key != "where"}


def _cause(values: Mapping[str, Any]) -> TrueCause:
    labels = {key: tuple((name, where) for name, where in values[key]) for key in ("families", "twins", "alike")}
    return TrueCause(**{**values, **labels})


def _tuples(values: Mapping[str, Any]) -> dict[str, Any]:
    return {key: tuple(value) if isinstance(value, list) else value for key, value in values.items()}
