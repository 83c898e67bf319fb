"""Sets of causes between which a recording does not decide, in words: what all of them have is said once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

from rig.effects import EFFECTS

#: A set of causes, each (effect, place); one may be there twice.
Causes = Sequence[tuple[str, str]]


def cause_name(effect: str, where: str) -> str:
    """An effect at its place, "backlash of joint5"; an effect that has but one place goes without."""
    return effect if effect in EFFECTS and len(EFFECTS[effect].places) == 1 else f"{effect} of {where}"


def and_words(names: Sequence[str]) -> str:
    """Names in a row: "a", "a and b", "a, b and c"."""
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


def sigmas_words(size: float) -> str:
    """How large a shift is, in standard deviations: to a tenth below a hundred, whole numbers above."""
    return f"{abs(size):,.{1 if abs(size) < 99.95 else 0}f}"


def parted(sets: Sequence[Causes]) -> tuple[list[tuple[str, str]], list[list[tuple[str, str]]]]:
    """What all of several sets have, and what each has beside it; of one set alone nothing is shared."""
    shared: Counter[tuple[str, str]] = Counter(sets[0] if len(sets) > 1 else ())
    for one in sets:
        shared &= Counter(one)
    return list(shared.elements()), [list((Counter(one) - shared).elements()) for one in sets]


def choice_words(
    sets: Sequence[Causes], name: Callable[[str, str], str] = cause_name, chances: Sequence[str] = ()
) -> str:
    """The choice between sets: "a or b and c", "a with b or with c", "a alone or with b".

    Args:
        sets: the likeliest first. name: of a cause. chances: the probability of each set, put behind it.
    """
    shared, own = parted(sets)
    always = and_words([name(*cause) for cause in shared])
    parts = []
    for number, causes in enumerate(own):
        words = and_words([name(*cause) for cause in causes])
        if always:
            words = f"with {words}" if words else "alone"
        parts.append(f"{words} ({chances[number]})" if chances else words)
    return " ".join(filter(None, [always, " or ".join(parts)]))
