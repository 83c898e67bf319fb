"""The quantities of a log, each with its own times: rows in which a quantity is missing belong to another rate."""

from __future__ import annotations

from collections.abc import Mapping as Table
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.interpolate import interp1d
from scipy.spatial.transform import Rotation, Slerp

from rig.arrays import Array, Mask
from rig.errors import RigError
from rig.recording.checks import check_finite
from scenarios.importing.mapping import Conventions
from scenarios.importing.quantities import PARTS, TIME_UNITS, Target, parse_target, unit_word
from scenarios.importing.text_log import Log
from scenarios.importing.whole_rows import whole_rows

LOUD: Final = "! "  #: begins what is to be said as a finding
_EPOCH: Final = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))
_LATEST_S: Final = 1e11  # three thousand years: later is no time, or a unit that it is not in
_ORTHOGONAL: Final = 0.02  # entries of R' R - 1: matrices rounded to two decimals pass, another kind of table does not
#: theta1, theta5, theta6 of Renk's Table 1 as joints 1, 5, 6 [rad], and where the others are locked.
_RENK_ZEROS: Final = {1: -np.pi / 2, 5: 0.0, 6: -np.pi}
_RENK_LOCKED: Final = {2: np.pi / 2, 3: -np.pi / 2, 4: 0.0}


@dataclass(frozen=True, eq=False)
class Track:
    """One quantity of a log.

    Attributes:
        log: where it comes from.
        kind: accel, mag, joints, rotation, position, temperature, supply, current.
        t: (n,) [s] of the log's own clock; None where it has no times.
        values: (n, k); of a rotation (n, 9), R_base_tool row by row.
        unit: recorded unit of readings; what it was made from, of a rotation.
        slides: of joints: the numbers of those that slide.
        joints: of motor currents: the number of each one's joint.
        rate_Hz: of a pose out of transforms, as of its log.
        left_out: rows of its log that were left out for a cell without a number.
    """

    log: str
    kind: str
    t: Array | None
    values: Array
    unit: str = ""
    slides: tuple[int, ...] = ()
    joints: tuple[int, ...] = ()
    rate_Hz: float | None = None
    left_out: int = 0

    def at(self, t: Array) -> Array:
        """Values (m, k) at times (m,) within the track's: linear, rotations along the shortest way."""
        assert self.t is not None
        if len(t) == len(self.t) and np.array_equal(t, self.t):
            return self.values
        if len(self.t) < 2:
            raise RigError(f"{self.log}: found {len(self.t)} row of {self.kind}, expected two or more to interpolate")
        if self.kind == "rotation":
            turns = Rotation.from_matrix(self.values.reshape(-1, 3, 3))
            return np.asarray(Slerp(self.t, turns)(t).as_matrix().reshape(-1, 9))
        return np.asarray(interp1d(self.t, self.values, axis=0)(t))


def tracks_of(log: Log, targets: Table[str, str], conventions: Conventions) -> tuple[list[Track], list[str]]:
    """What a log holds, by the targets of its columns, and what is to be said of it.

    Raises:
        RigError: a quantity is not whole, or poses are no rotations.
    """
    groups: dict[str, dict[str, tuple[str, Target]]] = {}
    for name, text in targets.items():
        target = parse_target(text)
        if target is None or name not in log.columns:
            continue
        parts = groups.setdefault(target.kind, {})
        if target.part in parts:
            raise RigError(
                f"{log.name}: columns {parts[target.part][0]!r} and {name!r} are both {text!r}, expected one"
            )
        parts[target.part] = (name, target)
    said: list[str] = []
    t, order = None, np.arange(len(next(iter(log.columns.values()))))
    if "time" in groups:
        name = groups.pop("time")[""][0]
        if np.isnan(log.columns[name]).all():
            raise RigError(f"{log.name}: {name} holds no number, expected times")
        check_finite(np.nan_to_num(log.columns[name], nan=0.0, posinf=np.inf, neginf=-np.inf), (name,), log.name)
        t, words = _times(name, log.columns[name], conventions)
        if np.nanmax(np.abs(t)) > _LATEST_S:
            row = int(np.nanargmax(np.abs(t)))
            raise RigError(
                f"{log.name}: {name} in row {row} (first row 0) is {log.columns[name][row]:g}, {words}: expected times"
                f" below {_LATEST_S:g} s, or another --time-unit"
            )
        order = np.argsort(t, kind="stable")
        missing = np.flatnonzero(np.isnan(t))
        whole_t = t[np.isfinite(t)]
        if back := int((np.diff(whole_t) < 0).sum()):
            row = int(np.flatnonzero(np.isfinite(t))[np.argmax(np.diff(whole_t) < 0) + 1])
            often = "once" if back == 1 else f"{back} times"
            said.append(f"{LOUD}{log.name}: time goes back {often}, first at row {row} (first row 0): sorted")
        said.append(f"{log.name}: time is {words}")
        if missing.size:
            left = f"{len(missing)} of {len(t)} rows, such as row {missing[0]} (first row 0)"
            said.append(f"{LOUD}{log.name}: {name} is missing in {left}: left out")
    found: list[Track] = []
    stacked = {kind: _stacked(kind, parts, log) for kind, parts in groups.items()}
    rows: dict[str, Mask] = {}
    left_out = 0
    if stacked:
        named = {kind: ([name for name, _ in own], values) for kind, (own, values) in stacked.items()}
        rows, left_out, wrong, notes = whole_rows(log.name, named, None if t is None else np.isfinite(t))
        said += [*(f"{LOUD}{line}" for line in wrong), *notes]
    when = None if t is None else t[order]
    for kind, (of_kind, values) in stacked.items():
        columns, whole = values[order], rows[kind][order]
        if when is not None:
            later = np.ones(len(when), dtype=bool)
            kept = np.flatnonzero(whole)
            later[kept[1:]] = np.diff(when[kept]) > 0
            if (dropped := int((whole & ~later).sum())) and not found:  # once for a log
                mark = LOUD if dropped > 0.01 * whole.sum() else ""  # a clock too coarse, or written with few digits
                said.append(
                    f"{mark}{log.name}: {dropped} of {whole.sum()} rows of {kind} repeat the time before: dropped"
                )
            whole &= later
        track = Track(
            log.name,
            kind,
            None if when is None else when[whole],
            columns[whole],
            rate_Hz=log.rate_Hz,
            left_out=left_out,
        )
        found.append(_converted(track, [target for _, target in of_kind], conventions))
    return found, said


def _stacked(kind: str, parts: dict[str, tuple[str, Target]], log: Log) -> tuple[list[tuple[str, Target]], Array]:
    """A quantity's columns, and their numbers (n, k) in the recorded unit, in the order of its parts."""
    wanted = PARTS.get(kind) or tuple(sorted(parts, key=lambda part: int(part or 0)))
    if kind == "joint":
        wanted = tuple(str(number) for number in range(1, max(map(int, parts)) + 1))
    if missing := [part for part in wanted if part not in parts]:
        have = ", ".join(repr(parts[part][0]) for part in parts)
        raise RigError(f"{log.name}: {kind}: part {missing[0]} is missing beside {have}, expected {', '.join(wanted)}")
    ordered = [parts[part] for part in wanted]
    return ordered, np.stack([target.factor * log.columns[name] for name, target in ordered], axis=1)


def _times(name: str, values: Array, conventions: Conventions) -> tuple[Array, str]:
    """[s], and in words where the unit comes from."""
    finite = values[np.isfinite(values)]
    unit: str
    if conventions.time_unit != "guess":
        unit, why = conventions.time_unit, "as stated"
    elif word := unit_word(name, tuple(TIME_UNITS)):
        unit, why = word, f"by the name {name!r}"
    else:
        largest = float(np.abs(finite).max(initial=0.0))
        step = float(np.median(np.abs(np.diff(finite)))) if len(finite) > 1 else 1.0
        unit = next((unit for bound, unit in _EPOCH if largest > bound), "")
        if not unit:
            unit = "s" if step <= 1.0 else "ms" if step <= 500.0 else "us" if step <= 5e5 else "ns"
        why = "by its range"
    start = finite[0] if abs(finite[0]) * TIME_UNITS[unit] > 1e8 else 0.0
    return (values - start) * TIME_UNITS[unit] + start * TIME_UNITS[unit], f"in {unit} {why}"


def _converted(track: Track, targets: list[Target], conventions: Conventions) -> Track:
    """A track of what the log's columns ``targets`` are, as one of what a recording has."""
    kind, values = track.kind, track.values
    if kind in ("accel", "mag"):
        units = [target.unit for target in targets]
        if len(set(units)) > 1:
            raise RigError(f"{track.log}: {kind} columns have the units {', '.join(units)}, expected one")
        return replace(track, unit=targets[0].recorded)
    if kind == "joint":
        slides = tuple(number for number, target in enumerate(targets, start=1) if target.recorded == "m")
        return replace(track, kind="joints", slides=slides)
    if kind == "theta":
        q = np.zeros((len(values), 6))
        for column, (joint, zero) in enumerate(_RENK_ZEROS.items()):
            q[:, joint - 1] = values[:, column] + zero
        for joint, angle in _RENK_LOCKED.items():
            q[:, joint - 1] = angle
        return replace(track, kind="joints", values=q)
    if kind in ("matrix", "quaternion", "euler"):
        unit = f"euler {conventions.euler}" if kind == "euler" else kind
        return replace(track, kind="rotation", values=_rotation(track, conventions), unit=unit)
    if kind == "current":
        return replace(track, joints=tuple(int(target.part) for target in targets))
    return track


def _rotation(track: Track, conventions: Conventions) -> Array:
    """(n, 9) R_base_tool."""
    values = track.values
    if track.kind == "matrix":
        R = values.reshape(-1, 3, 3)
        off = float(np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max())
        if off > _ORTHOGONAL:
            raise RigError(
                f"{track.log}: r11..r33 are no rotations: rows off right angles or length 1 by {off:.2g}, expected"
                " another order of the columns, or other columns"
            )
        if (flipped := np.linalg.det(R)).min() < 0:
            row = int(np.argmin(flipped))
            raise RigError(f"{track.log}: r11..r33 in row {row} are left-handed (determinant -1): expected rotations")
        turns = Rotation.from_matrix(R)
    elif track.kind == "quaternion":
        norm = np.linalg.norm(values, axis=1)
        if np.abs(norm - 1.0).max() > 0.05:
            row = int(np.argmax(np.abs(norm - 1.0)))
            raise RigError(f"{track.log}: the quaternion in row {row} has the norm {norm[row]:.4g}, expected 1")
        turns = Rotation.from_quat(values, scalar_first=True)
    else:
        turns = Rotation.from_euler(conventions.euler, values)
    if conventions.rotation == "tool<-base":
        turns = turns.inv()
    return np.asarray(turns.as_matrix().reshape(-1, 9))
