"""``rig diagnose``: where a recording disagrees with the rig, which effect causes it, how far the gap closes."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rig.errors import RigError, check_name, one_line
from rig.files import check_different
from scenarios.cli._options import (
    PATH,
    FiniteNumber,
    arm_options,
    check_output,
    chosen_arm,
    cluster_option,
    json_option,
    memory_option,
    print_json,
    processes_option,
    progress_bar,
    tell,
    without_locked,
)
from scenarios.cli._signals import debugging

if TYPE_CHECKING:
    from estimators.gap.diagnosis import Diagnosis
    from scenarios.diagnosing.batch import Outcome, Task
    from scenarios.diagnosing.fleet import Entry
    from scenarios.diagnosing.task import About
    from scenarios.workers import Workers


@click.command(short_help="Name what causes a recording's sim-to-real gap.")
@click.argument("runs", type=PATH, nargs=-1, required=True, metavar="RUN...")
@click.option("--locked", type=PATH, metavar="F", help="Locked-arm recording, for the noise floor.")
@click.option("--together", is_flag=True, help="One calibration and the same causes for all RUNs, in their order.")
@click.option(
    "--calibration",
    type=PATH,
    metavar="CAL",
    help="Of the same rig, from before: for a RUN that cannot be calibrated alone.",
)
@click.option("--maneuver2", type=PATH, metavar="F", help="Another maneuver of the same rig, to judge the causes on.")
@click.option("--without", multiple=True, metavar="EFFECT", help="Leave an effect out of the catalogue; repeatable.")
@click.option("--prior", type=PATH, metavar="F.toml", help="Weights of the effects that this arm is prone to.")
@click.option("--rig", "fitted", type=PATH, metavar="F.toml", help="Judge against this fitted rig, not the ideal one.")
@arm_options
@processes_option("jobs", 1, "Processes; one for each processor by default.")
@cluster_option
@click.option("--save-scenario", "saved", type=PATH, metavar="F.toml", help="Write the improved rig, for rig sweep.")
@click.option(
    "--minutes",
    type=FiniteNumber(min=0.0, max=600.0, min_open=True),
    metavar="M",
    help="For the next maneuver; as long as RUN by default.",
)
@click.option(
    "-o",
    "--output",
    "--out",
    "out",
    type=PATH,
    default="diagnosis",
    metavar="DIR",
    help="For the results; ./diagnosis by default.",
)
@memory_option
@json_option
def diagnose(
    runs: tuple[Path, ...],
    locked: Path | None,
    together: bool,
    calibration: Path | None,
    maneuver2: Path | None,
    without: tuple[str, ...],
    prior: Path | None,
    fitted: Path | None,
    arm_file: Path | None,
    tip: str | None,
    jobs: int | None,
    cluster: str | None,
    saved: Path | None,
    minutes: float | None,
    out: Path,
    as_json: bool,
) -> int:
    """Say where each RUN disagrees with the rig, which effects cause it, how probable that is, and what to do next.

    Each gets DIR/NAME.diagnosis.json, DIR/NAME.html, a page to look at, and DIR/NAME.calibration.json, the
    calibration with the causes in place and its covariance over all explanations, for rig apply and rig export. A
    RUN.locked.parquet beside RUN.parquet is taken as its noise floor. Where the data do not decide between
    explanations, DIR/NAME.next.toml is the maneuver that would, within the joints' limits and M minutes. --prior
    F.toml has a table [effects] of relative weights, such as backlash = 5; 1 is the default, 0 leaves an effect out.
    --rig F.toml takes a rig that --save-scenario wrote, adds its effects to the model, and says how far they close
    the gap, what is left, and whether that rig is better: only a recording that did not choose it, and of which it
    leaves the floor alone, says so.

    Several RUNs are done in parallel, here or on a Dask cluster that can read them; a bad one does not stop the
    others, and what DIR holds of the same files, options and version is kept. DIR/fleet.csv, .json and .html tell
    which cause is on which arm since when, by the metadata serial and recorded.

    --together: several maneuvers of one rig, poses and sweeps, of whatever days, are one piece of evidence:
    DIR/together.diagnosis.json and .html. A maneuver proposed before is added like this.

    \b
    Example:
      rig diagnose run.parquet
      rig diagnose lab/*.parquet --out reports --jobs 2
      rig diagnose lab/*.parquet --out reports --cluster tcp://10.0.0.1:8786
      rig diagnose run.parquet --prior our-arm.toml
      rig diagnose run.parquet next.parquet --together
      rig diagnose sweep.parquet --calibration cal.json
      rig diagnose run.parquet --save-scenario improved.toml && rig sweep improved.toml -o again.parquet
      rig diagnose another.parquet --rig improved.toml
    """
    chosen = without_locked(runs)
    if maneuver2 is not None and (calibration is not None or together):
        raise RigError("--maneuver2: found with --together or --calibration, expected it as one more RUN --together")
    if fitted is not None and (calibration is not None or together):
        raise RigError("--rig: found with --together or --calibration, expected one recording by itself")
    if together and cluster is not None:
        raise RigError("--together: found --cluster, expected one of them: it is one diagnosis, made here")
    if together:
        check_different(chosen)
    if maneuver2 is not None:  # what chose the causes cannot judge them
        for run in chosen:
            check_different((run, maneuver2))
    if together and len(chosen) == 1:
        raise RigError(f"--together: found one recording, {chosen[0]}, expected several")
    _check(
        chosen,
        without,
        saved,
        out,
        [path for path in (locked, maneuver2, prior, fitted, arm_file, calibration) if path is not None],
        together,
    )
    from estimators.gap.hypotheses.prior import read_prior
    from rig.recording import scan_recording
    from scenarios.diagnosing.batch import Outcome, Task, outcomes
    from scenarios.diagnosing.improved_rig import read_fitted_rig
    from scenarios.diagnosing.kept import document_of, write_outcome
    from scenarios.workers import Workers

    weights = None if prior is None else read_prior(prior)
    arm = chosen_arm(arm_file, tip)
    for path in (locked, maneuver2):  # a file for all recordings is not to be refused once for each
        if path is not None:
            scan_recording(path, joints=None if arm is None else arm.dof)
    workers = Workers(jobs, cluster)
    rig = None if fitted is None else read_fitted_rig(fitted)
    groups = [chosen] if together else [[run] for run in chosen]
    tasks = [
        Task(
            first,
            locked,
            maneuver2,
            without,
            arm_file,
            tip,
            saved is not None,
            minutes,
            workers.at_once(len(groups)),
            weights,
            others=tuple(others),
            calibration=calibration,
            rig=rig,
        )
        for first, *others in groups
    ]
    if len(tasks) > 1 or cluster is not None:
        return _fleet(tasks, workers, out, as_json)
    with progress_bar(f"diagnosing {chosen[0]}") as progress:
        ((_, result),) = outcomes(tasks, workers, progress)
    if not isinstance(result, Outcome):
        if debugging() or not isinstance(result, RigError):
            raise result
        raise type(result)(_words(tasks[0], result))
    _tell_averaged(tasks[0], result.about)
    write_outcome(result, out, saved)
    if as_json:
        print_json(document_of(result))
    else:
        _tell(result, out, saved)
    return _unsaved(result, saved)


def _fleet(tasks: Sequence[Task], workers: Workers, out: Path, as_json: bool) -> int:
    """Diagnose what is not in the folder yet, then write the table and the page of all."""
    from scenarios.diagnosing.batch import Outcome, outcomes
    from scenarios.diagnosing.fleet import Entry
    from scenarios.diagnosing.kept import kept, write_outcome
    from scenarios.gap_report.fleet_page import fleet_tables, write_fleet

    entries: dict[int, Entry] = {}
    errors: dict[int, Exception] = {}
    for number, task in enumerate(tasks):
        if (found := kept(task, out)) is not None:
            entries[number] = Entry(task.run.stem, *found, without=task.without)
    there = len(entries)
    left = [number for number in range(len(tasks)) if number not in entries]
    with progress_bar(f"diagnosing {len(left)} recordings") as progress:
        for place, result in outcomes([tasks[number] for number in left], workers, progress):
            task, number = tasks[left[place]], left[place]
            if isinstance(result, Outcome):
                write_outcome(result, out)
                entries[number] = Entry(task.run.stem, result.diagnosis, result.about, without=task.without)
            elif debugging():
                raise result
            else:
                entries[number] = Entry(task.run.stem, None, None, _words(task, result))
                errors[number] = result
    every = [entries[number] for number in range(len(tasks))]
    for task, entry in zip(tasks, every, strict=True):
        _tell_averaged(task, entry.about)
    made = write_fleet(every, out)
    if as_json:
        print_json([_document(entry) for entry in every])
    else:
        from scenarios.terminal.tables import show

        show(fleet_tables(every))
        kept_words = f", {there} of them kept as they were" if there else ""
        click.echo(f"\n{out}: NAME.html and NAME.diagnosis.json of {len(tasks) - len(errors)} recordings{kept_words}")
        click.echo(f"{', '.join(map(str, made))}: written")
    return _failures(errors, every)


def _tell_averaged(task: Task, about: About | None) -> None:
    """One line for a recording that was too long for the memory."""
    if about is not None and about.block > 1:
        tell(
            f"{task.run}: means over blocks of {about.block} samples are diagnosed, as memory allows no more: what is"
            " faster, such as mains hum, and single spoilt readings cannot be seen (--memory)"
        )


def _check(
    runs: Sequence[Path],
    without: Sequence[str],
    saved: Path | None,
    out: Path,
    others: Sequence[Path],
    together: bool = False,
) -> None:
    """Refuse, before any work, what could not end well.

    Args:
        others: what is read beside the recordings.
        together: whether there is one diagnosis of all recordings.
    """
    from rig.effects import EFFECTS
    from rig.recording import locked_beside
    from scenarios.diagnosing.kept import paths

    for name in without:
        check_name("effect", name, EFFECTS)
    named: dict[str, Path] = {}
    for run in runs:
        if run.stem in named:
            raise RigError(
                f"{run}: found the name {run.stem!r} again after {named[run.stem]}, expected different names"
            )
        named[run.stem] = run
    if saved is not None:
        check_output(saved, (".toml",), *runs, *map(locked_beside, runs), *others)
        if len(runs) > 1 and not together:
            raise RigError(f"--save-scenario: found {len(runs)} recordings, expected one, whose rig it is")
    if len(runs) > 1 and "fleet" in named:
        raise RigError(f"{named['fleet']}: found the name 'fleet', expected another: fleet.html is the page of all")
    existing = next(folder for folder in (out, *out.absolute().parents) if folder.exists())
    if not existing.is_dir():
        raise RigError(f"{out}: {existing} is a file, expected a folder for the results")
    if not os.access(existing, os.W_OK):
        raise RigError(f"{out}: folder {existing} cannot be written to")
    read = [path for run in runs for path in (run, locked_beside(run))]
    for name in ["together"] if together else [run.stem for run in runs]:
        for written in paths(out, name) if out.is_dir() else ():
            check_output(written, (written.suffix,), *read, *others)
            if saved is not None and saved.absolute() == written.absolute():
                raise RigError(f"--save-scenario {saved}: is another of the files written, expected another name")


def _tell(outcome: Outcome, out: Path, saved: Path | None) -> None:
    from scenarios.diagnosing.kept import paths
    from scenarios.gap_report.terminal import diagnosis_tables
    from scenarios.terminal.tables import show

    document, page, proposal, calibration = paths(out, outcome.diagnosis.name)
    show(diagnosis_tables(outcome.diagnosis, outcome.units))
    click.echo(f"\n{page}, {document}: written")
    if outcome.diagnosis.calibration is not None:
        click.echo(f"{calibration}: written, {_calibrated(outcome.diagnosis)}")
    if outcome.next is not None:
        click.echo(f"{proposal}: written; rig sweep {proposal} -o RUN.parquet simulates it")
    if saved is not None and outcome.scenario is not None:
        click.echo(f"{saved}: written; rig sweep {saved} -o RUN.parquet simulates it")


def _calibrated(diagnosis: Diagnosis) -> str:
    """What the corrected calibration is: of an unknown gap it rests on causes that may not be there."""
    if not diagnosis.leading:
        return "the calibration, for rig apply"
    if diagnosis.verdict == "unknown":
        return "a calibration with what is likeliest in place; its covariance is over all explanations"
    return "the calibration with the causes in place, for rig apply"


def _document(entry: Entry) -> dict[str, Any]:
    """The contract's object, or what stopped it."""
    if entry.diagnosis is None:
        return {"recordings": [entry.name], "error": entry.error}
    document: dict[str, Any] = entry.diagnosis.to_json()
    return document


def _failures(errors: Mapping[int, Exception], entries: Sequence[Entry]) -> int:
    """One line on stderr for each recording without a diagnosis, and the exit status of all."""
    from scenarios.cli._app import BUG, DONE

    status = DONE
    for number, error in sorted(errors.items()):
        tell(entries[number].error)
        status = max(status, error.exit_status if isinstance(error, RigError) else BUG)
    return status


def _unsaved(outcome: Outcome, saved: Path | None) -> int:
    """One line on stderr for an improved rig that cannot be written, and the exit status; the diagnosis stands."""
    from scenarios.cli._app import DONE

    if outcome.unsaved is None:
        return DONE
    tell(f"{saved}: not written, but the diagnosis is: {outcome.unsaved}")
    return RigError.exit_status


def _words(task: Task, error: Exception) -> str:
    words = " ".join(str(error).split()).replace(str(task.run.absolute()), str(task.run))  # as a cluster names it
    if isinstance(error, RigError):
        return words if one_line(task.run.name) in words else f"{task.run}: {words}"
    return f"{task.run}: this is a bug in rig, not in your call: {type(error).__name__}: {words}"
