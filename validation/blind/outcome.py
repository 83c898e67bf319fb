"""One answer beside the truth: what was right about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from rig.channels import CHANNELS_OF
from validation.blind.truth import Label, TrueCause, Truth

CONFIDENT: Final = ("named", "ambiguous")
#: A cause of this probability is established, whatever the verdict.
SURE: Final = 0.95

#: An effect that contains another: who names it has seen less than there is, but nothing that is not there. At the same
#: sensor, or at a channel of it, or anywhere for effects of the whole board.
CONTAINS: Final = {
    "bias_warmup": ("bias_random_walk", "supply_ratiometric"),
    "bias_temperature": ("bias_random_walk", "supply_ratiometric"),
    "bias_step": ("bias_random_walk", "supply_ratiometric"),
    "bias_random_walk": ("noise_coloured", "supply_ratiometric"),
    "noise_coloured": ("bias_random_walk", "noise_excess"),
    "noise_excess": ("noise_coloured",),
    "timing_jitter": ("noise_excess",),
    "adc_quantisation": ("noise_excess",),
    "outliers": ("noise_excess",),
    "dropouts": ("noise_excess", "timing_jitter"),
    "joint_offset": ("joint_eccentricity",),
    "joint_compliance": ("joint_eccentricity",),
    "vibration": ("noise_excess", "noise_coloured"),
    "mains_hum": ("noise_excess", "noise_coloured"),
}


@dataclass(frozen=True)
class Named:
    """One cause of an answer: its first name, and all of its names."""

    first: Label
    names: frozenset[Label]
    probability: float = 1.0

    @classmethod
    def of(cls, cause: Mapping[str, Any]) -> Named:
        """From a diagnosis."""
        first = (cause["effect"], cause["where"])
        names = frozenset([first, *((each["effect"], each["where"]) for each in cause["equivalent"])])
        return cls(first, names, float(cause.get("probability", 1.0)))


@dataclass(frozen=True)
class Outcome:
    """What an answer got right; rates are means of these over cases.

    Attributes:
        verdict: as answered.
        detected: something was found.
        first: the first name of the first cause is right.
        place: its place is.
        in_set: every visible true cause is in the set of one of the answer's causes.
        credit: for the names: one over the size of the set that holds the truth, the mean over the true causes.
        confidently_wrong: named or ambiguous, or a cause at ``SURE`` or more, that holds nothing of the truth.
        unknown: the verdict is unknown.
        members: mean size of the sets.
    """

    verdict: str
    detected: float
    first: float
    place: float
    in_set: float
    credit: float
    confidently_wrong: float
    unknown: float
    members: float


def judge(truth: Truth, answer: Mapping[str, Any], withheld: str = "") -> Outcome:
    """An answer beside the truth.

    Args:
        withheld: an effect that the diagnosis did not have: its name is no longer a right one, its twins are.
    """
    causes = [Named.of(cause) for cause in answer["causes"]]
    visible = truth.visible
    right = [_right(cause, withheld) for cause in visible]
    found = [[named for named in causes if named.names & names] for names in right]
    credit = [max((1.0 / len(each.names) for each in holding), default=0.0) for holding in found]
    first = causes[0].first if causes else None
    everything = set().union(*right) if right else set()
    tolerated = set().union(*(_tolerated(cause) for cause in truth.causes)) if truth.causes else set()
    stray = [named for named in causes if not any(_acceptable(label, everything | tolerated) for label in named.names)]
    return Outcome(
        verdict=answer["verdict"],
        detected=float(answer["verdict"] != "no-gap"),
        first=float(first in everything),
        place=float(first is not None and first[1] in {where for _, where in everything}),
        in_set=float(bool(visible) and all(found)),
        credit=sum(credit) / len(credit) if credit else 0.0,
        confidently_wrong=float(any(_sure(named, answer["verdict"]) for named in stray)),
        unknown=float(answer["verdict"] == "unknown"),
        members=sum(len(named.names) for named in causes) / len(causes) if causes else 0.0,
    )


def _sure(named: Named, verdict: str) -> bool:
    """Whether a cause is said with confidence; of an ambiguous answer every one that is likelier than not."""
    return named.probability >= (0.5 if verdict in CONFIDENT else SURE)


def _right(cause: TrueCause, withheld: str) -> set[Label]:
    return {label for label in cause.right if label[0] != withheld}


def _tolerated(cause: TrueCause) -> set[Label]:
    """Names that are not confidently wrong: the truth itself where it is weak, the alike, and what contains it."""
    found = cause.likely
    for effect, where in cause.right:
        found |= {(wider, where) for wider in CONTAINS.get(effect, ())}
    return found


def _acceptable(label: Label, names: set[Label]) -> bool:
    effect, where = label
    if label in names:
        return True
    return any(effect == name and _overlap(where, place) and effect in _SENSOR_WIDE for name, place in names)


_BOARD: Final = ("acquisition", "supply")
_SENSOR_WIDE: Final = frozenset(each for wider in CONTAINS.values() for each in wider)


def _overlap(one: str, other: str) -> bool:
    """A channel lies in its sensor, and everything electronic in the board."""
    if one in _BOARD or other in _BOARD or one == other:
        return True
    return one in CHANNELS_OF.get(other, ()) or other in CHANNELS_OF.get(one, ())
