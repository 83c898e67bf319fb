"""The strata of the blind check: how many cases of which kind, at which strength, on which floor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from rig.effects import EFFECTS, Kind
from rig.errors import RigError
from scenarios.blind.draws import ABSORBED
from scenarios.blind.forms import FORMS
from scenarios.blind.mechanics import MECHANISMS
from scenarios.blind.outside import OUTSIDE
from scenarios.blind.settings import FloorKind

#: Projected, whitened signal-to-noise of what is there to be seen.
STRENGTHS: Final = (5.0, 10.0, 30.0, 100.0)
#: Effects on noise and on single readings are asked for from here on.
STRONG_ENOUGH: Final = 30.0

#: Share of the cases, in per cent, mechanics aside; and what the stratum holds.
STRATA: Final = {
    "none": (26, "no effect"),
    "absorbed": (6, "an effect that the calibration takes up on this sweep"),
    "one": (30, "one effect of the catalogue"),
    "two": (12, "two effects of the catalogue"),
    "form": (12, "a family of the catalogue in another functional form"),
    "outside": (14, "an effect that is in no catalogue"),
}
MECHANICS: Final = "mechanics"
WITHHELD: Final = "withheld"
#: What the further strata hold, which are not drawn.
FURTHER: Final = {
    MECHANICS: "a mechanism in MuJoCo, stepped",
    WITHHELD: "one effect, its name taken out of the catalogue",
}

_COLOURED_EVERY: Final = 3  # one in so many floors remembers
_FLICKER_EVERY: Final = 4  # of these, one in so many is nearly 1/f


@dataclass(frozen=True)
class Plan:
    """What one case is to hold.

    Attributes:
        stratum: one of ``STRATA``, or "mechanics".
        names: of the effects; their meaning depends on the stratum.
        strengths: wanted signal-to-noise of each.
        floor: of the noise at rest.
    """

    stratum: str
    names: tuple[str, ...]
    strengths: tuple[float, ...]
    floor: FloorKind


def plans(cases: int, rng: np.random.Generator, mechanics: int = 0) -> list[Plan]:
    """The plans of a set, in random order, so that a case's number tells nothing.

    Args:
        cases: beside those of mechanics.
        mechanics: cases of mechanics; they take tens of seconds each.

    Raises:
        RigError: fewer than ten cases, or a negative number.
    """
    if cases < 10 or mechanics < 0:
        raise RigError(f"blind check: found {cases} cases and {mechanics} of mechanics, expected at least 10 and 0")
    found = []
    for stratum, count in _counts(cases).items():
        deck = _deck(stratum, count, rng)
        for index, names in enumerate(deck):
            strengths = tuple(_strength(name, stratum, index, rng) for name in names)
            found.append(Plan(stratum, names, strengths, _floor(index)))
    order = list(rng.permutation(list(MECHANISMS)))
    for index in range(mechanics):
        strength = float(rng.choice([30.0, 100.0]))
        found.append(Plan(MECHANICS, (str(order[index % len(order)]),), (strength,), "white"))
    return [found[index] for index in rng.permutation(len(found))]


def _counts(cases: int) -> dict[str, int]:
    """Rounded so that the sum is right and no effect at all is never under a quarter."""
    counts = {name: max(1, round(cases * share / 100.0)) for name, (share, _) in STRATA.items()}
    counts["one"] += cases - sum(counts.values())
    return counts


def _deck(stratum: str, count: int, rng: np.random.Generator) -> list[tuple[str, ...]]:
    """Names by dealing: every effect comes up before one comes up again."""
    if stratum == "none":
        return [()] * count
    if stratum == "two":
        names = [
            name
            for name, effect in EFFECTS.items()
            if effect.kind is Kind.MEAN and not effect.acts_at_zero and not effect.of_log
        ]
        return [tuple(str(name) for name in rng.choice(names, 2, replace=False)) for _ in range(count)]
    source = {
        "absorbed": [str(index) for index in range(len(ABSORBED))],
        "one": [name for name, effect in EFFECTS.items() if not effect.of_log],
        "form": list(FORMS),
        "outside": list(OUTSIDE),
    }[stratum]
    dealt: list[tuple[str, ...]] = []
    while len(dealt) < count:
        dealt += [(str(name),) for name in rng.permutation(source)]
    return dealt[:count]


def _floor(index: int) -> FloorKind:
    if index % _COLOURED_EVERY:
        return "white"
    return "flicker" if index // _COLOURED_EVERY % _FLICKER_EVERY == _FLICKER_EVERY - 1 else "coloured"


def _strength(name: str, stratum: str, index: int, rng: np.random.Generator) -> float:
    if stratum == "absorbed":
        return 0.0
    choices: tuple[float, ...] = STRENGTHS if stratum in ("one", "outside") else STRENGTHS[1:]
    noisy = name == "flicker" or (name in EFFECTS and EFFECTS[name].kind is not Kind.MEAN)
    if noisy:
        choices = tuple(each for each in choices if each >= STRONG_ENOUGH)
    return float(choices[(index + int(rng.integers(len(choices)))) % len(choices)])
