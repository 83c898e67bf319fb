"""One palette for every picture, of colours that colour-blind readers tell apart.

Source: M. Okabe and K. Ito, "Color Universal Design" (2008).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

BLACK: Final = "#000000"
ORANGE: Final = "#E69F00"
SKY_BLUE: Final = "#56B4E9"
GREEN: Final = "#009E73"
YELLOW: Final = "#F0E442"
BLUE: Final = "#0072B2"
VERMILLION: Final = "#D55E00"
PURPLE: Final = "#CC79A7"
GREY: Final = "#8C8C8C"

#: Time gone by, from first to last: ever lighter.
ELAPSED: Final = (BLUE, SKY_BLUE, "#A8D08D", YELLOW)

#: Axes 1, 2, 3 of a sensor: on a dark ground (the viewer) and on paper.
AXES_ON_DARK: Final = (SKY_BLUE, ORANGE, GREEN)
AXES_ON_PAPER: Final = (BLUE, VERMILLION, GREEN)

#: The orders in which a study takes samples.
ORDERS: Final = {"first": VERMILLION, "every-kth": BLUE, "random": GREEN}

#: Signed values, from below zero to above.
SIGNED: Final = (BLUE, SKY_BLUE, "#F2F2F2", ORANGE, VERMILLION)

#: What is within expectation, behind lines.
BAND: Final = "#E4E7EB"

#: What the fields are drawn in.
GRAVITY: Final = YELLOW
MAGNETIC: Final = PURPLE

Bytes = NDArray[np.uint8]


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255, of ``"#RRGGBB"``."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def ramp(values: ArrayLike, stops: tuple[str, ...]) -> Bytes:
    """Colours (n, 3) of values (n,) in [0, 1], linear between equally spaced stops; values beyond are clipped."""
    table = np.array([rgb(stop) for stop in stops], dtype=float)
    at = np.clip(np.asarray(values, dtype=float), 0.0, 1.0) * (len(table) - 1)
    columns = [np.interp(at, np.arange(len(table)), table[:, column]) for column in range(3)]
    return np.asarray(np.rint(np.stack(columns, axis=-1)), dtype=np.uint8)


def signed(values: ArrayLike, limit: float) -> Bytes:
    """Colours (n, 3) of signed values (n,): blue at -limit, pale at zero, vermillion at +limit."""
    return ramp(np.asarray(values, dtype=float) / (2.0 * limit) + 0.5, SIGNED)


def elapsed(share: ArrayLike) -> Bytes:
    """Colours (n, 3) of the share (n,) of a recording gone by: blue through green to yellow."""
    return ramp(share, ELAPSED)
