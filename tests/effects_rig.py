"""The rig on which the effects are tried: the A465, two sensors, a recording's signals at 4 Hz."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import effects_reference as reference
import numpy as np

from rig.arm import Arm
from rig.arrays import Array
from rig.effects import EFFECTS, Effect, Kind
from rig.environment import Environment
from rig.pipeline import Pipeline
from rig.sensor import TriaxialSensor
from rig.signals import Signals

TIMES = np.arange(240) * 0.25 + 3.0  # a recording need not start at zero

ENVIRONMENT = Environment(
    gravity_m_s2=9.8,
    gravity_direction=tuple(reference.GRAVITY),
    magnetic_field=1.3,
    magnetic_direction=tuple(reference.FIELD),
)
SENSORS = [
    TriaxialSensor.from_axes(reference.SENSITIVITY[rows], reference.OFFSET[rows], reference.AXES[rows])
    for rows in (slice(0, 3), slice(3, 6))
]
MEAN = [name for name, effect in EFFECTS.items() if effect.kind is Kind.MEAN]

#: Values where "typical" would not do: off the other parameters' symmetries, within the test recording.
VALUES: dict[str, dict[str, Any]] = {
    "joint_eccentricity": {"phase_rad": 0.7},
    "harmonic_drive_error": {"phase_rad": 0.7},
    "base_rocking": {"phase_rad": 0.7},
    "mounting_slip": {"rotation_rad": (2e-3, -1e-3, 3e-3), "at_s": 20.1},
    "motion_acceleration": {"lever_m": (0.02, -0.03, 0.05)},
    "vibration": {"freq_Hz": 17.3, "phase_rad": 0.7, "direction": (0.5, -1.0, 2.0)},
    "field_gradient": {"gradient_per_m": (0.03, -0.02, 0.05, 0.01, -0.04)},
    "base_dipole": {"position_m": (0.5, 0.2, 0.3), "moment": (2e-4, -1e-4, 3e-4)},
    "link_hard_iron": {"field": (0.01, -0.02, 0.005)},
    "link_soft_iron": {"chi": (0.01, -0.02, 0.005, 0.008, -0.003, 0.012)},
    "motor_current_field": {"field": (0.01, -0.02, 0.005)},
    "bias_warmup": {"coefficient": (5e-3, -3e-3, 2e-3), "tau_s": 30.0},
    "bias_temperature": {"coefficient_per_degC": (1e-3, -2e-3, 3e-3)},
    "scale_temperature": {"coefficient_per_degC": (1e-3, -2e-3, 3e-3)},
    "bias_step": {"at_s": 20.1},
    "pose_interpolation": {"node_interval_s": 1.5, "jitter_s": 0.0},
    "saturation": {"level": 2.6},
    "supply_ratiometric": {"waveform": tuple(1e-3 * np.cos(np.arange(24.0))), "supply_V": 0.8},
    "channel_crosstalk": {"source": "accel3"},
    "mains_hum": {
        "freq_Hz": 50.3,
        "amplitude": (1e-3, 2e-3, -1e-3, 3e-3, 2e-3, 1e-3),
        "phase_rad": tuple(np.arange(6.0)),
    },
}


def signals(t: Array = TIMES) -> Signals:
    """A recording's angles, temperature and supply."""
    supply = 5.0 + 0.01 * np.sin(0.02 * t)
    angles = reference.joint_angles(t)
    return Signals(t=t, arm=Arm.a465(), q_encoder=angles, temperature=reference.temperature(t), supply=supply)


def pipeline(*effects: Effect) -> Pipeline:
    """Both sensors and the effects."""
    return Pipeline(ENVIRONMENT, SENSORS[0], SENSORS[1], effects)


def volts(*effects: Effect, t: Array = TIMES) -> Array:
    """Voltages (n, 6) [V] of the recording with the effects; of its logged poses where one errs in these."""
    recording = logged(t) if any(effect.of_log for effect in effects) else signals(t)
    return pipeline(*effects).expected(recording, np.random.default_rng(0)).volts


def recording_for(effect: Effect, t: Array = TIMES) -> Signals:
    """A recording that the effect can act on."""
    return logged(t) if effect.of_log else signals(t)


def logged(t: Array = TIMES) -> Signals:
    """The same recording as a slow log has it: poses every two seconds, straight between."""
    return made("pose_interpolation", node_interval_s=2.0, jitter_s=0.0).log(measured(t), np.random.default_rng(0))


def measured(t: Array = TIMES) -> Signals:
    """The same recording as a tracking system has it: poses, no joints."""
    posed = pipeline().expected(signals(t), np.random.default_rng(0))
    return Signals(
        t=posed.t,
        R_base_tool=posed.R_base_tool,
        position=posed.position,
        temperature=posed.temperature,
        supply=posed.supply,
    )


def values(effect: type[Effect]) -> dict[str, Any]:
    """The effect's parameters and choices at which it is tried."""
    typical = {
        item.name: item.typical if item.size == 1 else (item.typical,) * item.size for item in effect.parameters()
    }
    return typical | VALUES.get(effect.name, {})


def made(name: str, where: str | None = None, **changed: Any) -> Effect:
    """The effect at a place (its first), with the values at which it is tried but for those changed."""
    effect = EFFECTS[name]
    table = values(effect) | changed
    place = where or effect.places[0]
    if table.get("source") == place:
        table["source"] = "mag2"
    return effect(where=place, **table)


def neutral(name: str, where: str | None = None) -> Effect:
    """The effect with its strengths at the values that change nothing."""
    zeros = {
        item.name: item.neutral if item.size == 1 else (item.neutral,) * item.size
        for item in EFFECTS[name].parameters()
        if item.strength
    }
    return made(name, where, **zeros)


#: Every effect at every place.
EVERYWHERE = [(name, where) for name, effect in EFFECTS.items() for where in effect.places]


def frozen(before: Signals) -> Signals:
    """The signals with all their arrays protected against writing."""
    copies: dict[str, Any] = {}
    for item in fields(before):
        value = getattr(before, item.name)
        if isinstance(value, np.ndarray):
            copies[item.name] = value.copy()
            copies[item.name].flags.writeable = False
    return replace(before, **copies)
