"""The samples at which an arm is at rest, by its recorded pose alone."""

from __future__ import annotations

from typing import Final

import numpy as np

from estimators.stillness.detection import SPEED_LIMIT
from rig.arrays import Mask
from rig.errors import RefusedFit, RigError
from rig.recording import Recording
from rig.recording.repeated_poses import straight_between

#: Readings so soon after a move and before the next are left out as well [s].
SETTLE_S: Final = 0.1


def at_rest_samples(recording: Recording) -> Recording:
    """The samples of a recording at which its joints, or its tool, neither turn nor have just turned.

    Nor will for a tenth of a second. Between poses that a slower log repeats it moves (``straight_between``).

    Args:
        recording: with joint angles or tool poses.

    Raises:
        RigError: no pose was recorded.
        RefusedFit: the arm is never at rest.
    """
    recording = straight_between(recording)
    where = recording.origin or recording.name
    step = np.diff(recording.t)
    if recording.q is not None:
        speed = np.abs(np.diff(recording.q, axis=0)).max(axis=1) / step
    elif recording.tool_quaternion is not None:
        turned = np.abs((recording.tool_quaternion[1:] * recording.tool_quaternion[:-1]).sum(axis=1))
        speed = 2.0 * np.arccos(np.minimum(turned, 1.0)) / step
    else:
        raise RigError(f"{where}: has no pose, expected joint angles or tool poses to see when the arm is at rest")
    moving: Mask = np.append(speed > SPEED_LIMIT, False) | np.append(False, speed > SPEED_LIMIT)
    when = recording.t[moving]
    after = np.searchsorted(when, recording.t - SETTLE_S, side="left")
    before = np.searchsorted(when, recording.t + SETTLE_S, side="right")
    still = before == after
    if not still.any():
        raise RefusedFit(f"{where}: the arm is never at rest for {2.0 * SETTLE_S:g} s, expected poses that are held")
    return recording.select(still)
