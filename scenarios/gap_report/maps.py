"""Maps of the whitened residual over two joint angles, before and after, the two directions of travel side by side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.arrays import Array, Rows
from rig.channels import CHANNELS
from scenarios.colours import signed
from scenarios.gap_report.residuals import GapResiduals
from scenarios.gap_report.svg import Drawing, Scale, tick_label

Pixels = NDArray[np.uint8]

#: A cell's mean is shown in its standard errors, up to so many.
LIMIT: Final = 4.0
_SAMPLES_A_CELL: Final = 16
_MOST: Final = (60, 40)
_LEAST: Final = (10, 6)
_FILLED: Final = 0.85  # a map with more empty cells is drawn coarser
_STILL_RAD: Final = 0.05
_TURNS: Final = 1.5  # a joint that spans more than so many turns is shown within one
_EMPTY: Final = (255, 255, 255, 0)


@dataclass(frozen=True)
class Axis:
    """One axis of a map.

    Attributes:
        name: in words. unit: of the ticks.
        place: (n,) from 0 to 1 along the axis.
        ticks: places and their labels.
        folded: whether the second half runs back, for travel the other way.
    """

    name: str
    unit: str
    place: Array
    ticks: tuple[tuple[float, str], ...]
    folded: bool = False

    @property
    def title(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit}]" + (" out, then back" if self.folded else "")


def maps(residuals: GapResiduals) -> str:
    """A row a channel: the first pair of axes before and after, then the second pair."""
    pairs = axis_pairs(residuals)
    columns = residuals.data.columns
    sides = {"before": residuals.white_before}
    if residuals.white_after is not None:
        sides["after"] = residuals.white_after
    width, height, pitch, left, top = (206.0 if len(sides) > 1 else 424.0), 84.0, 100.0, 92.0, 40.0
    drawing = Drawing(1000, top + pitch * len(columns) + 66, "maps of the whitened residual, before and after")
    for group, (horizontal, vertical) in enumerate(pairs):
        shape = shape_of(horizontal, vertical)
        for side, (when, white) in enumerate(sides.items()):
            x = left + (width + 12.0) * (group * len(sides) + side) + 36.0 * group
            if side == 0:
                drawing.text(x, 14, f"across: {horizontal.title}; up: {vertical.title}", "panel")
            drawing.text(x, 32, when if len(sides) > 1 else "residual", f"when-{when}")
            for number, column in enumerate(columns):
                y = top + pitch * number
                drawing.image(x, y, width, height, cells(white[:, column], horizontal, vertical, shape))
                drawing.rect(x, y, width, height, "frame")
                if vertical.folded:
                    drawing.line(x, y + height / 2, x + width, y + height / 2, "fold")
                if horizontal.folded:
                    drawing.line(x + width / 2, y, x + width / 2, y + height, "fold")
                if side == 0:
                    for at, label in vertical.ticks:
                        drawing.text(x - 4, y + height * (1 - at) + 8 * at, label, "small", "end")
            for at, label in horizontal.ticks:
                anchor = {0.0: "start", 1.0: "end"}.get(at, "middle")
                drawing.text(x + width * at, top + pitch * len(columns) - 3, label, "small", anchor)
    for number, column in enumerate(columns):
        drawing.text(0, top + pitch * number + height / 2 + 4, CHANNELS[column], "name")
    _legend(drawing, left, drawing.height - 34)
    return str(drawing)


def _legend(drawing: Drawing, x: float, y: float) -> None:
    ramp = np.linspace(-LIMIT, LIMIT, 101)
    drawing.image(x, y, 300, 10, _coloured(ramp[None, :]))
    drawing.rect(x, y, 300, 10, "frame")
    scale = Scale(-LIMIT, LIMIT, x, x + 300)
    for value in (-4.0, -2.0, 0.0, 2.0, 4.0):
        drawing.text(scale.at(value), y + 24, tick_label(value), "tick", "middle")
    words = "mean of a cell, in its standard errors: noise alone leaves 95 of 100 cells within ±2"
    drawing.text(x + 316, y + 10, words, "note")


def axis_pairs(residuals: GapResiduals) -> list[tuple[Axis, Axis]]:
    """Horizontal and vertical axes: roll and pitch, then yaw and pitch, of a sweep; of a tool pose its attitude."""
    q = residuals.recording.q
    if q is None:
        return _attitude_pairs(residuals)
    moving = [joint for joint in range(q.shape[1]) if np.ptp(np.unwrap(q[:, joint])) > _STILL_RAD]
    if not moving:
        return _attitude_pairs(residuals)
    across = [_joint_axis(joint, q[:, joint]) for joint in moving]
    if len(moving) == 1:
        return [(across[0], _time_axis(residuals.recording.t))]
    pairs = [(across[-1], across[-2])]
    if len(moving) > 2:
        pairs.append((across[0], _joint_axis(moving[-2], q[:, moving[-2]], fold=False)))
    return pairs


def _joint_axis(joint: int, angle: Array, fold: bool = True) -> Axis:
    name = f"q{joint + 1}"
    turns = np.ptp(np.unwrap(angle)) > 2.0 * np.pi * _TURNS
    if turns:
        place = np.mod(angle / (2.0 * np.pi) + 0.5, 1.0)
        ticks = tuple((share, tick_label(360.0 * share - 180.0)) for share in (0.0, 0.25, 0.5, 0.75, 1.0))
        return Axis(name, "deg", place, ticks)
    low, high = float(angle.min()), float(angle.max())
    along = np.clip((angle - low) / (high - low), 0.0, 1.0)
    rising = np.gradient(angle) >= 0
    ends = tick_label(round(np.degrees(low))), tick_label(round(np.degrees(high)))
    if fold and 0.1 < float(np.mean(rising)) < 0.9:
        place = np.where(rising, 0.5 * along, 1.0 - 0.5 * along)
        return Axis(name, "deg", place, ((0.0, ends[0]), (0.5, ends[1]), (1.0, ends[0])), folded=True)
    return Axis(name, "deg", along, ((0.0, ends[0]), (1.0, ends[1])))


def _time_axis(t: Array) -> Axis:
    ticks = ((0.0, tick_label(round(float(t[0])))), (1.0, tick_label(round(float(t[-1])))))
    return Axis("time", "s", (t - t[0]) / max(float(t[-1] - t[0]), 1e-12), ticks)


def _attitude_pairs(residuals: GapResiduals) -> list[tuple[Axis, Axis]]:
    """Where the base's vertical points in the tool's frame; and the tool's position, where it is known."""
    vertical = residuals.data.base.R_base_tool[:, 2, :]
    azimuth = np.arctan2(vertical[:, 1], vertical[:, 0]) / (2.0 * np.pi) + 0.5
    ticks = tuple((share, tick_label(360.0 * share - 180.0)) for share in (0.0, 0.25, 0.5, 0.75, 1.0))
    heights = tuple((0.5 + 0.5 * value, tick_label(value)) for value in (-1.0, 0.0, 1.0))
    attitude = (
        Axis("azimuth of the vertical in the tool", "deg", azimuth, ticks),
        Axis("its z component", "1", 0.5 + 0.5 * vertical[:, 2], heights),
    )
    position = residuals.data.base.position
    if not position.size or np.ptp(position, axis=0).max() < 1e-3:
        return [attitude]
    axes = [_length_axis(name, position[:, column]) for column, name in enumerate("xyz")]
    widest = sorted(np.argsort(-np.ptp(position, axis=0))[:2])
    return [attitude, (axes[widest[0]], axes[widest[1]])]


def _length_axis(name: str, values: Array) -> Axis:
    low, high = float(values.min()), float(values.max())
    ticks = ((0.0, tick_label(round(low, 2))), (1.0, tick_label(round(high, 2))))
    return Axis(name, "m", np.clip((values - low) / max(high - low, 1e-9), 0.0, 1.0), ticks)


def cells(white: Array, horizontal: Axis, vertical: Axis, shape: tuple[int, int]) -> Pixels:
    """The map as pixels (rows, columns, 4): each cell's mean in its standard errors; empty cells are transparent."""
    known = np.isfinite(white) & (white != 0.0)  # what is left out is zero
    index = _index(horizontal, vertical, shape)[known]
    size = shape[0] * shape[1]
    count = np.bincount(index, minlength=size)
    total = np.bincount(index, weights=white[known], minlength=size)
    with np.errstate(invalid="ignore", divide="ignore"):
        score = total / np.sqrt(count)
    return _coloured(score.reshape(shape))


def _index(horizontal: Axis, vertical: Axis, shape: tuple[int, int]) -> Rows:
    """(n,) number of each sample's cell, row by row from the top."""
    down, across = shape
    column = np.minimum((horizontal.place * across).astype(np.intp), across - 1)
    row = np.minimum(((1.0 - vertical.place) * down).astype(np.intp), down - 1)
    return np.asarray(row * across + column)


def shape_of(horizontal: Axis, vertical: Axis) -> tuple[int, int]:
    """Rows and columns of a map, both even: about 16 samples a cell, coarser where many cells would be empty."""
    wanted = len(horizontal.place) / _SAMPLES_A_CELL
    while True:
        across = int(np.clip(2 * round(np.sqrt(1.5 * wanted) / 2), _LEAST[0], _MOST[0]))
        down = int(np.clip(2 * round(np.sqrt(wanted / 1.5) / 2), _LEAST[1], _MOST[1]))
        filled = len(np.unique(_index(horizontal, vertical, (down, across)))) / (down * across)
        if filled >= _FILLED or (across, down) == _LEAST:
            return down, across
        wanted *= 0.8


def _coloured(score: Array) -> Pixels:
    pixels = np.empty((*score.shape, 4), dtype=np.uint8)
    pixels[..., :3] = signed(np.nan_to_num(score).ravel(), LIMIT).reshape(*score.shape, 3)
    pixels[..., 3] = 255
    pixels[~np.isfinite(score)] = _EMPTY
    return pixels
