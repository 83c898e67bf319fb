"""Errors that all channels share: of a joint's angle, of a field, of the mount, whatever they follow.

A mechanism that is not in the catalogue still acts through the arm and the sensor: what it does to the six channels is
one error of an angle, a field or a mounting, times an unknown course along time and joint angles. Low orders of such
courses, coherent over the channels, show it at signal-to-noise where no single channel does.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimators.gap.bench import Bench
from estimators.gap.score import Explained, Score, solve
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


@dataclass(frozen=True)
class Organ:
    """Something of the arm or of a sensor that can be off.

    Attributes:
        name: what is off, in words.
        changes: (n, 6) [recorded unit] what a unit of each of its freedoms does to the readings.
    """

    name: str
    changes: list[Array]


def families(bench: Bench) -> Iterator[tuple[str, list[Array]]]:
    """What the remainder may follow, in words, and its regressors (n, 6) [recorded unit], one after the other."""
    courses = np.hstack(_courses(bench))
    for organ in _organs(bench):
        if not organ.name.startswith("an offset"):  # the families of single channels hold it
            yield organ.name, _times(organ.changes, courses)


def likeliest(bench: Bench, rivals: int, explained: Explained | None = None, joint: str = "") -> float:
    """The most evidence that one organ off along one course has, beside so many rivals that are as likely beforehand.

    Some of these pairs are effects of the catalogue; where that holds the truth, none has more evidence than it.

    Args:
        bench: of the base fit, each mean with the rig evaluated once.
        rivals: the catalogue's candidates.
        explained: what is explained already; the calibration alone by default.
        joint: only errors of its angle; any organ by default.
    """
    explained = Explained(bench.absorbed, bench.whitened) if explained is None else explained
    courses = _courses(bench)
    ends = np.cumsum([0] + [course.shape[1] for course in courses])
    together = np.hstack(courses)
    best, tried = 0.0, 0
    for organ in _organs(bench):
        if joint and organ.name != _angle_of(joint):
            continue
        columns = bench.whiten_changes(_times(organ.changes, together))
        if not len(columns.values):
            continue
        gram = explained.unexplained(columns, explained.projected(columns))
        moment = columns.values.T @ explained.residual[columns.rows]
        length = np.linalg.norm(columns.values, axis=0)
        for first, last in itertools.pairwise(ends):
            own = np.concatenate([np.arange(first, last) + each * ends[-1] for each in range(len(organ.changes))])
            best = max(best, solve(gram[np.ix_(own, own)], moment[own], length[own]).evidence)
            tried += 1
    return best - 2.0 * float(np.log(max(tried / rivals, 1.0)))


def turning(q: Array) -> list[int]:
    """The joints (columns of q (n, N) [rad]) that are not locked."""
    return [joint for joint in range(q.shape[1]) if np.std(np.unwrap(q[:, joint])) > _LOCKED]


def of_one_joint(bench: Bench, explained: Explained) -> Score:
    """The best score of an error of one joint's angle."""
    names = families(bench)
    scores = [explained.score(bench.whiten_changes(changes)) for name, changes in names if "angle" in name]
    return max(scores, key=lambda score: score.evidence, default=Score(0.0, 0, np.zeros(0), 0.0))


def _organs(bench: Bench) -> Iterator[Organ]:
    if bench.base.q_encoder is not None:
        for joint in JOINTS[: bench.base.q_encoder.shape[1]]:
            change = bench.change([make_effect("joint_offset", {"where": joint, "offset_rad": _STEP})]) / _STEP
            yield Organ(_angle_of(joint), [change])
    for name in bench.pipeline.sensors:
        yield Organ(f"a change of the {name}'s field", _field_changes(bench, name))
        yield Organ(f"a turn of the {name}", _turns(bench, name))
        yield Organ(f"an offset of the {name}", _offsets(bench, name))


def _angle_of(joint: str) -> str:
    return f"an error of {joint}'s angle"


def _courses(bench: Bench) -> list[Array]:
    """(n, m) each, from one on: time, then the moving joints."""
    count = len(bench.base)
    clock = (np.arange(count) + 0.5) / count
    found = [np.ones((count, 1)), *(np.cos(np.pi * order * clock)[:, None] for order in range(1, _TIMES + 1))]
    if (q := bench.base.q_encoder) is not None:
        for joint in turning(q):
            angles = [order * q[:, joint] for order in range(1, _ORDERS + 1)]
            found += [np.stack([np.cos(angle), np.sin(angle)], 1) for angle in angles]
            found.append(smooth_sign(bench.base.joint_velocity[:, [joint]]))
    return found


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


def _offsets(bench: Bench, name: str) -> list[Array]:
    """What an offset of each of a sensor's axes does to its channels."""
    found = []
    for column in range(len(CHANNELS))[COLUMNS_OF[name]]:
        change = np.zeros((len(bench.base), len(CHANNELS)))
        change[:, column] = bench.base.references[column]
        found.append(change)
    return found


def _felt(bench: Bench, name: str, in_tool: Array) -> Array:
    """(n, 6) readings of a field (n, 3) in the tool's frame."""
    sensor = bench.pipeline.sensors[name]
    found = np.zeros((len(in_tool), len(CHANNELS)))
    found[:, COLUMNS_OF[name]] = in_tool @ sensor.axes.T * np.asarray(sensor.sensitivity)
    return found
