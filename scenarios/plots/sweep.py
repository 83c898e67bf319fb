"""The sweep on paper: joint angles against time, and the torus of bristles as in Renk et al. (2005), Figure 2."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure, SubFigure
from mpl_toolkits.mplot3d import Axes3D  # type: ignore[import-untyped]
from mpl_toolkits.mplot3d.art3d import Line3DCollection  # type: ignore[import-untyped]

from rig.arm import Arm
from rig.arrays import Array
from rig.errors import RigError
from rig.recording import Recording
from scenarios.colours import BLACK, BLUE, elapsed
from scenarios.decimation import evenly, extremes, gone_by
from scenarios.plots.coverage import time_bar
from scenarios.plots.style import new_figure, style
from scenarios.sensor_motion import motion

_SAMPLES = 20_000
_BRISTLES = 1_600
_STILL_RAD = 1e-3  # a joint that moves less is said to be locked


def sweep_figure(recording: Recording, arm: Arm | None) -> Figure:
    """Left the joints that move, against time; right a decimated set of bristles, from the wrist to the sensor.

    Args:
        recording: with joint angles, or with tool poses: then the bristles alone.
        arm: for the joint angles.

    Raises:
        RigError: the recording has no pose, or joint angles and no arm for them.
    """
    sweep = motion(recording, arm, evenly(len(recording), _BRISTLES))
    if sweep is None:
        raise RigError(f"{recording.name}: the pose is not known, expected tool poses, or joint angles and their arm")
    with style():
        right: Figure | SubFigure
        if recording.q is not None and arm is not None:
            figure = new_figure(11.5, 5.2)
            halves = figure.subfigures(1, 2, squeeze=False)
            left, right = halves[0]
            _joints(left, recording.t, recording.q, arm.joint_names)
        else:
            figure = right = new_figure(6.5, 5.2)
        _torus(right, sweep.root, sweep.tip, gone_by(recording.t, sweep.rows))
        time_bar(right, right.axes, recording.t, 0.6, 35.0)
    return figure


def _joints(figure: SubFigure, t: Array, q: Array, names: Sequence[str]) -> None:
    moving = [j for j in range(q.shape[1]) if np.ptp(q[:, j]) > _STILL_RAD]
    locked = [f"{names[j]} {np.degrees(q[0, j]):g}°".replace("-", "−") for j in range(q.shape[1]) if j not in moving]
    axes = figure.subplots(max(len(moving), 1), 1, sharex=True, squeeze=False)[:, 0]
    for axis, j in zip(axes, moving, strict=False):
        degrees = np.degrees(q[:, j])
        turns = np.ptp(degrees) > 720.0
        if turns:  # a roll of many turns is drawn within one
            degrees = (degrees + 180.0) % 360.0 - 180.0
        rows = np.arange(len(t)) if turns else extremes(degrees, _SAMPLES)
        line = degrees[rows].copy()
        line[1:][np.abs(np.diff(line)) > 180.0] = np.nan
        axis.plot(t[rows], line, color=BLUE, linewidth=0.9)
        axis.set_ylabel(f"{names[j]} {'mod 360 ' if turns else ''}[deg]")
        axis.margins(x=0.0)
    figure.align_ylabels(list(axes))
    axes[0].set_title(f"Joint angles; locked: {', '.join(locked)}" if locked else "Joint angles")
    axes[-1].set_xlabel("time [s]")


def _torus(figure: Figure | SubFigure, root: Array, tip: Array, share: Array) -> None:
    axis = figure.add_subplot(projection="3d")
    assert isinstance(axis, Axes3D)
    bristles = Line3DCollection(np.stack([root, tip], axis=1), colors=elapsed(share) / 255.0, linewidths=0.6, alpha=0.8)
    axis.add_collection3d(bristles)
    points = np.vstack([root, tip])
    low, high = points.min(axis=0), points.max(axis=0)
    half = 0.5 * max(float((high - low).max()), 1e-3)
    middle = (low + high) / 2.0
    axis.set_xlim(middle[0] - half, middle[0] + half)
    axis.set_ylim(middle[1] - half, middle[1] + half)
    axis.set_zlim(low[2], high[2])
    axis.set_box_aspect((2.0 * half, 2.0 * half, max(float(high[2] - low[2]), 1e-3)), zoom=0.95)
    axis.view_init(elev=28, azim=-55)
    axis.set_xlabel("x [m]")
    axis.set_ylabel("y [m]")
    axis.set_zlabel("z [m]")
    axis.tick_params(labelsize=7, colors=BLACK)
    for name, most in (("x", 5), ("y", 5), ("z", 3)):
        axis.locator_params(axis=name, nbins=most)
    axis.set_title(f"{len(share)} bristles, wrist to sensor, base frame")
