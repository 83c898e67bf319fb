"""In which order the samples of a maneuver are taken, as their number grows."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np
from scipy.stats.qmc import Halton

from rig.arrays import Rows
from rig.errors import unknown_name

Order = Literal["first", "every-kth", "random"]
ORDERS: Final[tuple[Order, ...]] = ("first", "every-kth", "random")


def order_of(order: Order, count: int, rng: np.random.Generator) -> Rows:
    """Row numbers (count,), each once: the first n of them are the n samples that are taken.

    Args:
        order: "first": as recorded, so that n samples are the maneuver's beginning (Renk et al., Figures 3 and 4).
            "every-kth": samples spread evenly over the whole maneuver. They are nested: every 64th, say, then those in
            the middle between, and so on, so that n = count / 2^m samples are exactly every (2^m)th (van der Corput).
            "random": without replacement.
        count: number of samples.
        rng: of "random".

    Raises:
        RigError: another order.
    """
    if order == "first":
        return np.arange(count)
    if order == "every-kth":
        return np.argsort(Halton(1, scramble=False).random(count).ravel())
    if order == "random":
        return rng.permutation(count)
    raise unknown_name("order", order, ORDERS)
