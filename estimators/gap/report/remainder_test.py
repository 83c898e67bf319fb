"""Whether what a fitted rig leaves of a fresh recording is the floor: a test with a stated false-refusal rate.

A rig was fitted: its parameters are known as well as they were found, and no better.

The statistic is a Bayes factor, of something left against nothing left; its p-value comes from noise of the floor
drawn on the same recording (I. J. Good, "The Bayes/non-Bayes compromise", Journal of the American Statistical
Association 87, 1992). What may be left: other values of the rig's own parameters; beside these, any effect of the
catalogue; and any error source along any course (``discrepancy``). Each third weighs alike.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from typing import Final

import numpy as np

from estimators.gap.data.projection import Basis, orthonormal, project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.discrepancy import Discrepancies
from estimators.gap.evidence.states import SLOWER
from estimators.gap.evidence.terms import Term
from estimators.gap.hypotheses.candidates import Candidate
from estimators.gap.hypotheses.prior import DISCREPANCY_SNR, Prior
from estimators.gap.hypotheses.scan import Scanner
from estimators.gap.hypotheses.score import ABSORBED
from estimators.gap.search.posterior import Posterior
from rig.arrays import Array
from rig.effects import Effect
from rig.effects.parameters import Parameter, Value

#: Drawn recordings of the floor: the p-value has steps of one over this plus one.
_DRAWS: Final = 199
#: Signal-to-noise of what may be left, each as likely.
_SNR: Final = DISCREPANCY_SNR * np.array([0.5, 1.0, 2.0, 4.0])
#: A direction of which a projection leaves less of its square is gone.
_GONE: Final = ABSORBED**2


def remainder_p_value(posterior: Posterior, std: Sequence[Mapping[str, Value]] = ()) -> float:
    """The share of the rig's own recordings that look more like something left than this one.

    Args:
        posterior: of a fresh recording, with the fitted rig's effects given. A coloured floor is taken to go on, slower
            than poses at rest can show, where that is the likelier floor.
        std: of the first given effects, standard deviations of their parameters by name; exact where there is none.
    """
    scanner, discrepancies = posterior.scanner, posterior.discrepancies
    floors = [each for each in posterior.hypotheses if not each.labels and not each.other]
    state = max(floors, key=lambda each: each.log_mass).state
    if state.name == SLOWER:
        scanner = scanner.stepped(state.steps)
        discrepancies = Discrepancies.of(scanner.fine.data, scanner.rough.data)
    return p_value(scanner, discrepancies, posterior.candidates, posterior.prior, std)


def p_value(
    scanner: Scanner,
    discrepancies: Discrepancies,
    candidates: Sequence[Candidate],
    prior: Prior,
    std: Sequence[Mapping[str, Value]] = (),
) -> float:
    """As ``remainder_p_value``, of candidates that were scanned."""
    data = scanner.fine.data
    means = discrepancies.means
    rng = np.random.default_rng(0)
    tangent, known = _own_tangent(data, std)
    noise = _drawn(data, rng) + (tangent * known) @ rng.standard_normal((len(known), _DRAWS))
    fine = np.column_stack([data.whitened, project(data.absorbed, noise)])
    summed = means(fine)
    absorbed = orthonormal(means(data.absorbed.dense()))
    rough = project(absorbed, summed)
    own = _basis(means(tangent), absorbed)
    square = np.sum((own.T @ rough) ** 2, axis=0)
    logs = [_gain(square, own.shape[1])] if own.shape[1] else []
    left_rough = project(own, rough)
    own_fine = _basis(tangent, data.absorbed)
    left_fine = project(own_fine, fine)
    catalogue = []
    for log_prior, columns, on_means in _columns(scanner, candidates, prior):
        held, left = (own, left_rough) if on_means else (own_fine, left_fine)
        basis = _basis(columns, absorbed if on_means else data.absorbed, held)
        if basis.shape[1]:
            more = np.sum((basis.T @ left) ** 2, axis=0)
            catalogue.append(log_prior + _gain(square + more, basis.shape[1] + own.shape[1]))
    if catalogue:
        logs.append(np.logaddexp.reduce(catalogue, axis=0))
    terms = [
        term.log_prior + _term_gain(term, fine if term.errors.means is None else summed) for term in discrepancies.terms
    ]
    logs.append(np.logaddexp.reduce(terms, axis=0))
    statistic = np.logaddexp.reduce(logs, axis=0)
    return float(np.mean(statistic >= statistic[0] - 1e-9))


def _drawn(data: WhitenedData, rng: np.random.Generator) -> Array:
    """(m, draws) whitened noise of a floor that is known as well as it was learned."""
    noise = rng.standard_normal((len(data.columns), data.count, _DRAWS))
    for index, column in enumerate(data.columns):
        samples = data.floor_samples[column]
        if samples > 1.0:
            noise[index] *= np.sqrt(samples / rng.chisquare(samples, _DRAWS))
        noise[index] *= (data.weights[:, column] > 0.0)[:, None]
    return noise.reshape(-1, _DRAWS)


def _own_tangent(data: WhitenedData, std: Sequence[Mapping[str, Value]]) -> tuple[Array, Array]:
    """What the numbers of the rig's own effects do to the whitened readings (m, p), each moved by a little, and how
    many such moves its standard deviation is (p,)."""
    found, known = [], []
    for index, effect in enumerate(data.given):
        for moved, item, place in _moved(effect):
            given = (*data.given[:index], moved, *data.given[index + 1 :])
            found.append(data.whiten(replace(data, given=given).modelled - data.modelled))
            own = std[index].get(item.name, 0.0) if index < len(std) else 0.0
            known.append(np.broadcast_to(own, item.size)[place] / item.step)
    return np.column_stack(found) if found else np.zeros((data.size, 0)), np.array(known)


def _moved(effect: Effect) -> Iterator[tuple[Effect, Parameter, int]]:
    """The effect with each of its numbers moved by a little of its typical size; which parameter, and where in it."""
    for item in effect.parameters():
        values = np.atleast_1d(np.asarray(getattr(effect, item.name), dtype=float))
        if item.name == "at_s" or not np.isfinite(values).all():
            continue
        for place in range(item.size):
            for sign in (1.0, -1.0):  # a bound may be on one side
                other = values.copy()
                other[place] += sign * item.step
                if item.lower <= other[place] <= item.upper:
                    value = float(other[0]) if item.size == 1 else tuple(map(float, other))
                    yield replace(effect, **{item.name: value}), item, place  # type: ignore[arg-type]
                    break


def _columns(scanner: Scanner, candidates: Sequence[Candidate], prior: Prior) -> Iterator[tuple[float, Array, bool]]:
    """Log prior, whitened columns (m, k), and whether on means: of each candidate at each shape that was looked at."""
    known = {candidate.label: candidate for candidate in candidates}
    looks = [(scanner.rough, True)] if scanner.rough is scanner.fine else [(scanner.rough, True), (scanner.fine, False)]
    seen: set[tuple[str, str]] = set()
    for look, on_means in looks:
        many = Counter(label for label, _ in look.kept)
        for (label, shape), kept in look.kept.items():
            candidate = known.get(label)
            if candidate is None or (label, shape) in seen or not len(kept.columns.values):
                continue
            if not on_means and candidate.smooth:
                continue
            seen.add((label, shape))
            columns = np.zeros((look.data.size, kept.columns.values.shape[1]))
            columns[kept.columns.rows] = kept.columns.values
            log_prior = prior.log_single((candidate.effect.name, (label,))) - float(np.log(many[label]))
            yield log_prior, columns, on_means


def _basis(columns: Array, *absorbed: Array | Basis) -> Array:
    """(m, r) orthonormal, of what projections leave of columns (m, k): directions of which they leave enough."""
    if not columns.shape[1]:
        return columns
    size = np.linalg.norm(columns, axis=0)
    unit = columns / np.where(size > 0.0, size, np.inf)
    left = reduce(lambda left, each: project(each, left), absorbed, unit)
    values, vectors = np.linalg.eigh(left.T @ left)
    kept = values > _GONE
    return np.asarray(left @ vectors[:, kept] / np.sqrt(values[kept]))


def _gain(square: Array, rank: int) -> Array:
    """(d,) log Bayes factor of ``rank`` unit directions that explain a square (d,), amplitudes averaged."""
    variance = (_SNR**2 / rank)[:, None]
    each = 0.5 * variance / (1.0 + variance) * square - 0.5 * rank * np.log1p(variance)
    return np.asarray(np.logaddexp.reduce(each, axis=0) - np.log(len(_SNR)))


def _term_gain(term: Term, residuals: Array) -> Array:
    """(d,) log Bayes factor of a discrepancy's term for residuals (m, d), amplitudes averaged."""
    squares = term.along(residuals) ** 2
    variances = _SNR**2 / max(float(term.values.sum()), 1e-300)
    ratio = np.outer(variances, term.values)
    each = 0.5 * (variances[:, None] / (1.0 + ratio)) @ squares - 0.5 * np.log1p(ratio).sum(axis=1)[:, None]
    return np.asarray(np.logaddexp.reduce(each, axis=0) - np.log(len(_SNR)))
