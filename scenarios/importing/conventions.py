"""What a wrong convention would do: gravity and the field must come out constant in the base."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from estimators.known_angle.fit import SensorFit, fit_sensor
from estimators.known_angle.statistics import Statistics
from rig.arm import Arm
from rig.arrays import Array, Rows
from rig.errors import RigError
from scenarios.importing.tracks import Track

_ROWS: Final = 2000
#: A rival reading of the poses is named where it leaves less than this share of the misfit, and one is suspected where
#: this share of the field is left.
_BETTER: Final = 0.6
_ALIKE: Final = 1.1  # rivals within this factor of the best are as good
_NAMED: Final = 4
MUCH: Final = 0.15
#: A sensor axis belongs to an axis of the tool within this [deg].
_NEAR_DEG: Final = 35.0


@dataclass(frozen=True)
class Verdict:
    """What the check found.

    Attributes:
        misfit: residual over what the readings vary by; None where the poses cannot tell.
        rival: the better reading of the poses, in words (several that are as good: mirrored worlds give the same
            readings), and how many times better, or None where as they stand they tell nothing; None: there is none.
        fit: of the sensor, as the poses stand.
    """

    misfit: float | None
    rival: tuple[str, float | None] | None
    fit: SensorFit | None


def fitted(rotations: Array, readings: Array, noise: Array | None = None) -> SensorFit | None:
    """The calibration by these rotations (n, 9); None where they cannot tell it."""
    if len(readings) < 15:
        return None
    try:
        fit = fit_sensor(Statistics.from_rotations(rotations, readings), refuse=False, noise=noise)
    except (RigError, np.linalg.LinAlgError):
        return None
    return None if fit.problem is not None else fit


def _misfit(fit: SensorFit | None, readings: Array) -> float:
    """RMS residual over that of the readings about their means, all channels together."""
    return np.inf if fit is None else float(np.sqrt(np.sum(fit.rms**2) / np.sum(readings.var(axis=0))))


def judged(pose: Track, rotations: Array, readings: Array, arm: Arm | None) -> Verdict:
    """The poses as they stand, held against the usual mistakes.

    Args:
        pose: rotations or joints at the readings' instants.
        rotations: (n, 9) R_base_tool.
        readings: (n, 3).
        arm: of the joints.
    """
    rows = np.unique(np.linspace(0, len(readings) - 1, min(_ROWS, len(readings))).astype(int))
    part = readings[rows]
    fit = fitted(rotations[rows], part)
    own = _misfit(fit, part)
    tried = [(_misfit(fitted(turned, part), part), words) for words, turned in _rivals(pose, rotations, rows, arm)]
    least = min((misfit for misfit, _ in tried), default=np.inf)
    known = own if np.isfinite(own) else None
    if not least < (_BETTER * own if known is not None else MUCH):
        return Verdict(known, None, fit)
    alike = [words for misfit, words in tried if misfit < _ALIKE * least]
    return Verdict(known, (", or ".join(alike[:_NAMED]), None if known is None else own / max(least, 1e-12)), fit)


def _rivals(pose: Track, rotations: Array, rows: Rows, arm: Arm | None) -> Iterator[tuple[str, Array]]:
    """The usual mistakes, in words, with the rotations (m, 9) that they would mean."""
    if pose.kind == "rotation":
        R = rotations[rows].reshape(-1, 3, 3)
        yield 'transposed (rotation = "tool<-base", or the other way round)', np.swapaxes(R, 1, 2).reshape(-1, 9)
        turns = Rotation.from_matrix(R)
        if pose.unit == "quaternion":
            for inverse in (False, True):
                quat = (turns.inv() if inverse else turns).as_quat(scalar_first=True)
                for names, places in (("x, y, z, w", [3, 0, 1, 2]), ("w, x, y, z", [1, 2, 3, 0])):
                    swapped = Rotation.from_quat(quat[:, places], scalar_first=True)
                    for back in (False, True):
                        words = f"with the quaternion in the order {names}" + (" and transposed" if back else "")
                        yield words, (swapped.inv() if back else swapped).as_matrix().reshape(-1, 9)
        if pose.unit.startswith("euler"):
            yield from _euler_rivals(turns, pose.unit.split()[1])
        return
    if arm is None or pose.kind != "joints":
        return
    q = pose.values[rows]
    turn = [joint for joint in range(arm.dof) if not arm.slides[joint]]
    moving = [joint for joint in turn if np.ptp(q[:, joint]) > 1e-3]

    def having(joints: list[int], values: Array) -> Array:
        changed = q.copy()
        changed[:, joints] = values
        return arm.rotation_map.rotations(changed)

    for unit, factor in (("in degrees, not radians", np.pi / 180.0), ("in radians, not degrees", 180.0 / np.pi)):
        yield f"with the joints {unit}", having(turn, factor * q[:, turn])
    for joint in moving:
        yield f"with {arm.joint_names[joint]} of the other sign", having([joint], -q[:, [joint]])
    for a, b in itertools.combinations(turn, 2):
        if a in moving or b in moving:
            yield f"with {arm.joint_names[a]} and {arm.joint_names[b]} exchanged", having([a, b], q[:, [b, a]])
    yield "with the joints in reverse order", having(list(range(arm.dof)), q[:, ::-1])


def _euler_rivals(turns: Rotation, stated: str) -> Iterator[tuple[str, Array]]:
    """All twelve orders about turned and about fixed axes, of the angles as they were read."""
    with warnings.catch_warnings():  # a pose at the pole has many angles: any will do
        warnings.simplefilter("ignore")
        angles = turns.as_euler(stated)
    triples = itertools.product("xyz", repeat=3)
    for order in ("".join(triple) for triple in triples if triple[0] != triple[1] != triple[2]):
        for convention in (order.upper(), order):
            for inverse in (False, True):
                turned = Rotation.from_euler(convention, angles)
                words = f"with euler = {convention!r}" + (" and transposed" if inverse else "")
                yield words, (turned.inv() if inverse else turned).as_matrix().reshape(-1, 9)
            for unit, factor in (("degrees", np.pi / 180.0), ("radians", 180.0 / np.pi)):
                turned = Rotation.from_euler(convention, angles * factor)
                yield f"with euler = {convention!r} in {unit}", turned.as_matrix().reshape(-1, 9)


def axis_words(axes: Array) -> str:
    """How a sensor's axes (3, 3) sit in the tool, such as "1 +y, 2 -x, 3 +z"; the angles where they lie between."""
    words = []
    for number, axis in enumerate(axes, start=1):
        along = int(np.argmax(np.abs(axis)))
        off = float(np.degrees(np.arccos(min(1.0, abs(axis[along])))))
        near = f"{'+' if axis[along] > 0 else '-'}{'xyz'[along]}"
        words.append(f"{number} {near}" if off < _NEAR_DEG else f"{number} {off:.0f} deg off {near}")
    return ", ".join(words)
