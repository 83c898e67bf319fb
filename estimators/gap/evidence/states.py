"""What the noise may be: the floor as it was learned, a floor that is slower than the poses at rest show, noise effects
of the catalogue, or noise that has no name.

Each is a further step of whitening, and a log weight: the determinant of that step, and what its parameters cost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

from estimators.gap.data.projection import side_by_side
from estimators.gap.data.steps import Gaps, Step, after_steps, joined, products_after
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.laplace import Linear
from estimators.gap.evidence.piecewise_spectrum import RANGE, piecewise
from estimators.gap.floor.learned import board_of, going_on, groups, remembers
from estimators.gap.floor.moved_together import moved_together
from estimators.gap.hypotheses.prior import (
    FLOOR_MOVED,
    FLOOR_RAISED,
    FLOOR_SLOWER,
    FLOOR_UNSEEN,
    FLOOR_WALKS,
    OTHER,
    OTHER_NOISE,
    Drawn,
)
from estimators.gap.hypotheses.score import Explained
from estimators.gap.hypotheses.stochastic import FittedNoise, Left
from rig.arrays import Array
from rig.channels import COLUMNS_OF

#: The state of a coloured floor that goes on below what poses at rest can show.
SLOWER: Final = "slower floor"
#: The state of a floor that no poses at rest show.
UNSEEN: Final = "unseen floor"
#: Pieces of time in which noise without a name may have another size, readings in each at least, and passes by which
#: size and spectrum are learned in turn; a variance that no noise falls below.
_PIECES, _LONG, _ALTERNATE, _LEAST = 48, 8, 4, 1e-6
#: Steps of Newton's method to a level's logarithm: as many as reach that of a hundred.
_NEWTON = 8


@dataclass(frozen=True)
class NoiseState:
    """A hypothesis of the noise.

    Attributes:
        name: in words; empty for the floor as learned.
        fitted: the noise effects of the catalogue that are part of it.
        steps: of whitening beyond the floor's.
        log_weight: cost of the steps' parameters, log prior of a floor; and, once ``under_steps`` has told it, the log
            determinant of the steps.
        other: whether it holds noise without a name.
        follows: what the size of that changes with, as a course's name; empty: nothing.
    """

    name: str = ""
    fitted: tuple[FittedNoise, ...] = ()
    steps: tuple[Step, ...] = ()
    log_weight: float = 0.0
    other: bool = False
    follows: str = ""

    @property
    def drawn(self) -> list[Drawn]:
        """As the prior knows it."""
        return [(fitted.effect.name, (fitted.label,)) for fitted in self.fitted]

    @property
    def labels(self) -> tuple[str, ...]:
        """Effects and places."""
        return tuple(sorted(fitted.label for fitted in self.fitted))

    @property
    def kind(self) -> tuple[str, tuple[str, ...]]:
        """Its name, and its effects and places."""
        return self.name, self.labels

    def beyond(self, more: NoiseState) -> NoiseState:
        """Another state's steps after its own, under that one's name; noise without a name stays what it is."""
        named = self if self.other and not more.other else more
        steps, weight = (*self.steps, *more.steps), self.log_weight + more.log_weight
        return replace(named, fitted=(*self.fitted, *more.fitted), steps=steps, log_weight=weight)


@dataclass(frozen=True, eq=False)
class Pieces:
    """Whitened columns, channel by channel and recording by recording: what further steps make of their products.

    Attributes:
        data: what they are of. columns: (c n, m).
    """

    data: WhitenedData
    columns: Array
    _spectra: dict[tuple[int, int], tuple[list[Array], Array]] = field(default_factory=dict)

    @cached_property
    def _values(self) -> dict[tuple[int, int], tuple[NDArray[np.intp], Array]]:
        """Of each channel and each recording, or calibration from before: which columns are there, and these (k, n)."""
        by_channel = self.columns.T.reshape(self.columns.shape[1], len(self.data.columns), self.data.count)
        found = {}
        for index, column in enumerate(self.data.columns):
            for part, own in enumerate(self.data.stretches):
                there = np.flatnonzero(by_channel[:, index, own].any(axis=1))
                found[column, part] = there, by_channel[there, index, own]
        return found

    @cached_property
    def _grams(self) -> dict[tuple[int, int], Array]:
        return {place: values @ values.T for place, (_, values) in self._values.items()}

    def gram(self, steps: Sequence[Step]) -> Array:
        """(m, m) products of the columns after further steps."""
        found = dict(self._grams)
        for place in dict.fromkeys((step.column, step.part) for step in steps):
            column, part = place
            gaps = self.data.parts[part].gaps[column]
            *before, last = joined([step for step in steps if (step.column, step.part) == place], gaps)
            if last.in_time:
                values = after_steps([*before, last], self._values[place][1], gaps)
                found[place] = values @ values.T
            else:
                found[place] = products_after(self._spectrum(place, before, gaps) * last.factor, gaps)
        whole = np.zeros((self.columns.shape[1],) * 2)
        for place, gram in found.items():
            there, _ = self._values[place]
            whole[np.ix_(there, there)] += gram
        return whole

    def _spectrum(self, place: tuple[int, int], before: Sequence[Step], gaps: Gaps) -> Array:
        """(k, n) cosine transforms of a channel's columns after steps; the last are kept: many states share these."""
        factors = [step.factor for step in before]
        known = self._spectra.get(place)
        if known is None or [*map(id, known[0])] != [*map(id, factors)]:
            values = after_steps(before, self._values[place][1], gaps)
            known = self._spectra[place] = factors, dct(gaps.filled(values), norm="ortho")
        return known[1]


def log_det(data: WhitenedData, steps: Sequence[Step]) -> float:
    """log determinant of further steps of whitening, less half that of what they make of the calibration's information:
    the calibration is integrated out, and coarser noise leaves it more room (Harville, Biometrika 61, 1974)."""
    return _log_det(steps, Pieces(data, data.absorbed.dense()).gram(steps)) if steps else 0.0


def _log_det(steps: Sequence[Step], information: Array) -> float:
    own = float(sum(np.sum(np.log(np.maximum(step.factor, 1e-300))) for step in steps))
    return own - 0.5 * float(np.linalg.slogdet(information)[1])


def pieces_of(data: WhitenedData, linear: Linear) -> Pieces:
    """The calibration's tangent, then what linearised effects leave and their own."""
    return Pieces(data, side_by_side(data.absorbed.dense(), linear.left, linear.tangent))


def under_steps(pieces: Pieces, linear: Linear, steps: Sequence[Step]) -> tuple[Linear, float]:
    """Linearised effects after further steps of whitening, not refitted; and ``log_det`` of the steps.

    Of what is left, and of the tangent, the products are those of the readings; the rows are fewer.

    Args:
        pieces: as ``pieces_of`` makes them.
    """
    gram = pieces.gram(steps)
    first = len(gram) - 1 - linear.tangent.shape[1]
    information, shared = gram[:first, :first], gram[:first, first:]
    rest = gram[first:, first:] - shared.T @ np.linalg.solve(information, shared)
    length = np.sqrt(np.maximum(np.diag(rest), 1e-300))
    values, vectors = np.linalg.eigh(rest / np.outer(length, length))
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * length
    return replace(linear, left=root[:, 0], tangent=root[:, 1:]), _log_det(steps, information)


def left_of(data: WhitenedData, explained: Explained) -> list[Left]:
    """What is left of each recording."""
    if len(data.parts) == 1:
        return [Left(data.parts[0], explained)]
    return [Left(part, explained.of(data.rows(number))) for number, part in enumerate(data.parts)]


def moved_floor(lefts: Sequence[Left], at_rest: bool, slower: bool = False) -> NoiseState | None:
    """The floor as the sweep itself says it is, as far as what it was learned from allows.

    Args:
        lefts: of each recording.
        at_rest: whether that was a recording at rest. Without, any spectrum may be the floor: see ``unseen_floor``.
        slower: whether it goes on below what that shows.
    """
    places = [(left, column) for left in lefts for column in left.data.columns]
    goes_on = any(going_on(left.data.floor, column, 0.0) for left, column in places)
    if slower and not goes_on:
        return None
    coloured = any(remembers(left.data.floor, column) for left, column in places)
    share = 0.0 if not goes_on else FLOOR_SLOWER if coloured else FLOOR_WALKS
    share = share if slower else 1.0 - share
    steps, price = _moved(lefts, slower)
    weight = float(np.log(share * (FLOOR_MOVED if at_rest else 1.0 - FLOOR_UNSEEN)))
    return NoiseState(SLOWER if slower else "floor", (), steps, weight + price) if steps else None


def _moved(lefts: Sequence[Left], slower: bool = False) -> tuple[tuple[Step, ...], float]:
    """Steps to the floor as the sweep says it is, and what its parameters cost."""
    steps, weight = [], 0.0
    for number, left in enumerate(lefts):
        alike: dict[tuple[range, tuple[float, ...]], list[int]] = {}
        for column in left.data.columns:
            unseen = left.spectrum(column, slower).learned.unseen_s
            alike.setdefault((board_of(column), unseen), []).append(column)
        for columns in alike.values():
            points, price = moved_together([left.spectrum(column, slower) for column in columns])
            factors = [_factor(left, column, slower, point) for column, point in zip(columns, points, strict=True)]
            for place, (column, point) in enumerate(zip(columns, points, strict=True)):
                if left.data.floor[column].lags:
                    shape, cost = _shape(left, column, slower, point)
                    factors[place], price = factors[place] * shape, price + cost
            if all(np.abs(np.log(factor)).max() < 1e-3 for factor in factors):
                continue
            steps += [Step(column, factor, False, number) for column, factor in zip(columns, factors, strict=True)]
            weight += price
    return tuple(steps), weight


def _factor(left: Left, column: int, slower: bool, point: Array) -> Array:
    """(n,) what whitens a channel's floor by cosine transform once that is moved to a point."""
    learned, own = (left.spectrum(column, way) for way in (False, slower))
    before, after = learned.floor.at(np.zeros(learned.learned.free)), own.floor.at(point)
    factor = np.sqrt(before / after)
    return np.concatenate([factor[:1], factor[groups(left.data.count, 1)]])


def _shape(left: Left, column: int, slower: bool, point: Array) -> tuple[Array, float]:
    """(n,) what whitens a floor that is known as an autoregression, by cosine transform, in the shape that the
    sweep says it has, and what that costs.

    A spectrum's logarithm is known to 2 p/N of N readings and p coefficients (Berk, Annals of Statistics 2, 1974): as
    well as the mean of the squares in each of p/2 bands.
    """
    spectrum, data = left.spectrum(column, slower), left.data
    group = groups(data.count, 1)
    bands = max((len(data.whiteners[column].ar) - 1) // 2, 1)
    middle = np.bincount(group, np.arange(len(group))) / np.bincount(group) / len(group)
    band = np.minimum((middle * bands).astype(int), bands - 1)
    many = np.bincount(band, spectrum.counts, minlength=bands)
    squares = np.bincount(band, spectrum.power / spectrum.floor.at(point), minlength=bands)
    known = data.floor[column].duration_s / data.interval_s / bands
    log_level = np.zeros(bands)
    for _ in range(_NEWTON):
        curvature = squares * np.exp(-log_level) + known
        log_level -= (many - squares * np.exp(-log_level) + known * log_level) / curvature
    curvature = squares * np.exp(-log_level) + known
    price = -0.25 * known * float(log_level @ log_level) - 0.5 * float(np.sum(np.log(curvature / known)))
    factor = np.exp(-0.5 * log_level)[band][group]
    return np.concatenate([factor[:1], factor]), price


def unseen_floor(found: NoiseState) -> NoiseState:
    """Where no recording at rest shows the floor: any spectrum may be it.

    What lies far above the floor that differences of neighbouring readings show is unlikely to be that floor.

    Args:
        found: the spectrum, as steady noise without a name.
    """
    weight = found.log_weight - float(np.log(OTHER * OTHER_NOISE)) + float(np.log(FLOOR_UNSEEN))
    return NoiseState(UNSEEN, (), found.steps, weight + _log_raised(found.steps))


def as_floor(state: NoiseState, given: NoiseState) -> NoiseState:
    """Where no recording at rest shows the floor: what noise effects do beyond a given state may be that."""
    further = state.steps[len(given.steps) :]
    weight = state.log_weight + float(np.log(FLOOR_UNSEEN)) + _log_raised(further)
    return NoiseState(UNSEEN, given.fitted, state.steps, weight, given.other)


def refined(state: NoiseState, lefts: Sequence[Left]) -> NoiseState:
    """A floor, the white part of which was learned as if there was no other, moved to where the sweep says it is.

    Args:
        lefts: of each recording, under the state.
    """
    steps, price = _moved(lefts)
    return replace(state, steps=(*state.steps, *steps), log_weight=state.log_weight + price)


def _log_raised(steps: Sequence[Step]) -> float:
    """Log prior of a floor that is raised as much as steps raise the variance of a channel, of the most raised one."""
    raised: dict[tuple[int, int], float] = {}
    for step in steps:
        place = step.column, step.part
        raised[place] = raised.get(place, 0.0) + float(np.log(np.mean(step.factor**-2.0)))
    return -0.5 * (max(raised.values(), default=0.0) / FLOOR_RAISED) ** 2


def unnamed(lefts: Sequence[Left], steady: bool = False) -> NoiseState | None:
    """Noise of any spectrum, of each channel by itself or one of a sensor's axes; that of a sensor may come and go, but
    where it is steady.

    Args:
        lefts: of each recording.
    """
    steps: list[Step] = []
    weight = float(np.log(OTHER * OTHER_NOISE))
    for number, (part, left) in enumerate((each.data, each.explained.residual) for each in lefts):
        for where in COLUMNS_OF.values():
            own = {column: part.channel(left, column) for column in part.columns if column in range(6)[where]}
            if not own:
                continue
            ways = []
            for together in (False, True):
                ways.append(_any_spectrum(part, own, np.ones(part.count), together=together))
                if not steady and part.count >= _LONG * _PIECES:
                    ways.append(_coming_and_going(part, own, together))
            _, price, factors = max(ways, key=lambda way: way[0] - way[1])
            weight -= price
            steps += [Step(column, factor, in_time, number) for column, factor, in_time in factors]
    if not steps:
        return None
    return NoiseState("noise", (), tuple(steps), weight, other=True)


def raised(data: WhitenedData, explained: Explained) -> list[Step]:
    """White noise of each channel as large as what is left: under it, effects that leave less come first."""
    steps = []
    for number, part in enumerate(data.parts):
        for column in part.columns:
            own = part.channel(explained.residual[data.rows(number)], column)
            size = max(float(np.sqrt(np.mean(own**2))), 1.0)
            steps.append(Step(column, np.full(part.count, 1.0 / size), in_time=False, part=number))
    return steps


#: Gain in log likelihood, what it costs, and for each channel a factor of whitening and whether it is in time.
_Way = tuple[float, float, list[tuple[int, Array, bool]]]


def _any_spectrum(
    part: WhitenedData, own: Mapping[int, Array], root: Array, least: float = 1.0, together: bool = False
) -> _Way:
    """Noise of any spectrum.

    Args:
        own: by channel, (n,) whitened readings. root: (n,) standard deviation that all of them are divided by.
        least: variance that the spectrum does not fall below, 1 of the floor.
        together: whether all of them have one spectrum, as multiples of their floors'.
    """
    gain, power = 0.0, {}
    for column, white in own.items():
        here, gaps = part.weights[:, column] > 0, part.gaps[column]
        power[column] = dct(gaps.filled(white / root), norm="ortho")[1:] ** 2 / gaps.share(len(white))
        gain += 0.5 * float(white @ white - (white / root) @ (white / root)) - float(np.sum(np.log(root[here])))
    if together:
        same = piecewise(np.sum(list(power.values()), axis=0), least, len(own))
        found = [(list(own), same)]
    else:
        found = [([column], piecewise(each, least)) for column, each in power.items()]
    gain += sum(gained for _, (gained, _, _) in found)
    price = sum(cost for _, (_, cost, _) in found)
    raised = {column: levels for columns, (_, _, levels) in found for column in columns}
    factors = [
        (column, np.concatenate([[1.0], 1.0 / np.sqrt(levels)]), False)
        for column, levels in raised.items()
        if (levels != 1.0).any()
    ]
    return gain, price, factors


def _coming_and_going(part: WhitenedData, own: Mapping[int, Array], together: bool) -> _Way:
    """Noise of any spectrum whose size is another in each piece of time, alike for the channels of a sensor.

    Args:
        together: as for ``_any_spectrum``.
    """
    piece = np.arange(part.count) * _PIECES // part.count
    there = sum((part.weights[:, column] > 0).astype(float) for column in own)
    many = np.bincount(piece, there, minlength=_PIECES)
    root = np.ones(part.count)
    found: _Way = (0.0, 0.0, [])
    for _ in range(_ALTERNATE):
        left = dict(own)
        for column, factor, _ in found[2]:
            step = Step(column, factor, in_time=False)
            left[column] = after_steps([step], own[column] / root, part.gaps[column]) * root
        square = np.bincount(piece, sum(white**2 for white in left.values()), minlength=_PIECES)
        root = np.sqrt(np.where(many > 0, np.maximum(square / np.maximum(many, 1.0), _LEAST), 1.0))[piece]
        found = _any_spectrum(part, own, root, _LEAST, together)
    gain, price, factors = found
    price += float(np.sum(np.log(RANGE / np.sqrt(4.0 * np.pi / np.maximum(many, 1.0)))))
    whole = [(column, np.where(part.weights[:, column] > 0, 1.0 / root, 1.0), True) for column in own]
    return gain, price, [*whole, *factors]
