"""What is left counts what only doubted causes explain, in units of the floor."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from whitened_examples import data, discrepancies  # noqa: F401

from estimators.gap.data.projection import project
from estimators.gap.data.steps import Step
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.discrepancy import Discrepancies
from estimators.gap.report.left_over import remainder


def swinging(data: WhitenedData, snr: float) -> tuple[WhitenedData, float]:
    """White noise, and an offset of mag1 that swings ever faster; the squares that it adds."""
    rng = np.random.default_rng(3)
    wave = np.zeros_like(data.readings)
    wave[:, 3] = np.cos(20.0 * np.linspace(0.0, 1.0, data.count) ** 2)
    size = float(np.linalg.norm(project(data.absorbed, data.whiten(wave))))
    noise = np.zeros_like(data.readings)
    for column in data.columns:
        noise[:, column] = data.whiteners[column].sigma * rng.standard_normal(data.count)
    return replace(data, readings=data.modelled + noise + wave * snr / size), snr**2


def told_left(
    data: WhitenedData, discrepancies: Discrepancies, gap: float, named: bool
) -> tuple[dict[str, object], ...]:
    weighed = SimpleNamespace(terms=())
    alone = weighed if named else SimpleNamespace(explanation=SimpleNamespace(fits=[], data=data), terms=())
    fine = SimpleNamespace(data=data)
    posterior = SimpleNamespace(
        scanner=SimpleNamespace(fine=fine), discrepancies=discrepancies, hypotheses=(), probabilities=np.zeros(0)
    )
    found = remainder(posterior, weighed, alone, [], 0.0, True, gap, np.random.default_rng(0))  # type: ignore[arg-type]
    return found.follows


def test_what_a_doubted_cause_alone_explains_is_left(data: WhitenedData, discrepancies: Discrepancies) -> None:
    """An error of 60 that one cause explains, which is not named: it is described as what it is, nearly all of the gap
    (of 3,600 squares the noise has 60 either way, the shrinkage a tenth). Of a cause that is named nothing is left."""
    off, square = swinging(data, 60.0)
    first, *_ = told_left(off, discrepancies, square, named=False)
    assert first["source"] == "the offset of mag1"
    assert first["course"].startswith("time")
    assert 0.8 < first["share"] <= 1.0
    assert told_left(off, discrepancies, square, named=True) == ()


@pytest.mark.parametrize("in_time", [True, False])
def test_steps_of_whitening_are_undone(data: WhitenedData, in_time: bool) -> None:
    rng = np.random.default_rng(1)
    steps = [Step(column, rng.uniform(0.05, 1.0, data.count), in_time) for column in (3, 4)]
    white = rng.standard_normal(data.size)
    after = white.copy()
    for step in steps:
        own = slice(step.column * data.count, (step.column + 1) * data.count)
        after[own] = step(after[own])
    np.testing.assert_allclose(data.before(steps, after), white, atol=1e-10)
