"""How well a maneuver tells effects apart: every pair as a square, beside how well each is seen."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

from estimators.design.isolability import SEEN
from scenarios.colours import BLUE, GREY
from scenarios.isolability import EffectsBound
from scenarios.plots.style import new_figure, style
from scenarios.terminal.isolability import names

#: Bounds of the classes [σ], and their colours: from not at all to well.
_BOUNDS: Final = (0.0, 1.0, 5.0, 10.0, 30.0, 1e9)
_COLOURS: Final = ("#7A1F00", "#D55E00", "#F6D8B8", "#A9CDE6", "#0072B2")
_LABELS: Final = ("below 1", "1-5", "5-10", "10-30", "above 30")


def isolability_figure(found: EffectsBound) -> Figure:
    """Rows are the truth, columns what explains it instead; seen effects only."""
    here = found.here
    shown = np.flatnonzero(here.visible)
    labels = [names([here.effects[place]], found.names) for place in shown]
    side = max(4.5, 0.145 * len(shown))
    with style():
        figure = new_figure(side + 4.2, side + 2.6)
        if not len(shown):
            figure.text(0.5, 0.5, "no effect of typical size is seen", ha="center")
            return figure
        left, right = figure.subplots(1, 2, width_ratios=[1.1, side], sharey=True)
        left.barh(np.arange(len(shown)), here.seen[shown], color=BLUE, height=0.7)
        left.axvline(SEEN, color=GREY, linewidth=0.8)
        left.set_xscale("log")
        left.set_xlabel("seen [σ]")
        left.set_yticks(range(len(shown)), labels, fontsize=6.5)
        left.grid(axis="y", visible=False)
        matrix = here.apart[np.ix_(shown, shown)].copy()
        np.fill_diagonal(matrix, np.nan)
        colours = ListedColormap(list(_COLOURS)).with_extremes(bad="#FFFFFF")
        image = right.imshow(matrix, cmap=colours, norm=BoundaryNorm(_BOUNDS, len(_COLOURS)), aspect="auto")
        right.set_xticks(range(len(shown)), labels, fontsize=6.5, rotation=90)
        right.set_xlabel("explained by")
        right.grid(visible=False)
        right.set_title(f"{found.scenario}: what is left of each effect (rows) beside another (columns)")
        bar = figure.colorbar(image, ax=right, shrink=0.5, pad=0.01)
        bar.set_ticks([0.5, 3.0, 7.5, 20.0, 0.5e9], labels=list(_LABELS))
        bar.set_label("left [σ]")
    return figure
