"""A magnetic field that stands in the room: any that has no source where the sensor goes.

Inside a sphere such a field is that of charges on it (equivalent sources: Dampney, "The equivalent source technique",
Geophysics 34, 1969); the wider the sphere, the smoother the field. Dipoles and gradients, if there are enough of them,
can be fitted to it as well, but are more likely only where they take fewer numbers.
"""

from __future__ import annotations

from dataclasses import replace
from math import log
from typing import Final

import numpy as np

from estimators.gap.data.projection import Basis
from estimators.gap.evidence.means import Means
from estimators.gap.evidence.terms import Term, terms_along
from estimators.gap.hypotheses.courses import Course
from estimators.gap.hypotheses.sources import Source
from rig.arrays import Array
from rig.directions import spiral

#: What an error of the field follows, by the radius of the sphere in that of the path: cables and beams beside it, and
#: what stands in the room.
SPHERES: Final = {
    "position, as a static field with sources near it does": 1.2,
    "position, as a static field with distant sources does": 2.0,
}
#: Charges on each: fields of a tenth order.
_CHARGES: Final = 144
#: [m] of a path that goes nowhere.
_NOWHERE: Final = 1e-3


def static_fields(
    absorbed: Basis, field: Source, position: Array, log_prior: float, means: Means | None = None
) -> list[Term]:
    """A term for each of the spheres; none where the sensor's position is not known, or does not change.

    Args:
        absorbed: the calibration's tangent, of every sample.
        field: the magnetic field's error along the base's axes. position: (n, 3) [m] of the sensor, in that frame.
        log_prior: of both together.
        means: the sums over neighbouring samples that field and positions are of; None: of every sample.
    """
    if not position.size or float(np.ptp(position, axis=0).max()) < _NOWHERE:
        return []
    share = log_prior - log(len(SPHERES))
    return [term for name in SPHERES for term in around(absorbed, field, position, name, share, means)]


def around(
    absorbed: Basis, field: Source, position: Array, name: str, log_prior: float, means: Means | None = None
) -> list[Term]:
    """As ``static_fields``, of one of the spheres."""
    away = (position - 0.5 * (position.min(axis=0) + position.max(axis=0))).T
    away = away / float(np.linalg.norm(away, axis=0).max())
    own, whitened = (field.series, None) if field.felt is None or means else field.felt
    series = np.zeros((_CHARGES, *own.shape[1:]))
    touched = own.any(axis=(0, 2))
    for number, charge in enumerate(spiral(_CHARGES, 2.0)):
        one = _of_charge(away - SPHERES[name] * charge[:, None])
        series[number, touched] = np.einsum("icn,in->cn", own[:, touched], one)
    source = replace(field, series=series if whitened is None else whitened(series), felt=None)
    course = Course(name, np.ones((series.shape[2], 1)), np.ones(1))
    return terms_along(absorbed, source, course, log_prior, means)


def _of_charge(way: Array) -> Array:
    """(3, n) the field at so many ways (3, n) from a charge, less its mean: the calibration takes what is constant."""
    field = way / np.einsum("in,in->n", way, way) ** 1.5
    return np.asarray(field - field.mean(axis=1, keepdims=True))
