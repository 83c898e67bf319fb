"""What is left over in words: which error of the rig it acts like, and what that error changes with."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from estimators.gap.choices import and_words

#: How the name of a noise that is left over begins, and what else its name holds.
_NOISE: Final = "noise of "
_ALONE: Final = " by itself"
#: A discrepancy's course, where its name alone would not say enough -> the variable in words.
_VARIABLES: Final = {
    "orientation": "orientation of the tool",
    "orientation, to first order": "orientation of the tool, to first order",
    "position": "position of the tool",
    "level": "level of the reading",
    "level and direction": "level of the reading, rising or falling",
    "the history of its level": "history of the reading",
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
    if start == "time" and rest.endswith("jumps"):
        return f"that changes in {rest.removeprefix('in ').replace('1 jumps', '1 jump')}"
    if start == "time" and rest.endswith("pieces"):
        return f"that changes with time, {rest.removeprefix('in ').removesuffix(' pieces')} times in the recording"
    if course.startswith("a sine of "):
        return f"that repeats as {course}"
    if course == "the recording":
        return "that differs between the recordings"
    variable = variable_words(course)
    return f"that changes with {variable if variable == course else f'the {variable}'}"


def is_noise(each: Mapping[str, Any]) -> bool:
    """Whether what is left over is more noise of a channel, beside any error that is left."""
    return str(each["source"]).startswith(_NOISE)


def is_second(each: Mapping[str, Any]) -> bool:
    """Whether what is left over is an error beside those of which one is meant."""
    return bool(each.get("beside"))


def source_words(source: str) -> str:
    """What is off, in words."""
    return source.replace(_ALONE, " alone").replace("field along link", "field fixed in link")


def share_left(share: float) -> str:
    """A share of the squared gap; what rounds to nothing is not called nothing."""
    return "less than 1 %" if not math.isfinite(share) or share < 0.005 else f"{100.0 * min(share, 1.0):.0f} %"


def error_words(each: Mapping[str, Any]) -> str:
    """One thing that is left: "an error of the clock that changes with time"."""
    source, course = source_words(str(each["source"])), str(each["course"])
    if is_noise(each):
        return f"{source}, {course}"
    if course.endswith("-like"):
        return f"{source} like {course.removesuffix('-like')}"
    return f"{f'an error of {source}' if source.startswith('the ') else source} {course_words(course)}"


def left_over_words(follows: Sequence[Mapping[str, Any]]) -> str:
    """All that is left, each with its share: errors of which one is meant, and an error and noise beside it."""
    told: tuple[list[str], list[str]] = ([], [])
    for each in follows:
        share = share_left(each["share"])
        told[is_noise(each) or is_second(each)].append(f"{error_words(each)} ({share} of the squared gap)")
    return ", and ".join(filter(None, [", or ".join(told[0]), and_words(told[1])]))


def likeliest_words(follows: Sequence[Mapping[str, Any]]) -> str:
    """The two likeliest errors that are left, the one beside them, and noise that has more of the gap than these; noise
    where it is all."""
    errors = [each for each in follows if not is_noise(each) and not is_second(each)][:2]
    errors += [each for each in follows if is_second(each)]
    most = max((each["share"] for each in errors), default=0.0)
    noise = [each for each in follows if is_noise(each) and (not errors or each["share"] > most)]
    return left_over_words([*errors, *noise[:2]])
