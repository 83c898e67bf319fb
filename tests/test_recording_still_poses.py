"""A recording of poses held still may leave out its times, if it says so, and its diagnosis what needs them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from diagnosed_recordings import recorded

import estimators
import scenarios
from rig.errors import RigError
from rig.recording import Metadata, Recording, read_recording, scan_recording

STILL = replace(recorded()[0], metadata=Metadata(still_poses=True))


def without_time(path: Path, run: Recording) -> Path:
    """The file of a recording, less its column t_s."""
    run.write(path)
    if path.suffix == ".parquet":
        pa.parquet.write_table(pa.parquet.read_table(path).drop_columns(["t_s"]), path)
    else:
        head, *lines = path.read_text().splitlines()
        path.write_text("\n".join([head, *(line.split(",", 1)[1] for line in lines)]) + "\n")
    return path


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_the_numbers_of_the_poses_stand_for_the_time(tmp_path: Path, suffix: str) -> None:
    path = without_time(tmp_path / f"poses{suffix}", STILL)
    run = read_recording(path)
    assert run.t.tolist() == list(range(600))
    assert run.metadata.still_poses
    for sensor in STILL.sensors:
        np.testing.assert_allclose(run.readings(sensor), STILL.readings(sensor), rtol=1e-12)
    batches = list(scan_recording(path, batch_rows=70))
    assert len(batches) > 1
    assert np.concatenate([batch.t for batch in batches]).tolist() == run.t.tolist()
    for sensor, found in estimators.calibrate(path).sensors.items():  # no time in it: the same answer
        np.testing.assert_allclose(found.values, estimators.calibrate(STILL)[sensor].values, rtol=1e-6, atol=1e-9)


def test_it_has_to_be_said(tmp_path: Path) -> None:
    path = without_time(tmp_path / "run.csv", replace(STILL, metadata=Metadata()))
    with pytest.raises(RigError, match="'t_s' is missing: only with \"still_poses\": true in the metadata"):
        scan_recording(path)
    with pytest.raises(RigError, match="still_poses: found 1, expected true or false"):
        Metadata(still_poses=1)  # type: ignore[arg-type]


def test_times_that_are_there_are_taken(tmp_path: Path) -> None:
    STILL.write(tmp_path / "run.parquet")
    assert read_recording(tmp_path / "run.parquet").t.tolist() == STILL.t.tolist()
    assert STILL.metadata.to_json()["still_poses"] is True
    assert "still_poses" not in Metadata().to_json()


def test_a_diagnosis_of_poses_without_times_names_nothing_that_needs_them() -> None:
    run = scenarios.load("ann-arbor").simulate(seed=3).select(slice(None, None, 16))
    poses = replace(run, t=np.arange(float(len(run))), metadata=replace(run.metadata, still_poses=True, rate_Hz=None))
    assert poses.untimed
    assert not run.untimed
    found = estimators.diagnose(poses)
    left_out = {each["effect"] for each in found.cannot_tell if "no times" in each["why"]}
    assert {"latency", "sensor_lag", "bias_warmup", "vibration", "motion_acceleration"} <= left_out
    assert not {"bias_step", "joint_offset", "scale_cubic"} & left_out
    assert not {cause.effect for cause in found.causes} & left_out
