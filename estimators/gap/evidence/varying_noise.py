"""Noise of a size that follows something: noise with a name in another form than the catalogue's, or without any.

An effect of the catalogue has one strength for a whole recording. What is larger in some poses, at some speeds or times
remembers as such an effect does, but is not it: what whitening by the effect, or by the floor alone, leaves has another
variance here than there. The logarithm of that variance is a sum of the functions that an error may follow.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimators.gap.data.steps import Step, after_steps
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.states import NoiseState
from estimators.gap.hypotheses.courses import Course, any_of, cosines, courses, falling
from estimators.gap.hypotheses.prior import OTHER, OTHER_FORM, OTHER_NOISE
from estimators.gap.hypotheses.stochastic import Left
from rig.arrays import Array
from rig.channels import COLUMNS_OF

#: The logarithm of the variance is normal about none, of such a deviation in all: tried.
_DEVIATIONS: Final = (0.5, 1.5)
#: Its mean, by which the named strength is off, has this one.
_LEVEL: Final = 3.0
#: Gain in log likelihood of named noise below which nothing tells what it follows.
_WORTH: Final = 10.0
#: By how much the gain of a family may be more than its score promises.
_ROUGHLY: Final = 5.0
#: Families of more functions say little of a variance. So many are fitted, by so many of Newton's steps, each so long.
_MOST, _FITTED, _STEPS, _LONGEST = 40, 3, 12, 2.0
#: Cosines of time.
_SLOW: Final = 8


def varying(states: Sequence[NoiseState], before: NoiseState, lefts: Sequence[Left]) -> list[NoiseState]:
    """Noise of a size that follows something: of any channel beyond the state before; and that of the likeliest of
    states with one more noise effect each, where that effect is evident. A state each, where anything shows it.

    Args:
        before: the state that they go beyond. lefts: of each recording, under that.
    """
    families = [{family.name: family for family in _families(left.data)} for left in lefts]
    every = {column for left in lefts for column in left.data.columns}
    found = [_following(before, before, lefts, families, every, 1.0)]
    likely = [each for each in states if each.steps[len(before.steps) :] and not each.fitted[-1].in_time]
    own = max(likely, key=lambda each: 0.5 * _gain(each) + each.log_weight, default=None)
    if own is not None and 0.5 * _gain(own) >= _WORTH:  # in place of the effect's own share of the prior
        touched = {step.column for left in lefts for each in own.fitted for step in each.steps(left.data)}
        found.append(_following(own, before, lefts, families, touched, OTHER_FORM / len(states)))
    return [each for each in found if each is not None]


def _gain(state: NoiseState) -> float:
    """Twice the gain in log likelihood of a state's last noise effect."""
    return sum(one.gain for one in state.fitted[-1].every)


def _following(
    own: NoiseState,
    before: NoiseState,
    lefts: Sequence[Left],
    families: Sequence[Mapping[str, Family]],
    touched: Collection[int],
    share: float,
) -> NoiseState | None:
    """A state beside which the size of what is left of some channels follows something; None where nothing shows it.

    Args:
        before: the state that what is left is under. families: of each recording. share: of the prior of noise
            without a name, whatever that follows.
    """
    further = own.steps[len(before.steps) :]
    boards: list[tuple[int, dict[int, Array]]] = []
    for number, left in enumerate(lefts):
        data = left.data
        for where in COLUMNS_OF.values():
            white = {
                column: after_steps(
                    [step for step in further if (step.column, step.part) == (column, number)],
                    data.channel(left.explained.residual, column),
                    data.gaps[column],
                )[data.weights[:, column] > 0.0]
                for column in sorted(touched)
                if column in range(6)[where] and column in data.columns
            }
            if white:
                boards.append((number, white))
    names = dict.fromkeys(name for number, _ in boards for name in families[number])
    promised = {
        name: sum(_promised(families[number].get(name, _NONE), lefts[number].data, white) for number, white in boards)
        for name in names
    }
    cost = float(np.log(OTHER * OTHER_NOISE * share / len(promised)))
    found: list[tuple[float, str, list[Step]]] = []
    for name in sorted(promised, key=lambda each: -promised[each])[:_FITTED]:
        if promised[name] + cost < -_ROUGHLY:
            break
        gained, steps = 0.0, list[Step]()
        for number, white in boards:
            data = lefts[number].data
            more, logs = _likeliest(families[number].get(name, _NONE), data, white)
            gained += more
            for column in white:
                root = np.ones(data.count)
                root[data.weights[:, column] > 0.0] = np.exp(0.5 * logs[column])
                steps.append(Step(column, 1.0 / root, True, number))
        found.append((gained, name, steps))
    gained, follows, steps = max(found, key=lambda each: each[0], default=(-np.inf, "", []))
    louder = sum(_likeliest(_NONE, lefts[number].data, white)[0] for number, white in boards) if found else 0.0
    if gained - max(louder, 0.0) + cost < 0.0:  # louder throughout is what noise with a name is
        return None
    every = (*own.steps, *steps)
    return replace(before, name="noise", steps=every, log_weight=own.log_weight + cost, other=True, follows=follows)


@dataclass(frozen=True)
class Family:
    """Functions that the logarithm of a variance may follow.

    Attributes:
        name: in words. of: (n, k) functions of each channel, of mean zero and mean square one. weight: (k,) their prior
            standard deviations, of square sum one.
    """

    name: str
    of: Mapping[int, Array]
    weight: Array

    def there(self, data: WhitenedData, column: int) -> Array:
        """(m, 1 + k) a constant, and the functions, where a channel has readings."""
        rows = data.weights[:, column] > 0.0
        own = self.of[column][rows] if column in self.of else np.zeros((int(rows.sum()), len(self.weight)))
        return np.column_stack([np.ones(len(own)), own])

    def precision(self, deviation: float) -> Array:
        """(1 + k,) of the prior."""
        return np.asarray(1.0 / np.concatenate([[_LEVEL], deviation * self.weight]) ** 2)


#: Louder throughout: following nothing.
_NONE: Final = Family("", {}, np.zeros(0))


def _families(data: WhitenedData) -> list[Family]:
    """What the variance of each channel may follow: what an offset may, its input and the size of its slope, time."""
    every = [(course.name, dict.fromkeys(data.columns, course.values), course.weight) for course in _slow(data)]
    inputs = np.nan_to_num(data.base.inputs)
    slopes = np.abs(np.gradient(inputs, data.t, axis=0))
    for name, own in (("level", inputs - inputs.min(axis=0)), ("how fast the reading changes", slopes)):
        sizes = {column: any_of(own[:, column]) for column in data.columns}
        every.append((name, sizes, falling(sizes[data.columns[0]].shape[1])))
    found = []
    for name, of, weight in every:
        once = {id(values): values for values in of.values()}  # most are those of all channels
        once = {number: _standard(values) for number, values in once.items()}
        scaled = {column: once[id(values)] for column, values in of.items()}
        found.append(Family(name, scaled, weight / float(np.linalg.norm(weight))))
    return found


def _slow(data: WhitenedData) -> Iterator[Course]:
    for course, kinds in courses(data):
        if "offset" in kinds and len(course.weight) <= _MOST and course.name != "time, throughout":
            yield course
    yield Course("time", cosines(data.count)[:, 1 : _SLOW + 1], falling(_SLOW))


def _standard(values: Array) -> Array:
    """(n, k) functions of mean zero and mean square one; those that are constant are zero."""
    centred = values - values.mean(axis=0)
    size = np.sqrt(np.mean(centred**2, axis=0))
    return np.asarray(np.where(size > 1e-9, centred / np.maximum(size, 1e-9), 0.0))


def _told(data: WhitenedData) -> Array:
    """(6,) what a square tells of a variance, as a share of what that of normal noise does: long tails tell less, and
    less so of means (the dispersion of a quasi-likelihood: Wedderburn, Biometrika 61, 1974)."""
    beyond = np.array([floor.spread for floor in data.floor]) - 1.0
    return np.asarray(1.0 / (1.0 + np.maximum(beyond, 0.0) / data.samples))


def _promised(family: Family, data: WhitenedData, white: Mapping[int, Array]) -> float:
    """What a family gains in log evidence to second order about one variance (a score test); as if its functions were
    orthogonal where that is nothing."""
    columns, told = {column: family.there(data, column) for column in white}, _told(data)
    precision = family.precision(_DEVIATIONS[-1])
    score = np.sum(
        [0.5 * told[column] * columns[column].T @ (values**2 - 1.0) for column, values in white.items()], axis=0
    )
    alone = precision + 0.5 * sum(told[column] * len(values) for column, values in white.items())
    gained = 0.5 * float(np.sum(score**2 / alone + np.log(precision / alone)))
    if gained < 0.0:
        return gained
    information = np.diag(precision) + 0.5 * np.sum(
        [told[column] * own.T @ own for column, own in columns.items()], axis=0
    )
    gained = 0.5 * float(score @ np.linalg.solve(information, score) + np.log(precision).sum())
    return gained - 0.5 * float(np.linalg.slogdet(information)[1])


def _likeliest(family: Family, data: WhitenedData, white: Mapping[int, Array]) -> tuple[float, dict[int, Array]]:
    """Log evidence of a variance of a sensor's channels that follows a family, against one variance, by Laplace's
    approximation; and the likeliest logarithm of it, of each channel's readings (m,)."""
    columns, told = {column: family.there(data, column) for column in white}, _told(data)
    found = []
    for deviation in _DEVIATIONS:
        precision, sizes = family.precision(deviation), np.zeros(1 + len(family.weight))
        for _ in range(_STEPS):
            gradient, curved = -precision * sizes, np.diag(precision)
            for column, values in white.items():
                squares = values**2 * np.exp(-columns[column] @ sizes)
                gradient += 0.5 * told[column] * columns[column].T @ (squares - 1.0)
                curved += 0.5 * told[column] * (columns[column] * np.maximum(squares, 0.5)[:, None]).T @ columns[column]
            step = np.linalg.solve(curved, gradient)
            sizes = sizes + step * min(1.0, _LONGEST / max(float(np.abs(step).max()), 1e-300))
        gained = -0.5 * float(precision @ sizes**2) + 0.5 * float(np.log(precision).sum())
        gained -= 0.5 * float(np.linalg.slogdet(curved)[1])
        logs = {column: own @ sizes for column, own in columns.items()}
        for column, values in white.items():
            lost = float(np.sum(logs[column] + values**2 * (np.exp(-logs[column]) - 1.0)))
            gained -= 0.5 * told[column] * lost
        found.append((gained, deviation, logs))
    total = float(np.logaddexp.reduce([gained for gained, *_ in found])) - np.log(len(found))
    return total, max(found, key=lambda each: each[0])[2]
