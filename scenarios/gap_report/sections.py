"""The sections of the page: explanations, what to do next, where, how far, what is left, what is not told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape
from typing import Any, Final

from estimators.gap.diagnosis import Cause, Diagnosis
from estimators.gap.readable_units import rms_text
from estimators.gap.remainder_words import grouped, share_left, source_words, variable_words
from estimators.gap.share_words import elsewhere_words
from rig.effects import EFFECTS, Kind
from rig.recording import Recording
from scenarios.gap_report import charts, curves, html, maps
from scenarios.gap_report.advice import next_steps
from scenarios.gap_report.gap_residuals import GapResiduals
from scenarios.gap_report.maneuver_words import interval_words
from scenarios.gap_report.untold import grouped_untold
from scenarios.gap_report.words import (
    MEANINGS,
    RIG_COLUMNS,
    VERDICTS,
    apart_words,
    as_sentence,
    capital,
    cause_title,
    explanation_rows,
    hidden_words,
    noise_words,
    one_of_words,
    part_words,
    readable,
    rig_rows,
    rig_words,
    worth_shifts,
)
from scenarios.shown_units import shift_unit, shown_units

_SHIFTS = 12
#: Where causes do the same to the recording.
_EITHER: Final = "“Either … or”: one of these is meant; they do the same to the recording, each has its probability. "
#: Of noise and of single readings.
_NOT_TAKEN_OUT: Final = (
    "The RMS after still has the noise and the single readings that are named: a simulator makes their like, it does "
    "not take them out of a recording. The gap after does not have them."
)


def explanations(diagnosis: Diagnosis) -> str:
    """What could explain the recording, each with its probability."""
    rows, rest = explanation_rows(diagnosis)
    cells = [*((escape(words), told) for words, told in rows), *((f"<i>{words}</i>", told) for words, told in rest)]
    return "\n".join(
        [
            "<h2>What could explain it</h2>",
            f"<p><b>{VERDICTS[diagnosis.verdict]}</b>: {escape(MEANINGS[diagnosis.verdict])}</p>",
            html.figure(charts.posterior_bars(diagnosis), "Probability of each answer; the three add up to one."),
            html.table(("explanation", "probability"), cells, numbers=(1,)),
            *(f"<p>{escape(as_sentence(words))}</p>" for words in one_of_words(diagnosis)),
            '<p class="soft">Every explanation is a set of causes that act together, the likeliest first. '
            f"{_EITHER if any(cause.equivalent for cause in diagnosis.causes) else ''}"
            "Of what is said with a probability of .9, nine in ten should be true.</p>",
        ]
    )


def fitted_rig(diagnosis: Diagnosis, residuals: GapResiduals) -> str:
    """The gap against the fitted rig beside that against the ideal one; empty where no rig was given."""
    if diagnosis.rig is None:
        return ""
    rows = [
        (f"<code>{escape(name)}</code>", *map(escape, told))
        for name, *told in rig_rows(diagnosis.rig, residuals.recording.units, diagnosis.samples)
    ]
    titles = ("channel", *RIG_COLUMNS.values(), "unit")
    words = " ".join(escape(line) for line in rig_words(diagnosis))
    return (
        f"<h2>Against the fitted rig</h2>\n<p>{words}</p>\n{html.table(titles, rows, numbers=range(1, 6))}\n"
        '<p class="soft">Calibrations are refitted for either rig. The verdict and all that follows are of what the '
        "fitted rig leaves.</p>"
    )


def recordings(diagnosis: Diagnosis) -> str:
    """What each of several recordings says for each cause; empty for one."""
    if len(diagnosis.recordings) == 1:
        return ""
    told = [cause for cause in diagnosis.causes if cause.evidence]
    rows = [
        (escape(name), *(f"{cause.evidence.get(name, 0.0):,.1f}" for cause in told)) for name in diagnosis.recordings
    ]
    titles = ("recording", *(cause_title(cause.effect, cause.where) for cause in told))
    return "\n".join(
        [
            "<h2>Which recording says so</h2>",
            '<p class="soft">One calibration and the same causes for all of them. By how much the log likelihood of '
            "each falls where a cause is taken out again: 5 is about 150 to one.</p>",
            html.table(titles, rows, numbers=range(1, len(titles))) if told else "<p>No cause is told of.</p>",
        ]
    )


def where(diagnosis: Diagnosis, residuals: GapResiduals) -> str:
    """By channel, by what it follows, over the joint angles, over frequency, over time; of one of several."""
    several = len(diagnosis.recordings) > 1
    if several:
        diagnosis = replace(diagnosis, channels=diagnosis.by_recording[residuals.recording.name])
    explained = residuals.after is not None
    both = [("before", "before"), ("after", "after")] if explained else [("residual", "before")]
    shown = [(f"gap {words}" if explained else "gap", css) for words, css in both]
    if diagnosis.verdict == "no-gap":
        shown = [("residual", "before")]
    named = explained and any(effect.kind.value == "noise" for effect in residuals.causes)
    parts = [
        f"<h2>Where it lies in {escape(residuals.recording.name)}</h2>" if several else "<h2>Where it lies</h2>",
        "<h3>By channel</h3>",
        html.key([*shown, ("noise floor", "tick")]),
        html.figure(charts.channel_bars(diagnosis, shown_units(residuals.recording.units)), wide=True),
    ]
    follows = list(diagnosis.follows)
    if follows and residuals.recording.name == diagnosis.recordings[0]:
        parts += [
            "<h3>By what it follows</h3>",
            '<div class="pair">',
            html.figure(charts.follow_bars(follows)),
            '<p class="soft">The share of the squared gap that one error of the rig explains if it changes smoothly '
            "with that variable: the error, of all that a rig can have, that explains most. The shares overlap: what "
            "repeats with a joint's angle also repeats with the orientation of the tool.</p></div>",
        ]
    parts += [
        "<h3>Over the joint angles</h3>"
        if residuals.recording.q is not None
        else "<h3>Over orientation and position</h3>",
        html.figure(
            maps.maps(residuals),
            "Whitened residual. A white cell has no sample. An axis marked “out, then back” shows both directions of "
            "travel, divided by the white line, so that what depends on the direction shows as two halves that differ.",
            wide=True,
        ),
        "<h3>Over frequency</h3>",
        html.key([*both, ("noise floor", "floor"), *([("floor and the named noise", "named")] if named else [])]),
        html.figure(
            curves.spectrum(residuals),
            "Amplitude spectral density of the residuals; both axes are logarithmic.",
            wide=True,
        ),
        "<h3>Over time</h3>",
        html.key([*both, ("two standard errors of such a mean, from the floor", "band")]),
        html.figure(
            curves.over_time(residuals),
            f"Residuals as means of successive blocks of {curves.block_s(residuals):.3g} s.",
            wide=True,
        ),
    ]
    return "\n".join(parts)


def _stays(cause: Cause) -> bool:
    """Whether what a cause does is in the residual with it in the simulator, too."""
    return cause.effect in EFFECTS and EFFECTS[cause.effect].kind is not Kind.MEAN


def how_far(diagnosis: Diagnosis, residuals: Sequence[GapResiduals]) -> str:
    """The share of the gap that is gone, and the numbers by channel."""
    if diagnosis.closed.value is None:
        return ""
    unit = shown_units({name: own for each in residuals for name, own in each.recording.units.items()})
    rows = []
    for name, row in diagnosis.channels.items():
        shown = unit[name]
        sizes = (row.noise_floor, row.rms_before, row.rms_after, row.gap_before, row.gap_after)
        told = (rms_text(size, row.noise_floor, diagnosis.samples, shown.factor) for size in sizes)
        rows.append((name, *told, part_words(row.closed), shown.name))
    titles = ("channel", "floor", "RMS before", "RMS after", "gap before", "gap after", "closed", "unit")
    elsewhere = diagnosis.closed_elsewhere
    also = "" if elsewhere is None else f"<p>{elsewhere_words(elsewhere).capitalize()}.</p>"
    return "\n".join(
        [
            "<h2>How far it closes</h2>",
            '<p class="soft">Share of the squared gap that is gone once the causes of the likeliest explanation are in '
            "the simulator, with its 95 % interval, judged on blocks of the recording that did not choose them.</p>",
            html.figure(charts.closed_bar(diagnosis)),
            also,
            html.table(titles, [tuple(map(escape, row)) for row in rows], numbers=range(1, 7)),
            *([f'<p class="soft">{_NOT_TAKEN_OUT}</p>'] if any(map(_stays, diagnosis.leading)) else []),
        ]
    )


def calibration(diagnosis: Diagnosis, recording: Recording) -> str:
    """What the gap does to the calibration, the largest shift first."""
    shifts, none = worth_shifts(diagnosis)
    heading = "<h2>What it does to the calibration</h2>"
    if not shifts:
        return f"{heading}\n<p>{as_sentence(none)}</p>" if none else ""
    shown = shifts[:_SHIFTS]
    rest = len(diagnosis.calibration_shift) - len(shown)
    rows = []
    for name, shift in shown:
        difference = shift["before"] - shift["after"]
        cells = (_fixed(shift[key], difference) for key in ("before", "after"))
        unit = shift_unit(name, recording.units, recording.metadata.magnetic_field_unit)
        rows.append((f"<code>{escape(name)}</code>", *cells, escape(unit)))
    titles = ("parameter", "gap not modelled", "gap modelled", "unit")
    below = f"<p class='soft'>The other {rest} moved less.</p>" if rest else ""
    return "\n".join(
        [
            heading,
            '<p class="soft">Shift from the calibration with the gap modelled to the one without, in standard '
            "deviations of the estimate from noise alone.</p>",
            '<div class="pair even">',
            html.figure(charts.shift_bars([(name, -shift["sigmas"]) for name, shift in shown])),
            f"<div>{html.table(titles, rows, numbers=(1, 2))}{below}</div>",
            "</div>",
        ]
    )


def _fixed(value: float, difference: float) -> str:
    """A number with as many decimals as show the difference."""
    decimals = 6 if difference == 0.0 else next((d for d in range(9) if abs(difference) * 10**d >= 9.5), 9)
    return f"{value:.{decimals}f}".replace("-", "−")


def remainder(diagnosis: Diagnosis) -> str:
    """What is left after the likeliest explanation, and what could still hide."""
    parts = ["<h2>What is left</h2>"]
    if diagnosis.remainder.verdict == "noise":
        parts.append(f"<p>{as_sentence(noise_words(diagnosis))}</p>")
    elif not diagnosis.remainder.follows:
        parts.append("<p>More than noise, without a pattern that could be told.</p>")
    else:
        parts += _left(diagnosis.remainder.follows)
    if hidden := hidden_words(diagnosis):
        parts.append(f"<p>{escape(hidden)}</p>")
    return "\n".join(parts)


def _left(follows: Sequence[Mapping[str, Any]]) -> list[str]:
    """What is left over: errors of the rig, one of which is meant, an error beside it, and noise beside both."""
    errors, second, noise = grouped(follows)
    parts = []
    for told, words, changes in (
        (errors, "More than noise. It acts like one of these errors of the rig:", "changes with"),
        (second, "And, beside that, like a second error:", "changes with"),
        (noise, "More noise than the floor" + (", beside that" if errors else "") + ":", "at frequencies of"),
    ):
        rows = [
            (
                escape(readable(source_words(str(each["source"])))),
                escape(readable(variable_words(str(each["course"])))),
                share_left(each["share"]),
            )
            for each in told
        ]
        if rows:
            titles = ("what is off", changes, "share of the squared gap")
            parts += [f"<p>{words}</p>", html.table(titles, rows, numbers=(2,))]
    return parts


def untold(diagnosis: Diagnosis) -> str:
    """The effects that this recording cannot show, by the reason."""
    if not diagnosis.cannot_tell:
        return ""
    groups = grouped_untold(diagnosis)
    listed = "".join(
        f"<dt>{escape(capital(why))}</dt><dd>{escape(', '.join(effects))}</dd>" for why, effects in groups.items()
    )
    return (
        "<h2>What this recording cannot tell</h2>\n"
        '<p class="soft">These may be there all the same; no analysis of this recording can see them.</p>\n'
        f'<dl class="reasons">{listed}</dl>'
    )


def next_step(diagnosis: Diagnosis) -> str:
    """What to do next, and the maneuver that would tell more with how far it separates each pair of explanations."""
    listed = "".join(f"<li>{html.with_commands(step)}</li>" for step in next_steps(diagnosis))
    parts = ["<h2>What to do next</h2>", f"<ol>{listed}</ol>"]
    step = diagnosis.next or {}
    if not step.get("maneuver"):
        return "\n".join(parts)
    parts += [f"<p><b>{escape(as_sentence(str(step['maneuver'])))}</b></p>", f"<p>{escape(str(step['why']))}</p>"]
    if step.get("scenario"):
        name = escape(str(step["scenario"]))
        parts.append(f"<p>To simulate it: <code>rig sweep {name} -o RUN.parquet</code></p>")
    rows = [
        (
            *map(escape, apart_words(*([(e["effect"], e["where"]) for e in pair[key]] for key in ("truth", "rival")))),
            interval_words(pair["chi_square"], pair["low"], pair["high"]),
            f"{pair['recorded_maneuver']:.1f}",
        )
        for pair in step.get("separates", ())
    ]
    if rows:
        titles = ("if this is true", "this fits worse", "by a chi-square of", "on the recorded maneuver")
        parts.append(html.table(titles, rows, numbers=(2, 3)))
        parts.append(
            '<p class="soft">A chi-square of 10 makes the true one about 150 times as likely as the other.</p>'
        )
    return "\n".join(parts)
