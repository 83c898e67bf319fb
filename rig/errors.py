"""The errors a user can meet; each is one line that says what, where, found, expected and the nearest valid choice."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class RigError(Exception):
    """The call or its input is wrong: the command line ends with exit status 2."""

    exit_status = 2


class RefusedFit(RigError):
    """The input is well formed, but no answer worth having follows from it: exit status 1."""

    exit_status = 1


def nearest(name: str, choices: Iterable[str]) -> str:
    """The closest valid name as ``" (nearest: 'x')"``, or ``""`` where none comes close."""
    match = difflib.get_close_matches(name, list(choices), n=1, cutoff=0.5)
    return f" (nearest: {match[0]!r})" if match else ""


def unknown_name(what: str, name: str, choices: Iterable[str]) -> RigError:
    """The error for a name that is none of ``choices``."""
    choices = sorted(choices)
    return RigError(f"unknown {what} {name!r}: expected one of {', '.join(choices)}{nearest(name, choices)}")
