"""``rig live`` and ``rig replay`` as a user calls them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import Rig

import estimators
import scenarios
from estimators.live import Options
from rig.recording import Recording, read_recording
from rig.stream import Feed, open_source
from scenarios.live.finish import calibrated
from scenarios.live.session import Plan, Session

RIG = [sys.executable, "-m", "scenarios.cli"]
#: ``rig live`` on standard input, which ends with the recording.
WAIT_S = 60.0


@pytest.fixture
def here(here: Path) -> Path:
    """The same with a recording."""
    scenarios.load("./small.toml").simulate(seed=0).write("run.csv")
    return here


def test_a_streams_sensitivity_is_in_the_unit_of_its_field(here: Path, rig: Rig) -> None:
    scenario = replace(scenarios.load("./small.toml"), magnetic_field_unit="uT")
    scenario.simulate(seed=0).write("run.csv")
    assert "S [V/µT]" in rig("live", "run.csv", "-o", "live.parquet", "--keep-going", "--idle", "0.2").out


def by_hand(seconds: float = 120.0) -> Recording:
    """A magnetometer turned slowly through all directions at 50 Hz, in microtesla."""
    rng = np.random.default_rng(0)
    t = 0.02 * np.arange(round(50.0 * seconds))
    quaternion = np.stack([np.cos(0.11 * k * t + k) + np.sin(0.07 * t * (k + 1)) for k in range(1, 5)], axis=1)
    quaternion /= np.linalg.norm(quaternion, axis=1)[:, None]
    w, x, y, z = quaternion.T
    down = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z], axis=1)
    readings = 48.0 * down @ np.diag([1.02, 0.99, 1.0]) + [5.0, -8.0, 3.0] + 0.1 * rng.standard_normal((len(t), 3))
    return Recording(t=t, magnetometer=readings, units={"magnetometer": "uT"})


def test_a_recording_replayed_is_the_recording(here: Path, rig: Rig) -> None:
    text = rig.done("replay", "run.csv", "--speed", "max")
    (here / "copy.csv").write_text(text)
    assert np.array_equal(read_recording("copy.csv").accelerometer, read_recording("run.csv").accelerometer)
    lines = rig.done("replay", "run.csv", "--speed", "max", "--json", "--without-pose", "--until", "5").splitlines()
    assert json.loads(lines[0])["rig"]["format"] == "rig-recording/1"
    assert set(json.loads(lines[1])) == {
        *("t_s", "temperature_degC"),
        *(f"{sensor}{k}_V" for sensor in ("accel", "mag") for k in (1, 2, 3)),
    }


def test_a_stream_becomes_a_recording_and_the_calibration_that_is_made_offline(here: Path, rig: Rig) -> None:
    result = rig("live", "run.csv", "-o", "live.parquet", "--keep-going", "--idle", "0.2", "--json")
    document = json.loads(result.out)
    assert result.status == 0
    assert document["samples"] == 600
    assert not (here / "live.csv").exists()
    offline = estimators.calibrate("live.parquet", noise="residuals")
    found = estimators.Calibration.read("live.calibration.json")
    for sensor in ("accelerometer", "magnetometer"):
        assert np.array_equal(found[sensor].values, offline[sensor].values)
        assert found[sensor].quality.verdict is not None


@pytest.mark.parametrize("posed", [True, False])
def test_a_sliding_window_ends_with_what_it_showed(here: Path, posed: bool) -> None:
    """The calibration written is that of the same samples as the last estimate."""
    if not posed:
        by_hand().write("run.csv")
    options = Options(forget_s=30.0 if posed else 100.0)
    session = Session(Feed(open_source("run.csv")), here / "live.csv", Plan(options, stop=False, idle_s=0.2), [])
    session.run()
    made = session.close()
    assert made is not None
    written, _ = calibrated(made, options, None, [], session.forgotten_s)
    for state in session.states:
        shown, own = state.estimate, written[state.sensor]
        assert shown is not None
        assert shown.samples == own.samples < session.samples
        # with a pose sums in another order, some 1e-14 of themselves times a condition below 1e3
        np.testing.assert_allclose(shown.values, own.values, rtol=1e-9 if posed else 0.0, atol=1e-9 if posed else 0.0)


def test_poses_of_a_slower_source_are_told_of(here: Path, rig: Rig) -> None:
    """Each stands for five samples: straight lines are put between, as they come and in the calibration."""
    run = read_recording("run.csv")
    assert run.q is not None
    replace(run, q=run.q[np.arange(len(run)) // 5 * 5]).write("held.csv")
    words = "each pose is repeated in 5 rows, throughout, while the readings go on: straight lines are put between them"
    for name, told in (("run", False), ("held", True)):
        found = rig("live", f"{name}.csv", "-o", f"{name}-live.parquet", "--keep-going", "--idle", "0.2")
        assert (words in " ".join(f"{found.out} {found.err}".split())) is told
        warnings = estimators.Calibration.read(f"{name}-live.calibration.json")["accelerometer"].quality.warnings
        assert any("straight lines were put between them" in each for each in warnings) is told


def test_it_stops_when_it_is_enough(here: Path, rig: Rig) -> None:
    run = by_hand()
    run.write("hand.csv")
    assert rig("live", "hand.csv", "-o", "live.csv", "--field", "48", "--idle", "0.2", "--to", "0.2%").status == 0
    found = read_recording("live.csv")
    assert len(found) < len(run)
    own = estimators.Calibration.read("live.calibration.json")["magnetometer"]
    # five sigma of three offsets, in one of half a million runs further off
    assert (np.abs(own.bias - [5.0, -8.0, 3.0]) < 5.0 * np.array([own.std(f"offset{k}") for k in (1, 2, 3)])).all()


def test_a_sensor_that_is_refused_does_not_keep_the_other_from_its_calibration(here: Path, rig: Rig) -> None:
    run = read_recording("run.csv")
    still = np.full((len(run), 3), 2.5) + 1e-4 * np.random.default_rng(0).standard_normal((len(run), 3))
    replace(run, magnetometer=still).write("deaf.csv")
    result = rig("live", "deaf.csv", "-o", "live.parquet", "--keep-going", "--idle", "0.2")
    assert result.status == 1
    assert "magnetometer" in result.err
    found = estimators.Calibration.read("live.calibration.json")
    assert tuple(found.sensors) == ("accelerometer",)


def test_what_is_not_enough_ends_with_status_one(here: Path, rig: Rig) -> None:
    result = rig("live", "run.csv", "-o", "live.parquet", "--idle", "0.2", "--to", "0.001%")
    assert result.status == 1
    assert "not enough" in result.out
    assert (here / "live.calibration.json").exists()


def test_what_cannot_be_told_is_recorded_and_refused(here: Path, rig: Rig) -> None:
    by_hand(2.0).write("hand.csv")
    result = rig("live", "hand.csv", "-o", "live.parquet", "--idle", "0.2")
    assert result.status == 1
    assert "is recorded, but" in result.err.splitlines()[-1]
    assert len(read_recording("live.parquet")) == 100


def test_a_change_under_a_calibration_is_an_alarm_and_no_calibration_of_it_is_good(here: Path, rig: Rig) -> None:
    run = by_hand()
    run.write("hand.csv")
    good = rig("live", "hand.csv", "-o", "good.parquet", "--field", "48", "--idle", "0.2", "--keep-going")
    assert good.status == 0, good.out + good.err
    assert run.magnetometer is not None
    magnet = np.where(((run.t > 60.0) & (run.t < 80.0))[:, None], [3.0, -2.0, 4.0], 0.0)
    Recording(t=run.t, magnetometer=run.magnetometer + magnet, units=run.units).write("magnet.csv")
    result = rig(
        *("live", "magnet.csv", "-o", "w.parquet", "--calibration", "good.calibration.json"),
        *("--idle", "0.2", "--json"),
    )
    assert result.status == 1
    (alarm,) = json.loads(result.out)["alarms"]
    assert 60.0 <= alarm["t_s"] <= 62.0
    assert {"effect": "bias_step", "where": "mag1-3"} in alarm["looks_like"]
    result = rig("live", "magnet.csv", "-o", "c.parquet", "--field", "48", "--idle", "0.2", "--keep-going", "--json")
    assert result.status == 1
    verdict = json.loads(result.out)["sensors"]["magnetometer"]["quality"]["verdict"]
    assert verdict["good"] is False
    assert any("monitor saw a change" in reason for reason in verdict["reasons"])


def streaming(here: Path, *more: str) -> tuple[subprocess.Popen[bytes], subprocess.Popen[bytes]]:
    """A replay at 20 times its pace into ``rig live``."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    sender = subprocess.Popen(
        [*RIG, "replay", "run.csv", "--speed", "20"], cwd=here, stdout=subprocess.PIPE, env=environment
    )
    quiet = subprocess.DEVNULL
    command = [*RIG, "live", "-", "-o", "live.parquet", "--keep-going", *more]
    receiver = subprocess.Popen(command, cwd=here, stdin=sender.stdout, stdout=quiet, stderr=quiet, env=environment)
    assert sender.stdout is not None
    sender.stdout.close()
    return sender, receiver


def wait_for(path: Path, size: int) -> None:
    until = time.monotonic() + WAIT_S
    while not path.exists() or path.stat().st_size < size:
        assert time.monotonic() < until, f"{path} did not grow"
        time.sleep(0.02)


def test_a_killed_session_loses_nothing_it_has_written_and_goes_on(here: Path, rig: Rig) -> None:
    sender, receiver = streaming(here)
    try:
        wait_for(here / "live.csv", 20_000)
        receiver.kill()
    finally:
        receiver.wait(WAIT_S)
        sender.kill()
        sender.wait(WAIT_S)
    before = read_recording("live.csv")
    run = read_recording("run.csv")
    assert np.array_equal(before.t, run.t[: len(before)])
    assert "--resume" in rig.refused("live", "run.csv", "-o", "live.parquet")
    run.select(run.t > before.t[-1]).write("rest.csv")
    result = rig("live", "rest.csv", "-o", "live.parquet", "--resume", "--keep-going", "--idle", "0.2")
    assert f"resumed with {len(before)} samples" in result.err
    assert np.array_equal(read_recording("live.parquet").accelerometer, run.accelerometer)


def test_an_interrupted_session_ends_in_order(here: Path) -> None:
    sender, receiver = streaming(here)
    try:
        wait_for(here / "live.csv", 20_000)
        receiver.send_signal(signal.SIGINT)
        status = receiver.wait(WAIT_S)
    finally:
        sender.kill()
        sender.wait(WAIT_S)
    assert status in (0, 1)
    assert not (here / "live.csv").exists()
    assert len(read_recording(here / "live.parquet")) > 50


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("live", "nowhere.csv"), "nowhere.csv"),
        (("live", "run.csv", "-o", "live.txt"), ".parquet or .csv"),
        (("live", "run.csv", "-o", "l.parquet", "--to", "wide"), "--to"),
        (("live", "run.csv", "-o", "l.parquet", "--guide", "three-turn"), "three-turns"),
        (("live", "run.csv", "-o", "l.parquet", "--rate", "-5"), "--rate"),
        (("live", "run.csv", "-o", "l.parquet", "--resume"), "l.csv"),
        (("live", "run.csv", "-o", "l.parquet", "--calibration", "none.json"), "none.json"),
        (("live", "run.csv", "-o", "run.parquet"), "--resume"),
        (("live", "tcp:x", "-o", "l.parquet"), "port"),
        (("replay", "run.csv", "--speed", "fast"), "--speed"),
        (("replay", "run.csv", "--to", "5555"), "connect:PORT"),
        (("replay", "none.csv"), "none.csv"),
    ],
)
def test_wrong_calls_are_a_line_and_leave_nothing(
    here: Path, rig: Rig, arguments: tuple[str, ...], message: str
) -> None:
    before = sorted(path.name for path in here.iterdir())
    line = rig.refused(*arguments)
    assert message in line
    assert len(line) < 300
    assert sorted(path.name for path in here.iterdir()) == before


@pytest.mark.parametrize(
    ("content", "found"),
    [
        ("", "nothing"),
        ("\n\n# a comment\n", "nothing"),
        ("t_s,mag1_uT,mag2_uT,mag3_uT\n", "the names of columns and no reading"),
        ("t_s,mag1_uT,mag2_uT,mag3_uT\n0,a,b,c\n", "1 broken line and no reading"),
    ],
)
def test_a_file_without_a_reading_says_what_it_has(here: Path, rig: Rig, content: str, found: str) -> None:
    (here / "empty.csv").write_text(content)
    before = sorted(path.name for path in here.iterdir())
    result = rig("live", "empty.csv", "--idle", "0.2")
    assert result.status == 2
    line = f"rig: empty.csv: found {found}, expected readings under the names of their columns"
    assert result.err.splitlines()[-1] == line
    assert sorted(path.name for path in here.iterdir()) == before


@pytest.mark.parametrize("form", ["csv", "json"])
def test_a_mapping_says_what_the_columns_are(here: Path, rig: Rig, form: str) -> None:
    run = by_hand(20.0)
    assert run.magnetometer is not None
    table = np.column_stack([1e3 * run.t, 10.0 * run.magnetometer])
    rows = table.tolist()
    names = ("stamp", "mx", "my", "mz")
    if form == "csv":
        text = "\n".join([",".join(names), *(",".join(map(repr, row)) for row in rows)])
    else:
        text = "\n".join(json.dumps(dict(zip(names, row, strict=True))) for row in rows)
    (here / "log.txt").write_text(text + "\n")
    (here / "map.toml").write_text(
        '[columns]\nstamp = "t"\nmx = "mag1_mG"\nmy = "-mag2_mG"\nmz = "mag3_mG"\n'
        '[conventions]\ntime_unit = "ms"\n[metadata]\nmagnetic_field = 0.48\nmagnetic_field_unit = "G"\n'
    )
    rig("live", "log.txt", "--map", "map.toml", "-o", "live.csv", "--idle", "0.2", "--keep-going")
    found = read_recording("live.csv")
    assert found.magnetometer is not None
    np.testing.assert_allclose(found.t, run.t, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.magnetometer, 0.01 * run.magnetometer * [1.0, -1.0, 1.0], rtol=1e-12)
    (here / "map.toml").write_text('[columns]\nstamps = "t"\n[conventions]\ntime_unit = "ms"\n')
    assert "stamp" in rig.refused("live", "log.txt", "--map", "map.toml", "-o", "again.csv")


def test_procedures_are_listed(rig: Rig) -> None:
    rows = json.loads(rig.done("live", "--guide", "list", "--json"))
    assert {row["name"] for row in rows} >= {"three-turns", "four-turns", "faces"}
    assert "angle1-2" in next(row["lacking"] for row in rows if row["name"] == "three-turns")
    assert "three-turns" in rig.done("live", "--guide", "list")


def test_a_field_that_nobody_stated_stays_marked_as_assumed(here: Path, rig: Rig) -> None:
    rig("live", "run.csv", "-o", "live.parquet", "--keep-going", "--idle", "0.2", "--gravity", "9.81")
    metadata = read_recording("live.parquet").metadata
    assert metadata.gravity_m_s2 == 9.81
    assert metadata.assumed == ("magnetic_field",)


def test_samples_without_a_time_are_evenly_timed_by_a_stated_rate(here: Path, rig: Rig) -> None:
    head, names, *rows = Path("run.csv").read_text().splitlines()
    assert names.startswith("t_s,")
    bare = head.replace('"rate_Hz": 10.0, ', "")
    Path("bare.csv").write_text("\n".join([bare, *(row.partition(",")[2] for row in (names, *rows))]) + "\n")
    live = ("live", "bare.csv", "-o", "live.csv", "--idle", "0.2")
    assert "column 't_s' is missing, expected it or, for evenly timed samples, --rate" in rig.refused(*live)
    rig(*live, "--rate", "10")
    np.testing.assert_allclose(read_recording("live.csv").t, np.arange(len(rows)) / 10.0, atol=1e-9)
