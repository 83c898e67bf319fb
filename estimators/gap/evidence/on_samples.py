"""Terms of a discrepancy sample by sample, each whitened along its course, where those that lead are of means over
neighbours or products of whitened sources.

What varies from sample to sample loses some of its power in means, one or two per cent where a joint rolls fast. Of an
unknown thing that gains thousands that is more than what decides between it and an effect, which is fitted on samples.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from estimators.gap.data.blocks import each_used
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.static_field import SPHERES, around
from estimators.gap.evidence.terms import Errors, Term, blocks_term, terms_along
from estimators.gap.hypotheses.courses import Course, cosines, courses, level_courses

#: Of so many pieces of time at most each is whitened by itself.
_FEW: Final = 128


@dataclass(frozen=True)
class OnSamples:
    """Makes them, each once.

    Attributes:
        data: sample by sample.
    """

    data: WhitenedData
    _known: dict[Term, Term] = field(default_factory=dict)

    def __call__(self, term: Term) -> Term:
        """The same source along the same course, of samples; a term that is so already as it is."""
        if term.of_samples is None:
            return term
        if term not in self._known:
            self._known[term] = next((replace(made, of_means=term) for made in self._made(term)), term)
        return self._known[term]

    def _made(self, term: Term) -> list[Term]:
        source, absorbed = term.of_samples, term.errors.absorbed
        assert source is not None
        assert absorbed is not None
        if term.edges is not None:
            pieces = len(term.edges)
            if source.felt is not None and pieces <= _FEW:
                return terms_along(absorbed, source, _in_pieces(term.course, pieces, self.data.count), term.log_prior)
            if pieces == len(term.errors.series):  # something else in each of the means
                return []
            errors = Errors.of([source], absorbed=absorbed)
            return [blocks_term(errors, source, slice(0, len(source.series)), len(term.edges), term.log_prior)]
        if term.course in SPHERES:
            if not each_used(self.data.count):  # of several recordings: too large to make
                return []
            return around(absorbed, source, self.data.base.position, term.course, term.log_prior)
        if term.course == "time":
            assert term.weight is not None
            course = Course(term.course, cosines(self.data.count)[:, : len(term.weight)], term.weight)
        else:
            of_level = level_courses(self.data, source.column) if source.of_one_offset else []
            every = itertools.chain(of_level, (each for each, _ in courses(self.data)))  # one at a time: they are large
            found = next((each for each in every if each.name == term.course), None)
            if found is None:  # of samples nothing follows it
                return []
            course = found
        return terms_along(absorbed, source, course, term.log_prior)


def _in_pieces(name: str, pieces: int, count: int) -> Course:
    """Something else in each piece of time."""
    piece = np.searchsorted(np.linspace(0, count, pieces, endpoint=False).astype(int), np.arange(count), side="right")
    return Course(name, (piece[:, None] == np.arange(1, pieces + 1)).astype(float), np.ones(pieces))
