"""A figure as an element of a page: no file, its letters the page's own, read aloud by its label."""

from __future__ import annotations

import io
import re
from html import escape
from typing import Any, Final

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.layout_engine import PlaceHolderLayoutEngine
from numpy.typing import NDArray

from scenarios.plots.style import style

_CSS_PIXELS_AN_INCH: Final = 96.0
#: Names that nothing refers to, the family of the letters, rules that would hold for the whole page, indentation.
_SURPLUS: Final = re.compile(
    r""" id="[\w.]+_\d+"|(?:font-family: |(?<=px) )'DejaVu Sans'[^;"]*|<defs>\s*<style.*?</defs>|\s+(?=<)""",
    re.DOTALL,
)
#: Of a path: less than a hundredth of a point, and line ends.
_FINE: Final = re.compile(r"(?<=\.\d\d)\d+|\s+(?=[A-Za-z])|\s+$")


def page_panels(
    size: tuple[float, float],
    rows: int,
    columns: int,
    margins: tuple[float, float, float, float],
    gaps: tuple[float, float] = (0.0, 0.0),
    **options: Any,
) -> tuple[Figure, NDArray[Any]]:
    """A figure for a page, which scales it down where it is narrower, and its panels (rows, columns).

    Args:
        size: width and height; margins: left, right, top and bottom; gaps between panels, across and down: all in
            pixels of the page. They are given, as looking for the best ones takes longer than drawing.
        options: as ``Figure.subplots`` has them.
    """
    (width, height), (left, right, top, bottom) = size, margins
    inner = (
        (width - left - right - gaps[0] * (columns - 1)) / columns,
        (height - top - bottom - gaps[1] * (rows - 1)) / rows,
    )
    figure = Figure(
        figsize=(width / _CSS_PIXELS_AN_INCH, height / _CSS_PIXELS_AN_INCH),
        layout=PlaceHolderLayoutEngine(False, False),
    )
    at = {"left": left / width, "right": 1.0 - right / width, "top": 1.0 - top / height, "bottom": bottom / height}
    at |= {"wspace": gaps[0] / inner[0], "hspace": gaps[1] / inner[1]}
    return figure, figure.subplots(rows, columns, squeeze=False, gridspec_kw=at, **options)


def inline_svg(figure: Figure, label: str) -> str:
    """The figure as an SVG element, the same every time.

    Args:
        label: what it shows, for those who cannot see it.
    """
    file = io.StringIO()
    with style(), mpl.rc_context({"svg.fonttype": "none"}):
        figure.savefig(file, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
    _, _, drawing = file.getvalue().partition("<svg ")
    drawing = re.sub(r'(?<= d=")[^"]*', lambda path: _FINE.sub("", path[0]), _SURPLUS.sub("", drawing))
    return f'<svg role="img" aria-label="{escape(label)}" {drawing}'
