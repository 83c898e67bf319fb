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
from rig.recording import Recording
from scenarios.live.session import Event, Snapshot

#: A panel is drawn, and a line is written, this often at most [s].
_PANEL_S: Final = 0.1
_LINE_S: Final = 10.0
_SHOWN: Final = 5
_BAR: Final = 20
#: Where the reason begins in the words of a problem.
_WHY: Final = re.compile(r" \(|[:;]")


def compact(snapshot: Snapshot) -> str:
    """One line: samples, coverage, worst interval, what to turn next, enough or not."""
    parts = [f"{snapshot.t_s:.1f} s", f"{snapshot.samples:,} samples"]
    for state in snapshot.states:
        parts.append(f"{state.sensor}: {_standing(state)}")
    if not snapshot.states and snapshot.watch is not None:
        parts += [f"{name}: {'ALARM' if one.alarmed else 'ok'}" for name, one in snapshot.watch.sensors.items()]
    if snapshot.guide:
        parts.append(snapshot.guide)
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


class Lines:
    """Events as they come and a line every ten seconds, on stderr."""

    def __init__(self) -> None:
        """Nothing was shown yet."""
        self._at = -np.inf

    def samples(self, batch: Recording) -> None:
        """Nothing to show."""

    def show(self, snapshot: Snapshot) -> None:
        """A line, if it is time for one."""
        if time.monotonic() - self._at >= _LINE_S:
            self._at = time.monotonic()
            print(one_line(compact(snapshot)), file=sys.stderr, flush=True)

    def event(self, event: Event) -> None:
        """A line."""
        print(one_line(str(event)), file=sys.stderr, flush=True)

    def close(self) -> None:
        """Nothing to end."""


class TerminalPanel:
    """A panel on stderr."""

    def __init__(self, source: str) -> None:
        """Args: source: its name."""
        self._source = source
        self._events: deque[Event] = deque(maxlen=_SHOWN)
        self._at = -np.inf
        self._last: Snapshot | None = None
        console = Console(stderr=True, highlight=False, emoji=False)
        self._live = Live(console=console, auto_refresh=False, redirect_stdout=False, redirect_stderr=False)
        self._live.start()

    def samples(self, batch: Recording) -> None:
        """Nothing to show before the estimates are brought up to date."""

    def show(self, snapshot: Snapshot) -> None:
        """Draw it, if it is time."""
        self._last = snapshot
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


def panel(source: str, snapshot: Snapshot | None, events: list[Event]) -> Panel:
    """The whole panel."""
    parts: list[RenderableType] = []
    if snapshot is None:
        parts.append(Text("waiting for samples", style="dim"))
    else:
        rate = f" at {snapshot.rate_Hz:.4g} Hz" if np.isfinite(snapshot.rate_Hz) else ""
        left = f", {snapshot.left_out:,} left out" if snapshot.left_out else ""
        parts.append(Text(f"{snapshot.samples:,} samples{rate}, up to {snapshot.t_s:.1f} s{left}"))
        if snapshot.states:
            parts.append(_table(snapshot.states))
            parts += [Text(f"{s.sensor}: {s.problem}", style="yellow") for s in snapshot.states if s.problem]
        if snapshot.guide:
            parts.append(Text(snapshot.guide, style="bold cyan"))
        if snapshot.watch is not None:
            parts.append(_watched(snapshot.watch))
    parts += [Text(str(event), style="bold red" if event.alarm else "dim") for event in events]
    done = snapshot is not None and bool(snapshot.states) and all(state.enough for state in snapshot.states)
    title = f" {source}: {'ENOUGH' if done else 'live'} "
    return Panel(Group(*parts), title=title, border_style="green" if done else "blue", box=box.ROUNDED)


def _table(states: tuple[SensorState, ...]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False)
    for column in ("sensor", "directions seen", "widest interval", "of", "next"):
        table.add_column(column, no_wrap=column != "next")
    for state in states:
        filled = round(_BAR * state.seen)
        bar = Text("█" * filled, style="green").append("░" * (_BAR - filled), style="dim")
        bar.append(f" {100.0 * state.seen:.0f} %", style="default")
        worst = "" if state.rule is None else state.rule.worst
        next_turn = Text("enough", style="bold green") if state.enough else Text(state.turn, style="bold")
        table.add_row(state.sensor, bar, f"±{_percent(state.interval)}", worst, next_turn)
    return table


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
