"""Causes in words: with their sizes, and with what does the same to the recording in their place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from estimators.gap.choices import Name, and_words, cause_name, counted, or_words
from estimators.gap.parameter_words import sizes_words
from estimators.gap.share_words import chance

if TYPE_CHECKING:
    from estimators.gap.diagnosis import Cause

#: Of more that do the same, so many are named in a sentence.
_NAMED: Final = 3


def alike(cause: Cause) -> list[tuple[str, str, float]]:
    """A cause and what does the same in its place: effect, place, and the probability of each by itself."""
    others = [(str(each["effect"]), str(each["where"]), float(each["probability"])) for each in cause.equivalent]
    own = max(cause.probability - sum(probability for *_, probability in others), 0.0)
    return [(cause.effect, cause.where, own), *others]


def either_words(
    cause: Cause, name: Name = cause_name, chances: bool = True, beside: str = "", most: int = _NAMED
) -> str:
    """A cause, or "either a (.50) or b (.50)" where others do the same.

    Args:
        chances: whether each of these has its probability behind it.
        beside: what else stands behind the cause itself.
        most: so many are named.
    """
    every = alike(cause)
    if len(every) == 1:
        return name(cause.effect, cause.where) + (f" ({beside})" if beside else "")
    shown, rest = (every, []) if len(every) <= most + 1 else (every[:most], every[most:])
    words = []
    for index, (effect, where, probability) in enumerate(shown):
        inside = "; ".join(filter(None, (chance(probability) if chances else "", "" if index else beside)))
        words.append(name(effect, where) + (f" ({inside})" if inside else ""))
    if rest:
        behind = f" ({chance(sum(probability for *_, probability in rest))})" if chances else ""
        words.append(f"one of {len(rest)} others{behind}")
    return f"either {or_words(words)}"


def naming(causes: Sequence[Cause], name: Name = cause_name, chances: bool = True) -> Name:
    """What to call a cause where an explanation has it: by its name, or by all names of what does the same.

    Args:
        causes: those that are told of. name: of one by itself. chances: as of ``either_words``.
    """
    told: dict[tuple[str, str], Cause] = {}
    for cause in causes:
        told.setdefault((cause.effect, cause.where), cause)

    def called(effect: str, where: str) -> str:
        cause = told.get((effect, where))
        return name(effect, where) if cause is None else either_words(cause, name, chances)

    return called


def causes_words(causes: Sequence[Cause], name: Name = cause_name) -> str:
    """Causes in a row, each with its sizes; those of one name together: "two bias_steps of mag2 (...; ...)"."""
    groups: dict[tuple[str, str], list[Cause]] = {}
    for cause in causes:
        groups.setdefault((cause.effect, cause.where), []).append(cause)
    words = []
    for (effect, where), group in groups.items():
        if len(group) == 1:
            words.append(either_words(group[0], name, beside=sizes_words(group[0])))
            continue
        sizes = "; ".join(filter(None, map(sizes_words, group)))
        words.append(counted(name(effect, where), len(group)) + (f" ({sizes})" if sizes else ""))
    return and_words(words)
