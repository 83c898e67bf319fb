"""Errors that all channels share: of a joint's angle, of a field, of the mount, whatever they follow.

A mechanism that is not in the catalogue still acts through the arm and the sensor: what it does to the six channels is
one error of an angle, a field or a mounting, times an unknown course along time and joint angles. Low orders of such
courses, coherent over the channels, show it at signal-to-noise where no single channel does.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimators.gap.bench import Bench
from estimators.gap.score import Explained, Score
from rig.channels import ACCELEROMETER, CHANNELS, COLUMNS_OF
from rig.effects import make_effect
from rig.effects.base import JOINTS
from rig.effects.transmission import smooth_sign

Array = NDArray[np.float64]

#: A joint whose angle varies less [rad] is locked.
_LOCKED: Final = 0.05
#: Courses: cosines of time; harmonics of each moving joint, and its direction.
_TIMES, _ORDERS = 8, 2
#: Angle [rad] at which derivatives are taken.
_STEP: Final = 1e-5


def families(bench: Bench) -> Iterator[tuple[str, list[Array]]]:
    """What the remainder may follow, in words, and its regressors (n, 6) [recorded unit], one after the other."""
    courses = _courses(bench)
    if bench.base.q_encoder is not None:
        for joint in JOINTS[: bench.base.q_encoder.shape[1]]:
            change = bench.change([make_effect("joint_offset", {"where": joint, "offset_rad": _STEP})]) / _STEP
            yield f"an error of {joint}'s angle", _times([change], courses)
    for name in bench.pipeline.sensors:
        yield f"a change of the {name}'s field", _times(_field_changes(bench, name), courses)
        yield f"a turn of the {name}", _times(_turns(bench, name), courses)


def of_one_joint(bench: Bench, explained: Explained) -> Score:
    """The best score of an error of one joint's angle."""
    names = families(bench)
    scores = [explained.score(bench.whiten_changes(changes)) for name, changes in names if "angle" in name]
    return max(scores, key=lambda score: score.evidence, default=Score(0.0, 0, np.zeros(0), 0.0))


def _courses(bench: Bench) -> Array:
    """(n, m) from one on: time, then the moving joints."""
    count = len(bench.base)
    clock = (np.arange(count) + 0.5) / count
    found = [np.ones(count), *(np.cos(np.pi * order * clock) for order in range(1, _TIMES + 1))]
    if (q := bench.base.q_encoder) is not None:
        moving = [joint for joint in range(q.shape[1]) if np.std(np.unwrap(q[:, joint])) > _LOCKED]
        for joint in moving:
            angles = [order * q[:, joint] for order in range(1, _ORDERS + 1)]
            found += [wave(angle) for angle in angles for wave in (np.cos, np.sin)]
            found.append(smooth_sign(bench.base.joint_velocity[:, joint]))
    return np.stack(found, axis=1)


def _times(changes: list[Array], courses: Array) -> list[Array]:
    return [change * course[:, None] for change in changes for course in courses.T]


def _field_changes(bench: Bench, name: str) -> list[Array]:
    """What a unit of field along each axis of the base does to a sensor's channels."""
    return [_felt(bench, name, bench.base.R_base_tool[:, axis, :]) for axis in range(3)]


def _turns(bench: Bench, name: str) -> list[Array]:
    """What a small turn of the sensor about each axis of the tool does to its channels."""
    environment = bench.pipeline.environment
    field = environment.gravity if name == ACCELEROMETER else environment.magnetic
    in_tool = np.matmul(field, bench.base.R_base_tool)
    return [_felt(bench, name, np.cross(in_tool, axis)) for axis in np.eye(3)]


def _felt(bench: Bench, name: str, in_tool: Array) -> Array:
    """(n, 6) readings of a field (n, 3) in the tool's frame."""
    sensor = bench.pipeline.sensors[name]
    found = np.zeros((len(in_tool), len(CHANNELS)))
    found[:, COLUMNS_OF[name]] = in_tool @ sensor.axes.T * np.asarray(sensor.sensitivity)
    return found
