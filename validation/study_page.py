"""A study of rows, one a trial, and the page that is made of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

from rig.files import child, made_folder, write_text
from rig.progress import Progress, unheard
from scenarios.studies.store import StudyFolder, Trial
from scenarios.studies.table_files import fitting_together, rows_of
from scenarios.workers import Workers
from validation.markdown import page_of

Row = TypeVar("Row")
Settings = TypeVar("Settings")


def make_page(
    folder: Path,
    name: str,
    settings: Settings,
    trial: Trial[Settings],
    count: int,
    row: type[Row],
    blocks: Callable[[Settings, tuple[Row, ...]], Iterable[str]],
    workers: Workers,
    progress: Progress = unheard,
) -> tuple[Path, tuple[Row, ...]]:
    """Write NAME.md, and NAME/study with the table behind it; an ended study goes on. The page and all rows.

    Args:
        trial, count: of the study. row: what its table has rows of. blocks: of the page.

    Raises:
        RigError: the folder holds another study or cannot be written to, or as of ``Workers.completed``.
    """
    with made_folder(folder / name, linked=False) as beside:
        study = StudyFolder.begin(child(beside, "study", str(beside)), name, settings)
        table = study.fill(trial, settings, count, workers, progress)
        with fitting_together(study.path):  # the table may be as somebody else has made it
            rows = tuple(rows_of(row, table))
            text = page_of(blocks(settings, rows))
    page = folder / f"{name}.md"
    write_text(page, text)
    return page, rows
