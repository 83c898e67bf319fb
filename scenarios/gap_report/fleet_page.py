"""A fleet on one page and on the terminal."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Final
from urllib.parse import quote

from rich.console import Group
from rich.text import Text

from estimators.gap.choices import and_words
from estimators.gap.share_words import chance
from rig.files import made_folder, write_text
from scenarios.diagnosing.fleet import Entry, History, fleet_csv, fleet_json, histories, in_order
from scenarios.gap_report import html
from scenarios.gap_report.own_names import in_own_names
from scenarios.gap_report.words import VERDICTS, cause_or_alike, cause_title, share_words
from scenarios.terminal.tables import table

_SIGN: Final = '<i class="k-{0}" title="{0}" aria-label="{0}" role="img"></i>'


def fleet_page(entries: Sequence[Entry]) -> str:
    """One HTML file that needs nothing else; the recordings' own pages lie beside it."""
    entries = _in_own_names(entries)
    ordered, told = in_order(entries), histories(entries)
    arms = list(dict.fromkeys(entry.arm for entry in ordered if entry.about is not None))
    parts = [
        f'<p class="kicker">{_number(len(ordered), "recording")} of {_number(len(arms), "arm")}</p>',
        f"<h1>{escape(_headline(told, arms))}</h1>",
        _tiles(ordered),
        "<h2>Which cause, on which arm, since when</h2>",
        html.table(_HEADER, [[escape(cell) for cell in row] for row in _rows(told)])
        if told
        else "<p>No recording shows a cause.</p>",
        _picture(told) if told else "",
        "<h2>All recordings</h2>",
        _recordings(ordered),
    ]
    return html.document("Fleet: which cause on which arm since when", parts)


def _in_own_names(entries: Sequence[Entry]) -> list[Entry]:
    return [
        entry if entry.diagnosis is None else replace(entry, diagnosis=in_own_names(entry.diagnosis))
        for entry in entries
    ]


def _headline(told: Sequence[History], arms: Sequence[str]) -> str:
    now = {each.arm for each in told if each.now}
    if not now:
        return f"No cause on {'the arm' if len(arms) == 1 else f'any of {len(arms)} arms'} now"
    return f"A cause on {'the arm' if len(arms) == 1 else f'{len(now)} of {len(arms)} arms'} now"


def _number(count: int, what: str) -> str:
    return f"{count:,} {what}" + ("" if count == 1 else "s")


def _tiles(entries: Sequence[Entry]) -> str:
    verdicts = Counter("failed" if entry.diagnosis is None else entry.diagnosis.verdict for entry in entries)
    words = {**VERDICTS, "failed": "Without a diagnosis"}
    return html.tiles((words[name], f"{verdicts[name]:,}", f"of {len(entries):,}") for name in words if verdicts[name])


def _title(history: History) -> str:
    return " or ".join(cause_title(*name) for name in history.names[:3]) + (" or others" * (len(history.names) > 3))


def _moment(entry: Entry) -> str:
    return f"{entry.recorded} ({entry.name})" if entry.recorded else entry.name


def _rows(told: Sequence[History]) -> list[tuple[str, str, str, str, str]]:
    """Arm, cause, since, last without, in how many of those that could tell."""
    return [
        (
            each.arm,
            f"{_title(each)} ({'now' if each.now else 'gone again'})",
            _moment(each.since),
            _before(each),
            f"{each.seen.count('found')} of {sum(seen != 'open' for seen in each.seen)}",
        )
        for each in told
    ]


def _before(history: History) -> str:
    if history.before is not None:
        return _moment(history.before)
    return "none: it is the first" if history.entries[0] is history.since else "none could tell"


_HEADER: Final = ("arm", "cause", "since", "last recording without it", "found in")


def _picture(told: Sequence[History]) -> str:
    rows = [(escape(f"{each.arm}: {_title(each)}"), "".join(map(_SIGN.format, each.seen))) for each in told]
    boxes = html.table(("arm and cause", "its recordings, from the first one on"), rows)
    signs = html.key([("found", "found"), ("looked for and not found", "absent"), ("could not tell", "open")])
    return html.figure(
        f'<div class="fleet">{boxes}</div>{signs}',
        "One box a recording of the arm, from its first one on. A cause has been found where its probability is .5 or "
        "more; a recording with something unexplained does not say that a cause is not there.",
    )


def _recordings(entries: Sequence[Entry]) -> str:
    rows = []
    for entry in entries:
        row = [escape(entry.arm), escape(entry.recorded)]
        found = entry.diagnosis
        if found is None:
            rows.append([*row, escape(entry.name), "–", escape(entry.error), ""])
            continue
        causes = [f"{cause_or_alike(cause)}: {chance(cause.probability)}" for cause in entry.causes]
        link = f'<a href="{quote(f"{entry.name}.html")}">{escape(entry.name)}</a>'
        rows.append(
            [*row, link, html.badge(found.verdict), "<br>".join(map(escape, causes)), escape(share_words(found.closed))]
        )
    return html.table(("arm", "recorded", "recording", "verdict", "causes", "closed"), rows)


def fleet_tables(entries: Sequence[Entry]) -> Group:
    """The same for the terminal: which cause on which arm since when, then one line a verdict."""
    told = histories(_in_own_names(entries))
    verdicts = Counter(entry.diagnosis.verdict for entry in entries if entry.diagnosis is not None)
    counts = and_words([f"{count} {VERDICTS[name].lower()}" for name, count in verdicts.most_common()])
    listed = [table(*_HEADER, rows=_rows(told))] if told else []
    return Group(*listed, Text(f"\n{_number(sum(verdicts.values()), 'recording')}: {counts}"))


def write_fleet(entries: Sequence[Entry], out: Path) -> tuple[Path, Path, Path]:
    """Write ``fleet.csv``, ``fleet.json`` and ``fleet.html`` into a folder.

    Raises:
        RigError: a file cannot be written.
    """
    made = (out / "fleet.csv", out / "fleet.json", out / "fleet.html")
    texts = (fleet_csv(entries), json.dumps(fleet_json(entries), indent=1, allow_nan=False) + "\n", fleet_page(entries))
    with made_folder(out):
        for path, text in zip(made, texts, strict=True):
            write_text(path, text)
    return made
