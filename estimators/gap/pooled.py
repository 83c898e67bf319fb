"""The gaps of several recordings' channels, as one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from estimators.gap.diagnosis import Channel


def pooled(each: Sequence[Mapping[str, Channel]], counts: Sequence[int] | None = None) -> Mapping[str, Channel]:
    """Root mean squares over recordings with so many samples; all alike where that is not known."""
    if len(each) == 1:
        return each[0]
    counts = [1] * len(each) if counts is None else counts
    found = {}
    for name in dict.fromkeys(name for one in each for name in one):
        there = [(one[name], count) for one, count in zip(each, counts, strict=True) if name in one]
        total = sum(count for _, count in there)
        keys = ("noise_floor", "rms_before", "gap_before", "rms_after", "gap_after")
        own = {key: math.sqrt(sum(count * getattr(one, key) ** 2 for one, count in there) / total) for key in keys}
        told = any(one.closed is not None for one, _ in there) and own["gap_before"] > 0.0
        closed = max(-1.0, 1.0 - (own["gap_after"] / own["gap_before"]) ** 2) if told else None
        found[name] = Channel(**own, closed=closed)
    return found
