"""A sealed set as somebody else may have made it, or time has left it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from test_blind import few_candidates, made  # noqa: F401  (fixtures)

import estimators.gap
from rig.errors import RigError
from scenarios.cli import _app
from scenarios.workers import Workers
from validation.blind import answers
from validation.blind.answers import Answers
from validation.blind.make import Order, make_set
from validation.blind.solve import ANSWERS, solve_set
from validation.blind.strata import FEWEST

HERE = Workers(0)


@pytest.mark.parametrize("key", ["name", "recording", "locked"])
@pytest.mark.parametrize("name", ["../../../x", "/etc/passwd", "a/b", "", "..", 5, None], ids=repr)
def test_a_set_does_not_lead_out_of_its_folder(made: Path, tmp_path: Path, key: str, name: object) -> None:  # noqa: F811
    folder = tmp_path / "deep" / "set"
    shutil.copytree(made, folder)
    document = json.loads((folder / "manifest.json").read_text())
    document["cases"][2][key] = name
    (folder / "manifest.json").write_text(json.dumps(document))
    before = sorted(tmp_path.rglob("*"))
    for command in (("blind", "solve", str(folder)), ("blind", "score", str(folder), "--truth", str(made) + ".sealed")):
        assert _app.run([*command]) == 2
    assert sorted(tmp_path.rglob("*")) == before


def test_a_set_does_not_write_through_links(made: Path, tmp_path: Path) -> None:  # noqa: F811
    folder, elsewhere = tmp_path / "set", tmp_path / "elsewhere"
    elsewhere.mkdir()
    shutil.copytree(made, folder)
    (folder / ANSWERS).symlink_to(elsewhere)
    with pytest.raises(RigError, match="answers: is a link"):
        solve_set(folder, HERE)
    (folder / ANSWERS).unlink()
    (folder / "case000.parquet").unlink()
    (folder / "case000.parquet").symlink_to("/etc/passwd")
    with pytest.raises(RigError, match=r"case000.parquet: is a link"):
        solve_set(folder, HERE)
    assert not list(elsewhere.iterdir())


def test_a_set_that_is_refused_gets_no_answers(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    folder = tmp_path / "set"
    shutil.copytree(made, folder)
    last = sorted(folder.glob("case*.locked.parquet"))[-1]
    content = last.read_bytes()
    last.write_bytes(content + b"x")
    with pytest.raises(RigError, match="has changed since it was sealed"):
        solve_set(folder, HERE)
    assert not (folder / ANSWERS).exists()
    last.write_bytes(content)

    def full(path: Path, text: str) -> None:
        raise RigError("no space left")

    monkeypatch.setattr(answers, "write_text", full)
    with pytest.raises(RigError, match="no space left"):
        solve_set(folder, HERE)
    assert not (folder / ANSWERS).exists()


def test_a_damaged_answer_is_found_and_made_again(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    folder = tmp_path / "set"
    shutil.copytree(made, folder)
    asked: list[str] = []

    class Found:
        def write(self, path: Path) -> None:
            path.write_text('{"verdict": "named", "causes": []}')

    def judge_all(run: Path, locked: Path | None, without: tuple[str, ...], arm: object) -> Found:
        asked.append(run.stem)
        return Found()

    monkeypatch.setattr(estimators.gap, "diagnose", judge_all)
    assert solve_set(folder, HERE) == FEWEST
    kept = Answers(folder / ANSWERS)
    path = kept.path("case004")
    path.write_text(path.read_text().replace("named", "no-gap"))
    with pytest.raises(RigError, match="is damaged or was changed: run rig blind solve again"):
        kept.read("case004")
    assert solve_set(folder, HERE) == 1
    assert asked[-1] == "case004"
    assert kept.read("case004")["verdict"] == "named"


@pytest.mark.parametrize("truth", ["set", "set/truth"])
def test_the_truth_does_not_lie_beside_the_recordings(tmp_path: Path, truth: str) -> None:
    order = Order(str(tmp_path / "set"), str(tmp_path / truth), 7, FEWEST, samples=400)
    with pytest.raises(RigError, match="expected another for the truth"):
        make_set(order, HERE)
    assert not list(tmp_path.iterdir())
