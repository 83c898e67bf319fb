"""The closed share of the squared gap: its interval holds what is really closed as often as it says."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ndtri
from scipy.stats import binom, norm

from estimators.gap.data.projection import Basis
from estimators.gap.evidence.laplace import Linear
from estimators.gap.evidence.terms import Functions, smooth_terms
from estimators.gap.evidence.weighed import Weighed
from estimators.gap.hypotheses.prior import FORM, OTHER, OTHER_NOISE, VISIBLE
from estimators.gap.hypotheses.sources import Source
from estimators.gap.hypotheses.stochastic import FittedNoise
from estimators.gap.report.closed_shares import (
    by_cause,
    of_noise,
    of_noise_by_channel,
    of_whole,
    out_of_form,
    where_left,
)
from estimators.gap.report.closure import Way, could_hide, drawn, held_out, share
from rig.channels import CHANNELS
from rig.effects import make_effect

TIMES, ROWS, SNR = 400, 300, 20.0


@pytest.mark.parametrize("count", [1, 3, 12])
def test_the_interval_of_the_closed_share_holds_the_truth(count: int) -> None:
    """A linear cause of signal-to-noise 20 fitted by least squares; each bound of the count fails once in 1e5 runs."""
    rng = np.random.default_rng(count)
    held = 0
    for _ in range(TIMES):
        tangent = rng.standard_normal((ROWS, count))
        true = rng.standard_normal(count)
        true *= SNR / np.linalg.norm(tangent @ true)
        readings = tangent @ true + rng.standard_normal(ROWS)
        gram = tangent.T @ tangent
        fitted = np.linalg.solve(gram, tangent.T @ readings)
        change = tangent @ fitted
        linear = Linear(
            readings - change,
            tangent,
            fitted,
            np.ones(count, dtype=bool),
            np.ones(count),
            np.zeros(count, dtype=np.intp),
        )
        way = Way(1.0, change, linear, (np.zeros(count), np.linalg.inv(gram)))
        closed = share(*drawn([way], change, rng))
        really = 1.0 - float(np.sum((tangent @ (true - fitted)) ** 2)) / SNR**2
        assert closed.low is not None
        assert closed.high is not None
        held += closed.low <= really <= closed.high
    # the bounds are order statistics of draws, known to a percent or so: anything from 93 to 97 % will do
    assert binom.ppf(1e-5, TIMES, 0.93) <= held <= binom.ppf(1.0 - 1e-5, TIMES, 0.97)


@pytest.mark.parametrize("snr", [10.0, 30.0, 300.0])
def test_the_interval_allows_for_a_form_that_is_not_quite_right(snr: float) -> None:
    """As for any normal error: nothing to 1.96 standard deviations of a tenth of the cause, or of what is just visible.
    The lower bound of 400 draws is off by a quarter of a standard deviation once in a hundred thousand."""
    before = np.full(400, snr**2)
    closed = share(out_of_form(before, np.random.default_rng(1)), before)
    off = min(FORM, VISIBLE / snr)
    assert closed.low is not None
    assert closed.high == 1.0  # all closed is the likeliest
    assert 1.0 - (2.4 * off) ** 2 < closed.low < 1.0 - (1.6 * off) ** 2


def test_draws_do_not_know_which_signs_the_eigenvectors_have(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another machine's rounding may turn any of them round: parameters and a discrepancy are drawn the same, to the
    square root of rounding."""
    rng = np.random.default_rng(3)
    tangent, left, change = rng.standard_normal((ROWS, 4)), rng.standard_normal(ROWS), rng.standard_normal(ROWS)
    source = Source("an angle", rng.standard_normal((2, 3, ROWS // 3)), "angle")
    owner = np.zeros(4, dtype=np.intp)
    linear = Linear(left, tangent, np.ones(4), np.ones(4, dtype=bool), np.ones(4), owner)

    def draws() -> np.ndarray:
        _, (term, *_) = smooth_terms(
            Basis(((slice(0, ROWS), np.full((ROWS, 1), ROWS**-0.5)),), ROWS),
            [source],
            [[]],
            [0.0],
            Functions.of(ROWS // 3, []),
        )
        moments = linear.posterior(np.ones(4))
        way = Way(1.0, change, linear, moments, 0.0, [Weighed(term, np.arange(8.0))])
        return np.stack(drawn([way], 0.7 * change, np.random.default_rng(0)))

    solve, plain = np.linalg.eigh, draws()

    def turned(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        values, vectors = solve(matrix)
        return values, vectors * rng.choice([-1.0, 1.0], vectors.shape[-1])

    monkeypatch.setattr(np.linalg, "eigh", turned)
    np.testing.assert_allclose(draws(), plain, rtol=1e-8)


def test_a_shape_that_the_fit_keeps_widens_it_as_a_fitted_one_would() -> None:
    """Two directions at right angles, of unit length: the first is fitted, the second lies with equal probability at
    quantiles of what the readings say of it."""
    rng = np.random.default_rng(7)
    both = np.linalg.qr(rng.standard_normal((ROWS, 2)))[0]
    quantiles = ndtri((np.arange(40) + 0.5) / 40.0)
    one = np.ones(1)
    held = 0
    for _ in range(TIMES):
        true = SNR / np.sqrt(2.0) * both.sum(axis=1)
        fitted = both.T @ (true + rng.standard_normal(ROWS))
        change = both @ fitted
        linear = Linear(change - change, both[:, :1], fitted[:1], one > 0, one, np.zeros(1, dtype=np.intp))
        way = Way(1.0, change, linear, (np.zeros(1), np.eye(1)), apart=(np.outer(quantiles, both[:, 1]),))
        closed = share(*drawn([way], change, rng))
        really = 1.0 - float(np.sum((true - change) ** 2)) / SNR**2
        assert closed.low is not None
        assert closed.high is not None
        held += closed.low <= really <= closed.high
    assert binom.ppf(1e-5, TIMES, 0.93) <= held <= binom.ppf(1.0 - 1e-5, TIMES, 0.97)


def test_what_acts_in_one_block_alone_is_judged_there_as_it_was_fitted() -> None:
    """No other block can fit it."""
    tangent = np.zeros((ROWS, 1))
    tangent[ROWS // 2 + 2] = 1.0  # amid a block
    change = 3.0 * tangent[:, 0]
    linear = Linear(
        np.zeros(ROWS), tangent, np.full(1, 3.0), np.ones(1, dtype=bool), np.ones(1), np.zeros(1, dtype=np.intp)
    )
    data = SimpleNamespace(count=ROWS, columns=[0], size=ROWS)
    found = held_out(linear, change, data)  # type: ignore[arg-type]
    assert 9.0 <= found < 18.0  # scaled to all samples from those that are not at a block's end


def test_the_only_cause_that_is_reported_closes_what_all_close() -> None:
    rng = np.random.default_rng(0)
    after, before = rng.uniform(0.05, 0.15, 100), np.ones(100)
    assert by_cause(1, None, None, before - after, before, rng) == share(after, before)  # type: ignore[arg-type]


def noise_of(where: str, variances: tuple[float, ...]) -> FittedNoise:
    """Noise of a sensor or channel that is known to a per mille, of so many times the floor's variance."""
    added = np.zeros((ROWS, 6))
    added[:, [column for column, name in enumerate(CHANNELS) if name == where or name[:3] == where[:3]]] = variances
    name, strength = ("noise_coloured", "sigma_V") if len(variances) > 1 else ("noise_excess", "extra_sigma")
    root = tuple(np.sqrt(variances)) if len(variances) > 1 else float(np.sqrt(variances[0]))
    effect = make_effect(name, {"where": where, strength: root})
    spread = 1e-3 * np.array(variances)
    return FittedNoise(effect, 0.0, len(variances), 1, spread, spread, added, False, np.zeros(6))


def test_the_shares_of_noise_are_of_the_whole_gap_and_add_up() -> None:
    """Noise of both sensors and a gap of the mean that is as large as both: a quarter, a quarter and a half."""
    rng = np.random.default_rng(0)
    data = SimpleNamespace(parts=[])
    noises = [noise_of("magnetometer", (0.1, 0.3, 0.2)), noise_of("accelerometer", (0.4, 0.1, 0.1))]
    size = 0.6 * ROWS
    told = []
    for one in noises:
        after, before = of_noise([one], [], data, rng)  # type: ignore[arg-type]
        assert before == pytest.approx(size)
        told.append(of_whole(before - after, np.full(len(after), 4.0 * size)))
    assert [each.value for each in told] == pytest.approx([0.25, 0.25], abs=1e-4)
    half, whole = np.full(9, 2.0 * size), np.full(9, 4.0 * size)
    assert by_cause(0, None, None, half, whole, rng).value == pytest.approx(0.5)  # type: ignore[arg-type]


def test_each_channel_keeps_what_its_own_noise_is_unsure_of() -> None:
    """Known to a tenth and to two tenths, of a half-normal error: the median of the squares is .45 of theirs."""
    noise = noise_of("magnetometer", (0.1, 0.3, 0.2))
    noise = replace(noise, spread=np.array([0.1, 0.2, 1e-6]) * np.square(noise.effect.sigma_V))  # type: ignore[attr-defined]
    after, before = of_noise_by_channel([noise], [], SimpleNamespace(parts=[]), np.random.default_rng(0))  # type: ignore[arg-type]
    assert before[0] == pytest.approx(np.array([0.0, 0.0, 0.0, 0.1, 0.3, 0.2]) * ROWS)
    left = np.median(after, axis=0)[3:] / before[0, 3:]
    assert left == pytest.approx([0.455 * 0.1**2, 0.455 * 0.2**2, 0.0], rel=0.5, abs=1e-9)


def test_what_is_left_of_a_cause_lies_where_its_parameters_are_unsure() -> None:
    """Two strengths, each of one channel; the second's width makes three quarters of what may be left."""
    tangent = np.zeros((20, 2))
    tangent[:10, 0] = tangent[10:, 1] = 1.0
    linear = SimpleNamespace(tangent=tangent)
    explanation = SimpleNamespace(linear=linear, data=SimpleNamespace(columns=[0, 1]))
    told = SimpleNamespace(explanation=explanation, moments=(np.zeros(2), np.diag([1.0, 3.0])))
    assert where_left(told) == pytest.approx([0.25, 0.75])  # type: ignore[arg-type]


def test_a_cause_takes_no_more_than_the_gap() -> None:
    """Where its own draws of the gap and the whole one's are apart."""
    assert of_whole(np.full(9, 8.0), np.full(9, 1e-12)) == share(np.zeros(9), np.ones(9))


@pytest.mark.parametrize("log_prior", [-2.0, -8.0])
def test_what_could_hide_is_the_size_that_escapes_once_in_twenty(log_prior: float) -> None:
    variances = 25.0 * 4.0 ** np.arange(8.0) / 2.0
    term = SimpleNamespace(values=np.array([2.0]), variances=variances, log_prior=log_prior)
    nothing = SimpleNamespace(values=np.zeros(2), variances=variances, log_prior=log_prior)

    def gain(seen: float) -> float:
        """The log odds of the term, of which so many standard deviations are seen."""
        spread = np.sqrt(1.0 + 2.0 * variances)
        odds = OTHER * (1.0 - OTHER_NOISE) / (1.0 - OTHER) * np.exp(log_prior)
        return float(np.log(odds * np.mean(norm.pdf(seen, scale=spread)) / norm.pdf(seen)))

    sees = brentq(gain, 0.0, 20.0)  # below that it is taken for noise
    expected = brentq(lambda size: norm.cdf(sees - size) - norm.cdf(-sees - size) - 0.05, sees, 2.0 * sees)
    found = could_hide(SimpleNamespace(terms=[term, nothing]), np.random.default_rng(0))  # type: ignore[arg-type]
    # that quantile of 64 draws has a standard deviation of 0.26: four of them, and the 5 % to which it is sought
    assert abs(found - expected) < 4.0 * 0.26 + 0.05 * expected
