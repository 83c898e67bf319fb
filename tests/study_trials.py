"""Trials that the tests of the executor run in other processes."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np
import pyarrow as pa

from rig.errors import RigError


def squares(settings: int, number: int) -> pa.Table:
    """A trial: random numbers from a seed, and the square of its own."""
    rng = np.random.default_rng([settings, number])
    return pa.table({"number": [number] * 3, "square": [number**2] * 3, "random": rng.standard_normal(3)})


def dying(folder: str, number: int) -> pa.Table:
    """The same, but trial 3 takes its process with it the first time."""
    marker = Path(folder) / "died"
    if number == 3 and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return squares(0, number)


def always_dying(_settings: int, _number: int) -> pa.Table:
    """A trial that no process survives."""
    os.kill(os.getpid(), signal.SIGKILL)


def failing(_settings: int, number: int) -> pa.Table:
    """A trial that is refused."""
    raise RigError(f"trial {number}: found nothing, expected something")
