"""A serial arm from a URDF file: the chain of hinges from the root link to a chosen link, as a MuJoCo model."""

from __future__ import annotations

import io
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
import yourdfpy
from lxml import etree
from numpy.typing import NDArray

from rig.errors import RigError, nearest

Array = NDArray[np.float64]

SITE: Final = "tip"

_HINGES = ("revolute", "continuous")
_WEIGHTLESS = 1e-9  # kg, kg m^2: MuJoCo has no moving bodies without mass


def read_urdf(path: Path, tip: str) -> tuple[str, mujoco.MjSpec]:
    """Read the chain from the root link of a URDF file to the link ``tip``.

    One body a moving joint, its frame that of the joint's child link; fixed joints, and the masses behind them, are
    folded into the bodies. Masses off the way to ``tip`` are left out, and there are no actuators.

    Returns:
        The robot's name and the model, whose site ``SITE`` is the frame of ``tip``.

    Raises:
        RigError: the file is missing, no well-formed URDF, has no link ``tip``, or the way to it has a joint that is
            neither revolute, continuous nor fixed, one that mimics another, or no moving joint at all.
    """
    robot = _parse(path)
    spec = mujoco.MjSpec()
    spec.modelname = str(robot.name or path.stem)
    spec.compiler.degree = False
    spec.compiler.autolimits = False
    spec.compiler.balanceinertia = True
    spec.compiler.boundmass = spec.compiler.boundinertia = _WEIGHTLESS
    masses = {str(link.name): link.inertial for link in robot.links}
    parent, offset, moving = spec.worldbody, np.eye(4), 0
    load = _Load.none()
    for joint in _joints_to(robot, tip, path):
        origin = np.eye(4) if joint.origin is None else np.asarray(joint.origin, dtype=float)
        _require_finite(origin, joint, "origin", path)
        offset = offset @ origin
        if joint.type != "fixed":
            _require_hinge(joint, path)
            load.give(parent, moving)
            parent = parent.add_body(name=str(joint.child), pos=offset[:3, 3], quat=_quaternion(offset))
            parent.add_joint(name=str(joint.name), axis=_axis(joint, path), **_limits(joint, path))
            offset, load = np.eye(4), _Load.none()
            moving += 1
        load = load + _Load.of(masses[str(joint.child)], offset, str(joint.child), path)
    load.give(parent, moving)
    if not moving:
        raise RigError(
            f"{path}: link {tip!r} is fixed to the root: expected a revolute or continuous joint between them"
        )
    parent.add_site(name=SITE, pos=offset[:3, 3], quat=_quaternion(offset))
    return spec.modelname, spec


@dataclass(frozen=True)
class _Load:
    """Mass, first and second moment of mass of what moves with a body, in the body's frame [kg, kg m, kg m^2].

    The second moment is the sum of m r r', so that those of several links simply add up.
    """

    mass: float
    first: Array
    second: Array

    @classmethod
    def none(cls) -> _Load:
        return cls(0.0, np.zeros(3), np.zeros((3, 3)))

    @classmethod
    def of(cls, inertial: Any, frame: Array, link: str, path: Path) -> _Load:
        """The load of a link whose frame is ``frame`` (4, 4) in the body's."""
        if inertial is None or inertial.mass is None:
            return cls.none()
        mass = float(inertial.mass)
        frame = frame @ (np.eye(4) if inertial.origin is None else np.asarray(inertial.origin, dtype=float))
        inertia = np.zeros((3, 3)) if inertial.inertia is None else np.asarray(inertial.inertia, dtype=float)
        if not (np.isfinite(mass) and mass >= 0 and np.isfinite(frame).all() and np.isfinite(inertia).all()):
            raise RigError(f"{path}: link {link!r}: <inertial> needs a mass of at least zero and finite values")
        R, centre = frame[:3, :3], frame[:3, 3]
        spread = R @ (np.trace(inertia) / 2 * np.eye(3) - inertia) @ R.T
        return cls(mass, mass * centre, spread + mass * np.outer(centre, centre))

    def __add__(self, other: _Load) -> _Load:
        return _Load(self.mass + other.mass, self.first + other.first, self.second + other.second)

    def give(self, body: Any, moving: int) -> None:
        """Let a moving body weigh this; the base, which holds the first joint, weighs nothing."""
        if not moving:
            return
        body.explicitinertial = True
        body.mass = self.mass
        body.ipos = self.first / self.mass if self.mass > 0 else np.zeros(3)
        spread = self.second - self.mass * np.outer(body.ipos, body.ipos)
        inertia = np.trace(spread) * np.eye(3) - spread
        body.fullinertia = [*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]]


def _parse(path: Path) -> Any:
    if not path.is_file():
        raise RigError(f"{path}: no such file, expected a URDF")
    content = path.read_bytes()
    try:
        root = etree.fromstring(content)  # yourdfpy would mend broken XML and go on with what is left
    except etree.XMLSyntaxError as error:
        raise RigError(f"{path}: not well-formed XML: {error.msg}") from error
    if root.tag != "robot":
        raise RigError(f"{path}: the root element is <{root.tag}>, expected <robot>")
    try:
        with np.errstate(invalid="ignore"):  # an infinite origin: refused below
            urdf = yourdfpy.URDF.load(
                io.BytesIO(content), build_scene_graph=False, load_meshes=False, load_collision_meshes=False
            )
    except Exception as error:  # yourdfpy checks little and fails in many ways on a URDF that breaks the rules
        raise RigError(f"{path}: not a valid URDF: {type(error).__name__}: {error}") from error
    return urdf.robot


def _joints_to(robot: Any, tip: str, path: Path) -> list[Any]:
    """The joints from the root link to ``tip``."""
    links = [str(link.name) for link in robot.links]
    if tip not in links:
        raise RigError(f"{path}: no link {tip!r}: expected one of {', '.join(links)}{nearest(tip, links)}")
    children = Counter(str(joint.child) for joint in robot.joints)
    carriers = {str(joint.child): joint for joint in robot.joints}
    chain: list[Any] = []
    link = tip
    while link in carriers:
        joint = carriers[link]
        if children[link] > 1:
            raise RigError(
                f"{path}: link {link!r} hangs on {children[link]} joints: expected one, a tree without loops"
            )
        if joint in chain:
            raise RigError(f"{path}: the joints to link {tip!r} form a loop: expected a tree with one root link")
        chain.append(joint)
        link = str(joint.parent)
        if link not in links:
            raise RigError(f"{path}: joint {joint.name!r} has parent {link!r}, which is no link{nearest(link, links)}")
    return chain[::-1]


def _require_hinge(joint: Any, path: Path) -> None:
    if joint.type not in _HINGES:
        expected = "revolute, continuous or fixed on the way to the tip"
        raise RigError(f"{path}: joint {joint.name!r} is of type {joint.type!r}: expected {expected}")
    if joint.mimic is not None:
        raise RigError(
            f"{path}: joint {joint.name!r} mimics {joint.mimic.joint!r}: expected joints that move by themselves"
        )


def _require_finite(values: Array, joint: Any, what: str, path: Path) -> None:
    if not np.isfinite(values).all():
        raise RigError(f"{path}: joint {joint.name!r}: {what} has a value that is not finite")


def _axis(joint: Any, path: Path) -> Array:
    axis = np.asarray(joint.axis, dtype=float)
    _require_finite(axis, joint, "axis", path)
    if axis.shape != (3,) or not np.linalg.norm(axis) > 0:
        raise RigError(f"{path}: joint {joint.name!r}: axis is {axis.tolist()}, expected three numbers, not all zero")
    return np.asarray(axis / np.linalg.norm(axis))


def _limits(joint: Any, path: Path) -> dict[str, Any]:
    """The limits of a revolute joint; one without ``<limit>`` is taken to be free."""
    if joint.type == "continuous" or joint.limit is None:
        return {"limited": mujoco.mjtLimited.mjLIMITED_FALSE}
    lower, upper = (0.0 if value is None else float(value) for value in (joint.limit.lower, joint.limit.upper))
    _require_finite(np.array([lower, upper]), joint, "limit", path)
    if lower >= upper:
        raise RigError(f"{path}: joint {joint.name!r}: limits are {lower:g} to {upper:g} rad, expected lower < upper")
    return {"limited": mujoco.mjtLimited.mjLIMITED_TRUE, "range": [lower, upper]}


def _quaternion(transform: Array) -> Array:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, transform[:3, :3].ravel())
    return quaternion
