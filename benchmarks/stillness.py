"""Static detection beside the textbook's, on poses held for ten seconds each with smooth moves between them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

import scenarios
from benchmarks._measure import Call, Cell, Goal, Report, Settings, interleaved, timing_table
from benchmarks.baselines import variance_detector
from estimators.stillness import CAMPS_THRESHOLD_V2, find_still
from rig.arrays import Mask
from rig.channels import ACCELEROMETER
from rig.maneuver import StaticPoses
from rig.recording import Recording

TITLE = "static detection, beside the textbook's"

_WINDOW: Final = 101  # samples: a second
_REST: Final = 900  # samples at the beginning that the textbook detector knows to be at rest
_MULTIPLE: Final = 2.0  # of the variance at rest: well above what chance makes of windows at rest
_LIMIT = "limit: sums and sums of squares"
_LOOP = "textbook detector, window by window"


def run(settings: Settings) -> Report:
    maneuver = StaticPoses(count=101, hold_s=10.0, move_s=6.54)
    base = scenarios.load("ann-arbor").with_acquisition(decimation=1)
    scenario = replace(base, maneuver=maneuver, motion="inertial")
    both = scenario.simulate(settings.seed)
    alone = replace(both, q=None, magnetometer=None, units={ACCELEROMETER: both.unit(ACCELEROMETER)})
    readings = np.ascontiguousarray(alone.readings(ACCELEROMETER))
    columns = np.ascontiguousarray(readings.T)
    truth = maneuver.holding(both.t)
    masks: dict[str, Mask] = {}

    def ours(name: str, recording: Recording, threshold: float | None = None) -> Call:
        def call() -> None:
            masks[name] = find_still(recording, threshold=threshold).still

        return call

    def textbook() -> None:
        masks["textbook detector, all windows at once"] = variance_detector.all_windows_at_once(
            readings, _WINDOW, _REST, _MULTIPLE
        )

    def loop() -> None:
        masks[_LOOP] = variance_detector.window_by_window(readings, _WINDOW, _REST, _MULTIPLE)

    names = [
        "torusrig find_still, accelerometer",
        "torusrig find_still, threshold of Camps et al.",
        "torusrig find_still, both sensors and encoders",
    ]
    calls: dict[str, Call] = {
        names[0]: ours(names[0], alone),
        names[1]: ours(names[1], alone, CAMPS_THRESHOLD_V2),
        names[2]: ours(names[2], both),
        "textbook detector, all windows at once": textbook,
        _LOOP: loop,
        _LIMIT: lambda: (columns.sum(axis=1), np.einsum("cn,cn->c", columns, columns)),
    }
    rounds = settings.rounds_of(11, 2)
    timings = interleaved(calls, rounds, fewer={_LOOP: min(rounds, settings.of(3, 1))})
    judged = {name: _Judged.of(mask, truth, _WINDOW // 2) for name, mask in masks.items()}
    further: dict[str, dict[str, Cell]] = {
        "poses found": {name: result.poses for name, result in judged.items()},
        "of": {name: len(maneuver.angles) for name in judged},
        "moving taken for still [%]": {name: 100.0 * result.moving_as_still for name, result in judged.items()},
        "still given up [%]": {name: 100.0 * result.given_up for name, result in judged.items()},
    }
    table = timing_table(
        f"{len(both):,} samples, {len(maneuver.angles)} poses",
        timings,
        beside=[_LIMIT, _LOOP],
        further=further,
        note="Given up: of the samples at rest that are farther than half a window from a move.",
    )
    goals = tuple(
        Goal(f"{len(both):,} samples, {name.partition(', ')[2]} [ms]", 1e3 * timings[name].median, "at most", 20.0)
        for name in names
    )
    return Report((table,), goals, {table.title: timings})


@dataclass(frozen=True)
class _Judged:
    """A detection against the truth.

    Attributes:
        poses: true poses of which at least half was found still, without a moving one in between counted twice.
        moving_as_still: share of the moving samples. given_up: share of those at rest, away from moves.
    """

    poses: int
    moving_as_still: float
    given_up: float

    @classmethod
    def of(cls, found: Mask, truth: Mask, half: int) -> _Judged:
        edges = np.flatnonzero(np.diff(np.concatenate([[False], truth, [False]]).astype(int)))
        inner = np.zeros_like(truth)
        poses = 0
        for first, stop in edges.reshape(-1, 2):
            inner[first + half : stop - half] = True
            poses += bool(found[first:stop].mean() > 0.5)
        return cls(poses, float(found[~truth].mean()), float(1.0 - found[inner].mean()))
