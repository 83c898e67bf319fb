"""What a recording made of logs shows of itself: its times, its units, and the conventions of its poses."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rig.arm import Arm
from rig.arrays import Array
from rig.channels import ACCELEROMETER, MAGNETOMETER
from rig.recording import Recording
from rig.recording.findings import degrees_words, gap_words, unit_words, unstated_words
from rig.units import ELECTRICAL
from scenarios.importing.conventions import MUCH, axis_words, judged
from scenarios.importing.mapping import Mapping
from scenarios.importing.tracks import Track


@dataclass(frozen=True, eq=False)
class Shown:
    """What a recording shows.

    Attributes:
        recording: with the sign of its accelerometer.
        wrong: what looks wrong; said: what is as it may be; open: what nobody has stated. All line by line.
    """

    recording: Recording
    wrong: tuple[str, ...]
    said: tuple[str, ...]
    open: tuple[str, ...]


def rotations_of(pose: Track, arm: Arm | None) -> Array | None:
    """(n, 9) R_base_tool of a pose; None where its joints are of an arm that is not known."""
    if pose.kind == "rotation":
        return pose.values
    if arm is None or pose.values.shape[1] != arm.dof:
        return None
    return arm.rotation_map.rotations(pose.values)


def shown_by(recording: Recording, pose: Track | None, mapping: Mapping, arm: Arm | None) -> Shown:
    """The recording with the accelerometer's sign, and what its times, units and conventions show.

    Args:
        pose: of the recording, at its instants.
        mapping: what was stated.
        arm: of the joints.
    """
    findings = [*gap_words(recording.t), *unit_words(recording)]
    if degrees := degrees_words(recording):
        findings.append(f"joints: {degrees}")
    remarks: list[str] = []
    unstated = list(unstated_words(recording, mapping.metadata.known).values())
    reads = mapping.conventions.accelerometer_reads
    rotations = None if pose is None else rotations_of(pose, arm)
    if pose is not None and rotations is None:
        taken = " and taken for the a465's" if recording.metadata.arm == "a465" else ""
        unstated.append(f"joint angles without --arm FILE: their conventions are not checked{taken}")
    handed: dict[str, Array] = {}
    for sensor in recording.sensors:
        if rotations is None or pose is None:
            break
        verdict = judged(pose, rotations, recording.readings(sensor), arm)
        if verdict.rival is not None:
            words, times = verdict.rival
            better = "only" if times is None else f"{times:.3g} times better"
            findings.append(f"poses: the {sensor} fits them {better} {words}: look at the mapping")
        elif verdict.misfit is not None and verdict.misfit > MUCH:
            findings.append(
                f"poses: {100 * verdict.misfit:.0f} % of the {sensor}'s field is left over, whatever usual"
                " convention is tried: look at the mapping (axes, order of joints, clock)"
            )
        if verdict.fit is None and verdict.rival is None:
            findings.append(f"poses: they do not tell the {sensor}'s axes, so its conventions cannot be checked")
        elif verdict.fit is not None and verdict.rival is None:
            handed[sensor] = verdict.fit.parameters.axes
    if ACCELEROMETER in handed:
        left = np.linalg.det(handed[ACCELEROMETER]) < 0
        digital = recording.unit(ACCELEROMETER) not in ELECTRICAL
        if reads == "detect" and digital and not left:
            findings.append(
                "accelerometer: reads -1 g upward at rest (g-a), rare for a chip: or an axis is mirrored, two exchanged"
            )
        elif reads == "detect" and not left:
            remarks.append(
                "accelerometer: reads -1 g upward at rest (g-a); if it is one that reads +1 g, an axis is mirrored or"
                " two are exchanged"
            )
        if reads == "detect" and left:
            reads = "a-g"
            remarks.append(
                "accelerometer: reads +1 g upward at rest (a-g, the common one), or an axis is mirrored: taken as a-g"
            )
        elif reads != "detect" and left != (reads == "a-g"):
            findings.append(
                "accelerometer: its axes are left-handed: an axis is mirrored, two are exchanged, or its sign"
            )
    if reads == "a-g":
        recording = replace(recording, metadata=replace(recording.metadata, accelerometer_reads="a-g"))
    for sensor, axes in handed.items():
        sign = -1.0 if sensor == ACCELEROMETER and reads == "a-g" else 1.0
        words = axis_words(sign * axes)
        if sensor == MAGNETOMETER and np.linalg.det(axes) < 0:
            # a chip's axes are right-handed; of three sensors by themselves each is mounted as it may be
            said = remarks if recording.unit(sensor) in ELECTRICAL else findings
            said.append(f"{sensor}: left-handed axes where the field points down: mirrored, or it points up")
        if words != "1 +x, 2 +y, 3 +z":
            remarks.append(f"{sensor}: axes in the tool: {words}; a calibration takes that up by itself")
    return Shown(recording, tuple(findings), tuple(remarks), tuple(unstated))
