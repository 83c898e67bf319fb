"""How every plot looks, and how it is saved: no state of matplotlib's is left changed."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rig.arrays import Array
from rig.errors import RigError
from rig.files import atomic_path
from scenarios.colours import AXES_ON_PAPER, BLUE, VERMILLION

#: What a plot can be saved as.
SUFFIXES: Final = (".png", ".svg", ".pdf")

_STYLE: Final[dict[Any, Any]] = {
    "figure.dpi": 100,
    "savefig.dpi": 160,
    "figure.constrained_layout.use": True,
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titlepad": 5,
    "axes.labelsize": 9,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.prop_cycle": cycler(color=AXES_ON_PAPER),
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.5,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "lines.linewidth": 1.0,
    "svg.hashsalt": "torusrig",
}


@contextmanager
def style() -> Iterator[None]:
    """Inside the block, figures are made in the common style."""
    with mpl.rc_context(_STYLE):
        yield


def new_figure(width: float, height: float, title: str = "") -> Figure:
    """A figure of ``width`` by ``height`` inches that belongs to no window, its title above all panels."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    if title:
        figure.suptitle(title, x=0.01, ha="left", fontsize=10)
    return figure


def parameter_rows(axis: Axes, names: Sequence[str]) -> Array:
    """A row for each parameter, the first one at the top; gives their heights (k,)."""
    heights = -np.arange(len(names), dtype=float)
    axis.set_yticks(heights, names)
    axis.set_ylim(heights[-1] - 0.7, 0.7)
    axis.grid(axis="y", visible=False)
    return heights


def judged_point(axis: Axes, height: float, value: float, ends: tuple[float, float], good: bool) -> None:
    """A value in its row on a line between two ends, in the colour and shape of what is good or not."""
    colour, marker = (BLUE, "o") if good else (VERMILLION, "D")
    axis.plot(ends, (height, height), color=colour, linewidth=1.0, alpha=0.6)
    axis.plot(value, height, marker, color=colour, markersize=5)


def in_words(axis: Axes, x: float, y: float, words: str = "cannot be told", **options: Any) -> None:
    """What stands where there is nothing to draw; ``options`` as of ``Axes.text``."""
    axis.text(x, y, words, ha="center", va="center", style="italic", **options)


def save(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Save a figure as .png, .svg or .pdf, whole or not at all, and the same to the byte every time.

    Raises:
        RigError: another ending, or the file cannot be written.
    """
    file = Path(path)
    suffix = file.suffix.lower()
    if suffix not in SUFFIXES:
        raise RigError(f"{file}: found the ending {suffix!r}, expected one of {', '.join(SUFFIXES)}")
    dated = {".png": {"Software": None}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    with style(), atomic_path(file) as temporary:
        figure.savefig(temporary, format=suffix[1:], metadata=dated[suffix])
