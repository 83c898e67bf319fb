"""The calibration moved to where it belongs once the causes are known.

The data takes the calibration's freedom to first order. A strong cause can have pushed the calibration further than
that: then the data are set up anew around the calibration with the causes in place, by Gauss-Newton steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from estimators.gap.data.tangent import moments
from estimators.gap.data.whitened import WhitenedData
from rig.arrays import Array
from rig.channels import ACCELEROMETER, COLUMNS_OF, MAGNETOMETER
from rig.directions import tangent_basis
from rig.effects import Effect
from rig.pipeline import Pipeline
from rig.sensor import TriaxialSensor

#: Directions of the calibration's parameters that move the readings by less than this share are left alone.
_FELT: Final = 1e-6


def rebased(data: WhitenedData, effects: Sequence[Effect]) -> WhitenedData:
    """The data around the calibration that fits best, to first order, with these effects in place."""
    gram, moment = moments(data.tangents, data.whiten(data.residual - data.change(effects)))
    scale = np.sqrt(np.diag(gram))
    scale[scale == 0.0] = np.inf
    step = np.linalg.pinv(gram / np.outer(scale, scale), rcond=_FELT, hermitian=True) @ (moment / scale) / scale
    return data.around(stepped(data.pipeline, step), effects)


def stepped(pipeline: Pipeline, step: Array) -> Pipeline:
    """The pipeline with its parameters moved by ``step`` (p,), in the order of ``WhitenedData.tangent``."""
    environment = pipeline.environment
    sensors: dict[str, TriaxialSensor] = {}
    first = 0
    for name, sensor in pipeline.sensors.items():
        count = len(range(6)[COLUMNS_OF[name]])
        own = step[first : first + 4 * count].reshape(count, 4)
        field = environment.gravity if name == ACCELEROMETER else environment.magnetic
        direction = field / np.linalg.norm(field)
        direction = direction + step[first + 4 * count : first + 4 * count + 2] @ tangent_basis(direction)
        x, y, z = (float(each) for each in direction / np.linalg.norm(direction))
        axes = np.stack([axis + move @ tangent_basis(axis) for axis, move in zip(sensor.axes, own[:, 2:], strict=True)])
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        sensitivity = np.maximum(np.asarray(sensor.sensitivity) + own[:, 0], 1e-9)
        sensors[name] = TriaxialSensor.from_axes(sensitivity, np.asarray(sensor.offset) + own[:, 1], axes)
        if name == ACCELEROMETER:
            environment = replace(environment, gravity_direction=(x, y, z))
        else:
            environment = replace(environment, magnetic_direction=(x, y, z))
        first += 4 * count + 2
    return Pipeline(environment, sensors.get(ACCELEROMETER), sensors.get(MAGNETOMETER))
