"""``rig check``: what a file of each kind holds, and what looks wrong in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import SMALL, Rig
from diagnosed_recordings import by_hand
from scipy.spatial.transform import Rotation

from rig.assets import model_path
from rig.recording import Recording, read_recording
from rig.recording.findings import degrees_words
from scenarios.importing.mapping import Mapping

CAUSE = '[[effects.backlash]]\nwhere = "joint5"\nwidth_rad = 0.01\n'


def test_what_a_file_holds(rig: Rig, swept: Path) -> None:
    Path("faulty.toml").write_text(SMALL + CAUSE)
    Path("map.toml").write_text(Mapping({"Acc X": "accel1_g", "time": "t"}).to_toml())
    Path("prior.toml").write_text("[effects]\nbacklash = 5\noutliers = 0\n")
    by_hand().write("found.json")
    rig.done("calibrate", "run.parquet", "-o", "cal.json")
    for name, words in {
        "faulty.toml": ("scenario", "torus-sweep", "backlash at joint5"),
        "map.toml": ("mapping", "Acc X"),
        "prior.toml": ("prior", "backlash 5; outliers 0"),
        "found.json": ("diagnosis", "named"),
        "cal.json": ("calibration", "accelerometer, magnetometer"),
        "run.parquet": ("recording", "600"),
    }.items():
        text = rig.done("check", name)
        assert all(word in text for word in words), text


def later(run: Recording) -> Recording:
    return replace(run, t=run.t + 60.0 * (np.arange(len(run)) > 99))


def too_fast(run: Recording) -> Recording:
    return replace(run, metadata=replace(run.metadata, rate_Hz=2.0 * run.rate_Hz))


def in_degrees(run: Recording) -> Recording:
    return replace(run, q=np.degrees(run.q))


def test_a_long_sweep_is_as_it_should_be(rig: Rig, here: Path) -> None:
    """Joint 6 makes 64 turns."""
    rig.done("sweep", "ann-arbor", "-o", "run.parquet", "--locked")
    run = read_recording("run.parquet")
    assert run.q is not None
    assert np.ptp(run.q[:, 5]) > 100.0 * np.pi
    assert "!" not in rig.done("check", "run.parquet")


@pytest.mark.parametrize("swing", [0.3, 2.0, 20.0])
@pytest.mark.parametrize("seed", range(2))
def test_any_course_of_six_joints_tells_degrees_from_radians(swing: float, seed: int) -> None:
    """All joints swing at random: neither far nor fast, and on an arm that the test alone knows."""
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(3000)
    q = swing * np.sin(np.outer(t, rng.uniform(0.02, 0.3, 6)) + rng.uniform(0.0, 2.0 * np.pi, 6))
    R = Rotation.identity(len(t))
    for axis, angle in zip(Rotation.random(6, rng=rng).apply([0.0, 0.0, 1.0]), q.T, strict=True):
        R *= Rotation.from_rotvec(angle[:, None] * axis)
    readings = 2.5 + 1.4 * R.inv().apply([0.0, 0.0, -1.0]) + 0.013 * rng.standard_normal((len(t), 3))
    run = Recording(t=t, q=q, accelerometer=readings, units={"accelerometer": "V"})
    assert degrees_words(run) == ""
    assert "degrees" in degrees_words(in_degrees(run))


@pytest.mark.parametrize("seed", range(3))
def test_readings_that_do_not_follow_the_joints_tell_nothing(seed: int) -> None:
    """Joint 1 turns about gravity while the sensor warms up; and two poses are held."""
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(3000)
    noise = 0.013 * rng.standard_normal((len(t), 3))
    tiny = 1e-200 * noise
    around = np.outer(t, [0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
    warm = np.outer(np.exp(-t / 100.0), [0.1, 0.1, -0.1])
    held = (t[:, None] > 100.0) * rng.uniform(-1.0, 1.0, 6)
    for q, readings in ((around, warm + noise), (around, tiny), (held, 3.0 * (t[:, None] > 100.0) + noise)):
        run = Recording(t=t, q=q, accelerometer=readings, units={"accelerometer": "V"})
        assert degrees_words(run) == ""
        assert degrees_words(in_degrees(run)) == ""
        assert degrees_words(run.select(slice(20))) == ""
        assert degrees_words(replace(run, accelerometer=np.zeros_like(readings))) == ""


def in_g(run: Recording) -> Recording:
    assert run.accelerometer is not None
    return replace(run, accelerometer=9.8 * run.accelerometer, units={**run.units, "accelerometer": "g"})


def of_another_arm(run: Recording) -> Recording:
    return replace(run, metadata=replace(run.metadata, arm="heron"))


def test_whose_model_will_be_asked_for(rig: Rig, swept: Path) -> None:
    """Of another arm than the one that comes with the rig, unless its model is given: that is no defect of the file."""
    of_another_arm(read_recording("run.parquet")).write("other.parquet")
    words = "arm_model that of heron is not built in: calibrate and diagnose need it (--arm FILE)"
    assert words in " ".join(rig.done("check", "other.parquet").split())
    assert "built in" not in rig.done("check", "other.parquet", "--arm", str(model_path("a465/a465.urdf")))
    assert "built in" not in rig.done("check", "run.parquet")


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (later, "a gap of 60.1 s after row 99; the median step is 0.1 s"),
        (too_fast, "rate_Hz says 20, the times say 10"),
        (in_degrees, "times as closely if their angles are degrees: under the name of radians?"),
        (in_g, "g, expected 0.5 to 2: its unit?"),
    ],
)
def test_what_looks_wrong(rig: Rig, swept: Path, wrong: Callable[[Recording], Recording], words: str) -> None:
    wrong(read_recording("run.parquet")).write("wrong.parquet")
    assert words in " ".join(rig.not_good("check", "wrong.parquet").split())
