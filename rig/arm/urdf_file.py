"""A URDF file as somebody else may have made it: its XML checked, and a copy that names no files but its own meshes."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote

from lxml import etree

from rig.documents import read_bytes
from rig.errors import RigError, one_line, shown

_LARGEST: Final = 32 << 20  # [bytes]
_DEEPEST: Final = 500  # links one behind the other
_MESHES: Final = (".stl", ".obj", ".dae", ".glb")
_LARGEST_MESH: Final = 64 << 20  # [bytes]
_LARGEST_MESHES: Final = 256 << 20  # together [bytes]
_PACKAGE: Final = "package://"
_XACRO: Final = ("http://www.ros.org/wiki/xacro", "http://wiki.ros.org/xacro", "http://ros.org/wiki/xacro")


def urdf_root(path: Path) -> Any:
    """The <robot> element of a URDF file.

    Raises:
        RigError: no such file, too large, no well-formed XML, another root element, a document type, which URDF has no
            use for, macros to be expanded first (xacro), a name that is missing or occurs twice, or links one behind
            the other without end.
    """
    content = read_bytes(path, "a URDF", _LARGEST)
    # yourdfpy would mend broken XML and go on with what is left.
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
    try:
        root = etree.fromstring(content, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise RigError(
            f"{path}: not well-formed XML: {one_line(getattr(error, 'msg', None) or str(error), 160)}"
        ) from error
    if root.getroottree().docinfo.doctype:
        raise RigError(f"{path}: has a document type, expected a URDF without one: it could pull in other files")
    if root.tag != "robot":
        raise RigError(f"{path}: the root element is <{shown(root.tag).strip(chr(39))}>, expected <robot>")
    if (macro := next((each for each in root.iter(etree.Element) if _is_xacro(each)), None)) is not None:
        raise RigError(
            f"{path}: found xacro (line {macro.sourceline}), which is no URDF yet: expected what ROS makes of it, by"
            f" xacro {path.name} > expanded.urdf"
        )
    for kind in ("link", "joint"):
        names = [element.get("name") for element in root.findall(kind)]
        if None in names:
            raise RigError(f"{path}: a <{kind}> has no name")
        name, count = Counter(names).most_common(1)[0] if names else ("", 0)
        if count > 1:
            raise RigError(f"{path}: {kind} {shown(name)} occurs {count} times, expected each name once")
    _check_depth(root, path)
    return root


def _is_xacro(element: Any) -> bool:
    """Whether an element, or a value in it, is still to be expanded."""
    return etree.QName(element).namespace in _XACRO or any("${" in value for value in element.attrib.values())


def drawable_urdf(path: Path) -> tuple[bytes, tuple[str, ...]]:
    """A URDF that a viewer can be given: whatever file it names is a mesh of its own, by its full path.

    A mesh is kept if its file lies in the folder tree of the URDF, or in that of a package: a folder of the package's
    name that holds the URDF, lies beside it or is named in ROS_PACKAGE_PATH. Its kind is one of .stl, .obj, .dae and
    .glb, and its size bounded. No URL is kept, and no texture; nor what a link collides with, if it is drawn.

    Returns:
        The XML, and what was left out, with the reason.

    Raises:
        RigError: as ``urdf_root``.
    """
    root = urdf_root(path)
    left_out: dict[str, None] = {}
    total = 0
    for texture in list(root.iter("texture")):
        texture.getparent().remove(texture)
    for link in root.iter("link"):
        for shape in link.findall("collision") if link.find("visual") is not None else []:
            link.remove(shape)
    for mesh in list(root.iter("mesh")):
        name = mesh.get("filename", "")
        try:
            file = _mesh_file(name, path)
            total += file.stat().st_size
            if total > _LARGEST_MESHES:
                raise RigError(f"more than {_LARGEST_MESHES} bytes together")
        except (RigError, OSError, ValueError) as error:
            left_out[f"{shown(name)}: {one_line(str(error), 80)}"] = None
            part = mesh.getparent().getparent()  # <visual> or <collision> about <geometry>
            if part is not None and part.getparent() is not None:
                part.getparent().remove(part)
        else:
            mesh.set("filename", str(file))
    return etree.tostring(root), tuple(left_out)


def _mesh_file(name: str, path: Path) -> Path:
    """The file of a mesh.

    Raises:
        RigError: it is none of the URDF's own.
    """
    folder = Path(os.path.realpath(path)).parent
    if name.startswith(_PACKAGE):
        package, _, rest = unquote(name[len(_PACKAGE) :]).partition("/")
        roots, relative = _package_folders(package, folder), rest
    elif "://" in name or Path(name).is_absolute():
        raise RigError("a URL or a path from elsewhere")
    else:
        roots, relative = [folder], name
    for root in roots:
        file = Path(os.path.realpath(root / relative))
        if not file.is_relative_to(os.path.realpath(root)):
            raise RigError("outside its folder")
        if file.is_file():
            if file.suffix.casefold() not in _MESHES:
                raise RigError(f"not one of {', '.join(_MESHES)}")
            if file.stat().st_size > _LARGEST_MESH:
                raise RigError(f"larger than {_LARGEST_MESH} bytes")
            return file
    raise RigError("no such file")


def _package_folders(package: str, folder: Path) -> list[Path]:
    if package in ("", ".", "..") or "\\" in package:
        raise RigError("no package's name")
    named = [Path(each) for each in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if each]
    about = [folder, *folder.parents]
    return [
        *(each for each in about if each.name == package),
        *(each / package for each in (*about[:2], *named) if (each / package).is_dir()),
        *(each for each in named if each.name == package),
    ]


def _check_depth(root: Any, path: Path) -> None:
    """Refuse what libraries that walk the tree by recursion do not survive; loops are refused where they matter."""
    parents: dict[str, str] = {}
    for joint in root.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is not None and child is not None:
            parents[child.get("link", "")] = parent.get("link", "")
    depth: dict[str, int] = {}
    for start in parents:
        chain: dict[str, None] = {}
        link = start
        while link in parents and link not in depth and link not in chain:
            chain[link] = None
            link = parents[link]
        known = depth.get(link, 0)
        for above, each in enumerate(reversed(chain), start=1):
            depth[each] = known + above
        if depth[start] > _DEEPEST:
            raise RigError(f"{path}: link {shown(start)} hangs behind more than {_DEEPEST} joints")
