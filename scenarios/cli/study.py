"""``rig study``: consistency, subsets and both papers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from scenarios.cli._checkout import GAP, LOOP, PAPER
from scenarios.cli._options import (
    PATH,
    Choice,
    arm_options,
    chosen_arm,
    cluster_option,
    counted,
    json_option,
    print_json,
    processes_option,
    progress_bar,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from scenarios.studies.error_summary import Summary


_METHODS: Final = ("separate", "simultaneous")
_ORDERS: Final = ("first", "every-kth", "random")


@click.group(short_help="Consistency, subsets, and both papers table by table.")
def study() -> None:
    """Study the estimators: many draws of the noise, many subsets of a recording, or what two papers publish.

    With --json each study prints one JSON document.

    \b
    Example:
      rig study consistency renk2005-table2 -o study
      rig study subsets run.parquet
      rig study paper -o docs
    """


def workers_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """``--workers`` and ``--cluster``: where trials run."""
    workers = processes_option("workers", 0, "Local processes; 0: this one. One a processor.")
    return workers(cluster_option(command))


@study.command(short_help="Do estimates converge, and at the best possible rate?")
@click.argument("scenario")
@click.option("-o", "--output", type=PATH, required=True, metavar="STUDY", help="Folder; an ended study goes on there.")
@click.option("--draws", type=click.IntRange(min=2), default=2000, show_default=True, help="Of the noise.")
@click.option(
    "--counts", type=click.IntRange(min=2), default=25, show_default=True, help="How many numbers of samples."
)
@click.option("--first", type=click.IntRange(min=24), default=100, show_default=True, help="The smallest of them.")
@click.option(
    "--noise",
    "noise_factors",
    multiple=True,
    type=float,
    default=(1.0, 10.0),
    metavar="K",
    help="White noise times K; 1 and 10.",
)
@click.option("--method", "methods", multiple=True, type=Choice(_METHODS), default=_METHODS, help="Both by default.")
@click.option("--order", "orders", multiple=True, type=Choice(_ORDERS), default=_ORDERS, help="All by default.")
@click.option("--parameter", "parameters", multiple=True, metavar="NAME", help="To show; sensitivity1 and offset1.")
@click.option("--seed", type=click.IntRange(min=0), default=0, help="Of everything random.")
@workers_options
@json_option
def consistency(
    scenario: str,
    output: Path,
    parameters: tuple[str, ...],
    workers: int | None,
    cluster: str | None,
    as_json: bool,
    **given: Any,
) -> None:
    """Estimate against the number of samples, for thousands of draws of SCENARIO's noise.

    Bias, RMSE over the Cramer-Rao bound, coverage and the rate of convergence, with intervals, and a verdict. STUDY
    gets the errors of every fit (table.parquet), what they come to (summary.parquet, rates.parquet), and plots. The
    same command goes on with a study that was ended.

    \b
    Example:
      rig study consistency renk2005-table2 -o study
      rig study consistency mine.toml -o study --draws 500 --order every-kth --parameter beta2
      rig study consistency renk2005-table2 -o study --cluster tcp://10.0.0.1:8786
    """
    from scenarios.loader import load
    from scenarios.studies import consistency as consistency_study
    from scenarios.studies.error_summary import RATES, Summary
    from scenarios.studies.settings import Settings
    from scenarios.studies.store import SUMMARY, StudyFolder
    from scenarios.studies.table_files import fitting_together
    from scenarios.workers import Workers

    where = Workers(workers, cluster)
    settings = Settings.of(load(scenario), **given)
    shown = _known(parameters, settings.methods) or ("sensitivity1", "offset1")
    folder = StudyFolder.begin(output, "consistency", settings)
    with progress_bar(f"{settings.trials} trials of {settings.name}") as progress:
        errors = consistency_study.run(settings, folder, where, progress)
    with fitting_together(output):  # the table may be as somebody else has made it
        with progress_bar("summing up"):
            summary = Summary.of(settings, errors)
            cells, rates = summary.tables()
            folder.write(SUMMARY, cells)
            folder.write(RATES, rates)
            files = _consistency_plots(summary, folder.path, errors, shown)
        if as_json:
            _print_consistency(summary, output, files)
            return
        from scenarios.terminal.studies import consistency_report
        from scenarios.terminal.tables import show

        show(consistency_report(summary, shown))
    click.echo(f"\n{output}: {errors.num_rows:,} fits; look at them: rig view {output}")


def _known(parameters: tuple[str, ...], methods: tuple[Any, ...]) -> tuple[str, ...]:
    """Parameters that one method at least has, by the name that is shown or the table's: the field's directions are
    named apart."""
    from rig.errors import unknown_name
    from scenarios.parameter_names import shown_name
    from scenarios.studies.coordinates import coordinate_names

    names = list(dict.fromkeys(name for method in methods for name in coordinate_names(method)))
    own = {shown_name(name): name for name in names} | {name: name for name in names}
    for name in parameters:
        if name not in own:
            raise unknown_name(f"parameter of {' and '.join(methods)} fits", name, [shown_name(each) for each in names])
    return tuple(dict.fromkeys(own[name] for name in parameters))


def _consistency_plots(summary: Summary, folder: Path, errors: Any, parameters: tuple[str, ...]) -> list[Path]:
    from scenarios.plots.study_consistency import consistency_figure
    from scenarios.studies.coordinates import coordinate_names

    files: list[Path] = []
    for sensor, method in dict.fromkeys((cell.sensor, cell.method) for cell in summary.cells):
        own = [name for name in parameters if name in coordinate_names(method)]
        if not own:
            continue
        files += _drawn(consistency_figure(summary, sensor, method, own, errors), folder / f"{sensor}-{method}")
    return files


def _drawn(figure: Figure, stem: Path) -> list[Path]:
    """The files of a figure, whose names begin with ``stem``."""
    from scenarios.plots.style import save

    files = [stem.with_name(f"{stem.name}{suffix}") for suffix in (".png", ".svg")]
    for file in files:
        save(figure, file)
    return files


def _print_consistency(summary: Summary, output: Path, files: list[Path]) -> None:
    from scenarios.studies.verdict import verdicts

    print_json(
        {
            "study": output,
            "plots": files,
            "verdicts": [
                {
                    "sensor": verdict.sensor,
                    "method": verdict.method,
                    "noise_factor": verdict.noise_factor,
                    "verdict": verdict.word,
                    "why": verdict.sentences,
                    "biases": [
                        {
                            "order": departure.cell.order,
                            "count": departure.cell.count,
                            "parameter": departure.cell.parameter,
                            "sigmas": departure.sigmas,
                            "sigmas_after_curvature": departure.after,
                            "reason": departure.reason,
                        }
                        for departure in verdict.departures
                    ],
                }
                for verdict in verdicts(summary)
            ],
            "rates": [asdict(rate) for rate in summary.rates],
            "cells": [asdict(cell) for cell in summary.cells],
        }
    )


@study.command(short_help="How much of a recording's misfit is noise, and how much systematic?")
@click.argument("run", type=PATH)
@click.option("-o", "--output", type=PATH, metavar="STUDY", help="Folder for tables and plots.")
@click.option("--subsets", "count", type=click.IntRange(2, 100_000), default=25, show_default=True, help="How many.")
@click.option(
    "--method", type=Choice(("simultaneous", "separate")), default="simultaneous", help="Of the parameters listed."
)
@click.option("--locked", type=PATH, metavar="F", help="Locked-arm recording, for the noise floor.")
@arm_options
@json_option
def subsets(
    run: Path,
    output: Path | None,
    count: int,
    method: Any,
    locked: Path | None,
    arm_file: Path | None,
    tip: str | None,
    as_json: bool,
) -> None:
    """Calibrate every k-th sample of RUN, k times over: what scatters is noise, what all share is systematic.

    Mean and standard deviation of every parameter beside the Cramer-Rao bound, the fit error taken apart, and whether
    the three separate fits of a sensor find one field direction. Neighbouring samples should see nearly the same pose:
    a recording at its full rate is best. A RUN.locked.parquet beside RUN.parquet is taken as the noise floor.

    \b
    Example:
      rig study subsets run.parquet
      rig study subsets run.parquet -o study --subsets 10
    """
    from rig.recording import locked_beside, scan_recording
    from scenarios.studies.subsets import study as study_subsets

    arm = chosen_arm(arm_file, tip)
    scan = scan_recording(run, joints=None if arm is None else arm.dof)
    still = locked or locked_beside(run)
    with progress_bar(f"{count} subsets of {run}") as progress:
        found = study_subsets(
            scan,
            count,
            method=method,
            noise=_floor(still),
            noise_source="residuals" if still is None else "locked recording",
            arm=arm,
            progress=counted(progress, scan.rows),
        )
    files: list[Path] = []
    if output is not None:
        from scenarios.plots.study_subsets import subsets_figure
        from scenarios.studies.subset_results import write_subsets

        folder = write_subsets(found, output)
        files = _drawn(subsets_figure(found), folder.path / "subsets")
    if as_json:
        print_json({**asdict(found), "study": output, "plots": files})
        return
    from scenarios.terminal.studies import subsets_report
    from scenarios.terminal.tables import show

    show(subsets_report(found))
    if output is not None:
        click.echo(f"\n{output}: written; look at it: rig view {output}")


def _floor(locked: Path | None) -> Callable[[str, str], NDArray[Any] | None]:
    """Sensor and unit -> the noise of its channels."""
    if locked is None:
        return lambda sensor, unit: None
    from estimators import noise_floor

    floor = noise_floor(locked)
    return lambda sensor, unit: None if (found := floor.of(sensor, unit)) is None else found[0]


study.add_command(PAPER)
study.add_command(GAP)
study.add_command(LOOP)
