"""From logs to a recording: columns to quantities, quantities to one clock, and what a wrong convention would show."""

from __future__ import annotations

from collections.abc import Mapping as Table
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from rig.arm import Arm
from rig.arrays import Array
from rig.channels import ACCELEROMETER, MAGNETOMETER, SENSORS
from rig.errors import RigError, nearest
from rig.pose_nodes import quaternions
from rig.recording import Metadata, Recording
from rig.recording.metadata import FIELD_SIZES
from scenarios.importing.bag_log import is_bag, read_bag
from scenarios.importing.clocks import clock_offset
from scenarios.importing.logged_conventions import rotations_of, shown_by
from scenarios.importing.mapping import Conventions, Mapping
from scenarios.importing.quantities import guess, is_numbered, is_time, kind_of
from scenarios.importing.text_log import Log, read_text_log
from scenarios.importing.tracks import LOUD, Track, tracks_of

_OTHER_CLOCK_S: Final = 0.5  # no sensor is later than this: more is another clock
_LISTED: Final = 24  # columns that no recording came to hold


@dataclass(frozen=True, eq=False)
class Imported:
    """A recording made of logs.

    Attributes:
        recording, mapping: what came out, and which column was taken for what.
        said: how the logs were read, line by line.
        findings: what looks wrong, and what it would be, line by line, which stays with the recording; and what nobody
            has stated. Empty where all is well.
        unused: by log, the columns that the recording does not hold.
    """

    recording: Recording
    mapping: Mapping
    said: tuple[str, ...]
    findings: tuple[str, ...]
    unused: Table[str, tuple[str, ...]]


def import_logs(
    paths: Sequence[Path], mapping: Mapping | None, arm: Arm | None, base: Mapping | None = None
) -> Imported:
    """One recording of one or several logs.

    Args:
        paths: text tables, MCAP files, ROS 2 bags.
        mapping: which column is what; None: guessed.
        arm: of the joints, whose names are looked for and whose kinematics check them.
        base: conventions and metadata for a guess.

    Raises:
        RigError: a log that cannot be read, columns that make no recording, poses that are none.
    """
    conventions = (mapping or base or Mapping()).conventions
    frames = conventions.base_frame, conventions.tool_frame
    if any(frames) and not any(map(is_bag, paths)):
        raise RigError(f"{paths[0]}: no bag, expected one with the transforms of base_frame and tool_frame")
    logs = [log for path in paths for log in (read_bag(path, *frames) if is_bag(path) else [read_text_log(path)])]
    said = [f"{log.name}: {log.said}" for log in logs if log.said]
    if mapping is None:
        mapping = _guessed(logs, arm, base or Mapping())
    else:
        present = [name for log in logs for name in (*log.columns, *log.unread)]
        if absent := next((name for name in mapping.columns if name not in present), None):
            more = ", .." if len(present) > 10 else ""
            known = f"{', '.join(present[:10])}{more}{nearest(absent, present)}"
            raise RigError(f"{paths[0]}: no log has a column {absent!r}: expected one of {known}")
    _check_numbers(logs, mapping)
    tracks: dict[str, Track] = {}
    for log in logs:
        own = {name: target for name, target in mapping.columns.items() if name in log.columns}
        found, words = tracks_of(log, own, mapping.conventions)
        said += words
        for track in found:
            if track.kind in tracks:
                said.append(f"{track.log}: {track.kind} is taken from {tracks[track.kind].log}: passed over here")
            tracks.setdefault(track.kind, track)
    recording, joined, findings = _joined(tracks, mapping, arm, said)
    shown = shown_by(recording, joined, mapping, arm)
    loud = [line.removeprefix(LOUD) for line in said if line.startswith(LOUD)]
    quiet = [line for line in said if not line.startswith(LOUD)]
    wrong = (*loud, *findings, *shown.wrong)
    recording = replace(shown.recording, metadata=replace(shown.recording.metadata, findings=wrong))
    unused = _unused_columns(logs, mapping.columns, recording)
    listed, lacking = _unused_words(unused, recording)
    open_questions = (*shown.open, *(listed if lacking else ()))
    remarks = (*quiet, *shown.said, *(() if lacking else listed))
    return Imported(recording, mapping, remarks, (*wrong, *open_questions), unused)


def _check_numbers(logs: Sequence[Log], mapping: Mapping) -> None:
    """Refuse a wanted column with a cell that is no number, and times that are written as texts."""
    timed = "t" in mapping.columns.values()
    for log in logs:
        for name, words in log.unread.items():
            if name in mapping.columns or (not timed and is_time(name)):
                raise RigError(f"{log.name}: {name} {words}, expected {'seconds' if is_time(name) else 'a number'}")


def _guessed(logs: Sequence[Log], arm: Arm | None, base: Mapping) -> Mapping:
    columns: dict[str, str] = {}
    theta = base.conventions.angles == "renk2005"
    names = arm.joint_names if arm is not None else ()
    for log in logs:
        for name, target in guess(log.columns, names, theta).items():
            columns.setdefault(name, target)
    if not any(target.startswith(("accel", "mag")) for target in columns.values()):
        listed = ", ".join(repr(name) for log in logs for name in log.columns)[:160]
        raise RigError(
            f"{logs[0].name}: no accelerometer or magnetometer can be told among the columns {listed}: expected"
            " --map MAP.toml that names them"
        )
    return replace(base, columns=columns)


def _joined(
    tracks: dict[str, Track], mapping: Mapping, arm: Arm | None, said: list[str]
) -> tuple[Recording, Track | None, list[str]]:
    """The recording at the instants of the readings; the pose there; findings."""
    readings = [tracks[kind] for kind in ("accel", "mag") if kind in tracks]
    tracks = _one_pose(tracks, arm, said)
    if not readings:
        raise RigError("no log has an accelerometer or a magnetometer, expected one in the mapping")
    pose = tracks.get("joints") or tracks.get("rotation")
    findings: list[str] = []
    timed = [track for track in (*readings, pose) if track is not None]
    untimed = [track for track in timed if track.t is None]
    if untimed and len(timed) > len(untimed):
        raise RigError(
            f"{untimed[0].log}: {untimed[0].kind} has no time although other logs have one, expected a column t"
        )
    main = readings[0]
    metadata = Metadata(arm=_arm_name(pose, mapping, arm))
    if main.t is None:
        sizes = {track.kind: len(track.values) for track in tracks.values()}
        if len(set(sizes.values())) > 1:
            raise RigError(f"{main.log}: without times all must have as many rows, found {sizes}")
        gappy = next((track for track in tracks.values() if track.left_out), None)
        if gappy is not None and len({track.log for track in tracks.values()}) > 1:
            raise RigError(
                f"{gappy.log}: {gappy.left_out} of {gappy.left_out + len(gappy.values)} rows left out for a cell"
                " without a number, and without times logs are joined row by row: expected whole rows, or a column t"
                " in each log"
            )
        t = np.arange(len(main.values), dtype=float)
        metadata = replace(metadata, still_poses=True)
        said.append(f"no time: each of the {len(t)} rows is a still pose, t_s counts them")
    else:
        if pose is not None:
            pose = _on_one_clock(main, pose, mapping.conventions, arm, said, findings)
        spans = [track.t for track in (*readings, pose) if track is not None and track.t is not None]
        start, end = max(each[0] for each in spans), min(each[-1] for each in spans)
        t = main.t[(main.t >= start) & (main.t <= end)]
        if len(t) < 2:
            raise RigError(f"{main.log}: its times and those of the other logs do not overlap, expected one clock")
        if len(t) < len(main.t):
            said.append(f"{main.log}: {len(main.t) - len(t)} rows before the first or after the last pose: left out")
        metadata = replace(metadata, rate_Hz=float(np.round(1.0 / np.median(np.diff(t)), 3)))
    if pose is not None and pose.t is not None and (slow := _slower(pose, t)) is not None:
        rate = float(np.round(slow, 3))
        metadata = replace(metadata, pose_rate_Hz=rate)
        said.append(f"poses are interpolated to the readings' instants: recorded at {rate:g} Hz")

    def at(kind: str) -> Array | None:
        track = pose if pose is not None and kind == pose.kind else tracks.get(kind)
        if track is None:
            return None
        if main.t is None or track.t is None:
            return track.values
        return track.at(np.clip(t, track.t[0], track.t[-1]))

    turns = at("rotation")
    joints, position = at("joints"), at("position")
    values = joints if joints is not None else turns
    here = None if pose is None or values is None else replace(pose, t=t, values=values)
    if arm is not None and joints is not None and joints.shape[1] != arm.dof:
        raise RigError(
            f"{tracks['joints'].log}: found {joints.shape[1]} joints, expected {arm.dof} of arm {arm.name!r}"
        )
    temperature, supply, currents = at("temperature"), at("supply"), at("current")
    known = mapping.metadata.known
    known["assumed"] = tuple(name for name in FIELD_SIZES if name not in known)
    known["notes"] = "; ".join(filter(None, [known.get("notes"), "made by rig import", *said]))[:1500]
    metadata = replace(metadata, **known)
    units = {ACCELEROMETER: "accel", MAGNETOMETER: "mag"}
    recording = Recording(
        t=t - t[0] if main.t is not None else t,
        q=joints,
        slides=tracks["joints"].slides if "joints" in tracks else (),
        tool_quaternion=None if turns is None else quaternions(turns),
        tool_position=position if turns is not None else None,
        accelerometer=at("accel"),
        magnetometer=at("mag"),
        units={sensor: tracks[kind].unit for sensor, kind in units.items() if kind in tracks},
        temperature=None if temperature is None else temperature[:, 0],
        supply=None if supply is None else supply[:, 0],
        currents={} if currents is None else dict(zip(tracks["current"].joints, currents.T, strict=True)),
        metadata=metadata,
        name="import",
    )
    return recording, here, findings


def _one_pose(tracks: dict[str, Track], arm: Arm | None, said: list[str]) -> dict[str, Track]:
    """Without the lesser of joints and a pose out of transforms, which come from the same joints.

    Joints are taken where their arm is known, and the transforms, which need none, where it is not.
    """
    joints, turns = tracks.get("joints"), tracks.get("rotation")
    if joints is None or turns is None or turns.rate_Hz is None:
        return tracks
    left = ("joints",) if arm is None else ("rotation", "position")
    why = "without --arm the transforms give the pose" if arm is None else "the joints of --arm give the pose"
    said.append(f"{(joints if arm is None else turns).log}: passed over: {why}")
    return {kind: track for kind, track in tracks.items() if kind not in left}


def _slower(pose: Track, t: Array) -> float | None:
    """The rate [Hz] of poses that had to be interpolated to the readings' instants; None where they had not."""
    assert pose.t is not None
    if pose.rate_Hz is not None:
        return pose.rate_Hz if np.isfinite(pose.rate_Hz) else None
    return None if np.isin(t, pose.t).all() else float(1.0 / np.median(np.diff(pose.t)))


def _arm_name(pose: Track | None, mapping: Mapping, arm: Arm | None) -> str:
    """Of the recording's metadata; six joints that are numbered, not named, are the rig's own arm's if they
    keep its limits."""
    if pose is None or pose.kind == "rotation":
        return "none"
    if arm is not None:
        return arm.name
    own = Arm.a465()
    named = [name for name, target in mapping.columns.items() if kind_of(target) == "joint" and not is_numbered(name)]
    if named or pose.values.shape[1] != own.dof:
        return "unknown"
    try:
        own.check_limits(pose.values, pose.log)
    except RigError:
        return "unknown"
    return own.name


def _on_one_clock(
    main: Track, pose: Track, conventions: Conventions, arm: Arm | None, said: list[str], findings: list[str]
) -> Track:
    """The poses with their times on the readings' clock, and what is to be said of it."""
    assert main.t is not None
    assert pose.t is not None
    if main.log == pose.log and conventions.clock_offset_s is None:
        return pose
    if isinstance(conventions.clock_offset_s, float):
        said.append(f"clock: {conventions.clock_offset_s:g} s added to the times of the poses, as stated")
        return replace(pose, t=pose.t + conventions.clock_offset_s)
    overlap = min(main.t[-1], pose.t[-1]) - max(main.t[0], pose.t[0])
    apart = overlap < 0.5 * min(np.ptp(main.t), np.ptp(pose.t))
    rotations = rotations_of(pose, arm)
    if rotations is None or len(pose.t) < 2:
        if apart:
            raise RigError(
                f"{pose.log}: its clock has nothing in common with that of {main.log}, and without --arm its offset"
                " cannot be found: expected clock_offset_s in the mapping, or --arm FILE"
            )
        return pose
    auto = conventions.clock_offset_s == "auto"
    found = clock_offset(main, pose, rotations, apart, anywhere=auto)
    words = f"{found.seconds:+.4f} +- {found.std:.4f} s"
    if apart or auto or (found.told and abs(found.seconds) > _OTHER_CLOCK_S):
        if not np.isfinite(found.std):
            raise RigError(
                f"{pose.log}: the motion does not tell the offset to the clock of {main.log}: expected clock_offset_s"
            )
        findings.append(f"two clocks: {words} added to the times of the poses, at which the readings follow them best")
        return replace(pose, t=pose.t + found.seconds)
    if found.told:
        findings.append(
            f"clock: the readings follow the poses best with {words} added to the times of the poses; kept as logged"
            " (a late sensor does this too): clock_offset_s in the mapping, or --clock-offset auto, takes it out"
        )
    else:
        said.append(f"clock: one for poses and readings (offset {words})")
    return pose


def _unused_columns(logs: Sequence[Log], targets: Table[str, str], recording: Recording) -> dict[str, tuple[str, ...]]:
    """By log, the columns that are nothing in the mapping, or nothing that this recording holds.

    Args:
        targets: column -> what it is.
    """
    idle = {name for name, text in targets.items() if recording.tool_position is None and kind_of(text) == "position"}
    found: dict[str, tuple[str, ...]] = {}
    for log in logs:
        every = dict.fromkeys((*log.columns, *log.unread))
        if left := tuple(name for name in every if name not in targets or name in idle):
            found[log.name] = left
    return found


def _unused_words(unused: Table[str, Sequence[str]], recording: Recording) -> tuple[list[str], bool]:
    """A line a log, and whether the recording lacks a sensor or the pose, which these columns may be."""
    lacking = [f"no {sensor}" for sensor in SENSORS if sensor not in recording.sensors]
    lacking += ["no pose"] * (recording.pose == "none")
    said = f"{' and '.join(lacking)} was recognised: name the columns in --map MAP.toml if they hold it"
    meant = f"; {said}" if lacking else ""
    found = []
    for log, names in unused.items():
        listed = ", ".join(map(repr, names[:_LISTED]))
        more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
        found.append(f"{log}: {len(names)} column{'s' * (len(names) > 1)} not used: {listed}{more}{meant}")
    return found, bool(lacking)
