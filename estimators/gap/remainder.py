"""What is left after the best explanation: is it the floor, or does it follow something?

Tests that need no candidate, each against its null distribution, Bonferroni over all: the mean against broad families
of regressors, the spectrum, the variance, the distribution, and the correlation between channels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct
from scipy.special import log_ndtr
from scipy.stats import kurtosistest

from estimators.gap import coherent
from estimators.gap.bench import Bench
from estimators.gap.score import Explained, solve
from estimators.gap.stochastic import NoiseOffer, spectrum
from estimators.gap.tails import chi2_logsf
from rig.channels import CHANNELS

Array = NDArray[np.float64]

#: Largest p-value, over all tests, of a remainder that is more than noise.
SIGNIFICANT = 1e-3
_BANDS = 12
_COSINES = 16
#: Squares that a band of a spectrum must hold for its sum to be nearly normal.
_FEWEST = 16
#: Where named noise raises the spectrum by this share of the floor, its coefficients are looked at for lines.
_RAISED = 0.3


@dataclass(frozen=True)
class Finding:
    """One test of the remainder.

    Attributes:
        follows: what the remainder would follow, in words.
        channel: the channel, or "all".
        statistic, rank: chi-square and its degrees of freedom under noise.
        log_p: logarithm of its p-value, corrected for the number of tests.
    """

    follows: str
    channel: str
    statistic: float
    rank: int
    log_p: float

    @property
    def excess(self) -> float:
        """What the statistic holds beyond noise, in units of squared signal-to-noise."""
        return max(0.0, self.statistic - self.rank)


def findings(
    bench: Bench,
    explained: Explained,
    noises: Sequence[NoiseOffer] = (),
    smooth: tuple[Bench, Explained] | None = None,
) -> list[Finding]:
    """All tests of what is left, the most significant first.

    Args:
        bench, explained: with the causes taken out and the noise effects whitened.
        noises: these noise effects.
        smooth: bench and what is explained for tests of smooth courses, as means; the same by default.
    """
    jittered = any(offer.in_time for offer in noises)  # an instant that is off is so for all channels
    raw = [
        *mean_tests(bench, explained),
        *([] if jittered else [*coherent_tests(*(smooth or (bench, explained))), *pair_tests(bench, explained)]),
        *spectrum_tests(bench, explained),
        *variance_tests(bench, explained),
        *line_tests(bench, explained, noises),
    ]
    count = np.log(len(raw))
    corrected = [
        Finding(each.follows, each.channel, each.statistic, each.rank, min(0.0, each.log_p + count)) for each in raw
    ]
    return sorted(corrected, key=lambda finding: finding.log_p)


def significant(tests: list[Finding]) -> list[Finding]:
    """The findings that noise does not make."""
    return [finding for finding in tests if finding.log_p < np.log(SIGNIFICANT)]


def families(bench: Bench, column: int) -> dict[str, Array]:
    """Regressors (n, m) by what they follow."""
    base = bench.base
    count = len(base)
    own = base.inputs[:, column] / base.references[column]
    others = np.delete(
        base.inputs[:, bench.columns] / base.references[bench.columns], bench.columns.index(column), axis=1
    )
    clock = (np.arange(count) + 0.5) / count
    cosines = np.cos(np.pi * np.outer(clock, np.arange(1, 4 * _COSINES + 1)))
    rate = np.gradient(own, base.t)
    rate = rate / max(float(np.sqrt(np.mean(rate**2))), 1e-12)
    found = {
        "time": cosines[:, :_COSINES],
        "time, in detail": cosines[:, _COSINES:],
        "level": np.stack([own**2, own**3, own**4, own**5], axis=1),
        "time and level": cosines[:, :6] * own[:, None],
        "rate of change": np.stack([rate, np.abs(rate), rate**2, rate * own], axis=1),
        "other channels": others,
        "orientation": _orientation(base.R_base_tool),
    }
    if base.position.size:
        centred = base.position - base.position.mean(axis=0)
        spread = np.maximum(np.sqrt(np.mean(centred**2, axis=0)), 1e-9)
        place = centred / spread
        found["position"] = np.concatenate([place, _products(place)], axis=1)
    if base.temperature is not None and np.ptp(base.temperature) > 0:
        warm = (base.temperature - base.temperature.mean()) / np.ptp(base.temperature)
        found["temperature"] = np.stack([warm, warm**2, warm * own], axis=1)
    if base.q_encoder is not None:
        found |= _joint_families(base.q_encoder, base.joint_velocity)
    return found


def _joint_families(q: Array, velocity: Array) -> dict[str, Array]:
    moving = coherent.turning(q)
    waves = {
        joint: np.stack([wave(order * q[:, joint]) for order in (1, 2, 3) for wave in (np.cos, np.sin)], axis=1)
        for joint in moving
    }
    found = {f"q{joint + 1}": waves[joint] for joint in moving}
    first = [waves[joint][:, :2] for joint in moving]
    pairs = [
        left[:, [a]] * right[:, [b]]
        for i, left in enumerate(first)
        for right in first[i + 1 :]
        for a in (0, 1)
        for b in (0, 1)
    ]
    if pairs:
        found["joints together"] = np.concatenate(pairs, axis=1)
    around = np.concatenate([np.ones((len(q), 1)), *first], axis=1) if first else np.ones((len(q), 1))
    for joint in moving:
        typical = float(np.median(np.abs(velocity[:, joint])))
        direction = np.tanh(velocity[:, joint] / max(0.2 * typical, 1e-9))
        if np.std(direction) > 0.1:
            found[f"q{joint + 1} direction"] = around * direction[:, None]
    return found


def _products(columns: Array) -> Array:
    count = columns.shape[1]
    return np.stack([columns[:, i] * columns[:, j] for i in range(count) for j in range(i, count)], axis=1)


def _orientation(rotation: Array) -> Array:
    """Products of rotation elements: everything up to second order in the orientation."""
    elements = rotation.reshape(-1, 9)
    return np.concatenate([elements, _products(elements[:, [0, 1, 2, 6, 7, 8]])], axis=1)


def mean_tests(bench: Bench, explained: Explained) -> list[Finding]:
    """Score tests of every family, channel by channel and over all channels."""
    count = bench.count
    found: list[Finding] = []
    total: dict[str, list[tuple[float, int]]] = {}
    for index, column in enumerate(bench.columns):
        rows = slice(index * count, (index + 1) * count)
        basis = explained.basis[rows]
        for name, regressors in families(bench, column).items():
            columns = bench.whiten_channel(column, regressors)
            shared = basis.T @ columns
            own = columns.T @ columns
            score = solve(own - shared.T @ shared, columns.T @ explained.residual[rows], np.sqrt(np.diag(own)))
            total.setdefault(name, []).append((score.statistic, score.rank))
            found.append(Finding(name, CHANNELS[column], score.statistic, score.rank, score.log_p))
    for name, parts in total.items():
        statistic, rank = sum(part[0] for part in parts), sum(part[1] for part in parts)
        found.append(Finding(name, "all", statistic, rank, chi2_logsf(statistic, rank) if rank else 0.0))
    return found


def coherent_tests(bench: Bench, explained: Explained) -> list[Finding]:
    """Score tests of errors that all channels share: along many courses, along each of them, and block by block."""
    found = []
    for trial in coherent.trials(bench, explained):
        for score in [trial.together, *trial.alone]:
            found.append(Finding(trial.organ, "all", score.statistic, score.rank, score.log_p))
    for name, statistic, rank in coherent.in_detail(bench, explained):
        found.append(Finding(name, "all", statistic, rank, chi2_logsf(statistic, rank)))
    return found


def spectrum_tests(bench: Bench, explained: Explained) -> list[Finding]:
    """Lines, and bands in which the spectrum is not the floor's as well as that is known."""
    found = []
    for column in bench.columns:
        residual = bench.channel(explained.residual, column)
        alive = max(float(np.mean(bench.weights[:, column] > 0)), 1e-9)
        power = np.abs(np.fft.rfft(residual)[1:-1]) ** 2 / (len(residual) * alive)
        line = float(power.max())
        found.append(Finding("frequency", CHANNELS[column], 2.0 * line, 2, -line + float(np.log(len(power)))))
        statistic, rank = spectrum(bench, explained, column).misfit(_BANDS, _FEWEST)
        found.append(Finding("noise spectrum", CHANNELS[column], statistic, rank, chi2_logsf(statistic, rank)))
    return found


def line_tests(bench: Bench, explained: Explained, noises: Sequence[NoiseOffer]) -> list[Finding]:
    """Whether noise that was named is a smooth spectrum: lines of a mean in it make its cosine coefficients
    heavy-tailed."""
    found = []
    for offer in noises:
        for column in bench.columns:
            if offer.in_time or not offer.added[:, column].any():
                continue
            where = offer.added[:, column] > _RAISED
            where[:_BANDS] = False
            coefficients = dct(bench.channel(explained.residual, column), norm="ortho")[where]
            if len(coefficients) < 4 * _BANDS:
                continue
            fourth = float(np.mean(coefficients**4) / np.mean(coefficients**2) ** 2 - 3.0)
            z = fourth / float(np.sqrt(24.0 / len(coefficients)))
            # the fourth moment of few coefficients is itself skewed: Anscombe and Glynn's transformation
            tail = float(np.log(kurtosistest(coefficients).pvalue + 1e-300)) if z > 0 else 0.0
            found.append(Finding("lines in the noise", CHANNELS[column], max(z, 0.0) ** 2, 1, tail))
    return found


def variance_tests(bench: Bench, explained: Explained) -> list[Finding]:
    """Whether the size of the residual follows time, level or slope; whether it has heavy tails."""
    found = []
    count = bench.count
    clock = (np.arange(count) + 0.5) / count
    for column in bench.columns:
        kept = bench.weights[:, column] > 0
        residual = bench.channel(explained.residual, column)[kept]
        residual = residual / max(float(np.sqrt(np.mean(residual**2))), 1e-12)
        square = residual**2 - 1.0
        own = bench.base.inputs[:, column] / bench.base.references[column]
        rate = np.gradient(own, bench.base.t)
        regressors = np.column_stack(
            [np.cos(np.pi * np.outer(clock, np.arange(1, 7))), own, own**2, rate**2, np.abs(rate)]
        )[kept]
        regressors = regressors - regressors.mean(axis=0)
        score = solve(
            regressors.T @ regressors, regressors.T @ square / np.sqrt(2.0), np.linalg.norm(regressors, axis=0)
        )
        found.append(Finding("variance", CHANNELS[column], score.statistic, score.rank, score.log_p))
        kurtosis = float(np.mean(residual**4) - 3.0) / np.sqrt(24.0 / len(residual))
        tail = float(np.log(2.0) + log_ndtr(-abs(kurtosis)))
        found.append(Finding("distribution", CHANNELS[column], kurtosis**2, 1, tail))
    return found


def pair_tests(bench: Bench, explained: Explained) -> list[Finding]:
    """Correlation between channels at the same instant; the floor's channels are independent."""
    white = np.stack([bench.channel(explained.residual, column) for column in bench.columns])
    correlation = np.atleast_2d(np.corrcoef(white))
    upper = correlation[np.triu_indices(len(white), 1)]
    if not upper.size:
        return []
    statistic = float(white.shape[1] * np.sum(upper**2))
    return [Finding("other channels' noise", "all", statistic, len(upper), chi2_logsf(statistic, len(upper)))]
