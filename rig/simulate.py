"""The simulated rig: a maneuver in, a recording out; two engines behind one call."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from rig.acquisition import Acquisition
from rig.arm import Arm
from rig.channels import ACCELEROMETER, CHANNELS_OF, COLUMNS_OF, MAGNETOMETER
from rig.effects.base import Effect, Stage, apply_stage
from rig.engine_dynamic import follow
from rig.environment import Environment
from rig.errors import RigError, check_name
from rig.maneuver import Maneuver
from rig.pipeline import Pipeline
from rig.pose_nodes import quaternions
from rig.progress import Progress
from rig.recording import Metadata, Recording
from rig.sensor import TriaxialSensor
from rig.signals import Signals, sampled
from rig.trajectory import JointTrajectory, PoseTrajectory

Engine = Literal["kinematic", "dynamic"]
Motion = Literal["quasi-static", "inertial"]
ENGINES: Final[tuple[Engine, ...]] = ("kinematic", "dynamic")
MOTIONS: Final[tuple[Motion, ...]] = ("quasi-static", "inertial")


def unfelt(effect: Effect, sensors: Iterable[str]) -> str:
    """Which sensor a rig lacks for an effect, in words; empty where it has all.

    Args:
        effect: with its place. sensors: of the rig.
    """
    own = {channel: sensor for sensor, channels in CHANNELS_OF.items() for channel in (sensor, *channels)}
    names = [effect.where, effect.of_sensor, *(str(getattr(effect, choice)) for choice in effect.choices())]
    lacking = [own[name] for name in names if name in own and own[name] not in sensors]
    if not lacking:
        return ""
    return f"the rig has no {lacking[0]}, expected an effect on its {' or '.join(sensors)}"


@dataclass(frozen=True)
class Rig:
    """An arm with a sensor on it, in its surroundings.

    Attributes:
        arm: None for a sensor tumbled by hand.
        accelerometer, magnetometer: at least one of the two.
        effects: what the ideal model leaves out, each applied at its stage.

    Raises:
        RigError: an effect on a sensor that is not there.
    """

    arm: Arm | None
    environment: Environment
    accelerometer: TriaxialSensor | None
    magnetometer: TriaxialSensor | None
    acquisition: Acquisition
    effects: tuple[Effect, ...] = ()

    def __post_init__(self) -> None:
        for effect in self.effects:
            if lacking := unfelt(effect, self.pipeline.sensors):
                raise RigError(f"effect {effect.name} at {effect.where}: {lacking}")

    @property
    def pipeline(self) -> Pipeline:
        """The stages before the acquisition; errors of the log are none of them."""
        world = tuple(effect for effect in self.effects if not effect.of_log)
        return Pipeline(self.environment, self.accelerometer, self.magnetometer, world)

    def simulate(
        self,
        maneuver: Maneuver,
        rng: np.random.Generator,
        engine: Engine = "kinematic",
        motion: Motion = "quasi-static",
        progress: Progress | None = None,
        name: str = "run",
    ) -> Recording:
        """Run a maneuver and record it.

        Args:
            maneuver: joint angles or poses over time.
            rng: all randomness of the recording.
            engine: "kinematic" puts the joints where the maneuver wants them; "dynamic" lets position actuators drive
                them (MuJoCo, 1 kHz), reads the encoders and has real accelerations.
            motion: of the kinematic engine: "quasi-static" ignores accelerations as Renk et al. do; "inertial" adds
                the sensor's true acceleration along the maneuver.
            progress: called with the share done, 0 to 1.
            name: the recording's name.

        Raises:
            RigError: unknown engine or motion, a joint beyond its limit, a maneuver that does not suit the rig.
        """
        check_name("engine", engine, ENGINES)
        check_name("motion", motion, MOTIONS)
        signals = self._start(maneuver, engine, motion, progress)
        signals = replace(signals, temperature=self.environment.temperature(signals.t))
        return self.record(signals, rng, maneuver.rate_Hz, name)

    def record(self, signals: Signals, rng: np.random.Generator, rate_Hz: float, name: str = "run") -> Recording:
        """From encoder angles or poses to a recording: the pipeline, sampling, noise and converter."""
        decimation, count = self.acquisition.decimation, len(signals.t)
        if 1 < count <= decimation:
            raise RigError(
                f"acquisition.decimation: found {decimation}, expected less than the maneuver's {count} samples"
            )
        kept = slice(None, None, decimation)
        logged = self._log(signals, rng)
        signals = sampled(self.pipeline.expected(signals, rng), kept)
        signals = replace(signals, volts=self.acquisition.add_noise(signals.volts, rng))
        signals = apply_stage(self.effects, Stage.ELECTRONIC, signals, rng)
        volts = self.acquisition.convert(signals.volts)
        pose = self.acquisition.pose
        return Recording(
            t=signals.t,
            q=signals.q_encoder if pose == "joints" else None,
            slides=self.arm.slide_numbers if self.arm is not None and pose == "joints" else (),
            tool_quaternion=None if logged is None else quaternions(logged.R_base_tool[kept]),
            tool_position=None if logged is None else logged.position[kept],
            accelerometer=None if self.accelerometer is None else volts[:, COLUMNS_OF[ACCELEROMETER]],
            magnetometer=None if self.magnetometer is None else volts[:, COLUMNS_OF[MAGNETOMETER]],
            units={name: unit for name, unit in self.acquisition.unit_of.items() if name in self.pipeline.sensors},
            temperature=signals.temperature,
            metadata=Metadata(
                gravity_m_s2=self.environment.gravity_m_s2,
                magnetic_field=self.environment.magnetic_field,
                rate_Hz=rate_Hz / decimation,
                arm=self.arm.name if self.arm else "none",
                accelerometer_reads=self.acquisition.accelerometer_reads,
            ),
            name=name,
        )

    def _log(self, signals: Signals, rng: np.random.Generator) -> Signals | None:
        """The tool's poses as they are logged; None where they are not.

        Raises:
            RigError: an error of the log where no tool pose is logged.
        """
        errors = [effect for effect in self.effects if effect.of_log]
        if self.acquisition.pose != "tool":
            for effect in errors:
                raise RigError(
                    f"effect {effect.name} errs in the log of the tool's poses: found acquisition.pose = "
                    f"{self.acquisition.pose!r}, expected 'tool'"
                )
            return None
        seen = tuple(effect for effect in self.pipeline.effects if not effect.on_mount)
        logged = replace(self.pipeline, effects=seen).expected(signals, rng, last=Stage.POSE)
        for effect in errors:
            logged = effect.log(logged, rng)
        return logged

    def _start(self, maneuver: Maneuver, engine: Engine, motion: Motion, progress: Progress | None) -> Signals:
        if engine == "dynamic":
            if self.arm is None:
                raise RigError("the dynamic engine needs an arm: found a rig without one")
            return _moved(self.arm, follow(self.arm, maneuver, self.environment.gravity, progress), inertial=True)
        trajectory = maneuver.trajectory()
        if isinstance(trajectory, PoseTrajectory):
            return Signals(
                t=trajectory.t,
                R_base_tool=trajectory.R_base_tool,
                position=trajectory.position,
                acceleration=trajectory.acceleration if motion == "inertial" else np.zeros(3),
            )
        if self.arm is None:
            raise RigError("the maneuver moves joints: found a rig without an arm")
        self.arm.check_limits(trajectory.q, "the maneuver")
        if not self.arm.is_a465:  # on the rig's own arm the published maneuver may be played as fast as one likes
            self.arm.check_speeds(trajectory.qd, "the maneuver")
        return _moved(self.arm, trajectory, motion == "inertial")


def _moved(arm: Arm, path: JointTrajectory, inertial: bool) -> Signals:
    """The signals of an arm along a path, with the sensor's acceleration or without."""
    acceleration = arm.site_acceleration(path.q, path.qd, path.qdd) if inertial else np.zeros(3)
    return Signals(path.t, arm=arm, q_encoder=path.q, velocity=path.qd, acceleration=acceleration)
