"""Causes of which at least one is there, where what is there could be any of them.

Effects that do nearly the same share the probability that either has: a steel beam at a place where no dipole and no
gradient is quite right may be told by both, each alone in doubt, and yet that one of them is there is not.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from estimators.gap.diagnosis import ESTABLISHED, OneOf

Named = tuple[str, str]

#: So many causes at most: of many, one is there sooner or later.
_MOST: Final = 3
#: A cause that adds less to the probability of the others is none of them.
_ADDS: Final = 0.02


def at_least_one(masses: Mapping[tuple[Named, ...], float]) -> tuple[OneOf, ...]:
    """Groups of causes of which one is established, as few in each as do, the likeliest first.

    Args:
        masses: the probability of each set of causes; they add up to one.
    """
    causes = {cause for causes in masses for cause in causes}
    each = {cause: sum(mass for causes, mass in masses.items() if cause in causes) for cause in causes}
    doubted = sorted((cause for cause in causes if each[cause] < ESTABLISHED), key=lambda one: (-each[one], one))
    found: list[OneOf] = []
    while doubted:
        group = [doubted[0]]
        probability = each[group[0]]
        while probability < ESTABLISHED and len(group) < _MOST:
            without = {causes: mass for causes, mass in masses.items() if not set(group) & set(causes)}
            gains = {one: sum(mass for causes, mass in without.items() if one in causes) for one in doubted}
            best = max(doubted, key=lambda one: gains[one])
            if gains[best] < _ADDS:
                break
            group.append(best)
            probability += gains[best]
        if probability >= ESTABLISHED:
            found.append(OneOf(tuple(group), min(probability, 1.0)))
        doubted = [one for one in doubted if one not in (group if probability >= ESTABLISHED else group[:1])]
    return tuple(found)
