"""The diagnosis contract ``rig-diagnosis/1``: where the gap lies, which effect causes it, how far it closes."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

from rig.files import write_text

FORMAT: Final = "rig-diagnosis/1"
Verdict = Literal["no-gap", "named", "ambiguous", "unknown"]


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter: value and standard deviation, a number or one for each component, and its unit.

    A parameter that is a name, such as the source of a crosstalk, is its own value.
    """

    value: float | tuple[float, ...] | str
    std: float | tuple[float, ...] | None
    unit: str


@dataclass(frozen=True)
class Cause:
    """One cause of the gap.

    Attributes:
        effect, where: name and place in the catalogue.
        probability: among the causes that the data cannot split from it.
        equivalent: these causes, each ``effect`` and ``where``.
        parameters: by name.
        p_value: of the cause's test, with the others in place.
        closed: share of the gap that it closes.
    """

    effect: str
    where: str
    probability: float
    equivalent: tuple[Mapping[str, str], ...]
    parameters: Mapping[str, Estimate]
    p_value: float
    closed: float


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
class Diagnosis:
    """A recording's diagnosis.

    Attributes:
        recording, samples, seconds: what was diagnosed, and how long that took.
        verdict: "no-gap", "named", "ambiguous" or "unknown".
        causes: empty for no gap; for "unknown" what could be named.
        channels: by name. follows: shares of the gap by what it follows.
        closed, closed_low, closed_high, closed_on: share of the squared gap that the causes close, its 95 % interval.
        closed_elsewhere: the share of another maneuver's gap that they close there; None without one.
        remainder: "noise" or "structured". remainder_follows: what it follows then.
        calibration_shift: by parameter: before, after, and the difference in standard deviations.
        cannot_tell: effects that this recording cannot show, each with the reason.
        next: the maneuver that would tell more; None where none is needed.
        floor: where the noise floor comes from.
        warnings: in words.
    """

    recording: str
    samples: int
    seconds: float
    verdict: Verdict
    causes: tuple[Cause, ...]
    channels: Mapping[str, Channel]
    follows: tuple[Mapping[str, Any], ...]
    closed: float | None
    closed_low: float | None
    closed_high: float | None
    closed_on: str
    remainder: str
    remainder_follows: tuple[Mapping[str, Any], ...]
    calibration_shift: Mapping[str, Mapping[str, float]]
    cannot_tell: tuple[Mapping[str, str], ...]
    next: Mapping[str, Any] | None
    floor: str
    warnings: tuple[str, ...] = ()
    closed_elsewhere: float | None = None

    def to_json(self) -> Any:
        """The contract's object."""
        return _plain(
            {
                "format": FORMAT,
                "recording": self.recording,
                "samples": self.samples,
                "seconds": round(self.seconds, 3),
                "verdict": self.verdict,
                "causes": [asdict(cause) for cause in self.causes],
                "where": {
                    "channels": {name: asdict(channel) for name, channel in self.channels.items()},
                    "follows": [dict(share) for share in self.follows],
                },
                "closed": {
                    "value": self.closed,
                    "low": self.closed_low,
                    "high": self.closed_high,
                    "on": self.closed_on,
                    "other_maneuver": self.closed_elsewhere,
                },
                "remainder": {"verdict": self.remainder, "follows": [dict(each) for each in self.remainder_follows]},
                "calibration_shift": {name: dict(shift) for name, shift in self.calibration_shift.items()},
                "cannot_tell": [dict(each) for each in self.cannot_tell],
                "next": None if self.next is None else dict(self.next),
                "floor": self.floor,
                "warnings": list(self.warnings),
            }
        )

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the JSON file, whole or not at all.

        Raises:
            RigError: the file cannot be written.
        """
        write_text(path, json.dumps(self.to_json(), indent=1, allow_nan=False) + "\n")

    def __str__(self) -> str:
        return self.sentence()

    def sentence(self) -> str:
        """The verdict in words that a person can act on."""
        if self.verdict == "no-gap":
            return "no gap: what the model leaves is the noise floor"
        named = " and ".join(describe(cause) for cause in self.causes)
        if self.verdict == "unknown":
            follows = ", ".join(str(each["variable"]) for each in self.remainder_follows[:3])
            known = f"{named}, but " if named else ""
            return f"unknown: {known}something outside the catalogue is left" + (
                f"; it follows {follows}" if follows else ""
            )
        return f"{self.verdict}: {named}{self._consequences()}"

    def _consequences(self) -> str:
        parts = []
        if self.closed is not None and self.closed_low is not None and self.closed_high is not None:
            share = percent(self.closed, self.closed_low, self.closed_high)
            parts.append(f"closes {share} of the gap on held-out blocks")
            if self.closed_elsewhere is not None:
                parts[-1] += f" and {percent(self.closed_elsewhere)} on the other maneuver"
        worst = sorted(
            self.channels, key=lambda name: -self.channels[name].gap_before / self.channels[name].noise_floor
        )
        parts.append(f"{' and '.join(worst[:2])} carry most of it")
        if self.calibration_shift:
            name, shift = max(self.calibration_shift.items(), key=lambda item: abs(item[1]["sigmas"]))
            if abs(shift["sigmas"]) >= 1.0:
                parts.append(f"it had shifted {name} by {abs(shift['sigmas']):.0f} sigma")
        if self.remainder == "noise":
            parts.append("nothing left above the floor")
        return ": " + "; ".join(parts)


def describe(cause: Cause) -> str:
    """One cause in words, with what the data cannot split from it."""
    sizes = [text for name, estimate in cause.parameters.items() if (text := _size(name, estimate))]
    text = f"{cause.effect} of {cause.where}" + (f" ({', '.join(sizes[:3])})" if sizes else "")
    if cause.equivalent:
        others = [f"{each['effect']} of {each['where']}" for each in cause.equivalent]
        text += " or " + " or ".join(others)
    return text


def percent(share: float | None, low: float | None = None, high: float | None = None) -> str:
    """A share in percent, to a tenth close to everything, with its interval where that says more: "97 % (95-99)"."""
    value, *ends = (_hundredths(each) for each in (share, low, high))
    return f"{value} %" if "–" in ends or ends == [value, value] else f"{value} % ({ends[0]}-{ends[1]})"


def _hundredths(share: float | None) -> str:
    if share is None or not math.isfinite(share):
        return "–"
    value = 100.0 * share
    return f"{value:.1f}".removesuffix(".0") if 99.0 <= value < 99.95 else f"{value:.0f}"


def _size(name: str, estimate: Estimate) -> str:
    if isinstance(estimate.value, tuple | str) or estimate.std is None or isinstance(estimate.std, tuple):
        return ""
    if estimate.unit == "rad":
        return f"{math.degrees(estimate.value):.3g} +- {math.degrees(estimate.std):.1g} deg"
    return f"{name} {estimate.value:.3g} +- {estimate.std:.1g} {estimate.unit}".rstrip()


def _plain(value: Any) -> Any:
    """JSON has no NaN: what is not known is null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, str | bool | int) or value is None:
        return value
    number = float(value)
    return number if math.isfinite(number) else None
