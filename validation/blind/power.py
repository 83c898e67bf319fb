"""Detection power beside the ideal test: what the diagnosis needs beyond who knows the effect's family.

The ideal test is the likelihood ratio for one candidate of known shape: its statistic is chi-square, with the rank of
the candidate's columns, noncentral by the squared projected signal-to-noise. It is given a false-alarm rate of
one in a hundred recordings over all candidates. Both detection curves are compared where they cross one
half.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2

from rig.effects import Effect
from rig.errors import RigError
from rig.progress import Progress, unheard
from rig.threads import one_blas_thread
from scenarios.loader import load
from scenarios.workers import Workers
from validation.blind.draws import draw_effect
from validation.blind.intervals import Rate
from validation.blind.likeness import columns_at
from validation.blind.settings import Setting, draw_setting
from validation.blind.strength import strength_for

#: So many mean effects and places a sweep of three joints has, about; and how often one of them may be found where
#: nothing is.
_CANDIDATES, _FALSE_ALARMS = 150.0, 0.01


@dataclass(frozen=True)
class PowerStudy:
    """What to simulate.

    Attributes:
        effect, where: of the catalogue, of a shape that needs no search.
        strengths: projected, whitened signal-to-noise.
        draws: recordings for each.
        false_alarm: of the ideal test, for one candidate: one in a hundred recordings over all of them.
        samples: of each recording. seed: of everything random.
    """

    effect: str = "backlash"
    where: str = "joint5"
    strengths: tuple[float, ...] = (2.0, 3.0, 4.0, 5.0, 6.0, 7.0)
    draws: int = 4
    false_alarm: float = _FALSE_ALARMS / _CANDIDATES
    samples: int = 6656
    seed: int = 0
    scenario: str = "ann-arbor"


@dataclass(frozen=True)
class Power:
    """Detection curves.

    Attributes:
        study: what was simulated. rank: of the effect's columns.
        found: detection rate of the diagnosis at each strength. ideal: probability of the ideal test's.
    """

    study: PowerStudy
    rank: int
    found: tuple[Rate, ...]
    ideal: tuple[float, ...]

    @property
    def ideal_half_dB(self) -> float:
        """Signal-to-noise at which the ideal test finds half [dB]."""
        return 20.0 * float(np.log10(half_power(self.rank, self.study.false_alarm)))

    @property
    def loss_dB(self) -> float:
        """How much more signal-to-noise the diagnosis needs to find half [dB]; nan where the curve does not cross."""
        return 20.0 * float(np.log10(crossing(self.study.strengths, [rate.value for rate in self.found]))) - (
            self.ideal_half_dB
        )


def ideal_power(strength: float, rank: int, false_alarm: float) -> float:
    """Probability that the likelihood-ratio test of a known family of columns detects."""
    return float(ncx2.sf(chi2.isf(false_alarm, rank), rank, strength**2))


def half_power(rank: int, false_alarm: float) -> float:
    """Signal-to-noise at which the ideal test detects half."""
    return float(brentq(lambda strength: ideal_power(strength, rank, false_alarm) - 0.5, 0.1, 100.0))


def crossing(strengths: Sequence[float], rates: Sequence[float]) -> float:
    """Where a detection curve crosses one half, by a logistic curve; nan if it does not.

    The slope is the ideal test's near enough: one standard deviation of the statistic a unit of strength. Only the
    position is fitted, by maximum likelihood over a grid.
    """
    if not (min(rates) < 0.5 < max(rates)):
        return float("nan")
    grid = np.linspace(min(strengths), max(strengths), 400)
    at, seen = np.asarray(strengths), np.asarray(rates)
    chance = np.clip(1.0 / (1.0 + np.exp(-1.7 * (at[:, None] - grid))), 1e-9, 1.0 - 1e-9)
    likelihood = (seen[:, None] * np.log(chance) + (1.0 - seen[:, None]) * np.log(1.0 - chance)).sum(axis=0)
    return float(grid[np.argmax(likelihood)])


def power(study: PowerStudy, workers: Workers | None = None, progress: Progress = unheard) -> Power:
    """Simulate and diagnose ``draws`` recordings at every strength.

    Raises:
        RigError: the effect cannot be that strong.
    """
    count = len(study.strengths) * study.draws
    hits = np.zeros(len(study.strengths))
    for done, (number, hit) in enumerate(
        (workers or Workers(0)).completed(partial(_trial, study), range(count)), start=1
    ):
        hits[number // study.draws] += hit
        progress(done / count)
    setting, effect = _drawn(study, study.strengths[0], 0)
    rank = _rank(effect, setting)
    ideal = tuple(ideal_power(strength, rank, study.false_alarm) for strength in study.strengths)
    return Power(study, rank, tuple(Rate(float(each), study.draws) for each in hits), ideal)


def _trial(study: PowerStudy, number: int) -> bool:
    from estimators.gap import diagnose

    draw = number % study.draws
    setting, effect = _drawn(study, study.strengths[number // study.draws], draw)
    rng = np.random.default_rng([study.seed, 2, number])
    with one_blas_thread():
        found = diagnose(setting.record((effect,), rng, "run"), setting.record_locked(rng, "rest"))
    return found.verdict != "no-gap"


def _drawn(study: PowerStudy, strength: float, draw: int) -> tuple[Setting, Effect]:
    rng = np.random.default_rng([study.seed, 1, draw])
    setting = draw_setting(load(study.scenario), study.samples, rng)
    make = draw_effect(study.effect, rng, setting, study.where)
    effect, _ = strength_for(make, strength, setting)
    return setting, effect


def _rank(effect: Effect, setting: Setting) -> int:
    fixed = {key: getattr(effect, key) for key in ("where", *effect.choices())}
    design = setting.projection(columns_at(type(effect), fixed, setting))
    size = np.linalg.norm(design, axis=0)
    if not size.max() > 0.0:
        raise RigError(f"effect {effect.name} at {effect.where}: the calibration takes it up")
    singular = np.linalg.svd(design / np.maximum(size, 1e-300), compute_uv=False)
    return int(np.sum(singular > 1e-6 * singular[0]))
