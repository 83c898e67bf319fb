"""What simple judges would answer: no gap, always; the largest raw correlation; stepwise regression by BIC.

They see what the diagnosis sees, the recording and the floor at rest, take that floor for white, and know nothing of
what the calibration takes up (raw correlation), of colour, of searches, or of effects outside the catalogue.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from estimators import calibrate, noise_floor
from rig.arm import Arm
from rig.arrays import Array
from rig.channels import COLUMNS_OF, SENSORS
from rig.effects import Effect
from rig.environment import Environment
from rig.pipeline import Pipeline
from rig.recording import Recording, read_recording
from rig.sensor import TriaxialSensor
from rig.signals import Signals
from validation.blind.floors import Floor
from validation.blind.likeness import candidates, small_steps
from validation.blind.projection import Projection

_THINNED: Final = 4  # every so many samples: the simple judges need not be slow as well
_MOST: Final = 4  # causes
_CORRELATED: Final = 5.0  # standard deviations of a correlation that count as one
_SHAPES: Final = 24  # so many shapes of a candidate are tried


@dataclass(frozen=True)
class _Desk:
    """A recording beside its calibration, thinned: what the simple judges look at."""

    pipeline: Pipeline
    signals: Signals
    residual: Array
    projection: Projection

    @classmethod
    def of(cls, recording: Recording, locked: Recording) -> _Desk:
        floor = noise_floor(locked)
        calibration = calibrate(recording, noise=floor)
        sensors, directions, sigma = {}, {}, np.ones(6)
        for name, found in calibration.sensors.items():
            sensors[name] = TriaxialSensor.from_axes(found.sensitivity, found.offset, found.axis_vectors)
            assert found.field_direction is not None
            directions[name] = tuple(found.field_direction.vector)
            sigma[COLUMNS_OF[name]] = np.std(locked_residuals(locked, name), axis=0)
        environment = Environment(
            gravity_m_s2=recording.metadata.gravity_m_s2,
            magnetic_field=recording.metadata.magnetic_field,
            gravity_direction=directions[SENSORS[0]],
            magnetic_direction=directions[SENSORS[1]],
        )
        pipeline = Pipeline(environment, sensors[SENSORS[0]], sensors[SENSORS[1]])
        assert recording.q is not None
        velocity = np.gradient(recording.q, recording.t, axis=0)
        rows = slice(None, None, _THINNED)
        start = Signals(
            t=recording.t[rows],
            arm=Arm.a465(),
            q_encoder=recording.q[rows],
            velocity=velocity[rows],
            temperature=None if recording.temperature is None else recording.temperature[rows],
        )
        signals = pipeline.expected(start, np.random.default_rng(0))
        readings = np.column_stack([recording.readings(name) for name in SENSORS])[rows]
        interval = _THINNED / recording.rate_Hz
        projection = Projection.of(pipeline, signals.R_base_tool, Floor(tuple(sigma), {}), interval)
        return cls(pipeline, signals, readings - signals.volts, projection)

    def columns(self, effect: type[Effect], fixed: dict[str, Any]) -> Array:
        """(n, 6, k) [V] derivatives by the strengths at zero."""
        found = []
        for span in effect.spanning():
            for step, _ in small_steps(effect):
                pipeline = replace(self.pipeline, effects=(effect.from_mapping({**span, **fixed, **step}),))
                changed = pipeline.expected(self.signals, np.random.default_rng(0), effect.stage)
                found.append(changed.volts - self.signals.volts)
        return np.stack(found, axis=2)

    def shapes(self, effect: type[Effect]) -> list[dict[str, Any]]:
        """Some shapes of a candidate; for tones the frequency where the residual has most power."""
        if effect.tone:
            power = np.abs(np.fft.rfft(self.residual, axis=0)[1:]) ** 2
            best = 1 + int(np.argmax(power.sum(axis=1)))
            step = float(self.signals.t[1] - self.signals.t[0])
            return [{"freq_Hz": best / (len(self.residual) * step)}]
        found = list(effect.searched(self.signals))
        return found[:: max(1, len(found) // _SHAPES)]


def always_none(recording: Recording, locked: Recording) -> dict[str, Any]:
    """No gap, whatever comes."""
    return _answer([])


def largest_correlation(recording: Recording, locked: Recording) -> dict[str, Any]:
    """The candidate whose raw effect correlates best with the raw residual, if that is beyond chance for one
    candidate."""
    desk = _Desk.of(recording, locked)
    sigma = np.asarray(desk.projection.floor.sigma_V)
    target = (desk.residual / sigma).ravel()
    best, label = 0.0, ("", "")
    for effect, fixed in candidates(desk.signals):
        for shape in desk.shapes(effect):
            columns = desk.columns(effect, {**fixed, **shape}) / sigma[:, None]
            flat = columns.reshape(-1, columns.shape[2])
            size = np.linalg.norm(flat, axis=0)
            found = np.abs(flat.T @ target) / np.maximum(size * np.linalg.norm(target), 1e-300)
            if found.max() > best:
                best, label = float(found.max()), (effect.name, fixed["where"])
    return _answer([label] if best * np.sqrt(len(target)) > _CORRELATED else [])


def stepwise_bic(recording: Recording, locked: Recording) -> dict[str, Any]:
    """Forward selection by the Bayesian information criterion, linear, with the calibration projected out."""
    desk = _Desk.of(recording, locked)
    residual = desk.projection(desk.residual)
    designs = []
    for effect, fixed in candidates(desk.signals):
        for shape in desk.shapes(effect):
            design = desk.projection(desk.columns(effect, {**fixed, **shape}))
            designs.append(((effect.name, fixed["where"]), _orthonormal(design)))
    chosen: list[tuple[str, str]] = []
    penalty = np.log(residual.size)
    for _ in range(_MOST):
        gains = [float(np.sum((basis.T @ residual) ** 2)) - penalty * basis.shape[1] for _, basis in designs]
        best = int(np.argmax(gains))
        if gains[best] <= 0.0:
            break
        label, basis = designs[best]
        chosen.append(label)
        residual = residual - basis @ (basis.T @ residual)
        designs = [(other, _orthonormal(each - basis @ (basis.T @ each))) for other, each in designs if other != label]
    return _answer(chosen)


Judge = Callable[[Recording, Recording], dict[str, Any]]

#: By name, as the report has them.
BASELINES: Final[dict[str, Judge]] = {
    "always none": always_none,
    "largest raw correlation": largest_correlation,
    "stepwise BIC": stepwise_bic,
}


def baseline_answers(recording: Path, locked: Path) -> dict[str, dict[str, Any]]:
    """The answers of all simple judges to one recording."""
    run, rest = read_recording(recording), read_recording(locked)
    return {name: judge(run, rest) for name, judge in BASELINES.items()}


def locked_residuals(locked: Recording, sensor: str) -> Array:
    """(n, 3) readings at rest, less the mean of their pose."""
    assert locked.q is not None
    readings = locked.readings(sensor).copy()
    moved = np.abs(np.diff(locked.q, axis=0)).max(axis=1) > 1e-6
    for rows in np.split(np.arange(len(locked)), np.flatnonzero(moved) + 1):
        readings[rows] -= readings[rows].mean(axis=0)
    return readings


def _orthonormal(design: Array) -> Array:
    size = np.linalg.norm(design, axis=0)
    kept = design[:, size > 1e-9 * max(float(size.max()), 1e-300)] if size.size else design
    if not kept.shape[1]:
        return np.zeros((len(design), 0))
    left, singular, _ = np.linalg.svd(kept / np.linalg.norm(kept, axis=0), full_matrices=False)
    return np.asarray(left[:, singular > 1e-5 * singular[0]])


def _answer(labels: list[tuple[str, str]]) -> dict[str, Any]:
    causes = [{"effect": effect, "where": where, "equivalent": []} for effect, where in labels]
    return {"verdict": "named" if causes else "no-gap", "causes": causes}
