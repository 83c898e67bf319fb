"""Scanning a candidate's shapes: the one whose columns explain most, and what having searched costs.

Smooth effects are looked at on means over neighbouring samples, which they outlive; others sample by sample.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import log
from typing import Final

import numpy as np

from estimators.gap.data.projection import Columns
from estimators.gap.data.stack import part_of
from estimators.gap.data.steps import Step
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.hypotheses.candidates import Candidate, Shape, still
from estimators.gap.hypotheses.score import Explained, Score, solve
from estimators.gap.hypotheses.tones import best_tone, envelopes
from rig.arrays import Array
from rig.effects import Effect
from rig.pipeline import Pipeline

#: Shapes that a fit cannot move smoothly: found by the scan and kept.
KEPT: Final = ("at_s", "order")
#: An onset leaves at least this share of the samples on either side.
_EDGE: Final = 0.01
#: What effects change of the readings, as a share of these, beyond which derivatives are taken anew beside them.
_BENT: Final = 0.02
#: Evidence below which a tone's first look will do.
_NOTHING: Final = 6.0


@dataclass(frozen=True)
class ScoreTest:
    """What a candidate explains at its best shape.

    Attributes:
        candidate: the effect and its place.
        shape: the best of the searched shapes.
        score: at that shape.
        searched: how many distinguishable shapes were tried.
        spread: logarithm of how many shapes that a fit keeps were as likely beforehand, less that of those which
            explain as much.
        widths: standard deviations of such shapes.
    """

    candidate: Candidate
    shape: Shape
    score: Score
    searched: int = 1
    spread: float = 0.0
    widths: Mapping[str, float] = field(default_factory=dict)

    @property
    def evidence(self) -> float:
        """Twice the log Bayes factor, each searched shape equally likely beforehand."""
        return self.score.evidence - 2.0 * log(self.searched)

    @property
    def log_p(self) -> float:
        """Logarithm of the p-value, corrected for the search (Bonferroni)."""
        return self.score.log_p + log(self.searched)


@dataclass(frozen=True)
class Kept:
    """A candidate's columns at one shape, and their Gram matrix with the calibration projected out."""

    columns: Columns
    gram: Array


@dataclass(frozen=True)
class Look:
    """Candidates on one recording; their columns are kept for the next scan, by label and shape.

    Attributes:
        nearby: the look beside fewer effects, whose derivatives tell well enough which shape a fit begins at.
        before: the look that these data had before further steps of whitening, and the steps.
    """

    data: WhitenedData
    kept: dict[tuple[str, str], Kept] = field(default_factory=dict)
    nearby: Look | None = None
    before: tuple[Look, Sequence[Step]] | None = None

    def best(
        self, candidate: Candidate, explained: Explained, shapes: Sequence[Shape] | None = None
    ) -> list[ScoreTest]:
        """The tests of all shapes of a candidate, or of some, the best first; not for a tone."""
        every: Sequence[Shape] = candidate.effect.searched(self.data.base)
        if set(every[0]) == {"at_s"}:
            return [_onset(candidate, self.data, explained)]
        if self.nearby is not None and shapes is None and len(every) > 1 and not set(every[0]) & set(KEPT):
            shapes = [self.nearby.best(candidate, explained)[0].shape]
        found = []
        for shape in every if shapes is None else shapes:
            key = candidate.label, str(shape)
            if key not in self.kept:
                columns = self.columns(candidate, shape)
                self.kept[key] = Kept(columns, explained.projected(columns))
            score = _possible(candidate, explained.score(self.kept[key].columns, self.kept[key].gram))
            found.append(ScoreTest(candidate, shape, score, len(every)))
        if set(every[0]) & set(KEPT) and shapes is None:
            likely = np.array([0.5 * tested.score.statistic for tested in found])
            spread = float(np.log(len(likely)) - np.logaddexp.reduce(likely - likely.max()))
            found = [replace(tested, spread=spread) for tested in found]
        return sorted(found, key=lambda tested: -tested.score.statistic)

    def columns(self, candidate: Candidate, shape: Shape) -> Columns:
        """A candidate's columns at a shape, kept where it was looked at, here or before further steps."""
        key = candidate.label, str(shape)
        if key in self.kept:
            return self.kept[key].columns
        if self.before is not None and key in self.before[0].kept:
            look, steps = self.before
            return look.data.after(steps, look.kept[key].columns)
        return candidate.columns(self.data, shape)

    def stepped(self, steps: Sequence[Step]) -> Look:
        """With further steps of whitening, which the columns go through when they are asked for."""
        return Look(self.data.stepped(steps), before=(self, steps))


@dataclass(frozen=True)
class Scanner:
    """Scans candidates.

    Attributes:
        rough, fine: on means over neighbouring samples, and sample by sample.
    """

    rough: Look
    fine: Look
    _envelopes: dict[str, Array] = field(default_factory=dict)
    _others: list[tuple[Array, Scanner]] = field(default_factory=list)
    _source: tuple[Scanner, tuple[Step, ...]] | None = None

    @classmethod
    def of(cls, data: WhitenedData) -> Scanner:
        """Nothing scanned yet."""
        fine = Look(data)
        coarse = data.coarse()
        return cls(fine if coarse is data else Look(coarse), fine)

    def scan(self, candidates: Iterable[Candidate], explained: Explained, roughly: Explained) -> list[ScoreTest]:
        """The best tested of each candidate, the most evident first; of equals those of joints that stand still last.

        Args:
            explained, roughly: sample by sample, and on means.
        """
        tests = [self._first(candidate, explained, roughly) for candidate in candidates]
        return sorted(tests, key=lambda tested: (-tested.evidence, still(tested.candidate, self.fine.data)))

    def visible(self, candidate: Candidate, roughly: Explained) -> float:
        """The largest share of a candidate's change that the calibration leaves; not for a tone or an onset."""
        return self.rough.best(candidate, roughly)[0].score.visible

    def stepped(self, steps: Sequence[Step]) -> Scanner:
        """The scanner of the data with further steps of whitening."""
        if not steps:
            return self
        return replace(self._with(steps), _source=(self, tuple(steps)))

    def _with(self, steps: Sequence[Step]) -> Scanner:
        fine = self.fine.stepped(steps)
        if self.rough is self.fine:
            return Scanner(fine, fine, self._envelopes)
        shortened = [step.shortened(_length(self.rough.data, step)) for step in steps]
        return Scanner(self.rough.stepped(shortened), fine, self._envelopes)

    def beside(self, effects: Sequence[Effect], pipeline: Pipeline) -> Scanner:
        """The scanner whose derivatives are those beside mean effects and another calibration, or nearly so.

        What effects change of the readings, as a share of these, is about what they change of others' derivatives.
        """
        data = self.rough.data
        change = data.change(effects)
        enough = _BENT * float(np.linalg.norm(np.nan_to_num(data.modelled - data.modelled.mean(axis=0))))
        for known, scanner in ((np.zeros_like(change), self), *self._others):
            if float(np.linalg.norm(np.nan_to_num(change - known))) <= enough:
                return scanner
        if self._source is not None:
            first, steps = self._source
            found = first.beside(effects, pipeline)._with(steps)
        else:
            fine = Look(self.fine.data.around(pipeline).having(effects))
            rough = fine if self.rough is self.fine else Look(data.around(pipeline).having(effects))
            found = Scanner(rough, fine, self._envelopes)  # a tone's first look is not made anew
        fine = replace(found.fine, nearby=self.fine)
        rough = fine if found.rough is found.fine else replace(found.rough, nearby=self.rough)
        found = replace(found, rough=rough, fine=fine)
        self._others.append((change, found))
        return found

    def _smooth(self, candidate: Candidate) -> bool:
        return self.rough is not self.fine and candidate.smooth

    def _first(self, candidate: Candidate, explained: Explained, roughly: Explained) -> ScoreTest:
        if candidate.effect.tone:
            return self._tone(candidate, explained)
        if self._smooth(candidate):
            return self.rough.best(candidate, roughly)[0]
        return self.fine.best(candidate, explained)[0]

    def _tone(self, candidate: Candidate, explained: Explained) -> ScoreTest:
        data, part = self.fine.data, part_of(candidate.effect)
        if part is not None:
            data, explained = data.parts[part], explained.of(data.rows(part))
        if candidate.label not in self._envelopes:
            self._envelopes[candidate.label] = envelopes(candidate, data)
        raw = self._envelopes[candidate.label]
        score, frequency, tried = best_tone(candidate, data, explained, raw, _NOTHING)
        return ScoreTest(candidate, {"freq_Hz": frequency}, score, tried)


def _possible(candidate: Candidate, score: Score) -> Score:
    """The score; that of nothing where a strength that is never negative would be: a low-pass does not look ahead."""
    (first, *more) = candidate.strengths
    one_sided = not more and first.size == 1 and first.lower >= first.neutral
    if one_sided and score.strengths.size == 1 and score.strengths[0] < first.lower:
        return replace(score, statistic=0.0)
    return score


def _onset(candidate: Candidate, data: WhitenedData, explained: Explained) -> ScoreTest:
    """Effects that begin at an instant: sums from the end give the score of every instant in one pass."""
    first = {"at_s": float(data.base.t[0])}
    columns = candidate.columns(data, first)
    if not columns.values.any():  # too small to change a number as large as the readings are
        return ScoreTest(candidate, first, Score(0.0, 0, np.zeros(columns.values.shape[1]), 0.0))
    count = data.count
    by_time = columns.values.T.reshape(columns.values.shape[1], -1, count)
    own = np.einsum("icn,jcn->nij", by_time, by_time)
    basis = explained.basis(columns.rows).T.reshape(-1, by_time.shape[1], count)
    shared = np.einsum("pcn,icn->npi", basis, by_time)
    moment = np.einsum("cn,icn->ni", explained.residual[columns.rows].reshape(-1, count), by_time)
    own, shared, moment = (np.cumsum(values[::-1], axis=0)[::-1] for values in (own, shared, moment))
    edge = max(2, int(_EDGE * count))
    grams = own - np.einsum("npi,npj->nij", shared, shared)
    statistics = _statistics(grams[edge:-edge], moment[edge:-edge], own[0])
    best = edge + int(np.argmax(statistics))
    score = solve(grams[best], moment[best], np.sqrt(np.diag(own[best])))
    # James, James and Siegmund, Biometrika 74 (1987), (3): the tail of the largest of a scan over all instants,
    # b phi(b) ln((1 - e) / e)^2, over that of one instant, 2 phi(b) / b
    tries = max(1, int(np.ceil(score.statistic * np.log((1.0 - _EDGE) / _EDGE))))
    at_s = 0.5 * float(data.t[best] + data.t[best - 1])
    likely = 0.5 * (statistics - statistics.max())
    spread = float(np.log(len(likely)) - np.logaddexp.reduce(likely))
    weight = np.exp(likely - np.logaddexp.reduce(likely))
    middles = 0.5 * (data.t[edge:-edge] + data.t[edge - 1 : -edge - 1])
    width = float(np.sqrt(weight @ (middles - at_s) ** 2 + data.interval_s**2 / 12.0))
    return ScoreTest(candidate, {"at_s": at_s}, score, tries, spread, {"at_s": width})


def _length(data: WhitenedData, step: Step) -> int:
    """How many means a step is of."""
    own = data.stretches[step.part]
    return int(own.stop - own.start)


def _statistics(grams: Array, moments: Array, scale: Array) -> Array:
    """LM of many small problems at once; a little ridge keeps the degenerate ones from exploding."""
    ridge = 1e-6 * np.trace(scale) / len(scale) * np.eye(len(scale))
    solved = np.linalg.solve(grams + ridge, moments[..., None])[..., 0]
    return np.asarray(np.einsum("ni,ni->n", moments, solved))
