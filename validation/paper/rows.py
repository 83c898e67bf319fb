"""One row of a published table beside what the rig gives."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, Self

from rig.arrays import Array
from validation.markdown import table_of

Word = Literal["agrees", "differs", "cannot be told", "is the rig's truth"]

#: What a verdict rests on. "tested": the published row could have come out otherwise than the rig predicts it. "by
#: construction": it went into the rig (its truth, or its noise), so that the rig gives it back. "arithmetic": it is
#: held against other published rows alone.
Basis = Literal["tested", "by construction", "arithmetic"]

#: A difference of more standard deviations than this is none of chance: among the 150 rows of both papers one in
#: fourteen such comparisons would find one by accident.
SIGMAS: Final = 3.5


@dataclass(frozen=True)
class Row:
    """A published number, or a direction, and the rig's.

    Attributes:
        paper, table: "renk" or "camps" and the table's number.
        item: which axis, pair or sensor. quantity, unit: what.
        published: as printed.
        rig, rig_std: what the rig gives under the same conditions, and how far one experiment scatters about it; NaN
            where it has no such number.
        sigmas: the difference in standard deviations; NaN where rounding or a ratio decides.
        word, why: the verdict. basis: what it rests on.
    """

    paper: str
    table: str
    item: str
    quantity: str
    unit: str
    published: str
    rig: float
    rig_std: float
    sigmas: float
    word: Word
    basis: Basis
    why: str = ""

    @classmethod
    def of_draws(
        cls, place: Sequence[str], published: str, own: Array, sigmas: float, word: Word, basis: Basis, why: str
    ) -> Self:
        """With mean and scatter of the rig's experiments (m,); ``place`` is paper, table, item, quantity and unit."""
        paper, table, item, quantity, unit = place
        mean, std = float(own.mean()), float(own.std())
        return cls(paper, table, item, quantity, unit, published, mean, std, sigmas, word, basis, why)

    @property
    def verdict(self) -> str:
        """The verdict with its reason."""
        return f"{self.word}: {self.why}" if self.why else self.word


@dataclass(frozen=True)
class Statement:
    """What a paper says about its numbers, held against them.

    Attributes:
        paper, about: which, and of what tables or figures.
        says: what it says, in our words. finds: what its own numbers, or the rig, give. holds: whether it does.
    """

    paper: str
    about: str
    says: str
    finds: str
    holds: bool


def number(value: float, std: float) -> str:
    """A number to the second digit of its standard deviation, with it."""
    if not math.isfinite(value):
        return "–"
    if not (math.isfinite(std) and std > 0.0):
        return f"{value:.6g}"
    decimals = min(max(1 - math.floor(math.log10(std)), 0), 12)
    return f"{value:.{decimals}f} ± {std:.{decimals}f}"


_SYMBOLS: Final = {
    "beta": "β",
    "gamma": "γ",
    "sensitivity": "S",
    "offset": "δ",
    "phi": "φ",
    "psi": "ψ",
    "phi, psi": "φ, ψ",
    "angle between": "angle",
    "three tests": "",
}


def published_rows(rows: Sequence[Row]) -> str:
    """Rows of one published table beside the rig."""
    return table_of(
        ("", "unit", "published", "the rig", "rests on", "verdict"),
        [
            (
                f"{_SYMBOLS.get(row.quantity, row.quantity)} {row.item}".strip(),
                row.unit,
                row.published,
                number(row.rig, row.rig_std),
                row.basis,
                row.verdict,
            )
            for row in rows
        ],
    )
