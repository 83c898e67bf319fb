"""Small drawings as inline SVG: what looks like what is left to the page's style sheet."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig.arrays import Array


@dataclass(frozen=True)
class Scale:
    """From values to positions in a drawing.

    Attributes:
        low, high: the ends in values; start, end: in positions. log: logarithmic, both ends above zero.
    """

    low: float
    high: float
    start: float
    end: float
    log: bool = False

    def __call__(self, values: ArrayLike) -> Array:
        """Positions of values, of the same shape."""
        array = np.asarray(values, dtype=float)
        low, high = self.low, self.high
        if self.log:
            array, low, high = np.log(array), math.log(low), math.log(high)
        return np.asarray(self.start + (array - low) / (high - low) * (self.end - self.start))

    def at(self, value: float) -> float:
        """The position of one value."""
        return float(self(value))

    def ticks(self, count: int = 5) -> list[float]:
        """Round values between the ends, about so many; powers of ten on a logarithmic scale."""
        if self.log:
            decades = range(math.ceil(math.log10(self.low) - 1e-9), math.floor(math.log10(self.high) + 1e-9) + 1)
            return [10.0**decade for decade in decades]
        step = nice_step((self.high - self.low) / max(count, 1))
        first = math.ceil(self.low / step - 1e-9)
        last = math.floor(self.high / step + 1e-9)
        return [step * number for number in range(first, last + 1)]


def nice_step(least: float) -> float:
    """The smallest of 1, 2, 5, 10 .. times a power of ten that is not below ``least``."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= least * (1.0 - 1e-9))


def tick_label(value: float) -> str:
    """A tick's value, with a true minus sign."""
    return f"{0.0 if abs(value) < 1e-12 else value:g}".replace("-", "−")


class Drawing:
    """An SVG drawing under construction: elements are added, then ``str()`` gives the element.

    Args:
        width, height: in CSS pixels; the page scales it down where it is narrower.
        label: what it shows, for those who cannot see it.
    """

    def __init__(self, width: float, height: float, label: str) -> None:
        self.width, self.height, self.label = width, height, label
        self._parts: list[str] = []

    def __str__(self) -> str:
        head = (
            f'<svg viewBox="0 0 {_px(self.width)} {_px(self.height)}" width="{_px(self.width)}" '
            f'height="{_px(self.height)}" role="img" aria-label="{escape(self.label)}" '
            'xmlns="http://www.w3.org/2000/svg">'
        )
        return f"{head}{''.join(self._parts)}</svg>"

    def text(self, x: float, y: float, words: str, css: str = "", anchor: str = "start") -> None:
        """Words with their baseline at y; ``anchor`` start, middle or end."""
        kind = f' class="{css}"' if css else ""
        place = "" if anchor == "start" else f' text-anchor="{anchor}"'
        self._parts.append(f'<text x="{_px(x)}" y="{_px(y)}"{kind}{place}>{escape(words)}</text>')

    def rect(self, x: float, y: float, width: float, height: float, css: str) -> None:
        """A rectangle."""
        size = f'width="{_px(max(width, 0.0))}" height="{_px(max(height, 0.0))}"'
        self._parts.append(f'<rect x="{_px(x)}" y="{_px(y)}" {size} class="{css}"/>')

    def line(self, x1: float, y1: float, x2: float, y2: float, css: str) -> None:
        """A straight line."""
        ends = f'x1="{_px(x1)}" y1="{_px(y1)}" x2="{_px(x2)}" y2="{_px(y2)}"'
        self._parts.append(f'<line {ends} class="{css}"/>')

    def path(self, x: Array, y: Array, css: str) -> None:
        """A line through points (n,), broken where one is not finite."""
        pieces, pen = [], "M"
        for across, down in zip(x.tolist(), y.tolist(), strict=True):
            if math.isfinite(across) and math.isfinite(down):
                pieces.append(f"{pen}{_px(across)} {_px(down)}")
                pen = "L"
            else:
                pen = "M"
        if pieces:
            self._parts.append(f'<path d="{"".join(pieces)}" class="{css}"/>')

    def image(self, x: float, y: float, width: float, height: float, pixels: NDArray[np.uint8]) -> None:
        """Pixels (rows, columns, 4): red, green, blue and opacity; stretched without smoothing."""
        from PIL import Image

        file = io.BytesIO()
        Image.fromarray(pixels).save(file, "png", optimize=True)
        data = base64.b64encode(file.getvalue()).decode("ascii")
        self._parts.append(
            f'<image x="{_px(x)}" y="{_px(y)}" width="{_px(width)}" height="{_px(height)}" class="pixels" '
            f'preserveAspectRatio="none" href="data:image/png;base64,{data}"/>'
        )

    def x_axis(self, scale: Scale, y: float) -> None:
        """Ticks and their values below a horizontal axis at height y."""
        self.line(scale.start, y, scale.end, y, "axis")
        for value in scale.ticks():
            x = scale.at(value)
            self.line(x, y, x, y + 4, "axis")
            self.text(x, y + 15, tick_label(value), "tick", "middle")

    def y_axis(self, scale: Scale, x: float, ticks: Sequence[float] | None = None) -> None:
        """Ticks and their values left of a vertical axis at x."""
        self.line(x, scale.start, x, scale.end, "axis")
        for value in scale.ticks(3) if ticks is None else ticks:
            y = scale.at(value)
            self.line(x - 4, y, x, y, "axis")
            self.text(x - 7, y + 3.5, tick_label(value), "tick", "end")


def _px(value: float) -> str:
    """A position to a tenth of a pixel."""
    text = f"{value:.1f}".removesuffix(".0")
    return "0" if text == "-0" else text
