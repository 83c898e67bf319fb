"""The process that draws for ``arm_picture``: model, scene, picture and camera are its arguments."""

from __future__ import annotations

import sys
from typing import Any

import mujoco
import numpy as np
from matplotlib.image import imsave

from rig.arrays import Array

_BRISTLE_M = 0.0009


def draw(model_file: str, scene_file: str, picture: str, camera: str) -> None:
    """Draw the scene and save it as a PNG."""
    model = mujoco.MjModel.from_binary_path(model_file)
    content = np.load(scene_file)
    width, height = (int(pixels) for pixels in content["size"])
    model.vis.global_.offwidth = max(model.vis.global_.offwidth, width)
    model.vis.global_.offheight = max(model.vis.global_.offheight, height)
    names = [model.camera(index).name for index in range(model.ncam)]
    data = mujoco.MjData(model)
    data.qpos[content["address"]] = content["q"]
    mujoco.mj_forward(model, data)
    room = model.ngeom + len(content["root"]) + 1000
    with mujoco.Renderer(model, height, width, max_geom=room) as renderer:
        renderer.update_scene(data, camera=camera if camera in names else -1)
        for root, tip, colour in zip(content["root"], content["tip"], content["colour"], strict=True):
            _add_bristle(renderer.scene, root, tip, colour)
        image = renderer.render()
    imsave(picture, image, format="png")


def _add_bristle(scene: Any, root: Array, tip: Array, colour: Array) -> None:
    geom = scene.geoms[scene.ngeom]
    rgba = np.array([*colour, 1.0], dtype=np.float32)
    kind = mujoco.mjtGeom.mjGEOM_CAPSULE
    mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.zeros(9), rgba)
    mujoco.mjv_connector(geom, kind, _BRISTLE_M, root, tip)
    scene.ngeom += 1


if __name__ == "__main__":
    draw(*sys.argv[1:5])
