"""Causes in a row, and sets of causes between which a recording does not decide, in words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Final

from rig.effects import EFFECTS
from rig.errors import in_a_row

#: A set of causes, each (effect, place); one may be there twice.
Causes = Sequence[tuple[str, str]]
#: What to call an effect at a place.
Name = Callable[[str, str], str]

#: What an explanation may have or be beside causes of the catalogue, in the place of a cause.
OTHER: Final = ("something outside the catalogue", "")
NOTHING: Final = ("nothing beyond the noise floor", "")

_COUNTS: Final = ("no", "one", "two", "three", "four", "five", "six")


def cause_name(effect: str, where: str) -> str:
    """An effect at its place, "backlash of joint5"; an effect that has but one place goes without."""
    alone = not where or (effect in EFFECTS and len(EFFECTS[effect].places) == 1)
    return effect if alone else f"{effect} of {where}"


def and_words(names: Sequence[str]) -> str:
    """Names in a row: "a", "a and b", "a, b and c"; a choice among them ends at a comma: "either a or b, and c"."""
    comma = "," if any(" or " in name for name in names[:-1]) else ""
    return in_a_row(names, f"{comma} and ")


def or_words(names: Sequence[str]) -> str:
    """Names of which one is meant: "a", "a or b", "a, b or c"."""
    return in_a_row(names, " or ")


def sigmas_words(size: float) -> str:
    """How large a shift is, in standard deviations: to a tenth below a hundred, whole numbers above."""
    return f"{abs(size):,.{1 if abs(size) < 99.95 else 0}f}"


def count_words(count: int) -> str:
    """A number as a word, as long as it is small."""
    return _COUNTS[count] if count < len(_COUNTS) else str(count)


def plural(words: str) -> str:
    """Several of an effect: "bias steps", "latencies", "hystereses"."""
    if words.endswith("is"):
        return f"{words[:-2]}es"
    if words.endswith(("ss", "sh", "ch", "x")):
        return f"{words}es"
    if words.endswith("y") and words[-2:-1] not in "aeiou":
        return f"{words[:-1]}ies"
    return words if words.endswith("s") else f"{words}s"


def counted(name: str, count: int) -> str:
    """A cause that is there so many times: "two bias_steps of mag2"."""
    if count == 1:
        return name
    effect, of, place = name.partition(" of ")
    return f"{count_words(count)} {plural(effect)}{of}{place}"


def cause_names(causes: Causes, name: Name = cause_name) -> list[str]:
    """The names of causes, each once, with how many times it is there."""
    return [counted(name(*cause), count) for cause, count in Counter(causes).items()]


def parted(sets: Sequence[Causes]) -> tuple[list[tuple[str, str]], list[list[tuple[str, str]]]]:
    """What all of several sets have, and what each has beside it; of one set alone nothing is shared."""
    shared: Counter[tuple[str, str]] = Counter(sets[0] if len(sets) > 1 else ())
    for one in sets:
        shared &= Counter(one)
    return list(shared.elements()), [list((Counter(one) - shared).elements()) for one in sets]


def choice_words(sets: Sequence[Causes], name: Name = cause_name, chances: Sequence[str] = ()) -> str:
    """The choice between sets: "a or b and c", "a with b or with c", "a alone or with b".

    Args:
        sets: the likeliest first. name: of a cause. chances: the probability of each set, put behind it.
    """
    shared, own = parted(sets)
    always = and_words(cause_names(shared, name))
    parts = []
    for number, causes in enumerate(own):
        words = and_words(cause_names(causes, name))
        if always:
            words = f"with {words}" if words else "alone"
        parts.append(f"{words} ({chances[number]})" if chances else words)
    return " ".join(filter(None, [always, " or ".join(parts)]))
