"""The viewer: bound to this machine, stopped when it hangs, and what it shows when it opens."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
from matplotlib.image import imread
from view_examples import calibration, tool_poses, view  # noqa: F401  (fixtures)

from documenting.photograph import _headless_viewer, photograph
from documenting.photograph import main as photograph_command
from rig.errors import RigError
from rig.recording import Recording
from scenarios.view import open_view

SECOND_NS = 1_000_000_000
#: Poses are stored in single precision: seven rotations and offsets of at most 1 m multiplied up, half an ulp each.
SINGLE = 7 * 4 * float(np.finfo(np.float32).eps)

needs_unix = pytest.mark.skipif(sys.platform == "win32", reason="stands in for the viewer with a shell script")


def stand_in(folder: Path, script: str) -> Path:
    """A program in the viewer's place."""
    program = folder / "viewer"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    return program


@needs_unix
def test_the_viewer_is_opened_for_this_machine_only(
    view: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = tmp_path / "said"
    program = stand_in(tmp_path, f'echo "$CI" "$@" > {said}.part && mv {said}.part {said}')
    monkeypatch.setenv("RERUN_CLI_PATH", str(program))
    monkeypatch.delenv("CI", raising=False)
    open_view(view).wait(timeout=30)
    words = said.read_text().split()
    assert words[0] == "1"  # where CI is set the viewer reports nothing to its makers
    assert words[words.index("--bind") + 1] == "127.0.0.1"
    assert words[-1] == str(view)
    assert "CI" not in os.environ
    with pytest.raises(RigError, match="no such file"):
        open_view(tmp_path / "none.rrd")
    monkeypatch.setenv("RERUN_CLI_PATH", str(tmp_path / "none"))
    with pytest.raises(RigError, match="cannot be started"):
        open_view(view)


@needs_unix
def test_a_viewer_that_hangs_is_stopped(view: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    number = tmp_path / "pid"
    program = stand_in(tmp_path, f"echo $$ > {number}; exec sleep 600")
    monkeypatch.setenv("RERUN_CLI_PATH", str(program))
    with pytest.raises(RigError, match="did not draw it in time"):
        photograph(view, tmp_path / "picture.png", timeout_s=1.0)
    assert not psutil.pid_exists(int(number.read_text()))
    assert not (tmp_path / "picture.png").exists()


@needs_unix
def test_a_viewer_that_fails_says_why(
    view: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("RERUN_CLI_PATH", str(stand_in(tmp_path, "echo 'No graphics adapter was found'; exit 101")))
    with pytest.raises(RigError, match="mesa-vulkan-drivers"):
        photograph(view, tmp_path / "picture.png")
    monkeypatch.setenv("RERUN_CLI_PATH", str(stand_in(tmp_path, "echo \"thread panicked at 'x'\"; echo bye; exit 101")))
    assert photograph_command([str(view), str(tmp_path / "picture.png")]) == 2
    assert "status 101 and said: thread panicked at 'x'" in capsys.readouterr().err
    assert photograph_command([]) == 2
    assert not (tmp_path / "picture.png").exists()


def test_it_looks_right_when_it_opens(view: Path, recording: Recording, tmp_path: Path) -> None:
    picture = tmp_path / "view.png"
    try:
        seen = photograph(view, picture, at_s=640.0, size=(1600, 900), settle_s=2.0)
    except RigError as error:
        if "no graphics driver" in str(error):
            pytest.skip(str(error))
        raise
    assert seen.complaints == ()
    assert len(seen.views) == 11
    assert seen.timeline == "t"
    assert (seen.start_s, seen.end_s) == pytest.approx(tuple(recording.t[[0, -1]]))
    pixels = imread(picture)[:, :, :3]
    assert pixels.shape == (900, 1600, 3)
    arm, series = pixels[100:850, 50:650], pixels[50:850, 720:1580]
    # The arm's shell is the only large bright area at the left; the axes' three colours fill the plots at the right.
    assert (arm.min(axis=2) > 0.5).mean() > 0.02
    for colour in ((0x56, 0xB4, 0xE9), (0xE6, 0x9F, 0x00), (0x00, 0x9E, 0x73)):
        assert (np.abs(series - np.array(colour) / 255.0).max(axis=2) < 0.02).mean() > 0.01


def test_the_headless_viewer_listens_to_this_machine_only(view: Path) -> None:
    with _headless_viewer(view, (640, 480)) as viewer:
        addresses: set[str] = set()
        for _ in range(100):
            if viewer.process.poll() is not None:
                pytest.skip(viewer.complaint())
            listening = [c for c in psutil.Process(viewer.process.pid).net_connections("inet") if c.status == "LISTEN"]
            addresses = {connection.laddr.ip for connection in listening}
            if addresses:
                break
            time.sleep(0.1)
        assert addresses == {"127.0.0.1"}
    assert viewer.process.returncode is not None
