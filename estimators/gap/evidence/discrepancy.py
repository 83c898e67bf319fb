"""The structured discrepancy: an error source along an unknown course, averaged over its prior.

Kennedy and O'Hagan, "Bayesian calibration of computer models" (Journal of the Royal Statistical Society B 63, 2001):
what no effect of the catalogue explains is a Gaussian process. Here it is a source times a sum of functions with normal
coefficients, so that its covariance has low rank: one eigendecomposition for each source and course serves all
amplitudes, and all hypotheses.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import log
from typing import Final

import numpy as np

from estimators.gap.data.projection import project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.amplitudes import between_steps
from estimators.gap.evidence.fitted_courses import FittedCourses
from estimators.gap.evidence.jumps import Jumps
from estimators.gap.evidence.laplace import Linear
from estimators.gap.evidence.means import Means
from estimators.gap.evidence.on_samples import OnSamples
from estimators.gap.evidence.passing import Passings
from estimators.gap.evidence.processes import Processes
from estimators.gap.evidence.repeats import Repeats
from estimators.gap.evidence.static_field import static_fields
from estimators.gap.evidence.telegraph import Telegraphs
from estimators.gap.evidence.terms import (
    Errors,
    Functions,
    Term,
    blocks_term,
    every_along,
    freedoms_of,
    smooth_terms,
    terms_along,
)
from estimators.gap.evidence.weighed import Weighed
from estimators.gap.hypotheses.candidates import split
from estimators.gap.hypotheses.courses import Course, courses, history_courses, level_courses
from estimators.gap.hypotheses.prior import OTHER_FORM
from estimators.gap.hypotheses.sources import MAGNETIC, STRENGTH, Source, alike, source_of, sources
from rig.arrays import Array

#: Makes the change (n, 6) [recorded unit] of an effect, and its whitened derivatives (c n, p) by the parameters.
Changed = Callable[[], tuple[Array, Array]]
#: Blocks of time in each of which a source may be off by something else: what changes faster than the cosines.
BLOCKS: Final = (128, 512)
#: Of courses that only a residual tells, the kinds; each is weighed where it may lead those before it.
_FITTED: Final[tuple[type[FittedCourses], ...]] = (Repeats, Jumps, Telegraphs, Passings, Processes)
#: A term that could not gain this much, its prior counted, is not weighed.
_HOPELESS: Final = -9.0
#: Log odds against the likeliest term before beyond which courses that only a residual tells are not weighed.
_NOTHING: Final = 8.0
#: So many terms are weighed at once: a matrix of all parameters of a set for each of their amplitudes.
_TERMS: Final = 64
#: So many terms, of those within such log odds of the likeliest, are weighed sample by sample where they gain more than
#: this: means over neighbours lose one or two per cent.
_ON_SAMPLES, _NEAR, _WEAK = 4, 10.0, 30.0


@dataclass(frozen=True)
class Discrepancies:
    """All terms.

    Attributes:
        terms: of every source. fitted: what sources are along what repeats, jumps and two levels, as a residual tells.
        means: the sums over neighbouring samples that slow terms are of. courses: those that any source may follow.
        functions: of all courses, made once for all sources. sources: how many there are.
        on_samples: makes terms of means ones of samples.
    """

    terms: list[Term]
    fitted: tuple[FittedCourses, ...]
    means: Means
    courses: tuple[Course, ...]
    functions: Functions
    on_samples: OnSamples
    sources: int = 1
    _forms: dict[tuple[str, str], list[Term]] = field(default_factory=dict)

    @classmethod
    def of(cls, fine: WhitenedData, rough: WhitenedData, without: Sequence[str] = ()) -> Discrepancies:
        """Of every source along every course.

        Args:
            without: effects that the catalogue does not have.
        """
        data = Means(fine, rough)
        along = list(courses(rough))
        of_samples = sources(fine)
        every = [_on_means(data, each) for each in of_samples]
        blocks = [count for count in BLOCKS if count < 0.7 * data.count] + [data.count]
        ways = len(blocks) + (not data.of_single)  # and from sample to sample
        own: list[list[Course]] = []
        for source in every:
            own.append([course for course, kinds in along if source.kind in kinds])
            if source.of_one_offset:
                own[-1] += level_courses(rough, source.column)
        past = [history_courses(fine, source.column) if source.of_one_offset else [] for source in of_samples]
        together = list(alike(fine))
        laws = Counter(source.name for source, _ in together)
        further = 2 + len(_FITTED)  # time, smoothly and in pieces
        laws[MAGNETIC] += 1  # a static field
        shares = [
            -float(np.log(len(every))) - float(np.log(len(each) + further + len(history) + laws[source.name]))
            for source, each, history in zip(every, own, past, strict=True)
        ]
        general = tuple(course for course, kinds in along if "gain" in kinds)
        functions = Functions.of(data.count, [*(each for courses in own for each in courses), *general])
        errors, found = smooth_terms(fine.absorbed, every, own, shares, functions, data)
        for source, share, freedoms in zip(every, shares, freedoms_of(every), strict=True):
            for count in blocks:
                found.append(blocks_term(errors, source, freedoms, count, share - log(ways)))
            if source.name == MAGNETIC:
                found += static_fields(fine.absorbed, source, rough.base.position, share, data)
        if fine.only_scaled and not data.of_single:
            found += _from_sample_to_sample(of_samples, shares, ways)
        if not data.exact:
            singles = {source.name: source for source in of_samples}
            found = [
                term if term.errors.means is None else replace(term, of_samples=singles[term.source]) for term in found
            ]
        for source, share, history in zip(of_samples, shares, past, strict=True):
            for course in history:
                found += terms_along(fine.absorbed, source, course, share)
        shared = dict(zip((source.name for source in of_samples), shares, strict=True))
        for source, law in together:
            constant = Course(law, np.ones((fine.count, 1)), np.ones(1))
            found += terms_along(fine.absorbed, source, constant, shared[source.name])
        stepping = frozenset(one.name for one in of_samples if one.single_step and one.single_step not in without)
        kept = [term for term in found if len(term.values)]
        fitted = tuple(kind(fine, of_samples, shares, stepping) for kind in _FITTED)
        return cls(kept, fitted, data, general, functions, OnSamples(fine), len(every))

    @property
    def without_forms(self) -> Discrepancies:
        """The same for other sets of effects: what forms of these do is not known yet."""
        return replace(self, on_samples=OnSamples(self.means.fine), _forms={})

    def forms(self, member: tuple[str, str], changed: Changed) -> list[Term]:
        """An effect that is there in another form than the catalogue's: of a strength that follows something.

        What its own parameters can do is no other form: it is projected out (orthogonal discrepancies: Plumlee, Journal
        of the American Statistical Association 112, 2017). Its change is that of the first set that holds it: what a
        covariance is made of need not be exact.

        Args:
            member: its label, and the shape that its fit keeps, in words. changed: makes what it does.
        """
        if member not in self._forms:
            effect, where = split(member[0])
            (change, own), fine = changed(), self.means.fine
            single = source_of(fine, f"{STRENGTH}{effect} at {where}", "gain", [change])
            share = -float(np.log(len(self.courses) + 1))
            taken, source = fine.absorbed.extended(own), _on_means(self.means, single)
            found = smooth_terms(taken, [source], [self.courses], [share], self.functions, self.means)[1]
            self._forms[member] = found if self.means.exact else [replace(term, of_samples=single) for term in found]
        return self._forms[member]


def _from_sample_to_sample(every: Sequence[Source], shares: Sequence[float], ways: int) -> list[Term]:
    """What moves several channels at once by something else in each sample, which means over neighbours hardly show.

    Only what has fewer freedoms than channels: else it is noise of these. Any turn is one of the tool.

    Args:
        ways: so many lengths a piece of time may have.
    """
    some = [
        (source, share)
        for source, share in zip(every, shares, strict=True)
        if len(source.series) < np.count_nonzero(source.series.any(axis=(0, 2)))
        and (source.kind != "turn" or source.of_tool)
    ]
    if not some:
        return []
    together = [source for source, _ in some]
    errors, count = Errors.of(together), together[0].series.shape[2]
    each = zip(some, freedoms_of(together), strict=True)
    return [blocks_term(errors, source, own, count, share - log(ways)) for (source, share), own in each]


def _on_means(data: Means, source: Source) -> Source:
    """A source of every sample, as sums over neighbours."""
    freedoms, channels, _ = source.series.shape
    both = data(source.series.reshape(freedoms, -1).T)
    return replace(source, series=both.T.reshape(freedoms, channels, data.count))


def weighed(
    linear: Linear,
    discrepancies: Discrepancies,
    changes: Mapping[tuple[str, str], Changed] | None = None,
    least: float = -np.inf,
) -> list[Weighed]:
    """Every term beside a set of effects, the likeliest first.

    Args:
        changes: by label and kept shape, of the set's effects, as ``Discrepancies.forms`` takes them.
        least: log mass below which courses that only the residual tells are not weighed.
    """
    found = weighed_terms(linear, discrepancies.terms)
    least = max((found[0].log_mass if found else 0.0) - _NOTHING, least)
    for each in discrepancies.fitted:
        found += (own := weighed_terms(linear, each.terms(linear.left, least)))
        least = max(least, own[0].log_mass - _NOTHING) if own else least
    if not changes:
        return between_steps(linear, _leading_on_samples(linear, found, discrepancies.on_samples))
    forms = weighed_terms(linear, [term for each in changes.items() for term in discrepancies.forms(*each)])
    every = [(one, 1.0 - OTHER_FORM) for one in found] + [(one, OTHER_FORM / len(changes)) for one in forms]
    shared = [Weighed(one.term, one.gains, log(part)) for one, part in every]
    return between_steps(linear, _leading_on_samples(linear, shared, discrepancies.on_samples))


def _leading_on_samples(linear: Linear, found: Sequence[Weighed], on_samples: OnSamples) -> list[Weighed]:
    """The same, the likeliest first, as exactly as can be where these gain so much that what they lose of it counts."""
    ranked = sorted(found, key=lambda each: -each.log_mass)
    # held against each other: a term of samples may lead these by what means lose
    of_means = [index for index, each in enumerate(ranked) if each.term.of_samples is not None]
    # products of whitened sources lose any share where the floor has a memory
    near, weak = (_NEAR, _WEAK) if on_samples.data.only_scaled else (np.inf, _WEAK / _ON_SAMPLES)
    least = ranked[of_means[0]].log_mass - near if of_means else 0.0
    for index in of_means[:_ON_SAMPLES]:
        each = ranked[index]
        if float(each.gains.max()) > weak and each.log_mass > least:
            again = weighed_terms(linear, [on_samples(each.term)])
            ranked[index] = replace(again[0], log_share=each.log_share) if again else each
    return sorted(ranked, key=lambda each: -each.log_mass)


def left_beside(linear: Linear, first: Weighed, discrepancies: Discrepancies) -> Linear:
    """A set of effects beside what a discrepancy is most likely to leave.

    Args:
        first: the discrepancy's term, as it was weighed beside the set.
    """
    term = first.term
    along = term.along(linear.columns)
    # of both at once: what an effect could do as well is not taken for little, time after time
    information = linear.gram + np.diag(linear.likeliest)
    fitted = np.linalg.solve(information, linear.tangent.T @ linear.left)
    weight = 1.0 / (1.0 / float(term.variances[int(np.argmax(first.gains))]) + term.values)
    shared = along[:, 1:]
    alone = weight * (along[:, 0] - shared @ fitted)
    core = information - (shared * weight[:, None]).T @ shared
    sizes = alone + weight * (shared @ np.linalg.solve(core, shared.T @ alone))
    made = term.every_sample(term.made(sizes[:, None]))[:, 0]
    return replace(linear, left=linear.left - project(discrepancies.means.fine.absorbed, made))


def weighed_terms(linear: Linear, terms: Sequence[Term]) -> list[Weighed]:
    """Terms beside a set of effects, the likeliest first; all on the same grid of amplitudes."""
    kept, taken, gains = list[Term](), list[Array](), list[Array]()
    for term, along in zip(terms, every_along(terms, linear.columns), strict=True):
        # without the effects' freedom no term can gain more than half the square it explains
        if 0.5 * float(np.sum(along[:, 0] ** 2 / term.values)) + term.log_prior < _HOPELESS:
            continue
        kept.append(term)
        taken.append(np.matmul(along.T * term.shrunk[0][:, None], along))
        if len(taken) == _TERMS:
            gains += [*linear.beyond(np.stack(taken))]
            taken.clear()
    gains += [*linear.beyond(np.stack(taken))] if taken else []
    found = [Weighed(term, own - 0.5 * term.shrunk[1]) for term, own in zip(kept, gains, strict=True)]
    return sorted(found, key=lambda each: -each.log_mass)


def squares_taken(every: Sequence[Weighed], residual: Array, data: WhitenedData, floor: WhitenedData) -> list[float]:
    """The squared gap that each term takes of a residual, shrunk by its likeliest amplitude, less what noise makes.

    Args:
        data: that it is whitened as, maybe under other noise. floor: in whose units the gap is.
    """
    found = []
    for each, along in zip(every, every_along([each.term for each in every], residual[:, None]), strict=True):
        values, shrink = each.term.values, each.term.shrunk[0][int(np.argmax(each.gains))]
        square = float(np.sum(shrink**2 * values * np.maximum(along[:, 0] ** 2 - values, 0.0)))
        if steps := data.steps[len(floor.steps) :]:
            made = each.term.every_sample(each.term.made(shrink[:, None] * along))[:, 0]
            louder = data.before(steps, made)
            square *= float(louder @ louder) / max(float(made @ made), 1e-300)
        found.append(square)
    return found


def total(log_masses: Sequence[float]) -> float:
    """log of the sum of exponentials."""
    return float(np.logaddexp.reduce(list(log_masses))) if len(log_masses) else -np.inf
