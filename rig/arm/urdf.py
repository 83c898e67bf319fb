"""A serial arm from a URDF file: the chain of joints from the root link to a chosen link, as a MuJoCo model."""

from __future__ import annotations

import io
from collections import Counter
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
import yourdfpy
from lxml import etree

from rig.arm.urdf_file import urdf_root
from rig.arrays import Array
from rig.errors import RigError, nearest

SITE: Final = "tip"

_TYPES: Final = {
    "revolute": mujoco.mjtJoint.mjJNT_HINGE,
    "continuous": mujoco.mjtJoint.mjJNT_HINGE,
    "prismatic": mujoco.mjtJoint.mjJNT_SLIDE,
}
_FEWEST_JOINTS: Final = 2  # before a branching, to be an arm and not a body with arms
#: Names that arms' makers give the frame where a tool is bolted on, the usual one first.
_FLANGES: Final = ("imu", "tool0", "flange", "ee_link", "tcp", "tool", "tip", "ee", "end_effector")
_EQUALITY_DATA = 12  # numbers of an equality in MuJoCo's specification
_WEIGHTLESS = 1e-9  # kg, kg m^2: MuJoCo has no moving bodies without mass


@dataclass(frozen=True)
class UrdfArm:
    """What a URDF file holds of an arm.

    Attributes:
        name: the robot's.
        tip: the link whose frame is the sensor's.
        spec: the model, whose site ``SITE`` is the frame of ``tip``.
        speeds: joint name -> the fastest it may go [rad/s, m/s], where stated.
    """

    name: str
    tip: str
    spec: mujoco.MjSpec
    speeds: dict[str, float]


def read_urdf(path: Path, tip: str | None = None) -> UrdfArm:
    """Read the chain from the root link of a URDF file to the link ``tip``.

    One body a moving joint, its frame that of the joint's child link; fixed joints, and the masses behind them, are
    folded into the bodies. A joint that mimics another one of the chain is tied to it. Masses off the way to ``tip``
    are left out, and there are no actuators.

    Args:
        path: the file.
        tip: None: the link that the most moving joints carry, by the name of a flange where several are alike.

    Raises:
        RigError: the file is missing, no well-formed URDF, has no link ``tip`` or none that is the tip beyond doubt, or
            the way to it has a joint that is neither revolute, continuous, prismatic nor fixed, or no moving joint.
    """
    robot = _parse(path)
    tip = _only_tip(robot, path) if tip is None else tip
    spec = mujoco.MjSpec()
    spec.modelname = str(robot.name or path.stem)
    spec.compiler.degree = False
    spec.compiler.autolimits = False
    spec.compiler.balanceinertia = True
    spec.compiler.boundmass = spec.compiler.boundinertia = _WEIGHTLESS
    masses = {str(link.name): link.inertial for link in robot.links}
    parent, offset, moving = spec.worldbody, np.eye(4), 0
    load = _Load.none()
    joints = _joints_to(robot, tip, path)
    for joint in joints:
        origin = np.eye(4) if joint.origin is None else np.asarray(joint.origin, dtype=float)
        _require_finite(origin, joint, "origin", path)
        offset = offset @ origin
        if joint.type != "fixed":
            if joint.type not in _TYPES:
                expected = f"{', '.join(_TYPES)} or fixed on the way to the tip"
                raise RigError(f"{path}: joint {joint.name!r} is of type {joint.type!r}: expected {expected}")
            load.give(parent, moving)
            parent = parent.add_body(name=str(joint.child), pos=offset[:3, 3], quat=_quaternion(offset))
            parent.add_joint(
                name=str(joint.name), type=_TYPES[joint.type], axis=_axis(joint, path), **_limits(joint, path)
            )
            offset, load = np.eye(4), _Load.none()
            moving += 1
        load = load + _Load.of(masses[str(joint.child)], offset, str(joint.child), path)
    load.give(parent, moving)
    if not moving:
        raise RigError(
            f"{path}: link {tip!r} is fixed to the root: expected a revolute, continuous or prismatic joint between"
            f" them{_tips_of(robot)}"
        )
    parent.add_site(name=SITE, pos=offset[:3, 3], quat=_quaternion(offset))
    _tie(spec, [joint for joint in joints if joint.type != "fixed"])
    return UrdfArm(spec.modelname, tip, spec, _speeds(joints))


def _tie(spec: mujoco.MjSpec, joints: list[Any]) -> None:
    """Let the joints that mimic another one of the chain follow it."""
    names = {str(joint.name) for joint in joints}
    for joint in joints:
        if joint.mimic is None or str(joint.mimic.joint) not in names:
            continue
        slope = 1.0 if joint.mimic.multiplier is None else float(joint.mimic.multiplier)
        constant = 0.0 if joint.mimic.offset is None else float(joint.mimic.offset)
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_JOINT,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            name1=str(joint.name),
            name2=str(joint.mimic.joint),
            data=[constant, slope] + [0.0] * (_EQUALITY_DATA - 2),
        )


def _speeds(joints: list[Any]) -> dict[str, float]:
    """Stated speeds; zero, which many files write for not known, states none."""
    stated = {str(joint.name): joint.limit.velocity for joint in joints if joint.limit is not None}
    return {name: float(speed) for name, speed in stated.items() if speed is not None and float(speed) > 0.0}


def _only_tip(robot: Any, path: Path) -> str:
    """The link at the end of the arm: where its joints end, or branch off into the fingers of a gripper.

    Of the links fixed to each other there, one with the name of a flange, else the one that the joint moves.

    Raises:
        RigError: no link, every link hangs on another, nothing moves, or the joints branch off before there is an arm.
    """
    children: dict[str, list[Any]] = {}
    for joint in robot.joints:
        children.setdefault(str(joint.parent), []).append(joint)
    carried = {str(joint.child) for joint in robot.joints}
    links = [str(link.name) for link in robot.links]
    root = next((link for link in links if link not in carried), None)
    if root is None:
        what = "its joints form a loop, in which every link hangs on another" if links else "has no link"
        raise RigError(f"{path}: {what}: expected a tree with one root link")
    last, moved = root, 0
    while True:
        together, onward = [last], []
        for link in together:  # grows
            for joint in children.get(link, []):
                if joint.type != "fixed":
                    onward.append(joint)
                elif str(joint.child) not in together:
                    together.append(str(joint.child))
        if len(onward) != 1 or moved > len(robot.joints):
            break
        last, moved = str(onward[0].child), moved + 1
    if moved == 0 or (onward and moved < _FEWEST_JOINTS):
        what = f"its joints branch off at link {last!r}" if onward else "no joint moves"
        raise RigError(f"{path}: {what}: expected --tip LINK, the one that carries the sensor{_tips_of(robot)}")
    for flange in _FLANGES:
        for link in together:
            if link == flange or link.endswith(f"_{flange}"):
                return link
    return last


def _tips_of(robot: Any) -> str:
    """The links that may be a tip, in words: those behind a moving joint, the last ones first."""
    carriers = {str(joint.child): joint for joint in robot.joints}
    depth: dict[str, int] = {}
    for link in (str(link.name) for link in robot.links):
        at, count, steps = link, 0, 0
        while at in carriers and steps <= len(carriers):
            count += carriers[at].type != "fixed"
            at, steps = str(carriers[at].parent), steps + 1
        depth[link] = count
    links = sorted((link for link in depth if depth[link]), key=lambda link: -depth[link])[:12]
    return f", such as {', '.join(links)}" if links else ""


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
    root = urdf_root(path)
    if "name" not in root.attrib:
        root.set("name", path.stem)
    content = etree.tostring(root)
    try:
        # An infinite origin is refused below; what yourdfpy prints of an odd file is for nobody.
        with np.errstate(invalid="ignore"), redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            urdf = yourdfpy.URDF.load(
                io.BytesIO(content), build_scene_graph=False, load_meshes=False, load_collision_meshes=False
            )
    except KeyError as error:
        raise RigError(f"{path}: not a valid URDF: an element lacks its attribute {error}") from error
    except Exception as error:  # yourdfpy checks little and fails in many ways on a URDF that breaks the rules
        raise RigError(f"{path}: not a valid URDF: {type(error).__name__}: {error}") from error
    return urdf.robot


def _joints_to(robot: Any, tip: str, path: Path) -> list[Any]:
    """The joints from the root link to ``tip``."""
    links = [str(link.name) for link in robot.links]
    if tip not in links:
        found = f"expected one of {', '.join(links)}{nearest(tip, links)}" if links else "the file has none"
        raise RigError(f"{path}: no link {tip!r}: {found}")
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
    """The limits of a joint; one without ``<limit>`` is taken to be free."""
    if joint.type == "continuous" or joint.limit is None:
        return {"limited": mujoco.mjtLimited.mjLIMITED_FALSE}
    lower, upper = (0.0 if value is None else float(value) for value in (joint.limit.lower, joint.limit.upper))
    _require_finite(np.array([lower, upper]), joint, "limit", path)
    if lower >= upper:
        unit = "m" if joint.type == "prismatic" else "rad"
        raise RigError(
            f"{path}: joint {joint.name!r}: limits are {lower:g} to {upper:g} {unit}, expected lower < upper"
        )
    return {"limited": mujoco.mjtLimited.mjLIMITED_TRUE, "range": [lower, upper]}


def _quaternion(transform: Array) -> Array:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, transform[:3, :3].ravel())
    return quaternion
