"""Studies in the rerun viewer: errors in units of the bound against the number of samples, or subset by subset."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from estimators.p_words import p_words
from rig.arrays import Array
from rig.files import in_utf8
from scenarios.colours import BLUE, GREY, ORANGE, ORDERS, rgb
from scenarios.parameter_names import shown_name
from scenarios.studies.error_summary import RATES, Cell, Summary, first_draw
from scenarios.studies.store import SUMMARY, TABLE, StudyFolder
from scenarios.studies.subset_results import SubsetStudy, read_subsets
from scenarios.studies.table_files import fitting_together
from scenarios.studies.verdict import verdicts
from scenarios.view.blueprint import layout
from scenarios.view.stream import written_stream

_SAMPLES: Final = "samples"
_SUBSET: Final = "subset"
#: Parameters that the layout shows; all others can be added in the viewer.
_SHOWN: Final = ("sensitivity1", "offset1")
_EXPLAINED: Final = (
    "Against the number of samples, in units of the Cramer-Rao bound. Error: the mean of all draws (thick), one draw"
    " (thin), ±1.96 bounds (grey). RMSE (thick) with its 95 % interval (thin), where the bound is small. Orange: the"
    " first n samples; blue: every k-th; green: random."
)


def write_study_view(path: Path, target: str | os.PathLike[str]) -> None:
    """Write an .rrd file, whole or not at all, of a finished study.

    Args:
        path: the study's folder.
        target: the file; ``.rrd`` is what the viewer opens.

    Raises:
        RigError: no study, an unfinished one, or one of a kind that has no view; or the file cannot be written.
    """
    folder = StudyFolder.read(path)
    with fitting_together(path), written_stream(target) as stream:
        stream.send_recording_name(in_utf8(path.name))
        if folder.kind == "subsets":
            stream.send_blueprint(_subsets(stream, read_subsets(folder)))
        else:
            stream.send_blueprint(_consistency(stream, folder))


def _consistency(stream: rr.RecordingStream, folder: StudyFolder) -> rrb.Blueprint:
    summary = Summary.from_tables(folder.table(SUMMARY), folder.table(RATES))
    errors = folder.table(TABLE) if (folder.path / TABLE).is_file() else None
    places: dict[str, str] = {}
    for cells in _series(summary):
        first = cells[0]
        level = f"noise_{first.noise_factor:g}"  # a path's parts have no special characters
        place = f"{first.sensor}/{first.method}/{level}/{first.parameter}"
        n = np.array([cell.count for cell in cells])
        bound = np.array([cell.bound for cell in cells])
        order, colour = first.order, ORDERS[first.order]
        bias = np.array([cell.bias for cell in cells]) / bound
        _line(stream, f"{place}/errors/{order}/mean", n, bias, f"mean, {order}", colour, 2.0)
        one = first_draw(errors, cells)
        if one is not None:
            _line(stream, f"{place}/errors/{order}/one_draw", n, one / bound, f"one draw, {order}", colour, 1.0)
        if place not in places:
            places[place] = f"{first.method} ×{first.noise_factor:g}, {_short(first.parameter)}"
            for sign, name in ((1.96, "upper"), (-1.96, "lower")):
                _line(stream, f"{place}/errors/{name}", n, np.full(len(n), sign), f"{sign:+g}", GREY, 1.0)
        small = [cell for cell in cells if cell.small]
        if small:
            ratio = np.array([[cell.ratio_low, cell.ratio, cell.ratio_high] for cell in small]).T
            of_small = np.array([cell.count for cell in small])
            for values, name, width in zip(ratio, ("low", "RMSE", "high"), (0.7, 2.0, 0.7), strict=True):
                _line(stream, f"{place}/ratio/{order}/{name}", of_small, values, f"{name}, {order}", colour, width)
    shown = [place for place in places if place.rpartition("/")[2] in _SHOWN] or list(places)[:4]
    counts = [cell.count for cell in summary.cells]
    views: list[rrb.View] = []
    for place in shown:
        for part, what, reach in (("errors", "error", (-4.0, 4.0)), ("ratio", "RMSE", (0.8, 1.2))):
            views.append(_view(f"{place}/{part}", f"{places[place]}: {what}", reach, (min(counts), max(counts))))
    lines = [_EXPLAINED]
    for verdict in verdicts(summary):
        lines += [f"**{verdict.title}**", *verdict.sentences]
    return _blueprint(stream, "\n\n".join(lines), views, 4, _SAMPLES)


def _short(parameter: str) -> str:
    return shown_name(parameter).replace("sensitivity", "S").replace("offset", "δ")


def _series(summary: Summary) -> Iterator[Sequence[Cell]]:
    """The cells of one curve after the other, by growing count."""
    groups: dict[tuple[object, ...], list[Cell]] = {}
    for cell in summary.cells:
        key = (cell.sensor, cell.method, cell.noise_factor, cell.parameter, cell.order)
        groups.setdefault(key, []).append(cell)
    for cells in groups.values():
        yield sorted(cells, key=lambda cell: cell.count)


def _subsets(stream: rr.RecordingStream, study: SubsetStudy) -> rrb.Blueprint:
    number = np.arange(study.subsets)
    views: list[rrb.View] = []
    for row, values in zip(study.parameters, study.estimates, strict=True):
        if not np.isfinite(row.bound):
            continue
        name = shown_name(row.parameter)
        place = f"{row.sensor}/{name}"
        _line(stream, place, number, (values - row.mean) / row.bound, name, BLUE, 1.2)
        views.append(_view(place, f"{row.sensor[:5]}. {_short(row.parameter)}", (-5.0, 5.0), (0, study.subsets - 1)))
    channels = ", ".join(channel.channel for channel in study.channels)
    for name, attribute, colour in (("noise-like", "noise_like", BLUE), ("systematic", "systematic", ORANGE)):
        levels = [getattr(channel, attribute) for channel in study.channels]
        stream.log(f"fit_error/{attribute}", rr.BarChart(levels, color=rgb(colour)), static=True)
        views.append(rrb.BarChartView(origin=f"fit_error/{attribute}", name=f"{name} [{study.channels[0].unit}]"))
    lines = [
        f"**{study.recording}**, {study.samples:,} samples in {study.subsets} interleaved subsets",
        "Curves: each subset's estimate less the mean, in units of the Cramer-Rao bound. What scatters is noise; what"
        " all subsets share is systematic, and only in the fit error.",
        f"Bars: the fit error of {channels} taken apart.",
    ]
    for channel in study.channels:
        lines.append(
            f"{channel.channel}: {channel.share:.0%} ({channel.share_low:.0%} to {channel.share_high:.0%}) noise-like"
        )
    for agreement in study.agreements:
        lines.append(
            f"{agreement.sensor}: separate fits' field directions, chi-square {agreement.chi_square:.1f} for"
            f" {agreement.degrees_of_freedom}, {p_words(agreement.p_value)}"
        )
    return _blueprint(stream, "\n\n".join(lines), views, 5, _SUBSET)


def _line(
    stream: rr.RecordingStream, path: str, index: NDArray[np.int_], values: Array, name: str, colour: str, width: float
) -> None:
    timeline = _SUBSET if path.count("/") < 2 else _SAMPLES
    stream.log(path, rr.SeriesLines(colors=[rgb(colour)], names=[name], widths=[width]), static=True)
    told = np.isfinite(values)
    columns = rr.Scalars.columns(scalars=np.asarray(values, dtype=float)[told])
    stream.send_columns(path, indexes=[rr.TimeColumn(timeline, sequence=index[told])], columns=columns)


def _view(origin: str, name: str, reach: tuple[float, float], indices: tuple[int, int]) -> rrb.TimeSeriesView:
    start, end = (rrb.TimeRangeBoundary.absolute(seq=index) for index in indices)
    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        axis_x=rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end)),
        axis_y=rrb.ScalarAxis(range=reach),
        plot_legend=rrb.PlotLegend(visible=False),
    )


def _blueprint(
    stream: rr.RecordingStream, text: str, views: Sequence[rrb.View], columns: int, timeline: str
) -> rrb.Blueprint:
    stream.log("explained", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)
    return layout(
        rrb.Horizontal(
            rrb.TextDocumentView(origin="explained", name="What it shows"),
            rrb.Grid(contents=list(views), grid_columns=columns),
            column_shares=[1, 4],
        ),
        rrb.TimePanel(state="collapsed", timeline=timeline, play_state="paused"),
    )
