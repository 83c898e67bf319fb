"""Names, values and shares as a person reads them."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, Final

from estimators.gap.cause_words import alike, causes_words, either_words, naming
from estimators.gap.choices import Causes, and_words, cause_name, cause_names, choice_words, or_words, parted, plural
from estimators.gap.diagnosis import ESTABLISHED, Cause, Closed, Diagnosis, Estimate, Hypothesis
from estimators.gap.parameter_words import pairs, sizes_words, told_parameters
from estimators.gap.readable_units import readable_unit, rms_text, two_digits
from estimators.gap.remainder_words import left_over_words
from estimators.gap.share_words import chance, percent
from estimators.gap.verdict_words import consequence_words, told_words
from rig.effects import EFFECTS
from scenarios.shown_units import shown_units
from scenarios.terminal.tables import plus_minus

#: A parameter of more numbers is not written out.
_MOST_NUMBERS: Final = 6

#: What a unit is written as on paper.
_WRITTEN: Final = (("degC", "°C"), ("m/s^2", "m/s²"), ("m^3", "m³"), ("sqrt(s)", "√s"))

VERDICTS: Final = {
    "no-gap": "No gap",
    "named": "Named",
    "ambiguous": "Ambiguous",
    "partly": "Partly",
    "unknown": "Unknown",
}

#: What each verdict means, for who reads one for the first time.
MEANINGS: Final = {
    "no-gap": "The model with its best calibration leaves noise, and nothing else that could be seen.",
    "named": "One explanation has a probability of .9 or more.",
    "ambiguous": "At most five explanations share a probability of .9; which of them is right is open.",
    "partly": "At least one cause is established, with a probability of .95 or more; what else is there is open.",
    "unknown": "No explanation by known causes is likely enough to be named.",
}

#: The three answers between which the probability is divided.
ANSWERS: Final = {
    "nothing": "nothing beyond the noise floor",
    "known": "known causes alone",
    "other": "something outside the catalogue",
}
#: What the share of a cause is.
ITS_SHARE: Final = "what comes back of the squared gap where it alone is taken out again"
#: Of what the data do not feel: a maneuver that would show it was not made.
NOT_FELT: Final = "not felt"
#: Of a frequency: a faster one looks the same at this sampling rate.
SAMPLED: Final = " as sampled"
#: So many explanations are listed, on the terminal and on the page; the file has more.
_LISTED: Final = 5
#: A calibration parameter that moved by fewer standard deviations is not worth a line.
WORTH_SIGMAS: Final = 0.5
#: From this probability on something outside the catalogue is not negligible.
_NOT_NEGLIGIBLE: Final = 0.1
_EFFECT: Final = re.compile("|".join(rf"\b{name}\b" for effect in EFFECTS for name in (effect, plural(effect))))


def place_words(where: str) -> str:
    """A place as words: ``joint5`` is "joint 5"."""
    return re.sub(r"\b(joint|link)(\d+)\b", r"\1 \2", where)


def cause_title(effect: str, where: str) -> str:
    """An effect at its place, "backlash of joint 5"; an effect that has but one place goes without."""
    return cause_name(effect, place_words(where)).replace(effect, effect.replace("_", " "), 1)


def formula(effect: str) -> str:
    """The first paragraph of the effect's description, and what its frequency means where it is a tone."""
    paragraph = (inspect.getdoc(EFFECTS[effect]) or "").split("\n\n")[0] if effect in EFFECTS else ""
    tone = " A frequency as sampled: the true one may differ from it, or from minus it, by any multiple of the rate."
    return paragraph.replace("\n", " ").replace("``", "") + (tone if effect in EFFECTS and EFFECTS[effect].tone else "")


def estimate_words(estimate: Estimate) -> str:
    """A parameter in its own unit, with its standard deviation where it has one; what the data do not feel says so."""
    if isinstance(estimate.value, str):
        return estimate.value
    if not _felt(estimate):
        return NOT_FELT
    unit = "" if estimate.unit in ("relative", "name") else _written(estimate.unit)
    return _numbers(estimate, 1.0, unit) + (SAMPLED if estimate.unit == "Hz" else "")


def estimate_for_people(estimate: Estimate) -> str:
    """The same in degrees, percent, milli- or microvolts; empty where there is nothing to convert."""
    if isinstance(estimate.value, str) or not _felt(estimate):
        return ""
    sizes = [abs(each) for pair in pairs(estimate) for each in pair if each is not None and math.isfinite(each)]
    factor, unit = readable_unit(estimate.unit, max(sizes))
    return "" if factor == 1.0 else _numbers(estimate, factor, _written(unit), brief=True)


def parameter_for_people(cause: Cause, name: str) -> str:
    """The same of a cause's parameter; of a direction nobody thinks in per cent."""
    declared = EFFECTS[cause.effect].parameters() if cause.effect in EFFECTS else ()
    direction = any(item.name == name and item.unit_vector for item in declared)
    return "" if direction else estimate_for_people(told_parameters(cause)[name])


def _written(unit: str) -> str:
    """A unit as on paper."""
    for own, written in _WRITTEN:
        unit = unit.replace(own, written)
    return unit


def _felt(estimate: Estimate) -> bool:
    """Whether the data feel any component."""
    values = estimate.value if isinstance(estimate.value, tuple) else (estimate.value,)
    return any(value is not None for value in values)


def _numbers(estimate: Estimate, factor: float, unit: str, brief: bool = False) -> str:
    """The numbers times a factor, in a unit; of many how large they are.

    Args:
        brief: whether how many these are was said.
    """
    sizes = [
        (None if value is None else factor * value, None if std is None else factor * std)
        for value, std in pairs(estimate)
    ]
    if len(sizes) > _MOST_NUMBERS:
        known = [value for value, _ in sizes if value is not None]
        rms = math.sqrt(sum(value**2 for value in known) / len(known))
        size, lacking = f"RMS {rms:.3g} {unit}".rstrip(), len(sizes) - len(known)
        if brief:
            return size
        return f"{len(sizes)} numbers, {size}" + (f", {lacking} of them {NOT_FELT}" if lacking else "")
    numbers = [NOT_FELT if value is None else _number(value, std).replace("-", "−") for value, std in sizes]
    return (numbers[0] if len(numbers) == 1 else f"({', '.join(numbers)})") + (f" {unit}" if unit else "")


def _number(value: float, std: float | None) -> str:
    known = std is not None and math.isfinite(std) and std > 0.0
    return plus_minus(value, std) if known else f"{value:.4g}"


def cause_words(cause: Cause) -> str:
    """A cause in one phrase: effect, place and its sizes."""
    sizes = sizes_words(cause)
    return on_paper(cause_title(cause.effect, cause.where) + (f", {sizes}" if sizes else ""))


def cause_or_alike(cause: Cause) -> str:
    """The same where nothing else does the same; otherwise which of several it is, each with its probability."""
    if not cause.equivalent:
        return cause_words(cause)
    return on_paper(either_words(cause, cause_title, beside=sizes_words(cause)))


def alike_title(cause: Cause) -> str:
    """A cause's name without sizes, with the names and probabilities of all that does the same."""
    return either_words(cause, cause_title, most=len(cause.equivalent) + 1)


def status_words(cause: Cause, diagnosis: Diagnosis) -> str:
    """How sure one may be of a cause, and whether the likeliest explanation has it."""
    sure = "established" if cause.probability >= ESTABLISHED else "likely" if cause.probability >= 0.5 else "possible"
    if cause.equivalent:
        sure += ", as one of these"
    return sure if cause in diagnosis.leading else f"{sure}, not in the likeliest explanation"


def alike_words(cause: Cause) -> str:
    """What does the same as a cause to this recording, each with its probability."""
    return or_words([f"{cause_title(*name)} ({chance(probability)})" for *name, probability in alike(cause)[1:]])


def apart_words(one: Causes, other: Causes) -> tuple[str, str]:
    """Two sets of causes without what they share; whole where one has nothing else."""
    _, own = parted((one, other))
    first, second = (and_words(cause_names(each, cause_title)) for each in (own if all(own) else (one, other)))
    return first, second


def explanation_words(hypothesis: Hypothesis, causes: Sequence[Cause] = ()) -> str:
    """An explanation in words; ``causes``: those that are told of, of which some have others that do the same."""
    return and_words(cause_names(hypothesis.parts, naming(causes, cause_title)))


def one_of_words(diagnosis: Diagnosis) -> list[str]:
    """Of which causes one at least is there, each a sentence without its stop."""
    name = naming(diagnosis.causes, cause_title)
    return [
        f"at least one of {and_words([name(*cause) for cause in one.causes])} is there, probability "
        f"{chance(one.probability)}"
        for one in diagnosis.at_least_one
    ]


def explanation_rows(diagnosis: Diagnosis) -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    """The likeliest explanations with their probabilities; and the row of all others together, where there are any."""
    shown, rest = diagnosis.hypotheses[:_LISTED], diagnosis.hypotheses[_LISTED:]
    left = diagnosis.omitted + sum(one.probability for one in rest)
    rows = [(explanation_words(one, diagnosis.causes), chance(one.probability)) for one in shown]
    return rows, [] if left < 0.0005 else [("all other explanations together", chance(left))]


def posterior_words(diagnosis: Diagnosis) -> str:
    """The three answers with their probabilities."""
    return ", ".join(f"{words} {chance(diagnosis.posterior[name])}" for name, words in ANSWERS.items())


def hidden_words(diagnosis: Diagnosis) -> str:
    """What could be there and not be seen; empty where that is not known."""
    size = diagnosis.remainder.could_hide_snr
    if size is None:
        return ""
    together = "" if len(diagnosis.recordings) == 1 else "s together"
    return (
        "A further gap could still hide in the noise: of the errors of one joint, mount, field, clock or channel, the "
        "hardest to see is missed more often than once in twenty with a signal-to-noise ratio of up to "
        f"{two_digits(size)} over the whole recording{together}: for an error of one channel all along, about "
        f"{two_digits(size / math.sqrt(max(diagnosis.samples, 1)))} of its noise."
    )


def readable(words: str) -> str:
    """Words in which effects have their names in the catalogue and places theirs, as a person reads them."""
    return place_words(_EFFECT.sub(lambda found: found[0].replace("_", " "), words))


def left_words(diagnosis: Diagnosis) -> str:
    """What is left over acts like: errors, one of which is meant, and noise beside it, each with its share."""
    return readable(left_over_words(diagnosis.remainder.follows))


def noise_words(diagnosis: Diagnosis) -> str:
    """What is left where that is noise: for certain only where nothing outside the catalogue may be there."""
    sure = diagnosis.posterior["other"] < _NOT_NEGLIGIBLE
    return "noise" if sure else "noise, if the likeliest explanation holds"


def worth_shifts(diagnosis: Diagnosis) -> tuple[list[tuple[str, Any]], str]:
    """The calibration parameters that moved enough to speak of, the largest shift first; in words, where none did."""
    shifts = sorted(diagnosis.calibration_shift.items(), key=lambda item: -abs(item[1]["sigmas"]))
    shown = [item for item in shifts if abs(item[1]["sigmas"]) >= WORTH_SIGMAS]
    none = f"nothing: all {len(shifts)} parameters stay within {WORTH_SIGMAS:g} standard deviations"
    return shown, none if shifts and not shown else ""


def part_words(share: float | None) -> str:
    """A share without its interval, with a true minus sign where the gap has grown; beyond twice, that it has."""
    return percent(share).replace("-", "−") + (" or less" if share is not None and share <= -1.0 else "")


def share_words(closed: Closed) -> str:
    """How far a gap closes, with the share's interval: "97 % (95–99)"; a dash where nothing is to close."""
    if closed.value is None:
        return "–"
    words = percent(closed.value, closed.low, closed.high)
    return re.sub(r"(?<=\d)-", "–", words).replace("-", "−")


def sentence(diagnosis: Diagnosis) -> str:
    """The diagnosis' own sentence without the verdict's name before it, as a sentence on paper."""
    words = ": ".join(filter(None, (told_words(diagnosis), consequence_words(diagnosis))))
    return as_sentence(on_paper(f"no gap: {words}" if diagnosis.verdict == "no-gap" else words))


def consequences(diagnosis: Diagnosis) -> str:
    """What follows from what the headline says; the whole sentence where nothing does."""
    words = consequence_words(diagnosis)
    return as_sentence(on_paper(words)) if words else sentence(diagnosis)


def on_paper(words: str) -> str:
    """Words of a diagnosis with a printed text's signs and units, and with names as a person reads them."""
    words = re.sub(r"\(([\d.]+)-([\d.]+)\)", r"(\1–\2)", words.replace("+-", "±"))
    return readable(_written(re.sub(r"(?<=[( ])-(?=\d)", "−", words)))


#: The figures of a fitted rig, channel by channel, and what they are called.
RIG_COLUMNS: Final = {
    "noise_floor": "floor",
    "rms_ideal": "RMS, ideal rig",
    "gap_ideal": "gap, ideal rig",
    "rms_fitted": "RMS, fitted rig",
    "gap_fitted": "gap, fitted rig",
}


def rig_rows(rig: Mapping[str, Any], units: Mapping[str, str], samples: int) -> list[tuple[str, ...]]:
    """Channel, ``RIG_COLUMNS`` and unit of each channel.

    Args:
        rig: of a diagnosis of so many samples.
        units: sensor -> recorded unit.
    """
    shown = shown_units(units)
    return [
        (
            name,
            *(rms_text(row[key], row["noise_floor"], samples, shown[name].factor) for key in RIG_COLUMNS),
            shown[name].name,
        )
        for name, row in rig["channels"].items()
    ]


def rig_words(diagnosis: Diagnosis) -> list[str]:
    """What a recording says of a fitted rig: whether it is better, why, and how much of the gap it leaves."""
    if diagnosis.rig is None:
        return []
    found = diagnosis.rig
    better = "better than the ideal rig" if found["better"] else "not called better than the ideal rig"
    words = [f"{found['name']} is {better}: {found['why']}."]
    if found["left"] is not None:
        words.append(
            f"It leaves {percent(found['left'])} of the squared gap."
            if found["left"] <= 1.0
            else f"With it the squared gap is {two_digits(found['left'])} times as large."
        )
    return words


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in a few words."""
    if diagnosis.verdict == "no-gap":
        return "No gap: the model leaves noise"
    if diagnosis.verdict == "named":
        return capital(_found(diagnosis.leading))
    if diagnosis.verdict == "ambiguous":
        name = naming(diagnosis.causes, cause_title, chances=False)
        return capital(choice_words([one.causes for one in diagnosis.alternatives], name))
    other = diagnosis.posterior["other"] >= 0.5
    if diagnosis.verdict == "partly":
        rest = ANSWERS["other"] if other else "perhaps more"
        return capital(f"{_found(diagnosis.established)}, and {rest}")
    if not other and diagnosis.likely is not None:
        return capital(f"{explanation_words(diagnosis.likely, diagnosis.causes)} is likely, but not certain")
    return capital(ANSWERS["other"]) if other else "No explanation stands out"


def _found(causes: Sequence[Cause]) -> str:
    """Causes with their sizes: of one alone these follow it, of several they stand in brackets."""
    return cause_or_alike(causes[0]) if len(causes) == 1 else on_paper(causes_words(causes, cause_title))


def capital(words: str) -> str:
    """Words that begin a sentence or a title."""
    return words[:1].upper() + words[1:]


def as_sentence(words: str) -> str:
    """Words as a sentence, with its stop."""
    return capital(words) + ("" if words.endswith(".") else ".")
