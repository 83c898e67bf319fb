"""Memory has a stated limit: what is larger is thinned with a word about it, averaged, or refused with its numbers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import SMALL, Rig
from diagnosed_recordings import recorded, scenario

import scenarios
from estimators import calibrate
from estimators.gap.data.basefit import fitted_model
from rig.errors import RigError
from rig.memory import VARIABLE, limit_bytes, parsed
from rig.recording import Recording, block_means, scan_recording, whole_or_beginning, whole_or_means

LEAST = str(64 << 20)


@pytest.fixture
def long(tmp_path: Path) -> Path:
    """20,000 samples by a tool whose quaternion changes sign at random."""
    rng = np.random.default_rng(1)
    n = 20_000
    angle = np.linspace(0.0, 6.0, n)
    turns = np.stack([np.cos(angle / 2), np.sin(angle / 2), 0.0 * angle, 0.0 * angle], axis=1)
    turns *= rng.choice([-1.0, 1.0], n)[:, None]
    path = tmp_path / "long.parquet"
    Recording(t=np.arange(n) * 0.01, tool_quaternion=turns, accelerometer=rng.normal(size=(n, 3))).write(path)
    return path


@pytest.mark.parametrize(
    ("text", "size"), [("2G", 2 << 30), ("512MiB", 512 << 20), ("1.5 gb", 3 << 29), ("100000000", 100_000_000)]
)
def test_sizes(text: str, size: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, text)
    assert limit_bytes() == size


@pytest.mark.parametrize("text", ["", "much", "-1G", "1M", "G", "1e9", "9" * 5000])
def test_what_is_no_size(text: str) -> None:
    with pytest.raises(RigError, match=r"--memory: found .*expected a size from 64M on"):
        parsed(text, "--memory")


def test_what_the_machine_has_left_is_halved(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    assert limit_bytes() > 0


def test_a_scenario_is_not_larger_than_memory(rig: Rig, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for duration in ("1e9", "1e50"):
        Path("long.toml").write_text(SMALL.replace("duration_s = 60.0", f"duration_s = {duration}"))
        line = rig.refused("sweep", "long.toml", "-o", "run.parquet")
        assert "samples: takes" in line
        assert "at rate_Hz 100 Hz" in line
    monkeypatch.setenv(VARIABLE, "1G")  # and so put back afterwards
    Path("small.toml").write_text(SMALL.replace("duration_s = 60.0", "duration_s = 6000.0"))
    assert "of memory, expected 64 MiB at most: state more with --memory or RIG_MEMORY," in rig.refused(
        "sweep", "small.toml", "-o", "run.parquet", "--memory", "64M"
    )


@pytest.mark.parametrize("command", [("bound", "long.toml"), ("plan", "--seconds", "1e12", "-o", "plan.toml")])
def test_a_command_without_the_option_names_the_variable(rig: Rig, here: Path, command: tuple[str, ...]) -> None:
    Path("long.toml").write_text(SMALL.replace("duration_s = 60.0", "duration_s = 1e9"))
    rig.refused("sweep", "long.toml", "-o", "run.parquet")  # a command before it that has the option
    line = rig.refused(*command)
    assert "at most: state more with RIG_MEMORY, or ask for less" in line


def test_a_file_is_refused_by_its_row_count(long: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, LEAST)
    monkeypatch.setattr("rig.memory._SMALL", 1 << 10)
    monkeypatch.setattr("rig.recording.recording_files._COPIES", 1 << 10)
    with pytest.raises(RigError, match=r"long.parquet: 20000 rows of 8 columns: takes 1.22 GiB of memory"):
        scan_recording(long).read()


def test_means_over_blocks(long: Path) -> None:
    """Of rotations too, whatever the signs of their quaternions; a batch's end is no block's end."""
    whole = scan_recording(long).read()
    for batch_rows in (999, 65536):
        found = block_means(scan_recording(long, batch_rows), 7)
        assert len(found) == len(whole) // 7
        kept = len(found) * 7
        assert whole.accelerometer is not None
        expected = whole.accelerometer[:kept].reshape(-1, 7, 3).mean(axis=1)
        np.testing.assert_allclose(found.accelerometer, expected, atol=1e-15)
        np.testing.assert_allclose(found.t, whole.t[:kept].reshape(-1, 7).mean(axis=1), atol=1e-12)
        middle = whole.select(slice(3, kept, 7)).rotations(None)
        np.testing.assert_allclose(found.rotations(None), middle, atol=1e-5)  # the angle's step squared, 9e-8, and more
    with pytest.raises(RigError, match="fewer than 30000 samples"):
        block_means(scan_recording(long), 30_000)


def test_means_while_the_arm_moves_are_those_of_its_noise(tmp_path: Path) -> None:
    """The mean reading of a turn is not the reading at its middle: with a fitted model no more than noise is left.

    Of 360 means: their mean square is that of noise within 5 standard deviations, 5 sqrt(2 / 360) of it.
    """
    run, _ = recorded()
    run.write(tmp_path / "run.parquet")
    scan = scan_recording(tmp_path / "run.parquet")
    left = {}
    for name, model in (("as they are", None), ("beside a model", fitted_model(scan, None))):
        found = block_means(scan, 10, model)
        calibration = calibrate(found)
        rms = np.concatenate([calibration[sensor].fit_rms for sensor in found.sensors])
        left[name] = float(np.mean(np.square(rms / np.array(scenario().rig.acquisition.noise_V)) * 10.0))
    assert abs(left["beside a model"] - 1.0) < 5.0 * np.sqrt(2.0 / 360.0)
    assert left["as they are"] > 4.0  # and not by chance


def test_what_does_not_fit_is_averaged_or_cut(long: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, LEAST)
    assert whole_or_means(long)[1] == 1
    found, block = whole_or_means(long, bytes_a_sample=(64 << 20) / 5000)
    assert (len(found), block) == (5000, 4)
    assert whole_or_means(long, block=10)[0].rate_Hz == pytest.approx(10.0, rel=1e-3)
    assert whole_or_beginning(long)[1] == ""
    found, words = whole_or_beginning(long, bytes_a_sample=(64 << 20) / 5000, fixed=0.0)
    assert len(found) == 5000
    assert "its first 5,000 samples are used" in words
    assert len(whole_or_beginning(long, bytes_a_sample=(64 << 20) / 5000)[0]) == 1000  # a fifth, whatever else is taken


def test_a_long_recording_is_thinned_with_a_word(rig: Rig, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = replace(scenarios.load("ann-arbor"), name="run").simulate(1)
    run.write("run.parquet")
    monkeypatch.setenv(VARIABLE, LEAST)
    monkeypatch.setattr("scenarios.cli.calibrate._ROBUST", 16_000.0)
    found = rig("calibrate", "run.parquet", "--robust")
    assert found.status in (0, 1)
    assert "stretches is used" in found.err
