"""The poses from which a calibration is most certain, chosen among many: an optimal design by exchange.

A pose's worth is its Fisher information, and information adds up. The design makes the largest standard deviation,
each relative to a reference, as small as it can (Fedorov's exchange with the minimax criterion in place of the
determinant; V. V. Fedorov, "Theory of optimal experiments", 1972).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimators.known_angle.model import SensorParameters
from rig.arrays import Array, Mask, Rows
from rig.threads import one_blas_thread

#: Of a parameter that nothing tells, over the reference.
OPEN: Final = 1e6
_ROUNDS: Final = 12
_PARAMETERS: Final = 14


@dataclass(frozen=True, eq=False)
class Criterion:
    """What a design is judged by: standard deviations of one sensor over reference ones.

    Attributes:
        sensor: its name. names: (14,) of the coordinates: an axis and the field count along elevation and azimuth.
        jacobian: (3, 10, 14) of the readings by these coordinates. noise: (3,) of a sample [recorded unit].
        reference: (14,) standard deviations that one is compared with. weight: (14,) how much each counts.
        gain: (3, 3) of the channels by the field in frame 6 [recorded unit per field unit].
    """

    sensor: str
    names: tuple[str, ...]
    jacobian: Array
    noise: Array
    reference: Array
    weight: Array
    gain: Array

    @classmethod
    def of(
        cls,
        sensor: str,
        truth: SensorParameters,
        noise: Array,
        gram: Array,
        weights: Mapping[str, float] | None = None,
    ) -> Criterion:
        """Of a sensor, relative to the bound of a reference maneuver.

        Args:
            gram: (10, 10) of the reference's samples. weights: stem such as "sensitivity", "axis" or "offset1" -> how
                much it counts; one where nothing is said, zero to leave it out.
        """
        names = coordinate_names()
        jacobian = truth.jacobian("simultaneous") @ truth.along_angles("simultaneous").T
        weight = np.array([_weight(name, weights or {}) for name in names])
        found = cls(sensor, names, jacobian, noise, np.ones(_PARAMETERS), weight, truth.gain)
        return replace(found, reference=found.std(found.information(gram)[None])[0])

    def information(self, gram: Array) -> Array:
        """(..., 14, 14) of Gram matrices (..., 10, 10)."""
        weighted = self.jacobian / self.noise[:, None, None]
        return np.asarray(np.einsum("kip,...ij,kjq->...pq", weighted, gram, weighted, optimize=True))

    def std(self, information: Array) -> Array:
        """(m, 14) standard deviations of (m, 14, 14); ``OPEN`` where nothing is told."""
        size = np.sqrt(np.maximum(np.einsum("mii->mi", information), 1e-300))
        scaled = information / (size[:, :, None] * size[:, None, :])
        values, vectors = np.linalg.eigh(scaled)
        open_ = values < 1e-10
        inverse = np.where(open_, 0.0, 1.0 / np.where(open_, 1.0, values))
        variance = np.einsum("mij,mj,mij->mi", vectors, inverse, vectors)
        lost = np.einsum("mij,mj->mi", vectors**2, open_.astype(float)) > 1e-6
        return np.asarray(np.where(lost, OPEN, np.sqrt(variance) / size))

    def moved(self, information: Array, cross: Array) -> Array:
        """(m, 14) by how much a field that the calibration does not know of moves what it finds.

        Args:
            information: (m, 14, 14). cross: (m, 10, 3) sum over samples of (vec R, 1) times that field, frame 6.
        """
        weighted = self.jacobian / self.noise[:, None, None] ** 2
        score = np.einsum("kip,mij,kj->mp", weighted, cross, self.gain, optimize=True)
        return np.asarray(np.einsum("mpq,mq->mp", np.linalg.pinv(information, hermitian=True), score))

    def ratios(self, information: Array, moved: Array | None = None) -> Array:
        """(m, k) weighted errors over their references, standard deviation and (m, 14) ``moved`` in squares; what the
        reference leaves open is left out."""
        told = (self.reference < OPEN) & (self.weight > 0.0)
        std = self.std(information)
        return np.asarray((self.weight * (std if moved is None else np.hypot(std, moved)) / self.reference)[:, told])

    def worst(self, information: Array) -> Array:
        """(m,) the largest of the ratios."""
        return np.asarray(self.ratios(information).max(axis=1, initial=0.0))


def coordinate_names() -> tuple[str, ...]:
    """Of the coordinates of a criterion."""
    own = [(f"sensitivity{k}", f"offset{k}", f"axis{k}_elevation", f"axis{k}_azimuth") for k in (1, 2, 3)]
    return (*(name for each in own for name in each), "field_elevation", "field_azimuth")


def _weight(name: str, weights: Mapping[str, float]) -> float:
    stem = name.partition("_")[0]
    return float(weights.get(stem, weights.get(stem.rstrip("123"), 1.0)))


def exchange(
    criteria: list[Criterion], grams: Array, count: int, samples: float, start: Rows, allowed: Mask
) -> tuple[Rows, float]:
    """Choose poses.

    Args:
        criteria: of the sensors. grams: (m, 10, 10) of one sample in each candidate pose.
        count: how many poses. samples: in each of them.
        start: (count,) candidates to begin with. allowed: (m,) those that may be chosen.

    Returns:
        The chosen (count,), and the criterion's value.
    """
    with one_blas_thread():
        parts = [samples * criterion.information(grams) for criterion in criteria]
        chosen = np.array(start)
        value = max(
            float(criterion.worst(part[chosen].sum(axis=0)[None])[0])
            for criterion, part in zip(criteria, parts, strict=True)
        )
        for _ in range(_ROUNDS):
            before = value
            for place in range(count):
                rest = np.delete(chosen, place)
                trial = np.max(
                    [
                        criterion.worst(part[rest].sum(axis=0) + part)
                        for criterion, part in zip(criteria, parts, strict=True)
                    ],
                    axis=0,
                )
                trial[~allowed] = np.inf
                trial[rest] = np.inf
                best = int(np.argmin(trial))
                if trial[best] < value * (1.0 - 1e-6):
                    chosen[place], value = best, float(trial[best])
            if value > before * (1.0 - 1e-3):
                break
    return chosen, value
