"""Probabilities that a set's evidence does not tell: of defects, and of causes beside what no catalogue has."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from estimators.gap.data.defects import Defect
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.states import left_of
from estimators.gap.evidence.weighed import Weighed
from estimators.gap.hypotheses.candidates import split
from estimators.gap.hypotheses.prior import Prior
from estimators.gap.hypotheses.score import Explained
from estimators.gap.hypotheses.sources import STRENGTH
from estimators.gap.report import homogeneity, reach
from estimators.gap.search.hypothesis import Hypothesis
from estimators.gap.search.posterior import Posterior

#: Hypotheses that are looked at, by their probability.
WAYS: Final = 0.002
#: Terms of a discrepancy beside which causes are judged, by their share of it.
_SHARE: Final = 0.1


def log_bayes_factor(log_p: float) -> float:
    """The largest log Bayes factor that a p-value allows, -1/(e p log p): Sellke, Bayarri and Berger (American
    Statistician 55, 2001)."""
    log_p = max(min(log_p, -1.1), -1e6)
    return -log_p - math.log(-log_p) - 1.0


def _probability(log_odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-max(min(log_odds, 700.0), -700.0)))


def defect_probability(defect: Defect, prior: Prior, beside: WhitenedData | None = None) -> float:
    """Of a defect whose p-value is known.

    Args:
        beside: the recording, where it has something outside the catalogue, which may have made single readings: those
            of a cause are then everywhere, if they may be anywhere. At a limit they are where the signal is.
    """
    place = defect.effect, defect.where
    own = tuple(label for label in prior.places[defect.effect] if split(label) == place)
    odds = log_bayes_factor(defect.log_p)
    if beside is not None and defect.anywhere and defect.affected.any():
        odds = min(odds, homogeneity.log_bayes_factor_of_readings(np.asarray(defect.affected.any(axis=1)), beside))
    return _probability(odds + prior.log_single((defect.effect, own)))


def doubts(posterior: Posterior) -> dict[int, tuple[float, ...]]:
    """For the hypotheses that hold something outside the catalogue, by their number, the probability of each member of
    their explanation, then of each noise effect in the order of their labels: as the catalogue's effects do part of
    what it does, their own evidence is no longer one."""
    found: dict[int, tuple[float, ...]] = {}
    known: dict[tuple[int, int], list[float]] = {}
    gained: dict[int, list[reach.Gains]] = {}
    second = any(each.further for each in posterior.hypotheses)
    for number, (each, probability) in enumerate(zip(posterior.hypotheses, posterior.probabilities, strict=True)):
        if not each.other or probability < WAYS:
            continue
        explanation, prior = each.explanation, posterior.prior
        if id(explanation) not in gained:
            gained[id(explanation)] = reach.gains(explanation)
        images = [reach.log_prior_of_image(gains, each, second) for gains in gained[id(explanation)]]
        shares, believed = [], []
        for beside, share in _besides(each):
            key = id(explanation), id(beside)
            if key not in known:
                known[key] = [
                    homogeneity.log_bayes_factor(explanation, index, beside) + prior.log_single(member.drawn)
                    for index, member in enumerate(explanation.members)
                ]
            shares.append(share)
            believed.append([_probability(odds - image) for odds, image in zip(known[key], images, strict=True)])
        found[number] = tuple(np.average(believed, axis=0, weights=shares).tolist())
        if noises := sorted(each.state.fitted, key=lambda fitted: fitted.label):
            here = explanation.on(posterior.scanner.fine.data)
            data, linear = here.data, here.linear
            lefts = left_of(data, Explained(data.absorbed, linear.left))
            found[number] += tuple(
                _probability(
                    homogeneity.log_bayes_factor_of_noise(fitted, lefts)
                    + prior.log_single((fitted.effect.name, (fitted.label,)))
                    - reach.log_prior_of_image(reach.gains_of_noise(fitted, data.columns), each, second=False)
                )
                for fitted in noises
            )
    return found


def _besides(hypothesis: Hypothesis) -> list[tuple[Weighed | None, float]]:
    """What the discrepancy of a hypothesis may be, each with its probability; None without one, and where it is that a
    cause has another form: a cause in doubt is asked for one strength, not for one beside what that changes with."""
    if not hypothesis.terms:
        return [(None, 1.0)]
    masses = np.array([one.log_mass for one in hypothesis.terms])
    shares = np.exp(masses - np.logaddexp.reduce(masses))
    likely = [(one, float(share)) for one, share in zip(hypothesis.terms, shares, strict=True) if share >= _SHARE]
    every = likely or [(hypothesis.terms[0], 1.0)]
    return [(None if one.term.source.startswith(STRENGTH) else one, share) for one, share in every]
