"""A serial arm of hinges with a sensor at its end: where the sensor is and how it moves, from joint angles."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig.assets import model_path
from rig.chain import Chain, extract_chain
from rig.errors import RigError
from rig.rotation_map import RotationMap

Array = NDArray[np.float64]

_LIMIT_SLACK_RAD = 1e-6  # a limit reached exactly, then written and read again in degrees, is still within it


@dataclass(frozen=True)
class Poses:
    """Where the sensor is: ``R_base_tool`` (n, 3, 3) and ``position`` (n, 3) [m] of the site, in the base frame."""

    R_base_tool: Array
    position: Array


@dataclass(frozen=True)
class LinkPoses:
    """Where the N links are: ``rotation`` (n, N, 3, 3) R_base_link and ``position`` (n, N, 3) [m], in the base frame.

    Link j is the body that joint j moves, and the frame is that body's own: for the A465 Denavit-Hartenberg frame j,
    except that link 2 has its origin on the axis of joint 2.
    """

    rotation: Array
    position: Array


@dataclass(frozen=True, eq=False)
class Arm:
    """A chain of N hinges from a base to the site of the sensor.

    The base frame is the frame of the body that carries joint 1; the tool frame is the site's.

    Attributes:
        name: how recordings refer to it.
        model: the full MuJoCo model: geometry, inertia, actuators.
        site: the sensor's site in ``model``.
        joint_names: the N joints, base to sensor.
        lower, upper: (N,) [rad] limits, -inf and inf where free.
        roll_range: (2,) [rad] range of the last joint for maneuvers that keep within it.
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
    urdf: Path | None
    chain: Chain

    @staticmethod
    def a465() -> Arm:
        """The A465-like arm in its scene; the same object every time."""
        return _a465()

    @classmethod
    def from_mjcf(cls, path: str | os.PathLike[str], site: str = "imu") -> Arm:
        """The arm that carries ``site`` in an MJCF file.

        Raises:
            RigError: the file is missing or not valid MJCF, has no such site, or the site hangs on other than hinges.
        """
        file = Path(path)
        if not file.is_file():
            raise RigError(f"{file}: no such file, expected an MJCF model")
        try:
            spec = mujoco.MjSpec.from_file(str(file))
            model = spec.compile()
        except ValueError as error:
            raise RigError(f"{file}: not a valid MJCF model: {' '.join(str(error).split())}") from error
        chain = extract_chain(model, site, str(file))
        return cls._assemble(spec.modelname or file.stem, model, site, chain)

    @classmethod
    def from_urdf(cls, path: str | os.PathLike[str], tip: str) -> Arm:
        """The revolute and continuous joints of a URDF file from its root link to the link ``tip``.

        The base frame is the root link's, the tool frame that of ``tip``. Branches off the way to ``tip`` are ignored.

        Raises:
            RigError: the file is missing, no valid URDF, has no such link, or another kind of joint on the way to it.
        """
        from rig.urdf import SITE as URDF_SITE
        from rig.urdf import read_urdf  # brings trimesh with it: only where it is wanted

        file = Path(path)
        name, spec = read_urdf(file, tip)
        try:
            model = spec.compile()
        except ValueError as error:
            raise RigError(f"{file}: not a valid arm: {' '.join(str(error).split())}") from error
        return cls._assemble(name, model, URDF_SITE, extract_chain(model, URDF_SITE, str(file)), urdf=file)

    @classmethod
    def _assemble(cls, name: str, model: mujoco.MjModel, site: str, chain: Chain, urdf: Path | None = None) -> Arm:
        limited = model.jnt_limited[chain.joints].astype(bool)
        lower, upper = model.jnt_range[chain.joints].T
        return cls(
            name=name,
            model=model,
            site=site,
            joint_names=tuple(model.joint(int(joint)).name for joint in chain.joints),
            lower=np.where(limited, lower, -np.inf),
            upper=np.where(limited, upper, np.inf),
            roll_range=(float(lower[-1]), float(upper[-1])) if limited[-1] else (-np.pi, np.pi),
            urdf=urdf,
            chain=chain,
        )

    @property
    def dof(self) -> int:
        """The number N of joints."""
        return len(self.joint_names)

    @cached_property
    def rotation_map(self) -> RotationMap:
        """The rotation R_base_tool as a function of the joints' cosines and sines."""
        data = self._at_zero()
        return RotationMap(axes=data.xaxis.copy(), R_zero=data.site_xmat.reshape(3, 3).copy())

    @cached_property
    def link_maps(self) -> tuple[RotationMap, ...]:
        """The rotation of each link as a function of the joints up to it."""
        data = self._at_zero()
        zero = data.xmat[self.chain.links].reshape(-1, 3, 3)
        return tuple(RotationMap(axes=data.xaxis[: index + 1].copy(), R_zero=zero[index]) for index in range(self.dof))

    def _at_zero(self) -> mujoco.MjData:
        data = mujoco.MjData(self.chain.bare)
        data.qpos[:] = 0.0
        mujoco.mj_kinematics(self.chain.bare, data)
        return data

    def poses(self, q: ArrayLike) -> Poses:
        """The sensor's pose at joint angles ``q`` (n, N) [rad]; no limit is checked."""
        angles = self._angles(q)
        rotation, position = np.empty((len(angles), 3, 3)), np.empty((len(angles), 3))
        for rows, (xmat, xpos) in self.chain.evaluated(angles, "site_xmat", "site_xpos"):
            rotation[rows] = xmat.reshape(-1, 3, 3)
            position[rows] = xpos[:, 0]
        return Poses(rotation, position)

    def link_poses(self, q: ArrayLike) -> LinkPoses:
        """The poses of all links at joint angles ``q`` (n, N) [rad]; no limit is checked."""
        angles = self._angles(q)
        links = self.chain.links
        rotation, position = np.empty((len(angles), self.dof, 3, 3)), np.empty((len(angles), self.dof, 3))
        for rows, (xmat, xpos) in self.chain.evaluated(angles, "xmat", "xpos"):
            rotation[rows] = xmat[:, links].reshape(-1, self.dof, 3, 3)
            position[rows] = xpos[:, links]
        return LinkPoses(rotation, position)

    def site_acceleration(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
        """The sensor's acceleration (n, 3) [m/s^2], base frame, without gravity, by ``mj_inverse``.

        Args:
            q, qd, qdd: (n, N) [rad], [rad/s], [rad/s^2].
        """
        motion = [self._angles(values) for values in (q, qd, qdd)]
        if not motion[0].shape == motion[1].shape == motion[2].shape:
            raise RigError(f"arm {self.name}: q, qd and qdd differ in shape: {[values.shape for values in motion]}")
        return self.chain.acceleration(*motion)

    def check_limits(self, q: ArrayLike, name: str) -> None:
        """Refuse joint angles beyond the arm's limits.

        Args:
            q: (n, N) [rad].
            name: what the angles belong to, for the message.

        Raises:
            RigError: with the joint, the first sample and the value beyond its limit.
        """
        angles = self._angles(q)
        beyond = (angles < self.lower - _LIMIT_SLACK_RAD) | (angles > self.upper + _LIMIT_SLACK_RAD)
        if beyond.any():
            row = int(np.flatnonzero(beyond.any(axis=1))[0])
            joint = int(np.flatnonzero(beyond[row])[0])
            low, high = np.degrees([self.lower[joint], self.upper[joint]])
            raise RigError(
                f"{name}: {self.joint_names[joint]} is at {np.degrees(angles[row, joint]):.6g} deg in sample {row}, "
                f"expected {low:.6g} to {high:.6g} deg"
            )

    def _angles(self, q: ArrayLike) -> Array:
        angles = np.atleast_2d(np.asarray(q, dtype=float))
        if angles.ndim != 2 or angles.shape[1] != self.dof:
            raise RigError(f"arm {self.name}: found joint values of shape {angles.shape}, expected (n, {self.dof})")
        return angles


@cache
def _a465() -> Arm:
    arm = Arm.from_mjcf(model_path("a465/scene.xml"))
    return replace(arm, name="a465", urdf=model_path("a465/a465.urdf"))
