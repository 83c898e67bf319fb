"""What the pages are made of: a document that needs nothing else, with tiles, tables and figures."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from html import escape
from itertools import count
from pathlib import Path
from typing import Final

from scenarios.gap_report.words import VERDICTS

#: A command within a sentence.
_COMMAND: Final = re.compile(
    r"rig [a-z]+(?: (?:[A-Z]{3,}(?:\.\w+)?|--(?:arm|tip) (?:&#x27;.*?&#x27;|\S+)|--?[a-z-]+|[\w/-]+\.\w+))+"
)
#: Nothing may be loaded from anywhere; the style is the page's own.
_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"


def document(title: str, parts: Iterable[str]) -> str:
    """An HTML file with the pages' style, of what stands in it."""
    body = _own_names("\n".join(part for part in parts if part))
    style = Path(__file__).with_name("page.css").read_text(encoding="utf-8")
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{style}</style>\n</head>\n<body>\n<main>\n"
        f"{body}\n</main>\n</body>\n</html>\n"
    )


def _own_names(body: str) -> str:
    """What drawings refer to gets a name that no other drawing has: alike parts of two have the same."""
    number = count(1)

    def own(drawing: re.Match[str]) -> str:
        mark = f"d{next(number)}-"
        return re.sub(r'( id="|href="#|url\(#)', rf"\g<1>{mark}", drawing[0])

    return re.sub(r"<svg.*?</svg>", own, body, flags=re.DOTALL)


def tiles(items: Iterable[tuple[str, str, str]]) -> str:
    """The figures at the top of a page: a name, a value and a note each."""
    made = (
        f'<div class="tile"><dt>{escape(name)}</dt><dd>{escape(value)}<small>{escape(note)}</small></dd></div>'
        for name, value, note in items
    )
    return f'<dl class="tiles">{"".join(made)}</dl>'


def with_commands(words: str) -> str:
    """Words as HTML, with the commands among them set apart; no option is broken after its dashes."""

    def command(found: re.Match[str]) -> str:
        return f"<code>{' '.join(f'<span>{part}</span>' for part in found[0].split(' '))}</code>"

    return _COMMAND.sub(command, escape(words))


def badge(verdict: str) -> str:
    """A verdict in its colour."""
    return f'<span class="badge {verdict}">{VERDICTS[verdict]}</span>'


def figure(drawing: str, caption: str = "", wide: bool = False) -> str:
    """A drawing with what it shows; on a narrow screen one that is ``wide`` says that it goes on to the right."""
    words = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    kind = ' class="wide"' if wide else ""
    return f"<figure{kind}>{drawing}{words}</figure>"


def bar(words: str, told: str, share: float, css: str, ends: tuple[float, float] | None = None) -> str:
    """A share of one as a bar below its words and its value; ``ends``: of its interval."""
    left, right = (100.0 * min(max(each, 0.0), 1.0) for each in ends or (0.0, 0.0))
    whisker = f'<i style="left:{left:.1f}%;width:{right - left:.1f}%"></i>' if ends else ""
    width = 100.0 * min(max(share, 0.0), 1.0)
    return (
        f"<dt>{escape(words)}</dt><dd>{escape(told)}</dd>"
        f'<dd class="bar"><b class="{css}" style="width:{width:.1f}%"></b>{whisker}</dd>'
    )


def bars(made: Iterable[str], label: str) -> str:
    """Bars below each other; they are as wide as the screen lets them be."""
    return f'<dl class="bars" aria-label="{escape(label)}">{"".join(made)}</dl>'


def key(items: Iterable[tuple[str, str]]) -> str:
    """The key of a drawing: words, and the style that they stand for."""
    return '<ul class="key">' + "".join(f'<li class="k-{css}">{escape(words)}</li>' for words, css in items) + "</ul>"


def table(titles: Sequence[str], rows: Iterable[Sequence[str]], numbers: Iterable[int] = ()) -> str:
    """A table; the cells are HTML already, columns in ``numbers`` are aligned to the right."""
    right = set(numbers)

    def cells(tag: str, values: Sequence[str]) -> str:
        kinds = [' class="n"' if index in right else "" for index in range(len(values))]
        return "".join(f"<{tag}{kind}>{value}</{tag}>" for kind, value in zip(kinds, values, strict=True))

    body = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    return f"<table><thead><tr>{cells('th', [*map(escape, titles)])}</tr></thead><tbody>{body}</tbody></table>"
