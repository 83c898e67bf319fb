"""``rig blind make|solve|score``: the check on data whose truth is sealed."""

from __future__ import annotations

import secrets
from pathlib import Path

import click

from scenarios.cli._options import PATH, check_output, json_option, print_json, processes_option, progress_bar
from validation.cli._options import MOST, MOST_SAMPLES, options

_JOBS = processes_option("jobs", 0, "Processes; one for each processor.")
_SEALED = click.option(
    "--truth", "sealed", type=PATH, metavar="DIR", help="The sealed folder; FOLDER.sealed by default."
)

#: What a set is made of.
_set_options = options(
    click.option("--cases", type=click.IntRange(16, MOST), default=100, help="Beside those of mechanics."),
    click.option(
        "--mechanics", type=click.IntRange(0, MOST), default=0, help="Cases stepped by MuJoCo; a minute each."
    ),
    click.option("--samples", type=click.IntRange(400, MOST_SAMPLES), default=6656, help="Of each recording, at 4 Hz."),
    click.option("--scenario", default="ann-arbor", help="What the rigs are drawn around: a name or a TOML file."),
    click.option("--seed", type=click.IntRange(min=0), help="Of everything random; drawn and sealed by default."),
)


@click.group(short_help="The check on sealed recordings: make, solve, score.")
def blind() -> None:
    """Make recordings with a sealed truth, diagnose them, then open the seal and score the answers.

    With --json each step prints one JSON document.

    \b
    Example:
      rig blind make set1 --cases 100 --mechanics 12
      rig blind solve set1
      rig blind score set1 -o blind.md
    """


@blind.command(short_help="Make sealed recordings.")
@click.argument("folder", type=PATH)
@_set_options
@_SEALED
@_JOBS
@json_option
def make(
    folder: Path,
    cases: int,
    mechanics: int,
    samples: int,
    scenario: str,
    seed: int | None,
    sealed: Path | None,
    jobs: int | None,
    as_json: bool,
) -> None:
    """Write sealed recordings into FOLDER, and their truth into another folder.

    FOLDER holds of the truth only a hash with a secret salt: it can be given to whoever is to be tested.

    \b
    Example:
      rig blind make set1 --cases 100 --mechanics 12
      rig blind make small --cases 20 --samples 1664 --seed 5 --truth elsewhere
    """
    hidden, count = _make(folder, sealed, cases, mechanics, samples, scenario, seed, jobs)
    if as_json:
        print_json({"folder": folder, "truth": hidden, "cases": count})
    else:
        click.echo(f"{folder}: {count} recordings, sealed; {hidden}: their truth")


@blind.command(short_help="Diagnose sealed recordings.")
@click.argument("folder", type=PATH)
@_JOBS
@json_option
def solve(folder: Path, jobs: int | None, as_json: bool) -> None:
    """Diagnose every recording of FOLDER into FOLDER/answers; those that are there already are kept.

    \b
    Example:
      rig blind solve set1
      rig blind solve set1 --jobs 2
    """
    from scenarios.workers import Workers
    from validation.blind.solve import ANSWERS, solve_set

    with progress_bar(f"diagnosing {folder}") as progress:
        count = solve_set(folder, Workers(jobs), progress)
    if as_json:
        print_json({"answers": folder / ANSWERS, "diagnosed": count})
    else:
        click.echo(f"{folder / ANSWERS}: {count} recordings diagnosed")


@blind.command(short_help="Open the seal and score the answers.")
@click.argument("folder", type=PATH)
@click.option("-o", "--output", type=PATH, metavar="PAGE", help="Write the page: .md, with a picture beside it.")
@click.option(
    "--withheld/--no-withheld", default=True, help="Diagnose again, the true effect taken out of the catalogue."
)
@click.option(
    "--power", "draws", type=click.IntRange(0, MOST), default=0, help="Recordings a strength for detection power."
)
@_SEALED
@_JOBS
@json_option
def score(
    folder: Path, output: Path | None, withheld: bool, draws: int, sealed: Path | None, jobs: int | None, as_json: bool
) -> None:
    """Open the seal of FOLDER and judge its answers: how many are right, and what went wrong.

    \b
    Example:
      rig blind score set1
      rig blind score set1 -o docs/blind.md --power 20
    """
    if output is not None:
        check_output(output, (".md",))
    _score(folder, sealed, output, withheld, draws, jobs, as_json)


@blind.command(short_help="Make, solve and score in one go.")
@click.argument("folder", type=PATH)
@_set_options
@click.option(
    "--power", "draws", type=click.IntRange(0, MOST), default=0, help="Recordings a strength for detection power."
)
@click.option(
    "-o", "--output", type=PATH, required=True, metavar="PAGE", help="The page: .md, with a picture beside it."
)
@_JOBS
@json_option
def run(
    folder: Path,
    cases: int,
    mechanics: int,
    samples: int,
    scenario: str,
    seed: int | None,
    draws: int,
    output: Path,
    jobs: int | None,
    as_json: bool,
) -> None:
    """Make a set in FOLDER unless there is one, solve it, score it, and write the page; ended early, it goes on.

    \b
    Example:
      rig blind run set1 --cases 400 --mechanics 24 --seed 1 --power 20 -o docs/blind.md
    """
    check_output(output, (".md",))
    from scenarios.workers import Workers
    from validation.blind.seal import MANIFEST
    from validation.blind.solve import solve_set

    if not (folder / MANIFEST).exists():
        _make(folder, None, cases, mechanics, samples, scenario, seed, jobs)
    with progress_bar(f"diagnosing {folder}") as progress:
        solve_set(folder, Workers(jobs), progress)
    _score(folder, None, output, True, draws, jobs, as_json)


def _make(
    folder: Path,
    sealed: Path | None,
    cases: int,
    mechanics: int,
    samples: int,
    scenario: str,
    seed: int | None,
    jobs: int | None,
) -> tuple[Path, int]:
    from scenarios.workers import Workers
    from validation.blind.make import Order, make_set
    from validation.blind.seal import sealed_folder

    hidden = sealed or sealed_folder(folder)
    number = secrets.randbits(63) if seed is None else seed
    order = Order(str(folder), str(hidden), number, cases, mechanics, samples, scenario)
    with progress_bar(f"making {folder}") as progress:
        return hidden, make_set(order, Workers(jobs), progress)


def _score(
    folder: Path, sealed: Path | None, output: Path | None, withheld: bool, draws: int, jobs: int | None, as_json: bool
) -> None:
    from scenarios.workers import Workers
    from validation.blind.answers import Answers
    from validation.blind.power import PowerStudy, power
    from validation.blind.report import page, write_report
    from validation.blind.scoring import score_set, summary
    from validation.blind.seal import read_order, sealed_folder
    from validation.blind.solve import ANSWERS

    hidden = sealed or sealed_folder(folder)
    with progress_bar(f"scoring {folder}") as progress:
        scores = score_set(folder, hidden, Workers(jobs), progress, withheld)
    curve = None
    if draws:
        with progress_bar("detection power") as progress:
            curve = power(PowerStudy(draws=draws), Workers(jobs), progress)
    order, solver = read_order(hidden), Answers(folder / ANSWERS).solver()
    if output is not None:
        write_report(output, scores, order, solver, curve)
    if as_json:
        print_json(summary(scores))
    elif output is not None:
        click.echo(f"{output}: written")
    else:
        click.echo(page(scores, order, solver, "", curve))
