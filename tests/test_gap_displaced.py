"""Causes that something without a name is instead of, several at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from diagnosed_recordings import scenario as small
from whitened_examples import SHAKING

from estimators.gap.data.basefit import posed, set_up
from estimators.gap.data.laid_out import floor_and_step
from estimators.gap.evidence.discrepancy import Discrepancies, total, weighed
from estimators.gap.hypotheses.candidates import all_candidates
from estimators.gap.hypotheses.considered import set_prior
from estimators.gap.hypotheses.prior import OTHER
from estimators.gap.hypotheses.scan import Scanner
from estimators.gap.search.beam import Search
from estimators.gap.search.displaced import displaced
from estimators.gap.search.explanation import Key
from rig.effects import Effect, make_effect

SLIP, TONE = "mounting_slip@mount", "vibration@accelerometer/tool"


def slip(turn: Sequence[float], at: float) -> Effect:
    """At a share of the recording."""
    return make_effect("mounting_slip", {"where": "mount", "rotation_rad": tuple(turn), "at_s": 59.9 * at})


def found(seed: int, *slips: Effect) -> tuple[Key, list[tuple[Key, float]]]:
    """The likeliest set of slips and tones beside a tone, what is left where several are dropped together, and how much
    likelier that is beside something without a name."""
    run, arm = posed(small().with_effects([SHAKING, *slips]).simulate(seed), None)
    data = set_up(run, floor_and_step(run, small().simulate_locked(seed), arm)[0], arm)
    candidates = [each for each in all_candidates(data) if each.label in (SLIP, TONE)]
    scanner = Scanner.of(data)
    search = Search(scanner, candidates, set_prior(candidates, {}, data, {}))
    (leading, *_) = search.run()
    every = Discrepancies.of(scanner.fine.data, scanner.rough.data)
    rests = [search.fine(rest, search.fitted(rest)) for rest in displaced(leading, search.without_one(leading), every)]
    gains = [total([term.log_mass for term in weighed(rest.linear, every)]) for rest in rests]
    masses = [rest.log_mass + gain + float(np.log(OTHER)) for rest, gain in zip(rests, gains, strict=True)]
    return leading.key, [(rest.key, mass - leading.log_mass) for rest, mass in zip(rests, masses, strict=True)]


def test_a_mount_that_creeps_is_in_the_place_of_all_slips_and_not_of_a_tone() -> None:
    """A smooth turn of a hundredth of a radian, in sixty small steps: the search finds five slips or more in its
    place, in both draws tried."""
    instants = np.linspace(0.01, 0.99, 60)
    for seed in range(2):
        phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, 3)
        path = 0.01 * np.sin(2.0 * np.pi * np.outer(instants, [1.0, 1.7, 2.4]) + phases)
        turns = zip(np.diff(path, axis=0).tolist(), instants[1:].tolist(), strict=True)
        leading, rests = found(seed, *(slip(turn, at) for turn, at in turns))
        assert leading.count(SLIP) >= 5
        (likeliest, gained), *_ = rests
        assert likeliest == tuple(label for label in leading if label != SLIP)
        assert gained > 50.0


def test_causes_that_are_there_stay() -> None:
    """Two slips of a hundredth and more of a radian: whatever is dropped, no course makes up for it. Three draws of
    three."""
    for seed in range(3):
        leading, rests = found(seed, slip((0.02, 0.0, 0.01), 0.3), slip((-0.01, 0.02, 0.0), 0.7))
        assert leading == (SLIP, SLIP, TONE)
        assert all(gained < -20.0 for _, gained in rests)
