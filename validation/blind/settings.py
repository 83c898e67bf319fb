"""The rig of one case: a scenario with everything drawn anew that a laboratory would have otherwise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from rig.arm import Arm
from rig.arrays import Array
from rig.channels import ACCELEROMETER, MAGNETOMETER
from rig.effects import Effect, Stage
from rig.environment import Environment
from rig.errors import RigError
from rig.maneuver import LockedPoses, StaticPoses, TorusSweep
from rig.recording import Recording
from rig.sensor import TriaxialSensor
from rig.signals import Signals, sampled
from rig.simulate import Rig
from scenarios.scenario import Scenario
from validation.blind.floors import Colour, Floor
from validation.blind.laboratories import LABORATORIES, Laboratory, Wander
from validation.blind.projection import Projection

FloorKind = Literal["white", "coloured", "flicker", "slow flicker", "walk", "long tails"]

#: Samples a second that a recording keeps, and that are simulated for each of them.
RATE_HZ: Final = 4.0
FINER: Final = 5

#: Passes of yaw and pitch, and how much faster than the paper's sweep they are run.
SWEEPS: Final = (((15, 7), 1), ((11, 6), 1), ((13, 8), 1), ((15, 7), 2))
FAST: Final = (((15, 7), 4),)

_PAPERS_S: Final = 1664.0  # the paper's sweep
_DEGREES: Final = 4.0  # of Student's t
_HOLD_S: Final = 100.0
_LOCKED_HZ: Final = 20.0


@dataclass(frozen=True)
class Setting:
    """Everything of a case but its effects.

    Attributes:
        rig: arm, surroundings, sensors and the white part of the noise; no effects.
        maneuver: sampled ``FINER`` times as often as the recording.
        locked: the poses of the recording at rest.
        floor: the noise at rest.
        inertial: whether the sensor's own acceleration along the maneuver acts.
        laboratory: where it is recorded.
    """

    rig: Rig
    maneuver: TorusSweep | StaticPoses | Wander
    locked: LockedPoses
    floor: Floor
    inertial: bool = False
    laboratory: Laboratory = LABORATORIES["sweep"]

    @property
    def sweep(self) -> TorusSweep:
        """The maneuver, where it is a sweep.

        Raises:
            RigError: it is none.
        """
        if not isinstance(self.maneuver, TorusSweep):
            raise RigError(f"laboratory {self.laboratory.name}: found no torus sweep, expected one")
        return self.maneuver

    @property
    def kept(self) -> slice:
        """The samples that the recording keeps."""
        return slice(None, None, FINER)

    @cached_property
    def start(self) -> Signals:
        """The fine samples as they enter the pipeline: encoder angles, no effect yet."""
        path = self.maneuver.trajectory()
        arm = self.rig.arm
        if arm is None:
            raise RigError("the blind check needs an arm: found a scenario without one")
        arm.check_limits(path.q, "the sweep")
        acceleration = arm.site_acceleration(path.q, path.qd, path.qdd) if self.inertial else np.zeros(3)
        temperature = self.rig.environment.temperature(path.t)
        joints = Signals(
            t=path.t, arm=arm, q_encoder=path.q, velocity=path.qd, acceleration=acceleration, temperature=temperature
        )
        if self.laboratory.pose == "joints":
            return joints
        poses = arm.poses(path.q)
        return replace(
            joints, arm=None, q_encoder=None, velocity=None, R_base_tool=poses.R_base_tool, position=poses.position
        )

    @cached_property
    def ideal(self) -> Signals:
        """The kept samples without effect and noise."""
        return self.expected(())

    @cached_property
    def projection(self) -> Projection:
        """M and W."""
        pipeline = replace(self.rig.pipeline, effects=())
        return Projection.of(pipeline, self.ideal.R_base_tool, self.floor, 1.0 / RATE_HZ)

    def expected(self, effects: tuple[Effect, ...]) -> Signals:
        """The kept samples with effects, before noise; effects on noisy readings do nothing here."""
        pipeline = replace(self.rig.pipeline, effects=effects)
        return sampled(pipeline.expected(self.start, np.random.default_rng(0)), self.kept)

    def change(self, effects: tuple[Effect, ...]) -> Array:
        """(n, 6) [V] what mean effects change in the kept samples, as seen from the poses that are logged."""
        world = tuple(effect for effect in effects if not effect.of_log)
        changed = self.expected(world).volts if world else self.ideal.volts
        logged = self.start
        for effect in effects:
            if effect.of_log:
                logged = effect.log(logged, np.random.default_rng(0))
        if logged is self.start:
            return np.asarray(changed - self.ideal.volts)
        read = replace(self.rig.pipeline, effects=()).expected(sampled(logged, self.kept), np.random.default_rng(0))
        return np.asarray(changed - read.volts)

    def record(self, effects: tuple[Effect, ...], rng: np.random.Generator, name: str) -> Recording:
        """The recording with effects."""
        rig = replace(self.rig, effects=(*self.floor.effects, *effects))
        return replace(rig.record(self.start, rng, self.maneuver.rate_Hz, name), name=name)

    def record_locked(self, rng: np.random.Generator, name: str) -> Recording | None:
        """The recording at rest, without effects; None where the laboratory makes none."""
        if not self.laboratory.locked:
            return None
        acquisition = replace(self.rig.acquisition, decimation=1, pose="joints")
        rig = replace(self.rig, effects=self.floor.effects, acquisition=acquisition)
        recording = rig.simulate(self.locked, rng, name=name)
        return replace(recording, temperature=None)

    def record_volts(self, volts: Array, rng: np.random.Generator, name: str, q: Array, t: Array) -> Recording:
        """A recording of expected readings (n, 6) [V] that something else computed, with floor and converter.

        Args:
            q: (n, N) [rad] what the encoders read. t: (n,) [s].
        """
        rig = replace(self.rig, effects=(_Given("acquisition", volts), *self.floor.effects))
        acquisition = replace(rig.acquisition, decimation=1)
        temperature = rig.environment.temperature(t)
        start = Signals(t=t, arm=rig.arm, q_encoder=q, velocity=np.zeros_like(q), temperature=temperature)
        return replace(replace(rig, acquisition=acquisition).record(start, rng, RATE_HZ, name), name=name)


def draw_setting(
    scenario: Scenario,
    samples: int,
    rng: np.random.Generator,
    floor: FloorKind = "white",
    sweeps: tuple[tuple[tuple[int, int], int], ...] = SWEEPS,
    laboratory: Laboratory = LABORATORIES["sweep"],
) -> Setting:
    """A setting around a scenario: calibration, tilt, sweep and floor are drawn.

    Args:
        scenario: with an arm and both sensors.
        samples: of the recording; 6,656 is the paper's sweep at 4 Hz.
        floor: white; half first-order coloured, over 0.4 to 3 s; nearly 1/f, over the lags that a locked pose teaches
            or to the length of the recording ("slow"); a walk too slow for the locked poses; white of long tails.
        sweeps: to choose from.
        laboratory: where it is recorded; it may have a number of samples of its own.

    Raises:
        RigError: the scenario has no arm, or lacks a sensor.
    """
    rig = scenario.rig
    if rig.arm is None or rig.accelerometer is None or rig.magnetometer is None:
        raise RigError(f"scenario {scenario.name}: found no arm or a sensor missing, expected an arm with both sensors")
    duration_s = (laboratory.samples or samples) / RATE_HZ
    arm = laboratory.arm_in(rig.arm)
    if laboratory.wanders:
        maneuver: TorusSweep | Wander = Wander.drawn(arm, duration_s, RATE_HZ * FINER, rng)
        locked = _draw_rest(arm, rng)
    else:
        maneuver = draw_sweep(sweeps, duration_s, rng)
        locked = _draw_locked(rng)
    noise = _draw_floor(np.asarray(rig.acquisition.noise_V), floor, duration_s, rng)
    noise_V = (0.0,) * 6 if noise.degrees else noise.white_V
    acquisition = replace(rig.acquisition, noise_V=noise_V, decimation=FINER, pose=laboratory.pose)
    mount = Rotation.from_rotvec(np.radians(3.0) * rng.standard_normal(3))
    mount = Rotation.from_rotvec(0.5 * np.pi * rng.integers(4) * np.eye(3)[2]) * mount
    drawn = Rig(
        arm=arm,
        environment=_draw_environment(rig.environment, rng),
        accelerometer=_draw_sensor(rig.accelerometer, mount, rng),
        magnetometer=_draw_sensor(rig.magnetometer, mount, rng),
        acquisition=acquisition,
    )
    return Setting(drawn, maneuver, locked, noise, laboratory=laboratory)


def draw_sweep(
    sweeps: tuple[tuple[tuple[int, int], int], ...], duration_s: float, rng: np.random.Generator
) -> TorusSweep:
    """A torus sweep in a time, its passes and speed drawn from some to choose from."""
    (yaw, pitch), speed = sweeps[rng.integers(len(sweeps))]
    longer = max(1, round(duration_s / _PAPERS_S))  # a longer recording has more passes, not slower ones
    return TorusSweep(
        duration_s=duration_s,
        rate_Hz=RATE_HZ * FINER,
        yaw_passes=yaw * speed * longer,
        pitch_passes=pitch * speed * longer,
        roll_deg_per_s=13.9 * speed,
        corner_s=float(rng.choice([0.5, 1.0])),
    )


def _draw_rest(arm: Arm, rng: np.random.Generator) -> LockedPoses:
    """Three poses anywhere within an arm's limits."""
    wander = Wander.drawn(arm, 1.0, 1.0, rng)
    poses = [
        tuple(float(each) for each in np.degrees(wander.trajectory(np.array([at])).q[0])) for at in (0.0, 70.0, 190.0)
    ]
    return LockedPoses(poses_deg=tuple(poses), hold_s=_HOLD_S, rate_Hz=_LOCKED_HZ)


def _draw_floor(sigma: Array, kind: FloorKind, duration_s: float, rng: np.random.Generator) -> Floor:
    sigma = sigma * rng.uniform(0.7, 1.3, 6)
    colours: dict[str, tuple[Colour, ...]] = {}
    if kind == "long tails":
        return Floor(tuple(float(value) for value in sigma), colours, _DEGREES)
    if kind != "white":
        sensors = [(ACCELEROMETER, MAGNETOMETER), (ACCELEROMETER,), (MAGNETOMETER,)][rng.integers(3)]
        for sensor in sensors:
            if kind == "coloured":
                colours[sensor] = (Colour(float(rng.uniform(0.3, 0.6)), float(np.exp(rng.uniform(-0.9, 1.1)))),)
            elif kind == "walk":
                colours[sensor] = (Colour(float(rng.uniform(0.1, 0.4)), 3.0 * duration_s),)
            elif kind == "slow flicker":  # nearly 1/f to the length of the recording: more than a locked pose can teach
                fastest = float(rng.uniform(0.15, 0.6))
                parts = max(2, int(np.log(duration_s / fastest) / np.log(5.0)))
                colours[sensor] = tuple(Colour(0.6 / parts, fastest * 5.0**step) for step in range(parts))
            else:  # nearly 1/f over the lags that a locked pose of 100 s can teach
                fastest = float(rng.uniform(0.15, 0.6))
                colours[sensor] = tuple(Colour(0.17, fastest * 5.0**step) for step in range(3))
    return Floor(tuple(float(value) for value in sigma), colours)


def _draw_environment(around: Environment, rng: np.random.Generator) -> Environment:
    """The base tilted by up to 5 degrees to anywhere, on a site of its own."""
    azimuth, tilt = rng.uniform(0.0, 2.0 * np.pi), np.radians(rng.uniform(0.3, 5.0))
    lean = Rotation.from_rotvec(tilt * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]))
    dip, heading = np.radians(rng.uniform(45.0, 72.0)), rng.uniform(0.0, 2.0 * np.pi)
    north = np.array([np.cos(dip) * np.cos(heading), np.cos(dip) * np.sin(heading), -np.sin(dip)])
    return replace(
        around,
        gravity_direction=tuple(lean.apply([0.0, 0.0, -1.0])),
        magnetic_direction=tuple(lean.apply(north)),
        temperature_degC=float(rng.uniform(19.0, 25.0)),
        temperature_rise_degC=float(rng.uniform(2.0, 6.0)),
        temperature_tau_s=float(rng.uniform(300.0, 900.0)),
    )


def _draw_sensor(around: TriaxialSensor, mount: Rotation, rng: np.random.Generator) -> TriaxialSensor:
    crooked = around.axes + np.radians(1.5) * rng.standard_normal((3, 3))
    axes = mount.apply(crooked / np.linalg.norm(crooked, axis=1, keepdims=True))
    sensitivity = np.asarray(around.sensitivity) * rng.uniform(0.93, 1.07, 3)
    offset = np.asarray(around.offset) + rng.uniform(-0.1, 0.1, 3)
    return TriaxialSensor.from_axes(sensitivity, offset, axes)


def _draw_locked(rng: np.random.Generator) -> LockedPoses:
    poses = []
    for _ in range(3):
        yaw, pitch, roll = rng.uniform(-160.0, 160.0), rng.uniform(-80.0, 80.0), rng.uniform(-180.0, 180.0)
        poses.append((yaw, 90.0, -90.0, 0.0, pitch, roll))
    return LockedPoses(poses_deg=tuple(poses), hold_s=_HOLD_S, rate_Hz=_LOCKED_HZ)


@dataclass(frozen=True)
class _Given(Effect):
    """Readings (n, 6) [V] that were computed elsewhere, in place of the pipeline's."""

    name = "given"
    stage = Stage.VOLTS
    places = ("acquisition",)

    volts: Array

    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        return replace(signals, volts=self.volts)
