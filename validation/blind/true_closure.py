"""How far an answer's causes really close the gap, by the true change and the true calibration."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rig.arm import Arm
from rig.arrays import Array
from rig.channels import CHANNELS
from rig.effects import Effect, Kind
from rig.errors import RigError
from rig.recording import Recording
from rig.signals import Signals
from scenarios.causes import read_causes
from validation.blind.projection import Projection
from validation.blind.truth import Truth


@dataclass(frozen=True)
class Closure:
    """Answer and truth, side by side; None where there is nothing to compare.

    Attributes:
        gap_error: relative error of the gap, root of the sum of squares over the channels.
        left: RMS that the answer's causes really leave of the gap, over the gap.
        closed_error: closed as answered less closed in truth, both as shares of the squared gap.
        closed_holds: whether the answer's interval of it holds the truth.
    """

    gap_error: float | None
    left: float | None
    closed_error: float | None
    closed_holds: bool | None = None


def closure(truth: Truth, change: Array, recording: Recording, answer: dict[str, Any], path: Path, arm: Arm) -> Closure:
    """The comparison for one case.

    Args:
        change: (n, 6) [V] true change of the expected readings.
        answer, path: the diagnosis and its file.
        arm: that made the recording.
    """
    true_gap = float(np.linalg.norm(truth.gap_V))
    if not true_gap > 0.0 or not truth.visible or "where" not in answer:
        return Closure(None, None, None)
    channels = answer["where"]["channels"]
    gap = float(np.linalg.norm([channels[name]["gap_before"] or 0.0 for name in CHANNELS]))
    gap_error = gap / true_gap - 1.0
    if not np.any(change):
        return Closure(gap_error, None, None)
    signals, projection = _bench(truth, recording, arm)
    total = projection.snr(change)
    effects: tuple[Effect, ...] = ()
    try:
        effects = tuple(effect for effect in read_causes(path) if effect.kind is Kind.MEAN)
        left = projection.snr(change - _replayed(effects, truth, signals)) / total
    except RigError:  # names or values that the simulator refuses close nothing
        left = 1.0
    closed = answer["closed"]
    if closed["value"] is None or not effects:
        return Closure(gap_error, left, None)
    really = 1.0 - left**2
    holds = None if closed["low"] is None else float(closed["low"]) <= really <= float(closed["high"])
    return Closure(gap_error, left, float(closed["value"]) - really, holds)


def _bench(truth: Truth, recording: Recording, arm: Arm) -> tuple[Signals, Projection]:
    if recording.q is None:
        rotation = recording.rotations(None).reshape(-1, 3, 3)
        position = np.empty((0, 0)) if recording.tool_position is None else recording.tool_position
        start = Signals(t=recording.t, R_base_tool=rotation, position=position, temperature=recording.temperature)
    else:
        velocity = np.gradient(recording.q, recording.t, axis=0)
        start = Signals(
            t=recording.t, arm=arm, q_encoder=recording.q, velocity=velocity, temperature=recording.temperature
        )
    signals = truth.pipeline.expected(start, np.random.default_rng(0))
    return signals, Projection.of(truth.pipeline, signals.R_base_tool, truth.floor, 1.0 / recording.rate_Hz)


def _replayed(effects: tuple[Effect, ...], truth: Truth, signals: Signals) -> Array:
    if not effects:
        return np.zeros_like(signals.volts)
    first = min(effect.stage for effect in effects)
    pipeline = replace(truth.pipeline, effects=effects)
    return np.asarray(pipeline.expected(signals, np.random.default_rng(0), first).volts - signals.volts)
