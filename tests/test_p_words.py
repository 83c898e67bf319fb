"""A p-value in words: never one that looks like a number and is none."""

from __future__ import annotations

import pytest

from estimators.p_words import p_words


@pytest.mark.parametrize(
    ("value", "words"),
    [(0.0, "p < 1e-99"), (1e-120, "p < 1e-99"), (1e-98, "p = 1e-98"), (0.0312, "p = 0.031"), (1.0, "p = 1")],
)
def test_a_p_value_of_zero_is_told_as_less(value: float, words: str) -> None:
    assert p_words(value) == words
