"""One hidden rig played to its end: recorded, diagnosed, sent the next maneuver, until it is named or given up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import pyarrow as pa

from estimators.gap.diagnosis import Diagnosis
from estimators.gap.report.separation import rivals
from rig.maneuver import StaticPoses, TorusSweep
from rig.recording import Recording
from rig.threads import one_blas_thread
from scenarios.plan.maneuver_family import Family, stops
from validation.blind.settings import RATE_HZ, SWEEPS, draw_sweep
from validation.loop.judge import Judged, judged
from validation.loop.rigs import HiddenRig, hidden_rig

Strategy = Literal["proposed", "random", "torus"]
STRATEGIES: Final[tuple[Strategy, ...]] = ("proposed", "random", "torus")
#: Maneuvers at most, the first one included.
MOST: Final = 6

Maneuver = TorusSweep | StaticPoses


@dataclass(frozen=True)
class Settings:
    """What is studied.

    Attributes:
        rigs: how many. samples: of every recording, at 4 Hz. seed: of everything random.
        strategies: how the next maneuver is chosen.
    """

    rigs: int = 12
    samples: int = 1664
    seed: int = 1
    strategies: tuple[Strategy, ...] = STRATEGIES


@dataclass(frozen=True)
class Step:
    """One more recording.

    Attributes:
        rig, strategy, step: which; the first recording is step 1.
        effect, where: the truth. snr: of the first recording. alike: how many other names it has there.
        minutes: of arm time so far.
        maneuver: its kind.
        verdict, probability: of all recordings so far together.
        names: how many names the leading explanation has, twins counted.
        said: the leading explanation.
        right: whether the truth is one of its names.
        ended: "named", "no maneuver" where nothing more is proposed, "given up" after the last; empty: it goes on.
    """

    rig: int
    strategy: str
    step: int
    effect: str
    where: str
    snr: float
    alike: int
    minutes: float
    maneuver: str
    verdict: str
    probability: float
    names: int
    said: str
    right: bool
    ended: str

    @property
    def rightly(self) -> bool:
        """Whether it ended with the truth's name and no other."""
        return self.ended == "named" and self.right


def trial(settings: Settings, number: int) -> pa.Table:
    """All steps of a rig, strategy by strategy; they share the first recording."""
    with one_blas_thread():
        rig = hidden_rig(settings.seed, number, settings.samples)
        locked = rig.locked()
        first = rig.recording(0)
        begun = judged([first], locked)
        steps = [
            step for strategy in settings.strategies for step in _played(rig, number, strategy, first, locked, begun)
        ]
    return pa.Table.from_pylist([vars(step) for step in steps])


def _played(
    rig: HiddenRig, number: int, strategy: Strategy, first: Recording, locked: Recording, begun: Judged
) -> list[Step]:
    choose = _chooser(rig, strategy, first)
    runs, found, steps = [first], begun, []
    minutes, kind = _minutes(rig), "torus sweep"
    for step in range(1, MOST + 1):
        following = None
        ended = "named" if named(found.diagnosis) else "given up" if step == MOST else ""
        if not ended:
            following = choose(found)
            ended = "" if following is not None else "no maneuver"
        steps.append(_step(rig, number, strategy, step, minutes, kind, found.diagnosis, ended))
        if following is None:
            break
        moved = rig.on(*following)
        minutes += _minutes(moved)
        kind = "stops" if isinstance(following[0], StaticPoses) else "torus sweep"
        runs = [*runs, moved.recording(100 * (1 + STRATEGIES.index(strategy)) + step)]
        found = judged(runs, locked)
    return steps


def _minutes(rig: HiddenRig) -> float:
    return rig.setting.maneuver.duration_s / 60.0


def named(diagnosis: Diagnosis) -> bool:
    """Whether one cause by one name is what the diagnosis says: nothing else is left between which to decide."""
    return diagnosis.verdict == "named" and not rivals(diagnosis)


def _chooser(
    rig: HiddenRig, strategy: Strategy, first: Recording
) -> Callable[[Judged], tuple[Maneuver, bool, float] | None]:
    """What gives the next maneuver, whether the arm's own acceleration counts in it, and by how much the room warms."""
    if strategy == "proposed":
        return lambda found: found.proposed()
    rng = np.random.default_rng([*rig.seed, 3, STRATEGIES.index(strategy)])
    duration_s = rig.setting.maneuver.duration_s
    if strategy == "torus":
        return lambda found: (draw_sweep(SWEEPS, duration_s, rng), False, 0.0)
    arm = rig.setting.rig.arm
    assert arm is not None
    assert first.q is not None
    room = Family.of(arm, first.t, first.q)

    def at_random(found: Judged) -> tuple[Maneuver, bool, float]:
        return stops(room, duration_s, RATE_HZ, int(rng.integers(1 << 31)), spread=1.0, held=0.5), False, 0.0

    return at_random


def _step(
    rig: HiddenRig,
    number: int,
    strategy: Strategy,
    step: int,
    minutes: float,
    kind: str,
    diagnosis: Diagnosis,
    ended: str,
) -> Step:
    names = [
        {(cause.effect, cause.where), *((each["effect"], each["where"]) for each in cause.equivalent)}
        for cause in diagnosis.leading
    ]
    names = [each for index, each in enumerate(names) if each not in names[:index]]  # once for all recordings
    effect, where = rig.cause
    return Step(
        rig=number,
        strategy=strategy,
        step=step,
        effect=effect,
        where=where,
        snr=rig.snr,
        alike=len(rig.alike),
        minutes=minutes,
        maneuver=kind,
        verdict=diagnosis.verdict,
        probability=diagnosis.hypotheses[0].probability if diagnosis.hypotheses else 0.0,
        names=sum(map(len, names)),
        said=" with ".join(" or ".join("@".join(label) for label in sorted(each)) for each in names),
        right=len(names) == 1 and rig.cause in names[0],
        ended=ended,
    )
