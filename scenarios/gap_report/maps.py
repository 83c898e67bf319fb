"""Maps of the whitened residual over two joint angles, before and after, the two directions of travel side by side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.colors import LinearSegmentedColormap

from rig.arrays import Array, Rows
from rig.channels import CHANNELS
from scenarios.colours import BLUE, GREY, SIGNED, VERMILLION
from scenarios.gap_report.gap_residuals import GapResiduals
from scenarios.plots.inline_svg import inline_svg, page_panels
from scenarios.plots.style import style

#: A cell's mean is shown in its standard errors, up to so many.
LIMIT: Final = 4.0
_SAMPLES_A_CELL: Final = 16
_MOST: Final = (60, 40)
_LEAST: Final = (10, 6)
_FILLED: Final = 0.85  # a map with more empty cells is drawn coarser
_STILL_RAD: Final = 0.05
_TURNS: Final = 1.5  # a joint that spans more than so many turns is shown within one
#: Of an angle within a turn [deg].
_TURN: Final = tuple((share, f"{360.0 * share - 180.0:g}".replace("-", "−")) for share in (0.0, 0.25, 0.5, 0.75, 1.0))
_SHOWN: Final[dict[str, Any]] = {
    "cmap": LinearSegmentedColormap.from_list("signed", SIGNED),
    "vmin": -LIMIT,
    "vmax": LIMIT,
    "extent": (0.0, 1.0, 0.0, 1.0),
    "aspect": "auto",
    "interpolation": "none",
}


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
    sides = [("before", residuals.white_before, VERMILLION)]
    if residuals.white_after is not None:
        sides.append(("after", residuals.white_after, BLUE))
    pairs, columns = axis_pairs(residuals), residuals.data.columns
    with style():
        height = 100.0 * len(columns) + 120.0
        figure, axes = page_panels(
            (1000.0, height), len(columns), len(pairs) * len(sides), (84.0, 20.0, 62.0, 90.0), (44.0, 20.0)
        )
        for group, (horizontal, vertical) in enumerate(pairs):
            shape = shape_of(horizontal, vertical)
            for side, (when, white, colour) in enumerate(sides):
                panels = axes[:, group * len(sides) + side]
                for panel, column in zip(panels, columns, strict=True):
                    image = panel.imshow(cells(white[:, column], horizontal, vertical, shape), **_SHOWN)
                    if horizontal.folded:
                        panel.axvline(0.5, color="white", linewidth=2.0)
                    if vertical.folded:
                        panel.axhline(0.5, color="white", linewidth=2.0)
                    panel.set_xticks([])
                    panel.set_yticks(*(zip(*vertical.ticks, strict=True) if side == 0 else ((),)))
                    panel.grid(visible=False)
                    panel.spines[:].set(visible=True, color=GREY)
                panels[0].set_title(when if len(sides) > 1 else "residual", color=colour, weight="bold")
                panels[-1].set_xticks(*zip(*horizontal.ticks, strict=True))
            words = f"across: {horizontal.title}\nup: {vertical.title}"
            figure.text(axes[0, group * len(sides)].get_position().x0, 0.995, words, weight="bold", va="top")
        for panel, column in zip(axes[:, 0], columns, strict=True):
            panel.set_ylabel(CHANNELS[column])
        bar = figure.colorbar(
            image, figure.add_axes((0.25, 44.0 / height, 0.5, 12.0 / height)), orientation="horizontal"
        )
        bar.set_label("mean of a cell, in its standard errors: noise alone leaves 95 of 100 cells within ±2")
    return inline_svg(figure, "maps of the whitened residual, before and after")


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
        return [(across[0], _linear("time", "s", residuals.recording.t, 0))]
    pairs = [(across[-1], across[-2])]
    if len(moving) > 2:
        pairs.append((across[0], _joint_axis(moving[-2], q[:, moving[-2]], fold=False)))
    return pairs


def _joint_axis(joint: int, angle: Array, fold: bool = True) -> Axis:
    name = f"q{joint + 1}"
    turns = np.ptp(np.unwrap(angle)) > 2.0 * np.pi * _TURNS
    if turns:
        place = np.mod(angle / (2.0 * np.pi) + 0.5, 1.0)
        return Axis(name, "deg", place, _TURN)
    low, high = float(angle.min()), float(angle.max())
    along = np.clip((angle - low) / (high - low), 0.0, 1.0)
    rising = np.gradient(angle) >= 0
    ends = _label(round(np.degrees(low))), _label(round(np.degrees(high)))
    if fold and 0.1 < float(np.mean(rising)) < 0.9:
        place = np.where(rising, 0.5 * along, 1.0 - 0.5 * along)
        return Axis(name, "deg", place, ((0.0, ends[0]), (0.5, ends[1]), (1.0, ends[0])), folded=True)
    return Axis(name, "deg", along, ((0.0, ends[0]), (1.0, ends[1])))


def _attitude_pairs(residuals: GapResiduals) -> list[tuple[Axis, Axis]]:
    """Where the base's vertical points in the tool's frame; and the tool's position, where it is known."""
    vertical = residuals.data.base.R_base_tool[:, 2, :]
    azimuth = np.arctan2(vertical[:, 1], vertical[:, 0]) / (2.0 * np.pi) + 0.5
    heights = tuple((0.5 + 0.5 * value, _label(value)) for value in (-1.0, 0.0, 1.0))
    attitude = (
        Axis("azimuth of the vertical in the tool", "deg", azimuth, _TURN),
        Axis("its z component", "1", 0.5 + 0.5 * vertical[:, 2], heights),
    )
    position = residuals.data.base.position
    if not position.size or np.ptp(position, axis=0).max() < 1e-3:
        return [attitude]
    axes = [_linear(name, "m", position[:, column], 2) for column, name in enumerate("xyz")]
    widest = sorted(np.argsort(-np.ptp(position, axis=0))[:2])
    return [attitude, (axes[widest[0]], axes[widest[1]])]


def _linear(name: str, unit: str, values: Array, decimals: int) -> Axis:
    low, high = float(values.min()), float(values.max())
    ticks = ((0.0, _label(round(low, decimals))), (1.0, _label(round(high, decimals))))
    return Axis(name, unit, np.clip((values - low) / max(high - low, 1e-9), 0.0, 1.0), ticks)


def cells(white: Array, horizontal: Axis, vertical: Axis, shape: tuple[int, int]) -> Array:
    """The map (rows, columns): each cell's mean in its standard errors; NaN where it is empty."""
    known = np.isfinite(white) & (white != 0.0)  # what is left out is zero
    index = _index(horizontal, vertical, shape)[known]
    size = shape[0] * shape[1]
    count = np.bincount(index, minlength=size)
    total = np.bincount(index, weights=white[known], minlength=size)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray((total / np.sqrt(count)).reshape(shape))


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


def _label(value: float) -> str:
    return f"{value:g}".replace("-", "−")
