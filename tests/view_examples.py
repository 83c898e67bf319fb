"""A recording, its calibration and its view, for the tests of the view and of the viewer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from scipy.spatial.transform import Rotation

import estimators
from estimators.calibration import Calibration
from rig.arm import Arm
from rig.recording import Metadata, Recording
from scenarios.view import write_view


@pytest.fixture(scope="module")
def calibration(recording: Recording) -> Calibration:
    return estimators.calibrate(recording)


@pytest.fixture(scope="module")
def view(recording: Recording, calibration: Calibration, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("view") / "run.rrd"
    write_view(recording, calibration, path)
    return path


@pytest.fixture(scope="module")
def tool_poses(recording: Recording) -> Recording:
    """The same run as a tracking system would record it."""
    poses = Arm.a465().poses(recording.q)
    quaternion = Rotation.from_matrix(poses.R_base_tool).as_quat(scalar_first=True)
    return replace(
        recording, q=None, tool_quaternion=quaternion, tool_position=poses.position, metadata=Metadata(arm="none")
    )
