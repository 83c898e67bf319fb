"""Scenarios from TOML files: those that come with the package, by name, and the user's own, by path."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeVar

from rig.acquisition import Acquisition
from rig.arm import Arm
from rig.channels import ACCELEROMETER, MAGNETOMETER, SENSORS
from rig.documents import parse_toml, read_toml
from rig.effects import EFFECTS, Effect, make_effect
from rig.effects.parameters import Parameter, Value
from rig.environment import MAGNITUDES, Environment
from rig.errors import RigError, nearest, unknown_name
from rig.files import in_utf8
from rig.maneuver import MANEUVERS, LockedPoses, Maneuver
from rig.maneuver.fitting import fitted, unlimited
from rig.simulate import Rig, unfelt
from scenarios.catalogue import built_in, names
from scenarios.scenario import Scenario
from scenarios.schema import Built, Table, build
from scenarios.toml_tables import ArmTable, EarthTable, EnvironmentTable, FieldUnit, RunTable, SensorTable

Made = TypeVar("Made")

__all__ = ["from_toml", "load", "names"]

#: What a fitted parameter's name gets for its standard deviation.
_STD: Final = "_std"
_SECTIONS: Final = ("arm", "maneuver", "environment", *SENSORS, "acquisition", "locked", "effects")


def load(name_or_path: str | os.PathLike[str]) -> Scenario:
    """A scenario by its name, or by the path of a TOML file.

    Raises:
        RigError: no such scenario, or a file that is not one; with the file, the key, the value found, what was
            expected and the nearest valid name.
    """
    path = _path(name_or_path)
    return from_toml(read_text(name_or_path), path.name if path == built_in(path.stem) else str(path))


def read_text(name_or_path: str | os.PathLike[str]) -> str:
    """The TOML text of a scenario.

    Raises:
        RigError: no such scenario, or a file that cannot be read as text.
    """
    return read_toml(_path(name_or_path), "a scenario in TOML")


def _path(name_or_path: str | os.PathLike[str]) -> Path:
    text = os.fspath(name_or_path)
    choices = names()
    if text in choices:
        return built_in(text)
    path = Path(text)
    if path.suffix != ".toml" and path.name == text and not path.is_file():
        raise RigError(
            f"unknown scenario {text!r}: expected the path of a .toml file or one of {', '.join(choices)}"
            f"{nearest(text, choices)}"
        )
    return path


def from_toml(text: str, file: str) -> Scenario:
    """A scenario from TOML text; ``file`` is its path, for messages, for its name and for relative paths in it.

    Raises:
        RigError: as ``load``.
    """
    values = parse_toml(text, file)
    top = Table(file, "", values)
    run = build(RunTable, replace(top, values=_without(values, _SECTIONS)), also=_SECTIONS)
    folder = Path(file).parent
    arm_table = build(ArmTable, top.sub("arm"))
    sensors: dict[str, SensorTable] = {name: build(SensorTable, top.sub(name)) for name in SENSORS if name in values}
    if not sensors:
        raise top.error("no sensor: expected a section [accelerometer], [magnetometer] or both")
    environment, unit = _environment(top.sub("environment"))
    truths = {name: _checked(top.sub(name), sensor.sensor) for name, sensor in sensors.items()}
    arm = _checked(top.sub("arm"), partial(arm_table.arm, folder))
    acquisition = _acquisition(top.sub("acquisition"), sensors)
    if ACCELEROMETER in truths and acquisition.accelerometer_reads == "a-g":  # the rig's own sensors feel g - a
        truths[ACCELEROMETER] = truths[ACCELEROMETER].turned()
    effects, std = _effects(top.sub("effects"), arm, sensors)
    rig = Rig(
        arm=arm,
        environment=environment,
        accelerometer=truths.get(ACCELEROMETER),
        magnetometer=truths.get(MAGNETOMETER),
        acquisition=acquisition,
        effects=effects,
    )
    return Scenario(
        **vars(run),
        name=in_utf8(Path(file).stem),
        rig=rig,
        maneuver=_maneuver(top.sub("maneuver"), arm),
        locked=_fitted(LockedPoses, top.sub("locked"), arm),
        fitted_std=std,
        magnetic_field_unit=unit,
        datasheets={name: sensor.datasheet for name, sensor in sensors.items() if sensor.datasheet},
        nominal={
            name: (sensor.nominal_sensitivity, sensor.nominal_offset)
            for name, sensor in sensors.items()
            if sensor.nominal_sensitivity is not None
        },
    )


def _maneuver(table: Table, arm: Arm | None) -> Maneuver:
    kind = table.values.get("kind")
    if kind is None:
        raise table.error(f"kind: is missing, expected one of {', '.join(MANEUVERS)}")
    name = str(kind).replace("_", "-")  # either spelling
    if name not in MANEUVERS:
        raise table.wrong("kind", f"one of {', '.join(MANEUVERS)}", tuple(MANEUVERS))
    return _fitted(MANEUVERS[name], replace(table, values=_without(table.values, ["kind"])), arm)


def _fitted(kind: type[Built], table: Table, arm: Arm | None) -> Built:
    """A maneuver; what the file leaves open suits its arm."""
    if arm is None or arm.is_a465:
        return build(kind, table)
    open_ = {key: value for key, value in unlimited(kind).items() if key not in table.values}
    made = build(kind, table, given=open_)
    return _checked(table, lambda: fitted(made, arm, table.values))


def _environment(table: Table) -> tuple[Environment, FieldUnit | None]:
    earth = table.sub("earth")
    own = replace(table, values=_without(table.values, ["earth"]))
    stated = build(EnvironmentTable, own, also=("earth",))
    for key in own.values if "earth" in table.values else ():
        if key.startswith("magnetic_") or key in ("gravity_direction", "gravity_phi_deg", "gravity_psi_deg"):
            raise table.error(f"{key}: found beside [{earth.name}], which states it, expected one or the other")
    rest = _checked(own, stated.environment)
    if "earth" not in table.values:
        return rest, stated.magnetic_field_unit
    return _checked(earth, partial(build(EarthTable, earth).environment, rest)), "G"


def _acquisition(table: Table, sensors: Mapping[str, SensorTable]) -> Acquisition:
    if "noise_V" in table.values:
        raise table.error("noise_V: found here, expected it in [accelerometer] and [magnetometer], three numbers each")
    noise = [sensors[name].noise_of_readings if name in sensors else (0.0, 0.0, 0.0) for name in SENSORS]
    return build(Acquisition, table, leave_out=("noise_V",), given={"noise_V": (*noise[0], *noise[1])})


def _effects(
    table: Table, arm: Arm | None, sensors: Collection[str]
) -> tuple[tuple[Effect, ...], tuple[Mapping[str, Value], ...]]:
    effects: list[Effect] = []
    known: list[Mapping[str, Value]] = []
    for name, values in table.values.items():
        if name not in EFFECTS:
            raise table.error(str(unknown_name("effect", name, EFFECTS)))
        entries = values if isinstance(values, list) else [values]
        for entry in entries:
            if not isinstance(entry, dict):
                raise table.wrong(name, f"a table [effects.{name}] or several [[effects.{name}]]")
            own = Table(table.file, table.path(name), entry)
            std = {f"{item.name}{_STD}": item for item in EFFECTS[name].parameters()}
            known.append({item.name: _std(own, key, item) for key, item in std.items() if key in entry})
            effects.append(_checked(own, partial(make_effect, name, _without(entry, std), arm)))
            if lacking := unfelt(effects[-1], sensors):
                raise own.error(f"effect {name} at {effects[-1].where}: {lacking}")
    return tuple(effects), tuple(known) if any(known) else ()


def _std(table: Table, key: str, item: Parameter) -> Value:
    """The standard deviation of a fitted parameter: a number, or one for each of its numbers."""
    value = table.values[key]
    numbers = value if isinstance(value, list) else [value]
    sound = [x for x in numbers if isinstance(x, int | float) and not isinstance(x, bool) and 0.0 <= x <= MAGNITUDES[1]]
    if len(sound) != len(numbers) or len(numbers) != item.size or isinstance(value, list) != (item.size > 1):
        raise table.wrong(key, "a number of zero or more" if item.size == 1 else f"{item.size} numbers of zero or more")
    return tuple(map(float, sound)) if item.size > 1 else float(sound[0])


def _without(values: Mapping[str, Any], keys: Collection[str]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if key not in keys}


def _checked(table: Table, make: Callable[[], Made]) -> Made:
    """What ``make`` makes; its refusal with the file and the section."""
    try:
        return make()
    except RigError as error:
        raise table.error(str(error)) from error
