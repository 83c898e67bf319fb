"""Errors that all channels share: of a joint's angle, of a field, of the mount, whatever they follow.

A mechanism that is not in the catalogue still acts through the arm and the sensor: what it does to the six channels is
one error of an angle, a field or a mounting, times an unknown course along time and joint angles. Low orders of such
courses, coherent over the channels, show it at signal-to-noise where no single channel does.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
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
#: The name of what is off where sensors and joints are not read at the same time.
CLOCK: Final = "an error of the clock"
#: Angle [rad] and delay [s] at which derivatives are taken.
_STEP: Final = 1e-5
_DELAY: Final = 1e-4
#: Blocks of a recording in which an organ may be off by something else each.
_BLOCKS: Final = (32, 128, 512)
#: Standard errors by which the floor may be off.
_FLOOR_OFF: Final = 2.0


@dataclass(frozen=True)
class Organ:
    """Something of the arm or of a sensor that can be off.

    Attributes:
        name: what is off, in words.
        changes: (n, 6) [recorded unit] what a unit of each of its freedoms does to the readings.
    """

    name: str
    changes: list[Array]


@dataclass(frozen=True)
class Trial:
    """An organ that is off along courses, beside a residual.

    Attributes:
        organ: its name.
        gram: (m, m) what of the whitened columns, one for each freedom and course, is not explained yet.
        moment: (m,) of these columns and the residual. length: (m,) of the columns, unprojected.
        courses: which columns belong to each of the courses.
    """

    organ: str
    gram: Array
    moment: Array
    length: Array
    courses: list[NDArray[np.intp]]

    @property
    def together(self) -> Score:
        """Off along all courses at once."""
        return solve(self.gram, self.moment, self.length)

    @property
    def alone(self) -> list[Score]:
        """Off along each of the courses."""
        return [solve(self.gram[np.ix_(own, own)], self.moment[own], self.length[own]) for own in self.courses]


def trials(
    bench: Bench, explained: Explained, courses: Sequence[Array] | None = None, only: Sequence[str] = ()
) -> Iterator[Trial]:
    """Every organ, or only those named, off along courses (n, k): by default those of time and of the moving joints."""
    courses = _courses(bench) if courses is None else courses
    together = np.hstack(courses)
    ends = np.cumsum([0] + [course.shape[1] for course in courses])
    for organ in _organs(bench):
        if only and organ.name not in only:
            continue
        columns = bench.whiten_changes([change * course[:, None] for change in organ.changes for course in together.T])
        if not len(columns.values):
            continue
        freedoms = ends[-1] * np.arange(len(organ.changes))
        yield Trial(
            organ.name,
            explained.unexplained(columns, explained.projected(columns)),
            columns.values.T @ explained.residual[columns.rows],
            np.linalg.norm(columns.values, axis=0),
            [np.add.outer(freedoms, np.arange(*span)).ravel() for span in itertools.pairwise(ends)],
        )


def in_detail(bench: Bench, explained: Explained) -> Iterator[tuple[str, float, int]]:
    """What is off by something else in every block of time: its name, chi-square, and degrees of freedom.

    What is explained takes some of these freedoms, and the floor may be off as far as it is not known: the chi-square
    is too small rather than too large.
    """
    residual = explained.residual.reshape(len(bench.columns), bench.count)
    sure = 1.0 + _FLOOR_OFF * float(np.sqrt(2.0 / np.min(bench.floor_samples[bench.columns])))
    for organ in _organs(bench):
        columns = bench.whiten_changes(organ.changes)
        if not len(columns.values):
            continue
        touched = columns.values.T.reshape(len(organ.changes), -1, bench.count)
        left = residual[columns.first // bench.count :][: touched.shape[1]]
        for blocks in _BLOCKS:
            edges = np.linspace(0, bench.count, blocks, endpoint=False).astype(int)
            grams = np.add.reduceat(np.einsum("icn,jcn->nij", touched, touched), edges, axis=0)
            moments = np.add.reduceat(np.einsum("icn,cn->ni", touched, left), edges, axis=0)
            inverse = np.linalg.pinv(grams, rcond=1e-6, hermitian=True)
            ranks = np.linalg.matrix_rank(grams, hermitian=True, rtol=1e-6)
            statistic = float(np.einsum("ni,nij,nj->", moments, inverse, moments))
            yield f"{organ.name}, in detail", statistic / sure, int(ranks.sum())


def likeliest(
    bench: Bench,
    rivals: int,
    explained: Explained | None = None,
    courses: Sequence[Array] | None = None,
    only: Sequence[str] = (),
) -> float:
    """The most evidence that one organ off along one course has, beside so many rivals that are as likely beforehand.

    Some of these pairs are effects of the catalogue; where that holds the truth, none has more evidence than it.

    Args:
        bench: of the base fit, each mean with the rig evaluated once.
        rivals: the catalogue's candidates.
        explained: what is explained already; the calibration alone by default.
        courses, only: as for ``trials``.
    """
    explained = Explained(bench.absorbed, bench.whitened) if explained is None else explained
    found = [score.evidence for trial in trials(bench, explained, courses, only) for score in trial.alone]
    return max(found, default=0.0) - 2.0 * float(np.log(max(len(found) / rivals, 1.0)))


def turning(q: Array) -> list[int]:
    """The joints (columns of q (n, N) [rad]) that are not locked."""
    return [joint for joint in range(q.shape[1]) if np.std(np.unwrap(q[:, joint])) > _LOCKED]


def of_one_joint(bench: Bench, explained: Explained) -> Score:
    """The best score of an error of one joint's angle."""
    scores = [trial.together for trial in trials(bench, explained, only=[angle_of(joint) for joint in JOINTS])]
    return max(scores, key=lambda score: score.evidence, default=Score(0.0, 0, np.zeros(0), 0.0))


def drifts(bench: Bench, steps: Sequence[float]) -> list[Array]:
    """(n, 1) each: slow courses of time that are not constant, and jumps at instants [s]."""
    return [*_times(bench)[1:], *((bench.base.t > at)[:, None].astype(float) for at in steps)]


def _organs(bench: Bench) -> Iterator[Organ]:
    if bench.base.q_encoder is not None:
        for joint in JOINTS[: bench.base.q_encoder.shape[1]]:
            change = bench.change([make_effect("joint_offset", {"where": joint, "offset_rad": _STEP})]) / _STEP
            yield Organ(angle_of(joint), [change])
    late = make_effect("latency", {"where": "acquisition", "delay_s": _DELAY})
    yield Organ(CLOCK, [bench.change([late]) / _DELAY])
    for name in bench.pipeline.sensors:
        yield Organ(f"a change of the {name}'s field", _field_changes(bench, name))
        yield Organ(f"a turn of the {name}", _turns(bench, name))
        yield Organ(f"an offset of the {name}", _offsets(bench, name))


def angle_of(joint: str) -> str:
    """The name of what is off where a joint's angle is."""
    return f"an error of {joint}'s angle"


def _times(bench: Bench) -> list[Array]:
    """(n, 1) each: slow courses of time, the constant one first."""
    count = len(bench.base)
    clock = (np.arange(count) + 0.5) / count
    waves = [np.cos(np.pi * order * clock) for order in range(1, _TIMES + 1)]
    return [course[:, None] for course in (np.ones(count), 2.0 * clock - 1.0, *waves)]


def _courses(bench: Bench) -> list[Array]:
    """(n, m) each: time, then the moving joints."""
    found = _times(bench)
    if (q := bench.base.q_encoder) is not None:
        for joint in turning(q):
            angles = [order * q[:, joint] for order in range(1, _ORDERS + 1)]
            found += [np.stack([np.cos(angle), np.sin(angle)], 1) for angle in angles]
            found.append(smooth_sign(bench.base.joint_velocity[:, [joint]]))
    return found


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
