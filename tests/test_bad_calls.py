"""Calls that make no sense through the command line: one line on stderr, exit status 2, nothing written."""

from __future__ import annotations

import codecs
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import SMALL, Rig

import estimators
from rig.effects import EFFECTS
from rig.errors import RigError
from rig.recording import read_recording
from scenarios.causes import read_causes
from scenarios.loader import from_toml, load


@pytest.fixture
def here(here: Path) -> Path:
    """The same with a recording."""
    from_toml(SMALL, "small.toml").simulate(0).write("run.csv")
    return here


@pytest.mark.parametrize("again", ["run.csv", "./run.csv", "link.csv"])
@pytest.mark.parametrize(
    "command",
    [
        ("import", "-o", "out.parquet"),
        ("calibrate", "-o", "out.json"),
        ("diagnose", "--together", "--out", "out"),
    ],
    ids=lambda command: command[0],
)
def test_a_file_is_not_taken_twice(here: Path, rig: Rig, command: tuple[str, ...], again: str) -> None:
    Path("link.csv").symlink_to("run.csv")
    line = rig.refused(*command, "run.csv", again)
    assert line.startswith(f"rig: {Path(again)}: is ")
    assert line.endswith("expected each once")
    assert not list(here.glob("out*"))


#: Every command that writes, up to the name of what it writes.
WRITERS = {
    "demo": ("demo", "-o", "out/"),
    "sweep": ("sweep", "small.toml", "-o", "out/run.parquet"),
    "import": ("import", "run.csv", "-o", "out/run.parquet"),
    "import, its mapping": ("import", "run.csv", "--map", "out/map.toml"),
    "calibrate": ("calibrate", "run.csv", "-o", "out/cal.json"),
    "calibrate, its picture": ("calibrate", "run.csv", "--coverage", "out/seen.png"),
    "apply": ("apply", "cal.json", "run.csv", "-o", "out/run.csv"),
    "compare": ("compare", "cal.json", "cal.json", "-o", "out/errors.png"),
    "view": ("view", "run.csv", "-o", "out/run.rrd"),
    "effects": ("effects", "backlash", "-o", "out/backlash.png"),
    "diagnose": ("diagnose", "run.csv", "--out", "out/"),
    "diagnose, its rig": ("diagnose", "run.csv", "--save-scenario", "out/rig.toml"),
    "bound": ("bound", "small.toml", "-o", "out/bound.png"),
    "plan": ("plan", "--seconds", "60", "-o", "out/plan.toml"),
    "plan, its path": ("plan", "--seconds", "60", "-o", "plan.toml", "--csv", "out/plan.csv"),
    "noise": ("noise", "run.csv", "-o", "out/noise.png"),
    "live": ("live", "run.csv", "-o", "out/run.parquet"),
    "live, its calibration": ("live", "run.csv", "-o", "live.parquet", "--cal", "out/cal.json"),
    "export": ("export", "cal.json", "--to", "c", "-o", "out/cal.h"),
    "study consistency": ("study", "consistency", "small.toml", "-o", "out/"),
    "study subsets": ("study", "subsets", "run.csv", "-o", "out/"),
}


@pytest.mark.parametrize("call", WRITERS.values(), ids=WRITERS)
def test_a_folder_that_may_only_be_read(
    here: Path, rig: Rig, monkeypatch: pytest.MonkeyPatch, call: tuple[str, ...]
) -> None:
    """Said before any work, of which the standard output would tell."""
    Path("out").mkdir()
    access = os.access
    monkeypatch.setattr(
        os, "access", lambda path, mode: access(path, mode) and (Path(path).name, mode) != ("out", os.W_OK)
    )
    line = rig.refused(*call)
    assert line.startswith(f"rig: {call[-1].rstrip('/')}")
    assert "out cannot be written to" in line
    assert not list(Path("out").iterdir())


@pytest.mark.parametrize("call", WRITERS.values(), ids=WRITERS)
def test_a_file_is_no_folder_to_write_to(here: Path, rig: Rig, call: tuple[str, ...]) -> None:
    Path("out").write_text("a file")
    line = rig.refused(*call)
    assert line.startswith(f"rig: {call[-1].rstrip('/')}: ")
    assert Path("out").read_text() == "a file"


@pytest.mark.parametrize("text", ['{"a": 1, "b": {"c": 2, "c": 2}}', '[{"c": 1, "d": 2, "c": 3}]'])
def test_a_key_that_is_there_twice_is_no_choice_of_ours(rig: Rig, here: Path, text: str) -> None:
    Path("twice.json").write_text(text)
    line = rig.refused("export", "twice.json", "--to", "c")
    assert line == "rig: twice.json: key 'c' occurs twice in one object, expected once"


def test_a_byte_order_mark_is_no_part_of_a_text(rig: Rig, here: Path) -> None:
    Path("marked.toml").write_bytes(codecs.BOM_UTF8 + SMALL.encode())
    assert "600 samples" in rig.done("sweep", "marked.toml", "-o", "out.csv")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (SMALL.encode("utf-16"), "is UTF-16 text, expected a CSV file in UTF-8"),
        ("t_s,accel1_\xb5V\n".encode("latin-1"), "not UTF-8 text (byte 11 of a line at its beginning), expected CSV"),
        (b"t_s,accel1_V,accel2_V,accel3_V\n" + 2**21 * b"9", "has a row of more than 524288 bytes, expected numbers"),
    ],
    ids=["UTF-16", "Latin-1", "a row without end"],
)
def test_a_table_of_another_kind(rig: Rig, here: Path, content: bytes, message: str) -> None:
    Path("other.csv").write_bytes(content)
    assert rig.refused("check", "other.csv") == f"rig: other.csv: {message}"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--draws", "1000000000000"), "draws: 1000000000000 with 25 counts, 3e+14 fits: takes 5.46e+04 TiB of memory"),
        (("--counts", "1000000000"), "counts: found 1000000000 from 100 samples, expected two or more, from"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_a_study_that_nobody_could_wait_for(here: Path, rig: Rig, options: tuple[str, ...], message: str) -> None:
    assert message in rig.refused("study", "consistency", "small.toml", "-o", "study", *options)
    assert not Path("study").exists()


def test_a_line_of_json_without_end_is_a_broken_line(here: Path, rig: Rig) -> None:
    good = '{"t_s": %s, "mag1_uT": 1.0, "mag2_uT": 2.0, "mag3_uT": 3.0}'
    deep = '{"t_s": ' + 5000 * "["
    for lines in ([deep], [deep, good % 0, deep, *(good % number for number in range(1, 40))]):
        Path("lines.jsonl").write_text("\n".join(lines) + "\n")
        result = rig("live", "lines.jsonl", "-o", f"{len(lines)}.csv", "--idle", "0.2")
        assert result.status == (2 if len(lines) == 1 else 1)  # 40 equal readings tell nothing
        assert "broken line" in result.err
        assert "bug" not in result.err


def test_no_stream_is_enough_for_an_interval_of_nothing(here: Path, rig: Rig) -> None:
    assert "--to: found '1e-300', expected a share such as 0.1% or 0.001, 1e-09 or more" in rig.refused(
        "live", "run.csv", "-o", "live.parquet", "--to", "1e-300"
    )


def test_a_start_beyond_all_numbers(here: Path, rig: Rig) -> None:
    line = rig.refused("calibrate", "run.csv", "--method", "ellipsoid", "--start", "1e-300,1e300")
    assert line.startswith("rig: run.csv: accelerometer: start: found gain [1.0")


@pytest.mark.parametrize("offset", ["nan", "-inf", "soon"])
def test_an_offset_of_a_clock_is_a_number(here: Path, rig: Rig, offset: str) -> None:
    line = rig.refused("import", "run.csv", "--clock-offset", offset)
    assert line == f"rig: --clock-offset: found '{offset}', expected a number of seconds or auto"


def test_an_arm_without_a_body_suggests_none(here: Path, rig: Rig) -> None:
    Path("none.xml").write_text("<mujoco><worldbody/></mujoco>")
    line = rig.refused("bound", "small.toml", "--arm", "none.xml")
    assert line.endswith("expected --tip NAME, the site or body that carries the sensor")


def test_a_maneuver_without_a_sample(here: Path, rig: Rig) -> None:
    Path("slow.toml").write_text(SMALL.replace("duration_s = 60.0", "duration_s = 60.0\nrate_Hz = 1e-9"))
    line = rig.refused("sweep", "slow.toml", "-o", "out.csv")
    assert line == "rig: scenario slow: duration_s 60 s at rate_Hz 1e-09 Hz: found no sample, expected one or more"


MANY = "1000000000000"


@pytest.mark.parametrize(
    ("command", "most"),
    [
        (("blind", "make", "set", "--cases"), "16<=x<=10000"),
        (("blind", "make", "set", "--mechanics"), "0<=x<=10000"),
        (("blind", "make", "set", "--samples"), "400<=x<=1000000"),
        (("blind", "score", "set", "--power"), "0<=x<=10000"),
        (("study", "loop", "-o", "loop", "--rigs"), "1<=x<=10000"),
        (("study", "loop", "-o", "loop", "--samples"), "400<=x<=1000000"),
        (("study", "subsets", "run.csv", "--subsets"), "2<=x<=100000"),
    ],
    ids=lambda value: value[-1] if isinstance(value, tuple) else "",
)
@pytest.mark.parametrize("count", [MANY, "-1", "nan", "1e12"])
def test_so_many_that_nobody_could_wait(here: Path, rig: Rig, command: tuple[str, ...], most: str, count: str) -> None:
    expected = f"number {most}" if count in (MANY, "-1") else "whole number"
    assert (
        f"{command[-1]}': found {count if count in (MANY, '-1') else repr(count)}, expected a {expected}"
        in rig.refused(*command, count)
    )
    assert sorted(path.name for path in here.iterdir()) == ["run.csv", "small.toml"]


def test_more_subsets_than_samples_ask_for_no_memory(here: Path, rig: Rig) -> None:
    line = rig.refused("study", "subsets", "run.csv", "--subsets", "100000")
    assert line == "rig: run: found 600 samples, expected at least 24 for each of 100000 subsets"


def test_the_help_of_a_number_without_bounds_names_none(rig: Rig) -> None:
    assert "None" not in rig.done("plan", "--help")


def test_an_effect_on_a_sensor_that_is_not_there_is_refused_wherever_it_comes_from(here: Path, rig: Rig) -> None:
    text = SMALL[: SMALL.index("[magnetometer]")]
    Path("accelerometer.toml").write_text(text)
    Path("cause.json").write_text('{"effect": "sensor_lag", "where": "magnetometer"}')
    Path("effect.toml").write_text(f'{text}[effects.sensor_lag]\nwhere = "magnetometer"\n')
    said = "effect sensor_lag at magnetometer: the rig has no magnetometer, expected an effect on its accelerometer"
    line = rig.refused("sweep", "accelerometer.toml", "-o", "out.csv", "--with", "cause.json")
    assert line == f"rig: cause.json: cause 1: {said}"
    assert rig.refused("bound", "effect.toml") == f"rig: effect.toml: [effects.sensor_lag] {said}"
    with pytest.raises(RigError, match="the rig has no magnetometer"):
        load("accelerometer.toml").with_effects(read_causes("cause.json"))


def test_what_chose_the_causes_cannot_judge_them(here: Path, rig: Rig) -> None:
    Path("link.csv").symlink_to("run.csv")
    for again in ("run.csv", "link.csv"):
        line = rig.refused("diagnose", "run.csv", "--maneuver2", again, "--out", "out")
        assert line.startswith(f"rig: {again}: is ")
        assert line.endswith("expected each once")


@pytest.mark.parametrize("minutes", ["1e9", "nan", "0"])
def test_a_next_maneuver_of_years_is_refused_before_the_diagnosis(here: Path, rig: Rig, minutes: str) -> None:
    assert "'--minutes': found" in rig.refused("diagnose", "run.csv", "--minutes", minutes, "--out", "out")
    assert not Path("out").exists()


def test_an_empty_list_of_causes_is_no_cause(here: Path, rig: Rig) -> None:
    Path("none.json").write_text("[]")
    line = rig.refused("sweep", "small.toml", "-o", "out.csv", "--with", "none.json")
    assert line == "rig: none.json: found an empty list, expected one cause or more"


def test_metadata_and_no_columns(here: Path, rig: Rig) -> None:
    Path("none.csv").write_text(Path("run.csv").read_text().splitlines()[0] + "\n")
    assert rig.refused("check", "none.csv").startswith("rig: none.csv: found no line of columns, none of a recording")


def test_a_base_that_leans_by_more_than_a_turn(here: Path, rig: Rig) -> None:
    Path("lean.toml").write_text(SMALL.replace("base_tilt_deg = 3.0", "base_tilt_deg = 1e9"))
    line = rig.refused("bound", "lean.toml")
    assert line == "rig: lean.toml: [environment.earth] base_tilt_deg: found 1e+09, expected -360 to 360"


def test_a_check_tells_of_stuck_readings_and_of_temperatures_that_cannot_be(here: Path, rig: Rig) -> None:
    assert not {"stuck", "temperature_degC goes"} & set(rig.done("check", "run.csv").split())
    run = read_recording("run.csv")
    readings = run.accelerometer.copy()  # type: ignore[union-attr]
    readings[100:160] = readings[100]
    replace(run, accelerometer=readings, temperature=np.full(len(run), -400.0)).write("stuck.csv")
    text = " ".join(rig("check", "stuck.csv").out.split())
    assert "accelerometer: 60 readings in a row are the same, from row 100 on (first row 0): stuck?" in text
    assert "temperature_degC goes from -400 to -400, expected -100 to 300" in text
    told = estimators.diagnose("stuck.csv", without=[name for name in EFFECTS if name != "backlash"])
    assert "accelerometer: 60 readings in a row are the same, from row 100 on (first row 0): stuck?" in told.warnings


@pytest.mark.parametrize("option", ["--alarms", "--learn"])
def test_what_watches_a_calibration_needs_one(here: Path, rig: Rig, option: str) -> None:
    line = rig.refused("live", "run.csv", "-o", "live.parquet", option, "5")
    assert line == f"rig: {option}: found without --calibration, expected the calibration to watch"


def test_what_would_be_passed_over_is_refused(here: Path, rig: Rig) -> None:
    line = rig.refused("bound", "small.toml", "--effects", "--method", "separate")
    assert line == "rig: --method: found with --effects, which asks for no parameters, expected one of them"
    line = rig.refused("import", "run.csv", "-o", "again.csv", "--base-frame", "table")
    assert line == "rig: run.csv: no bag, expected one with the transforms of base_frame and tool_frame"
    Path("few.toml").write_text(SMALL.replace("decimation = 10", "decimation = 10_000_000"))
    assert "acquisition.decimation: found 10000000, expected less than the maneuver's" in rig.refused(
        "sweep", "few.toml", "-o", "few.csv"
    )
