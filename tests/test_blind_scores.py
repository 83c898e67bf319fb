"""Judging one answer beside the truth: names, probabilities, stated numbers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from blind_answers import answer

from rig.environment import Environment
from rig.errors import RigError
from rig.sensor import TriaxialSensor
from validation.blind.estimates import stated
from validation.blind.floors import Floor
from validation.blind.outcome import judge
from validation.blind.probability import LEAST, Claim, calibration_error, check_answer, claims, proper, reliability
from validation.blind.scoring import withheld_effect
from validation.blind.truth import TrueCause, Truth


def truth_of(*causes: TrueCause, stratum: str = "one") -> Truth:
    sensor = TriaxialSensor((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, -90.0), (0.0, 90.0, 0.0))
    floor = Floor((0.01,) * 6, {})
    return Truth("case000", stratum, (30.0,), causes, (0.01,) * 6, floor, Environment(), sensor, sensor)


BACKLASH = TrueCause(
    "backlash",
    "backlash",
    "joint5",
    30.0,
    30.0,
    twins=(("joint_offset", "joint2"),),
    alike=(("latency", "acquisition"),),
)
WARMUP = TrueCause("bias_warmup", "bias_warmup", "accelerometer", 30.0, 30.0)
OFFSET = TrueCause("joint_offset", "joint_offset", "joint5", 30.0, 30.0)
OUTSIDER = TrueCause("cable_pull", "", "joint5", 30.0, 30.0, twins=(("joint_scale", "joint5"),))


@pytest.mark.parametrize(
    ("truth", "given", "expected"),
    [
        (truth_of(), answer("no-gap"), {"detected": 0.0, "confidently_wrong": 0.0}),
        (truth_of(), answer("named", ("backlash", "joint5")), {"detected": 1.0, "confidently_wrong": 1.0}),
        (truth_of(), answer("unknown", ("backlash", "joint5"), sure=0.6), {"detected": 1.0, "confidently_wrong": 0.0}),
        (truth_of(BACKLASH), answer("named", ("backlash", "joint5")), {"first": 1.0, "in_set": 1.0, "credit": 1.0}),
        (
            truth_of(BACKLASH),
            answer("named", ("backlash", "joint1")),
            {"first": 0.0, "place": 0.0, "confidently_wrong": 1.0},
        ),
        (
            truth_of(BACKLASH),
            answer("named", ("joint_scale", "joint5")),
            {"first": 0.0, "place": 1.0, "confidently_wrong": 1.0},
        ),
        (truth_of(BACKLASH), answer("named", ("joint_offset", "joint2")), {"first": 1.0, "confidently_wrong": 0.0}),
        (
            truth_of(BACKLASH),
            answer("named", ("latency", "acquisition")),
            {"first": 0.0, "in_set": 0.0, "confidently_wrong": 0.0},
        ),
        (
            truth_of(BACKLASH),
            answer("ambiguous", ("joint_scale", "joint5"), equivalent=(("backlash", "joint5"),)),
            {"first": 0.0, "in_set": 1.0, "credit": 0.5, "confidently_wrong": 0.0, "members": 2.0},
        ),
        (
            truth_of(BACKLASH),
            answer("named", ("backlash", "joint5"), ("mains_hum", "acquisition")),
            {"first": 1.0, "in_set": 1.0, "confidently_wrong": 1.0},
        ),
        (
            truth_of(BACKLASH, WARMUP, stratum="two"),
            answer("named", ("backlash", "joint5")),
            {"in_set": 0.0, "credit": 0.5},
        ),
        (
            truth_of(BACKLASH, WARMUP, stratum="two"),
            answer("named", ("backlash", "joint5"), ("bias_warmup", "accelerometer")),
            {"in_set": 1.0, "credit": 1.0},
        ),
        (
            truth_of(WARMUP),
            answer("named", ("bias_random_walk", "accelerometer")),
            {"in_set": 0.0, "confidently_wrong": 0.0},
        ),
        (truth_of(WARMUP), answer("named", ("bias_random_walk", "accel2")), {"confidently_wrong": 0.0}),
        (truth_of(WARMUP), answer("named", ("bias_random_walk", "magnetometer")), {"confidently_wrong": 1.0}),
        (truth_of(OFFSET), answer("named", ("joint_eccentricity", "joint5")), {"confidently_wrong": 0.0}),
        (truth_of(OFFSET), answer("named", ("joint_eccentricity", "joint1")), {"confidently_wrong": 1.0}),
        (truth_of(OUTSIDER, stratum="outside"), answer("named", ("backlash", "joint5")), {"confidently_wrong": 1.0}),
        (
            truth_of(OUTSIDER, stratum="outside"),
            answer("named", ("joint_scale", "joint5")),
            {"first": 0.0, "confidently_wrong": 0.0},
        ),
        (truth_of(OUTSIDER, stratum="outside"), answer("unknown"), {"unknown": 1.0, "confidently_wrong": 0.0}),
        (truth_of(replace(BACKLASH, beyond=2.0)), answer("no-gap"), {"detected": 0.0, "in_set": 0.0}),
        (truth_of(replace(BACKLASH, beyond=2.0)), answer("named", ("backlash", "joint5")), {"confidently_wrong": 0.0}),
    ],
)
def test_judging(truth: Truth, given: dict[str, Any], expected: dict[str, float]) -> None:
    outcome = judge(truth, given)
    assert {name: getattr(outcome, name) for name in expected} == expected


def test_a_withheld_name_is_no_longer_right_but_its_twin_is() -> None:
    truth = truth_of(BACKLASH)
    assert withheld_effect(truth) == "backlash"
    assert judge(truth, answer("named", ("joint_offset", "joint2")), "backlash").first == 1.0
    assert judge(truth, answer("named", ("joint_scale", "joint1")), "backlash").confidently_wrong == 1.0
    assert withheld_effect(truth_of()) == ""
    assert withheld_effect(truth_of(OUTSIDER, stratum="outside")) == ""


def mixed(**probabilities: float) -> dict[str, Any]:
    """An answer to one cause: so much on it alone, with something else, twice itself, on nothing, on else alone."""
    both = [["backlash", "joint5"], ["bias_warmup", "accelerometer"]]
    sets = {
        "alone": ([["backlash", "joint5"]], False),
        "with_other": ([["backlash", "joint5"]], True),
        "both": (both, False),
        "nothing": ([], False),
        "other": ([], True),
        "twin": ([["joint_offset", "joint2"]], False),
        "stray": ([["joint_scale", "joint1"]], False),
    }
    found = answer("partly", ("backlash", "joint5"))
    found["hypotheses"] = [
        {"causes": sets[name][0], "other": sets[name][1], "probability": value} for name, value in probabilities.items()
    ]
    known = sum(value for name, value in probabilities.items() if sets[name][0] and not sets[name][1])
    other = sum(value for name, value in probabilities.items() if sets[name][1])
    found["posterior"] = {"nothing": probabilities.get("nothing", 0.0), "known": known, "other": other}
    return found


@pytest.mark.parametrize(
    ("causes", "stratum", "mass"),
    [
        ((), "none", 0.02),
        ((BACKLASH,), "one", 0.4 + 0.1),  # itself, and a twin in its place
        ((BACKLASH, WARMUP), "two", 0.2),
        ((BACKLASH, replace(WARMUP, beyond=2.0)), "two", 0.4 + 0.1 + 0.2),  # with or without what is too weak
        ((replace(BACKLASH, beyond=2.0),), "one", 0.02 + 0.4 + 0.1),
        ((OUTSIDER,), "outside", 0.15 + 0.1),
        ((BACKLASH, OUTSIDER), "known and outside", 0.15),
        ((BACKLASH,), "form", 0.4 + 0.1 + 0.15 + 0.1),
        ((WARMUP,), "one", 0.0),
    ],
)
def test_the_mass_on_the_truth(causes: tuple[TrueCause, ...], stratum: str, mass: float) -> None:
    given = mixed(alone=0.4, with_other=0.15, both=0.2, nothing=0.02, other=0.1, twin=0.1, stray=0.03)
    found = proper(truth_of(*causes, stratum=stratum), given)
    assert found.mass == pytest.approx(mass)
    assert found.log == pytest.approx(-np.log(max(mass, LEAST)))
    assert found.brier == pytest.approx((1.0 - mass) ** 2)


def test_one_cause_does_not_stand_for_two() -> None:
    """Two steps of one knock: a hypothesis with one of them, or with one of them and a stray, is not the truth."""
    steps = [TrueCause("bias_step", "bias_step", where, 30.0, 30.0) for where in ("mag1", "mag2")]
    given = answer("named", ("bias_step", "mag1"))
    assert proper(truth_of(*steps, stratum="two places"), given).mass == 0.0
    given = answer("named", ("bias_step", "mag1"), ("bias_step", "mag3"))
    assert proper(truth_of(*steps, stratum="two places"), given).mass == 0.0
    given = answer("named", ("bias_step", "mag2"), ("bias_step", "mag1"))
    assert proper(truth_of(*steps, stratum="two places"), given).mass == pytest.approx(0.97)


def test_a_declared_equivalent_is_as_good() -> None:
    given = answer("named", ("joint_scale", "joint5"), equivalent=(("backlash", "joint5"),))
    assert proper(truth_of(BACKLASH), given).mass == pytest.approx(0.97)
    assert proper(truth_of(BACKLASH), answer("named", ("joint_scale", "joint5"))).mass == 0.0


def test_of_a_withheld_effect_something_else_or_a_twin_is_right() -> None:
    given = mixed(alone=0.0, with_other=0.1, other=0.5, twin=0.3, stray=0.1)
    assert proper(truth_of(BACKLASH), given, "backlash").mass == pytest.approx(0.9)
    unknown = answer("unknown")
    assert proper(truth_of(BACKLASH), unknown, "backlash").mass == pytest.approx(0.97)


def test_log_and_brier_are_least_for_who_says_what_he_believes() -> None:
    """Of two explanations true with .7 and .3: the expected score over what is said has its least at .7.

    The Brier score of the mass on the truth alone is proper for two outcomes.
    """
    said = np.linspace(0.05, 0.95, 181)
    for score in ("log", "brier"):
        values = []
        for p in said:
            given = mixed(alone=float(p), stray=1.0 - float(p))
            first = getattr(proper(truth_of(BACKLASH), given), score)
            stray = replace(BACKLASH, effect="joint_scale", where="joint1", twins=())
            second = getattr(proper(truth_of(stray), given), score)
            values.append(0.7 * first + 0.3 * second)
        assert said[int(np.argmin(values))] == pytest.approx(0.7, abs=0.005)


def test_claims_are_what_is_said_with_a_probability() -> None:
    found = list(claims(truth_of(BACKLASH), answer("named", ("backlash", "joint5"), ("mains_hum", "acquisition"))))
    assert {(each.kind, each.true) for each in found} == {
        ("nothing", False),
        ("other", False),
        ("backlash", True),
        ("mains_hum", False),
    }
    outside = list(claims(truth_of(OUTSIDER, stratum="outside"), answer("unknown")))
    assert [(each.kind, each.true) for each in outside] == [("nothing", False), ("other", True)]
    assert not list(claims(truth_of(), {"verdict": "refused", "causes": []}))


def test_calibration_of_honest_claims() -> None:
    """20,000 claims that are so as often as said: each bin's share is within 5 standard deviations, sqrt(.25/1500).

    A failure in a hundred thousand changes of the seed.
    """
    rng = np.random.default_rng(4)
    said = rng.uniform(0.0, 1.0, 20_000)
    honest = [Claim(float(p), bool(true), "x") for p, true in zip(said, rng.uniform(size=20_000) < said, strict=True)]
    width = 5.0 * np.sqrt(0.25 / 1500.0)
    assert all(abs(p - share) < width for p, share, _ in reliability(honest))
    assert sum(count for _, _, count in reliability(honest)) == 20_000
    assert calibration_error(honest) < width
    bold = [Claim(0.99, index % 2 == 0, "x") for index in range(100)]
    assert calibration_error(bold) == pytest.approx(0.49)


def test_stated_numbers_stand_beside_the_true_ones() -> None:
    true = replace(BACKLASH, parameters={"width_rad": 0.01})
    given = answer("named", ("backlash", "joint5"))
    given["causes"][0]["parameters"] = {"width_rad": {"value": 0.0103, "std": 1e-4, "unit": "rad"}}
    (found,) = stated(truth_of(true), given)
    assert found.z == pytest.approx(3.0)
    assert not found.holds
    iron = TrueCause("link_hard_iron", "link_hard_iron", "link5", 9.0, 9.0, parameters={"field": (0.1, 0.2, 0.3)})
    given = answer("named", ("link_hard_iron", "link5"))
    given["causes"][0]["parameters"] = {"field": {"value": [0.1, None, 0.31], "std": [0.1, None, 0.02]}}
    assert [each.z for each in stated(truth_of(iron), given)] == pytest.approx([0.0, 0.5])  # what is not felt: nothing
    assert not list(stated(truth_of(replace(true, name="soft_backlash")), given))


@pytest.mark.parametrize(
    "spoilt", [{"format": "rig-diagnosis/1"}, {"posterior": {"nothing": 1.0}}, {"hypotheses": None}, {"causes": 3}]
)
def test_an_answer_without_a_posterior_is_refused(spoilt: dict[str, Any]) -> None:
    check_answer(answer("no-gap"), "case000")
    with pytest.raises(RigError, match=r"case000: .*expected"):
        check_answer(answer("no-gap") | spoilt, "case000")


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
@pytest.mark.parametrize(("source", "z"), [("mag1", 1.0), ("mag2", -1.0), ("accel3", 1.0)])
def test_of_an_effect_that_is_named_twice_the_copy_with_the_true_names_is_compared(
    order: tuple[int, int], source: str, z: float
) -> None:
    """Two crosstalks into one channel differ by their source; of neither true one the likelier is taken."""

    def copy(name: str, value: float, probability: float) -> dict[str, Any]:
        parameters = {"source": {"value": name, "std": None}, "coefficient": {"value": value, "std": 0.01}}
        return {"effect": "channel_crosstalk", "where": "accel1", "probability": probability, "parameters": parameters}

    parameters = {"source": source, "coefficient": 0.05}
    true = TrueCause("channel_crosstalk", "channel_crosstalk", "accel1", 30.0, 30.0, parameters=parameters)
    copies = [copy("mag1", 0.06, 0.99), copy("mag2", 0.04, 0.96)]
    (found,) = stated(truth_of(true), {"causes": [copies[index] for index in order]})
    assert (found.effect, found.name) == ("channel_crosstalk", "coefficient")
    assert found.z == pytest.approx(z)
