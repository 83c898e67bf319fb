"""What the viewer shows when the file is opened: the arm on the left, readings, residuals and spheres on the right."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import ArrayLike

from rig.arrays import Array
from rig.recording import Recording
from scenarios.overlay import Overlay
from scenarios.view.arm import ARM
from scenarios.view.series import READINGS, RESIDUALS
from scenarios.view.spheres import SPHERES
from scenarios.view.stream import TIMELINE
from scenarios.view.sweep import SWEEP

#: The whole recording is played in about this many seconds.
PLAYED_IN_S: Final = 60.0

#: The direction from the arm to the eye, base frame.
EYE_FROM: Final = np.array([0.62, -0.68, 0.39])

_SOLID = rr.components.FillMode.Solid


def blueprint(
    recording: Recording, laid: Mapping[str, Overlay], base: str | None, arm: bool, reach: Array
) -> rrb.Blueprint:
    """The layout of what has been logged.

    Args:
        recording: whose readings are shown.
        laid: sensor -> its calibration laid over the recording; none without a calibration.
        base: the base frame's name, where there is a pose. arm: whether the arm is shown.
        reach: (m, 3) [m] points that the view of the arm must hold, base frame.
    """
    span = float(recording.t[0]), float(recording.t[-1])
    columns = [_sensor_column(sensor, unit, laid.get(sensor), span) for sensor, unit in recording.units.items()]
    root: rrb.Container = rrb.Horizontal(contents=columns)
    if base is not None:
        title = f"The sweep of the {'arm' if arm else 'sensor'}, blue first, yellow last"
        sweep = spatial_view(title, [f"/{ARM}/**", f"/{SWEEP}/**"], base, reach)
        root = rrb.Horizontal(contents=[sweep, root], column_shares=[4, 5])
    return layout(root, played(*span))


def layout(root: rrb.Container, time: rrb.TimePanel) -> rrb.Blueprint:
    """What is shown, and nothing else: the viewer's own panels are folded."""
    return rrb.Blueprint(
        root,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        time,
        auto_views=False,
    )


def played(start_s: float, end_s: float) -> rrb.TimePanel:
    """The time panel, playing the whole recording again and again."""
    return rrb.TimePanel(
        state="collapsed",
        timeline=TIMELINE,
        playback_speed=round(max((end_s - start_s) / PLAYED_IN_S, 1.0), 1),
        play_state="playing",
        loop_mode="all",
    )


def _sensor_column(sensor: str, unit: str, overlay: Overlay | None, span: tuple[float, float]) -> rrb.Container:
    title = f"{sensor.capitalize()} [{unit}]"
    views: list[rrb.View] = [series_view(f"{READINGS}/{sensor}", title, *span, legend=True)]
    shares = [3.2]
    if overlay is not None:
        for name, sigma in zip(overlay.names, overlay.sigma, strict=True):
            title = f"Residual of {name} [{overlay.unit}], ±3σ = ±{3.0 * sigma:.3g} {overlay.unit}"
            views.append(series_view(f"{RESIDUALS}/{sensor}/{name}", title, *span, legend=False))
            shares.append(2.0)
    views.append(_spheres(sensor, overlay))
    shares.append(3.8)
    return rrb.Vertical(contents=views, row_shares=shares)


def series_view(origin: str, title: str, start_s: float, end_s: float, legend: bool) -> rrb.TimeSeriesView:
    """A plot of what lies below an entity, over the whole recording."""
    start, end = (rrb.TimeRangeBoundary.absolute(seconds=at) for at in (start_s, end_s))
    # Unless told, the plot starts as a short window about the time cursor.
    whole = rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end)) if end_s > start_s else None
    return rrb.TimeSeriesView(
        origin=origin,
        name=title,
        axis_x=whole,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=legend),
    )


def sphere_view(sensor: str, name: str, eye: tuple[float, float, float]) -> rrb.Spatial3DView:
    """A sensor's spheres of directions, seen from a place (3,)."""
    controls = rrb.EyeControls3D(position=eye, look_target=(0.0, 0.0, 0.0), eye_up=(0.0, 0.0, 1.0))
    return rrb.Spatial3DView(origin=f"{SPHERES}/{sensor}", name=name, eye_controls=controls, line_grid=False)


def _spheres(sensor: str, overlay: Overlay | None) -> rrb.Spatial3DView:
    name = f"Readings of the {sensor}, blue first, yellow last"
    if overlay is not None:
        name = f"{overlay.field_name.capitalize()} in frame 6 by residual, blue −3σ, orange +3σ"
    width = 1 if overlay is None else len(overlay.names)
    distance = 1.9 + 0.75 * width
    return sphere_view(sensor, name, (0.0, -distance, 0.4 * distance))


def spatial_view(title: str, contents: list[str], base: str, reach: Array) -> rrb.Spatial3DView:
    """A view of the scene about the arm that holds points ``reach`` (m, 3) [m], base frame."""
    low, high = reach.min(axis=0), reach.max(axis=0)
    centre = (low + high) / 2.0
    radius = max(float(np.linalg.norm(high - low)) / 2.0, 0.1)
    return scene_view(title, contents, base, centre + 1.9 * radius * EYE_FROM, centre)


def scene_view(title: str, contents: list[str], base: str, eye: ArrayLike, target: ArrayLike) -> rrb.Spatial3DView:
    """A view of the scene from a place towards another, both (3,) [m] in the base frame."""
    return rrb.Spatial3DView(
        origin="/",
        contents=contents,
        name=title,
        spatial_information=rrb.SpatialInformation(target_frame=base),
        eye_controls=rrb.EyeControls3D(position=eye, look_target=target, eye_up=(0.0, 0.0, 1.0)),
        defaults=[rr.Boxes3D.from_fields(fill_mode=_SOLID), rr.Cylinders3D.from_fields(fill_mode=_SOLID)],
    )
