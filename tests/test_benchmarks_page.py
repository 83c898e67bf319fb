"""The page of the benchmarks' figures: every figure of the JSON, in words where there is none."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks._measure import Column, Goal, Report, Table, Timing, timing_table
from benchmarks._run import discover, machine_facts
from documenting.benchmarks_page import main, page

PAGE = Path(__file__).parents[1] / "docs" / "benchmarks.md"


DOCUMENT = {
    "format": "rig-benchmarks/1",
    "quick": True,
    "seed": 0,
    "machine": machine_facts(),
    "benchmarks": {"one": {"title": "a title", "seconds": 1.0, "tables": [], "goals": []}},
}


def test_every_figure_is_on_the_page() -> None:
    timings = {"ours": Timing((0.001, 0.001)), "peer": Timing((0.004, 0.004))}
    table = timing_table("1,664 samples", timings, beside=["peer"], further={"error [mg]": {"peer": 31_250.0}})
    odd = Table("odd", (Column("what"), Column("n")), (("a | b", None), ("c", 7)), "a note")
    goals = (Goal("ours over peer", 0.25, "at most", 2.0), Goal("no answer", float("nan"), "at least", 1.0))
    reports = {
        "one": {"title": "a title", "seconds": 1.0, **Report((table, odd), goals).to_dict()},
        "other": {"title": "broken", "failed": "ValueError: no"},
    }
    document = {**DOCUMENT, "benchmarks": reports}
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


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (None, "no such file"),
        (b"{", "is not JSON"),
        (b"\xff", "UTF-8"),
        ([], "[] is not of type 'object'"),
        ({**DOCUMENT, "format": "rig-calibration/1"}, "format: "),
        ({key: value for key, value in DOCUMENT.items() if key != "machine"}, "'machine' is a required property"),
        ({**DOCUMENT, "benchmarks": {"one": {"titel": "t"}}}, "benchmarks.one: 'title' is a required property"),
        ({**DOCUMENT, "benchmarks": {"one": {"title": "t", "goals": [{}]}}}, "benchmarks.one.goals[0]: "),
        ({**DOCUMENT, "benchmarks": {"one": {"title": 7}}}, "benchmarks.one.title: 7 is not of type 'string'"),
        ({**DOCUMENT, "machine": {**machine_facts(), "load": []}}, "machine.load: "),
    ],
)
def test_what_make_bench_did_not_write_is_refused(
    content: Any, complaint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good, bad, written = tmp_path / "good.json", tmp_path / "bad.json", tmp_path / "page.md"
    good.write_text(json.dumps(DOCUMENT), encoding="utf-8")
    if content is not None:
        bad.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
    assert main([str(written), "Nothing else ran.", str(good), str(bad)]) == 2
    said = capsys.readouterr().err
    assert complaint in said
    assert said.count("\n") == 1
    assert len(said) < 300 + len(str(bad))
    assert f"{bad}" in said
    assert not written.exists()
    assert main([str(written), "Nothing else ran.", str(good)]) == 0
    assert "Nothing else ran." in written.read_text(encoding="utf-8")


def test_a_call_without_files_says_what_is_missing(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["page.md"]) == 2
    assert "BENCH.json" in capsys.readouterr().err
