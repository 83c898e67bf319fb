"""What the noise may be: the floor as it was learned, a floor that is slower than the poses at rest show, noise effects
of the catalogue, or noise that has no name.

Each is a further step of whitening, and a log weight: the determinant of that step, and what its parameters cost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

from estimators.gap.bench import Bench, Step
from estimators.gap.evidence import Linear
from estimators.gap.floor import going_on, groups, remembers
from estimators.gap.prior import (
    FLOOR_MOVED,
    FLOOR_RAISED,
    FLOOR_SLOWER,
    FLOOR_UNSEEN,
    FLOOR_WALKS,
    GRID,
    LARGEST,
    OTHER,
    OTHER_NOISE,
    VISIBLE,
    Drawn,
)
from estimators.gap.score import Explained
from estimators.gap.stochastic import NoiseOffer, noise_offers, spectrum

Array = NDArray[np.float64]

#: The state of a coloured floor that goes on below what poses at rest can show.
SLOWER: Final = "slower floor"
#: Bands of a spectrum without a name; log range of a band's excess before the data.
_BANDS: Final = 10
_RANGE: Final = 12.0


@dataclass(frozen=True)
class NoiseState:
    """A hypothesis of the noise.

    Attributes:
        name: in words; empty for the floor as learned.
        offers: the noise effects of the catalogue that are part of it.
        steps: of whitening beyond the floor's.
        log_weight: cost of the steps' parameters, log prior of a floor; and, once ``under_steps`` has told it, the log
            determinant of the steps.
        other: whether it holds noise without a name.
    """

    name: str = ""
    offers: tuple[NoiseOffer, ...] = ()
    steps: tuple[Step, ...] = ()
    log_weight: float = 0.0
    other: bool = False

    @property
    def drawn(self) -> list[Drawn]:
        """As the prior knows it."""
        return [(offer.effect.name, (offer.label,)) for offer in self.offers]

    @property
    def labels(self) -> tuple[str, ...]:
        """Effects and places."""
        return tuple(sorted(offer.label for offer in self.offers))


def log_det(bench: Bench, steps: Sequence[Step]) -> float:
    """log determinant of further steps of whitening, less half that of what they make of the calibration's information:
    the calibration is integrated out, and coarser noise leaves it more room (Harville, Biometrika 61, 1974)."""
    if not steps:
        return 0.0
    basis = _stepped(bench, bench.absorbed, steps)
    return _log_det(steps, basis.T @ basis)


def _log_det(steps: Sequence[Step], information: Array) -> float:
    own = float(sum(np.sum(np.log(np.maximum(step.factor, 1e-300))) for step in steps))
    return own - 0.5 * float(np.linalg.slogdet(information)[1])


def under_steps(bench: Bench, linear: Linear, steps: Sequence[Step]) -> tuple[Linear, float]:
    """Linearised effects after further steps of whitening, not refitted; and ``log_det`` of the steps."""
    absorbed = bench.absorbed.shape[1]
    every = _stepped(bench, np.column_stack([bench.absorbed, linear.left, linear.tangent]), steps)
    basis, rest = every[:, :absorbed], every[:, absorbed:]
    information = basis.T @ basis
    rest = rest - basis @ np.linalg.solve(information, basis.T @ rest)
    return replace(linear, left=rest[:, 0], tangent=rest[:, 1:]), _log_det(steps, information)


def _stepped(bench: Bench, columns: Array, steps: Sequence[Step]) -> Array:
    """Whitened columns (c n, m) after further steps."""
    by_channel = columns.T.reshape(columns.shape[1], len(bench.columns), bench.count).copy()
    for step in steps:
        own = bench.columns.index(step.column), bench.stretches[step.part]
        by_channel[:, *own] = step(by_channel[:, *own])
    return by_channel.reshape(columns.shape[1], -1).T


def moved_floor(bench: Bench, explained: Explained, at_rest: bool, slower: bool = False) -> NoiseState | None:
    """The floor as the sweep itself says it is, as far as what it was learned from allows.

    Args:
        at_rest: whether that was a recording at rest. Without, any spectrum may be the floor: see ``unseen_floor``.
        slower: whether it goes on below what that shows.
    """
    places = [(number, column) for number, part in enumerate(bench.parts) for column in part.columns]
    goes_on = any(going_on(bench.parts[number].floor, column, 0.0) for number, column in places)
    if slower and not goes_on:
        return None
    coloured = any(remembers(bench.parts[number].floor, column) for number, column in places)
    share = 0.0 if not goes_on else FLOOR_SLOWER if coloured else FLOOR_WALKS
    share = share if slower else 1.0 - share
    steps, weight = [], float(np.log(share * (FLOOR_MOVED if at_rest else 1.0 - FLOOR_UNSEEN)))
    for number, column in places:
        part, left = bench.parts[number], explained.of(bench.rows(number))
        learned = spectrum(part, left, column)
        own = spectrum(part, left, column, slower) if slower else learned
        point, _ = own.alone
        before, after = learned.floor.at(np.zeros(learned.learned.free)), own.floor.at(point)
        factor = np.sqrt(before / after)
        if np.abs(np.log(factor)).max() < 1e-3:
            continue
        group = groups(part.count, 1)
        full = np.concatenate([factor[:1], factor[group]])
        steps.append(Step(column, full, in_time=False, part=number))
        weight += own.price(point) - 0.5 * own.learned.penalty(point)[0]
    if not steps:
        return None
    name = SLOWER if slower else "floor"
    return NoiseState(name, (), tuple(steps), weight)


def unseen_floor(found: NoiseState) -> NoiseState:
    """Where no recording at rest shows the floor: any spectrum may be it.

    What lies far above the floor that differences of neighbouring readings show is unlikely to be that floor.

    Args:
        found: the spectrum, as noise without a name.
    """
    raised = max(float(np.log(np.mean(step.factor**-2.0))) for step in found.steps)
    weight = found.log_weight - float(np.log(OTHER * OTHER_NOISE)) + float(np.log(FLOOR_UNSEEN))
    return NoiseState("unseen floor", (), found.steps, weight - 0.5 * (raised / FLOOR_RAISED) ** 2)


def named(bench: Bench, explained: Explained, without: Sequence[str], given: NoiseState) -> list[NoiseState]:
    """States with one more noise effect of the catalogue each, the most evident first."""
    held = {offer.label for offer in given.offers}
    found = []
    for offer in _offers(bench, explained, without):
        if offer.label in held:
            continue
        steps = tuple(step for each in offer.every for step in each.steps(bench.parts[each.part]))
        weight = given.log_weight + sum(_cost(each) for each in offer.every)
        found.append(NoiseState("", (*given.offers, offer), (*given.steps, *steps), weight, given.other))
    return found


def _offers(bench: Bench, explained: Explained, without: Sequence[str]) -> list[NoiseOffer]:
    """Of every noise effect at every place, with a strength of its own in each recording that shows it."""
    found: dict[str, list[NoiseOffer]] = {}
    for number, part in enumerate(bench.parts):
        own = explained if len(bench.parts) == 1 else explained.of(bench.rows(number))
        for offer in noise_offers(part, own, without):
            if offer.gain > 0.0:
                found.setdefault(offer.label, []).append(replace(offer, part=number))
    return [replace(first, more=tuple(rest)) for first, *rest in found.values()]


def unnamed(bench: Bench, explained: Explained) -> NoiseState | None:
    """Noise of each channel by itself, of any spectrum."""
    steps, weight = [], float(np.log(OTHER * OTHER_NOISE))
    for number, column in ((number, column) for number, part in enumerate(bench.parts) for column in part.columns):
        part = bench.parts[number]
        edges = np.geomspace(1.0, part.count, _BANDS + 1)
        band = np.clip(np.searchsorted(edges, np.arange(1, part.count), side="right") - 1, 0, _BANDS - 1)
        alive = max(float(np.mean(part.weights[:, column] > 0)), 1e-9)
        own = part.channel(explained.residual[bench.rows(number)], column)
        power = dct(own, norm="ortho")[1:] ** 2 / alive
        many = np.bincount(band, minlength=_BANDS).astype(float)
        ratio = np.bincount(band, power, minlength=_BANDS) / np.maximum(many, 1.0)
        raised = np.where(many > 0, np.maximum(ratio, 1.0), 1.0)
        gains = 0.5 * many * (ratio - np.log(np.maximum(raised, 1e-300)) - ratio / raised)
        price = np.log(_RANGE / np.sqrt(4.0 * np.pi / np.maximum(many, 1.0)))
        kept = gains > price
        weight -= float(np.sum(price[kept])) + _BANDS * np.log(2.0) * 0.2
        if kept.any():
            factor = 1.0 / np.sqrt(np.where(kept, raised, 1.0))
            steps.append(Step(column, np.concatenate([[1.0], factor[band]]), in_time=False, part=number))
    if not steps:
        return None
    return NoiseState("noise", (), tuple(steps), weight, other=True)


def _cost(offer: NoiseOffer) -> float:
    """log of the share of the prior that the fitted strengths take: half-normal, its scale averaged over a grid."""
    (strength,) = [item for item in offer.effect.parameters() if item.strength]
    values = np.atleast_1d(np.asarray(getattr(offer.effect, strength.name), dtype=float))[: offer.rank]
    spread = np.maximum(offer.spread, 1e-300)
    least = np.sqrt(spread)  # the amplitude whose variance is as large as that
    width = np.minimum(0.5 * spread / np.maximum(values, 1e-300), least)
    start = VISIBLE * float(np.sqrt(np.mean(least**2)))
    top = max(LARGEST * strength.typical, start)
    grid = start * GRID ** np.arange(int(np.log(top / start) / np.log(GRID)) + 1)
    each = [float(np.sum(np.log(2.0 * width / scale) - 0.5 * (values / scale) ** 2)) for scale in grid]
    return float(np.logaddexp.reduce(each) - np.log(len(grid))) - float(np.log(offer.searched))
