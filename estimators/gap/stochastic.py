"""Noise that the floor does not have: white, coloured, wandering, or growing with the slope of the signal.

A noise effect changes the covariance of the readings, not their mean: its evidence is the likelihood of the whitened
residual under a spectrum (Whittle's, with cosines) or under a variance in time, against that of the floor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct
from scipy.optimize import minimize
from scipy.stats import chi2

from estimators.gap.bench import Bench
from estimators.gap.score import Explained, evidence
from rig.channels import CHANNELS
from rig.effects import EFFECTS, Effect, Kind

Array = NDArray[np.float64]

#: The lowest frequencies, in cycles a recording, carry what the calibration took: they tell nothing of the noise.
_TAKEN = 1
#: Strengths, as added over white variance at the spectrum's largest, between which the likelihood is searched.
_LOWEST, _HIGHEST = 1e-5, 1e8


@dataclass(frozen=True)
class NoiseOffer:
    """What a noise effect explains.

    Attributes:
        effect: with its fitted strengths.
        gain: twice the gain in log likelihood.
        rank: the number of its strengths.
        searched: how many shapes were tried.
        std: (rank,) standard deviation of the strengths.
        added: (n, 6) variance that it adds to whitened readings, in time or by cosine transform.
        in_time: which of the two.
        gap: (6,) [recorded unit] root mean square of what it adds to the readings.
    """

    effect: Effect
    gain: float
    rank: int
    searched: int
    std: Array
    added: Array
    in_time: bool
    gap: Array

    @property
    def evidence(self) -> float:
        """Twice the log Bayes factor, on the scale of a mean effect's."""
        return evidence(self.gain, self.rank) - 2.0 * float(np.log(self.searched))

    @property
    def log_p(self) -> float:
        """Logarithm of the p-value (chi-square bound, corrected for the search)."""
        return float(chi2.logsf(self.gain, self.rank) + np.log(self.searched))

    @property
    def label(self) -> str:
        """Effect and place in one word."""
        return f"{self.effect.name}@{self.effect.where}"

    def applied(self, bench: Bench) -> Bench:
        """The bench with this noise whitened too."""
        factor = 1.0 / np.sqrt(1.0 + self.added)
        if self.in_time:
            return replace(bench, weights=bench.weights * factor)
        gains = []
        for column, gain in enumerate(bench.gains):
            own = factor[:, column]
            gains.append(gain if np.all(own == 1.0) else own if gain is None else gain * own)
        return replace(bench, gains=tuple(gains))


def noise_offers(bench: Bench, explained: Explained, without: Sequence[str] = ()) -> list[NoiseOffer]:
    """Every noise effect at every place, the most evident first."""
    offers = []
    for effect in EFFECTS.values():
        if effect.kind is not Kind.NOISE or effect.name in without or effect.lacking(bench.base):
            continue
        for where in effect.places:
            offer = fit_effect(effect, where, bench, explained)
            if offer is not None:
                offers.append(offer)
    return sorted(offers, key=lambda offer: -offer.evidence)


def fit_effect(effect: type[Effect], where: str, bench: Bench, explained: Explained) -> NoiseOffer | None:
    """One noise effect's strengths by maximum likelihood, at its best shape; None where its channels are not there."""
    (strength,) = [item for item in effect.parameters() if item.strength]
    shapes = effect.searched(bench.base)
    best: NoiseOffer | None = None
    for shape in shapes:
        probe = effect.from_mapping({"where": where, **shape})
        columns = [column for column in range(len(CHANNELS))[probe.columns] if column in bench.columns]
        if not columns:
            return None
        parts = {column: _squares(probe, bench, explained, column) for column in columns}
        if strength.size == 1:  # one strength for all its channels
            together = [np.concatenate([part[index] for part in parts.values()]) for index in (0, 1)]
            fit = _likeliest(together[0], together[1], float(bench.floor_samples[columns].sum()))
            fits = dict.fromkeys(columns, fit)
            gains, spreads = [fit[1]], [fit[2]]
        else:
            fits = {column: _likeliest(*parts[column][:2], float(bench.floor_samples[column])) for column in columns}
            gains, spreads = [fit[1] for fit in fits.values()], [fit[2] for fit in fits.values()]
        gain = float(sum(gains)) * _trust(bench, columns)
        if best is not None and gain <= best.gain:
            continue
        added = np.zeros((len(bench.base), len(CHANNELS)))
        gap = np.zeros(len(CHANNELS))
        for column in columns:
            gap[column] = np.sqrt(fits[column][0] * parts[column][2])
            full = added[:, column]
            unit = parts[column][1]
            full[-len(unit) :] = fits[column][0] * unit
            full[: len(full) - len(unit)] = full[len(full) - len(unit)]
        roots = np.sqrt([max(fits[column][0], 0.0) for column in columns])[: len(gains)]
        std = 0.5 * np.asarray(spreads) / np.maximum(roots, 1e-9)
        roots = np.clip(roots, strength.lower, strength.upper)
        value: object = float(roots[0]) if strength.size == 1 else tuple(float(root) for root in roots)
        made = effect.from_mapping({"where": where, **shape, strength.name: value})
        best = NoiseOffer(made, gain, len(gains), len(shapes), std, added, probe.adds_in_time, gap)
    return best


def _trust(bench: Bench, columns: list[int]) -> float:
    """The share of a gain that counts where the floor is coloured.

    The shape of a coloured floor is known no better at low frequencies than the time at rest tells, and the gain is
    that of a spectrum against it: of two estimates whose variances add.
    """
    coloured = [column for column in columns if bench.whiteners[column].phi != 0.0]
    if not coloured:
        return 1.0
    learned = float(np.mean(bench.floor_samples[coloured]))
    return learned / (learned + len(bench.base))


def _squares(probe: Effect, bench: Bench, explained: Explained, column: int) -> tuple[Array, Array, float]:
    """Squared residuals, in time or by cosine transform, what the effect at strength one adds to them, and its
    variance.

    Cosines are close to the eigenvectors of slowly correlated noise and of a random walk, without the jump between its
    ends that a Fourier transform would see.
    """
    residual = bench.channel(explained.residual, column)
    if probe.adds_in_time:
        rate = np.gradient(bench.base.volts[:, column], bench.base.t)
        added = (rate / bench.whiteners[column].sigma * bench.weights[:, column]) ** 2
        return residual**2, added, float(np.mean(rate**2))
    count = len(residual)
    frequency = np.arange(count)[_TAKEN:] / (2.0 * count)
    alive = float(np.mean(bench.weights[:, column] > 0))
    power = dct(residual, norm="ortho")[_TAKEN:] ** 2 / max(alive, 1e-9)
    weight = float(np.mean(bench.weights[:, column] ** 2)) / max(alive, 1e-9)
    response = weight * np.abs(_response(bench, column, frequency)) ** 2
    spectrum = probe.added_spectrum(frequency, bench.interval_s)
    return power, spectrum * response, float(np.mean(spectrum))


def _response(bench: Bench, column: int, frequency: Array) -> Array:
    """What the whitening does at frequencies [cycles a sample]."""
    whitener = bench.whiteners[column]
    turn = np.exp(-2j * np.pi * frequency)
    response = (1.0 - whitener.phi * turn) / (1.0 + whitener.theta * turn) / whitener.sigma
    gain = bench.gains[column]
    return np.asarray(response if gain is None else response * gain[-len(frequency) :])


def _likeliest(power: Array, unit: Array, floor_samples: float) -> tuple[float, float, float]:
    """The variance x that makes squares most likely under level (1 + x unit / level): x, twice the gain, its deviation.

    The floor's level is not known better than the samples it was learned from tell: it is fitted along, with their
    likelihood.
    """
    largest = float(unit.max()) if unit.size else 0.0
    if largest <= 0.0:
        return 0.0, 0.0, np.inf
    relative = unit / largest

    def loss(point: Array) -> tuple[float, Array]:
        level, ratio = np.exp(point)
        total = level + ratio * relative
        slope = (1.0 - power / total) / total
        value = float(np.sum(np.log(total) + power / total) + floor_samples * (point[0] + 1.0 / level))
        along = np.array([level * slope.sum() + floor_samples * (1.0 - 1.0 / level), ratio * (slope @ relative)])
        return value, along

    count = len(power)
    alone = (float(power.sum()) + floor_samples) / (count + floor_samples)
    nothing = (count + floor_samples) * (np.log(alone) + 1.0)
    starts = [np.array([0.0, exponent]) for exponent in (-3.0, 2.0, 7.0)]
    start = min(starts, key=lambda point: loss(point)[0])
    bounds = [(-2.0, 5.0), (np.log(_LOWEST), np.log(_HIGHEST))]
    found = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds)
    gain = nothing - float(found.fun)
    if gain <= 0.0:
        return 0.0, 0.0, np.inf
    level, ratio = np.exp(found.x)
    total = level + ratio * relative
    weights = np.stack([np.ones(count), relative]) / total
    information = 0.5 * weights @ weights.T
    information[0, 0] += 0.5 * floor_samples / level**2
    spread = float(np.sqrt(np.linalg.inv(information)[1, 1]))
    return float(ratio) / largest, gain, spread / largest
