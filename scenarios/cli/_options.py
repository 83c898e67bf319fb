"""What several commands share: options, their types, checks of output files, JSON and the progress bar."""

from __future__ import annotations

import json
import math
import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

import click

from rig.documents import plain
from rig.errors import RigError, check_name, nearest, one_line, shown
from rig.files import check_not_input, check_writable
from rig.memory import VARIABLE, WHERE, parsed
from rig.progress import Progress, unheard

if TYPE_CHECKING:
    from rich.console import RenderableType

    from rig.arm import Arm
    from scenarios.scenario import Scenario

Command = TypeVar("Command", bound=Callable[..., Any])

PATH: Final = click.Path(path_type=Path)
RECORDING_SUFFIXES: Final = (".parquet", ".csv")
_PATIENCE_S: Final = 2.0


class Choice(click.Choice[str]):
    """A choice whose error names the nearest one."""

    def get_invalid_choice_message(self, value: Any, ctx: click.Context | None) -> str:
        """What was found, what was expected and the nearest of it."""
        return f"found {shown(value)}, expected one of {', '.join(self.choices)}{nearest(str(value), self.choices)}"


def number(text: str) -> float:
    """The number that a text says; NaN where it says none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def numbers(text: str) -> list[float]:
    """The numbers between commas; none where one of them is no number."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        return []


class FiniteNumber(click.FloatRange):
    """A number within a range; "nan" is in none, whatever it is compared with."""

    def _describe_range(self) -> str:
        """The range, for the help; of a number without bounds what it is."""
        return "a number" if self.min is None and self.max is None else super()._describe_range()

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The number."""
        found = super().convert(value, param, ctx)
        if not math.isfinite(found):
            self.fail(f"found {value!r}, expected a finite number", param, ctx)
        return found


POSITIVE: Final = FiniteNumber(min=0.0, min_open=True)


def json_option(command: Command) -> Command:
    """``--json``: one JSON document on stdout, and nothing else there."""
    return click.option("--json", "as_json", is_flag=True, help="One JSON document on stdout, for machines.")(command)


def print_json(document: Any) -> None:
    """Print a document as JSON; not-a-number becomes null."""
    content = plain(document)
    text = json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False)
    try:
        text.encode(sys.stdout.encoding or "utf-8")
    except UnicodeEncodeError:  # an ASCII terminal, or a name that is not UTF-8
        text = json.dumps(content, indent=1, allow_nan=False)
    click.echo(text)


def answer(as_json: bool, found: Any, report: Callable[[Any], RenderableType], *written: Path | None) -> None:
    """Say what was found: as JSON, or as its report and a line for each file that was written."""
    if as_json:
        print_json(found)
        return
    from scenarios.terminal.tables import show

    show(report(found))
    tell_written(*written)


def tell_written(*files: Path | None) -> None:
    """A line for each file that was written, below what was found."""
    if lines := [f"{file}: written" for file in files if file is not None]:
        click.echo("\n".join(["", *lines]))


def tell(*lines: str) -> None:
    """A line each on stderr, of those that say anything."""
    for line in filter(None, lines):
        click.echo(f"rig: {one_line(line)}", err=True)


def check_output(path: Path | None, suffixes: Sequence[str], *inputs: Path | None) -> None:
    """Refuse, before any work, a file that could not be written at the end, or that is read; None: none is asked for.

    Raises:
        RigError: another suffix, a folder, a folder that is missing or not writable, or one of ``inputs``.
    """
    if path is None:
        return
    if path.suffix not in suffixes:
        near = nearest(path.suffix, suffixes)
        raise RigError(f"{path}: found suffix {shown(path.suffix)}, expected {' or '.join(suffixes)}{near}")
    check_writable(path)
    check_not_input(path, *inputs)


def check_picture(path: Path | None, *inputs: Path | None) -> None:
    """The same of a picture."""
    check_output(path, (".png", ".svg", ".pdf"), *inputs)


def memory_option(command: Command) -> Command:
    """``--memory``: what may be taken, by this process and those that it starts."""

    def state(context: click.Context, option: click.Parameter, value: str | None) -> None:
        WHERE.set(f"--memory or {VARIABLE}")
        if value is not None:
            parsed(value, "--memory")
            os.environ[VARIABLE] = value

    text = "Memory to take at most, such as 2G; half of what is free by default. Longer recordings are thinned."
    return click.option("--memory", metavar="SIZE", callback=state, expose_value=False, help=text)(command)


@contextmanager
def progress_bar(title: str) -> Iterator[Progress]:
    """A bar on stderr for what takes over two seconds; on a terminal only.

    Yields:
        What to call with the share done, 0 to 1; without a call the bar just moves.
    """
    if not sys.stderr.isatty():
        yield unheard
        return
    import rich.console
    import rich.progress

    console = rich.console.Console(stderr=True)
    bar = rich.progress.Progress(console=console, transient=True, redirect_stdout=False, redirect_stderr=False)
    task = bar.add_task(title, total=None)
    timer = threading.Timer(_PATIENCE_S, bar.start)
    timer.daemon = True
    timer.start()
    try:
        yield lambda share: bar.update(task, total=1.0, completed=share)
    finally:
        timer.cancel()
        timer.join()
        bar.stop()


def counted(progress: Progress, rows: int | None) -> Callable[[int], None]:
    """From samples done to the share of all; nothing where their number is not known beforehand."""
    done = 0

    def count(samples: int) -> None:
        nonlocal done
        done += samples
        if rows:
            progress(done / rows)

    return count


def processes_option(name: str, least: int, text: str) -> Callable[[Command], Command]:
    """``--jobs`` and ``--workers``, which are one option: on how many processes of this machine.

    Args:
        name: "jobs" or "workers": the argument's, and the option that help shows first.
        least: the fewest there may be. text: of the help.
    """
    other = "workers" if name == "jobs" else "jobs"
    return click.option(f"--{name}", f"--{other}", name, type=click.IntRange(min=least), metavar="N", help=text)


def cluster_option(command: Command) -> Command:
    """``--cluster``: a Dask scheduler."""
    text = "A Dask cluster that is there already."
    return click.option("--cluster", metavar="tcp://HOST:PORT", help=text)(command)


def arm_options(command: Command) -> Command:
    """``--arm`` and ``--tip``: the user's own arm."""
    tip = click.option(
        "--tip", metavar="LINK", help="What carries the sensor: a link, of an MJCF a site or body; the arm's end else."
    )
    file = click.option(
        "--arm",
        "arm_file",
        type=PATH,
        metavar="FILE",
        help="Another arm than the A465: URDF, MJCF or a folder with one.",
    )
    return file(tip(command))


def without_locked(runs: Sequence[Path]) -> list[Path]:
    """The recordings without those that are another's locked one, as a pattern like *.parquet names both."""
    stems = {run.with_name(run.stem) for run in runs}
    return [run for run in runs if not run.stem.endswith(".locked") or run.with_name(run.stem[:-7]) not in stems]


class _ManeuverOption(click.Option):
    """Lists the maneuvers where its help is asked for: they need NumPy, which is not imported before."""

    @property
    def help(self) -> str | None:
        from rig.maneuver import MANEUVERS

        return f"Another maneuver than the scenario's, made to fit the arm: {', '.join(MANEUVERS)}."

    @help.setter
    def help(self, text: str | None) -> None:
        """Click's own, which is none."""


def maneuver_option(command: Command) -> Command:
    """``--maneuver``: another kind of maneuver, made to fit the arm."""
    return click.option("--maneuver", "kind", metavar="KIND", cls=_ManeuverOption)(command)


def on_arm(scenario: Scenario, arm_file: Path | None, tip: str | None, kind: str | None) -> Scenario:
    """A scenario on the arm of ``--arm`` and ``--tip``, with the maneuver of ``--maneuver``.

    Raises:
        RigError: the arm cannot be used, or cannot make the maneuver.
    """
    from rig.maneuver import MANEUVERS

    if kind is not None:
        check_name("maneuver", kind, MANEUVERS)
    arm = chosen_arm(arm_file, tip)
    if arm is None and (kind is None or kind == scenario.kind):
        return scenario
    arm = arm or scenario.rig.arm
    if arm is None:
        raise RigError(f"--maneuver: scenario {scenario.name} has no arm, expected --arm FILE")
    return scenario.with_arm(arm, kind)


def chosen_arm(arm_file: Path | None, tip: str | None) -> Arm | None:
    """The arm of ``--arm`` and ``--tip``; None where neither is given.

    Raises:
        RigError: a tip without an arm, or the file cannot be used.
    """
    if arm_file is None:
        if tip is not None:
            raise RigError(f"--tip: found {tip!r} without --arm, expected the file of the arm that has it")
        return None
    from rig.arm import Arm

    return Arm.from_file(arm_file, tip)
