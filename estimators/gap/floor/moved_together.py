"""The floors of a sensor's channels, moved together: what the poses at rest did not show is alike in size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.linalg import block_diag

from estimators.gap.floor.colour import APART
from estimators.gap.floor.learned import Spectrum
from rig.arrays import Array

#: Passes over the channels, each moved given the others.
_PASSES: Final = 3


def moved_together(spectra: Sequence[Spectrum]) -> tuple[list[Array], float]:
    """The likeliest points of a sensor's channels without anything added, and the log of the share that they take of
    what the recording at rest, and a prior, leave possible (Laplace), with how well they fit that recording.

    Args:
        spectra: of the channels, which have the same unseen parts.
    """
    precision = _prior_precision(spectra)
    edges = np.cumsum([0, *(each.learned.free for each in spectra)])
    own = [slice(first, last) for first, last in pairwise(edges)]
    expected = np.concatenate([each.expected for each in spectra])
    point = np.concatenate([each.alone[0] for each in spectra])
    coupled = len(spectra) > 1 and spectra[0].learned.unseen
    for each, here in list(zip(spectra, own, strict=True)) * (_PASSES if coupled else 0):
        alone = np.diag(precision[here, here])
        others = precision[here] @ (point - expected) - alone * (point - expected)[here]
        point[here] = replace(each, believed=(each.expected - others / alone, alone), near=point[here]).alone[0]
    points = [point[here] for here in own]
    pairs = list(zip(spectra, points, strict=True))
    known = block_diag(*(each.learned.information(at) for each, at in pairs)) + precision
    sweep = block_diag(*(each.information(at) for each, at in pairs))
    spread = np.linalg.slogdet(known + sweep)[1] - np.linalg.slogdet(known)[1]
    off = point - expected
    return points, -0.5 * float(spread + off @ precision @ off + sum(each.learned.penalty(at)[0] for each, at in pairs))


def _prior_precision(spectra: Sequence[Spectrum]) -> Array:
    """(p, p) of the points of all channels, one after the other."""
    precision = np.diag(np.concatenate([each.precision for each in spectra]))
    first = np.cumsum([0, *(each.learned.free for each in spectra[:-1])])
    unseen = [start + np.arange(each.learned.free)[each.unseen] for start, each in zip(first, spectra, strict=True)]
    for places in np.transpose(unseen):
        shared = 1.0 / float(np.mean(np.diag(precision)[places])) - APART**2
        covariance = shared + APART**2 * np.eye(len(spectra))
        precision[np.ix_(places, places)] = np.linalg.inv(covariance)
    return precision
