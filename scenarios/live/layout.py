"""What the live view shows: the sensor or the arm on the left, a column for each sensor on the right."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import rerun as rr
import rerun.blueprint as rrb

from scenarios.view.arm import ARM
from scenarios.view.blueprint import layout, scene_view, sphere_view
from scenarios.view.series import READINGS, RESIDUALS
from scenarios.view.stream import TIMELINE

INTERVALS: Final = "intervals"
GUIDE: Final = "guide"
NOW: Final = "now"

#: Readings and residuals are shown this far back [s].
_BACK_S: Final = 30.0


def live_blueprint(units: Mapping[str, str], base: str | None) -> rrb.Blueprint:
    """The layout; ``base``: the arm's base frame, None without an arm."""
    columns = [_column(sensor, unit) for sensor, unit in units.items()]
    text = rrb.TextDocumentView(origin=GUIDE, name="What to do, and what is known")
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
                origin=f"{INTERVALS}/{sensor}",
                name="Interval over what was asked for [powers of ten]",
                axis_x=rrb.TimeAxis(view_range=whole),
                plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=False),
            ),
        ],
        row_shares=[3.0, 1.6, 1.6, 1.8],
    )
