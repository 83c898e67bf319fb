"""Places at which one effect does the same: only one of them needs to be fitted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimators.gap.hypotheses.prior import Prior
from estimators.gap.hypotheses.scan import ScoreTest


def alike(tests: Sequence[ScoreTest], prior: Prior) -> list[list[ScoreTest]]:
    """Score tests in groups of one effect that does the same at several places, the likeliest place first.

    The first is fitted, and what is said of the group has its size: axes that point against each other differ in sign.
    """
    groups: list[list[ScoreTest]] = []
    of_effect: dict[str, list[list[ScoreTest]]] = {}
    for tested in tests:
        own = of_effect.setdefault(tested.candidate.effect.name, [])
        statistic = tested.score.statistic
        group = next(
            (each for each in own if statistic and np.isclose(each[0].score.statistic, statistic, rtol=1e-7)), None
        )
        if group is None:
            group = []
            own.append(group)
            groups.append(group)
        group.append(tested)
    for group in groups:
        group.sort(key=lambda tested: -prior.weight(tested.candidate.effect.name, tested.candidate.label))
    return groups
