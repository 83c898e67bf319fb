"""What one recording looks like on its way from encoder angles to volts, stage by stage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.arrays import Array
from rig.errors import RigError
from rig.pose_nodes import PoseNodes, find_nodes

if TYPE_CHECKING:
    from rig.arm import Arm

_SCALAR_PER_SAMPLE = ("t", "temperature", "supply")


def _empty() -> Array:
    return np.empty((0, 0))


@dataclass(frozen=True)
class Signals:
    """The signals of n samples; a stage that has not run yet has left its arrays empty.

    Attributes:
        t: (n,) [s].
        arm: the arm, None where poses were measured instead of joint angles.
        q_encoder: (n, N) [rad] what the encoders read; None without joints.
        q: (n, N) [rad] the true joint angles, after the transmission.
        R_base_tool: (n, 3, 3) orientation of frame 6.
        position: (n, 3) [m] the sensor, base frame.
        acceleration: (n, 3) [m/s^2] the sensor's acceleration, base frame; zero in the quasi-static model.
        gravity: (n, 3) or (3,) [m/s^2], base frame, at the sensor.
        magnetic: (n, 3) or (3,) [field unit], base frame, at the sensor.
        inputs: (n, 6) what each channel's axis feels [m/s^2, field unit].
        volts: (n, 6) [V].
        references: (6,) full reference X of each channel: the stated magnitudes [m/s^2, field unit].
        velocity: (n, N) [rad/s] joint velocity; from the encoders where nobody gave it.
        temperature: (n,) [degC], currents: joint number -> (n,) [A], supply: (n,) [V]; where recorded.
        electrical: whether the readings are a voltage or a converter's count, not a field that a chip computed.
        known_links: the link poses of one array ``q``, so that effects which leave it alone need not compute them
            again.
        known_nodes: the nodes of the poses as they were logged, where these were looked for: effects that change the
            poses, and samples of them, keep these.
    """

    t: Array
    arm: Arm | None = None
    q_encoder: Array | None = None
    q: Array = field(default_factory=_empty)
    R_base_tool: Array = field(default_factory=_empty)
    position: Array = field(default_factory=_empty)
    acceleration: Array = field(default_factory=lambda: np.zeros(3))
    gravity: Array = field(default_factory=_empty)
    magnetic: Array = field(default_factory=_empty)
    inputs: Array = field(default_factory=_empty)
    volts: Array = field(default_factory=_empty)
    references: Array = field(default_factory=lambda: np.repeat([9.8, 1.0], 3))
    velocity: Array | None = None
    temperature: Array | None = None
    currents: Mapping[int, Array] = field(default_factory=dict)
    supply: Array | None = None
    electrical: bool = True
    known_links: tuple[Array, tuple[tuple[Array, Array], ...]] | None = None
    known_nodes: tuple[PoseNodes | None] | None = None

    def __len__(self) -> int:
        return len(self.t)

    @cached_property
    def joint_velocity(self) -> Array:
        """(n, N) [rad/s]: as given, else by central differences of the encoder angles."""
        if self.velocity is not None:
            return self.velocity
        return np.gradient(self.encoder_angles, self.t, axis=0)

    @property
    def encoder_angles(self) -> Array:
        """(n, N) [rad].

        Raises:
            RigError: the recording has no joint angles.
        """
        if self.q_encoder is None:
            raise RigError(
                "the effect acts on a joint: found a recording without joint angles, expected q1_rad..qN_rad"
            )
        return self.q_encoder

    @cached_property
    def pose_nodes(self) -> PoseNodes | None:
        """The nodes between which logged poses were interpolated; None where they were not, or joints were logged."""
        if self.known_nodes is not None:
            return self.known_nodes[0]
        if self.q_encoder is not None or not self.R_base_tool.size:
            return None
        return find_nodes(self.t, self.R_base_tool, self.position)

    def link_pose(self, link: int) -> tuple[Array, Array]:
        """R_base_link (n, 3, 3) and position (n, 3) [m] of a link, counted from 0, at the true joint angles.

        Raises:
            RigError: the recording has no joint angles.
        """
        if self.known_links is not None and self.known_links[0] is self.q:
            return self.known_links[1][link]
        return self._jointed_arm.link_pose(link, self.q)

    def link_rotation(self, link: int) -> Array:
        """As the first of ``link_pose``."""
        if self.known_links is not None and self.known_links[0] is self.q:
            return self.known_links[1][link][0]
        return self._jointed_arm.link_maps[link].rotations(self.q).reshape(-1, 3, 3)

    def knowing_links(self) -> Signals:
        """With the poses of all links known, and the joint velocities."""
        links = tuple(self.link_pose(link) for link in range(self._jointed_arm.dof))
        return replace(self, velocity=self.joint_velocity, known_links=(self.q, links))

    @property
    def _jointed_arm(self) -> Arm:
        if self.arm is None or self.q.size == 0:
            raise RigError("the effect acts on a link: found a recording without joint angles, expected q1_rad..qN_rad")
        return self.arm

    @property
    def temperatures(self) -> Array:
        """(n,) [degC].

        Raises:
            RigError: the temperature was not recorded.
        """
        if self.temperature is None:
            raise RigError("the effect follows the temperature: found none, expected a column temperature_degC")
        return self.temperature


def sampled(signals: Signals, rows: slice | NDArray[np.intp]) -> Signals:
    """The signals at some of their samples."""
    count = len(signals)
    kept: dict[str, Any] = {"currents": {joint: current[rows] for joint, current in signals.currents.items()}}
    for item in fields(signals):
        value = getattr(signals, item.name)
        per_sample = isinstance(value, np.ndarray) and value.shape[:1] == (count,)
        if per_sample and (value.ndim > 1 or item.name in _SCALAR_PER_SAMPLE):  # (3,) fields hold for every sample
            kept[item.name] = value[rows]
    return replace(signals, **kept)


def joined(parts: Sequence[Signals]) -> Signals:
    """The signals of several recordings one after another; what not all of them have is left out."""
    found: dict[str, Any] = {}
    for item in fields(Signals):
        values = [getattr(part, item.name) for part in parts]
        if item.name in ("arm", "references", "known_links", "known_nodes", "currents", "electrical"):
            continue
        if any(value is None for value in values):
            found[item.name] = None
        elif any(value.shape == (3,) for value in values) and item.name in ("acceleration", "gravity", "magnetic"):
            found[item.name] = np.concatenate(
                [np.broadcast_to(value, (len(part), 3)) for value, part in zip(values, parts, strict=True)]
            )
        else:
            found[item.name] = np.concatenate(values) if all(value.size for value in values) else _empty()
    numbers = set.intersection(*(set(part.currents) for part in parts))
    found["currents"] = {joint: np.concatenate([part.currents[joint] for part in parts]) for joint in sorted(numbers)}
    found["electrical"] = all(part.electrical for part in parts)
    return replace(parts[0], **found, known_links=None, known_nodes=None)
