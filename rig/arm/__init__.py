"""The arm: where the sensor is and how it moves, from whatever file describes it, and what it can be asked to do."""

from rig.arm.serial import Arm, LinkPoses

__all__ = ["Arm", "LinkPoses"]
