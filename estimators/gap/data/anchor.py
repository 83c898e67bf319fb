"""A calibration that is known from before, beside recordings.

It is as good as readings: its covariance, inverted, is information about the same parameters, and stands in the
whitened problem as so many rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import repeat
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimators.calibration import Calibration
from estimators.calibration.turned import turned
from estimators.gap.data.whitened import WhitenedData
from rig.arrays import Array
from rig.channels import CHANNELS, COLUMNS_OF
from rig.directions import tangent_basis
from rig.effects import Effect
from rig.errors import RigError
from rig.pipeline import Pipeline
from rig.signals import sampled

#: Eigenvalues of a calibration's correlation matrix below this are rounding.
_ROUNDING: Final = 1e-12


@dataclass(frozen=True)
class Anchor(WhitenedData):
    """A calibration from before, as rows of the whitened problem: for each channel some.

    Its "readings" are whitened already: the square root of the calibration's information times what its parameters are
    from those of the pipeline.

    Attributes:
        known: the calibration.
    """

    known: Calibration | None = None

    @classmethod
    def beside(cls, member: WhitenedData, pipeline: Pipeline, known: Calibration) -> Anchor:
        """At poses of a recording, which do not matter.

        Raises:
            RigError: it has no attitude, or lacks a sensor that was recorded.
        """
        for sensor in pipeline.sensors:
            own = known[sensor]
            if not own.axes or own.field_direction is None or own.method != "simultaneous":
                raise RigError(f"calibration of the {sensor}: found method {own.method!r}, expected simultaneous")
        known = replace(
            known, sensors={name: turned(own) if own.reads == "a-g" else own for name, own in known.sensors.items()}
        )
        count = -(-_size(pipeline) // len(pipeline.columns))
        base = sampled(member.base, slice(0, count))
        after = float(member.base.t[-1]) + np.arange(1.0, count + 1.0)
        base = replace(
            base,
            t=after,
            volts=np.zeros((count, len(CHANNELS))),
            known_links=None,
            known_nodes=None,
            velocity=base.velocity,
        )
        nothing = np.zeros((count, len(CHANNELS)))
        found = cls(base, pipeline, nothing, member.noises, nothing + 1.0, member.floor, known=known)
        return found.around(pipeline)

    def around(self, pipeline: Pipeline, in_place: Sequence[Effect] = ()) -> Anchor:
        """Around another calibration: the same information, seen from there."""
        found = replace(self, pipeline=pipeline)
        rows = np.zeros(len(self.columns) * self.count)
        rows[: len(found.root)] = found.root @ found.away
        readings = np.zeros_like(self.readings)
        readings[:, self.columns] = rows.reshape(len(self.columns), self.count).T
        return replace(found, readings=readings)

    @cached_property
    def root(self) -> Array:
        """(p, p) square root of the information, in the coordinates of ``WhitenedData.tangent``.

        Raises:
            RigError: the calibration does not tell all of its parameters.
        """
        assert self.known is not None
        total = _size(self.pipeline)
        found = np.zeros((total, total))
        first = 0
        for name in self.pipeline.sensors:
            turn = self._turn(name)
            covariance = turn @ self.known[name].vector_covariance @ turn.T
            variances = np.diag(covariance)
            if not (np.isfinite(variances) & (variances > 0.0)).all():
                raise RigError(f"calibration of the {name}: found parameters without a variance, expected one of each")
            scale = np.sqrt(variances)
            values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
            values = np.maximum(values, _ROUNDING)
            stop = first + len(turn)
            found[first:stop, first:stop] = (vectors / np.sqrt(values)).T / scale
            first = stop
        return found

    @cached_property
    def away(self) -> Array:
        """(p,) the calibration's parameters less those of the pipeline."""
        assert self.known is not None
        parts = []
        for name, sensor in self.pipeline.sensors.items():
            own = self.known[name]
            here = []
            for k in range(3):
                here += [sensor.sensitivity[k], sensor.offset[k], *sensor.axes[k]]
            there = []
            for k in range(3):
                there += [own.sensitivity[k], own.offset[k], *own.axis_vectors[k]]
            assert own.field_direction is not None
            here += list(_direction(self.pipeline, name))
            there += list(own.field_direction.vector)
            parts.append(self._turn(name, ordered=True) @ (np.array(there) - np.array(here)))
        return np.concatenate(parts)

    def of_channel(self, column: int) -> Array:
        """(count, p) rows of the whitened tangent."""
        every = np.zeros((len(self.columns) * self.count, len(self.root)))
        every[: len(self.root)] = self.root
        return np.asarray(every.reshape(len(self.columns), self.count, -1)[self.columns.index(column)])

    def whiten_means(self, column: int, means: Array) -> Array:
        """As they are."""
        return means

    def beside_each_other(self, white: Array, first: int = 0) -> Array:
        """As they are."""
        return white

    def change(self, effects: Sequence[Effect]) -> Array:
        """Nothing."""
        return np.zeros_like(self.readings)

    def changes(
        self, effects: Sequence[Effect], index: int, moved: Sequence[Effect], channels: NDArray[np.bool_]
    ) -> Iterator[Array]:
        """Nothing."""
        return repeat(np.zeros_like(self.readings), len(moved))

    def having(self, effects: Sequence[Effect]) -> WhitenedData:
        """As it is."""
        return self

    def without(self, left_out: NDArray[np.bool_]) -> WhitenedData:
        """As it is."""
        return self

    def averaged(self, block: int) -> WhitenedData:
        """As it is."""
        return self

    def coarse(self) -> WhitenedData:
        """As it is."""
        return self

    def _turn(self, name: str, ordered: bool = False) -> Array:
        """(14, v) from vector parameters to tangent coordinates; ``ordered``: of (S, delta, axis) thrice and field."""
        assert self.known is not None
        own = self.known[name]
        names = list(own.vector_parameters)
        if ordered:
            stems = ("sensitivity{}", "offset{}", "axis{}_x", "axis{}_y", "axis{}_z")
            names = [stem.format(k) for k in (1, 2, 3) for stem in stems] + ["field_x", "field_y", "field_z"]
        sensor = self.pipeline.sensors[name]
        found = np.zeros((14, len(names)))
        for k in range(3):
            found[4 * k, names.index(f"sensitivity{k + 1}")] = 1.0
            found[4 * k + 1, names.index(f"offset{k + 1}")] = 1.0
            at = names.index(f"axis{k + 1}_x")
            found[4 * k + 2 : 4 * k + 4, at : at + 3] = tangent_basis(sensor.axes[k])
        at = names.index("field_x")
        found[12:14, at : at + 3] = tangent_basis(_direction(self.pipeline, name))
        return found


def _direction(pipeline: Pipeline, sensor: str) -> Array:
    field = pipeline.environment.field(sensor)
    return np.asarray(field / np.linalg.norm(field))


def _size(pipeline: Pipeline) -> int:
    """How many parameters a calibration has."""
    return sum(4 * len(range(6)[COLUMNS_OF[name]]) + 2 for name in pipeline.sensors)
