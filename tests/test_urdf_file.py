"""A URDF of somebody else's names no file but its own meshes, pulls in nothing, and is read in seconds."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_support import Rig
from recording_examples import example

from rig.arm import Arm
from rig.arm.urdf_file import drawable_urdf
from rig.errors import RigError
from scenarios.cli import show

SECRET = "solid secret of this machine\n"
STL = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n"


def arm_with(*meshes: str, joints: int = 6) -> str:
    """A chain of revolute joints; each mesh is a visual of its first link."""
    visuals = "".join(f'<visual><geometry><mesh filename="{name}"/></geometry></visual>' for name in meshes)
    parts = [f'<link name="l0">{visuals}</link>']
    for number in range(1, joints + 1):
        parts.append(
            f'<link name="l{number}"/><joint name="j{number}" type="revolute"><parent link="l{number - 1}"/>'
            f'<child link="l{number}"/><origin xyz="0 0 0.1"/><axis xyz="{number % 2} {1 - number % 2} 0"/>'
            '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        )
    return f'<robot name="own">{"".join(parts)}</robot>'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A package with its URDF and a mesh; around it what is none of its business."""
    own = tmp_path / "own_arm" / "urdf"
    own.mkdir(parents=True)
    (tmp_path / "own_arm" / "meshes").mkdir()
    for place in (own / "a.stl", tmp_path / "own_arm" / "meshes" / "b.STL"):
        place.write_text(STL)
    for place in (tmp_path / "secret.stl", tmp_path / "own_arm" / "secret.txt", own / "secret.txt"):
        place.write_text(SECRET)
    (own / "link.stl").symlink_to(tmp_path / "secret.stl")
    return own


FOREIGN = {
    "/etc/passwd": "from elsewhere",
    "file:///etc/passwd": "a URL",
    "http://example.invalid/a.stl": "a URL",
    "HTTPS://example.invalid/a.stl": "a URL",
    "../../secret.stl": "outside its folder",
    "link.stl": "outside its folder",
    "secret.txt": "not one of .stl",
    "package://own_arm/../secret.stl": "outside its folder",
    "package://own_arm/%2e%2e/secret.stl": "outside its folder",
    "package://../secret.stl": "no package",
    "package://other/a.stl": "no such file",
    "none.stl": "no such file",
    "": "no such file",
}


@pytest.mark.parametrize(("name", "reason"), FOREIGN.items(), ids=list(FOREIGN))
def test_meshes_that_are_not_its_own_are_left_out(folder: Path, name: str, reason: str) -> None:
    urdf = folder / "own.urdf"
    urdf.write_text(arm_with(name, "a.stl", "package://own_arm/meshes/b.STL"))
    content, left_out = drawable_urdf(urdf)
    assert len(left_out) == 1
    assert reason in left_out[0]
    assert content.count(b"<mesh ") == 2
    assert str(folder / "a.stl").encode() in content
    assert str(folder.parent / "meshes" / "b.STL").encode() in content


def test_a_view_holds_no_foreign_file(folder: Path, here: Path, rig: Rig) -> None:
    urdf = folder / "own.urdf"
    urdf.write_text(arm_with(*FOREIGN, "a.stl"))
    example().write("run.parquet")
    seen = rig("view", "run.parquet", "--arm", urdf, "--tip", "l6", "-o", "run.rrd")
    assert seen.status == 0
    assert seen.err.startswith(f"rig: {urdf}: {len(FOREIGN)} meshes are left out: '/etc/passwd': ")
    view = Path("run.rrd").read_bytes()
    assert SECRET.encode() not in view
    assert b"root:" not in view


def test_a_mesh_that_is_missing_is_named(here: Path, rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    Path("own.urdf").write_text(arm_with("none.stl"))
    example().write("run.parquet")
    monkeypatch.setattr(show, "_draw_diagnosis", lambda run, diagnosis, arm, target: None)
    for more in ((), ("--diagnosis", "found.json")):
        seen = rig("view", "run.parquet", "--arm", "own.urdf", "-o", "run.rrd", *more)
        assert seen.status == 0
        assert seen.err.splitlines().count("rig: own.urdf: a mesh is left out: 'none.stl': no such file") == 1


BAD = {
    "an entity bomb": ('<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa">]><robot name="&a;"/>', "has a document type"),
    "a foreign entity": ('<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot>&a;</robot>', "document type"),
    "a link twice": ('<robot name="r"><link name="a"/><link name="a"/></robot>', "link 'a' occurs 2 times"),
    "a joint twice": ('<robot name="r"><joint name="j"/><joint name="j"/></robot>', "joint 'j' occurs 2 times"),
    "no name": ('<robot name="r"><link/></robot>', "a <link> has no name"),
    "no XML": ("<robot", "not well-formed XML"),
    "deep XML": ("<robot>" + "<a>" * 100_000, "not well-formed XML"),
    "a chain without end": (arm_with(joints=20_000), "hangs behind more than 500 joints"),
}


@pytest.mark.parametrize(("content", "reason"), BAD.values(), ids=list(BAD))
def test_urdfs_that_are_refused(tmp_path: Path, content: str, reason: str) -> None:
    urdf = tmp_path / "own.urdf"
    urdf.write_text(content)
    with pytest.raises(RigError, match=reason):
        Arm.from_urdf(urdf, "l6")


def test_a_large_urdf_is_read(tmp_path: Path) -> None:
    """20,000 links take some seconds, as time grows with their number and not with its square."""
    urdf = tmp_path / "own.urdf"
    links = "".join(
        f'<link name="m{number}"/><joint name="k{number}" type="fixed"><parent link="l0"/>'
        f'<child link="m{number}"/></joint>'
        for number in range(20_000)
    )
    urdf.write_text(arm_with().replace("</robot>", f"{links}</robot>"))
    assert Arm.from_urdf(urdf, "l6").dof == 6
    assert len(drawable_urdf(urdf)[1]) == 0


def test_what_a_link_collides_with_is_not_drawn_over_its_looks(tmp_path: Path) -> None:
    shape = "<geometry><box size='1 1 1'/></geometry>"
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(
        f"<robot name='a'><link name='drawn'><visual>{shape}</visual><collision>{shape}</collision></link>"
        f"<link name='bare'><collision>{shape}</collision></link></robot>"
    )
    content, _ = drawable_urdf(urdf)
    assert content.count(b"<visual>") == content.count(b"<collision>") == 1


@pytest.mark.parametrize(
    "inside",
    [
        '<xacro:include filename="$(find ur_description)/urdf/ur_macro.xacro"/>',
        '<joint name="a" type="revolute"><origin xyz="0 0 ${height}"/></joint>',
    ],
)
def test_xacro_is_no_urdf_yet(tmp_path: Path, inside: str) -> None:
    path = tmp_path / "ur.urdf.xacro"
    path.write_text(f'<robot xmlns:xacro="http://wiki.ros.org/xacro" name="ur">{inside}</robot>')
    with pytest.raises(RigError, match=r"found xacro \(line 1\).*xacro ur\.urdf\.xacro > expanded\.urdf"):
        Arm.from_file(path)
    expanded = tmp_path / "ur.urdf"  # what it makes keeps the name space
    expanded.write_text(arm_with().replace("<robot ", '<robot xmlns:xacro="http://wiki.ros.org/xacro" '))
    assert Arm.from_file(expanded).dof == 6
