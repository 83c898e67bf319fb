"""A photograph-like picture of the arm in its sweep, by MuJoCo, with the bristles of the sweep around it.

As a command, ``python -m documenting.arm_picture docs/sweep.png``: the README's picture.

MuJoCo draws with whatever OpenGL it was told to use before it was imported, and some ways abort the process on machines
that lack them. So the picture is drawn in a process of its own, which is handed the scene as a file.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import mujoco
import numpy as np

from rig.arm import Arm
from rig.arrays import Array
from rig.errors import RigError
from rig.files import atomic_path, scratch_folder
from scenarios.colours import elapsed
from scenarios.decimation import evenly
from scenarios.sensor_motion import SensorMotion

#: Ways of drawing without a window, in the order they are tried where MUJOCO_GL does not choose one.
_WITHOUT_WINDOW: Final = ("egl", "osmesa")
_TIMEOUT_S: Final = 120.0

#: Joints 1 and 5 in the README's picture [deg].
_POSE_DEG: Final = (20.0, 40.0)


def arm_picture(
    arm: Arm,
    q: Array,
    path: str | os.PathLike[str],
    pose: int = 0,
    bristles: int = 900,
    size: tuple[int, int] = (1400, 1050),
) -> None:
    """Draw the arm at one sample of its motion, and the bristles of all, as a PNG.

    Args:
        q: (n, N) [rad] the motion.
        pose: row of ``q`` at which the arm is drawn.
        bristles: how many to draw at most, from wrist to sensor, blue first and yellow last.
        size: width and height [pixels], at most the model's off-screen buffer.

    Raises:
        RigError: there is no OpenGL to draw with, or the file cannot be written.
    """
    rows = evenly(len(q), bristles)
    motion = SensorMotion.of_joints(arm, q, rows)
    with scratch_folder("rig-picture") as folder, atomic_path(path) as temporary:
        model, scene = folder / "model.mjb", folder / "scene.npz"
        mujoco.mj_saveModel(arm.model, str(model))
        np.savez(
            scene,
            address=arm.model.jnt_qposadr[arm.chain.joints],
            q=q[pose],
            root=motion.root,
            tip=motion.tip,
            colour=elapsed(rows / max(len(q) - 1, 1)) / 255.0,
            size=np.array(size),
        )
        _run(folder, [str(model), str(scene), str(temporary.absolute()), "overview"])


def _run(folder: Path, arguments: list[str]) -> None:
    """Draw in another process, with the first way that works; MuJoCo leaves its log of failures in ``folder``."""
    chosen = os.environ.get("MUJOCO_GL")
    ways: tuple[str | None, ...] = (chosen,) if chosen or sys.platform != "linux" else _WITHOUT_WINDOW
    reasons = []
    for way in ways:
        environment = dict(os.environ) if way is None else {**os.environ, "MUJOCO_GL": way, "PYOPENGL_PLATFORM": way}
        command = [sys.executable, "-P", str(Path(__file__).with_name("_draw_arm.py")), *arguments]
        try:
            done = subprocess.run(
                command, env=environment, cwd=folder, capture_output=True, text=True, timeout=_TIMEOUT_S
            )
        except subprocess.TimeoutExpired:
            reasons.append(f"{way}: not done within {_TIMEOUT_S:g} s")
            continue
        if done.returncode == 0:
            return
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        reasons.append(f"{way or 'OpenGL'}: {lines[-1] if lines else f'status {done.returncode}'}")
    raise RigError(
        f"no OpenGL to draw the arm with ({'; '.join(reasons)}): set MUJOCO_GL=osmesa (Debian: libosmesa6) or egl"
    )


def main(arguments: Sequence[str]) -> int:
    """The command: draw the README's picture, the A465 in the torus sweep; returns its exit status."""
    from rig.maneuver import TorusSweep

    if len(arguments) != 1:
        print("usage: python -m documenting.arm_picture PICTURE.png", file=sys.stderr)
        return 2
    arm = Arm.a465()
    q = TorusSweep().trajectory().q
    turned = np.degrees(q[:, [0, 4]]) - _POSE_DEG
    try:
        arm_picture(arm, q, arguments[0], pose=int(np.square(turned).sum(axis=1).argmin()))
    except RigError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
