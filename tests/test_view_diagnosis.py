"""A diagnosis on the arm in rerun: the place at fault, the stray magnet, vectors before and after, what causes do."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cli_support import Rig
from diagnosed_recordings import backlash, by_hand, cause, recorded
from rerun.chunk import RrdReader

from rig.arm import Arm
from rig.effects import make_effect
from scenarios.gap_report import gap_residuals
from scenarios.view.diagnosed import write_diagnosis_view

DIPOLE = {"position_m": (0.55, 0.35, 0.25), "moment": (0.0, 0.02, 0.01)}


def drawn(path: Path) -> dict[str, set[str]]:
    """Entity -> the components that are logged of it."""
    found: dict[str, set[str]] = {}
    for chunk in RrdReader(path).stream():
        names = {name for name in chunk.to_record_batch().schema.names if ":" in name}
        found.setdefault(chunk.entity_path, set()).update(names)
    return found


def test_the_joint_at_fault_and_the_magnet_are_where_they_are(tmp_path: Path) -> None:
    run, locked = recorded(backlash(), make_effect("base_dipole", {"where": "base", **DIPOLE}))
    magnet = cause(
        "base_dipole",
        "base",
        position_m=(DIPOLE["position_m"], (0.03, 0.05, 0.02), "m"),
        moment=(DIPOLE["moment"], (1e-3,) * 3, "relative"),
    )
    diagnosis = by_hand(causes=(*by_hand().causes, magnet))
    write_diagnosis_view(diagnosis, gap_residuals(run, diagnosis, locked), tmp_path / "d.rrd")
    found = drawn(tmp_path / "d.rrd")
    for entity, column in (("", "positions"), ("/label", "positions"), ("/label", "labels")):
        assert f"Points3D:{column}" in found[f"/fault/backlash_joint5{entity}"]
    assert "Ellipsoids3D:half_sizes" in found["/fault/base_dipole_base/uncertainty"]
    for name in ("before", "after"):
        assert "Arrows3D:vectors" in found[f"/residual_vectors/{name}"]
        assert "Scalars:scalars" in found[f"/residual_means/mag1/{name}"]
    assert "Scalars:scalars" in found["/what_the_causes_do/magnetometer/mag2"]
    painted = [entity for entity in found if "/visual_geometries/link5/" in entity]
    assert painted
    for entity in painted:  # a colour of another shape is an error in the viewer
        assert len({name.split(":")[0] for name in found[entity]} & {"Boxes3D", "Cylinders3D", "Ellipsoids3D"}) == 1


def test_anchors_lie_on_the_joints_axes() -> None:
    arm = Arm.a465()
    q = np.array([[0.3, 1.2, -0.9, 0.4, 0.7, 0.1]])
    for joint in range(arm.dof):  # a point on the axis stays where it is while the joint turns
        turned = q.copy()
        turned[0, joint] += 0.5
        np.testing.assert_allclose(arm.joint_anchors(q)[0, joint], arm.joint_anchors(turned)[0, joint], atol=1e-12)


def test_only_a_diagnosis_of_that_recording_is_shown(here: Path, rig: Rig) -> None:
    run, locked = recorded(backlash())
    run.write("small.parquet")
    locked.write("small.locked.parquet")
    by_hand().write("small.diagnosis.json")
    by_hand(name="other").write("other.diagnosis.json")
    said = rig.refused("view", "small.parquet", "--diagnosis", "other.diagnosis.json", "-o", "v.rrd")
    assert "is of other, expected a diagnosis of small" in said
    rig.refused(
        "view", "small.parquet", "--diagnosis", "small.diagnosis.json", "--calibration", "c.json", "-o", "v.rrd"
    )
    assert not Path("v.rrd").exists()
    rig.done("view", "small.parquet", "--diagnosis", "small.diagnosis.json", "-o", "v.rrd")
    assert Path("v.rrd").stat().st_size > 10_000


@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT")
def test_the_web_viewer_listens_to_this_machine_and_ends_with_ctrl_c(tmp_path: Path) -> None:
    run, _ = recorded()
    run.write(tmp_path / "run.parquet")
    call = [sys.executable, "-m", "scenarios.cli", "view", "run.parquet", "--web", "-o", "v.rrd"]
    with subprocess.Popen(
        call,
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # the shell may have it ignored
    ) as process:
        try:
            assert process.stderr is not None
            address = process.stderr.readline().strip()
            while not address.startswith("http"):  # whatever is said of the calibration
                assert address, "the server ended"
                address = process.stderr.readline().strip()
            assert address.startswith("http://127.0.0.1:")
            process.send_signal(signal.SIGINT)
            assert process.wait(30.0) == 130
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
