"""The page of the benchmarks' figures: every figure of the JSON, in words where there is none."""

from __future__ import annotations

from pathlib import Path

from benchmarks._measure import Column, Goal, Report, Table, Timing, timing_table
from benchmarks._run import discover, machine_facts
from documenting.benchmarks_page import page

PAGE = Path(__file__).parents[1] / "docs" / "benchmarks.md"


def test_every_figure_is_on_the_page() -> None:
    timings = {"ours": Timing((0.001, 0.001)), "peer": Timing((0.004, 0.004))}
    table = timing_table("1,664 samples", timings, beside=["peer"], further={"error [mg]": {"peer": 31_250.0}})
    odd = Table("odd", (Column("what"), Column("n")), (("a | b", None), ("c", 7)), "a note")
    goals = (Goal("ours over peer", 0.25, "at most", 2.0), Goal("no answer", float("nan"), "at least", 1.0))
    reports = {
        "one": {"title": "a title", "seconds": 1.0, **Report((table, odd), goals).to_dict()},
        "other": {"title": "broken", "failed": "ValueError: no"},
    }
    document = {"quick": True, "seed": 0, "machine": machine_facts(), "benchmarks": reports}
    text = page(document, "Nothing else ran.")
    for line in (
        "| ours | 1 | 0 | – | 0.25 | – |",
        "| peer | 4 | 0 | – | – | 31,250 |",
        "| a \\| b | – |",
        "| c | 7 |",
        "a note",
        "| one | ours over peer | 0.25 | at most 2 | met |",
        "| one | no answer | – | at least 1 | not measured |",
        "It failed: ValueError: no",
    ):
        assert line in text.splitlines()
    assert "are small" in text
    assert "Nothing else ran." in text
    assert "are small" not in page({**document, "quick": False}, "")


def test_every_benchmark_is_on_the_kept_page() -> None:
    headings = [line.split(":")[0][3:] for line in PAGE.read_text(encoding="utf-8").splitlines() if line[:3] == "## "]
    assert set(discover()) <= set(headings)
