"""What must hold before any test module is imported, and what many tests begin with."""

from __future__ import annotations

import os

# One BLAS thread (two make small fits erratic), read when numpy is first imported; no window for plots.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ.setdefault(_variable, "1")
os.environ.setdefault("MPLBACKEND", "Agg")

from pathlib import Path

import pytest
from cli_support import SMALL, Rig

import scenarios
from rig.arm import Arm
from rig.recording import Recording


@pytest.fixture
def rig(capfd: pytest.CaptureFixture[str]) -> Rig:
    """The command line."""
    return Rig(capfd)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, no checkout, with a scenario of the user's."""
    (tmp_path / "small.toml").write_text(SMALL)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def swept(here: Path, rig: Rig) -> Path:
    """The same with its recording, run.parquet and run.locked.parquet."""
    rig.done("sweep", "small.toml", "-o", "run.parquet", "--locked")
    return here


@pytest.fixture(scope="module")
def arm() -> Arm:
    """The A465."""
    return Arm.a465()


@pytest.fixture(scope="module")
def recording() -> Recording:
    """6,656 samples of both sensors on the A465, whose base is tilted."""
    return scenarios.load("ann-arbor").simulate(seed=2)
