"""The diagnosis contract ``rig-diagnosis/2``: what explains a gap, with what probability, where, how far it closes."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Final, Literal

from estimators.gap.choices import NOTHING, OTHER
from estimators.gap.verdict_words import consequence_words, told_words
from rig.documents import plain
from rig.errors import in_short
from rig.files import write_text

if TYPE_CHECKING:
    from estimators.calibration import Calibration

FORMAT: Final = "rig-diagnosis/2"
Verdict = Literal["no-gap", "named", "ambiguous", "partly", "unknown"]
Number = float | None


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter: value and standard deviation, a number or one for each component, and its unit.

    A parameter that is a name, such as the source of a crosstalk, is its own value. A component that the data do not
    feel is None, and ``why`` says so; ``fitted`` then has the numbers that stood there in the fit, to which the others
    belong: with them the cause does again what was found.
    """

    value: Number | tuple[Number, ...] | str
    std: Number | tuple[Number, ...]
    unit: str
    why: str | None = None
    fitted: Number | tuple[Number, ...] = None


@dataclass(frozen=True)
class Closed:
    """A share of the squared gap, with its 95 % interval; None where nothing is to close."""

    value: Number
    low: Number
    high: Number


@dataclass(frozen=True)
class Cause:
    """One cause of the gap.

    Attributes:
        effect, where: name and place in the catalogue.
        probability: of all explanations that hold it or one of its equivalents.
        equivalent: causes that do the same to this recording, each ``effect``, ``where`` and ``probability``.
        parameters: by name; widths over all explanations that hold the cause.
        closed: share of the squared gap that comes back where it alone is taken out again, of every kind of cause.
        recording: of several, the one in which alone it acts, or in which it begins; None: all of them.
        evidence: of several, by name: by how much each one's log likelihood falls where it is taken out again.
    """

    effect: str
    where: str
    probability: float
    equivalent: tuple[Mapping[str, Any], ...]
    parameters: Mapping[str, Estimate]
    closed: Closed
    recording: str | None = None
    evidence: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Hypothesis:
    """One explanation: its causes, each (effect, place), whether something outside the catalogue is part of it, and its
    posterior probability."""

    causes: tuple[tuple[str, str], ...]
    other: bool
    probability: float

    @property
    def parts(self) -> tuple[tuple[str, str], ...]:
        """Its causes and something outside the catalogue, if that is part of it; or that there is nothing."""
        return (*self.causes, *([OTHER] if self.other else [])) or (NOTHING,)


@dataclass(frozen=True)
class OneOf:
    """Causes of which at least one is there, while none is established by itself: each (effect, place), the likeliest
    first, and the probability that the explanation holds one of them."""

    causes: tuple[tuple[str, str], ...]
    probability: float


@dataclass(frozen=True)
class Channel:
    """One channel's gap [recorded unit]; None where it has none to state."""

    noise_floor: float
    rms_before: float
    gap_before: float
    rms_after: float
    gap_after: float
    closed: float | None


@dataclass(frozen=True)
class Remainder:
    """What the causes leave.

    Attributes:
        verdict: "noise" or "structured".
        follows: what it follows then: ``source``, ``course`` and ``share`` of the gap.
        could_hide_snr: the largest gap of an error source along a course that would have escaped with a chance above
            5 %, as signal-to-noise.
    """

    verdict: str
    follows: tuple[Mapping[str, Any], ...]
    could_hide_snr: float | None


@dataclass(frozen=True)
class Diagnosis:
    """A recording's diagnosis.

    Attributes:
        recordings, samples, seconds: what was diagnosed, and how long that took.
        verdict: "no-gap", "named", "ambiguous", "partly" or "unknown"; from the probabilities alone.
        posterior: of "nothing" beyond the floor, "known" causes alone, and something "other" with or without causes.
        omitted: the probability of the explanations that are not listed.
        hypotheses: the explanations, the likeliest first.
        at_least_one: causes of which one at least is established, while none of them is by itself.
        causes: those of the likeliest explanation and those that are likely, the likeliest first; empty for no gap.
        channels: by name; over all recordings. by_recording: of several, by its name, each one's own.
        follows: shares of the gap by what it follows.
        closed: share of the squared gap that the causes close. closed_on: what that was judged on.
        closed_elsewhere: the share of another maneuver's gap that they close there, below zero where they make it
            larger; None without one.
        rig: against a fitted rig, of whose remainder all the rest then tells: its ``name`` and ``effects``, whether it
            is ``better`` than the ideal rig and ``why``, the share that is ``left``, ``remainder_p_value`` of that
            against the floor, and the gaps by channel.
        calibration: the corrected one, a file of its own; None where it was not asked for.
        remainder: what is left.
        calibration_shift: by parameter: before, after, and the difference in standard deviations.
        cannot_tell: effects that this recording cannot show, each with the reason.
        next: the maneuver that would tell more; None where none is needed.
        floor: where the noise floor comes from.
        warnings: in words.
    """

    recordings: tuple[str, ...]
    samples: int
    seconds: float
    verdict: Verdict
    posterior: Mapping[str, float]
    omitted: float
    hypotheses: tuple[Hypothesis, ...]
    causes: tuple[Cause, ...]
    channels: Mapping[str, Channel]
    follows: tuple[Mapping[str, Any], ...]
    closed: Closed
    closed_on: str
    remainder: Remainder
    calibration_shift: Mapping[str, Mapping[str, float]]
    cannot_tell: tuple[Mapping[str, str], ...]
    next: Mapping[str, Any] | None
    floor: str
    warnings: tuple[str, ...] = ()
    closed_elsewhere: float | None = None
    names: Mapping[str, str] = field(default_factory=dict)
    rig: Mapping[str, Any] | None = None
    calibration: Calibration | None = field(default=None, repr=False, compare=False)
    by_recording: Mapping[str, Mapping[str, Channel]] = field(default_factory=dict)
    at_least_one: tuple[OneOf, ...] = ()

    @property
    def recording(self) -> str:
        """The name of what was diagnosed."""
        return in_short(self.recordings)

    @property
    def name(self) -> str:
        """Of its files."""
        return self.recordings[0] if len(self.recordings) == 1 else "together"

    @property
    def leading(self) -> tuple[Cause, ...]:
        """The causes of the likeliest explanation: those that are put into a simulator."""
        left = list(self.hypotheses[0].causes) if self.hypotheses else []
        found = []
        for cause in self.causes:
            if (name := (cause.effect, cause.where)) in left:
                left.remove(name)
                found.append(cause)
        return tuple(found)

    @property
    def established(self) -> tuple[Cause, ...]:
        """The causes of which one may speak as found."""
        return tuple(cause for cause in self.causes if cause.probability >= ESTABLISHED)

    @property
    def alternatives(self) -> tuple[Hypothesis, ...]:
        """Explanations by known causes alone, the likeliest first: as many as it takes to name one of them."""
        return _to_name_one([one for one in self.hypotheses if one.causes and not one.other])

    @property
    def likeliest(self) -> tuple[Hypothesis, ...]:
        """Explanations of every kind, the likeliest first: as many as together would be named, five at most."""
        return _to_name_one(sorted(self.hypotheses, key=lambda each: -each.probability)[:MOST_TOLD])

    @property
    def likely(self) -> Hypothesis | None:
        """The explanation by known causes that is likelier than all others together; None where there is none."""
        known = [one for one in self.likeliest[:1] if one.causes and not one.other and one.probability >= 0.5]
        return known[0] if known else None

    def to_json(self) -> dict[str, Any]:
        """The contract's object."""
        document: dict[str, Any] = plain(
            {
                "format": FORMAT,
                "recordings": list(self.recordings),
                "samples": self.samples,
                "seconds": round(self.seconds, 3),
                "verdict": self.verdict,
                "posterior": dict(self.posterior),
                "omitted": self.omitted,
                "hypotheses": [
                    {
                        "causes": [list(each) for each in one.causes],
                        "other": one.other,
                        "probability": one.probability,
                    }
                    for one in self.hypotheses
                ],
                "at_least_one": [
                    {"causes": [list(each) for each in one.causes], "probability": one.probability}
                    for one in self.at_least_one
                ],
                "causes": [self._cause(cause) for cause in self.causes],
                "where": {
                    "channels": {
                        recording: {name: asdict(channel) for name, channel in own.items()}
                        for recording, own in self.by_recording.items()
                    }
                    or {name: asdict(channel) for name, channel in self.channels.items()},
                    "follows": [dict(share) for share in self.follows],
                },
                "closed": {**asdict(self.closed), "on": self.closed_on, "other_maneuver": self.closed_elsewhere},
                "remainder": asdict(self.remainder),
                "calibration_shift": {name: dict(shift) for name, shift in self.calibration_shift.items()},
                "cannot_tell": [dict(each) for each in self.cannot_tell],
                "next": None if self.next is None else dict(self.next),
                "floor": self.floor,
                "warnings": list(self.warnings),
                **({} if self.rig is None else {"rig": self.rig}),
            }
        )
        return document

    def _cause(self, cause: Cause) -> dict[str, Any]:
        found = asdict(cause)
        for estimate in found["parameters"].values():
            for name in ("why", "fitted"):
                if estimate[name] is None:
                    del estimate[name]
        for key in ("recording", "evidence"):
            if not found[key]:
                del found[key]
        if cause.where in self.names:
            found["name"] = self.names[cause.where]
        return found

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the JSON file, whole or not at all.

        Raises:
            RigError: the file cannot be written.
        """
        write_text(path, self.to_text())

    def to_text(self) -> str:
        """The contract's text."""
        return json.dumps(self.to_json(), indent=1, allow_nan=False) + "\n"

    def __str__(self) -> str:
        return self.sentence()

    def sentence(self) -> str:
        """The verdict in words that a person can act on."""
        return ": ".join(filter(None, (self.verdict.replace("-", " "), told_words(self), consequence_words(self))))


#: How warnings begin that speak of how the diagnosis was made, and not against the recordings.
ESTIMATED_FLOOR: Final = "the noise floor is estimated from the recording itself"
GIVEN_WEIGHTS: Final = "the probabilities rest on given weights of effects"
TONE_AT_REST: Final = "the recording at rest has a tone"
UNSURE_FLOOR: Final = "the locked recording tells the noise roughly only"
NOT_CORRECTED: Final = "no corrected calibration"
INFORMATIVE: Final = (ESTIMATED_FLOOR, GIVEN_WEIGHTS, TONE_AT_REST, UNSURE_FLOOR, NOT_CORRECTED)
#: Probabilities from which on an explanation is named, a cause is established, and there is no gap.
NAMED: Final = 0.9
ESTABLISHED: Final = 0.95
NO_GAP: Final = 0.5
#: So many explanations at most are told of in a sentence, and share the probability of an ambiguous verdict.
MOST_TOLD: Final = 5


def _to_name_one(explanations: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
    """As many, from the first on, as it takes to name one of them."""
    found: list[Hypothesis] = []
    for one in explanations:
        if sum(each.probability for each in found) < NAMED:
            found.append(one)
    return tuple(found)


def verdict_of(posterior: Mapping[str, float], hypotheses: Sequence[Hypothesis], causes: Sequence[Cause]) -> Verdict:
    """The first verdict that holds: no-gap, named, ambiguous, partly, unknown."""
    if posterior["nothing"] >= NO_GAP:
        return "no-gap"
    sets = [one.probability for one in hypotheses if one.causes and not one.other]
    if sets and sets[0] >= NAMED:
        return "named"
    if sum(sets[:MOST_TOLD]) >= NAMED:
        return "ambiguous"
    return "partly" if any(cause.probability >= ESTABLISHED for cause in causes) else "unknown"
