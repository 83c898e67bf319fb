"""Poses, or a sweep, that tell causes apart: stops all over, exchanged one by one for such that separate them more."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from estimators.design.isolability import SEEN, Isolability, Key
from rig.arrays import Array
from rig.errors import RigError, nearest
from rig.maneuver.fitting import stops_at
from rig.progress import Progress, unheard
from scenarios.isolability import shown_by
from scenarios.plan.poses import FAR, PosePlan, PoseSearch
from scenarios.plan.sweeps import SweepPlan, SweepSearch
from scenarios.scenario import Scenario

#: Numbers of poses, and shares of the joints' ranges, that are begun with; draws of each.
_COUNTS: Final = (8, 14, 24)
_SPREADS: Final = (1.0, 0.55)
_DRAWS: Final = 4
#: Exchanges that are tried, of given causes and of all.
_CLIMBS: Final = (150, 25)
#: Samples of a maneuver that are looked at while maneuvers are compared.
_SAMPLES: Final = 300
_FEWEST: Final = 2


def telling(
    base: Scenario,
    search: PoseSearch,
    seconds: float,
    tell: Sequence[Key],
    progress: Progress = unheard,
) -> PosePlan:
    """The poses whose least separated pair of causes is separated most.

    Args:
        base: sensors and surroundings. search: of the arm's poses. seconds: for all of it.
        tell: effects and places; none: all that it can show, as many pairs told apart as can be.

    Raises:
        RigError: fewer than two causes, one that cannot act here, or too little time.
    """
    _check(tell)

    def value(plan: PosePlan) -> float:
        shown = search.arm.in_degrees(plan.q)
        maneuver = stops_at(search.arm, shown, plan.hold_s, plan.move_s, search.rate_Hz)
        return worth(shown_by(base, maneuver, tell or None, _SAMPLES), tell)

    starts = []
    for spread in _SPREADS:
        pool = search.candidates(spread)
        for count in _COUNTS:
            for _ in range(_DRAWS if tell else 1):
                chosen = search.rng.choice(len(pool), min(count, len(pool)), replace=False)
                plan = search.timed(search.ordered(pool[chosen]), seconds)
                if plan.worst < FAR:
                    starts.append((value(plan), plan))
    if not starts:
        raise RigError(
            f"--seconds: found {seconds:g}, expected more: {min(_COUNTS)} poses with the moves between them do not fit"
        )
    best, plan = max(starts, key=lambda each: each[0])
    climbs = _CLIMBS[0] if tell else _CLIMBS[1]
    for turn in range(climbs):
        place = int(search.rng.integers(len(plan.q)))
        moved = search.nudged(plan.q, place, 0.4 * (1.0 - turn / climbs) + 0.03)
        other = search.timed(moved, seconds)
        if other.worst < FAR and not search.clearance.touching(moved[place])[0]:
            found = value(other)
            if found > best:
                best, plan = found, other
        progress((turn + 1) / climbs)
    free = search.freed(plan, seconds)
    if free is None:
        raise RigError("plan: no way between the poses is free of contacts: try another --seed or more room")
    return free


def telling_sweep(
    base: Scenario,
    search: SweepSearch,
    seconds: float,
    tell: Sequence[Key],
    progress: Progress = unheard,
) -> SweepPlan:
    """The sweep whose least separated pair of causes is separated most; arguments and errors as of ``telling``."""
    _check(tell)

    def value(values: Array) -> float:
        return worth(shown_by(base, search.maneuver(values, seconds), tell or None, _SAMPLES), tell)

    starts = [(value(values), values) for _, values in search.drawn(seconds, _DRAWS)]
    best, values = max(starts, key=lambda each: each[0])
    climbs = _CLIMBS[0] if tell else _CLIMBS[1]
    for turn in range(climbs):
        step = 0.2 * (1.0 - turn / climbs) + 0.02
        moved = values + step * search.span * search.room.rng.standard_normal(values.shape) / values.shape[1]
        other = search.fitted(moved, seconds)
        if (found := value(other)) > best and search.free(other, seconds):
            best, values = found, other
        progress((turn + 1) / climbs)
    return search.plan(values, seconds)


def _check(tell: Sequence[Key]) -> None:
    if len(tell) == 1:
        raise RigError(f"--tell: found one cause, expected {_FEWEST} or more, or all")


def worth(found: Isolability, tell: Sequence[Key]) -> float:
    """Of given causes the least separation of a pair [sigma]; of all, the share of pairs that are told apart, near
    ones by how near they are.

    Raises:
        RigError: a given cause is none that can act here.
    """
    for key in tell:
        if key not in found.effects:
            known = [f"{effect}@{where}" for effect, where in found.effects]
            raise RigError(
                f"--tell: {'@'.join(key)} cannot act on this arm and recording, expected effect@place"
                f"{nearest('@'.join(key), known)}"
            )
    upper = np.triu_indices(len(found.effects), 1)
    pairs = found.pairs[upper]
    return float(pairs.min()) if tell else float(np.minimum(pairs, SEEN).mean() / SEEN)
