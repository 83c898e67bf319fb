"""The picture of the loop: the share of rigs named rightly by arm time, and how the others end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from scenarios.colours import BLUE, GREEN, GREY, ORANGE, VERMILLION
from scenarios.plots.style import new_figure, style
from validation.loop.summary import ENDS, Summary

_LINES: Final = {"proposed": (BLUE, "-"), "random": (ORANGE, "--"), "torus": (GREEN, ":")}
_ENDS: Final = dict(zip(ENDS, (BLUE, VERMILLION, ORANGE, GREY), strict=True))
_HATCHES: Final = dict(zip(ENDS, ("", "xx", "//", ""), strict=True))


def loop_figure(found: Sequence[Summary]) -> Figure:
    """Left the share of rigs named rightly within the minutes of arm time, right how all of them end."""
    with style():
        figure = new_figure(9.0, 3.6)
        left, right = figure.subplots(1, 2, width_ratios=[1.3, 1.0])
        longest = max(step.minutes for each in found for step in each.last)
        minutes = np.linspace(0.0, 1.05 * longest, 600)
        for each in found:
            colour, line = _LINES[each.strategy]
            left.plot(minutes, 100.0 * each.share(minutes), line, color=colour, linewidth=2.0, label=each.strategy)
        left.set_ylim(0.0, 105.0)
        left.set_xlim(0.0, minutes[-1])
        left.set_xlabel("arm time of all recordings of a rig [min]")
        left.set_ylabel("rigs named rightly [%]")
        left.set_title("Named rightly by arm time")
        left.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=3, fontsize=8)
        for place, each in enumerate(found):
            begin = 0.0
            for name, count in each.ends.items():
                right.barh(
                    -place,
                    count,
                    left=begin,
                    height=0.6,
                    color=_ENDS[name],
                    hatch=_HATCHES[name],
                    edgecolor="white",
                    label=name if place == 0 else None,
                )
                if count:
                    box = {"facecolor": "white", "edgecolor": "none", "boxstyle": "round,pad=0.15"}
                    right.text(begin + 0.5 * count, -place, str(count), ha="center", va="center", bbox=box)
                begin += count
        right.set_yticks([-place for place in range(len(found))], [each.strategy for each in found])
        right.set_xlabel("rigs")
        right.set_title("How they end")
        right.grid(axis="y", visible=False)
        right.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=4, fontsize=8)
    return figure
