"""Poses with holds for a calibration: chosen, brought into an order, moved closer together, free of contacts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from estimators.design.exchange import Criterion, exchange
from estimators.stillness.at_rest import SETTLE_S
from rig.arm import Arm
from rig.arm.clearance import Clearance, finite_limits
from rig.arrays import Array
from rig.errors import RigError
from rig.maneuver.moves import Dynamics
from rig.maneuver.static_poses import between
from rig.progress import Progress, unheard

#: The shortest hold that is planned [s].
_LEAST_HOLD_S: Final = 0.5
_CANDIDATES: Final = 500
#: Numbers of poses that are tried, each with joints over all of their range and over these shares of it: near poses
#: differ less, and take less time to go between.
_COUNTS: Final = (8, 9, 10)
_SPREADS: Final = (1.0, 0.55)
_CLIMBS: Final = 2500
_STEPS: Final = (0.6, 0.3, 0.12, 0.04)
#: Joints stay so far within their limits, of their range.
_WITHIN: Final = 0.98
#: The criterion of poses, or a sweep, that do not fit into the time.
FAR: Final = 1e3
#: Errors of so many times the reference's are not worth showing.
WORTHLESS: Final = 100.0


@dataclass(frozen=True, eq=False)
class PosePlan:
    """Poses in their order.

    Attributes:
        q: (k, N) [rad, m]. hold_s, move_s: time in a pose, and between two [s].
        worst: the criterion: the largest standard deviation over its reference.
    """

    q: Array
    hold_s: float
    move_s: float
    worst: float

    @property
    def samples_s(self) -> float:
        """Time of readings that count, of all poses [s]."""
        return len(self.q) * (self.hold_s - 2.0 * SETTLE_S)


class PoseSearch:
    """Looks for the poses of an arm that a calibration gains most from in a given time.

    Args:
        arm, clearance, dynamics: what moves, what it may not touch, how fast.
        criteria: of the sensors. rate_Hz: of the samples. seed: of everything random.
    """

    def __init__(
        self,
        arm: Arm,
        clearance: Clearance,
        dynamics: Dynamics,
        criteria: Sequence[Criterion],
        rate_Hz: float,
        seed: int = 0,
    ) -> None:
        self.arm, self.clearance, self.dynamics = arm, clearance, dynamics
        self.criteria, self.rate_Hz = list(criteria), rate_Hz
        self.rng = np.random.default_rng(seed)
        low, high = finite_limits(arm)
        middle, half = 0.5 * (low + high), 0.5 * _WITHIN * (high - low)
        self.low, self.high = middle - half, middle + half

    def candidates(self, spread: float = 1.0) -> Array:
        """(m, N) random joint values that touch nothing, over a share of the joints' ranges.

        Raises:
            RigError: hardly any pose is free.
        """
        count = _CANDIDATES
        found: list[Array] = []
        for _ in range(20):
            middle, half = 0.5 * (self.low + self.high), 0.5 * spread * (self.high - self.low)
            if spread < 1.0:  # about a place that changes, as the middle of all ranges may be no good one
                middle = self.rng.uniform(self.low + half, self.high - half)
            drawn = self.rng.uniform(middle - half, middle + half, (count, self.arm.dof))
            found.extend(drawn[~self.clearance.touching(drawn)])
            if len(found) >= count:
                return np.array(found[:count])
        if len(found) < 3 * max(_COUNTS):
            raise RigError(
                f"arm {self.arm.name}: of {20 * count:,} random poses {len(found)} keep clear, expected more room:"
                " a lower table, fewer boxes, or a smaller --margin"
            )
        return np.array(found)

    def best(self, seconds: float, progress: Progress = unheard) -> PosePlan:
        """The best poses in this time, moves included.

        Raises:
            RigError: the time is too short for any, or no way between poses is free.
        """
        plans: list[PosePlan] = []
        ways = [(spread, count) for spread in _SPREADS for count in _COUNTS]
        for done, (spread, count) in enumerate(ways):
            pool = self.candidates(spread)
            grams = self.grams(pool)
            allowed = np.ones(len(pool), dtype=bool)
            start = self.rng.choice(len(pool), count, replace=False)
            samples = max(seconds / count - 1.5, _LEAST_HOLD_S) * self.rate_Hz
            chosen, _ = exchange(self.criteria, grams, count, samples, start, allowed)
            plan = self._climbed(pool[chosen], seconds)
            if plan is not None and plan.worst < FAR:
                plans.append(plan)
            progress((done + 1) / len(ways))
        if not plans:
            raise RigError(
                f"--seconds: found {seconds:g}, expected more: {min(_COUNTS)} poses with the moves between them, free"
                " of contacts, do not fit into it"
            )
        return min(plans, key=lambda plan: plan.worst)

    def grams(self, q: Array) -> Array:
        """(m, 10, 10) of one sample at each of joint values (m, N)."""
        rotations = self.arm.rotation_map.rotations(q).reshape(-1, 9)
        x = np.hstack([rotations, np.ones((len(q), 1))])
        return np.asarray(x[:, :, None] * x[:, None, :])

    def timed(self, q: Array, seconds: float) -> PosePlan:
        """The plan of these poses in this order; its worst is far too large where they do not fit into the time."""
        move = float(np.ceil(100.0 * self.dynamics.seconds(q[:-1], q[1:]).max()) / 100.0)
        hold = (seconds - (len(q) - 1) * move) / len(q)
        # Whole samples, so that every pose begins at one.
        hold = np.floor(hold * 100.0 + 1e-9) / 100.0
        if hold < _LEAST_HOLD_S:
            return PosePlan(q, float(hold), move, FAR * (1.0 + _LEAST_HOLD_S - hold))
        samples = (hold - 2.0 * SETTLE_S) * self.rate_Hz
        gram = samples * self.grams(q).sum(axis=0)
        worst = max(float(one.worst(one.information(gram)[None])[0]) for one in self.criteria)
        return PosePlan(q, float(hold), move, worst)

    def ordered(self, q: Array) -> Array:
        """The poses in an order with a short longest move: nearest first, then two exchanged as long as that helps."""
        cost = self.dynamics.seconds(q[:, None], q[None]) ** 6
        best: tuple[float, list[int]] | None = None
        for first in range(len(q)):
            way, left = [first], set(range(len(q))) - {first}
            while left:
                nearest = min(left, key=lambda place: cost[way[-1], place])
                way.append(nearest)
                left.remove(nearest)
            way = _untangled(way, cost)
            length = float(cost[way[:-1], way[1:]].sum())
            if best is None or length < best[0]:
                best = length, way
        assert best is not None
        return q[best[1]]

    def free(self, q: Array) -> bool:
        """Whether all moves between these poses touch nothing."""
        return not self.clearance.touching(between(q)).any()

    def nudged(self, q: Array, place: int, step: Array | float) -> Array:
        """Poses (k, N), one of them moved at random, by about ``step`` of each joint's range."""
        moved = q.copy()
        away = step * (self.high - self.low) * self.rng.standard_normal(self.arm.dof)
        moved[place] = np.clip(moved[place] + away, self.low, self.high)
        return moved

    def _climbed(self, q: Array, seconds: float) -> PosePlan | None:
        """Poses moved a little as long as that helps; None where no way between them is free."""
        plan = self.timed(self.ordered(q), seconds)
        for turn in range(_CLIMBS):
            step = _STEPS[turn * len(_STEPS) // _CLIMBS]
            if turn % 250 == 249:
                again = self.timed(self.ordered(plan.q), seconds)
                plan = again if again.worst < plan.worst else plan
            place = int(self.rng.integers(len(plan.q)))
            joints = self.rng.random(self.arm.dof) < 0.5
            moved = self.nudged(plan.q, place, np.where(joints, step, 0.0))
            other = self.timed(moved, seconds)
            if other.worst < plan.worst and not self.clearance.touching(moved[place])[0]:
                plan = other
        return self.freed(plan, seconds)

    def freed(self, plan: PosePlan, seconds: float) -> PosePlan | None:
        """The plan with moves that touch nothing: in another order, or with the poses in the way elsewhere."""
        for _ in range(200):
            legs = [not self.free(plan.q[k : k + 2]) for k in range(len(plan.q) - 1)]
            if not any(legs):
                return plan
            place = int(np.argmax(legs)) + int(self.rng.integers(2))
            moved = self.nudged(plan.q, place, 0.15)
            if self.clearance.touching(moved[place])[0]:
                continue
            beside = [k for k in (place - 1, place) if 0 <= k < len(moved) - 1]
            before = sum(legs[k] for k in beside)
            if sum(not self.free(moved[k : k + 2]) for k in beside) <= before:
                other = self.timed(moved, seconds)
                if other.worst < 1.05 * plan.worst:
                    plan = other
        return None


def _untangled(way: list[int], cost: Array) -> list[int]:
    """The way with stretches turned round as long as that shortens it."""
    better = True
    while better:
        better = False
        for i in range(len(way) - 1):
            for j in range(i + 1, len(way)):
                turned = way[:i] + way[i : j + 1][::-1] + way[j + 1 :]
                if cost[turned[:-1], turned[1:]].sum() < cost[way[:-1], way[1:]].sum() * (1.0 - 1e-9):
                    way, better = turned, True
    return way
