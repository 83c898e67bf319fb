"""Make the page on both papers, with its pictures and with the study that it rests on."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from matplotlib.figure import Figure

from rig.channels import ACCELEROMETER
from rig.files import child, made_folder, write_text
from rig.progress import Progress, unheard
from scenarios.loader import load
from scenarios.studies.consistency import run, trial
from scenarios.studies.error_summary import RATES, Summary
from scenarios.studies.settings import Settings
from scenarios.studies.store import SUMMARY, TABLE, StudyFolder, is_study
from scenarios.workers import Workers
from validation.paper.compare import Comparison, compare
from validation.paper.data import FILE, document
from validation.paper.page import FOLDER, page

PAGE: Final = "paper.md"
#: The consistency study's results are kept beside the pictures, its 600,000 fits are not: ..
STUDY: Final = "consistency"
#: .. mean squares of each trial stand for them, so that any trial can be made again and compared.
BLOCKS: Final = "blocks.parquet"
CHECKED: Final = ("sensitivity1", "offset1")
SCENARIO: Final = "renk2005-table2"
#: Whose sweep is drawn.
SWEEP: Final = "renk2005-accelerometer"


@dataclass(frozen=True)
class Paper:
    """What was made.

    Attributes:
        comparison: of the tables and texts. summary: of the consistency study. files: what was written.
    """

    comparison: Comparison
    summary: Summary
    files: tuple[Path, ...]


def settings(draws: int = 2000) -> Settings:
    """Of the consistency study: the paper's simulated data."""
    return Settings.of(load(SCENARIO), draws=draws)


def make_paper(
    folder: Path,
    chosen: Settings | None = None,
    workers: Workers | None = None,
    progress: Progress = unheard,
) -> Paper:
    """Write paper.md, its pictures, its data, and the results of its consistency study.

    Args:
        folder: is made if it is not there. chosen: of the consistency study; None: 2,000 draws.
        workers, progress: as of ``consistency.run``. A study whose results are there is not made again.

    Raises:
        RigError: the folder cannot be made or written to, or as of ``consistency.run``.
    """
    wanted = chosen or settings()
    with made_folder(folder / FOLDER, linked=False) as beside:
        study = _studied(child(beside, STUDY, str(beside)), wanted, workers, progress)
    summary = read_summary(study.path)
    comparison = compare()
    files = [folder / PAGE]
    from scenarios.plots.style import save

    for name, figure in figures(comparison, summary, wanted).items():
        files.append(beside / f"{name}.png")
        save(figure, files[-1])
    files.append(beside / FILE)
    write_text(files[-1], json.dumps(document(comparison), indent=1, ensure_ascii=False) + "\n")
    write_text(folder / PAGE, page(comparison, summary))
    return Paper(comparison, summary, tuple(files))


def _studied(path: Path, wanted: Settings, workers: Workers | None, progress: Progress) -> StudyFolder:
    """The consistency study, made where its results are not there."""
    there = is_study(path) and StudyFolder.read(path).holds(SUMMARY, RATES, BLOCKS)
    study = StudyFolder.begin(path, "consistency", wanted, any_version=there)
    if not there:
        table = run(wanted, study, workers, progress)
        cells, rates = Summary.of(wanted, table).tables()
        study.write(BLOCKS, blocks(wanted, table))
        study.write(RATES, rates)
        study.write(SUMMARY, cells)
        (study.path / TABLE).unlink()
    return study


def read_summary(study: Path) -> Summary:
    """The summary that is kept in a study's folder."""
    folder = StudyFolder.read(study)
    return Summary.from_tables(folder.table(SUMMARY), folder.table(RATES))


def figures(comparison: Comparison, summary: Summary, chosen: Settings) -> dict[str, Figure]:
    """The pictures by name."""
    from scenarios.plots.study_consistency import consistency_figure
    from scenarios.plots.sweep import sweep_figure
    from validation.plots.paper import camps_figure, misfit_figure, scatter_figure
    from validation.plots.papers import drawn_as_in_the_papers

    first = trial(chosen, chosen.orders.index("first") * chosen.blocks)
    drawn: dict[str, Figure] = {}
    for method in chosen.methods:
        drawn[method] = consistency_figure(summary, ACCELEROMETER, method, CHECKED, first)
    scenario = load(SWEEP)
    drawn["maneuver"] = sweep_figure(scenario.simulate(), scenario.rig.arm)
    drawn |= drawn_as_in_the_papers(summary, first, comparison.one_draws)
    return {**drawn, "scatter": scatter_figure(), "misfit": misfit_figure(comparison.misfits), "camps": camps_figure()}


def blocks(chosen: Settings, table: pa.Table) -> pa.Table:
    """The mean square errors of S1 and delta1 in every block of draws: a row for each order, method, noise, count."""
    block = pc.cast(pc.divide(table["draw"], chosen.block), pa.int32())
    columns = ["order", "block", "method", "noise_factor", "count"]
    part = table.select(["order", "method", "noise_factor", "count"]).append_column("block", block)
    for name in CHECKED:
        square = np.square(table[f"error_{name}"].to_numpy().astype(float))
        part = part.append_column(name, pa.array(square))
    part = part.set_column(part.column_names.index("order"), "order", pc.cast(part["order"], pa.string()))
    part = part.set_column(part.column_names.index("method"), "method", pc.cast(part["method"], pa.string()))
    found = part.group_by(columns).aggregate([(name, "mean") for name in CHECKED])
    return found.sort_by([(name, "ascending") for name in columns])
