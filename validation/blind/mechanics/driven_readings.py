"""What the sensors make of a driven arm, beside what the ideal model makes of its encoders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rig.arrays import Array
from rig.channels import ACCELEROMETER, COLUMNS_OF, MAGNETOMETER
from rig.signals import Signals
from validation.blind.mechanics.drive import drive
from validation.blind.mechanics.mechanism import Mechanism
from validation.blind.settings import Setting


@dataclass(frozen=True)
class Seen:
    """The n samples of a recording before noise.

    Attributes:
        t: (n,) [s]. q: (n, 6) [rad] what the encoders read.
        volts: (n, 6) expected readings [V].
        change: (n, 6) [V] these less the ideal model's at the same encoder angles.
    """

    t: Array
    q: Array
    volts: Array
    change: Array


def see(mechanism: Mechanism, setting: Setting) -> Seen:
    """Drive the arm along the setting's sweep with the mechanism in it, and read the sensors.

    Raises:
        RigError: as ``drive``.
    """
    environment, sensors = setting.rig.environment, setting.rig.pipeline.sensors
    driven = drive(mechanism, setting.sweep, environment.gravity)
    fields = {
        ACCELEROMETER: environment.gravity - driven.acceleration,
        MAGNETOMETER: environment.magnetic + environment.magnetic_field * driven.field,
    }
    volts = np.empty((len(driven.t), 6))
    for name, sensor in sensors.items():
        volts[:, COLUMNS_OF[name]] = sensor.volts(sensor.components(driven.R_base_tool, fields[name]))
    start = Signals(t=driven.t, arm=setting.rig.arm, q_encoder=driven.q, velocity=np.zeros_like(driven.q))
    ideal = setting.rig.pipeline.expected(start, np.random.default_rng(0)).volts
    return Seen(driven.t, driven.q, volts, volts - ideal)
