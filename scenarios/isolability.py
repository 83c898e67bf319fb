"""Which effects a scenario's maneuver can show and tell apart, and what changes if every joint moves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from estimators.design.isolability import SEEN, Isolability, Key, isolability
from rig.arm.clearance import Clearance, finite_limits
from rig.errors import RigError
from rig.maneuver import Maneuver, StaticPoses
from rig.maneuver.fitting import stops_at
from rig.progress import Progress, unheard
from rig.signals import Signals
from rig.trajectory import PoseTrajectory
from scenarios.bound import noise_of
from scenarios.scenario import Scenario

#: Samples of a maneuver that are looked at.
_SAMPLES: Final = 1200
#: The other maneuver stops so often, and is at rest for this share of its time.
_STOPS: Final = 40
_HELD: Final = 0.3
_STILL_RAD: Final = 1e-3


@dataclass(frozen=True, eq=False)
class EffectsBound:
    """What a maneuver can show, and another of the same time in which every joint moves.

    Attributes:
        scenario: its name. here: of its maneuver. moving: of the other; None where every joint moves already.
        locked: numbers of the joints that its maneuver does not move.
        names: the arm's own names of the places joint1..jointN, where they differ.
    """

    scenario: str
    here: Isolability
    moving: Isolability | None
    locked: tuple[int, ...]
    names: Mapping[str, str] = field(default_factory=dict)

    @property
    def gained(self) -> list[Key]:
        """Effects that are seen only if every joint moves."""
        if self.moving is None:
            return []
        seen = {key for key, visible in zip(self.here.effects, self.here.visible, strict=True) if visible}
        other = zip(self.moving.effects, self.moving.visible, strict=True)
        return [key for key, visible in other if visible and key not in seen]

    @property
    def parted(self) -> list[tuple[Key, Key, float]]:
        """Pairs that are not told apart here, and by how many standard deviations they are if every joint moves."""
        if self.moving is None:
            return []
        place = {key: index for index, key in enumerate(self.moving.effects)}
        pairs = self.moving.pairs
        found = [
            (one, other, float(pairs[place[one], place[other]]))
            for one, other, _ in self.here.alike
            if one in place and other in place
        ]
        return [pair for pair in found if pair[2] >= SEEN]

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {
            "format": "rig-isolability/1",
            "scenario": self.scenario,
            "locked_joints": list(self.locked),
            **self.here.to_json(),
            "if_every_joint_moves": None
            if self.moving is None
            else {
                **self.moving.to_json(),
                "newly_seen": [list(key) for key in self.gained],
                "newly_told_apart": [
                    {"pair": [list(one), list(other)], "sigmas": sigmas} for one, other, sigmas in self.parted
                ],
            },
        }


def isolability_of(scenario: Scenario, only: Sequence[Key] | None = None, progress: Progress = unheard) -> EffectsBound:
    """What the maneuver of a scenario can show of the catalogue's effects.

    Args:
        only: effect and place of those that are wanted; None: all. progress: called with the share done.

    Raises:
        RigError: the scenario has no arm or no noise.
    """
    if scenario.rig.arm is None:
        raise RigError(f"scenario {scenario.name}: has no arm, expected joint angles: effects act on joints and links")
    trajectory = scenario.maneuver.trajectory()
    assert not isinstance(trajectory, PoseTrajectory)
    locked = tuple((1 + np.flatnonzero(np.ptp(trajectory.q, axis=0) <= _STILL_RAD)).tolist())
    half = 0.5 if locked else 1.0
    here = shown_by(scenario, scenario.maneuver, only, progress=lambda done: progress(half * done))
    moving = None
    if locked:
        moving = shown_by(scenario, moving_all(scenario), only, progress=lambda done: progress(half + half * done))
    return EffectsBound(scenario.name, here, moving, locked, scenario.rig.arm.place_names)


def moving_all(scenario: Scenario) -> StaticPoses:
    """Stops at random poses of all joints, free of contacts, in the time of the scenario's maneuver.

    Raises:
        RigError: hardly any pose is free.
    """
    arm = scenario.rig.arm
    assert arm is not None
    clearance = Clearance.of(arm, None if arm.is_a465 else 0.0)
    low, high = finite_limits(arm)
    rng = np.random.default_rng(0)
    poses: list[np.ndarray[Any, Any]] = []
    for _ in range(20):
        drawn = rng.uniform(0.97 * low, 0.97 * high, (2 * _STOPS, arm.dof))
        poses.extend(drawn[~clearance.touching(drawn)])
        if len(poses) >= _STOPS:
            break
    else:
        raise RigError(f"arm {arm.name}: hardly any random pose is free of contacts")
    cycle = scenario.maneuver.duration_s / _STOPS
    shown = arm.in_degrees(poses[:_STOPS])
    return stops_at(arm, shown, _HELD * cycle, (1.0 - _HELD) * cycle, scenario.maneuver.rate_Hz)


def shown_by(
    scenario: Scenario,
    maneuver: Maneuver,
    only: Sequence[Key] | None = None,
    samples: int = _SAMPLES,
    progress: Progress = unheard,
) -> Isolability:
    """What a maneuver can show with the arm, the sensors and the surroundings of a scenario.

    Args:
        only, progress: as of ``isolability_of``. samples: so many of the maneuver's are looked at.
    """
    acquisition = scenario.rig.acquisition
    total = maneuver.duration_s * maneuver.rate_Hz / acquisition.decimation
    count = int(min(samples, total))
    motion = maneuver.trajectory(np.arange(count, dtype=np.float64) * (maneuver.duration_s / count))
    assert not isinstance(motion, PoseTrajectory)
    environment = scenario.rig.environment
    signals = Signals(
        motion.t,
        arm=scenario.rig.arm,
        q_encoder=motion.q,
        velocity=motion.qd,
        temperature=environment.temperature(motion.t) if environment.temperature_rise_degC else None,
    )
    pipeline = replace(scenario.rig.pipeline, effects=())
    return isolability(signals, pipeline, noise_of(scenario), total / count, only, progress)
