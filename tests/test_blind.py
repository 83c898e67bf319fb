"""The blind check from end to end: sealing, solving, judging, the page."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from blind_answers import answer

import estimators.gap
import scenarios
import validation.blind.scoring as scoring
from rig.channels import CHANNELS
from rig.effects import Effect, make_effect
from rig.errors import RigError
from rig.recording import read_recording
from rig.signals import Signals
from scenarios.cli import _app
from scenarios.workers import Workers
from validation.blind import answers, likeness
from validation.blind.answers import Answers
from validation.blind.baselines import BASELINES
from validation.blind.cases import Case, make_case
from validation.blind.intervals import Rate
from validation.blind.laboratories import LABORATORIES
from validation.blind.make import Order, _make_one, make_set
from validation.blind.mechanics import MECHANISMS
from validation.blind.power import crossing, half_power, ideal_power
from validation.blind.report import page, write_report
from validation.blind.scoring import is_right, score_set, summary, withheld_effect
from validation.blind.seal import commitment, read_manifest, read_order, read_truth, sealed_folder
from validation.blind.settings import FloorKind, draw_setting
from validation.blind.solve import ANSWERS, solve_set
from validation.blind.strata import FEWEST, MECHANICS, STRATA, Plan, plans, usable
from validation.blind.strength import signal_to_noise
from validation.blind.truth import Truth

HERE = Workers(0)
CASES = FEWEST


@pytest.fixture(scope="module")
def few_candidates() -> Iterator[None]:
    """A truth is compared with the joints' effects alone: with the whole catalogue that takes a second a case."""
    every = likeness.candidates

    def few(signals: Signals) -> list[tuple[type[Effect], dict[str, str]]]:
        return [each for each in every(signals) if each[0].name in ("backlash", "joint_offset", "joint_scale")]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(likeness, "candidates", few)
        for name in ("short", "long"):
            patch.setitem(LABORATORIES, name, replace(LABORATORIES[name], samples=400))
        yield


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, few_candidates: None) -> Path:
    """A case of each stratum, small; not to be written to."""
    folder = tmp_path_factory.mktemp("blind") / "set"
    assert make_set(Order(str(folder), str(sealed_folder(folder)), 7, CASES, samples=400), HERE) == CASES
    return folder


@dataclass(frozen=True)
class Stub:
    """A diagnosis that says what it is told."""

    document: dict[str, Any]

    def write(self, path: Path) -> None:
        path.write_text(json.dumps(self.document))


def stub(name: str, verdict: str, *causes: tuple[str, str]) -> Stub:
    channel = {"noise_floor": 0.01, "rms_before": 0.02, "gap_before": 0.01, "rms_after": 0.01, "gap_after": 0.0}
    return Stub(
        answer(verdict, *causes)
        | {
            "recordings": [name],
            "seconds": 0.5,
            "where": {"channels": dict.fromkeys(CHANNELS, channel)},
            "closed": {"value": 0.9 if causes else None, "low": 0.8, "high": 1.0},
            "remainder": {"verdict": "noise", "follows": [], "could_hide_snr": 4.0},
        }
    )


def test_strata_hold_what_they_say() -> None:
    dealt = plans(200, np.random.default_rng(0), mechanics=6)
    counts = {name: sum(plan.stratum == name for plan in dealt) for name in (*STRATA, MECHANICS)}
    assert sum(counts.values()) == 206
    assert counts[MECHANICS] == 6
    assert counts["none"] >= 50  # at least a quarter of the cases
    assert min(counts.values()) > 0
    many = {"none": (0,), "several": (3, 4)} | dict.fromkeys(
        ("two", "two places", "one joint", "strong and weak", "known and outside"), (2,)
    )
    for plan in dealt:
        assert len(plan.names) in many.get(plan.stratum, (1,))
        assert len(plan.names) == len(plan.strengths)
        assert (plan.stratum != "two places") or plan.names[0] == plan.names[1]
    assert {plan.laboratory for plan in dealt} == set(LABORATORIES)
    assert all(usable(name, plan.laboratory) for plan in dealt if plan.stratum in ("one", "two") for name in plan.names)
    assert {plan.names[0] for plan in dealt if plan.stratum == MECHANICS} == set(MECHANISMS)
    assert {plan.floor for plan in dealt} == set(get_args(FloorKind))
    order = [plan.stratum for plan in dealt]
    assert order != sorted(order)
    with pytest.raises(RigError, match="at least 16"):
        plans(3, np.random.default_rng(0))


def test_the_open_half_tells_nothing(made: Path) -> None:
    """Hashes and file names; recordings that say neither seed nor effect."""
    for case in read_manifest(made):
        keys = {"name", "recording", "locked", "arm", "recording_sha256", "commitment"}
        keys |= {f"{key}_sha256" for key in ("locked", "arm") if case[key]}
        assert set(case) == keys
        recording = read_recording(made / case["recording"])
        assert recording.metadata.notes == ""
        assert not recording.metadata.extra
        assert len(recording) == 400
    text = b"".join(path.read_bytes() for path in made.iterdir() if path.is_file())
    truths = read_truth(sealed_folder(made), read_manifest(made))
    for truth in truths.values():
        for cause in truth["causes"]:
            assert cause["name"].encode() not in text
    assert (sealed_folder(made) / "truth.json").stat().st_mode & 0o077 == 0


def test_the_same_order_makes_the_same_recordings(made: Path, tmp_path: Path) -> None:
    order = Order(str(tmp_path / "a"), str(tmp_path / "b"), 7, CASES, samples=400)
    (tmp_path / "a").mkdir()
    (tmp_path / "b" / "changes").mkdir(parents=True)
    first = read_manifest(made)[3]
    again, sealed = _make_one(order, 3)
    assert again["recording_sha256"] == first["recording_sha256"]
    assert again.get("locked_sha256") == first.get("locked_sha256")
    assert again["commitment"] != first["commitment"]  # another salt
    assert sealed["truth"] == read_truth(sealed_folder(made), read_manifest(made))[first["name"]]


def test_a_plan_that_no_draw_can_follow_gives_way_to_the_next_of_its_stratum(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order = Order(str(tmp_path / "a"), str(tmp_path / "b"), 7, CASES, samples=400)
    (tmp_path / "a").mkdir()
    (tmp_path / "b" / "changes").mkdir(parents=True)
    number, first = next((number, plan) for number, plan in enumerate(order.plans) if plan.stratum == "one")
    tried: list[Plan] = []

    def alike(name: str, plan: Plan, *rest: object) -> Case:
        tried.append(plan)
        if len(tried) == 1:
            raise RigError("the effects are too much alike")
        return make_case(name, plan, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr("validation.blind.make.make_case", alike)
    _, sealed = _make_one(order, number)
    assert tried[0] == first
    assert [plan.stratum for plan in tried] == ["one", "one"]
    assert sealed["truth"]["causes"][0]["name"] == tried[1].names[0]  # type: ignore[index]


def test_a_truth_that_was_not_sealed_is_refused(made: Path, tmp_path: Path) -> None:
    document = json.loads((sealed_folder(made) / "truth.json").read_text())
    name = next(iter(document["cases"]))
    document["cases"][name]["truth"]["wanted"] = [1.0]
    (tmp_path / "truth.json").write_text(json.dumps(document))
    with pytest.raises(RigError, match="not what the set was sealed with"):
        read_truth(tmp_path, read_manifest(made))
    with pytest.raises(RigError, match="the sealed folder"):
        read_truth(tmp_path / "none", read_manifest(made))
    assert commitment("a", {"x": 1}) != commitment("b", {"x": 1})


def test_truth_goes_through_json_unchanged(made: Path) -> None:
    for document in read_truth(sealed_folder(made), read_manifest(made)).values():
        truth = Truth.from_json(document)
        assert json.loads(json.dumps(truth.to_json())) == document


def test_solving_scoring_and_the_page(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a judge that always says backlash: solving picks up where it was left; a page comes out."""
    folder = tmp_path / "set"
    shutil.copytree(made, folder)
    sealed = sealed_folder(folder)
    shutil.copytree(sealed_folder(made), sealed)
    asked: list[tuple[str, ...]] = []

    def judge_all(run: Path, locked: Path | None, without: tuple[str, ...], arm: object) -> Stub:
        asked.append(without)
        if run.stem == "case001":
            raise RigError("no")
        if run.stem == "case003":
            raise ZeroDivisionError("a fault")
        return stub(run.stem, "named", ("backlash", "joint5"))

    monkeypatch.setattr(estimators.gap, "diagnose", judge_all)
    silent = dict.fromkeys(BASELINES, answer("no-gap"))
    monkeypatch.setattr(scoring, "baseline_answers", lambda recording, locked: silent)  # they take seconds a case
    hidden = sealed.rename(tmp_path / "hidden")  # solving does without it
    assert solve_set(folder, HERE) == CASES
    assert Answers(folder / ANSWERS).read("case001")["verdict"] == "refused"
    failed = Answers(folder / ANSWERS).read("case003")
    assert failed["verdict"] == "failed"
    assert failed["why"].startswith("ZeroDivisionError: a fault (test_blind.py, line ")
    (folder / ANSWERS / "case002.diagnosis.json").unlink()
    assert solve_set(folder, HERE) == 1
    assert set(asked) == {()}
    scores = score_set(folder, hidden, HERE)
    assert set(asked[CASES + 1 :]) == {
        (withheld_effect(score.truth),) for score in scores if withheld_effect(score.truth)
    }
    for score in scores:
        if score.answer["verdict"] in ("refused", "failed"):
            assert score.scores.mass == 0.0
            assert not is_right(score)
            continue
        right = ("backlash", "joint5") in {label for cause in score.truth.visible for label in cause.right}
        assert score.outcome.first == float(right)
        assert not (score.truth.stratum == "none" and is_right(score))
        if score.closure.left is not None:
            assert score.closure.left == pytest.approx(1.0)  # a cause of no strength closes nothing
            assert score.closure.closed_error is None or score.closure.closed_holds is False
    text = page(scores, read_order(hidden), "0" * 64, "blind.png")
    assert "cases are not what their stratum asks for" in text
    for heading in ("Probability on the truth", "Are the probabilities right?", "By laboratory", "Effect by effect"):
        assert f"### {heading}" in text
    for score in scores:
        assert (f"- {score.truth.case}," in text) == (not is_right(score))
    assert len(summary(scores)) == CASES
    write_report(tmp_path / "page.md", scores, read_order(hidden), "0" * 64)
    assert (tmp_path / "page.png").stat().st_size > 10_000
    changed = folder / "case003.parquet"
    changed.write_bytes((folder / "case004.parquet").read_bytes())
    with pytest.raises(RigError, match="changed since it was sealed"):
        score_set(folder, hidden, HERE)


def test_the_simple_judges_see_a_strong_effect() -> None:
    """A cube fifty standard deviations strong: stepwise selection names it first, raw correlation sees that there is
    something. In noise alone raw correlation stays silent, as some thousand correlations beyond five standard
    deviations are a matter of 0.2 %; stepwise selection does not, which the check is there to show."""
    setting = draw_setting(scenarios.load("ann-arbor"), 600, np.random.default_rng(8))
    effect = make_effect("scale_cubic", {"where": "accel2", "fraction_of_full": 0.3})
    assert signal_to_noise((effect,), setting) > 50.0
    rng = np.random.default_rng(9)
    run, quiet = setting.record((effect,), rng, "run"), setting.record((), rng, "quiet")
    rest = setting.record_locked(rng, "rest")
    assert BASELINES["always none"](run, rest)["verdict"] == "no-gap"
    first = BASELINES["stepwise BIC"](run, rest)["causes"][0]
    assert (first["effect"], first["where"]) == ("scale_cubic", "accel2")
    assert BASELINES["largest raw correlation"](run, rest)["verdict"] == "named"
    assert BASELINES["largest raw correlation"](quiet, rest)["verdict"] == "no-gap"


def test_two_versions_of_the_diagnosis_are_not_mixed(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Answers(tmp_path).begin()
    Answers(tmp_path).begin()
    monkeypatch.setattr(answers, "sources_hash", lambda: "another")
    with pytest.raises(RigError, match="another version"):
        Answers(tmp_path).begin()


@pytest.mark.parametrize(
    ("hits", "count", "low", "high"), [(10, 10, 0.7225, 1.0), (0, 10, 0.0, 0.2775), (5, 10, 0.2366, 0.7634)]
)
def test_wilson_intervals(hits: int, count: int, low: float, high: float) -> None:
    """Against the figures of Brown, Cai and DasGupta's formula worked by hand to four places."""
    assert Rate(hits, count).interval == pytest.approx((low, high), abs=5e-5)
    assert Rate(0, 0).interval == (0.0, 1.0)


def test_ideal_power_is_the_likelihood_ratio_tests() -> None:
    """100,000 draws of a two-column test: the share beyond the threshold is good to 4 standard deviations of 0.0016."""
    rng = np.random.default_rng(2)
    threshold = -2.0 * np.log(1e-3)  # of chi-square with two degrees of freedom, in closed form
    statistic = ((rng.standard_normal((100_000, 2)) + np.array([4.0, 0.0])) ** 2).sum(axis=1)
    assert ideal_power(4.0, 2, 1e-3) == pytest.approx(float(np.mean(statistic > threshold)), abs=0.0064)
    assert ideal_power(half_power(3, 1e-4), 3, 1e-4) == pytest.approx(0.5, abs=1e-9)
    assert crossing([4.0, 5.0, 6.0, 7.0], [0.0, 0.0, 1.0, 1.0]) == pytest.approx(5.5, abs=0.05)
    assert np.isnan(crossing([4.0, 5.0], [1.0, 1.0]))


def test_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _app.run(["blind", "solve", str(tmp_path / "nowhere")]) == 2
    assert "rig blind make" in capsys.readouterr().err
    assert _app.run(["blind", "score", str(tmp_path), "-o", "page.txt"]) == 2
    assert _app.run(["blind", "make", str(tmp_path / "set"), "--cases", "15"]) == 2
