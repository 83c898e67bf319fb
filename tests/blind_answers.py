"""Answers to sealed cases, made by hand: a diagnosis with all its probability on what it says."""

from __future__ import annotations

from typing import Any

Label = tuple[str, str]


def answer(verdict: str, *causes: Label, equivalent: tuple[Label, ...] = (), sure: float = 0.97) -> dict[str, Any]:
    """A verdict with causes, each of probability ``sure``, and what is left on nothing.

    An answer that names nothing puts ``sure`` on something else where it is unknown, and on nothing elsewhere.
    """
    others = [{"effect": effect, "where": where, "probability": 0.1} for effect, where in equivalent]
    found = [
        {"effect": effect, "where": where, "probability": sure, "equivalent": others, "parameters": {}}
        for effect, where in causes
    ]
    other = verdict == "unknown"
    main = {"causes": [list(label) for label in causes], "other": other, "probability": sure}
    rest = {"causes": [], "other": not causes and not other, "probability": round(1.0 - sure, 9)}
    said = "other" if other else "known" if causes else "nothing"
    posterior = dict.fromkeys(("nothing", "known", "other"), 0.0) | {said: sure}
    posterior["other" if rest["other"] else "nothing"] += round(1.0 - sure, 9)
    return {
        "format": "rig-diagnosis/2",
        "verdict": verdict,
        "posterior": posterior,
        "omitted": 0.0,
        "hypotheses": [main, rest],
        "causes": found,
    }
