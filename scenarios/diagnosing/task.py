"""What is to be diagnosed, and what became of it."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from estimators.gap import Diagnosis
from estimators.gap.report.fitted_rig import FittedRig
from rig.recording import Recording

#: Memory that a diagnosis takes [bytes a sample], and the program by itself [bytes].
BYTES_A_SAMPLE: Final = 10_000.0
BYTES_ANYWAY: Final = 400e6


def given_arm(arm_file: Path | None, tip: str | None) -> list[str]:
    """The words of ``--arm`` and ``--tip`` as they were given; none where they were not."""
    given = {"--arm": arm_file, "--tip": tip}
    return [word for option, value in given.items() if value is not None for word in (option, str(value))]


@dataclass(frozen=True)
class Task:
    """One recording to diagnose, or several together.

    Attributes:
        run: its file. others: those of others that are diagnosed together with it.
        calibration: the file of one from before, of the same rig.
        locked: the locked recording; None: the one beside it, if there is one.
        maneuver2: another maneuver of the same rig.
        without: effects to leave out of the catalogue.
        arm_file, tip: the arm; None: the A465.
        improved: whether the improved rig is wanted.
        minutes: how long the next maneuver may take; None: as long as the recording.
        together: how many tasks share the memory that may be taken.
        prior: relative weights of effects; None: all alike.
        memory: what the user has stated, for workers that are not of this machine.
        origin: what the files must be, of a worker that reads them elsewhere; None: as they are.
        rig: the fitted rig to judge against; None: the ideal one.
    """

    run: Path
    locked: Path | None = None
    maneuver2: Path | None = None
    without: tuple[str, ...] = ()
    arm_file: Path | None = None
    tip: str | None = None
    improved: bool = False
    minutes: float | None = None
    together: int = 1
    prior: Mapping[str, float] | None = None
    memory: str | None = None
    origin: Mapping[str, Any] | None = None
    rig: FittedRig | None = None
    others: tuple[Path, ...] = ()
    calibration: Path | None = None

    @property
    def arm_options(self) -> str:
        """The options of the arm, as a shell takes them; empty where none was given."""
        return shlex.join(given_arm(self.arm_file, self.tip))


@dataclass(frozen=True)
class About:
    """Whose recording it is, of when.

    Attributes:
        arm: its model. serial: of that arm; None: not stated.
        recorded: ISO 8601 date and time of the first sample; None: not stated.
        block: samples that each of those diagnosed is the mean of; 1: diagnosed as recorded.
    """

    arm: str
    serial: str | None = None
    recorded: str | None = None
    block: int = 1

    @classmethod
    def of(cls, recording: Recording, block: int) -> About:
        """As its metadata say."""
        metadata = recording.metadata
        serial = None if metadata.serial is None else str(metadata.serial)
        return cls(metadata.arm, serial, metadata.recorded, block)


@dataclass(frozen=True)
class Outcome:
    """What became of a task.

    Attributes:
        diagnosis, page: the diagnosis and its page.
        about: whose recording it is. origin: what the diagnosis was made from.
        units: sensor -> recorded unit.
        scenario: the improved rig, where it was wanted.
        next: the scenario that would tell the explanations apart, where the recording does not.
        unsaved: why the improved rig cannot be written, where it was wanted and cannot.
    """

    diagnosis: Diagnosis
    page: str
    about: About
    origin: Mapping[str, Any]
    units: Mapping[str, str]
    scenario: str | None
    next: str | None = None
    unsaved: str | None = None
