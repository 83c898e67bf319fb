"""Names, values and shares as a person reads them."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Mapping, Sequence
from typing import Final

from estimators.gap.diagnosis import Cause, Diagnosis, Estimate, percent
from rig.effects import EFFECTS
from scenarios.report import plus_minus, shortened

#: Below this a p-value is the floating-point floor of the test, not a statement.
_SMALLEST_P: Final = 1e-300

#: A parameter of more numbers is not written out.
_MOST_NUMBERS: Final = 6

#: A unit as it is written elsewhere -> what to multiply with, and the unit that people think in.
_PEOPLE: Final = {"rad": (180.0 / math.pi, "deg"), "relative": (100.0, "%"), "V": (1e3, "mV")}

VERDICTS: Final = {
    "no-gap": "No gap",
    "named": "Named",
    "ambiguous": "Ambiguous",
    "unknown": "Unknown",
}


def place_words(where: str) -> str:
    """A place as words: ``joint5`` is "joint 5"."""
    return re.sub(r"^(joint|link)(\d)$", r"\1 \2", where)


def cause_title(effect: str, where: str) -> str:
    """An effect at its place, "backlash of joint 5"; an effect that has but one place goes without."""
    words = effect.replace("_", " ")
    return words if effect in EFFECTS and len(EFFECTS[effect].places) == 1 else f"{words} of {place_words(where)}"


def formula(effect: str) -> str:
    """The first paragraph of the effect's description."""
    paragraph = (inspect.getdoc(EFFECTS[effect]) or "").split("\n\n")[0] if effect in EFFECTS else ""
    return paragraph.replace("\n", " ")


def estimate_words(estimate: Estimate) -> str:
    """A parameter in its own unit, with its standard deviation where it has one."""
    if isinstance(estimate.value, str):
        return estimate.value
    unit = "" if estimate.unit in ("relative", "name") else f" {estimate.unit}"
    return _numbers(estimate, 1.0) + unit


def estimate_for_people(estimate: Estimate) -> str:
    """The same in degrees, percent or millivolts; empty where there is nothing to convert."""
    if isinstance(estimate.value, str) or estimate.unit not in _PEOPLE:
        return ""
    factor, unit = _PEOPLE[estimate.unit]
    return f"{_numbers(estimate, factor)} {unit}"


def _numbers(estimate: Estimate, factor: float) -> str:
    pairs = [(factor * value, None if std is None else factor * std) for value, std in _pairs(estimate)]
    if len(pairs) > _MOST_NUMBERS:
        rms = math.sqrt(sum(value**2 for value, _ in pairs) / len(pairs))
        return f"{len(pairs)} numbers, RMS {rms:.3g}"
    numbers = [_number(*pair).replace("-", "−") for pair in pairs]
    return numbers[0] if len(numbers) == 1 else f"({', '.join(numbers)})"


def _pairs(estimate: Estimate) -> list[tuple[float, float | None]]:
    values = estimate.value if isinstance(estimate.value, tuple) else (estimate.value,)
    stds: tuple[float | None, ...] = estimate.std if isinstance(estimate.std, tuple) else (estimate.std,) * len(values)
    return [(float(value), std) for value, std in zip(values, stds, strict=True)]


def _number(value: float, std: float | None) -> str:
    known = std is not None and math.isfinite(std) and std > 0.0
    return plus_minus(value, std) if known else f"{value:.4g}"


def cause_words(cause: Cause) -> str:
    """A cause in one phrase: place, effect and its strengths."""
    sizes = [
        estimate_for_people(value) or estimate_words(value)
        for value in cause.parameters.values()
        if value.std is not None and not isinstance(value.value, tuple)
    ]
    return cause_title(cause.effect, cause.where) + (f", {', '.join(sizes[:2])}" if sizes else "")


def p_words(p_value: float) -> str:
    """A p-value."""
    return "< 1e-300" if p_value <= _SMALLEST_P else f"{p_value:.2g}"


def closed_words(diagnosis: Diagnosis) -> str:
    """How far the gap closes, with its interval: "97 % (95–99)"."""
    if diagnosis.closed is None:
        return "–"
    return percent(diagnosis.closed, diagnosis.closed_low, diagnosis.closed_high).replace("-", "–")


def sentence(diagnosis: Diagnosis) -> str:
    """The diagnosis' own sentence without the verdict's name before it, as a sentence on paper."""
    words = str(diagnosis.sentence()).removeprefix(f"{diagnosis.verdict}: ")
    words = words.replace("+-", "±").replace(" deg", "°")
    return _as_sentence(re.sub(r"\b(joint|link)(\d)\b", r"\1 \2", words))


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in a few words."""
    if diagnosis.verdict == "no-gap":
        return sentence(diagnosis)
    causes = " and ".join(cause_words(cause) + _rivals(cause) for cause in diagnosis.causes)
    if diagnosis.verdict == "unknown":
        if diagnosis.remainder == "noise":  # several causes where one would do
            return "Something that the catalogue does not have; only several effects together would imitate it"
        return "Something that the catalogue does not have" + (f", beside {causes}" if causes else "")
    return causes[:1].upper() + causes[1:]


def _rivals(cause: Cause) -> str:
    """What the data cannot split from a cause: by name where it is one, by number where they are several."""
    if not cause.equivalent:
        return ""
    if len(cause.equivalent) > 1:
        return f" (or one of {len(cause.equivalent)} that the data cannot split from it)"
    return f" (or {cause_title(cause.equivalent[0]['effect'], cause.equivalent[0]['where'])})"


def consequences(diagnosis: Diagnosis) -> str:
    """What the diagnosis' sentence says after the causes; all of it where that is not set apart."""
    if diagnosis.verdict == "no-gap":
        return ""
    words = sentence(diagnosis)
    _, apart, rest = words.partition(": ")
    return _as_sentence(rest) if apart else words


def _as_sentence(words: str) -> str:
    return words[:1].upper() + words[1:] + ("" if words.endswith(".") else ".")


def grouped_untold(untold: Sequence[Mapping[str, str]]) -> dict[str, list[str]]:
    """What the recording cannot tell, by the reason: effects each with their places."""
    found: dict[str, dict[str, list[str]]] = {}
    for each in untold:
        places = found.setdefault(each["why"], {}).setdefault(each["effect"], [])
        if each["where"] not in places:
            places.append(each["where"])
    return {
        why: [f"{effect} ({shortened(places)})" for effect, places in effects.items()] for why, effects in found.items()
    }
