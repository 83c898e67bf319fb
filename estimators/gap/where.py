"""Where the gap lies: what it follows, on data that did not choose it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.gap.bench import Bench, project
from estimators.gap.remainder import families
from estimators.gap.score import Explained

Array = NDArray[np.float64]

_BLOCKS = 8


@dataclass(frozen=True)
class Share:
    """How much of the gap a family of regressors predicts on held-out blocks.

    Attributes:
        variable: what they follow.
        share: of the whitened squared gap, 0 to 1.
    """

    variable: str
    share: float


def shares(bench: Bench, explained: Explained, gap: float) -> list[Share]:
    """Shares by what the residual follows, largest first; they overlap.

    Each family is fitted on every other block and judged on the blocks between, both ways round: sum of 2 r m - m m,
    over the whole gap.

    Args:
        bench: base fit.
        explained: residual of the base fit, whitened.
        gap: whitened squared gap.
    """
    count = bench.count
    halves = (np.arange(count) * _BLOCKS // count) % 2
    totals: dict[str, float] = {}
    for index, column in enumerate(bench.columns):
        rows = slice(index * count, (index + 1) * count)
        residual, basis = explained.residual[rows], explained.basis[rows]
        for name, regressors in families(bench, column).items():
            columns = project(basis, bench.whiten_channel(column, regressors))
            for half in (0, 1):
                train, test = halves != half, halves == half
                gram = columns[train].T @ columns[train]
                gram += 1e-6 * np.trace(gram) / len(gram) * np.eye(len(gram))
                fitted = columns[test] @ np.linalg.solve(gram, columns[train].T @ residual[train])
                totals[name] = totals.get(name, 0.0) + float(2.0 * residual[test] @ fitted - fitted @ fitted)
    found = [Share(name, float(np.clip(value / gap, 0.0, 1.0))) for name, value in totals.items()]
    return sorted(found, key=lambda share: -share.share)
