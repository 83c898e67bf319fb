"""The seam to the diagnosis: several recordings of one rig judged together, and the maneuver proposed then."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from estimators.gap.diagnose import examined
from estimators.gap.diagnosis import Diagnosis
from estimators.gap.report.separation import rivals
from rig.maneuver import StaticPoses, TorusSweep
from rig.recording import Recording
from scenarios.diagnosing.several import residuals_of_each
from scenarios.plan.next_maneuver import next_maneuver


@dataclass(frozen=True)
class Judged:
    """A diagnosis of all recordings so far.

    Attributes:
        diagnosis: of them together.
        proposed: the next maneuver, whether the arm's own acceleration counts in it, and how much warmer the room is
            then [degC]; None: there is none.
    """

    diagnosis: Diagnosis
    proposed: Callable[[], tuple[TorusSweep | StaticPoses, bool, float] | None]


def judged(runs: Sequence[Recording], locked: Recording) -> Judged:
    """Diagnose recordings of one rig together.

    Args:
        locked: the rig at rest, for the noise floor of all of them.

    Raises:
        RigError, RefusedFit: as ``estimators.diagnose``.
    """
    found = examined(list(runs), [locked] * len(runs))

    def proposed() -> tuple[TorusSweep | StaticPoses, bool, float] | None:
        if not rivals(found.diagnosis):
            return None
        following = next_maneuver(found.diagnosis, residuals_of_each(found)[-1], None)
        return None if following is None else (following.maneuver, following.felt, following.warmer_degC)

    return Judged(found.diagnosis, proposed)
