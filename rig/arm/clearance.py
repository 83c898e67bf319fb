"""Whether an arm touches itself or what stands around it: MuJoCo's contacts at joint values and along a path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Self

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig.arm.serial import Arm
from rig.arrays import Array, Mask
from rig.errors import RigError

#: Radius of the links of an arm whose file has no geometry, over the arm's reach.
_SLENDER: Final = 0.05
#: Bodies that touch in this share of all poses are joined there: neighbours overlap by design.
_JOINED: Final = 0.8
_SAMPLES: Final = 64
#: Half the side of a table as it is drawn; it goes on for ever [m].
_TABLE: Final = 5.0
_SHORTEST: Final = 1e-3


@dataclass(frozen=True, eq=False)
class Clearance:
    """An arm with the geometry that it may touch.

    Attributes:
        arm: whose joints move.
        model: of the same joints, in which every pair of bodies that could meet makes contacts.
        around: the geoms of the table and the boxes, which are a part of their own.
        margin_m: nearer than this counts as touching [m].
        joined: pairs of parts that always touch, which is no collision.
        slender: whether the links are capsules because the arm's file has no geometry.
    """

    arm: Arm
    model: mujoco.MjModel
    around: tuple[int, ...]
    margin_m: float
    joined: frozenset[tuple[int, int]]
    slender: bool

    @classmethod
    def of(
        cls,
        arm: Arm,
        table_m: float | None = None,
        boxes: Sequence[tuple[float, float, float, float, float, float]] = (),
        margin_m: float = 0.01,
    ) -> Self:
        """The arm's own geometry and scene, with more beside it.

        Args:
            arm: where its file has no geometry, each link is a capsule from its joint to the next one.
            table_m: height of a level table in the base frame [m]; None: none but the scene's.
            boxes: what stands around, as x, y, z of one corner and of the opposite one, base frame [m].
            margin_m: nearer than this counts as touching [m].

        Raises:
            RigError: a box without extent, or the arm's file cannot be read again.
        """
        spec = arm.spec()
        carried = [geom for geom in spec.geoms if geom.parent.name != "world"]
        slender = not carried
        if slender:
            _add_capsules(spec, arm)
        added = []
        if table_m is not None:
            # A plane: whatever is below it touches it.
            added.append(
                spec.worldbody.add_geom(
                    type=mujoco.mjtGeom.mjGEOM_PLANE, size=[_TABLE, _TABLE, _TABLE], pos=[0.0, 0.0, table_m]
                )
            )
        for box in boxes:
            low, high = np.minimum(box[:3], box[3:]), np.maximum(box[:3], box[3:])
            if not (np.isfinite(box).all() and (high > low).all()):
                raise RigError(f"box: found {list(box)}, expected two opposite corners x,y,z,X,Y,Z [m]")
            size, middle = 0.5 * (high - low), 0.5 * (high + low)
            added.append(
                spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=size.tolist(), pos=middle.tolist())
            )
        model = _compiled(spec, margin_m)
        made = cls(arm, model, tuple(int(geom.id) for geom in added), margin_m, frozenset(), slender)
        joined, nearest_m = made._always_touching()
        first = int(arm.model.jnt_bodyid[arm.chain.members[0]])
        if slender:  # its first capsule stands on whatever the base stands on
            joined |= {(0, first), (first, model.nbody)}
        elif nearest_m.get((first, model.nbody), 0.0) > 0.0:  # it turns above the table, and comes no nearer
            joined |= {(first, model.nbody)}
        return replace(made, joined=joined)

    def touching(self, q: ArrayLike) -> Mask:
        """(n,) whether the arm touches anything at joint values (n, N) [rad, m]."""
        return np.array([len(self._collisions(row)) > 0 for row in self._values(q)], dtype=bool)

    def first_contact(self, q: ArrayLike) -> tuple[int, str, str] | None:
        """The first of joint values (n, N) [rad, m] at which the arm touches something, and the two bodies."""
        for row, values in enumerate(self._values(q)):
            if len(found := self._collisions(values)):
                names = [self._name(index) for index in min(found.tolist())]
                return row, names[0], names[1]
        return None

    def without(self, q: ArrayLike) -> Self:
        """The same, but for what touches at joint values (n, N) [rad, m] at which the arm is known to have been."""
        pairs = [tuple(pair) for values in self._values(q) for pair in self._collisions(values).tolist()]
        return replace(self, joined=self.joined | frozenset(pairs))

    def _values(self, q: ArrayLike) -> Array:
        """(n, M) values of all members of the chain."""
        return self.arm.chain.spread(np.atleast_2d(np.asarray(q, dtype=float)))

    def _pairs(self, values: Array) -> tuple[NDArray[np.int64], Array]:
        """(k, 2) parts that touch, the lower number first, and (k,) how far apart [m]; a pair may come repeatedly."""
        data = self._data
        data.qpos[:] = self.model.qpos0
        data.qpos[self._addresses] = values
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_collision(self.model, data)
        near = data.contact.dist < self.margin_m  # MuJoCo adds the margins of both
        found: NDArray[np.int64] = np.sort(self._parts[data.contact.geom.reshape(-1, 2)[near]], axis=1)
        return found, data.contact.dist[near]

    def _collisions(self, values: Array) -> NDArray[np.int64]:
        """(k, 2) parts that touch and are not joined."""
        pairs, _ = self._pairs(values)
        return pairs[~self._is_joined[pairs[:, 0], pairs[:, 1]]]

    def _always_touching(self) -> tuple[frozenset[tuple[int, int]], dict[tuple[int, int], float]]:
        """Pairs of the arm and its file's scene, of which a table or a box in its way is no part; and how near each
        pair that is ever within the margin comes [m]."""
        rng = np.random.default_rng(0)
        low, high = finite_limits(self.arm)
        counts: dict[tuple[int, int], int] = {}
        nearest: dict[tuple[int, int], float] = {}
        for values in self._values(rng.uniform(low, high, (_SAMPLES, self.arm.dof))):
            found, distances = self._pairs(values)
            pairs = list(map(tuple, found.tolist()))
            for pair in set(pairs):
                counts[pair] = counts.get(pair, 0) + 1
            for pair, distance in zip(pairs, distances.tolist(), strict=True):
                nearest[pair] = min(nearest.get(pair, np.inf), distance)
        always = {pair for pair, count in counts.items() if count >= _JOINED * _SAMPLES}
        return frozenset(pair for pair in always if pair[1] < self.model.nbody), nearest

    @cached_property
    def _data(self) -> mujoco.MjData:
        return mujoco.MjData(self.model)

    @cached_property
    def _addresses(self) -> NDArray[np.int64]:
        names = [self.arm.model.joint(int(joint)).name for joint in self.arm.chain.members]
        return np.array([self.model.joint(name).qposadr[0] for name in names])

    @cached_property
    def _parts(self) -> NDArray[np.int64]:
        """(geoms,) what each belongs to: a body that moves, a fixed tree of bodies, or, last, what stands around."""
        body = self.model.geom_bodyid
        moves = self.model.body_weldid[body]
        parts: NDArray[np.int64] = np.where(moves == 0, self.model.body_rootid[body], moves).astype(np.int64)
        parts[list(self.around)] = self.model.nbody
        return parts

    def _name(self, part: int) -> str:
        return (self.model.body(part).name if part < self.model.nbody else "") or "the surroundings"

    @cached_property
    def _is_joined(self) -> Mask:
        """(parts, parts) whether two are joined, the lower number first."""
        table = np.zeros((self.model.nbody + 1, self.model.nbody + 1), dtype=bool)
        for one, other in self.joined:
            table[one, other] = True
        return table


def finite_limits(arm: Arm) -> tuple[Array, Array]:
    """(N,) lower and upper limits [rad, m]; of a joint without any, one turn; the last one within its roll."""
    low, high = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
    low, high = np.where(arm.slides, arm.lower, low), np.where(arm.slides, arm.upper, high)
    low[-1], high[-1] = max(low[-1], arm.roll_range[0]), min(high[-1], arm.roll_range[1])
    return low, high


def _compiled(spec: mujoco.MjSpec, margin_m: float) -> mujoco.MjModel:
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 1
        geom.margin = margin_m
    spec.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return spec.compile()


def _add_capsules(spec: mujoco.MjSpec, arm: Arm) -> None:
    """A capsule from each body to the bodies that it carries, and to the site."""
    home = arm.poses(np.zeros((1, arm.dof))).position[0]
    links = arm.link_poses(np.zeros((1, arm.dof))).position[0]
    way = np.vstack([np.zeros(3), links, home])
    radius = _SLENDER * float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
    for body in spec.bodies:
        if body.name == "world":
            continue
        ends = [np.array(child.pos) for child in body.bodies] + [np.array(site.pos) for site in body.sites]
        for end in ends:
            length = float(np.linalg.norm(end))
            if length > _SHORTEST:
                body.add_geom(
                    type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                    fromto=[0.0, 0.0, 0.0, *end.tolist()],
                    size=[min(radius, 0.45 * length), 0.0, 0.0],
                )
