"""The standard terms of an Allan deviation: quantisation, white noise, bias instability, random walk and ramp.

    sigma^2(tau) = 3 Q^2 / tau^2 + N^2 / tau + (2 ln 2 / pi) B^2 + K^2 tau / 3 + R^2 tau^2 / 2

is IEEE Std 952-1997, annex C (B at averages well above the sampling interval). The coefficients are found by least
squares with the covariance that the Allan variances have under the model itself (``allan_model``), which
gives their standard deviations too, and the intervals of the deviation. A term is reported where the data show it; of
the others an upper limit is.

Of a sampled voltage, white noise over the sensitivity is the velocity random walk (m/s/sqrt(s)) of an accelerometer;
the converter's rounding is white too and adds step^2 / 12 to it. The term Q, of slope -1, is the rounding of something
that is differenced afterwards (an increment of angle or velocity): a converter that samples a voltage has none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Final

import numpy as np
from scipy.optimize import nnls
from scipy.special import chdtrc

from estimators.noise.allan import AllanDeviation
from estimators.noise.allan_model import AllanModel, allan_model
from rig.arrays import Array
from rig.threads import one_blas_thread

#: The names, and what each unit is beside the reading's.
TERMS: Final[dict[str, str]] = {
    "quantisation": "s",
    "white": "/sqrt(Hz)",
    "bias_instability": "",
    "random_walk": "/sqrt(s)",
    "ramp": "/s",
}
_NAMES: Final = tuple(TERMS)
_WHITE: Final = _NAMES.index("white")
_RAMP: Final = _NAMES.index("ramp")
#: What a term must gain in minus twice the log likelihood: white noise shows another in fewer than one of 300 channels.
PENALTY: Final = 12.0
_STEPS: Final = 6
#: Added to the diagonal of correlations: long averages of one random walk are all but one number.
_JITTER: Final = 1e-6
#: One-sided 95 % of a normal distribution, for the upper limit of a term that is not seen.
_ONE_SIDED_95: Final = 1.6448536269514722


@dataclass(frozen=True)
class Term:
    """One coefficient, in the reading's unit with the suffix of ``TERMS``.

    Attributes:
        value: zero where it is not seen.
        std: its standard deviation; NaN where it is not seen.
        upper: what it does not exceed with 95 % confidence, where it is not seen; NaN elsewhere.
    """

    value: float
    std: float
    upper: float

    @property
    def seen(self) -> bool:
        """Whether the data show it."""
        return self.value > 0.0


@dataclass(frozen=True, eq=False)
class NoiseTerms:
    """The standard terms of one channel.

    Attributes:
        terms: by the names of ``TERMS``.
        deviation: (k,) the Allan deviation of the terms together [unit].
        degrees_of_freedom: (k,) equivalent ones of the measured Allan variances, if the terms are the truth.
        p_value: how probable it is that these terms leave as much of the Allan variances unexplained as they do, by
            chi-square; NaN where there are no more averages than terms.
    """

    terms: Mapping[str, Term]
    deviation: Array
    degrees_of_freedom: Array
    p_value: float

    def __getitem__(self, name: str) -> Term:
        """One of them."""
        return self.terms[name]

    def to_json(self) -> dict[str, Any]:
        """Value and standard deviation, or upper limit, of each."""
        return {
            name: {"value": term.value, "std": term.std} if term.seen else {"value": 0.0, "upper_95": term.upper}
            for name, term in self.terms.items()
        }


def fit_terms(measured: AllanDeviation) -> NoiseTerms:
    """The terms that a measured Allan deviation shows, and upper limits of the others."""
    observed = np.square(measured.deviation)
    if not observed.any():
        nothing = {name: Term(0.0, np.nan, 0.0) for name in TERMS}
        return NoiseTerms(nothing, np.zeros_like(observed), np.full_like(observed, np.nan), np.nan)
    with one_blas_thread():
        return _fit(_Fit.of(measured))


def _fit(fit: _Fit) -> NoiseTerms:
    """White noise, with whichever of the others pay for themselves."""
    others = [index for index in range(len(_NAMES)) if index != _WHITE]
    choices = [(_WHITE, *extra) for size in range(len(others) + 1) for extra in combinations(others, size)]
    shown = min(choices, key=lambda choice: fit.cost(fit.solve(choice)) + PENALTY * len(choice))
    best = fit.solve(shown)
    spread = fit.spread(best, shown)
    terms: dict[str, Term] = {}
    for index, name in enumerate(_NAMES):
        if best[index] > 0.0:
            value = float(np.sqrt(best[index]))
            terms[name] = Term(value, float(spread[index]) / (2.0 * value), np.nan)
        else:
            wider = [*shown, index]
            limit = fit.solve(wider)[index] + _ONE_SIDED_95 * fit.spread(best, wider)[index]
            terms[name] = Term(0.0, np.nan, float(np.sqrt(limit)))
    expected = fit.design @ best
    variance = fit.covariance(best).diagonal()
    left = len(expected) - len(shown)
    return NoiseTerms(
        terms,
        np.sqrt(expected),
        2.0 * expected**2 / np.maximum(variance, 1e-300),
        float(chdtrc(left, fit.chi_square(best))) if left > 0 else np.nan,
    )


@dataclass(frozen=True, eq=False)
class _Fit:
    """Observed Allan variances (k,), what each squared coefficient adds to them (k, 5), and their statistics."""

    observed: Array
    design: Array
    interval_s: float
    model: AllanModel

    @classmethod
    def of(cls, measured: AllanDeviation) -> _Fit:
        samples = tuple(int(n) for n in measured.samples)
        averaged = tuple(int(m) for m in measured.averaged)
        model = allan_model(samples, averaged)
        per_sample = model.variances * _per_sample(measured.interval_s)
        ramp = 0.5 * np.square(measured.tau_s)
        return cls(np.square(measured.deviation), np.column_stack([per_sample, ramp]), measured.interval_s, model)

    def covariance(self, coefficients: Array) -> Array:
        """(k, k) of the observed variances for squared coefficients (5,); a ramp does not scatter."""
        return self.model.covariance(coefficients[:_RAMP] * _per_sample(self.interval_s))

    def _root(self, coefficients: Array) -> tuple[Array, Array]:
        """Size (k,) and lower root (k, k) of the covariance: size * root @ root.T * size, neighbours all but equal."""
        covariance = self.covariance(coefficients)
        size = np.asarray(np.sqrt(np.maximum(covariance.diagonal(), 1e-300)), dtype=np.float64)
        correlation = covariance / np.outer(size, size) + _JITTER * np.eye(len(size))
        return size, np.asarray(np.linalg.cholesky(correlation), dtype=np.float64)

    def _whitened(self, coefficients: Array) -> tuple[Array, Array]:
        """Design and observation with unit covariance under squared coefficients (5,)."""
        size, root = self._root(coefficients)
        table = np.column_stack([self.design, self.observed]) / size[:, None]
        both = np.asarray(np.linalg.solve(root, table), dtype=np.float64)
        return both[:, :-1], both[:, -1]

    def cost(self, coefficients: Array) -> float:
        """Minus twice the logarithm of the likelihood, as if Allan variances were normal."""
        if not coefficients[:_RAMP].any():
            return np.inf
        size, root = self._root(coefficients)
        return self.chi_square(coefficients) + float(2.0 * np.log(root.diagonal()).sum() + 2.0 * np.log(size).sum())

    def chi_square(self, coefficients: Array) -> float:
        """Of what squared coefficients (5,) leave unexplained."""
        design, observed = self._whitened(coefficients)
        return float(np.square(observed - design @ coefficients).sum())

    def solve(self, shown: Sequence[int]) -> Array:
        """(5,) squared coefficients, none negative, zero but for those ``shown``."""
        columns = list(shown)
        result = np.zeros(len(_NAMES))
        weighted = self.design[:, columns] / self.observed[:, None]  # as if every variance were equally well known
        scale = np.sqrt(np.square(weighted).sum(axis=0))
        result[columns] = nnls(weighted / scale, np.ones(len(weighted)))[0] / scale
        for _ in range(_STEPS):
            if not result[:_RAMP].any():
                break
            design, observed = self._whitened(result)
            scale = np.sqrt(np.square(design[:, columns]).sum(axis=0))
            result[columns] = nnls(design[:, columns] / scale, observed)[0] / scale
        return result

    def spread(self, coefficients: Array, shown: Sequence[int]) -> Array:
        """(5,) standard deviations of the squared coefficients if those given are the truth; NaN for others."""
        columns = list(shown)
        design = self._whitened(coefficients)[0][:, columns]
        scale = np.sqrt(np.square(design).sum(axis=0))
        inverse = np.linalg.pinv((design / scale).T @ (design / scale))
        result = np.full(len(_NAMES), np.nan)
        result[columns] = np.sqrt(inverse.diagonal()) / scale
        return result


def _per_sample(interval_s: float) -> Array:
    """(4,) what squared coefficients of Q, N, B, K are per sample: q, s, b, k of ``estimators.noise.allan_model``."""
    return np.array([interval_s**-2.0, 1.0 / interval_s, 1.0, interval_s])
