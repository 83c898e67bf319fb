"""When a calibration is refused, and the reason in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from estimators.known_angle.identifiability import Information
from estimators.known_angle.model import PARAMETERS_AT_ONCE, SensorParameters
from rig.arrays import Array
from rig.errors import in_a_row

if TYPE_CHECKING:
    from estimators.batch.optimum import Rivals

#: A tenth of the quantity itself (of S_k, of S_k |f|, of a radian): beyond it an answer is worth less than a data
#: sheet. Where the true field is such that the poses tell nothing, an estimate of the field that is off by z of its
#: standard deviations makes them seem to tell everything to 1/z: noise would have to reach ten sigmas to deceive.
UNCERTAINTY_LIMIT: Final = 0.1
#: Two minima closer than this in chi-square are one the data cannot choose between (3.5 standard deviations) ..
AMBIGUOUS_CHI_SQUARE: Final = 12.0
#: .. unless the covariance covers both: their fields lie within this many standard deviations of each other.
SAME_SIGMAS: Final = 5.0

_REMEDY: Final = "turn the sensor about at least two axes, through more orientations"


def why_not(
    parameters: SensorParameters,
    information: Information,
    covariance: Array,
    spread: Array,
    rank: int,
    rivals: Sequence[Rivals],
    noise: Array,
    count: int,
) -> str | None:
    """Why the data cannot tell the parameters, or None where they can.

    Args:
        parameters, information, covariance: the optimum, in the coordinates of ``SensorParameters.jacobian``.
        spread: (9, 9) covariance of vec R. rank: dimensions that the orientations span.
        rivals: the other local minima.
        noise: (3,) standard deviation of a reading [recorded unit].
        count: n.
    """
    method = information.method
    channels = 3 if method == "simultaneous" else 1
    equations = channels * (rank + 1)
    parameters_at_once = PARAMETERS_AT_ONCE[method]
    undetermined = information.undetermined()
    if undetermined:
        return (
            f"these poses cannot determine {listed(undetermined)}: {_seen(parameters, spread, rank, 1e-10)}; {_REMEDY}"
        )
    if equations < parameters_at_once + channels:
        return (
            f"{rank + 1} orientations give {equations} equations for {parameters_at_once} parameters, too few to"
            f" check the answer by; {_REMEDY}"
        )
    uncertain = information.uncertain(covariance, UNCERTAINTY_LIMIT)
    if uncertain:
        return (
            f"these poses and this noise leave {listed(uncertain)} uncertain by more than a tenth of itself or 0.1 rad"
            f" (condition {information.condition:.1e}): {_seen(parameters, spread, rank, 1e-2)}; {_REMEDY}"
        )
    for rival in rivals:
        alike, excess = rival.alike(parameters.fields[None], covariance[None], noise[None], np.array([count]), method)
        if len(alike):
            best, other = parameters.fields[rival.channel or 0], rival.field[alike[0]]
            angle = np.degrees(np.arccos(min(1.0, abs(float(best @ other)))))
            return (
                f"two solutions whose fields lie {angle:.2g} deg apart fit alike (chi-square differs by"
                f" {excess[0]:.1f}, expected {AMBIGUOUS_CHI_SQUARE:g} or more); {_REMEDY}"
            )
    return None


def _seen(parameters: SensorParameters, covariance: Array, rank: int, limit: float) -> str:
    """What the sensor has seen of the field, by the covariance of R^T f: its eigenvalues above ``limit``."""
    field = parameters.fields[0]
    blocks = covariance.reshape(3, 3, 3, 3)
    values = np.linalg.eigvalsh(np.einsum("i,ijkl,k->jl", field, blocks, field))
    dimensions = int((values > limit).sum())
    if dimensions < 3:
        shape = ("one direction", "two directions", "directions on one circle")[dimensions]
        return f"the sensor sees the field from {shape} only, as in three orientations or in turns about one axis"
    return f"the orientations span {rank} dimensions, as {rank + 1} of them do, or turns about too few axes"


def listed(names: tuple[str, ...]) -> str:
    """``sensitivity1-3, axis1-3 and the field``, say."""
    parts: list[str] = []
    for stem in ("sensitivity", "offset", "axis", "field"):
        numbers = [name[len(stem) :] for name in names if name.startswith(stem)]
        if numbers == ["1", "2", "3"]:
            parts.append(f"{stem}1-3")
        elif numbers == [""]:
            parts.append("the field")
        else:
            parts += [stem + number for number in numbers]
    return in_a_row(parts)
