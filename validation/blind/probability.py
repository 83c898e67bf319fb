"""How much of an answer's probability lies on the truth: proper scores of a posterior over hypotheses."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from rig.errors import RigError
from validation.blind.truth import Label, Truth

FORMAT: Final = "rig-diagnosis/2"

#: The least probability that is told: a hypothesis below it is not listed.
LEAST: Final = 0.005
#: Of the reliability diagram.
BINS: Final = 10


@dataclass(frozen=True)
class Proper:
    """The proper scores of one answer.

    Attributes:
        mass: posterior probability of the hypotheses that are the truth, up to declared equivalents. Its mean over
            cases is the fraction of the posterior on the truth (FIA).
        log: -log of that mass, which counts as ``LEAST`` where it is less [nats].
        brier: (1 - mass)^2.
    """

    mass: float
    log: float
    brier: float


@dataclass(frozen=True)
class Claim:
    """Something that an answer says with a probability, and whether it is so."""

    probability: float
    true: bool
    kind: str  #: "nothing", "other", or the effect of a cause


def check_answer(answer: Mapping[str, Any], where: str) -> None:
    """Refuse an answer of another format.

    Raises:
        RigError: it is not a diagnosis with a posterior.
    """
    if answer.get("format") != FORMAT:
        raise RigError(f"{where}: found format {answer.get('format')!r}, expected {FORMAT!r}: solve the set anew")
    if answer.get("verdict") in ("refused", "failed"):
        return
    posterior = answer.get("posterior")
    complete = isinstance(posterior, Mapping) and {"nothing", "known", "other"} <= set(posterior)
    if not complete or not isinstance(answer.get("hypotheses"), list) or not isinstance(answer.get("causes"), list):
        raise RigError(f"{where}: expected posterior (nothing, known, other), hypotheses and causes")


def proper(truth: Truth, answer: Mapping[str, Any], withheld: str = "") -> Proper:
    """The scores of an answer; of none (refused, failed) the worst.

    Args:
        withheld: an effect that the diagnosis did not have: only its twins, or "other", are right then.
    """
    mass = min(max(_mass(truth, answer, withheld), 0.0), 1.0)
    return Proper(mass, -float(np.log(max(mass, LEAST))), (1.0 - mass) ** 2)


def claims(truth: Truth, answer: Mapping[str, Any]) -> Iterator[Claim]:
    """All that an answer says with a probability, but about another form of an effect: that is both known and other."""
    if "posterior" not in answer:
        return
    posterior = answer["posterior"]
    yield Claim(float(posterior["nothing"]), not truth.visible, "nothing")
    if truth.stratum != "form":
        unnamed = any(not each.right for each in truth.visible)
        yield Claim(float(posterior["other"]), unnamed, "other")
    there = set().union(*(each.likely for each in truth.causes)) if truth.causes else set()
    for cause in answer["causes"]:
        if cause.get("probability") is not None:
            names = {(cause["effect"], cause["where"]), *_equivalents(cause)}
            yield Claim(float(cause["probability"]), bool(names & there), cause["effect"])


def calibration_error(found: Iterable[Claim]) -> float:
    """Mean distance between what was said and how often it was so, over bins of equal width, by their claims."""
    rows = reliability(found)
    total = sum(count for _, _, count in rows)
    return sum(count * abs(said - share) for said, share, count in rows) / total if total else float("nan")


def reliability(found: Iterable[Claim]) -> list[tuple[float, float, int]]:
    """Of each bin that holds claims: the mean probability, the share that is so, and their number."""
    listed = list(found)
    said = np.array([each.probability for each in listed])
    true = np.array([each.true for each in listed], dtype=float)
    bins = np.minimum((said * BINS).astype(int), BINS - 1)
    return [
        (float(said[bins == index].mean()), float(true[bins == index].mean()), int((bins == index).sum()))
        for index in range(BINS)
        if (bins == index).any()
    ]


def _mass(truth: Truth, answer: Mapping[str, Any], withheld: str) -> float:
    if "posterior" not in answer:
        return 0.0
    known = [_names(each.right, withheld) for each in truth.visible]
    named = [names for names in known if names]
    weak = set().union(*(each.right for each in truth.causes)) if truth.causes else set()
    equivalent = {(cause["effect"], cause["where"]): set(_equivalents(cause)) for cause in answer["causes"]}
    unnamed = len(named) < len(known)
    posterior = answer["posterior"]
    if withheld or (unnamed and not named):  # nothing but what no catalogue has, or whose name was taken out
        mass = float(posterior["other"])
        return mass + (_listed(answer, named, weak, equivalent, False) if named else 0.0)
    mass = _listed(answer, named, weak, equivalent, unnamed)
    if not truth.visible:
        mass += float(posterior["nothing"]) - _nothing(answer)
    if truth.stratum == "form":  # its family, or something else: both are honest
        mass += float(posterior["other"])
    return mass


def _listed(
    answer: Mapping[str, Any],
    wanted: list[set[Label]],
    weak: set[Label],
    equivalent: dict[Label, set[Label]],
    other: bool,
) -> float:
    """The mass of the hypotheses that hold each of the wanted once, and nothing else but what is there and weak."""
    total = 0.0
    for hypothesis in answer["hypotheses"]:
        labels = [(effect, where) for effect, where in hypothesis["causes"]]
        if bool(hypothesis["other"]) is other and _is(labels, wanted, weak, equivalent):
            total += float(hypothesis["probability"])
    return total


def _is(labels: list[Label], wanted: list[set[Label]], weak: set[Label], equivalent: dict[Label, set[Label]]) -> bool:
    names = [{label} | equivalent.get(label, set()) for label in labels]
    if len(names) < len(wanted):
        return False
    left = set(range(len(names)))
    if wanted:
        fits = np.array([[bool(each & want) for each in names] for want in wanted])
        rows, columns = linear_sum_assignment(~fits)
        if not fits[rows, columns].all():
            return False
        left -= {int(column) for column in columns}
    return all(names[index] & weak for index in left)


def _nothing(answer: Mapping[str, Any]) -> float:
    """The mass of the empty hypothesis as it is listed: ``posterior`` has it even where it is not."""
    return sum(float(each["probability"]) for each in answer["hypotheses"] if not each["causes"] and not each["other"])


def _names(names: set[Label], withheld: str) -> set[Label]:
    return {label for label in names if label[0] != withheld}


def _equivalents(cause: Mapping[str, Any]) -> list[Label]:
    return [(each["effect"], each["where"]) for each in cause.get("equivalent", ())]
