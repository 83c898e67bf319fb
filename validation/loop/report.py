"""The loop on the terminal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.table import Table

from scenarios.terminal.tables import table
from validation.loop.summary import ENDS, Summary


def loop_table(found: Sequence[Summary]) -> Table:
    """One line for each way to choose the next maneuver."""
    numbers = (*ENDS, "open, then rightly", "minutes a name")
    result = table("next maneuver", *numbers, numbers=numbers)
    for each in found:
        cost = "–" if np.isinf(each.minutes_a_name) else f"{each.minutes_a_name:.0f}"
        then = f"{each.rightly_open.hits:g} of {each.rightly_open.count}"
        result.add_row(each.strategy, *(str(each.ends[name]) for name in ENDS), then, cost)
    return result
