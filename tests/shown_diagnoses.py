"""Diagnoses of every verdict, made by hand, and what terminal and page say to a reader."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape
from io import StringIO

from diagnosed_recordings import by_hand, cause
from rich.console import Console

from estimators.gap.diagnosis import Hypothesis

OFFSET = cause("joint_offset", "joint5", probability=0.6, offset_rad=(0.01, 1e-4, "rad"))
TWIN = {"effect": "joint_offset", "where": "joint2", "probability": 0.3}
TWINS = replace(OFFSET, probability=0.98, equivalent=(TWIN,))
IRON = cause(
    "link_soft_iron",
    "link4",
    probability=0.7,
    chi=(
        (0.01, None, 0.02, None, None, 0.03),
        (1e-3, None, 1e-3, None, None, 1e-3),
        "relative",
        "not in this maneuver",
    ),
)
LISTED = cause("backlash", "joint1", probability=0.3, width_rad=(None, None, "rad", "this recording does not feel it"))
SHOWN = {
    "named": by_hand(),
    "named with a twin": by_hand(causes=(TWINS,)),
    "ambiguous": by_hand("ambiguous", (OFFSET,), rivals=((("joint_offset", "joint2"),),)),
    "partly": by_hand("partly"),
    "partly, many fit": by_hand(
        "partly", other=False, rivals=tuple((("backlash", "joint5"), ("latency", where)) for where in ("mag1",) * 6)
    ),
    "unknown": by_hand("unknown"),
    "unknown, no cause": by_hand("unknown", ()),
    "unknown, many fit": by_hand(
        "unknown", (IRON,), other=False, rivals=tuple((("joint_scale", f"joint{n}"),) for n in range(1, 7)), first=0.4
    ),
    "unknown, one is likely": by_hand("unknown", (IRON,), other=False, first=0.8),
    "no-gap": by_hand("no-gap", ()),
}
LIKELY = SHOWN["unknown, one is likely"]
SHOWN["unknown, one is likely"] = replace(
    LIKELY,
    hypotheses=(LIKELY.hypotheses[0], Hypothesis((), True, 0.18)),
    posterior={"nothing": 0.0, "known": 0.82, "other": 0.18},
)
SHOWN["unknown, many fit"] = replace(
    SHOWN["unknown, many fit"], causes=(IRON, LISTED), floor="estimated from the recording itself"
)


def spoken(*items: object) -> str:
    """What the terminal would say if it were so wide that nothing wraps."""
    console = Console(file=StringIO(), width=1000)
    for item in items:
        console.print(item)
    return " ".join(console.file.getvalue().split())  # type: ignore[attr-defined]


def read(text: str) -> str:
    """What a reader of the page sees."""
    body = re.sub(r"<style>.*?</style>|<image[^>]*>", "", text, flags=re.DOTALL)
    body = re.sub(r"</?(code|span)>", "", body)  # within a sentence
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", body)).split())


UNITS = {"accelerometer": "V", "magnetometer": "V"}
