"""A serial arm with a sensor at its end: where the sensor is and how it moves, from joint values."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from rig.arm.chain import Chain, extract_chain
from rig.arm.model_files import compiled_mjcf, is_urdf, mjcf_spec, model_file
from rig.arm.rotation_map import RotationMap
from rig.arrays import Array
from rig.assets import model_path
from rig.errors import RigError
from rig.joint_values import given_values, joint_values

_SPEEDS = "joint_speed_limit_deg_s"
_LIMIT_SLACK_RAD = 1e-6  # a limit reached exactly, then written and read again in degrees, is still within it


@dataclass(frozen=True)
class Poses:
    """Where the sensor is: ``R_base_tool`` (n, 3, 3) and ``position`` (n, 3) [m] of the site, in the base frame."""

    R_base_tool: Array
    position: Array


@dataclass(frozen=True)
class LinkPoses:
    """Where the N links are: ``rotation`` (n, N, 3, 3) R_base_link and ``position`` (n, N, 3) [m], in the base frame.

    Link j is the body that joint j moves, joints that only follow another one not counted, and the frame is that body's
    own: for the A465 Denavit-Hartenberg frame j, except that link 2 has its origin on the axis of joint 2.
    """

    rotation: Array
    position: Array


@dataclass(frozen=True, eq=False)
class Arm:
    """A chain of N joints from a base to the site of the sensor.

    The base frame is the frame of the body that carries joint 1; the tool frame is the site's. A joint's value is an
    angle [rad], or of one that slides a way [m]. Joints that only follow another one have no value of their own.

    Attributes:
        name: how recordings refer to it.
        model: the full MuJoCo model: geometry, inertia, actuators.
        site: the sensor's site in ``model``.
        joint_names: the N joints, base to sensor, by the names of their file.
        lower, upper: (N,) [rad, m] limits, -inf and inf where free.
        roll_range: (2,) [rad] range of the last joint for maneuvers that keep within it.
        speed: (N,) [rad/s, m/s] the fastest that each may go, inf where nothing is stated.
        file, tip: what it was read from; None where it came with the rig.
        urdf: the same arm as URDF, where there is one.
        chain: the bare kinematics from the base to the site.
    """

    name: str
    model: mujoco.MjModel
    site: str
    joint_names: tuple[str, ...]
    lower: Array
    upper: Array
    roll_range: tuple[float, float]
    speed: Array
    urdf: Path | None
    chain: Chain
    file: Path | None = None
    tip: str | None = None

    @staticmethod
    def a465() -> Arm:
        """The A465-like arm in its scene; the same object every time."""
        return _a465()

    @classmethod
    def from_file(cls, path: str | os.PathLike[str], tip: str | None = None) -> Arm:
        """The arm in a URDF file, an MJCF file, or a folder with one of these (as in a collection of models).

        Args:
            path: the file or folder.
            tip: what carries the sensor: a link of a URDF, a site or body of an MJCF; None: the end of the arm, where
                that is beyond doubt.

        Raises:
            RigError: as ``from_urdf`` and ``from_mjcf``; a folder with several models or none.
        """
        file = model_file(Path(path))
        return cls.from_urdf(file, tip) if is_urdf(file) else cls.from_mjcf(file, tip)

    @classmethod
    def from_mjcf(cls, path: str | os.PathLike[str], tip: str | None = "imu") -> Arm:
        """The arm that carries the site or body ``tip`` in an MJCF file.

        Meshes that are missing are left out, with a warning: they change nothing about where the sensor is.

        Raises:
            RigError: the file is missing or not valid MJCF, has no such site, or the site hangs on a ball or nothing.
        """
        file = Path(path)
        name, model, site = compiled_mjcf(file, tip)
        arm = cls._assemble(name, model, site, extract_chain(model, site, str(file)))
        return replace(arm, file=file, tip=tip)

    @classmethod
    def from_urdf(cls, path: str | os.PathLike[str], tip: str | None = None) -> Arm:
        """The joints of a URDF file from its root link to the link ``tip``.

        The base frame is the root link's, the tool frame that of ``tip``. Branches off the way to ``tip`` are ignored.
        Without ``tip`` it is the end of the arm.

        Raises:
            RigError: the file is missing, no valid URDF, has no such link, or another kind of joint on the way to it.
        """
        from rig.arm.urdf import SITE as URDF_SITE
        from rig.arm.urdf import read_urdf  # brings trimesh with it: only where it is wanted

        file = Path(path)
        found = read_urdf(file, tip)
        try:
            model = found.spec.compile()
        except ValueError as error:
            raise RigError(f"{file}: not a valid arm: {' '.join(str(error).split())}") from error
        arm = cls._assemble(found.name, model, URDF_SITE, extract_chain(model, URDF_SITE, str(file)), found.speeds)
        return replace(arm, urdf=file, file=file, tip=found.tip)

    def spec(self) -> mujoco.MjSpec:
        """The arm's specification, read again from its file; with the scene that it stands in, if that has one.

        Raises:
            RigError: the arm was not read from a file.
        """
        if self.is_a465:
            return mujoco.MjSpec.from_file(str(model_path("a465/scene.xml")))
        if self.urdf is not None:
            from rig.arm.urdf import read_urdf  # as above

            return read_urdf(self.urdf, self.tip).spec
        if self.file is None:
            raise RigError(f"arm {self.name}: its file is not known, expected an arm read from one")
        return mjcf_spec(self.file)

    @classmethod
    def _assemble(
        cls, name: str, model: mujoco.MjModel, site: str, chain: Chain, speeds: Mapping[str, float] | None = None
    ) -> Arm:
        limited = model.jnt_limited[chain.joints].astype(bool)
        lower, upper = model.jnt_range[chain.joints].T
        names = [model.joint(int(joint)).name for joint in chain.joints]
        turns = model.jnt_type[chain.joints[-1]] == mujoco.mjtJoint.mjJNT_HINGE
        return cls(
            name=name,
            model=model,
            site=site,
            joint_names=tuple(name or f"joint{number}" for number, name in enumerate(names, start=1)),
            lower=np.where(limited, lower, -np.inf),
            upper=np.where(limited, upper, np.inf),
            roll_range=(float(lower[-1]), float(upper[-1])) if limited[-1] or not turns else (-np.pi, np.pi),
            speed=_stated_speeds(model, names, speeds or {}),
            urdf=None,
            chain=chain,
        )

    @property
    def dof(self) -> int:
        """The number N of joints."""
        return len(self.joint_names)

    @property
    def is_a465(self) -> bool:
        """Whether it is the rig's own arm, of which more is known than its model says."""
        return self.name == "a465"

    @cached_property
    def slides(self) -> tuple[bool, ...]:
        """Of each of the N joints whether it slides."""
        kinds = self.model.jnt_type[self.chain.joints]
        return tuple(bool(kind == mujoco.mjtJoint.mjJNT_SLIDE) for kind in kinds)

    @cached_property
    def slide_numbers(self) -> tuple[int, ...]:
        """The numbers of the joints that slide, from 1."""
        return tuple(number for number, slides in enumerate(self.slides, start=1) if slides)

    def in_degrees(self, q: ArrayLike) -> Array:
        """Joint values (..., N) [rad, m] as maneuvers take them: deg, or m of joints that slide."""
        return given_values(q, self.slide_numbers)

    def from_degrees(self, values: ArrayLike) -> Array:
        """Joint values (..., N) [rad, m] from those of a maneuver [deg, m]."""
        return joint_values(values, self.slide_numbers)

    @cached_property
    def joint_axes(self) -> Array:
        """(N, 3) unit vectors, base frame: the axes of the joints with all joints at zero."""
        axes = self._at_zero().xaxis[self.chain.places]
        return np.asarray(axes / np.linalg.norm(axes, axis=1, keepdims=True))

    @property
    def place_names(self) -> dict[str, str]:
        """The arm's own names of the places joint1..jointN, where they differ."""
        places = {f"joint{number}": name for number, name in enumerate(self.joint_names, start=1)}
        return {place: name for place, name in places.items() if name != place}

    @cached_property
    def rotation_map(self) -> RotationMap:
        """The rotation R_base_tool as a function of the joints' cosines and sines."""
        zero = self._at_zero()
        return self._map(zero.site_xmat.reshape(3, 3), zero.site_xpos[0], len(self.chain.members))

    @cached_property
    def link_maps(self) -> tuple[RotationMap, ...]:
        """The rotation of each link as a function of the values of all N joints."""
        zero, links = self._at_zero(), self.chain.links
        poses = zip(zero.xmat[links].reshape(-1, 3, 3), zero.xpos[links], self.chain.places, strict=True)
        # up to the member that is the joint itself
        return tuple(self._map(R, p, place + 1, partial=True) for R, p, place in poses)

    def _map(self, R_zero: Array, p_zero: Array, count: int, partial: bool = False) -> RotationMap:
        """The rotation after the first ``count`` joints of the chain; where none slides the position, too."""
        chain, zero = self.chain, self._at_zero()
        turning = np.flatnonzero(~chain.slides[:count])
        axes = zero.xaxis[turning].copy()
        placed = {} if chain.slides.any() else {"anchors": zero.xanchor[turning].copy(), "p_zero": p_zero.copy()}
        if chain.coupling is None and not chain.slides.any() and not partial:
            return RotationMap(axes, R_zero.copy(), **placed)
        coupling = np.eye(self.dof) if chain.coupling is None else chain.coupling
        offset = None if chain.offset is None else chain.offset[turning]
        return RotationMap(axes, R_zero.copy(), coupling[turning], offset, **placed)

    def _at_zero(self) -> mujoco.MjData:
        data = mujoco.MjData(self.chain.bare)
        data.qpos[:] = 0.0
        mujoco.mj_kinematics(self.chain.bare, data)
        return data

    def poses(self, q: ArrayLike) -> Poses:
        """The sensor's pose at joint values ``q`` (n, N) [rad, m]; no limit is checked."""
        rotation, position = self.chain.evaluated(self._angles(q), site_xmat=[0], site_xpos=[0])
        return Poses(rotation.reshape(-1, 3, 3), position[:, 0])

    def link_poses(self, q: ArrayLike) -> LinkPoses:
        """The poses of all links at joint values ``q`` (n, N) [rad, m]; no limit is checked."""
        rotation, position = self.chain.evaluated(self._angles(q), xmat=self.chain.links, xpos=self.chain.links)
        return LinkPoses(rotation.reshape(-1, self.dof, 3, 3), position)

    def mapped_poses(self, q: ArrayLike) -> Poses:
        """As ``poses``, to rounding and many times as fast, by ``rotation_map``; by MuJoCo where a joint slides."""
        if self.rotation_map.anchors is None:
            return self.poses(q)
        return Poses(*self.rotation_map.poses(self._angles(q)))

    def link_pose(self, link: int, q: ArrayLike) -> tuple[Array, Array]:
        """Rotation (n, 3, 3) and position (n, 3) of one link, counted from 0, as ``mapped_poses`` of the tool."""
        if self.rotation_map.anchors is None:
            every = self.link_poses(q)
            return every.rotation[:, link], every.position[:, link]
        return self.link_maps[link].poses(self._angles(q))

    def joint_anchors(self, q: ArrayLike) -> Array:
        """(n, N, 3) [m] a point on each joint's axis, base frame, at joint values ``q`` (n, N) [rad, m]."""
        return self.chain.evaluated(self._angles(q), xanchor=self.chain.places)[0]

    def site_acceleration(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
        """The sensor's acceleration (n, 3) [m/s^2], base frame, without gravity, by ``mj_inverse``.

        Args:
            q, qd, qdd: (n, N) [rad], [rad/s], [rad/s^2]; of joints that slide with m.
        """
        motion = [self._angles(values) for values in (q, qd, qdd)]
        if not motion[0].shape == motion[1].shape == motion[2].shape:
            raise RigError(f"arm {self.name}: q, qd and qdd differ in shape: {[values.shape for values in motion]}")
        return self.chain.acceleration(*motion)

    def check_limits(self, q: ArrayLike, name: str) -> None:
        """Refuse joint values beyond the arm's limits.

        Args:
            q: (n, N) [rad, m].
            name: what the angles belong to, for the message.

        Raises:
            RigError: with the joint, the first sample and the value beyond its limit.
        """
        angles = self._angles(q)
        beyond = (angles < self.lower - _LIMIT_SLACK_RAD) | (angles > self.upper + _LIMIT_SLACK_RAD)
        if beyond.any():
            row = int(np.flatnonzero(beyond.any(axis=1))[0])
            joint = int(np.flatnonzero(beyond[row])[0])
            found, low, high = self.shown(joint, angles[row, joint], self.lower[joint], self.upper[joint])
            raise RigError(
                f"{name}: {self.joint_names[joint]} is at {found:.6g} {self.shown_unit(joint)} in sample {row}, "
                f"expected {low:.6g} to {high:.6g} {self.shown_unit(joint)}"
            )

    def check_speeds(self, qd: ArrayLike, name: str) -> None:
        """Refuse joint velocities ``qd`` (n, N) [rad/s, m/s] beyond the arm's speeds, as ``check_limits`` does."""
        fastest = np.abs(self._angles(qd)).max(axis=0, initial=0.0)
        beyond = np.flatnonzero(fastest > self.speed * (1.0 + _LIMIT_SLACK_RAD))
        if beyond.size:
            joint = int(beyond[0])
            found, limit = self.shown(joint, fastest[joint], self.speed[joint])
            raise RigError(
                f"{name}: {self.joint_names[joint]} goes at {found:.6g} {self.shown_unit(joint)}/s, "
                f"expected at most {limit:.6g} {self.shown_unit(joint)}/s"
            )

    def shown(self, joint: int, *values: float) -> tuple[float, ...]:
        """Values [rad, m] of a joint (a column) as people read them: in ``shown_unit``."""
        return values if self.slides[joint] else tuple(float(np.degrees(value)) for value in values)

    def shown_unit(self, joint: int) -> str:
        """deg, or m of a joint that slides."""
        return "m" if self.slides[joint] else "deg"

    def _angles(self, q: ArrayLike) -> Array:
        angles = np.atleast_2d(np.asarray(q, dtype=float))
        if angles.ndim != 2 or angles.shape[1] != self.dof:
            raise RigError(f"arm {self.name}: found joint values of shape {angles.shape}, expected (n, {self.dof})")
        return angles


def _stated_speeds(model: mujoco.MjModel, names: Sequence[str], stated: Mapping[str, float]) -> Array:
    """(N,) [rad/s, m/s]: by the joints' names, or of the model's own numbers in deg/s; inf where there is none."""
    custom = {model.numeric(index).name for index in range(model.nnumeric)}
    if _SPEEDS in custom:
        speeds = np.radians(np.array(model.numeric(_SPEEDS).data, dtype=float))
        if len(speeds) >= len(names):
            return np.asarray(speeds[: len(names)])
    return np.array([stated.get(name, np.inf) for name in names])


@cache
def _a465() -> Arm:
    arm = Arm.from_mjcf(model_path("a465/scene.xml"))
    return replace(arm, name="a465", urdf=model_path("a465/a465.urdf"), file=None, tip=None)
