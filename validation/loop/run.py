"""Make the study of the loop, its page and its picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rig.progress import Progress, unheard
from scenarios.workers import Workers
from validation.loop.page import PICTURE, blocks
from validation.loop.play import Settings, Step, trial
from validation.loop.summary import Summary, summaries
from validation.study_page import make_page


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

    page, steps = make_page(folder, "loop", settings, trial, settings.rigs, Step, blocks, workers, progress)
    found = summaries(steps)
    picture = folder / "loop" / PICTURE
    save(loop_figure(found), picture)
    return Loop(steps, found, (page, picture, folder / "loop" / "study"))
