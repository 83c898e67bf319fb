"""The sections of the page: where, which, how far, what it did to the calibration, what is left, what is next."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from estimators.gap.diagnosis import Cause, Diagnosis, percent
from scenarios.gap_report import charts, curves, maps
from scenarios.gap_report.next_maneuver import interval_words
from scenarios.gap_report.residuals import GapResiduals
from scenarios.gap_report.units import shown_units
from scenarios.gap_report.words import (
    cause_title,
    estimate_for_people,
    estimate_words,
    formula,
    grouped_untold,
    p_words,
)

_SHIFTS = 12
#: A calibration parameter that moved by less is not worth a bar.
_WORTH_SIGMAS = 0.5


def where(diagnosis: Diagnosis, residuals: GapResiduals) -> str:
    """By channel, by what it follows, over the joint angles, over frequency, over time."""
    explained = residuals.after is not None
    both = [("before", "before")] + ([("after", "after")] if explained else [])
    named = explained and any(effect.kind.value == "noise" for effect in residuals.causes)
    parts = [
        "<h2>Where it lies</h2>",
        "<h3>By channel</h3>",
        _key([*((f"gap {words}", css) for words, css in both), ("noise floor", "tick")]),
        _figure(charts.channel_bars(diagnosis, shown_units(residuals.recording.units)), ""),
    ]
    follows = list(diagnosis.follows)
    if follows:
        parts += [
            "<h3>By what it follows</h3>",
            '<div class="pair">',
            _figure(charts.follow_bars(follows), ""),
            '<p class="soft">The share of the gap that smooth functions of each quantity predict on blocks of the '
            "recording that did not fit them. The shares overlap: what repeats with a joint's angle also repeats "
            "with the orientation.</p></div>",
        ]
    parts += [
        "<h3>Over the joint angles</h3>" if residuals.recording.q is not None else "<h3>Over attitude and place</h3>",
        _figure(
            maps.maps(residuals),
            "Whitened residual. An axis marked “out, then back” shows both directions of travel, divided by the white "
            "line, so that what depends on the direction shows as two halves that differ.",
        ),
        "<h3>Over frequency</h3>",
        _key([*both, ("noise floor", "floor"), *([("floor and the named noise", "named")] if named else [])]),
        _figure(curves.spectrum(residuals), "Amplitude density of the residuals."),
        "<h3>Over time</h3>",
        _key([*both, ("two standard errors of the floor", "band")]),
        _figure(curves.over_time(residuals), "Means of successive blocks of the residuals."),
    ]
    return "\n".join(parts)


def which(diagnosis: Diagnosis) -> str:
    """The causes, each with its parameters, its probability and what the data cannot split from it."""
    parts = ["<h2>Which effect causes it</h2>"]
    if not diagnosis.causes:
        none = (
            "No effect is needed: the ideal rig with its best calibration leaves noise."
            if diagnosis.verdict == "no-gap"
            else "No effect of the catalogue explains it."
        )
        return f"{parts[0]}\n<p>{none}</p>"
    if diagnosis.verdict == "unknown":
        reason = (
            "It takes all of these together to explain the gap, and none of them explains most of it: a sign that the "
            "true cause is not in the catalogue and that they imitate it."
            if diagnosis.remainder == "noise"
            else "These explain part of the gap only. Something that is not in the catalogue is left, and may imitate "
            "them or bend their parameters."
        )
        parts.append(f'<p class="warning">{reason}</p>')
    parts += [_cause(cause) for cause in diagnosis.causes]
    return "\n".join(parts)


def _cause(cause: Cause) -> str:
    rows = [
        (f"<code>{escape(name)}</code>", escape(estimate_words(value)), escape(estimate_for_people(value)))
        for name, value in cause.parameters.items()
    ]
    facts = [
        ("probability", percent(cause.probability)),
        ("p-value", p_words(cause.p_value)),
        ("closes", percent(cause.closed)),
        ("in the catalogue", f"{cause.effect}, {cause.where}"),
    ]
    listed = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in facts)
    title = cause_title(cause.effect, cause.where)
    parts = [
        f'<section class="cause"><h3>{escape(title[:1].upper() + title[1:])}</h3>',
        f'<p class="soft">{escape(formula(cause.effect))}</p>',
        f'<dl class="facts">{listed}</dl>',
        _table(("parameter", "value ± standard deviation", ""), rows),
    ]
    if cause.equivalent:
        others = "; ".join(cause_title(each["effect"], each["where"]) for each in cause.equivalent)
        parts.append(f"<p>The data cannot split it from: <b>{escape(others)}</b>.</p>")
    return "".join(parts) + "</section>"


def how_far(diagnosis: Diagnosis, residuals: GapResiduals) -> str:
    """The share of the gap that is gone, and the numbers by channel."""
    if diagnosis.closed is None:
        return ""
    unit = shown_units(residuals.recording.units)
    rows = []
    for name, row in diagnosis.channels.items():
        shown = unit[name]
        sizes = (row.noise_floor, row.rms_before, row.rms_after, row.gap_before, row.gap_after)
        rows.append((name, *(f"{shown.factor * size:.4g}" for size in sizes), percent(row.closed), shown.name))
    titles = ("channel", "floor", "RMS before", "RMS after", "gap before", "gap after", "closed", "unit")
    elsewhere = diagnosis.closed_elsewhere
    also = "" if elsewhere is None else f"<p>On the other maneuver: <b>{percent(elsewhere)}</b>.</p>"
    return "\n".join(
        [
            "<h2>How far it closes</h2>",
            '<p class="soft">Share of the squared gap that is gone once the causes are in the simulator, on '
            "held-out blocks, with its 95 % interval.</p>",
            _figure(charts.closed_bar(diagnosis), ""),
            also,
            _table(titles, [tuple(map(escape, row)) for row in rows], numbers=range(1, 7)),
        ]
    )


def calibration(diagnosis: Diagnosis) -> str:
    """What the gap had done to the calibration, the largest shift first."""
    shifts = sorted(diagnosis.calibration_shift.items(), key=lambda item: -abs(item[1]["sigmas"]))
    if not shifts:
        return ""
    heading = "<h2>What it had done to the calibration</h2>"
    shown = [item for item in shifts if abs(item[1]["sigmas"]) >= _WORTH_SIGMAS][:_SHIFTS]
    rest = len(shifts) - len(shown)
    if not shown:
        return f"{heading}\n<p>Nothing: all {rest} parameters stay within {_WORTH_SIGMAS:g} standard deviations.</p>"
    rows = []
    for name, shift in shown:
        difference = shift["before"] - shift["after"]
        cells = (_fixed(shift[key], difference) for key in ("before", "after"))
        rows.append((f"<code>{escape(name)}</code>", *cells))
    below = f"<p class='soft'>The other {rest} moved less.</p>" if rest else ""
    return "\n".join(
        [
            heading,
            '<p class="soft">Shift from the calibration with the gap modelled to the one without, in the standard '
            "deviations that noise alone gives.</p>",
            '<div class="pair even">',
            _figure(charts.shift_bars([(name, -shift["sigmas"]) for name, shift in shown]), ""),
            f"<div>{_table(('parameter', 'gap not modelled', 'gap modelled'), rows, numbers=(1, 2))}{below}</div>",
            "</div>",
        ]
    )


def _fixed(value: float, difference: float) -> str:
    """A number with as many decimals as show the difference."""
    decimals = 6 if difference == 0.0 else next((d for d in range(9) if abs(difference) * 10**d >= 9.5), 9)
    return f"{value:.{decimals}f}".replace("-", "−")


def remainder(diagnosis: Diagnosis) -> str:
    """What is left after the best explanation."""
    heading = "<h2>What is left</h2>"
    if diagnosis.remainder == "noise":
        return (
            f"{heading}\n<p>Noise. Tested against pose, direction of travel, time, level, frequency, distribution and "
            "the other channels: nothing stands out.</p>"
        )
    if not diagnosis.remainder_follows:
        return f"{heading}\n<p>More than noise, without a pattern that could be told.</p>"
    return (
        f"{heading}\n<p>More than noise. It follows:</p>\n"
        f"{_figure(charts.follow_bars(diagnosis.remainder_follows), 'Relative to the strongest test.')}"
    )


def untold(diagnosis: Diagnosis) -> str:
    """The effects that this recording cannot show, by the reason."""
    if not diagnosis.cannot_tell:
        return ""
    groups = grouped_untold(diagnosis.cannot_tell)
    listed = "".join(
        f"<dt>{escape(why[:1].upper() + why[1:])}</dt><dd>{escape(', '.join(effects))}</dd>"
        for why, effects in groups.items()
    )
    return (
        "<h2>What this recording cannot tell</h2>\n"
        '<p class="soft">These may be there all the same; no analysis of this recording can see them.</p>\n'
        f'<dl class="reasons">{listed}</dl>'
    )


def next_step(diagnosis: Diagnosis) -> str:
    """The maneuver that would tell more, and how far it separates each pair of causes."""
    step = diagnosis.next
    if not step:
        return ""
    parts = ["<h2>What to do next</h2>", f"<p>{escape(str(step['why']))}</p>"]
    if step.get("maneuver"):
        parts.append(f"<p><b>{escape(_sentence(str(step['maneuver'])))}</b></p>")
    if step.get("scenario"):
        name = escape(str(step["scenario"]))
        parts.append(f"<p>To simulate it: <code>rig sweep {name} -o RUN.parquet</code></p>")
    rows = [
        (
            *(escape(cause_title(pair[key]["effect"], pair[key]["where"])) for key in ("truth", "rival")),
            interval_words(pair["chi_square"], pair["low"], pair["high"]),
            f"{pair['recorded_maneuver']:.1f}",
        )
        for pair in step.get("separates", ())
    ]
    if rows:
        titles = ("if this is true", "this fits worse", "by a chi-square of", "on the recorded maneuver")
        parts.append(_table(titles, rows, numbers=(2, 3)))
    return "\n".join(parts)


def _sentence(words: str) -> str:
    return words[:1].upper() + words[1:] + "."


def _figure(drawing: str, caption: str) -> str:
    words = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f"<figure>{drawing}{words}</figure>"


def _key(items: Iterable[tuple[str, str]]) -> str:
    return '<ul class="key">' + "".join(f'<li class="k-{css}">{escape(words)}</li>' for words, css in items) + "</ul>"


def _table(titles: Sequence[str], rows: Iterable[Sequence[str]], numbers: Iterable[int] = ()) -> str:
    """A table; the cells are HTML already, columns in ``numbers`` are aligned to the right."""
    right = set(numbers)

    def cells(tag: str, values: Sequence[str]) -> str:
        kinds = [' class="n"' if index in right else "" for index in range(len(values))]
        return "".join(f"<{tag}{kind}>{value}</{tag}>" for kind, value in zip(kinds, values, strict=True))

    body = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    return f"<table><thead><tr>{cells('th', titles)}</tr></thead><tbody>{body}</tbody></table>"
