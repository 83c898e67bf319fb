"""A session in the rerun viewer, live: directions seen and missing, readings, residuals, intervals, and the arm."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from estimators.coverage import Enough, direction_name
from estimators.live import SensorState
from estimators.live.estimate import SensorEstimate
from rig.arm import Arm
from rig.arrays import Array
from rig.channels import CHANNELS_OF
from rig.recording import Recording, joined
from scenarios.colours import AXES_ON_DARK, GREY, ORANGE, VERMILLION, YELLOW, rgb
from scenarios.decimation import extremes
from scenarios.live.session import Display, Event, Session
from scenarios.sensor_motion import arm_of
from scenarios.terminal.calibration import symbol
from scenarios.terminal.tables import plus_minus
from scenarios.view.arm import ARM, ArmView
from scenarios.view.blueprint import layout, scene_view, sphere_view
from scenarios.view.series import READINGS, RESIDUALS
from scenarios.view.spheres import SPHERES, globe
from scenarios.view.stream import TIMELINE, at, new_stream
from scenarios.view.viewer import start_viewer

#: The view is brought up to date this often at most [s], and the larger parts of it less often.
_PERIOD_S: Final = 0.2
_SPHERE_S: Final = 0.5
#: Points of a series for each time it is brought up to date.
_POINTS: Final = 24
_LONGEST: Final = 4096
#: Readings and residuals are shown this far back [s].
_BACK_S: Final = 30.0
_SEEN, _MISSING = rgb(AXES_ON_DARK[0]), rgb(ORANGE)
_INTERVALS: Final = "intervals"
_GUIDE: Final = "guide"


class LiveView(Display):
    """Shows a session in a viewer window, in a file, or both."""

    def __init__(self, window: bool, file: Path | None, arm: Arm | None) -> None:
        """Args:
        window: open the viewer, which nothing but this machine can reach.
        file: what is written besides, or instead.
        arm: for joint angles; None: the A465 where the recording names it.

        Raises:
            RigError: the viewer cannot be started, or logging is switched off in the environment.
        """
        self._stream = new_stream("torusrig live")
        sinks: list[Any] = [rr.GrpcSink(start_viewer())] if window else []
        sinks += [rr.FileSink(str(file))] if file is not None else []
        self._stream.set_sinks(*sinks)
        self._arm_model = arm
        self._arm: ArmView | None = None
        self._waiting: list[Recording] = []
        self._last: Recording | None = None
        self._begun, self._begun_s = False, 0.0
        self._early: list[Event] = []  # events from before the first sample
        self._shown: Session | None = None
        self._at = self._sphere_at = -np.inf
        self._parameters: dict[str, tuple[str, ...]] = {}

    def samples(self, batch: Recording) -> None:
        """Keep the new samples until they are drawn: the latest of them, if there are too many."""
        if not self._begun:
            self._begin(batch)
        self._waiting.append(batch)
        while sum(map(len, self._waiting)) > _LONGEST and len(self._waiting) > 1:
            self._waiting.pop(0)

    def show(self, session: Session) -> None:
        """Draw what is new, if it is time."""
        self._shown = session
        if not self._begun or time.monotonic() - self._at < _PERIOD_S:
            return
        self._at = time.monotonic()
        self._draw(session)

    def event(self, event: Event) -> None:
        """A line in the log; from before the first sample, at the first."""
        if not self._begun:
            self._early.append(event)
            return
        self._stream.set_time(TIMELINE, duration=self._begun_s if np.isnan(event.t_s) else event.t_s)
        level = rr.TextLogLevel.WARN if event.alarm else rr.TextLogLevel.INFO
        self._stream.log("events", rr.TextLog(str(event), level=level))

    def close(self) -> None:
        """Draw the last state, and write what is pending."""
        if self._shown is not None:
            self._sphere_at = -np.inf
            self._draw(self._shown)
        self._stream.disconnect()

    def _begin(self, batch: Recording) -> None:
        self._begun, self._begun_s = True, float(batch.t[0])
        model = self._arm_model or arm_of(batch)
        if batch.q is not None and model is not None:
            self._arm = ArmView(self._stream, model)
        self._stream.send_blueprint(_blueprint(batch.units, None if self._arm is None else self._arm.base))
        for sensor in batch.sensors:
            for channel, colour in zip(CHANNELS_OF[sensor], AXES_ON_DARK, strict=True):
                self._style(f"{READINGS}/{sensor}/{channel}", channel, colour)
            self._stream.log(f"{SPHERES}/{sensor}/globe", globe(), static=True)
            axes = rr.Arrows3D(
                vectors=1.35 * np.eye(3), colors=[rgb(c) for c in AXES_ON_DARK], radii=0.015, labels=["x", "y", "z"]
            )
            self._stream.log(f"{SPHERES}/{sensor}/axes", axes, static=True)
        for event in self._early:
            self.event(event)

    def _style(self, path: str, name: str, colour: str, width: float = 1.2) -> None:
        self._stream.log(path, rr.SeriesLines(colors=[rgb(colour)], names=[name], widths=[width]), static=True)

    def _draw(self, session: Session) -> None:
        parts, self._waiting = self._waiting, []
        if parts:
            self._last = joined(parts)
            for sensor in self._last.sensors:
                self._series(sensor, self._last, session)
        if self._last is None:
            return
        self._stream.set_time(TIMELINE, duration=session.t_s)
        if self._arm is not None and self._last.q is not None:
            self._arm.move(self._last.t[-1:], self._last.q[-1:])
        spheres = time.monotonic() - self._sphere_at >= _SPHERE_S
        for state in session.states:
            if state.estimate is not None and state.rule is not None:
                self._intervals(state.sensor, state.rule)
                if spheres:
                    self._sphere(state, state.estimate, state.rule)
        if spheres:
            self._sphere_at = time.monotonic()
        self._stream.log(_GUIDE, rr.TextDocument(_words(session), media_type=rr.MediaType.MARKDOWN))

    def _series(self, sensor: str, part: Recording, session: Session) -> None:
        for channel, values in zip(CHANNELS_OF[sensor], part.readings(sensor).T, strict=True):
            self._line(f"{READINGS}/{sensor}/{channel}", part.t, values)
        watch = session.watch
        reference = None if watch is None or sensor not in watch.sensors else watch.sensors[sensor].reference
        if reference is None or not np.isfinite(reference.matrix).all():
            return
        assert watch is not None
        values = reference.residuals(part, sensor, watch.arm).values
        names = CHANNELS_OF[sensor] if values.shape[1] == 3 else ("magnitude",)
        if self._parameters.setdefault(f"{sensor} residuals", ()) != names:
            self._parameters[f"{sensor} residuals"] = tuple(names)
            for name, colour in zip(names, AXES_ON_DARK, strict=False):
                self._style(f"{RESIDUALS}/{sensor}/{name}", name, colour)
            for name in ("+3σ", "-3σ"):
                self._style(f"{RESIDUALS}/{sensor}/{name}", name, GREY)
        for name, column in zip(names, values.T, strict=True):
            self._line(f"{RESIDUALS}/{sensor}/{name}", part.t, column)
        for name, level in (("+3σ", 3.0), ("-3σ", -3.0)):
            self._line(f"{RESIDUALS}/{sensor}/{name}", part.t[-1:], np.full(1, level))

    def _line(self, path: str, t: Array, values: Array) -> None:
        rows = extremes(np.ascontiguousarray(values), _POINTS)
        self._stream.send_columns(path, indexes=at(t[rows]), columns=rr.Scalars.columns(scalars=values[rows]))

    def _intervals(self, sensor: str, rule: Enough) -> None:
        """How wide each interval is over what was asked for, as powers of ten: all below zero is enough."""
        if self._parameters.get(sensor) != tuple(rule.target):
            self._parameters[sensor] = tuple(rule.target)
            for place, name in enumerate(rule.target):
                self._style(f"{_INTERVALS}/{sensor}/{name}", name, AXES_ON_DARK[place % 3])
            self._style(f"{_INTERVALS}/{sensor}/asked", "asked for", YELLOW, 2.0)
        for name, target in rule.target.items():
            ratio = rule.std[name] / target
            if np.isfinite(ratio) and ratio > 0.0:
                self._stream.log(f"{_INTERVALS}/{sensor}/{name}", rr.Scalars(float(np.log10(ratio))))
        self._stream.log(f"{_INTERVALS}/{sensor}/asked", rr.Scalars(0.0))

    def _sphere(self, state: SensorState, estimate: SensorEstimate, rule: Enough) -> None:
        path = f"{SPHERES}/{state.sensor}"
        seen, missing = estimate.directions, rule.coverage.missing
        self._stream.log(f"{path}/seen", rr.Points3D(seen, colors=[_SEEN], radii=0.022 if len(seen) > 100 else 0.05))
        self._stream.log(f"{path}/missing", rr.Points3D(missing, colors=[_MISSING], radii=0.05))
        if self._last is not None:
            field = (self._last.readings(state.sensor)[-1] - estimate.bias) @ estimate.matrix.T
            length = float(np.sqrt(field @ field))
            if length > 0.0:
                marker = rr.Points3D([field / length], colors=[(255, 255, 255)], radii=0.07)
                self._stream.log(f"{path}/now", marker)
        toward = rule.next_direction
        if state.enough or toward is None:
            self._stream.log(f"{path}/next", rr.Clear(recursive=False))
            return
        label = f"next: {direction_name(toward)}"
        arrow = rr.Arrows3D(vectors=[1.5 * np.asarray(toward)], colors=[rgb(VERMILLION)], radii=0.03, labels=[label])
        self._stream.log(f"{path}/next", arrow)


def _words(session: Session) -> str:
    """What to do and how it stands, as Markdown."""
    lines = [f"**{'ENOUGH' if session.enough else 'live'}**, {session.samples:,} samples, {session.t_s:.1f} s", ""]
    if guidance := session.guidance:
        lines += [f"**{guidance}**", ""]
    for state in session.states:
        todo = "enough" if state.enough else state.problem or state.turn
        lines += [f"**{state.sensor}**: {100.0 * state.seen:.0f} % of directions seen; {todo}", ""]
        if state.estimate is not None:
            lines += _table(state.estimate)
    if session.watch is not None:
        for name, one in session.watch.sensors.items():
            if one.alarmed is not None:
                lines += [f"**ALARM {name}** since {one.alarmed.since_s:.1f} s: {one.alarmed.looks_like}", ""]
    return "\n".join(lines)


def _table(found: SensorEstimate) -> Sequence[str]:
    cells = [
        f"{symbol(name)} {plus_minus(value, std * found.quantile, ' ± ')}"
        for name, value, std in zip(found.names, found.values.tolist(), found.std.tolist(), strict=True)
    ]
    width = 3
    rows = ["|" + " |" * width, "|" + "---|" * width]
    rows += ["| " + " | ".join(cells[i : i + width]) + " |" for i in range(0, len(cells), width)]
    return [*rows, ""]


def _blueprint(units: Mapping[str, str], base: str | None) -> rrb.Blueprint:
    """The sensor or the arm on the left, a column for each sensor on the right; ``base``: the arm's base frame, None
    without an arm."""
    columns = [_column(sensor, unit) for sensor, unit in units.items()]
    text = rrb.TextDocumentView(origin=_GUIDE, name="What to do, and what is known")
    log = rrb.TextLogView(
        origin="events",
        name="Events",
        columns=rrb.TextLogColumns(text_log_columns=["loglevel", "body"]),
        format_options=rrb.TextLogFormat(monospace_body=False),
    )
    left: list[rrb.View] = [text, log]
    shares = [3.0, 1.0]
    if base is not None:
        left.insert(0, scene_view("The arm", [f"/{ARM}/**"], base, (0.95, -1.0, 0.85), (0.1, 0.0, 0.45)))
        shares = [2.2, 2.8, 1.2]
    return layout(
        rrb.Horizontal(contents=[rrb.Vertical(contents=left, row_shares=shares), *columns]),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
    )


def _column(sensor: str, unit: str) -> rrb.Container:
    back = rr.TimeRange(
        start=rr.TimeRangeBoundary.cursor_relative(seconds=-_BACK_S), end=rr.TimeRangeBoundary.cursor_relative()
    )
    last = rrb.TimeAxis(view_range=back)
    whole = rr.TimeRange(start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.infinite())
    return rrb.Vertical(
        contents=[
            sphere_view(sensor, f"Field at the {sensor}: seen blue, missing orange, now white", (1.6, -2.5, 1.3)),
            rrb.TimeSeriesView(origin=f"{READINGS}/{sensor}", name=f"{sensor.capitalize()} [{unit}]", axis_x=last),
            rrb.TimeSeriesView(
                origin=f"{RESIDUALS}/{sensor}", name="Residuals [standard deviations], lines at ±3", axis_x=last
            ),
            rrb.TimeSeriesView(
                origin=f"{_INTERVALS}/{sensor}",
                name="Interval over what was asked for [powers of ten]",
                axis_x=rrb.TimeAxis(view_range=whole),
                plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=False),
            ),
        ],
        row_shares=[3.0, 1.6, 1.6, 1.8],
    )
