"""A fitted rig judged on recordings: its effects are part of the model, and only a fresh recording calls it better."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_support import SMALL, Rig
from diagnosed_recordings import backlash, only, recorded, scenario, write_small
from scipy.special import chdtrc, chdtri

from estimators.gap.data.basefit import learn_floor, set_up
from estimators.gap.hypotheses.stochastic import known_steps
from estimators.gap.report.fitted_rig import FittedRig, delayed, judged
from rig.effects import Effect, make_effect
from rig.recording import read_recording

#: The chance that a statistical test fails without a reason.
FALSE_FAILURE = 1e-6
#: What is looked for where the answer is about the rig.
FEW = only("backlash", "joint_offset", "joint_scale", "noise_excess")
WRONG = make_effect("joint_offset", {"where": "joint5", "offset_rad": 0.02})


def fitted_to(effect: Effect) -> None:
    """A rig with this effect, as a file."""
    Path("fitted.toml").write_text(scenario().with_effects([effect]).to_toml())


@pytest.mark.parametrize(
    "effect",
    [
        backlash(),
        make_effect("joint_offset", {"where": "joint5", "offset_rad": 0.05}),
        make_effect("base_dipole", {"where": "base", "position_m": (0.6, 0.3, 0.2), "moment": (0.0, 0.02, 0.01)}),
    ],
    ids=lambda effect: effect.name,
)
def test_with_the_true_effect_in_the_model_only_noise_is_left(effect: Effect) -> None:
    run, locked = recorded(effect)
    floor = learn_floor(locked, float(np.median(np.diff(run.t))))
    data = set_up(run, floor, scenario().rig.arm, [effect])
    freedom = data.size - data.absorbed.rank
    # the floor is learned from some 1,400 samples a channel, 3 % of its variance: a chi-square widened by that
    scale = 1.0 + freedom / 1400.0
    assert float(data.whitened @ data.whitened) - freedom < scale**0.5 * (chdtri(freedom, FALSE_FAILURE) - freedom)
    beside = data.change([WRONG])
    pipeline = replace(data.pipeline, effects=(effect, WRONG))
    both = pipeline.carried(data.base, np.random.default_rng(0)).volts
    np.testing.assert_allclose(data.modelled + beside, both, atol=1e-12)
    coarse = data.coarse()
    np.testing.assert_allclose(coarse.residual.mean(axis=0), data.residual.mean(axis=0), atol=1e-3)


def test_known_noise_is_whitened() -> None:
    noise = make_effect("noise_excess", {"where": "mag1", "extra_sigma": 0.03})
    run, locked = recorded(noise)
    data = set_up(run, learn_floor(locked, float(np.median(np.diff(run.t)))), scenario().rig.arm)
    white = data.stepped(known_steps(noise, data))
    for column, each in ((3, white), (4, data)):
        square = float(np.sum(each.channel(each.whitened, column) ** 2))
        # 600 samples against a floor of 1,400: within five standard deviations of sqrt(2/600 + 2/1400)
        assert abs(square / each.count - 1.0) < 5.0 * np.sqrt(2.0 / 600.0 + 2.0 / 1400.0)
    assert chdtrc(data.count, float(np.sum(data.channel(data.whitened, 3) ** 2))) < FALSE_FAILURE


def test_a_rig_is_better_on_a_recording_that_did_not_choose_it(rig: Rig, here: Path) -> None:
    write_small(here, backlash())
    rig.done("diagnose", "run.parquet", "--save-scenario", "fitted.toml", "--out", "o", *FEW)
    run, locked = recorded(backlash(), seed=1)
    run.write("fresh.parquet")
    locked.write("fresh.locked.parquet")
    found = json.loads(
        rig.done("diagnose", "run.parquet", "fresh.parquet", "--rig", "fitted.toml", "--jobs", "1", "--json", *FEW)
    )
    itself, fresh = (each["rig"] for each in found)
    assert itself["chosen_by_this_recording"]
    assert not itself["better"]
    assert "this recording chose the fitted rig" in itself["why"]
    assert fresh["better"]
    assert fresh["effects"] == [["backlash", "joint5"]]
    # A lash of 20 sigma and more, fitted to as many samples: what is left is its error, 1/400 of its square
    assert fresh["left"] < 0.03
    assert fresh["log_likelihood_ratio"] > 100.0
    assert found[1]["verdict"] == "no-gap"
    assert "Against the fitted rig" in Path("diagnosis/fresh.html").read_text()


def test_a_rig_with_a_wrong_cause_is_refused(rig: Rig, here: Path) -> None:
    write_small(here, backlash())
    fitted_to(WRONG)
    shown = rig("diagnose", "run.parquet", "--rig", "fitted.toml", "--save-scenario", "b.toml", *FEW).out
    assert "not called better than the ideal rig" in shown
    found = json.loads(Path("diagnosis/run.diagnosis.json").read_text())
    assert not found["rig"]["better"]
    assert found["verdict"] != "no-gap"
    text = Path("b.toml").read_text()  # the next rig has what was given and what was found beside it
    assert "[[effects.joint_offset]]" in text
    assert read_recording("run.parquet").fingerprint in text


def test_a_rig_without_effects_is_no_fitted_rig(rig: Rig, here: Path) -> None:
    write_small(here)
    Path("plain.toml").write_text(SMALL)
    result = rig("diagnose", "run.parquet", "--rig", "plain.toml")
    assert result.status == 2
    assert result.err == (
        "rig: plain.toml: found no effect, expected a fitted rig, as rig diagnose --save-scenario writes it\n"
    )


def test_an_effect_moves_to_another_clock_and_back() -> None:
    tone = make_effect(
        "mains_hum", {"where": "acquisition", "freq_Hz": 49.3, "amplitude": (0.02,) * 6, "phase_rad": (0.4,) * 6}
    )
    slip = make_effect("mounting_slip", {"where": "mount", "rotation_rad": (0.01, 0.0, 0.0), "at_s": 31.0})
    assert delayed(slip, 100.0).at_s == 131.0  # type: ignore[attr-defined]
    back = delayed(delayed(tone, 12.3), -12.3)
    np.testing.assert_allclose(back.phase_rad, tone.phase_rad, atol=1e-9)  # type: ignore[attr-defined]


def test_a_better_rig_is_likelier_than_chance_allows() -> None:
    """Of the ideal rig's own recordings one in twenty at most is likelier under another rig by the gate's ratio."""
    # Both whitened are of one recording: only the judgement itself is asked, no diagnosis
    from diagnosed_recordings import by_hand

    wins = 0
    effect = make_effect("joint_offset", {"where": "joint5", "offset_rad": 0.004})
    rig = FittedRig("fitted", (effect,))
    quiet = by_hand("no-gap", causes=())
    for seed in range(20):
        run, locked = recorded(seed=seed)
        floor = learn_floor(locked, float(np.median(np.diff(run.t))))
        whitened = [set_up(run, floor, scenario().rig.arm, given) for given in ((), (effect,))]
        wins += judged(rig, run, quiet, *whitened, ())["better"]
    # binomial(20, 1/20): more than 6 of 20 come once in 25,000 runs
    assert wins <= 6
