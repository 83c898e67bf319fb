"""Every JSON format has a schema that is made from the code, is not stale, and that real outputs keep to."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from cli_support import Rig
from jsonschema import Draft202012Validator
from jsonschema.exceptions import ValidationError

import estimators
import scenarios
from documenting.schemas import schemas, text_of
from estimators.calibration.export import export
from estimators.noise.study import study_noise
from rig.effects import make_effect
from rig.maneuver import LockedPoses, TorusSweep
from scenarios.bound import bound_of
from scenarios.diagnosing.fleet import Entry, fleet_json
from scenarios.diagnosing.task import About
from scenarios.isolability import isolability_of
from scenarios.plan import poses
from scenarios.plan.plan import make_plan
from scenarios.scenario import Scenario

FOLDER = Path(__file__).parents[1] / "docs" / "schemas"


@pytest.fixture(scope="module")
def short() -> Scenario:
    """Five minutes with a step in one channel, and a short rest."""
    swept = replace(scenarios.load("ann-arbor"), maneuver=TorusSweep(duration_s=300.0, yaw_passes=5, pitch_passes=3))
    swept = replace(swept, locked=LockedPoses(hold_s=20.0, rate_Hz=100.0))
    return swept.with_effects([make_effect("bias_step", {"where": "accel2", "volts": 0.05, "at_s": 150.0})])


@pytest.fixture(scope="module")
def check() -> Callable[[str, Any], None]:
    own = {name: Draft202012Validator(schema) for name, schema in schemas().items()}

    def checked(name: str, document: Any) -> None:
        own[name].validate(json.loads(json.dumps(document, default=str, allow_nan=False)))

    return checked


def test_the_schemas_are_not_stale() -> None:
    written = {path.stem: path.read_text(encoding="utf-8") for path in FOLDER.glob("*.json")}
    made = {name: text_of(schema) for name, schema in schemas().items()}
    assert written == made, "run python -m documenting.schemas docs/schemas"
    for schema in schemas().values():
        Draft202012Validator.check_schema(schema)


def test_the_page_links_them() -> None:
    page = (FOLDER.parent / "formats.md").read_text(encoding="utf-8")
    assert not [name for name in schemas() if f"(schemas/{name}.json)" not in page]


def test_recordings_and_calibrations(short: Scenario, check: Callable[[str, Any], None]) -> None:
    run = short.simulate(seed=1)
    check("recording-metadata", run.metadata.to_json())
    stated = replace(
        run.metadata,
        accelerometer_reads="a-g",
        serial=7,
        pose_rate_Hz=2.0,
        recorded="2026-05-31",
        assumed=["magnetic_field"],
    )
    check("recording-metadata", stated.to_json())
    for method in ("simultaneous", "separate", "ellipsoid"):
        found = estimators.calibrate(run, method=method)
        check("calibration", found.to_json())
        check("export", json.loads(export(found, "json")))
    broken = found.to_json()
    broken["sensors"]["accelerometer"]["bias"] = [1.0, 2.0]
    with pytest.raises(ValidationError):
        check("calibration", broken)


def test_diagnoses(short: Scenario, check: Callable[[str, Any], None]) -> None:
    found = estimators.diagnose(short.simulate(seed=1), locked=short.simulate_locked(seed=1), without=SLOW)
    assert found.causes
    document = found.to_json()
    check("diagnosis", document)
    check("cause", document)
    check("cause", [{"effect": "backlash", "where": "joint5", "parameters": {"width_rad": 0.01}}])
    about = About("a465", None, "2026-05-31")
    check("fleet", fleet_json([Entry("a", found, about), Entry("b", None, None, "torn")]))
    document["causes"][0]["effect"] = "gremlins"
    with pytest.raises(ValidationError):
        check("diagnosis", document)


#: What a test of the file's form does without: the search is not tested here.
SLOW = ("harmonic_drive_error", "link_hard_iron", "link_soft_iron", "motor_current_field", "field_gradient")


def test_noise_bounds_and_plans(
    short: Scenario, check: Callable[[str, Any], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    locked = short.simulate_locked(seed=1)
    check("noise", study_noise(locked).to_json())
    check("noise", estimators.noise_floor(locked).to_json())
    check("bound", bound_of(short).to_json())
    some = isolability_of(short, only=[("backlash", "joint5"), ("joint_scale", "joint1")])
    check("isolability", some.to_json())
    for name, least in (("_CLIMBS", 30), ("_COUNTS", (8,)), ("_CANDIDATES", 40)):
        monkeypatch.setattr(poses, name, least)  # a poor plan has the form of a good one
    plan = make_plan(short, 40.0, seed=1)
    check("plan", replace(plan, told=some.here).to_json())


def told(rig: Rig, *arguments: str | Path) -> Any:
    """What a command prints by --json, whether the answer is good or bad."""
    found = rig(*arguments, "--json")
    assert found.status in (0, 1), found.err
    return json.loads(found.out)


def test_commands(rig: Rig, check: Callable[[str, Any], None], tmp_path: Path, short: Scenario) -> None:
    scenario, run = tmp_path / "short.toml", tmp_path / "run.csv"
    scenario.write_text(short.to_toml())
    short.simulate(seed=1).write(run)
    check("check", told(rig, "check", run))
    check("import", told(rig, "import", run, "-o", tmp_path / "again.parquet"))
    told(rig, "calibrate", run, "-o", tmp_path / "cal.json")
    made = json.loads((tmp_path / "cal.json").read_text())
    check("calibration", made)
    made["sensors"]["accelerometer"]["axes"][0]["offset"] += 1.0
    (tmp_path / "other.json").write_text(json.dumps(made))
    check("compare", told(rig, "compare", tmp_path / "cal.json", scenario))
    check("compare", told(rig, "compare", run, scenario))
    heard = ("live", run, "--idle", "0.2", "--keep-going")
    check("live", told(rig, *heard, "-o", tmp_path / "live.csv"))
    watched = told(rig, *heard, "-o", tmp_path / "watched.csv", "--calibration", tmp_path / "other.json")
    check("live", watched)
    assert watched["alarms"]


def test_the_folders_of_studies(check: Callable[[str, Any], None]) -> None:
    """Those that the documentation keeps: what ``rig study`` has written."""
    built = FOLDER.parent / "_build"  # copies, where the site has been made
    found = {name: sorted(FOLDER.parent.rglob(f"{name}.json")) for name in ("study", "tables")}
    kept = {name: [path for path in paths if built not in path.parents] for name, paths in found.items()}
    kept["study"].remove(FOLDER / "study.json")
    assert all(kept.values())
    for path in kept["study"]:
        check("study", json.loads(path.read_text(encoding="utf-8")))
    for path in kept["tables"]:
        check("study-tables", json.loads(path.read_text(encoding="utf-8")))
