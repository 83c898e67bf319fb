"""What mean effects change of a recording's readings, with the calibration held."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from estimators.gap.data.blocks import each_used
from estimators.gap.data.tangent import along
from rig.arrays import Array
from rig.channels import COLUMNS_OF, MAGNETOMETER
from rig.effects import Effect, Stage
from rig.effects.base import apply_stage
from rig.pipeline import Pipeline
from rig.signals import Signals


@dataclass(frozen=True)
class ModelledRig:
    """The rig as it was fitted to a recording of n samples.

    Attributes:
        base: the recording's angles or poses after all stages of the fitted pipeline, without effects; n samples.
        pipeline: the fitted pipeline, without effects.
        given: mean effects that the model has, as a fitted rig has them; all others are asked for beside these.
        within: where each sample stands for a block of them, the recording at some of each block, poses known: where
            effects are evaluated whose mean over a block is not their value at its mean pose.
        bent: whether that holds for every effect.
        in_place: mean effects beside which the pipeline was fitted.
    """

    base: Signals
    pipeline: Pipeline
    given: tuple[Effect, ...] = field(default=(), kw_only=True)
    within: Signals | None = field(default=None, kw_only=True)
    bent: bool = field(default=False, kw_only=True)
    in_place: tuple[Effect, ...] = field(default=(), kw_only=True)

    @cached_property
    def given_change(self) -> Array:
        """(n, 6) [recorded unit] what the given effects change, with the calibration held."""
        return self._changed(self.given) if self.given else np.broadcast_to(0.0, self.base.volts.shape)

    @property
    def modelled(self) -> Array:
        """(n, 6) [recorded unit] the base fit, given effects included."""
        return self.base.volts + self.given_change if self.given else self.base.volts

    def recalibrated(self, step: Array) -> Array:
        """(n, 6) [recorded unit] what a small step (p,) of the calibration changes, with the effects in place."""
        return along(self.base, self.pipeline, (*self.given, *self.in_place), step)

    def change(self, effects: Sequence[Effect]) -> Array:
        """(n, 6) [recorded unit] what mean effects change, with the calibration held."""
        if not effects:
            return np.zeros_like(self.base.volts)
        if len(effects) == 1 and effects[0].stage is Stage.FIELD and not self.given and not self.bent:
            found = self._of_field(effects[0])
            if found is not None:
                return found
        return self._changed((*self.given, *effects)) - self.given_change

    def _of_field(self, effect: Effect) -> Array | None:
        """As ``change``, of an effect that adds to the magnetic field alone: the readings are linear in that."""
        base = self.base
        moved = apply_stage((effect,), Stage.FIELD, base, np.random.default_rng(0))
        if moved.gravity is not base.gravity or moved.acceleration is not base.acceleration:
            return None
        change = np.zeros_like(base.volts)
        if MAGNETOMETER in self.pipeline.sensors:
            change[:, COLUMNS_OF[MAGNETOMETER]] = np.einsum("nki,ni->nk", self._felt, moved.magnetic - base.magnetic)
        return change

    @cached_property
    def _felt(self) -> Array:
        """(n, 3, 3) [recorded unit over the field's] what the magnetometer's channels read of a field, base frame."""
        sensor = self.pipeline.sensors[MAGNETOMETER]
        return np.asarray(
            np.einsum("nij,kj->nki", self.base.R_base_tool, np.reshape(sensor.sensitivity, (-1, 1)) * sensor.axes)
        )

    def _changed(self, effects: Sequence[Effect]) -> Array:
        """(n, 6) [recorded unit] what effects change, those that the model has among them."""
        base = self._base_for(effects)
        rng = np.random.default_rng(0)  # mean effects draw nothing
        return self._means_within(replace(self.pipeline, effects=tuple(effects)).carried(base, rng).volts - base.volts)

    def _base_for(self, effects: Sequence[Effect]) -> Signals:
        """Where effects are evaluated."""
        return self._within if self.bent or any(each.jumps or each.rapid for each in effects) else self.base

    @property
    def _within(self) -> Signals:
        """``within`` after all stages of the fitted pipeline: made anew, as it is large and these data are many."""
        if self.within is None:
            return self.base
        return self.pipeline.expected(self.within, np.random.default_rng(0), first=Stage.FIELD)

    def _means_within(self, change: Array) -> Array:
        """(n, 6) a change of the readings (n, 6), or at some samples of each block (k n, 6)."""
        count = len(self.base)
        return change if len(change) == count else np.asarray(change.reshape(count, -1, change.shape[1]).mean(axis=1))

    def changes(
        self, effects: Sequence[Effect], index: int, moved: Sequence[Effect], channels: NDArray[np.bool_]
    ) -> Iterator[Array]:
        """As ``change``, with one of the effects as each of several others in turn; the stages before it run once.

        Args:
            channels: (6,) of these alone; what a sensor without any reads is not evaluated, and NaN.
        """
        rng, stage = np.random.default_rng(0), effects[index].stage
        here = [name for name, own in COLUMNS_OF.items() if name in self.pipeline.sensors and channels[own].any()]
        pipeline, base = self.pipeline, self._base_for((*self.given, *effects))
        if here and len(here) < len(pipeline.sensors):
            pipeline, inputs = pipeline.restricted(here), np.full_like(base.inputs, np.nan)
            for name in here:
                inputs[:, COLUMNS_OF[name]] = base.inputs[:, COLUMNS_OF[name]]
            base = replace(base, inputs=inputs)
        begun = None
        for effect in moved:
            pipeline = replace(pipeline, effects=(*self.given, *effects[:index], effect, *effects[index + 1 :]))
            begun = begun or pipeline.begun(base, rng, stage)
            yield self._means_within(pipeline.carried(base, rng, begun, stage).volts - base.volts) - self.given_change


def known(base: Signals) -> Signals:
    """The signals with what is asked for again and again: joint velocities and link poses, or the log's nodes.

    Link poses of more samples than are used one by one are asked for a few times, and are ten times the readings.
    """
    if base.q_encoder is None:
        return replace(base, known_nodes=(base.pose_nodes,))
    return base.knowing_links() if each_used(len(base)) else replace(base, velocity=base.joint_velocity)
