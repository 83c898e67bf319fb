"""What is left over in words: which error of the rig it acts like, and what that error changes with."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from estimators.gap.choices import and_words, cause_name
from estimators.gap.hypotheses.sources import STRENGTH
from estimators.gap.share_words import percent

#: How the name of a noise that is left over begins, and what else its name holds.
_NOISE: Final = "noise of "
_ALONE: Final = " by itself"
#: What has less of the squared gap is told, but is no reason to look at the rig.
WORTH_A_LOOK: Final = 0.01
#: A discrepancy's course, where its name alone would not say enough -> the variable in words.
_VARIABLES: Final = {
    "orientation": "orientation of the tool",
    "orientation, to first order": "orientation of the tool, to first order",
    "position, to first order": "position of the tool, to first order",
    "position": "position of the tool",
    "position, as a static field with sources near it does": "position of the tool, as a field of sources near by does",
    "position, as a static field with distant sources does": "position of the tool, as a field of far sources does",
    "level": "level of the reading",
    "level and direction": "level of the reading, rising or falling",
    "the history of its level": "history of the reading",
    "the fading memory of its level": "fading memory of the reading",
    "the fading memory of their levels": "fading memory of the readings",
    "their levels": "levels of the readings",
    "their levels and direction": "levels of the readings, rising or falling",
}


def variable_words(course: str) -> str:
    """What an error changes with, for a table or a picture: "position of the tool"."""
    return _VARIABLES.get(course, course)


def course_words(course: str) -> str:
    """How an error changes: "that changes with time"."""
    start, _, rest = course.partition(", ")
    if course == "time, throughout":
        return "that is constant"
    if course == "time, steadily":
        return "that drifts steadily with time"
    if course == "time, steadily from a start":
        return "that drifts steadily with time from a start"
    if course == "time, irregularly":
        return "that changes irregularly with time"
    if start == "time" and rest == "between two levels":
        return "that switches between two levels"
    if start == "time" and (rest.startswith("once ") or " times, first " in rest):
        return f"that comes {rest}"
    if start == "time" and rest.endswith("jumps"):
        return f"that changes in {rest.removeprefix('in ').replace('1 jumps', '1 jump')}"
    if start == "time" and rest.endswith("pieces"):
        return f"that changes with time, {rest.removeprefix('in ').removesuffix(' pieces')} times in the recording"
    if course.startswith("a sine of "):
        return f"that repeats as {course}"
    if start.startswith("every "):
        return f"that repeats {course}"
    if course == "the recording":
        return "that differs between the recordings"
    variable = variable_words(course)
    if course.startswith("the fading memory"):
        return f"that follows a {variable}"
    return f"that changes with {variable if variable == course else f'the {variable}'}"


def is_noise(each: Mapping[str, Any]) -> bool:
    """Whether what is left over is more noise of a channel, beside any error that is left."""
    return str(each["source"]).startswith(_NOISE)


def is_second(each: Mapping[str, Any]) -> bool:
    """Whether what is left over is an error beside those of which one is meant."""
    return bool(each.get("beside"))


def source_words(source: str) -> str:
    """What is off, in words."""
    if source.startswith(STRENGTH):
        return f"{STRENGTH}{of_constant_strength(source)}"
    return source.replace(_ALONE, " alone").replace("field along link", "field fixed in link")


def of_constant_strength(source: str) -> str:
    """The cause that an error is of whose strength the catalogue has as constant: "backlash of joint5"."""
    effect, _, where = source.removeprefix(STRENGTH).partition(" at ")
    return cause_name(effect, where)


def noise_and_bands(noise: Sequence[Mapping[str, Any]]) -> str:
    """Noise that is left, of which channels and where: those of one band together."""
    bands: dict[str, list[str]] = {}
    for each in noise:
        bands.setdefault(str(each["course"]), []).append(noisy_channel(str(each["source"])))
    told = [
        f"{and_words(channels)}{', each by itself' if len(channels) > 1 else ' alone'} ({band})"
        for band, channels in bands.items()
    ]
    return f"noise of {and_words(told)}"


def noisy_channel(source: str) -> str:
    """The channel of a noise that is left over."""
    return source.removeprefix(_NOISE).partition(_ALONE)[0]


def share_left(share: float) -> str:
    """A share of the squared gap; what rounds to nothing is not called nothing, nor all what rounds to all."""
    if not math.isfinite(share):
        return "less than 1 %"
    return percent(min(max(share, 0.0), 1.0)).replace("< ", "less than ").replace("> ", "more than ")


def by_share(follows: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """What is left over, the largest share first."""
    return sorted(follows, key=lambda each: -each["share"] if math.isfinite(each["share"]) else 0.0)


def grouped(follows: Sequence[Mapping[str, Any]]) -> tuple[list[Mapping[str, Any]], ...]:
    """Errors of which one is meant, errors beside these, and noise; of each the largest share first."""
    groups: tuple[list[Mapping[str, Any]], ...] = ([], [], [])
    for each in by_share(follows):
        groups[2 if is_noise(each) else 1 if is_second(each) else 0].append(each)
    return groups


def error_words(each: Mapping[str, Any]) -> str:
    """One thing that is left: "an error of the clock that changes with time"."""
    name, course = str(each["source"]), str(each["course"])
    source = source_words(name)
    if is_noise(each):
        return f"{source}, {course}"
    if course.endswith("-like"):
        return f"{source} like {course.removesuffix('-like')}"
    if name.startswith(STRENGTH):
        cause = of_constant_strength(name)
        return (
            f"{'an' if cause[0] in 'aeio' else 'a'} {cause} whose strength {course_words(course).removeprefix('that ')}"
        )
    return f"{f'an error of {source}' if source.startswith('the ') else source} {course_words(course)}"


def left_over_words(follows: Sequence[Mapping[str, Any]]) -> str:
    """All that is left, each with its share: errors of which one is meant, and an error and noise beside it."""
    errors, second, noise = (
        [f"{error_words(each)} ({share_left(each['share'])} of the squared gap)" for each in group]
        for group in grouped(follows)
    )
    return ", and ".join(filter(None, [", or ".join(errors), and_words([*second, *noise])]))


def largest_words(follows: Sequence[Mapping[str, Any]]) -> str:
    """The two largest errors that are left, those beside them, and noise that has more of the gap than these; noise
    where it is all."""
    errors, second, noise = grouped(follows)
    told = [*errors[:2], *second]
    most = max((each["share"] for each in told), default=0.0)
    return left_over_words([*told, *[each for each in noise if not told or each["share"] > most][:2]])
