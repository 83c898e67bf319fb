"""A refused fit, with the directions that would have told the parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimators.coverage.seen import coverage
from rig.errors import RefusedFit
from rig.recording import Recording

if TYPE_CHECKING:
    from rig.arm import Arm

Array = NDArray[np.float64]

_SAMPLES: Final = 20_000
_SHOWN: Final = 8


def with_missing_directions(
    refusal: RefusedFit, recording: Recording, field: ArrayLike, arm: Arm | None = None
) -> RefusedFit:
    """The refusal of a fit with known angles, followed by what was not seen.

    Args:
        refusal: what the estimator raised.
        recording: that was to be fitted.
        field: (3,) the field's direction in the base frame: the best estimate, or where that is left open what the user
            says it is (down, of gravity).
        arm: for joint angles.

    Raises:
        RigError: as ``Recording.rotations``.
    """
    some = recording.select(slice(None, None, -(-len(recording) // _SAMPLES)))
    vector = np.asarray(field, dtype=float)
    rotations = some.rotations(arm).reshape(-1, 3, 3)
    seen = coverage(np.matmul(vector / np.sqrt(vector @ vector), rotations))  # R^T f
    names = seen.missing_names
    if not names:
        return refusal
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return RefusedFit(
        f"{refusal}; the field was seen in {100.0 * seen.share:.0f} % of {seen.cells.count} equal cells of frame 6:"
        f" bring it along {', '.join(names[:_SHOWN])}{more}"
    )
