"""The way of a reading through the rig: encoder angles in at the top, volts out at the bottom.

The simulator runs it on a maneuver, the diagnosis on a recording's own angles.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rig.channels import ACCELEROMETER, CHANNELS, COLUMNS_OF, MAGNETOMETER, SENSORS
from rig.effects.base import Effect, Stage, apply_stage
from rig.environment import Environment
from rig.errors import RigError
from rig.sensor import TriaxialSensor
from rig.signals import Signals


@dataclass(frozen=True)
class Pipeline:
    """The stages with what they need: the surroundings, the two sensors and the effects.

    Attributes:
        accelerometer, magnetometer: at least one of the two; the other's channels read NaN.
        effects: applied at their stage, in this order.
    """

    environment: Environment
    accelerometer: TriaxialSensor | None
    magnetometer: TriaxialSensor | None
    effects: tuple[Effect, ...] = ()

    def __post_init__(self) -> None:
        if not self.sensors:
            raise RigError("the rig has no sensor: expected an accelerometer, a magnetometer or both")

    @property
    def sensors(self) -> dict[str, TriaxialSensor]:
        """The sensors that are there, by name."""
        both = {ACCELEROMETER: self.accelerometer, MAGNETOMETER: self.magnetometer}
        return {name: sensor for name, sensor in both.items() if sensor is not None}

    @property
    def columns(self) -> list[int]:
        """The channels that are there, as columns of an array (n, 6)."""
        return [index for name in self.sensors for index in range(*COLUMNS_OF[name].indices(len(CHANNELS)))]

    def restricted(self, sensors: Iterable[str]) -> Pipeline:
        """With some of its sensors."""
        own = {name: sensor for name, sensor in self.sensors.items() if name in set(sensors)}
        return replace(self, accelerometer=own.get(ACCELEROMETER), magnetometer=own.get(MAGNETOMETER))

    def expected(
        self, signals: Signals, rng: np.random.Generator, first: Stage = Stage.TRANSMISSION, last: Stage = Stage.VOLTS
    ) -> Signals:
        """From angles or poses to volts before sampling and noise, with the effects of these stages.

        Args:
            signals: with ``q_encoder`` (angles) or ``R_base_tool`` and ``position`` (measured poses).
            rng: for effects that are random.
            first: the first stage to run; the stages before it have run already.
            last: the last stage to run.

        Raises:
            RigError: joint angles without an arm, an effect on a joint where no joint angles were recorded.
        """
        steps = (self._jointed, self._posed, self._exposed, self._felt, self._measured)
        for stage in range(first, last + 1):
            signals = apply_stage(self.effects, Stage(stage), steps[stage](signals), rng)
        return signals

    def carried(
        self, base: Signals, rng: np.random.Generator, begun: Signals | None = None, first: Stage = Stage.TRANSMISSION
    ) -> Signals:
        """Signals that have been through every stage without effects, with the effects: what they leave alone is kept.

        The same as ``expected`` to rounding, and many times as fast where an effect changes little.

        Args:
            base: without effects.
            begun: as ``begun`` makes it of the first stage; ``base`` by default.
            first: the first stage whose effects are applied.
        """
        signals = apply_stage(self.effects, first, base if begun is None else begun, rng)
        for stage in map(Stage, range(first + 1, Stage.ELECTRONIC)):
            signals = apply_stage(self.effects, stage, self._again(stage, signals, base), rng)
        return signals

    def begun(self, base: Signals, rng: np.random.Generator, stage: Stage) -> Signals:
        """As ``carried``, up to where the effects of a stage are applied."""
        signals = base
        for earlier in map(Stage, range(stage)):
            signals = self._again(Stage(earlier + 1), apply_stage(self.effects, earlier, signals, rng), base)
        return signals

    def _again(self, stage: Stage, signals: Signals, base: Signals) -> Signals:
        """A stage's step, where something before it has changed."""
        if stage is Stage.POSE and signals.q is not base.q:
            return self._posed(signals)
        if stage is Stage.INPUT:
            turned = signals.R_base_tool is not base.R_base_tool
            pushed = signals.acceleration is not base.acceleration or signals.gravity is not base.gravity
            drawn = signals.magnetic is not base.magnetic
            names = [name for name, changed in ((ACCELEROMETER, pushed), (MAGNETOMETER, drawn)) if turned or changed]
            return self._felt(signals, names) if names else signals
        if stage is Stage.VOLTS and signals.inputs is not base.inputs:
            return self._measured(signals)
        return signals

    def _jointed(self, signals: Signals) -> Signals:
        if signals.q_encoder is not None:
            return replace(signals, q=signals.q_encoder)
        misplaced = [effect.name for effect in self.effects if effect.stage is Stage.TRANSMISSION]
        if misplaced:
            raise RigError(f"effect {misplaced[0]} acts on a joint: found poses without joint angles")
        return signals

    def _posed(self, signals: Signals) -> Signals:
        if signals.q_encoder is None:
            return signals
        if signals.arm is None:
            raise RigError("joint angles without an arm: expected an Arm beside them")
        posed = bool(signals.position.size)  # before
        if posed and not any("position" in effect.requires for effect in self.effects):
            # nothing asks where the sensor is: only its orientation follows the joints
            rotation = signals.arm.rotation_map.rotations(signals.q)
            return replace(signals, R_base_tool=rotation.reshape(-1, 3, 3))
        poses = signals.arm.mapped_poses(signals.q) if posed else signals.arm.poses(signals.q)
        return replace(signals, R_base_tool=poses.R_base_tool, position=poses.position)

    def _exposed(self, signals: Signals) -> Signals:
        environment = self.environment
        return replace(
            signals,
            gravity=environment.gravity,
            magnetic=environment.magnetic,
            references=np.repeat([environment.gravity_m_s2, environment.magnetic_field], 3),
        )

    def _felt(self, signals: Signals, names: Sequence[str] = SENSORS) -> Signals:
        inputs = signals.inputs.copy() if signals.inputs.size else np.full((len(signals), len(CHANNELS)), np.nan)
        for name in names:
            field = signals.gravity - signals.acceleration if name == ACCELEROMETER else signals.magnetic
            if name in self.sensors:
                inputs[:, COLUMNS_OF[name]] = self.sensors[name].components(signals.R_base_tool, field)
        return replace(signals, inputs=inputs)

    def _measured(self, signals: Signals) -> Signals:
        volts = np.full_like(signals.inputs, np.nan)
        for name, sensor in self.sensors.items():
            volts[:, COLUMNS_OF[name]] = sensor.volts(signals.inputs[:, COLUMNS_OF[name]])
        return replace(signals, volts=volts)
