"""The shapes of an arm's MuJoCo model in the viewer: boxes, capsules, cylinders, ellipsoids, meshes, link by link."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from rig.arm import Arm
from rig.arrays import Array
from scenarios.view.stream import at

Colour = tuple[int, int, int]

#: MuJoCo's own viewer shows the groups below this one; the others hold, by convention, what only collides.
_HIDDEN: Final = 3
#: The colour that MuJoCo takes for one that is not stated: then the material's counts.
_UNSTATED: Final = np.array([0.5, 0.5, 0.5, 1.0], dtype=np.float32)
_KINDS: Final = mujoco.mjtGeom
_MESHES: Final = (_KINDS.mjGEOM_MESH, _KINDS.mjGEOM_SDF)
_ROUND: Final = (_KINDS.mjGEOM_SPHERE, _KINDS.mjGEOM_ELLIPSOID)
#: What is drawn, and as what.
_ARCHETYPES: Final[dict[mujoco.mjtGeom, Any]] = {
    _KINDS.mjGEOM_BOX: rr.Boxes3D,
    _KINDS.mjGEOM_CAPSULE: rr.Capsules3D,
    _KINDS.mjGEOM_CYLINDER: rr.Cylinders3D,
    **dict.fromkeys(_ROUND, rr.Ellipsoids3D),
    **dict.fromkeys(_MESHES, rr.Mesh3D),
}


@dataclass(frozen=True)
class Shape:
    """A geom of the model that is drawn.

    Attributes:
        geom: its id.
        member: the place, in ``arm.chain.members``, of the joint that moves it; -1: fixed to the base.
        position, rotation: (3,) [m], (3, 3) of its frame in that of the body which the joint moves, or in the base.
    """

    geom: int
    member: int
    position: Array
    rotation: Array


def shapes_of(arm: Arm) -> list[Shape]:
    """What is drawn of an arm: of every link the geoms that do not collide, or all of them where there are none such.

    Groups that MuJoCo's viewer hides at first are left out, planes too, and what hangs on the world beside the arm.
    Joints off the arm, such as a gripper's, stand as in the file.
    """
    model = arm.model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    moved = {int(model.jnt_bodyid[joint]): member for member, joint in enumerate(arm.chain.members)}
    first = int(model.jnt_bodyid[arm.chain.members[0]])
    base = int(model.body_parentid[first])
    found: dict[int, list[Shape]] = {}
    for geom in range(model.ngeom):
        kind = _KINDS(model.geom_type[geom])
        if model.geom_group[geom] >= _HIDDEN or kind not in _ARCHETYPES or _rgba(model, geom)[3] == 0.0:
            continue
        body = int(model.geom_bodyid[geom])
        carrier = _carrier(model, body, moved)
        if carrier < 0 and not _stands_under(model, body, base):
            continue
        frame = base if carrier < 0 else carrier
        turn = data.xmat[frame].reshape(3, 3)
        shape = Shape(
            geom,
            moved.get(carrier, -1),
            turn.T @ (data.geom_xpos[geom] - data.xpos[frame]),
            turn.T @ data.geom_xmat[geom].reshape(3, 3),
        )
        found.setdefault(carrier, []).append(shape)
    return [shape for shapes in found.values() for shape in _seen(model, shapes)]


def _carrier(model: mujoco.MjModel, body: int, moved: dict[int, int]) -> int:
    """The body of the arm's chain that carries a body; -1 where none does."""
    while body and body not in moved:
        body = int(model.body_parentid[body])
    return body or -1


def _stands_under(model: mujoco.MjModel, body: int, base: int) -> bool:
    """Whether a body that no joint of the arm carries is the base, is fixed to it, or stands under it."""
    under = [base]
    while under[-1]:
        under.append(int(model.body_parentid[under[-1]]))
    while body and body not in under[:-1]:
        body = int(model.body_parentid[body])
    return bool(body) or base == 0


def _seen(model: mujoco.MjModel, shapes: list[Shape]) -> list[Shape]:
    looks = [each for each in shapes if not model.geom_contype[each.geom] and not model.geom_conaffinity[each.geom]]
    return looks or shapes


class Shapes:
    """The shapes of an arm in a view.

    Attributes:
        drawn: what is drawn; empty where the model has no shapes.
    """

    def __init__(self, stream: rr.RecordingStream, arm: Arm, base: str, path: str) -> None:
        """Log the shapes, each in the frame of its link.

        Args:
            stream: to log to.
            arm: to be shown.
            base: the base frame's name.
            path: under which the shapes are logged.
        """
        self.drawn = shapes_of(arm)
        self._stream, self._arm, self._base, self._path = stream, arm, base, path
        names = [arm.model.joint(int(joint)).name for joint in arm.chain.members]
        self._names = [name or f"joint{number}" for number, name in enumerate(names, start=1)]
        for shape in self.drawn:
            frame = base if shape.member < 0 else self._frame(shape.member)
            stream.log(self._entity(shape), rr.CoordinateFrame(frame), _logged(arm.model, shape), static=True)

    def move(self, t: Array, q: Array, path: str) -> None:
        """The links moving through m samples: times (m,) [s], joint values (m, N) [rad, m], logged under ``path``."""
        bare = self._arm.chain.bare
        bodies = [bare.body(f"body{member}").id for member in range(len(self._names))]
        turns, places = self._arm.chain.evaluated(q, xquat=bodies, xpos=bodies)
        for member, name in enumerate(self._names):
            columns = rr.Transform3D.columns(
                translation=places[:, member],
                quaternion=np.roll(turns[:, member], -1, axis=1),
                parent_frame=[self._base] * len(t),
                child_frame=[self._frame(member)] * len(t),
            )
            self._stream.send_columns(f"{path}/{name}", indexes=at(t), columns=columns)

    def colour(self, number: int, colour: Colour) -> None:
        """Paint the link that a joint of the arm moves, counted from zero."""
        members = [int(joint) for joint in self._arm.chain.members]
        wanted = members.index(int(self._arm.chain.joints[number]))
        for shape in self.drawn:
            if shape.member == wanted:
                kind = _KINDS(self._arm.model.geom_type[shape.geom])
                self._stream.log(self._entity(shape), painted(_ARCHETYPES[kind], colour), static=True)

    def _frame(self, member: int) -> str:
        return f"link of {self._names[member]}"

    def _entity(self, shape: Shape) -> str:
        link = "base" if shape.member < 0 else self._names[shape.member]
        return f"{self._path}/{link}/{shape.geom}"


def _rgba(model: mujoco.MjModel, geom: int) -> Array:
    """(4,) of a geom: its own where stated, else its material's."""
    own, material = model.geom_rgba[geom], int(model.geom_matid[geom])
    return np.asarray(model.mat_rgba[material] if material >= 0 and np.array_equal(own, _UNSTATED) else own)


def _logged(model: mujoco.MjModel, shape: Shape) -> rr.AsComponents:
    """A geom as the viewer has it."""
    kind, size = _KINDS(model.geom_type[shape.geom]), model.geom_size[shape.geom]
    colour = np.round(255.0 * _rgba(model, shape.geom)).astype(np.uint8)
    if kind in _MESHES:
        return _mesh(model, shape, colour)
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, shape.rotation.ravel())
    turn = [rr.Quaternion(xyzw=np.roll(quaternion, -1))]
    look: dict[str, Any] = {"colors": [colour], "fill_mode": rr.components.FillMode.Solid, "quaternions": turn}
    centre = [shape.position]
    if kind == _KINDS.mjGEOM_BOX:
        return rr.Boxes3D(half_sizes=[size], centers=centre, **look)
    if kind == _KINDS.mjGEOM_CYLINDER:
        return rr.Cylinders3D(radii=[size[0]], lengths=[2.0 * size[1]], centers=centre, **look)
    if kind == _KINDS.mjGEOM_CAPSULE:  # the viewer's begins at its place, MuJoCo's has its middle there
        start = [shape.position - size[1] * shape.rotation[:, 2]]
        return rr.Capsules3D(radii=[size[0]], lengths=[2.0 * size[1]], translations=start, **look)
    half = [size[0]] * 3 if kind == _KINDS.mjGEOM_SPHERE else size
    return rr.Ellipsoids3D(half_sizes=[half], centers=centre, **look)


def _mesh(model: mujoco.MjModel, shape: Shape, colour: NDArray[np.uint8]) -> rr.Mesh3D:
    """Triangles with the normals of the model, which has them apart from the corners: each pair becomes a corner."""
    mesh = int(model.geom_dataid[shape.geom])
    rows = slice(int(model.mesh_faceadr[mesh]), int(model.mesh_faceadr[mesh]) + int(model.mesh_facenum[mesh]))
    pairs = np.stack([model.mesh_face[rows].ravel(), model.mesh_facenormal[rows].ravel()], axis=1)
    corners, faces = np.unique(pairs, axis=0, return_inverse=True)
    own = model.mesh_vert[int(model.mesh_vertadr[mesh]) + corners[:, 0]]
    normals = model.mesh_normal[int(model.mesh_normaladr[mesh]) + corners[:, 1]]
    return rr.Mesh3D(
        vertex_positions=own @ shape.rotation.T + shape.position,
        vertex_normals=normals @ shape.rotation.T,
        triangle_indices=faces.reshape(-1, 3),
        albedo_factor=colour,
    )


def painted(archetype: Any, colour: Colour) -> rr.AsComponents:
    """Another colour for what is drawn as an archetype; a component of another one is an error in the viewer."""
    whole = archetype in (rr.Mesh3D, rr.Asset3D)
    fields = {"albedo_factor": [*colour, 255]} if whole else {"colors": [colour]}
    found: rr.AsComponents = archetype.from_fields(**fields)
    return found
