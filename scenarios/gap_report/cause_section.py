"""The page's section on causes: each with its probability, its parameters and what does the same to the recording."""

from __future__ import annotations

from html import escape

from estimators.gap.diagnosis import Cause, Diagnosis
from estimators.gap.parameter_words import parameter_name, told_parameters
from estimators.gap.share_words import chance
from scenarios.gap_report import html
from scenarios.gap_report.words import (
    ITS_SHARE,
    alike_title,
    capital,
    cause_title,
    estimate_words,
    formula,
    parameter_for_people,
    share_words,
    status_words,
)


def which(diagnosis: Diagnosis) -> str:
    """The causes, each with its parameters, its probability and what does the same to the recording."""
    heading = "<h2>Which effect causes it</h2>"
    if not diagnosis.causes:
        none = (
            "No effect is needed: the ideal rig with its best calibration leaves noise."
            if diagnosis.verdict == "no-gap"
            else "No effect of the catalogue is likely."
        )
        return f"{heading}\n<p>{none}</p>"
    parts = [heading]
    if warning := _doubt(diagnosis):
        trust = (
            "Trust those causes only that are established."
            if diagnosis.established
            else "None of these causes is established."
        )
        parts.append(f'<p class="warning">{warning} {trust}</p>')
    # no rig is improved by what is unknown
    shown = "The pictures have" if diagnosis.verdict == "unknown" else "The pictures and the improved rig have"
    parts.append(
        '<p class="soft">The probability of a cause is that of all explanations that have it, or what does the same in '
        "its place. Established: .95 or more; likely: .5 or more; possible: less. “Not felt”: this recording says "
        f"nothing about that number. Its share: {ITS_SHARE}; two causes that do a part of the same have shares that "
        f"do not add up. {shown} the causes of the likeliest explanation.</p>"
    )
    parts += [_cause(cause, status_words(cause, diagnosis)) for cause in diagnosis.causes]
    return "\n".join(parts)


def _doubt(diagnosis: Diagnosis) -> str:
    """Why not every cause that is told of is there; empty where there is no such doubt."""
    if diagnosis.posterior["other"] >= 0.5:
        return (
            "Something outside the catalogue is there as well, and may imitate these causes or bend their parameters."
        )
    if diagnosis.verdict == "partly":
        return "What else is there, if anything, is open."
    if diagnosis.verdict == "unknown":
        return "No explanation stands out." if diagnosis.likely is None else "The likeliest explanation is not certain."
    return ""


def _parameter(name: str) -> str:
    """What a parameter is called, with its name in the catalogue where that is another."""
    words = parameter_name(name)
    return escape(words) if words == name else f"{escape(words)} <code>{escape(name)}</code>"


def _cause(cause: Cause, status: str) -> str:
    rows = [
        (
            _parameter(name),
            escape(estimate_words(value)),
            escape(parameter_for_people(cause, name)),
            escape(value.why or ""),
        )
        for name, value in told_parameters(cause).items()
    ]
    facts = [
        ("probability", chance(cause.probability)),
        ("status", status),
        (
            "its share",
            f"{share_words(cause.closed)} of the squared gap" if cause.closed.value is not None else "–",
        ),
        ("in the catalogue", f"{cause.effect}, {cause.where}"),
    ]
    listed = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in facts)
    titles = ("parameter", "value ± standard deviation", "in other units", "remark")
    filled = [index for index in range(len(titles)) if index < 2 or any(row[index] for row in rows)]
    parts = [
        f'<section class="cause"><h3>{escape(capital(alike_title(cause)))}</h3>',
        f'<p class="soft">{escape(formula(cause.effect))}</p>',
        f'<dl class="facts">{listed}</dl>',
        html.table([titles[index] for index in filled], [[row[index] for index in filled] for row in rows]),
    ]
    if cause.equivalent:
        first = escape(cause_title(cause.effect, cause.where))
        parts.append(
            f"<p>These do the same to this recording; one of them is meant. The parameters are of <b>{first}</b>.</p>"
        )
    return "".join(parts) + "</section>"
