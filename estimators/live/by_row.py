"""Arrays that have a row each for the same samples, or blocks of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from rig.arrays import Array, Mask


@dataclass(frozen=True, eq=False)
class ByRow:
    """Rows in the order of time; a class of its own adds further arrays.

    Attributes:
        t: (n,) time of each row [s].
    """

    t: Array

    def __len__(self) -> int:
        """How many rows."""
        return len(self.t)

    def pick(self, rows: slice | Mask) -> Self:
        """Some of them."""
        return replace(self, **{name: values[rows] for name, values in vars(self).items()})

    def then(self, *others: Self) -> Self:
        """These and the ones after them."""
        parts = (self, *others)
        return replace(self, **{name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(self)})
