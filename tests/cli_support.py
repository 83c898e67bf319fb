"""A small scenario and how the tests call the command line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from scenarios.cli._app import run

#: Both sensors, 600 samples, and a locked recording of two poses.
SMALL = """
title = "A short sweep"
[maneuver]
kind = "torus-sweep"
duration_s = 60.0
[environment.earth]
north_G = 0.18534
east_G = -0.02118
down_G = 0.51927
base_tilt_deg = 3.0
[acquisition]
decimation = 10
[accelerometer]
sensitivity = [0.14259, 0.14251, 0.14198]
offset = [2.3754, 2.4491, 2.1096]
beta_deg = [85.3089, -1.2394, 1.2829]
gamma_deg = [89.8537, 0.8943, 272.1489]
noise_V = [0.0134, 0.0136, 0.0146]
[magnetometer]
sensitivity = [2.3572, 2.4074, 2.4181]
offset = [2.4216, 2.3967, 2.7643]
beta_deg = [0.96237, -85.6307, -4.0172]
gamma_deg = [270.2059, 185.8359, 1.2153]
noise_V = [0.0085, 0.0068, 0.0117]
[locked]
poses_deg = [[0, 90, -90, 0, 0, 0], [0, 90, -90, 0, 90, 0]]
hold_s = 2.0
"""


@dataclass(frozen=True)
class Result:
    """What a command did: exit status, standard output and standard error."""

    status: int
    out: str
    err: str


class Rig:
    """The command line, as a user calls it, in this process."""

    def __init__(self, capture: pytest.CaptureFixture[str]) -> None:
        self._capture = capture

    def __call__(self, *arguments: str | Path) -> Result:
        self._capture.readouterr()
        status = run([str(argument) for argument in arguments])
        captured = self._capture.readouterr()
        return Result(status, captured.out, captured.err)

    def done(self, *arguments: str | Path) -> str:
        """Standard output of a call that must end well and say nothing on standard error."""
        result = self(*arguments)
        assert result.status == 0, result.err
        assert result.err == ""
        return result.out

    def not_good(self, *arguments: str | Path) -> str:
        """Standard output of a call whose answer is there, but bad."""
        result = self(*arguments)
        assert result.status == 1, result.err
        assert result.err == ""
        return result.out

    def refused(self, *arguments: str | Path, status: int = 2) -> str:
        """The one line on standard error of a call that must fail."""
        result = self(*arguments)
        assert result.status == status, (result.status, result.out, result.err)
        assert result.out == ""
        assert result.err.startswith("rig: "), result.err
        assert result.err.count("\n") == 1, result.err
        assert "Traceback" not in result.err
        return result.err.strip()
