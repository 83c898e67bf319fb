"""The study of the numbers: all are listed with a reason, one moves in its module and in what is made of it, and only
while it is asked for."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pyarrow as pa
import pytest

from estimators.gap.hypotheses import prior
from estimators.gap.search import further_unknowns
from rig.errors import RigError
from scenarios.workers import Workers
from validation.numbers import run
from validation.numbers.listed import ROOMS, Number, numbers
from validation.numbers.run import FACTOR, Row, Settings, make_numbers, sway
from validation.numbers.swayed import with_number

PRIOR = "estimators.gap.hypotheses.prior"


def test_every_number_has_its_reason() -> None:
    every = numbers()
    assert {each.room for each in every} == set(ROOMS)
    assert [each for each in every if not each.reason] == []
    (further,) = [each for each in every if (each.module, each.name) == (PRIOR, "FURTHER")]
    assert further.values == (prior.FURTHER,)
    assert further.reason.startswith("The factor for each further cause")
    lengths = next(each for each in every if (each.module, each.name) == (PRIOR, "LENGTHS"))
    assert lengths.values == prior.LENGTHS
    assert not [each for each in every if each.name == "SECOND"]  # made of another


def test_a_share_stays_one_and_a_count_a_count() -> None:
    assert Number("m", "N", (0.5, 3, -2.0, 0.0), "").moved(2.0) == pytest.approx((2.0 / 3.0, 6, -4.0, 0.0))
    assert Number("m", "N", (1, 0), "").moved(0.5) == (1, 0)
    assert Number("m", "N", (8.0,), "").moved(0.5) == (4.0,)


def test_a_number_moves_with_all_that_is_made_of_it_and_back() -> None:
    number = next(each for each in numbers() if (each.module, each.name) == (PRIOR, "FURTHER_UNKNOWN"))
    with with_number(number, (0.7,)):
        from estimators.gap.hypotheses.prior import FURTHER_UNKNOWN
        from estimators.gap.search.further_unknowns import SECOND

        assert FURTHER_UNKNOWN == 0.7
        assert pytest.approx(math.log(0.7)) == SECOND
    from estimators.gap.search import further_unknowns as after

    assert after is further_unknowns
    assert pytest.approx(math.log(prior.FURTHER_UNKNOWN)) == further_unknowns.SECOND


def test_of_several_in_a_line_one_moves() -> None:
    number = next(each for each in numbers() if each.name == "_DAMPED")
    with with_number(number, (0.5,)):
        from estimators.gap.evidence import refine

        assert (refine._DAMPED, refine._LEAST, refine._LARGEST) == (0.5, 1e-8, 1e4)


def test_the_furthest_move_counts() -> None:
    base = [{"verdict": "no-gap", "nothing": 0.9, "other": 0.1}, {"verdict": "named", "nothing": 0.0, "a at b": 0.9}]
    moved = [{"verdict": "no-gap", "nothing": 0.8, "other": 0.1}, {"verdict": "unknown", "nothing": 0.0, "other": 0.3}]
    assert sway(base, json.dumps(moved)) == (pytest.approx(0.9), True)
    assert sway(base, json.dumps(base)) == (0.0, False)
    assert sway(base, "ValueError: no") == (math.inf, True)


def test_the_page_has_every_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told = {"verdict": "no-gap", "nothing": 0.9, "other": 0.1}
    few = numbers()[:3]

    def trial(settings: Settings, number: int) -> pa.Table:
        each = few[max(number - 1, 0)]
        row = Row(each.module, each.name, FACTOR, json.dumps([{**told, "nothing": 0.7 if number == 2 else 0.9}]))
        return pa.Table.from_pylist([vars(row)])

    monkeypatch.setattr(run, "trial", trial)
    monkeypatch.setattr(run, "numbers", lambda: few)
    page, rows = make_numbers(tmp_path, Settings(), Workers(0, None))
    assert len(rows) == 1 + len(few)
    text = page.read_text(encoding="utf-8")
    assert all(f"`{each.name}` in {each.module.rsplit('.', 1)[1]}" in text for each in few)
    assert "2 of 3 move no probability by more than 0.05; 0 change a verdict." in text
    assert "| 0.20 |" in text
    monkeypatch.setattr(run, "numbers", lambda: numbers()[1:4])
    with pytest.raises(RigError, match=f"study: .*of before there was {numbers()[3].name} in .*: remove that folder"):
        make_numbers(tmp_path, Settings(), Workers(0, None))
