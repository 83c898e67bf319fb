"""The strata of the blind check: how many cases of which kind, at which strength, on which floor, and where."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Final

import numpy as np

from rig.effects import EFFECTS, Kind, Stage
from rig.errors import RigError
from validation.blind.draws import ABSORBED, places_on_sweep
from validation.blind.forms import FORMS
from validation.blind.laboratories import LABORATORIES
from validation.blind.mechanics import MECHANISMS
from validation.blind.outside import JOINTED, OUTSIDE
from validation.blind.settings import FloorKind

#: Projected, whitened signal-to-noise of what is there to be seen.
STRENGTHS: Final = (5.0, 10.0, 30.0, 100.0)
#: Effects on noise and on single readings are asked for from here on.
STRONG_ENOUGH: Final = 30.0

#: Share of the cases, in per cent, mechanics aside; and what the stratum holds.
STRATA: Final = {
    "none": (25, "no effect"),
    "absorbed": (4, "an effect that the calibration takes up on this sweep"),
    "one": (23, "one effect of the catalogue"),
    "one axis": (4, "a fault of one axis of a sensor"),
    "two": (6, "two effects of the catalogue"),
    "two places": (4, "the same effect at two places"),
    "one joint": (4, "two effects on one joint"),
    "strong and weak": (4, "a strong effect beside a weak one"),
    "several": (5, "three or four effects"),
    "form": (8, "a family of the catalogue in another functional form"),
    "outside": (9, "an effect that is in no catalogue"),
    "known and outside": (4, "an effect of the catalogue beside one that is in none"),
}
MECHANICS: Final = "mechanics"
WITHHELD: Final = "withheld"
#: On one joint of the sweep any two of these are too much alike to make a case.
_ALIKE: Final = {"joint_compliance", "joint_eccentricity", "joint_offset"}
#: What the further strata hold, which are not drawn.
FURTHER: Final = {
    MECHANICS: "a mechanism in MuJoCo, stepped",
    WITHHELD: "one effect, its name taken out of the catalogue",
}
#: One case of each stratum, and a quarter without any effect.
FEWEST: Final = 16
#: Strata whose cases may lie in any laboratory; the others need the sweep.
ANYWHERE: Final = ("none", "one", "one axis", "two", "several", "outside")

_COLOURED_EVERY: Final = 3  # one in so many floors remembers
_FLOORS: Final[tuple[FloorKind, ...]] = ("coloured", "slow flicker", "coloured", "long tails", "flicker", "walk")
_ELSEWHERE_EVERY: Final = 3  # one in so many cases lies in another laboratory
_STRONG_AND_WEAK: Final = (100.0, 10.0)
_TONES: Final = ("vibration", "mains_hum")


@dataclass(frozen=True)
class Plan:
    """What one case is to hold.

    Attributes:
        stratum: one of ``STRATA``, or "mechanics".
        names: of the effects; their meaning depends on the stratum.
        strengths: wanted signal-to-noise of each.
        floor: of the noise at rest. laboratory: where it is recorded.
    """

    stratum: str
    names: tuple[str, ...]
    strengths: tuple[float, ...]
    floor: FloorKind
    laboratory: str = "sweep"


def plans(cases: int, rng: np.random.Generator, mechanics: int = 0) -> list[Plan]:
    """The plans of a set, in random order, so that a case's number tells nothing.

    Args:
        cases: beside those of mechanics.
        mechanics: cases of mechanics; they take tens of seconds each.

    Raises:
        RigError: fewer than one case a stratum and a quarter without effect, or a negative number.
    """
    if cases < FEWEST or mechanics < 0:
        raise RigError(
            f"blind check: found {cases} cases and {mechanics} of mechanics, expected at least {FEWEST} and 0"
        )
    found: list[Plan] = []
    for stratum, count in _counts(cases).items():
        laboratories = _laboratories(stratum, count, rng)
        deck = _deck(stratum, laboratories, rng)
        for index, (names, laboratory) in enumerate(zip(deck, laboratories, strict=True)):
            strengths = tuple(_strength(name, stratum, index, rng) for name in names)
            if stratum == "strong and weak":
                strengths = _STRONG_AND_WEAK
            floor = "white" if laboratory in ("long", "no rest") else _floor(index)
            found.append(Plan(stratum, names, strengths, floor, laboratory))
    order = list(rng.permutation(list(MECHANISMS)))
    for index in range(mechanics):
        strength = float(rng.choice([30.0, 100.0]))
        found.append(Plan(MECHANICS, (str(order[index % len(order)]),), (strength,), "white"))
    return [found[index] for index in rng.permutation(len(found))]


def usable(name: str, laboratory: str) -> bool:
    """Whether an effect of the catalogue can be seen in a laboratory, and its strength be chosen there."""
    effect, logs_poses = EFFECTS[name], LABORATORIES[laboratory].pose == "tool"
    if effect.acts_at_zero:  # its strength is the maneuver's speed
        return laboratory == "sweep"
    if effect.of_log or not logs_poses:
        return effect.of_log == logs_poses
    return "joints" not in effect.requires and name != "vibration"  # which may be fixed in a link


def _counts(cases: int) -> dict[str, int]:
    """Rounded so that the sum is right and no effect at all is never under a quarter."""
    counts = {name: max(1, round(cases * share / 100.0)) for name, (share, _) in STRATA.items()}
    counts["none"] = max(counts["none"], -(-cases // 4))
    for name in sorted(counts, key=lambda each: -counts[each])[1:]:  # the largest strata give or take the rest
        counts[name] = max(1, counts[name] + cases - sum(counts.values()))
        if sum(counts.values()) == cases:
            break
    return counts


def _laboratories(stratum: str, count: int, rng: np.random.Generator) -> list[str]:
    others = [name for name in LABORATORIES if name != "sweep"]
    dealt: list[str] = []
    while len(dealt) < count:
        dealt += [str(name) for name in rng.permutation(others)]
    elsewhere = iter(dealt)
    apart = stratum in ANYWHERE
    return [
        next(elsewhere) if apart and index % _ELSEWHERE_EVERY == _ELSEWHERE_EVERY - 1 else "sweep"
        for index in range(count)
    ]


def _deck(stratum: str, laboratories: list[str], rng: np.random.Generator) -> list[tuple[str, ...]]:
    """Names by dealing: every effect comes up before one comes up again, where the laboratory has it."""
    count = len(laboratories)
    if stratum == "none":
        return [()] * count
    if stratum in ("two", "several", "strong and weak"):
        return [_some(stratum, laboratory, index, rng) for index, laboratory in enumerate(laboratories)]
    if stratum == "two places":
        names = [name for name in _moving("sweep") if len(places_on_sweep(EFFECTS[name])) > 1]
        return [(name, name) for name in (str(each) for each in rng.permutation(names * count)[:count])]
    if stratum == "one joint":
        names = [name for name in _moving("sweep") if EFFECTS[name].stage is Stage.TRANSMISSION]
        pairs = [pair for pair in itertools.permutations(names, 2) if not set(pair) <= _ALIKE]
        return [pairs[int(index)] for index in rng.integers(len(pairs), size=count)]
    if stratum == "known and outside":
        known, outside = _moving("sweep"), list(OUTSIDE)
        return [(str(rng.choice(known)), str(rng.choice(outside))) for _ in range(count)]
    source = {
        "absorbed": [str(index) for index in range(len(ABSORBED))],
        "one": list(EFFECTS),
        "one axis": one_axis(),
        "form": list(FORMS),
        "outside": list(OUTSIDE),
    }[stratum]
    waiting: list[str] = []
    dealt: list[tuple[str, ...]] = []
    for laboratory in laboratories:
        fits = [name for name in waiting if _fits(name, stratum, laboratory)]
        if not fits:
            waiting += [str(name) for name in rng.permutation(source)]
            fits = [name for name in waiting if _fits(name, stratum, laboratory)]
        waiting.remove(fits[0])
        dealt.append((fits[0],))
    return dealt


def one_axis() -> list[str]:
    """The effects with a strength for each axis of a sensor."""
    found = []
    for name, effect in EFFECTS.items():
        sensors = effect.places[:1] == ("accelerometer",)
        if (
            sensors
            and any(item.strength and item.size == 3 for item in effect.parameters())
            and not effect.acts_at_zero
        ):
            found.append(name)
    return found


def _fits(name: str, stratum: str, laboratory: str) -> bool:
    if stratum == "outside":
        return LABORATORIES[laboratory].pose == "joints" or name not in JOINTED
    return stratum in ("absorbed", "form") or usable(name, laboratory)


def _moving(laboratory: str) -> list[str]:
    return [name for name, effect in EFFECTS.items() if effect.kind is Kind.MEAN and usable(name, laboratory)]


def _some(stratum: str, laboratory: str, index: int, rng: np.random.Generator) -> tuple[str, ...]:
    many = 3 + index % 2 if stratum == "several" else 2
    names = _moving(laboratory)
    while True:
        chosen = tuple(str(name) for name in rng.choice(names, many, replace=False))
        if sum(name in _TONES for name in chosen) < 2:
            return chosen


def _floor(index: int) -> FloorKind:
    if index % _COLOURED_EVERY:
        return "white"
    return _FLOORS[index // _COLOURED_EVERY % len(_FLOORS)]


def _strength(name: str, stratum: str, index: int, rng: np.random.Generator) -> float:
    if stratum == "absorbed":
        return 0.0
    choices: tuple[float, ...] = STRENGTHS if stratum in ("one", "one axis", "outside") else STRENGTHS[1:]
    noisy = name == "flicker" or (name in EFFECTS and EFFECTS[name].kind is not Kind.MEAN)
    if noisy:
        choices = tuple(each for each in choices if each >= STRONG_ENOUGH)
    return float(choices[(index + int(rng.integers(len(choices)))) % len(choices)])
