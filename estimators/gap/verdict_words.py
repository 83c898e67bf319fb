"""The sentence of a diagnosis: what it says, and what follows from that."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from estimators.gap.cause_words import causes_words, naming
from estimators.gap.choices import and_words, choice_words, sigmas_words
from estimators.gap.remainder_words import largest_words
from estimators.gap.share_words import chance, elsewhere_words, percent

if TYPE_CHECKING:
    from estimators.gap.diagnosis import Diagnosis, Hypothesis


def told_words(diagnosis: Diagnosis) -> str:
    """What a diagnosis says: its causes, or the explanations between which it does not decide, with probabilities."""
    if diagnosis.verdict == "no-gap":
        return f"what the model leaves is the noise floor (probability {chance(diagnosis.posterior['nothing'])})"
    if diagnosis.verdict == "named":
        return f"{causes_words(diagnosis.leading)}, probability {chance(diagnosis.hypotheses[0].probability)}"
    if diagnosis.verdict == "ambiguous":
        return _choice(diagnosis, diagnosis.alternatives)
    if diagnosis.verdict == "partly":
        found = diagnosis.established
        return f"{causes_words(found)} {'is' if len(found) == 1 else 'are'} established; {_rest(diagnosis)}"
    return _rest(diagnosis)


def _choice(diagnosis: Diagnosis, sets: Sequence[Hypothesis]) -> str:
    """Explanations with their probabilities, and the names of what does the same in a cause's place."""
    name = naming(diagnosis.causes, chances=False)
    return choice_words([one.parts for one in sets], name, [chance(one.probability) for one in sets])


def _rest(diagnosis: Diagnosis) -> str:
    """What a diagnosis says of that which is not named."""
    other = diagnosis.posterior["other"]
    if other >= 0.5:
        acts_like = largest_words(diagnosis.remainder.follows)
        words = f"something outside the catalogue is there (probability {chance(other)})"
        return words + (f": it acts like {acts_like}" if acts_like else "") + _one_of(diagnosis)
    sets = diagnosis.likeliest
    if diagnosis.verdict == "partly":
        return f"what else is there, if anything, is open: {_choice(diagnosis, sets)}"
    if diagnosis.likely is None:
        return f"no explanation stands out: {_choice(diagnosis, sets) or 'none fits'}"
    words = f"{_choice(diagnosis, sets[:1])} is likely, but not certain"
    return words + (f": {_choice(diagnosis, sets[1:])} may be there instead" if sets[1:] else "")


def _one_of(diagnosis: Diagnosis) -> str:
    name = naming(diagnosis.causes)
    named = (and_words([name(*each) for each in one.causes]) for one in diagnosis.at_least_one)
    return "".join(f"; at least one of {names} is there" for names in named)


def consequence_words(diagnosis: Diagnosis) -> str:
    """What follows from what is told: how far that closes, where the gap is, what it shifts; empty without such."""
    if diagnosis.verdict not in ("named", "ambiguous"):
        return ""
    parts = []
    closed = diagnosis.closed
    if closed.value is not None:
        parts.append(f"closes {percent(closed.value, closed.low, closed.high)} of the squared gap")
        if diagnosis.closed_elsewhere is not None:
            parts[-1] += f"; {elsewhere_words(diagnosis.closed_elsewhere)}"
    ratios = {name: channel.gap_before / channel.noise_floor for name, channel in diagnosis.channels.items()}
    worst = sorted(ratios, key=lambda name: -ratios[name])
    most = [name for name in worst[:2] if ratios[name] > 0.5 * ratios[worst[0]]]  # the second, where it is near
    if most:
        parts.append(f"relative to the noise floor, the gap is largest in {' and '.join(most)}")
    if diagnosis.calibration_shift:
        name, shift = max(diagnosis.calibration_shift.items(), key=lambda item: abs(item[1]["sigmas"]))
        if abs(shift["sigmas"]) >= 1.0:
            parts.append(f"not modelled, it shifts {name} by {sigmas_words(shift['sigmas'])} standard deviations")
    if diagnosis.remainder.verdict == "noise":
        parts.append("nothing is left above the noise floor")
    return "; ".join(parts)
