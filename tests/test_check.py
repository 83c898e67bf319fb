"""``rig check``: what a file of each kind holds, and what looks wrong in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import SMALL, Rig
from diagnosed_recordings import by_hand

from rig.recording import Recording, read_recording
from scenarios.importing.mapping import Mapping

CAUSE = '[[effects.backlash]]\nwhere = "joint5"\nwidth_rad = 0.01\n'


def test_what_a_file_holds(rig: Rig, swept: Path) -> None:
    Path("faulty.toml").write_text(SMALL + CAUSE)
    Path("map.toml").write_text(Mapping({"Acc X": "accel1_g", "time": "t"}).to_toml())
    by_hand().write("found.json")
    rig.done("calibrate", "run.parquet", "-o", "cal.json")
    for name, words in {
        "faulty.toml": ("scenario", "torus-sweep", "backlash at joint5"),
        "map.toml": ("mapping", "Acc X"),
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


def in_g(run: Recording) -> Recording:
    assert run.accelerometer is not None
    return replace(run, accelerometer=9.8 * run.accelerometer, units={**run.units, "accelerometer": "g"})


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (later, "a gap of 60.1 s after row 99; the median step is 0.1 s"),
        (too_fast, "rate_Hz says 20, the times say 10"),
        (in_degrees, "joint angles beyond 50 turns: degrees under the name of radians?"),
        (in_g, "times that of gravity in g: its unit?"),
    ],
)
def test_what_looks_wrong(rig: Rig, swept: Path, wrong: Callable[[Recording], Recording], words: str) -> None:
    wrong(read_recording("run.parquet")).write("wrong.parquet")
    assert words in " ".join(rig.not_good("check", "wrong.parquet").split())
