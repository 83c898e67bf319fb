"""Effects of the catalogue with everything about them drawn but their strength."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from rig.arrays import Array
from rig.channels import CHANNELS
from rig.effects import EFFECTS, Effect
from rig.errors import RigError
from rig.sensor import Triple
from validation.blind.settings import Setting
from validation.blind.strength import Make

Drawer = Callable[[np.random.Generator, Setting], dict[str, Any]]

#: Effects at places where the calibration takes them up on a sweep of joints 1, 5 and 6 with angles that are known.
ABSORBED: Final = (
    ("joint_offset", "joint1", {"offset_rad": 0.01}),
    ("joint_offset", "joint6", {"offset_rad": 0.02}),
    ("backlash", "joint6", {"width_rad": 5e-3}),  # it rolls one way
    ("axis_misalignment", "joint2", {"twist_rad": 5e-3}),
    ("axis_misalignment", "joint3", {"twist_rad": 5e-3}),
)

#: Their strength cannot be chosen: they act by being there.
BY_BEING_THERE: Final = ("motion_acceleration",)


def draw_effect(
    name: str, rng: np.random.Generator, setting: Setting, where: str | None = None, one_axis: bool = False
) -> Make:
    """An effect of the catalogue by its strength, one at its typical size; place, shape and direction are drawn.

    Args:
        where: the place; drawn where none is given.
        one_axis: whether only one number of each strength is not zero.

    Raises:
        RigError: the setting's arm has no place for it.
    """
    effect = EFFECTS[name]
    if where is None and not places_of(effect, setting):
        raise RigError(f"no place for {name} on this arm")
    place = where if where is not None else str(rng.choice(places_of(effect, setting)))
    fixed: dict[str, Any] = {"where": place, **_names(effect, place, rng)}
    if name in _SHAPES:
        fixed |= _SHAPES[name](rng, setting)
    for each in effect.parameters():
        if not each.strength and each.name == "phase_rad" and each.name not in fixed:
            turns = rng.uniform(0.0, 2.0 * np.pi, each.size)
            fixed["phase_rad"] = float(turns[0]) if each.size == 1 else tuple(turns)
    if name == "saturation":
        return _clipping(fixed, setting)
    towards = {}
    for each in effect.parameters():
        if each.strength and each.name not in fixed:
            drawn = rng.standard_normal(each.size) if each.size > 1 else rng.choice([-1.0, 1.0], 1)
            if one_axis and each.size > 1:
                drawn = np.where(np.arange(each.size) == rng.integers(each.size), 1.0, 0.0)
            towards[each.name] = each.typical * (np.abs(drawn) if each.lower >= 0.0 else drawn)

    def make(strength: float) -> Effect:
        values = {key: strength * value for key, value in towards.items()}
        plain = {key: float(value[0]) if len(value) == 1 else tuple(value) for key, value in values.items()}
        return effect.from_mapping({**fixed, **plain})

    return make


def places_of(effect: type[Effect], setting: Setting) -> list[str]:
    """The places where the effect shows in a setting."""
    if setting.laboratory.wanders:
        return list(effect.places_on(setting.ideal))
    return places_on_sweep(effect)


def places_on_sweep(effect: type[Effect]) -> list[str]:
    """The places where the effect shows on the paper's sweep."""
    hidden = [where for name, where, _ in ABSORBED if name == effect.name] + (
        ["joint4"] if effect.name == "axis_misalignment" else []
    )
    if effect.name == "joint_compliance":  # joints 2 and 3 are loaded by gravity almost alike in all poses
        hidden += ["joint2", "joint3"]
    return [where for where in effect.places if where not in hidden]


def _names(effect: type[Effect], place: str, rng: np.random.Generator) -> dict[str, str]:
    return {key: str(rng.choice([each for each in names if each != place])) for key, names in effect.choices().items()}


def _instant(rng: np.random.Generator, setting: Setting) -> dict[str, Any]:
    return {"at_s": float(setting.maneuver.duration_s * rng.uniform(0.1, 0.9))}


def near(rng: np.random.Generator, setting: Setting) -> dict[str, Any]:
    """A point 0.15 to 0.4 m from the sensor's path."""
    path = setting.ideal.position
    for _ in range(10_000):
        point = path[rng.integers(len(path))] + rng.uniform(0.15, 0.4) * unit(rng)
        if 0.15 < float(np.sqrt(np.min(np.sum((path - point) ** 2, axis=1)))) < 0.4:
            return {"position_m": tuple(point)}
    raise RigError("no place for a dipole beside the sensor's path")


def unit(rng: np.random.Generator) -> Array:
    """(3,) a direction."""
    vector = rng.standard_normal(3)
    return np.asarray(vector / np.linalg.norm(vector))


def scaled(vector: Array, strength: float) -> Triple:
    """A vector (3,) times a number, as plain numbers."""
    x, y, z = (float(value) for value in strength * vector)
    return (x, y, z)


def _slowly(rng: np.random.Generator, setting: Setting) -> dict[str, Any]:
    return {"tau_s": float(np.exp(rng.uniform(np.log(40.0), np.log(600.0))))}


def _waveform(rng: np.random.Generator, setting: Setting) -> dict[str, Any]:
    return {"supply_V": 1.0}


_SHAPES: Final[dict[str, Drawer]] = {
    "pose_noise": lambda rng, setting: {"tau_s": 0.0},
    "harmonic_drive_error": lambda rng, setting: {"order": float(rng.integers(198, 205))},
    "mounting_slip": _instant,
    "bias_step": _instant,
    "base_dipole": near,
    "bias_warmup": _slowly,
    "noise_coloured": lambda rng, setting: {"tau_s": float(np.exp(rng.uniform(np.log(0.5), np.log(8.0))))},
    "vibration": lambda rng, setting: {"freq_Hz": float(rng.uniform(5.0, 40.0)), "direction": tuple(unit(rng))},
    "mains_hum": lambda rng, setting: {"freq_Hz": float(rng.choice([50.0, 60.0]) * (1.0 + rng.uniform(-0.015, 0.015)))},
    "outliers": lambda rng, setting: {"size_V": float(rng.uniform(0.08, 0.15))},  # several even where they are weak
    "supply_ratiometric": _waveform,
}


def _clipping(fixed: dict[str, Any], setting: Setting) -> Make:
    top = float(setting.ideal.volts[:, CHANNELS.index(fixed["where"])].max())
    if top <= 2.6:
        raise RigError(f"{fixed['where']} never comes near its upper rail: nothing to clip")
    return lambda strength: EFFECTS["saturation"].from_mapping({**fixed, "level": top + 0.05 - 0.05 * strength})
