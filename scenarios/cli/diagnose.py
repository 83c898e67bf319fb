"""``rig diagnose``: where a recording disagrees with the rig, which effect causes it, how far the gap closes."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rig.errors import RigError, one_line, unknown_name
from scenarios.cli._options import (
    PATH,
    arm_options,
    check_output,
    chosen_arm,
    json_option,
    memory_option,
    print_json,
    progress_bar,
    without_locked,
)

if TYPE_CHECKING:
    from scenarios.gap_report.batch import Outcome, Task


@click.command(short_help="Name what causes a recording's sim-to-real gap.")
@click.argument("runs", type=PATH, nargs=-1, required=True, metavar="RUN...")
@click.option("--locked", type=PATH, metavar="F", help="Locked-arm recording, for the noise floor.")
@click.option("--maneuver2", type=PATH, metavar="F", help="Another maneuver of the same rig, to judge the causes on.")
@click.option("--without", multiple=True, metavar="EFFECT", help="Leave an effect out of the catalogue; repeatable.")
@click.option("--prior", type=PATH, metavar="F.toml", help="Weights of the effects that this arm is prone to.")
@arm_options
@click.option("--jobs", type=click.IntRange(min=1), metavar="N", help="Processes; one for each processor by default.")
@click.option("--save-scenario", "saved", type=PATH, metavar="F.toml", help="Write the improved rig, for rig sweep.")
@click.option(
    "--minutes",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="M",
    help="For the next maneuver; as long as RUN by default.",
)
@click.option("--out", type=PATH, default="diagnosis", metavar="DIR", help="For the results; ./diagnosis by default.")
@memory_option
@json_option
def diagnose(
    runs: tuple[Path, ...],
    locked: Path | None,
    maneuver2: Path | None,
    without: tuple[str, ...],
    prior: Path | None,
    arm_file: Path | None,
    tip: str | None,
    jobs: int | None,
    saved: Path | None,
    minutes: float | None,
    out: Path,
    as_json: bool,
) -> int:
    """Say where each RUN disagrees with the rig, which effects cause it, how probable that is, and what to do next.

    Each gets DIR/NAME.diagnosis.json and DIR/NAME.html, a page to look at. A RUN.locked.parquet beside RUN.parquet is
    taken as its noise floor. Where the data do not decide between explanations, DIR/NAME.next.toml is the maneuver
    that would, within the joints' limits and M minutes. --prior F.toml has a table [effects] of relative weights,
    such as backlash = 5; 1 is the default, 0 leaves an effect out. Several RUNs are done in parallel; a bad one does
    not stop the others.

    \b
    Example:
      rig diagnose run.parquet
      rig diagnose lab/*.parquet --out reports --jobs 2
      rig diagnose run.parquet --prior our-arm.toml
      rig diagnose run.parquet --save-scenario improved.toml && rig sweep improved.toml -o again.parquet
    """
    chosen = without_locked(runs)
    _check(chosen, without, saved, out, [path for path in (locked, maneuver2, prior, arm_file) if path is not None])
    from estimators.gap.prior import read_prior
    from rig.recording import scan_recording
    from scenarios.gap_report.batch import Outcome, Task, outcomes
    from scenarios.workers import Workers

    weights = None if prior is None else read_prior(prior)
    arm = chosen_arm(arm_file, tip)
    for path in (locked, maneuver2):  # a file for all recordings is not to be refused once for each
        if path is not None:
            scan_recording(path, joints=None if arm is None else arm.dof)
    workers = Workers(jobs)
    together = workers.at_once(len(chosen))
    tasks = [
        Task(run, locked, maneuver2, without, arm_file, tip, saved is not None, minutes, together, weights)
        for run in chosen
    ]
    _tell_averaged(tasks)
    found: dict[int, Outcome | Exception] = {}
    words = str(chosen[0]) if len(chosen) == 1 else f"{len(chosen)} recordings"
    with progress_bar(f"diagnosing {words}") as progress:
        for number, result in outcomes(tasks, workers, progress):
            if isinstance(result, Outcome):
                _write(result, out, saved)
            elif _debugging() or (len(tasks) == 1 and not isinstance(result, RigError)):
                raise result
            elif len(tasks) == 1:
                raise type(result)(_words(tasks[0], result))
            found[number] = result
    results = [found[number] for number in range(len(tasks))]
    if as_json:
        documents = [_document(task, result) for task, result in zip(tasks, results, strict=True)]
        print_json(documents[0] if len(documents) == 1 else documents)
    else:
        _tell([result for result in results if isinstance(result, Outcome)], out, saved)
    return max(_failures(tasks, results), _unsaved(results, saved))


def _tell_averaged(tasks: Sequence[Task]) -> None:
    """One line for each recording that is too long for the memory."""
    from rig.recording import block_length, scan_recording
    from scenarios.gap_report.batch import BYTES_A_SAMPLE, BYTES_ANYWAY

    for task in tasks:
        with suppress(RigError, OSError):  # which its own turn will tell
            together = task.together
            block = block_length(scan_recording(task.run), BYTES_A_SAMPLE * together, BYTES_ANYWAY * together)
            if block > 1:
                words = (
                    f"{task.run}: means over blocks of {block} samples are diagnosed, as memory allows no more: what is"
                    " faster, such as mains hum, and single spoilt readings cannot be seen (--memory)"
                )
                click.echo(one_line(words), err=True)


def _check(runs: Sequence[Path], without: Sequence[str], saved: Path | None, out: Path, others: Sequence[Path]) -> None:
    """Refuse, before any work, what could not end well.

    Args:
        others: what is read beside the recordings.
    """
    from rig.effects import EFFECTS
    from rig.recording import locked_beside

    for name in without:
        if name not in EFFECTS:
            raise unknown_name("effect", name, EFFECTS)
    named: dict[str, Path] = {}
    for run in runs:
        if run.stem in named:
            raise RigError(
                f"{run}: found the name {run.stem!r} again after {named[run.stem]}, expected different names"
            )
        named[run.stem] = run
    if saved is not None:
        check_output(saved, (".toml",), *runs, *map(locked_beside, runs), *others)
        if len(runs) > 1:
            raise RigError(f"--save-scenario: found {len(runs)} recordings, expected one, whose rig it is")
    existing = next(folder for folder in (out, *out.absolute().parents) if folder.exists())
    if not existing.is_dir():
        raise RigError(f"{out}: {existing} is a file, expected a folder for the results")
    if not os.access(existing, os.W_OK):
        raise RigError(f"{out}: folder {existing} cannot be written to")
    for run in runs:
        for written in _outputs(run.stem, out) if out.is_dir() else ():
            check_output(written, (written.suffix,), run, locked_beside(run), *others)
            if saved is not None and saved.absolute() == written.absolute():
                raise RigError(f"--save-scenario {saved}: is the next maneuver's file, expected another name")


def _outputs(name: str, out: Path) -> tuple[Path, Path, Path]:
    """The page, the diagnosis and the next maneuver of a recording."""
    return out / f"{name}.html", out / f"{name}.diagnosis.json", out / f"{name}.next.toml"


def _write(outcome: Outcome, out: Path, saved: Path | None) -> None:
    """All files of a recording or none."""
    from rig.files import atomic_path, write_text

    out.mkdir(parents=True, exist_ok=True)
    shown, said, proposal = _outputs(outcome.diagnosis.recording, out)
    again = said.exists()
    with atomic_path(shown) as page, atomic_path(said) as document:
        page.write_text(outcome.page, encoding="utf-8", errors="backslashreplace")
        outcome.diagnosis.write(document)
        if saved is not None and outcome.scenario is not None:
            with atomic_path(saved) as scenario:
                scenario.write_text(outcome.scenario, encoding="utf-8")
    if outcome.next is not None:
        write_text(proposal, outcome.next)
    elif again:
        proposal.unlink(missing_ok=True)  # of the earlier diagnosis


def _tell(outcomes: Sequence[Outcome], out: Path, saved: Path | None) -> None:
    from scenarios.gap_report.terminal import diagnosis_tables, summary_table
    from scenarios.report import show

    if not outcomes:
        return
    if len(outcomes) == 1:
        name = outcomes[0].diagnosis.recording
        show(diagnosis_tables(outcomes[0].diagnosis, outcomes[0].units))
        click.echo(f"\n{out / name}.html, {out / name}.diagnosis.json: written")
        if outcomes[0].next is not None:
            proposal = out / f"{name}.next.toml"
            click.echo(f"{proposal}: written; rig sweep {proposal} -o RUN.parquet simulates it")
    else:
        show(summary_table([outcome.diagnosis for outcome in outcomes]))
        click.echo(f"\n{out}: {len(outcomes)} recordings, for each NAME.html and NAME.diagnosis.json")
    if saved is not None and outcomes[0].scenario is not None:
        click.echo(f"{saved}: written; rig sweep {saved} -o RUN.parquet simulates it")


def _document(task: Task, result: Outcome | Exception) -> dict[str, Any]:
    """The contract's object, or what stopped it."""
    if isinstance(result, Exception):
        return {"recordings": [task.run.stem], "error": _words(task, result)}
    document: dict[str, Any] = result.diagnosis.to_json()
    return document


def _failures(tasks: Sequence[Task], results: Sequence[Outcome | Exception]) -> int:
    """One line on stderr for each recording without a diagnosis, and the exit status of all."""
    from scenarios.cli._app import BUG, DONE

    status = DONE
    for task, result in zip(tasks, results, strict=True):
        if isinstance(result, Exception):
            click.echo(f"rig: {one_line(_words(task, result))}", err=True)
            status = max(status, result.exit_status if isinstance(result, RigError) else BUG)
    return status


def _unsaved(results: Sequence[Outcome | Exception], saved: Path | None) -> int:
    """One line on stderr for an improved rig that cannot be written, and the exit status; the diagnosis stands."""
    from scenarios.cli._app import DONE
    from scenarios.gap_report.batch import Outcome

    status = DONE
    for result in results:
        if isinstance(result, Outcome) and result.unsaved is not None:
            click.echo(f"rig: {one_line(f'{saved}: not written, but the diagnosis is: {result.unsaved}')}", err=True)
            status = RigError.exit_status
    return status


def _words(task: Task, error: Exception) -> str:
    words = " ".join(str(error).split())
    if isinstance(error, RigError):
        return words if task.run.name in words else f"{task.run}: {words}"
    return f"{task.run}: this is a bug in rig, not in your call: {type(error).__name__}: {words}"


def _debugging() -> bool:
    return os.environ.get("RIG_DEBUG", "") not in ("", "0")
