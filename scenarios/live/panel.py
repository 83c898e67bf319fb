"""A session in the terminal: a panel that is drawn anew, or, where the output is no terminal, a line now and then."""

from __future__ import annotations

import re
import sys
import time
from collections import deque
from typing import Final

import numpy as np
from rich import box
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from estimators.live import SensorState
from estimators.live.watch import Watch
from rig.errors import one_line
from scenarios.live.session import Display, Event, Session
from scenarios.terminal.tables import table

#: A panel is drawn, and a line is written, this often at most [s].
_PANEL_S: Final = 0.1
_LINE_S: Final = 10.0
_SHOWN: Final = 5
_BAR: Final = 20
#: Where the reason begins in the words of a problem.
_WHY: Final = re.compile(r" \(|[:;]")


def compact(session: Session) -> str:
    """One line: samples, coverage, worst interval, what to turn next, enough or not."""
    parts = [f"{session.t_s:.1f} s", f"{session.samples:,} samples"]
    for state in session.states:
        parts.append(f"{state.sensor}: {_standing(state)}")
    if not session.states and session.watch is not None:
        parts += [f"{name}: {'ALARM' if one.alarmed else 'ok'}" for name, one in session.watch.sensors.items()]
    if guidance := session.guidance:
        parts.append(guidance)
    return ", ".join(parts)


def _standing(state: SensorState) -> str:
    if state.estimate is None or state.rule is None:
        return f"{_problem(state)}; {state.turn}"
    seen = f"{100.0 * state.seen:.0f} % seen"
    if not state.estimate.told:
        return f"{seen}, {_problem(state)}; {state.turn}"
    widest = f"{seen}, {state.rule.worst} ±{_percent(state.interval)}"
    return f"{widest}, enough" if state.enough else f"{widest}; {state.turn}"


def _problem(state: SensorState) -> str:
    """What stands in the way, without why."""
    return _WHY.split(state.problem or "", maxsplit=1)[0]


def _percent(value: float) -> str:
    return f"{100.0 * value:.2g} %" if np.isfinite(value) else "?"


class Lines(Display):
    """Events as they come and a line every ten seconds, on stderr."""

    def __init__(self) -> None:
        """Nothing was shown yet."""
        self._at = -np.inf

    def show(self, session: Session) -> None:
        """A line, if it is time for one."""
        if time.monotonic() - self._at >= _LINE_S:
            self._at = time.monotonic()
            print(one_line(compact(session)), file=sys.stderr, flush=True)

    def event(self, event: Event) -> None:
        """A line."""
        print(one_line(str(event)), file=sys.stderr, flush=True)


class TerminalPanel(Display):
    """A panel on stderr."""

    def __init__(self, source: str) -> None:
        """Args: source: its name."""
        self._source = source
        self._events: deque[Event] = deque(maxlen=_SHOWN)
        self._at = -np.inf
        self._last: Session | None = None
        console = Console(stderr=True, highlight=False, emoji=False)
        self._live = Live(console=console, auto_refresh=False, redirect_stdout=False, redirect_stderr=False)
        self._live.start()

    def show(self, session: Session) -> None:
        """Draw it, if it is time."""
        self._last = session
        if time.monotonic() - self._at >= _PANEL_S:
            self._draw()

    def event(self, event: Event) -> None:
        """Among the last ones."""
        self._events.append(event)
        self._draw()

    def close(self) -> None:
        """Leave the last state on the screen."""
        self._draw()
        self._live.stop()

    def _draw(self) -> None:
        self._at = time.monotonic()
        self._live.update(panel(self._source, self._last, list(self._events)), refresh=True)


def panel(source: str, session: Session | None, events: list[Event]) -> Panel:
    """The whole panel."""
    parts: list[RenderableType] = []
    if session is None:
        parts.append(Text("waiting for samples", style="dim"))
    else:
        rate = f" at {session.rate_Hz:.4g} Hz" if np.isfinite(session.rate_Hz) else ""
        left = f", {session.left_out:,} left out" if session.left_out else ""
        parts.append(Text(f"{session.samples:,} samples{rate}, up to {session.t_s:.1f} s{left}"))
        if session.states:
            parts.append(_table(session.states))
            parts += [Text(f"{s.sensor}: {s.problem}", style="yellow") for s in session.states if s.problem]
        if guidance := session.guidance:
            parts.append(Text(guidance, style="bold cyan"))
        if session.watch is not None:
            parts.append(_watched(session.watch))
    parts += [Text(str(event), style="bold red" if event.alarm else "dim") for event in events]
    done = session is not None and bool(session.states) and all(state.enough for state in session.states)
    title = f" {source}: {'ENOUGH' if done else 'live'} "
    return Panel(Group(*parts), title=title, border_style="green" if done else "blue", box=box.ROUNDED)


def _table(states: tuple[SensorState, ...]) -> Table:
    rows: list[tuple[str | Text, ...]] = []
    for state in states:
        filled = round(_BAR * state.seen)
        bar = Text("█" * filled, style="green").append("░" * (_BAR - filled), style="dim")
        bar.append(f" {100.0 * state.seen:.0f} %", style="default")
        worst = "" if state.rule is None else state.rule.worst
        next_turn = Text("enough", style="bold green") if state.enough else Text(state.turn, style="bold")
        rows.append((state.sensor, bar, f"±{_percent(state.interval)}", worst, next_turn))
    return table("sensor", "directions seen", "widest interval", "of", "next", rows=rows)


def _watched(watch: Watch) -> Text:
    text = Text(f"monitor, {watch.alarms_a_day:g} false alarm{'s' if watch.alarms_a_day != 1 else ''} a day at most: ")
    for place, (name, one) in enumerate(watch.sensors.items()):
        text.append(", " if place else "")
        if one.alarmed is not None:
            text.append(f"{name} ALARM since {one.alarmed.since_s:.1f} s", style="bold red")
        elif one.reference is None:
            text.append(f"{name} not calibrated yet", style="dim")
        else:
            text.append(f"{name} ok", style="green")
    return text
