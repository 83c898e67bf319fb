"""What further effects explain beside a discrepancy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estimators.gap.evidence.weighed import Weighed
from estimators.gap.hypotheses.candidates import Candidate
from estimators.gap.hypotheses.scan import Look, Scanner, ScoreTest
from estimators.gap.hypotheses.score import Explained, solve


def scores_beside(
    candidates: Sequence[Candidate], weighed: Weighed, scanner: Scanner, look: Look, explained: Explained
) -> list[tuple[float, ScoreTest]]:
    """The score test of each candidate where a discrepancy leaves it, and what it gains beside that.

    Args:
        look: of samples, or of the means that the discrepancy is of. explained: of the same.
    """
    if not candidates:
        return []
    likeliest = int(np.argmax(weighed.gains))
    shrink = weighed.term.shrunk[0][likeliest]
    of_look = weighed.term.of_every_sample if look is scanner.fine else weighed.term.mean
    taken = of_look(explained.residual, likeliest)
    # where an effect is best seen
    less = replace(explained, residual=explained.residual - explained.without(taken[:, None])[:, 0])
    tests = [
        scanner.scan([each], less, less)[0] if each.effect.tone else _likeliest(look, each, less) for each in candidates
    ]
    columns = [look.columns(tested.candidate, tested.shape) for tested in tests]
    ends = np.cumsum([1, *(own.values.shape[1] for own in columns)]).tolist()
    full = np.zeros((ends[-1], look.data.size)).T
    for own, first, end in zip(columns, ends[:-1], ends[1:], strict=True):
        full[own.rows, first:end] = own.values
    full = explained.without(full)
    full[:, 0] = explained.residual
    along = weighed.term.along(full)
    gram = full.T @ full - (along * shrink[:, None]).T @ along
    length = np.linalg.norm(full, axis=0)
    scored: list[tuple[float, ScoreTest]] = []
    for tested, first, end in zip(tests, ends[:-1], ends[1:], strict=True):
        part = slice(first, end)
        score = solve(gram[part, part], gram[part, 0], length[part])
        scored.append((0.5 * score.evidence - tested.spread, tested))
    return scored


def _likeliest(look: Look, candidate: Candidate, less: Explained) -> ScoreTest:
    """Of the two shapes that lead once the discrepancy is taken out, the one that explains more."""
    return max(look.best(candidate, less)[:2], key=lambda tested: tested.score.statistic)
