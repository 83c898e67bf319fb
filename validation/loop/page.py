"""The page of the loop."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from estimators.gap.share_words import chance
from scenarios.gap_report.words import cause_title
from validation.blind.intervals import Rate
from validation.loop.play import MOST, Settings, Step
from validation.loop.rigs import STRENGTHS
from validation.loop.summary import Summary, summaries
from validation.markdown import list_of, table_of

PICTURE: Final = "loop.png"
_WORDS: Final = {
    "proposed": "the proposed maneuver",
    "random": "stops at random poses",
    "torus": "another torus sweep",
}


def blocks(settings: Settings, steps: Sequence[Step]) -> Iterator[str]:
    """Of the page; ``loop`` beside it holds the picture and the table."""
    found = summaries(steps)
    minutes = steps[0].minutes
    command = f"rig study loop -o docs --rigs {settings.rigs} --samples {settings.samples} --seed {settings.seed}"
    yield (
        f"<!-- Written by `{command}`; do not edit. -->\n"
        "# The loop: diagnose, record what tells most, diagnose together"
    )
    yield (
        f"{settings.rigs} hidden rigs with one cause each, drawn so that the first sweep takes the cause for another: "
        "at least one other cause of the catalogue leaves less than 2.5 standard deviations of what it does. That is "
        "computed from the truth, not from a diagnosis. The cause's signal-to-noise in the first recording is drawn "
        f"between {STRENGTHS[0]:g} and {STRENGTHS[1]:g}; effects that happen at an instant are left out. Every "
        f"recording has {settings.samples:,} samples at 4 Hz, {minutes:.1f} minutes of arm time. Each rig is recorded "
        f"and diagnosed; then comes another maneuver, up to {MOST} in all, and all recordings are diagnosed together, "
        "until one cause by one name is left. The next maneuver is the one that the diagnosis proposes, stops at "
        "random poses of all joints, or another torus sweep of joints 1, 5 and 6, each as long as the first."
    )
    yield f"![How many rigs are named rightly after how many minutes](loop/{PICTURE})"
    yield list_of(map(_headline, found))
    columns = ("next", "named rightly", "wrongly", "no maneuver", "given up", "of open rigs", "minutes a name")
    yield table_of(columns, [_row(each) for each in found])
    yield (
        "Named rightly: of all rigs, with Wilson's 95 % interval. Wrongly: named by another cause. No maneuver: the "
        "diagnosis has none to propose, as it is of a verdict that needs another answer, or no maneuver that was tried "
        "tells more; of several names the truth may be one. The next recording may be in a room 5 degC warmer, where "
        f"that is proposed. Given up: after {MOST} maneuvers. Open rigs are those that the first recording did not "
        "name; minutes a name is the arm time after the first recording, of all open rigs, for each of them that ends "
        "rightly."
    )
    yield "## Every rig"
    header = ("rig", "cause", "signal-to-noise", "alike at first", "next", "maneuvers", "minutes", "ends", "as")
    yield table_of(header, [_rig(each) for summary in found for each in summary.last])
    yield "The table of all steps is `loop/study/table.parquet`."


def _headline(found: Summary) -> str:
    median = ""
    if not np.isnan(found.added_maneuvers):
        minutes = np.median([last.minutes for last in found.open if last.rightly])
        median = f", after {found.added_maneuvers:g} more at the median, {minutes:.0f} minutes of arm time in all"
    return (
        f"With {_WORDS[found.strategy]}, {_share(found.rightly_open)} of the rigs that the first recording left open"
        f" end with the right name{median}."
    )


def _share(rate: Rate) -> str:
    return f"{rate.hits:g} of {rate.count}"


def _row(each: Summary) -> tuple[str, ...]:
    ends = each.ends
    cost = "–" if np.isinf(each.minutes_a_name) else f"{each.minutes_a_name:.0f}"
    return (
        _WORDS[each.strategy],
        f"{_share(each.rightly)}: {each.rightly}",
        *(str(ends[name]) for name in ("wrongly", "no maneuver", "given up")),
        _share(each.rightly_open),
        cost,
    )


def _rig(each: Step) -> tuple[str, ...]:
    ends = "rightly" if each.rightly else "wrongly" if each.ended == "named" else each.ended
    said = " with ".join(map(_names, each.said.split(" with "))) if each.said else "–"
    if each.names > 3:
        said = f"{each.names} names"
    return (
        str(each.rig),
        cause_title(each.effect, each.where),
        f"{each.snr:.0f}",
        str(each.alike),
        _WORDS[each.strategy],
        str(each.step),
        f"{each.minutes:.0f}",
        f"{ends} ({each.verdict} {chance(each.probability)})",
        said,
    )


def _names(said: str) -> str:
    """One cause by all its names."""
    return " or ".join(cause_title(*label.split("@")) for label in said.split(" or "))
