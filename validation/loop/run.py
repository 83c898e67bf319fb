"""Make the study of the loop, its page and its picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rig.files import child, made_folder, write_text
from rig.progress import Progress, unheard
from scenarios.studies.store import StudyFolder
from scenarios.studies.table_files import fitting_together, rows_of
from scenarios.workers import Workers
from validation.loop.page import PICTURE, page
from validation.loop.play import Settings, Step, trial
from validation.loop.summary import Summary, summaries

PAGE: Final = "loop.md"
FOLDER: Final = "loop"
STUDY: Final = "study"


@dataclass(frozen=True)
class Loop:
    """What was made: every step, what they come to, and the files."""

    steps: tuple[Step, ...]
    summaries: tuple[Summary, ...]
    files: tuple[Path, ...]


def make_loop(folder: Path, settings: Settings, workers: Workers, progress: Progress = unheard) -> Loop:
    """Write loop.md, its picture and the table of all steps; an ended study goes on.

    Raises:
        RigError: the folder holds another study or cannot be written to, or as of ``Workers.completed``.
    """
    from scenarios.plots.style import save
    from validation.plots.loop import loop_figure

    with made_folder(folder / FOLDER, linked=False) as beside:
        study = StudyFolder.begin(child(beside, STUDY, str(beside)), "loop", settings)
        table = study.fill(trial, settings, settings.rigs, workers, progress)
        with fitting_together(study.path):  # the table may be as somebody else has made it
            steps = tuple(rows_of(Step, table))
            found = summaries(steps)
    save(loop_figure(found), beside / PICTURE)
    write_text(folder / PAGE, page(settings, steps, found, FOLDER))
    return Loop(steps, found, (folder / PAGE, beside / PICTURE, study.path))
