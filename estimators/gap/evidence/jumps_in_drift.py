"""When an error source jumps in a floor that drifts.

Whitened, a jump is a spike that fades, and a level that lasts is little: segments of one level do not show it. A step
at each instant is therefore tried as the floor's filter makes it, by the score of the residual; the one that explains
most is added, and all of them are fitted anew (orthogonal matching pursuit: Pati, Rezaiifar and Krishnaprasad, Asilomar
Conference on Signals, Systems and Computers, 1993).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from estimators.gap.data.projection import orthonormal, project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.hypotheses.sources import Source
from rig.arrays import Array

#: More jumps are not followed: each is fitted with all before it.
_MOST: Final = 32
#: A step of which the calibration leaves less than this share is not one.
_LEFT: Final = 1e-3
#: And a direction of which it leaves less than this share of the most tells nothing, nor one of which steps before do.
_TAKEN: Final = 1e-6


def scores(data: WhitenedData, white: Array) -> Array:
    """(m, c, n) what readings each sample of whitened ones (m, c, n) is made of: the filters' transposes."""
    found = np.empty_like(white)
    for index, column in enumerate(data.columns):
        found[:, index] = data.whiteners[column].from_rest(white[:, index, ::-1])[:, ::-1]
    return found


@dataclass(frozen=True, eq=False)
class StepsInDrift:
    """Steps of one source, at each instant.

    Attributes:
        source: one that tells what is felt. taken: ``scores`` of what the calibration takes.
    """

    data: WhitenedData
    source: Source
    taken: Array

    @property
    def _felt(self) -> Array:
        assert self.source.felt is not None
        return self.source.felt[0]

    @cached_property
    def _inverse(self) -> Array:
        """(n, f, f) of the information about a step at each instant, beside the calibration."""
        felt, count = self._felt, self.data.count
        # long after it a step is the source; before, as the filter answers to a step of what the source was at first
        told = _from_here(np.einsum("fcn,gcn->nfg", self.source.series, self.source.series))
        for index, column in enumerate(self.data.columns):
            own = felt[:, index].T
            if own.any():
                response = self.data.whiteners[column].from_rest(np.ones(count)) ** 2
                begins = np.cumsum(response - response[-1])[::-1]
                told += begins[:, None, None] * own[:, :, None] * own[:, None, :]
        shared = _from_here(np.einsum("fcn,pcn->nfp", felt, self.taken))
        left = told - shared @ shared.transpose(0, 2, 1)
        there = np.trace(left, axis1=1, axis2=2) > _LEFT * np.trace(told, axis1=1, axis2=2)
        values, vectors = np.linalg.eigh(left[there])
        told_of = values > _TAKEN * values[:, -1:]
        found = np.zeros_like(told)
        found[there] = (vectors * np.where(told_of, 1.0 / np.where(told_of, values, 1.0), 0.0)[:, None]) @ vectors.mT
        return found

    def squares(self, left: Array) -> Array:
        """(n,) about what a step at each instant explains of the squares that are left (c, n)."""
        moments = _from_here(np.einsum("fcn,cn->nf", self._felt, scores(self.data, left[None])[0]))
        return np.asarray(np.einsum("nf,nfg,ng->n", moments, self._inverse, moments))

    def instants(self, left: Array, price: float) -> list[int]:
        """When it jumps, as long as each further jump explains twice its price.

        Args:
            left: (c, n) whitened, with the calibration projected out. price: of an instant, in log likelihood.
        """
        at: list[int] = []
        steps: list[Array] = []  # orthonormal, each beside those before it
        rest = left.ravel()
        while len(at) < _MOST:
            every = self.squares(rest.reshape(left.shape))
            every[at] = 0.0
            instant = int(np.argmax(every))
            step = (np.arange(self.data.count) >= instant).astype(float)[:, None]
            if every[instant] < price or (more := self.source.along(step, np.ones(1))) is None:
                break
            own = project(self.data.absorbed, more.series.reshape(len(more.series), -1).T)
            size = np.sum(own**2, axis=0)
            for _ in range(2):  # once leaves what rounding makes of it
                for before in steps:
                    own = project(before, own)
            new = orthonormal(own[:, np.sum(own**2, axis=0) > _TAKEN * size])
            made = new @ (new.T @ rest)
            if 0.5 * float(made @ made) < price:
                break
            at.append(instant)
            steps.append(new)
            rest = rest - made
        return sorted(at)


def _from_here(values: Array) -> Array:
    """Sums of values (n, ...) from each of them on."""
    return np.asarray(np.cumsum(values[::-1], axis=0)[::-1])
