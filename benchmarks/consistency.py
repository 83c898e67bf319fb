"""A consistency study, beside calling the paper's way for each of its fits.

2,000 draws of the noise at 25 numbers of samples and two noise levels, fitted separately and simultaneously, as Renk et
al. do it once for Figures 3 and 4. Both ways are measured on a part of it, in turns, and extrapolated: the study by its
draws (one block of them is made), the paper's way by its fits (each method once or twice at each number of samples).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from scipy.optimize import minimize

import scenarios
from benchmarks._measure import Column, Goal, Report, Settings, Table, Timing, interleaved
from benchmarks.baselines import papers_way
from rig.arrays import Array
from rig.channels import ACCELEROMETER
from scenarios.studies.consistency import trial
from scenarios.studies.settings import Order, expected, increments, order_of
from scenarios.studies.settings import Settings as Study

TITLE = "2,000 draws x 25 sample counts x 2 noise levels x 2 methods, beside the paper's way"

_DRAWS: Final = 2000
_GOAL: Final = 200.0


def run(settings: Settings) -> Report:
    scenario = scenarios.load("renk2005-table2")
    counts = settings.of(25, 5)
    times: dict[str, Mapping[str, Timing]] = {}
    rows: list[tuple[str | float | None, ...]] = []
    goals: list[Goal] = []
    orders: tuple[Order, ...] = ("every-kth", "first")
    for order in orders:
        study = Study.of(scenario, counts, draws=_DRAWS, orders=(order,), seed=settings.seed)
        fits = len(study.counts) * len(study.noise_factors) * len(study.methods)
        increments(study, order, 0)  # poses and sums: made once a process, in milliseconds
        calls = {"study": lambda study=study: trial(study, 0)}
        chosen = study.counts if not settings.quick else study.counts[-1:]
        for position, count in enumerate(chosen):
            volts, rotations, magnitude = _data(study, order, count, position)
            calls[f"simultaneous, n = {count}"] = lambda v=volts, r=rotations, m=magnitude: papers_way.fit(r, v, m)
            calls[f"separate, n = {count}"] = lambda v=volts, r=rotations, m=magnitude: _separate(r, v, m)
        names = [name for name in calls if name != "study"]
        timings = interleaved(calls, settings.rounds_of(3, 1), dict.fromkeys(names, settings.rounds_of(2, 1)))
        times[order] = timings
        ours = timings["study"].median * study.blocks
        each = [timings[name].median for name in names]
        theirs = float(np.mean(each)) * fits * _DRAWS
        rows.append(
            (
                order,
                fits * _DRAWS,
                ours,
                1e6 * ours / (fits * _DRAWS),
                1e3 * float(np.mean(each)),
                theirs,
                theirs / ours,
            )
        )
        goals.append(
            Goal(f"times as fast as the paper's way for each fit, order {order}", theirs / ours, "at least", _GOAL)
        )
    columns = (
        Column("order", ""),
        Column("fits", ",d"),
        Column("the study [s]", ".3g"),
        Column("a fit [µs]", ".3g"),
        Column("the paper's way, a fit [ms]", ".4g"),
        Column("all fits [s]", ",.0f"),
        Column("times", ",.0f"),
    )
    note = (
        "One process. 'first': the first n samples, as in the paper, of which the fewest hardly tell the parameters, so"
        " that a finer search is made for them; 'every-kth': spread evenly."
    )
    return Report((Table(TITLE, columns, tuple(rows), note),), tuple(goals), times)


def _separate(rotations: Array, readings: Array, magnitude: float) -> list[Array]:
    """Renk (14), three times: six parameters a channel, from the paper's start, as ``papers_way.fit`` does (15)."""

    def found(volts: Array) -> Array:
        def cost(x: Array) -> float:
            axis, field = papers_way.direction(x[0], x[1]), papers_way.direction(x[4], x[5])
            expected_volts = magnitude * x[2] * (np.einsum("i,nij->nj", field, rotations) @ axis) + x[3]
            return float(np.sum((volts - expected_volts) ** 2))

        return np.asarray(minimize(cost, [0.0, 0.0, 1.0, 2.5, 0.5 * np.pi, 0.0], method="BFGS").x)

    return [found(readings[:, k]) for k in range(3)]


def _data(study: Study, order: Order, count: int, seed: int) -> tuple[Array, Array, float]:
    """Readings (n, 3), rotations (n, 3, 3) and the field's magnitude of one draw."""
    poses = expected(study)
    rows = order_of(order, len(poses.rotations), np.random.default_rng(0))[:count]
    noise = poses.noise[ACCELEROMETER] * np.random.default_rng([study.seed, seed]).standard_normal((count, 3))
    volts = poses.readings[ACCELEROMETER][rows] + noise
    return volts, poses.rotations[rows].reshape(-1, 3, 3), poses.truth[ACCELEROMETER].reference_magnitude
