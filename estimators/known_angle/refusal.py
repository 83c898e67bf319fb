"""When a calibration is refused, and the reason in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from estimators.known_angle.identifiability import Information
from estimators.known_angle.model import PARAMETERS_AT_ONCE, SensorParameters, columns_of_channels
from rig.arrays import Array
from rig.directions import tangent_basis

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
    channels = 3 if information.method == "simultaneous" else 1
    equations = channels * (rank + 1)
    parameters_at_once = PARAMETERS_AT_ONCE[information.method]
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
    columns = [of_field for _, _, of_field in columns_of_channels(information.method)]
    for rival in rivals:
        k = rival.channel or 0
        own_noise = noise if rival.channel is None else noise[k]
        for field, excess in zip(rival.field, rival.excess, strict=True):
            chi_square = count * float((excess / np.square(own_noise)).sum())
            if chi_square < AMBIGUOUS_CHI_SQUARE and _apart(
                parameters.fields[k], field, covariance[columns[k], columns[k]]
            ):
                angle = np.degrees(np.arccos(min(1.0, abs(float(parameters.fields[k] @ field)))))
                return (
                    f"two solutions whose fields lie {angle:.2g} deg apart fit alike (chi-square differs by"
                    f" {chi_square:.1f}, expected {AMBIGUOUS_CHI_SQUARE:g} or more); {_REMEDY}"
                )
    return None


def _apart(field: Array, other: Array, covariance: Array) -> bool:
    """Whether two directions, up to their sign, are farther apart than the covariance (2, 2) of the first explains."""
    error = tangent_basis(field) @ (other if float(field @ other) > 0.0 else -other)
    return bool(error @ np.linalg.solve(covariance, error) > SAME_SIGMAS**2)


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
    return " and ".join([", ".join(parts[:-1]), parts[-1]]) if len(parts) > 1 else parts[0]
