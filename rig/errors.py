"""The errors a user can meet; each is one line that says what, where, found, expected and the nearest valid choice."""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Any, Final

#: Letters of a message, with what the command line puts before it, at most.
LONGEST_MESSAGE: Final = 280
_LONGEST_WORD: Final = 120  # a path that is longer is shortened in its middle
_SHORT_WORD: Final = 20  # words are cut only where they are longer
_LONGEST_NAME: Final = 80  # compared with others for nearness
_MOST_NAMES: Final = 1000
_MARK: Final = "..."


class RigError(Exception):
    """The call or its input is wrong: the command line ends with exit status 2.

    The message is one line of printable letters and of bounded length, whatever was put into it.
    """

    exit_status = 2

    def __init__(self, message: str = "") -> None:
        super().__init__(one_line(message))


class RefusedFit(RigError):
    """The input is well formed, but no answer worth having follows from it: exit status 1."""

    exit_status = 1


class LeftOut(UserWarning):
    """A part of the input is missing, and what was asked for goes on without it: the command line says it in a line."""


def one_line(text: str, limit: int = LONGEST_MESSAGE) -> str:
    """A text as one printable line: white space is one space, and what cannot be shown is written as ``\\x1b``.

    What is too much is left out of the middle, so that both where a message begins and what it expects stay.

    Args:
        text: anything.
        limit: letters at most.
    """
    if len(text) > 4 * limit:  # whatever is behind will not be shown
        text = f"{text[: 2 * limit]}{_MARK}{text[-2 * limit :]}"
    text = "".join(_printable(" ".join(text.split())))
    if len(text) > limit:
        text = re.sub(rf"\S{{{_LONGEST_WORD + 1},}}", lambda word: shortened(word[0], _LONGEST_WORD), text)
    return shortened(text, limit)


def shown(value: Any, limit: int = 60) -> str:
    """A value as Python writes it, in one short line; also one that Python refuses to write, or only at length."""
    if isinstance(value, str):
        value = shortened(value, 4 * limit)
    elif isinstance(value, int) and not isinstance(value, bool) and value.bit_length() > 256:
        return f"{'-' if value < 0 else ''}an integer of {value.bit_length()} bits"
    elif isinstance(value, list | tuple | dict | set | bytes) and len(value) > limit:
        return f"{type(value).__name__} of {len(value)}"
    try:
        return one_line(repr(value), limit)
    except (ValueError, RecursionError):  # a huge integer, or a deep nesting, inside
        return f"a {type(value).__name__}"


def shortened(text: str, limit: int) -> str:
    """A text with its middle left out where it is longer than ``limit`` letters, between words that are short."""
    if len(text) <= limit:
        return text
    kept = limit - len(_MARK)
    before, after = text[: kept - kept // 2], text[len(text) - kept // 2 :]
    if " " in before[-_SHORT_WORD:]:
        before = before[: before.rindex(" ") + 1]
    if " " in after[:_SHORT_WORD]:
        after = after[after.index(" ") :]
    # where the middle was left out before
    return f"{before.removesuffix(f'{_MARK} ')}{_MARK}{after.removeprefix(f' {_MARK}')}"


def nearest(name: str, choices: Iterable[str]) -> str:
    """The closest valid name as ``" (nearest: 'x')"``, or ``""`` where none comes close."""
    match = closest(name, choices, 0.5)
    return "" if match is None else f" (nearest: {shown(match)})"


def closest(name: str, choices: Iterable[str], likeness: float) -> str | None:
    """The choice most like ``name``, None where none is as like as ``likeness`` (0 to 1).

    Very long names, and very many, are not compared: that takes time with the square of their length.
    """
    if len(name) > _LONGEST_NAME:
        return None
    short = [choice for _, choice in zip(range(_MOST_NAMES), choices, strict=False) if len(choice) <= _LONGEST_NAME]
    match = difflib.get_close_matches(name, short, n=1, cutoff=likeness)
    return match[0] if match else None


def unknown_name(what: str, name: str, choices: Iterable[str]) -> RigError:
    """The error for a name that is none of ``choices``."""
    choices = sorted(choices)
    near = nearest(name, choices)
    listed = shortened(", ".join(shortened(choice, _LONGEST_NAME) for choice in choices[:_MOST_NAMES]), 140)
    return RigError(f"unknown {what} {shown(name)}: expected one of {listed}{near}")


def check_name(what: str, name: Any, choices: Collection[str]) -> None:
    """Refuse what is none of ``choices``.

    Raises:
        RigError: as of ``unknown_name``.
    """
    if name not in choices:
        raise unknown_name(what, str(name), choices)


def _printable(text: str) -> Iterator[str]:
    for letter in text:
        if letter.isprintable():
            yield letter
        elif "\udc80" <= letter <= "\udcff":  # a byte of a name that is not UTF-8
            yield f"\\x{ord(letter) - 0xDC00:02x}"
        else:
            yield letter.encode("unicode_escape").decode("ascii")


def in_a_row(names: Sequence[str], last: str = " and ") -> str:
    """``a, b and c``: names with commas, and something else before the last one."""
    return last.join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


def in_short(names: Sequence[str]) -> str:
    """``a and b``, ``a, b and c``, or ``a, b and 5 more``."""
    return in_a_row(names if len(names) <= 3 else [*names[:2], f"{len(names) - 2} more"])
