"""Widths of a shape over which its effect is not straight: how far a magnet is, how slowly something warms.

Laplace's approximation takes the posterior about a fit for normal. Along each principal direction of the shape's
covariance it is evaluated instead, strengths and the other effects integrated out, and its second moment takes the
place of the normal one (Rue, Martino and Chopin, Journal of the Royal Statistical Society B 71, 2009, section 6.5).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from estimators.gap.data.projection import project
from estimators.gap.evidence.refine import tangent_of, touched_by
from estimators.gap.search.hypothesis import Hypothesis
from rig.arrays import Array
from rig.effects.parameters import Parameter

#: Standard deviations at which it is looked at first; beside these, and beyond, where it is not normal there by so
#: much log density; how far it is then taken to differ ever more from that.
_FIRST, _MORE, _NORMAL, _END = (-2.0, 2.0), (-4.0, -3.0, -1.0, 1.0, 3.0, 4.0), 0.3, 10.0
_POINTS: Final = 401
#: A shape of which the data leave more than this share of the prior's width is told by that.
_TOLD: Final = 0.5


def is_curved(item: Parameter) -> bool:
    """Whether a parameter is a shape that no sum of others spans: a place or a time, no phase, direction or tone."""
    return not (item.strength or item.spanned or item.unit_vector or item.unit == "Hz")


def beyond_normal(hypothesis: Hypothesis, index: int) -> Array:
    """(q, q) what is to be added to the covariance of an effect's parameters, in typical sizes.

    Nothing where something without a name is there too: its widths are of how the misfit scatters.

    Args:
        index: the effect's number in the set.
    """
    linear, fit = hypothesis.explanation.linear, hypothesis.explanation.fits[index]
    own = np.flatnonzero(linear.owner == index)
    found = np.zeros((len(own), len(own)))
    curved = np.array([is_curved(item) for item in fit.free for _ in range(item.size)], dtype=bool)
    if hypothesis.other or not curved.any():
        return found
    covariance = hypothesis.moments[1]
    shape = own[curved]
    values, vectors = np.linalg.eigh(covariance[np.ix_(shape, shape)])
    told = vectors.T**2 @ linear.width[shape] ** 2
    ray = Ray(hypothesis, index, shape)
    middle = ray.at(0.0, np.zeros(len(covariance)))
    for value, vector, wide in zip(values, vectors.T, told, strict=True):
        if not 0.0 < value < _TOLD**2 * wide:
            continue
        along = covariance[:, shape] @ vector / np.sqrt(value)  # of all parameters, for one standard deviation
        found += ray.second_moment(along, own, middle) - np.outer(along[own], along[own])
    return found


@dataclass(frozen=True)
class Ray:
    """A set of effects along a direction of one effect's shape.

    Attributes:
        hypothesis: the set. index: the effect's number. shape: where its shape is among all parameters.
    """

    hypothesis: Hypothesis
    index: int
    shape: NDArray[np.intp]

    @cached_property
    def touched(self) -> list[NDArray[np.bool_]]:
        """The channels of each effect, which are the same wherever it is fitted."""
        return touched_by(self.hypothesis.explanation.fits, self.hypothesis.explanation.data)

    def second_moment(self, along: Array, own: NDArray[np.intp], middle: tuple[float, Array]) -> Array:
        """(q, q) of the effect's parameters about the fitted ones.

        Args:
            along: (p,) what all parameters move by for one standard deviation. own: (q,) which are the effect's.
            middle: what is at the fitted ones, where all directions begin.
        """
        told = {0.0: np.append(0.0, middle[1][own])}  # log density beyond the normal one's, and where parameters are
        for some in (_FIRST, _MORE):
            for place in some:
                density, moved = self.at(place, along)
                told[place] = np.append(density - middle[0] + 0.5 * place**2, moved[own])
            if all(abs(told[place][0]) < _NORMAL for place in _FIRST):
                return np.outer(along[own], along[own])
        places = np.array(sorted(told))
        both = np.stack([told[place] for place in places])
        further = (_END - places[-1]) / (places[-1] - places[-2])
        low, high = (both[last] + further * (both[last] - both[before]) for last, before in ((0, 1), (-1, -2)))
        places, both = np.concatenate([[-_END], places, [_END]]), np.vstack([low, both, high])
        fine = np.linspace(-_END, _END, _POINTS)
        found = PchipInterpolator(places, both)(fine)
        log_density, moved = found[:, 0] - 0.5 * fine**2, found[:, 1:]
        weight = np.exp(log_density - log_density.max())
        return np.asarray((moved * (weight / weight.sum())[:, None]).T @ moved)

    def at(self, place: float, along: Array) -> tuple[float, Array]:
        """Log density of the shape at so many standard deviations, all others integrated out; and by what (p,) all
        parameters are moved there, in typical sizes."""
        explanation, linear = self.hypothesis.explanation, self.hypothesis.explanation.linear
        data, moved = explanation.data, place * along
        fits = [
            replace(fit, values=fit.values + moved[linear.owner == number] * fit.scale)
            for number, fit in enumerate(explanation.fits)
        ]
        change = data.change([fit.effect for fit in fits])
        tangent = linear.tangent.copy()
        tangent[:, linear.owner == self.index] = project(
            data.absorbed, tangent_of(self.index, fits, data, self.touched, change)
        )
        left = project(data.absorbed, data.whiten(data.residual - change))
        others = np.ones(len(moved), dtype=bool)
        others[self.shape] = False
        precision = linear.likeliest
        pull = linear.pull - moved
        information = tangent[:, others].T @ tangent[:, others] + np.diag(precision[others])
        score = tangent[:, others].T @ left + precision[others] * pull[others]
        step = np.linalg.solve(information, score)
        moved = moved.copy()
        moved[others] += step
        log_density = -0.5 * float(left @ left) - 0.5 * float(precision @ pull**2) + 0.5 * float(score @ step)
        return log_density - 0.5 * float(np.linalg.slogdet(information)[1]), moved
