"""Files that hold an arm: which file of a folder, URDF or MJCF, and an MJCF compiled with the sensor's site in it."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Final

import mujoco
import numpy as np

from rig.arm.chain import joints_of, site_names
from rig.documents import check_ordinary
from rig.errors import LeftOut, RigError, nearest

_ROOT: Final = re.compile(rb"<\s*(robot|mujoco)\b")
_BEGINNING: Final = 1 << 16  # bytes in which a file says what it is
#: Sites that arms' models have where a tool is bolted on, the usual one first.
_SITES: Final = ("imu", "attachment_site", "flange", "tool0", "tcp", "ee_site", "end_effector")


def is_urdf(path: Path) -> bool:
    """Whether a file is a URDF, by its root element, or by its ending where it has neither root.

    Raises:
        RigError: it cannot be read.
    """
    check_ordinary(path, "an arm as URDF, MJCF or a folder with one")
    try:
        found = _root(path)
    except OSError as error:
        raise RigError(f"{path}: cannot be read: {error.strerror}") from error
    if found is None:
        return path.suffix.casefold() == ".urdf"
    return found == b"robot"


def model_file(path: Path) -> Path:
    """The arm's file: the path itself or, of a folder, the model in it that is no scene.

    Raises:
        RigError: a folder with no model, or with several of which none bears the folder's name.
    """
    if not path.is_dir():
        return path
    found = sorted(
        file
        for pattern in ("*.xml", "*.urdf", "urdf/*.urdf", "robots/*.urdf")
        for file in path.glob(pattern)
        if not file.stem.startswith(("scene", "mjx")) and file.is_file() and _root(file)
    )
    if not found:
        raise RigError(f"{path}: found no model in this folder, expected an arm as .xml (MJCF) or .urdf")
    if len(found) == 1:
        return found[0]
    folder = _plain(path.name.removesuffix("_description"))
    named = [file for file in found if folder.endswith(_plain(file.stem))]
    if len(named) == 1:
        return named[0]
    names = ", ".join(str(file.relative_to(path)) for file in found[:8])
    raise RigError(f"{path}: found {len(found)} models, expected the path of one of {names}")


def _root(file: Path) -> bytes | None:
    """The root element of an arm's file; None where it is none."""
    with file.open("rb") as opened:
        found = _ROOT.search(opened.read(_BEGINNING))
    return None if found is None else found[1]


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.casefold())


def compiled_mjcf(file: Path, tip: str | None) -> tuple[str, mujoco.MjModel, str]:
    """An MJCF file's name and model, and the name of the site that stands for the sensor.

    Args:
        file: the file.
        tip: a site, or a body whose frame becomes the site; None: the end of the arm, where that is beyond doubt.

    Raises:
        RigError: the file is missing or not valid MJCF, or has no such site or body.
    """
    if not file.is_file():
        raise RigError(f"{file}: no such file, expected an MJCF model")
    try:
        spec = mujoco.MjSpec.from_file(str(file))
        model = _compiled(spec, file)
    except ValueError as error:
        raise RigError(f"{file}: not a valid MJCF model: {_line(error)}") from error
    for name in ("body_pos", "body_quat", "jnt_axis", "jnt_pos", "jnt_range", "site_pos", "site_quat"):
        if not np.isfinite(getattr(model, name)).all():
            raise RigError(f"{file}: {name.replace('_', ' ')} holds a number that is not finite, expected none")
    bodies = [name for name in (model.body(index).name for index in range(1, model.nbody)) if name]
    sites = site_names(model)
    chosen = _end(model, sites, file) if tip is None else tip
    if chosen not in sites:
        if chosen not in bodies:
            choices = [*sites, *bodies] if tip is not None and tip != "imu" else sites
            raise RigError(
                f"{file}: no site {chosen!r}: expected one of {', '.join(choices[:12]) or '(none)'}"
                f"{nearest(chosen, choices)}"
            )
        site = f"tip of {chosen}"
        spec.body(chosen).add_site(name=site)
        model, chosen = spec.compile(), site
    return spec.modelname or file.stem, model, chosen


def mjcf_spec(file: Path) -> mujoco.MjSpec:
    """The specification of an MJCF file that ``compiled_mjcf`` has read, without meshes whose files are missing."""
    spec = mujoco.MjSpec.from_file(str(file))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # said when the arm was read
        _compiled(spec, file)
    return spec


def _compiled(spec: mujoco.MjSpec, file: Path) -> mujoco.MjModel:
    """The model; without its meshes and textures, and with a warning, where their files are missing."""
    try:
        return spec.compile()
    except ValueError as error:
        if "opening file" not in str(error):
            raise
        words = f"{file}: meshes are missing, the arm is drawn without: {_line(error)}"
        warnings.warn(words, LeftOut, stacklevel=4)
    for geom in [geom for geom in spec.geoms if geom.type == mujoco.mjtGeom.mjGEOM_MESH or geom.meshname]:
        spec.delete(geom)
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for item in [*spec.meshes, *spec.skins, *spec.textures]:
        spec.delete(item)
    spec.compiler.boundmass = spec.compiler.boundinertia = 1e-9
    return spec.compile()


def _end(model: mujoco.MjModel, sites: list[str], file: Path) -> str:
    """The site or body at the end of the arm.

    Raises:
        RigError: there are several or none.
    """
    for name in _SITES:
        if name in sites:
            return name
    body = _last_body(model)
    body_of = {name: int(model.site_bodyid[model.site(name).id]) for name in sites}
    carried = [name for name in sites if model.body_weldid[body_of[name]]]  # by a joint: not fixed to the world
    ends = [name for name in carried if body is None or model.body_weldid[body_of[name]] == model.body(body).id]
    if len(ends) == 1:
        return ends[0]
    if body is not None:
        return body
    bodies = [model.body(index).name for index in range(model.nbody - 1, 0, -1) if model.body(index).name]
    names = [*carried, *bodies][:10]
    raise RigError(
        f"{file}: found no one end of the arm, expected --tip NAME, the site or body that carries the sensor"
        + (f", such as {', '.join(names)}" if names else "")
    )


def _last_body(model: mujoco.MjModel) -> str | None:
    """The body at which the joints end or branch off into fingers; None where they do before there is an arm."""
    body, moved, last = 0, 0, ""
    while True:
        beyond = np.flatnonzero(model.body_weldid[model.body_parentid] == body)  # also by what is fixed to it
        onward = [child for child in beyond.tolist() if len(joints_of(model, child))]
        if len(onward) != 1:
            return last if last and (moved > 1 or not onward) else None
        body, moved = onward[0], moved + len(joints_of(model, onward[0]))
        last = model.body(body).name


def _line(error: Exception) -> str:
    return " ".join(str(error).split())
