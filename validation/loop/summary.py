"""What the loop comes to: how many rigs end with their cause's name, and after how many minutes of arm time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from rig.arrays import Array
from validation.blind.intervals import Rate
from validation.loop.play import STRATEGIES, Step, Strategy

ENDS: Final = ("rightly", "wrongly", "no maneuver", "given up")


@dataclass(frozen=True)
class Summary:
    """One way to choose the next maneuver.

    Attributes:
        strategy: which. last: the last step of each rig. open: of those rigs that the first recording did not name.
        first_minutes: arm time of each first recording [min].
    """

    strategy: Strategy
    last: tuple[Step, ...]
    open: tuple[Step, ...]
    first_minutes: float

    @property
    def ends(self) -> dict[str, int]:
        """How many rigs end in which way."""
        found = ["wrongly" if each.ended == "named" and not each.right else each.ended for each in self.last]
        return {end: found.count("named" if end == "rightly" else end) for end in ENDS}

    @property
    def rightly(self) -> Rate:
        """Of all rigs."""
        return Rate.of(each.rightly for each in self.last)

    @property
    def rightly_open(self) -> Rate:
        """Of those that the first recording did not name."""
        return Rate.of(each.rightly for each in self.open)

    @property
    def added_maneuvers(self) -> float:
        """Median of the maneuvers after the first, of open rigs that end rightly; NaN of none."""
        return _median([each.step - 1.0 for each in self.open if each.rightly])

    @property
    def added_minutes(self) -> float:
        """Arm time after the first recording, of all open rigs, however they end [min]."""
        return sum(each.minutes - self.first_minutes for each in self.open)

    @property
    def minutes_a_name(self) -> float:
        """Of that time for each open rig that ends rightly [min]; infinite where none does."""
        hits = sum(each.rightly for each in self.open)
        return self.added_minutes / hits if hits else np.inf

    def share(self, minutes: Array) -> Array:
        """(m,) share of all rigs that are named rightly within so many minutes (m,) of arm time."""
        ends = np.array([each.minutes if each.rightly else np.inf for each in self.last])
        return np.asarray((ends[None, :] <= np.asarray(minutes)[:, None] + 1e-9).mean(axis=1))

    def to_json(self) -> dict[str, Any]:
        """A JSON object; what is not known is null."""
        low, high = self.rightly.interval
        return {
            "strategy": self.strategy,
            "rigs": len(self.last),
            "ends": self.ends,
            "rightly": {"value": self.rightly.value, "low": low, "high": high},
            "open": len(self.open),
            "open_rightly": sum(each.rightly for each in self.open),
            "added_maneuvers_median": self.added_maneuvers,
            "added_minutes": self.added_minutes,
            "minutes_a_name": self.minutes_a_name,
        }


def summaries(steps: Sequence[Step]) -> tuple[Summary, ...]:
    """Of each strategy that was played."""
    found = []
    for strategy in STRATEGIES:
        last: dict[int, Step] = {}
        for step in steps:
            if step.strategy == strategy and (step.rig not in last or step.step > last[step.rig].step):
                last[step.rig] = step
        if last:
            every = tuple(last[rig] for rig in sorted(last))
            begun = tuple(each for each in every if not _at_once(each))
            found.append(Summary(strategy, every, begun, min(step.minutes for step in steps)))
    return tuple(found)


def _at_once(last: Step) -> bool:
    """Whether the first recording named a cause, rightly or not."""
    return last.step == 1 and last.ended == "named"


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if values else float("nan")
