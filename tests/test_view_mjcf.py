"""The view of an arm given as MJCF: which of its shapes are drawn, and that they are where MuJoCo has them."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from rerun.chunk import RrdReader
from scipy.spatial.transform import Rotation

from rig.arm import Arm
from rig.errors import LeftOut
from rig.recording import Metadata, Recording
from scenarios.colours import VERMILLION, rgb
from scenarios.view import write_view
from scenarios.view.geoms import Shapes, shapes_of

ARM = """<mujoco model="drawn"><compiler angle="radian"/>
 <asset><material name="red" rgba="1 0 0 1"/>
  <mesh name="wedge" vertex="0 0 0  .1 0 0  0 .2 0  0 0 .3"/></asset>
 <worldbody><geom name="floor" type="plane" size="1 1 .1"/><body name="table" pos="2 0 0"><geom size=".3"/></body>
  <body name="pedestal" pos="0 0 .5" euler=".1 .2 .3"><geom name="stand" type="box" size=".1 .2 .3" pos=".01 .02 .03"/>
   <body pos="0 0 .1" euler="0 .3 0"><joint name="pan" axis="0 0 1"/>
    <geom name="skin" type="mesh" mesh="wedge" material="red" contype="0" conaffinity="0" pos=".1 0 0" euler="1 0 0"/>
    <geom name="hull" type="sphere" size=".2"/>
    <body pos=".3 0 0" euler=".2 0 .5"><joint name="tilt" axis="0 1 0" pos=".05 0 0"/>
     <geom name="rod" type="capsule" fromto="0 0 0 .1 .2 .3" size=".02" rgba="0 1 0 1"/>
     <geom name="can" type="cylinder" size=".03 .1" pos="0 .1 0" euler=".5 0 0"/>
     <geom name="egg" type="ellipsoid" size=".03 .04 .05" pos="0 0 .2"/>
     <geom name="fence" type="box" size="1 1 1" group="3" rgba="1 1 1 .1"/>
     <site name="imu" pos="0 0 .3"/>
     <body name="claw" pos="0 0 .35"><joint name="finger" type="slide" axis="1 0 0"/>
      <geom name="pad" type="box" size=".01 .01 .02"/></body></body></body></body></worldbody></mujoco>"""
#: Positions are stored in single precision: three frames of at most 2 m, an ulp each, and the rotations' own ulps.
SINGLE = 16 * float(np.finfo(np.float32).eps)


@pytest.fixture
def arm(tmp_path: Path) -> Arm:
    path = tmp_path / "drawn.xml"
    path.write_text(ARM)
    return Arm.from_mjcf(path)


@pytest.fixture
def recording() -> Recording:
    rng = np.random.default_rng(0)
    t = np.arange(20.0)
    q = np.column_stack([0.1 * t, np.sin(t)])
    return Recording(t=t, q=q, accelerometer=rng.normal(size=(20, 3)), metadata=Metadata(arm="drawn"), name="drawn")


def of_entity(path: Path, entity: str) -> dict[str, list]:
    """The components of an entity: all rows of a moving one."""
    found: dict[str, list] = {}
    for chunk in RrdReader(path).stream():
        if chunk.entity_path == entity:
            batch = chunk.to_record_batch()
            for name in batch.schema.names:
                found.setdefault(name.split(":")[-1], []).extend(batch.column(name).to_pylist())
    return found


def test_what_is_drawn_is_what_only_looks_and_else_what_collides(arm: Arm) -> None:
    names = {arm.model.geom(shape.geom).name: shape.member for shape in shapes_of(arm)}
    # Not the floor, the table, what collides beside a skin, or a group that viewers hide at first.
    assert names == {"stand": -1, "skin": 0, "rod": 1, "can": 1, "egg": 1, "pad": 1}


def test_shapes_are_where_mujoco_has_them(arm: Arm, recording: Recording, tmp_path: Path) -> None:
    path = tmp_path / "drawn.rrd"
    write_view(recording, None, path, arm)
    data = mujoco.MjData(arm.model)
    moves = {name: of_entity(path, f"/transforms/{name}") for name in arm.joint_names}
    assert recording.q is not None
    for row, q in enumerate(recording.q):
        data.qpos[:2] = q
        mujoco.mj_kinematics(arm.model, data)
        base = arm.model.body("pedestal").id
        R_base, p_base = data.xmat[base].reshape(3, 3), data.xpos[base]
        for name, link, points, own in (
            ("skin", "pan", "vertex_positions", None),
            ("can", "tilt", "centers", np.zeros(3)),
            ("rod", "tilt", "translations", np.array([0.0, 0.0, -np.sqrt(0.14) / 2])),
            ("stand", "base", "centers", np.zeros(3)),
        ):
            geom = arm.model.geom(name).id
            if own is None:  # corners in another order: the nearest one counts
                mesh = arm.model.mesh("wedge").id
                start = arm.model.mesh_vertadr[mesh]
                own = arm.model.mesh_vert[start : start + arm.model.mesh_vertnum[mesh]]
            world = np.atleast_2d(own) @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
            expected = (world - p_base) @ R_base
            logged = of_entity(path, f"/arm/{link}/{geom}")
            drawn = np.array(logged[points][0], dtype=float)
            if link != "base":
                assert logged["frame"][0] == moves[link]["child_frame"][row]
                turn = Rotation.from_quat(np.array(moves[link]["quaternion"][row], dtype=float).ravel())
                drawn = turn.apply(drawn) + np.array(moves[link]["translation"][row], dtype=float).ravel()
            apart = np.linalg.norm(drawn[:, None] - expected[None], axis=2)
            assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < SINGLE


def test_colours_are_the_geoms_own_or_the_materials(arm: Arm, recording: Recording, tmp_path: Path) -> None:
    path = tmp_path / "drawn.rrd"
    write_view(recording, None, path, arm)
    skin = of_entity(path, f"/arm/pan/{arm.model.geom('skin').id}")
    assert skin["albedo_factor"] == [[0xFF0000FF]]
    rod = of_entity(path, f"/arm/tilt/{arm.model.geom('rod').id}")
    assert rod["colors"] == [[0x00FF00FF]]
    normals = np.array(skin["vertex_normals"][0])
    assert np.linalg.norm(normals, axis=1) == pytest.approx(np.ones(len(normals)), abs=1e-6)


def test_an_arm_whose_meshes_and_textures_are_missing_keeps_its_colours(tmp_path: Path) -> None:
    path = tmp_path / "torn.xml"
    torn = ARM.replace('vertex="0 0 0  .1 0 0  0 .2 0  0 0 .3"', 'file="none.stl"')
    torn = torn.replace(
        'rgba="1 0 0 1"/>', 'rgba="1 0 0 1" texture="wood"/><texture name="wood" type="2d" file="none.png"/>'
    )
    path.write_text(torn.replace('name="hull" type="sphere"', 'name="hull" type="sphere" material="red"'))
    with pytest.warns(LeftOut, match=r"torn\.xml: meshes are missing, the arm is drawn without: .*none\.stl"):
        arm = Arm.from_mjcf(path)
    hull = arm.model.geom("hull")
    assert arm.model.mat_rgba[hull.matid[0]].tolist() == [1.0, 0.0, 0.0, 1.0]
    # To a user of the command line, whom a library's warnings do not reach, it is a line.
    call = ["-m", "scenarios.cli", "bound", "ann-arbor", "--arm", "torn.xml", "--maneuver", "static-poses"]
    done = subprocess.run([sys.executable, *call], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert re.fullmatch(r"rig: torn\.xml: meshes are missing, .*none\.stl.*\n", done.stderr)


def test_a_link_at_fault_is_painted(arm: Arm) -> None:
    class Logged:
        def __init__(self) -> None:
            self.paths: list[str] = []

        def log(self, path: str, *parts: object, static: bool) -> None:
            self.paths.append(path)

    stream = Logged()
    shown = Shapes(stream, arm, "base", "arm")  # type: ignore[arg-type]
    stream.paths.clear()
    shown.colour(1, rgb(VERMILLION))
    assert sorted(stream.paths) == [f"arm/tilt/{arm.model.geom(name).id}" for name in ("rod", "can", "egg", "pad")]


def test_an_arm_without_shapes_is_a_stick_figure(recording: Recording, tmp_path: Path) -> None:
    spec = mujoco.MjSpec.from_string(ARM)
    for geom in list(spec.geoms):
        spec.delete(geom)
    spec.compiler.boundmass = spec.compiler.boundinertia = 1e-9
    bare = tmp_path / "bare.xml"
    spec.compile()
    bare.write_text(spec.to_xml())
    path = tmp_path / "bare.rrd"
    write_view(replace(recording, metadata=Metadata(arm="bare")), None, path, Arm.from_mjcf(bare))
    assert len(of_entity(path, "/arm")["strips"]) == 20


def test_the_end_of_an_arm_is_no_site_along_the_way(tmp_path: Path) -> None:
    path = tmp_path / "marked.xml"
    joint = '<joint name="pan" axis="0 0 1"/>'
    path.write_text(ARM.replace('<site name="imu" pos="0 0 .3"/>', "").replace(joint, joint + '<site name="mark"/>'))
    assert Arm.from_file(path).joint_names == ("pan", "tilt", "finger")
