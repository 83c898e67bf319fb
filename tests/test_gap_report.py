"""The report of a diagnosis: residuals, spectra, maps and the page."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from diagnosed_recordings import backlash, by_hand, cause, recorded
from shown_diagnoses import SHOWN, UNITS, read, spoken

from estimators.gap import Diagnosis, Estimate
from estimators.gap.choices import choice_words
from estimators.gap.data.projection import Basis
from estimators.gap.diagnosis import Hypothesis, verdict_of
from estimators.gap.report.closure import elsewhere
from estimators.gap.share_words import chance
from rig.arm import Arm
from rig.effects import make_effect
from rig.pose_nodes import quaternions
from rig.recording import Recording
from scenarios.gap_report import GapResiduals, diagnosis_tables, gap_residuals
from scenarios.gap_report.advice import next_steps
from scenarios.gap_report.gap_residuals import diagnosed_effects
from scenarios.gap_report.maps import axis_pairs
from scenarios.gap_report.page import page
from scenarios.gap_report.words import (
    VERDICTS,
    apart_words,
    cause_title,
    estimate_for_people,
    estimate_words,
    headline,
    share_words,
)
from scenarios.terminal.tables import show

#: Two readings of the same voltage differ by the converter's rounding: sqrt(2) 1.2207 mV / sqrt(12).
ROUNDING_V = np.sqrt(2.0 / 12.0) * 20.0 / 2**14


@pytest.fixture(scope="module")
def small() -> tuple[Recording, Recording]:
    return recorded(backlash())


@pytest.fixture(scope="module")
def residuals(small: tuple[Recording, Recording]) -> GapResiduals:
    return gap_residuals(small[0], by_hand(), small[1])


def test_modelled_causes_leave_what_the_same_noise_leaves_without_them(residuals: GapResiduals) -> None:
    clean, locked = recorded()  # the same seed: the same noise
    nothing = gap_residuals(clean, by_hand("no-gap", causes=()), locked)
    assert nothing.after is None
    assert nothing.white_after is None
    assert residuals.after is not None
    # At rest and at a reversal the encoder, read every 0.1 s, and the simulator, stepped every 0.01 s, differ about the
    # direction of travel.
    slow = np.abs(np.gradient(residuals.recording.q[:, 4])) < 0.02  # type: ignore[index]
    away = ~slow & (np.arange(len(clean)) > 0)
    assert away.mean() > 0.9
    gap = np.sqrt(np.mean((residuals.before - nothing.before)[away] ** 2, axis=0))
    missed = np.sqrt(np.mean((residuals.after - nothing.before)[away] ** 2, axis=0))
    assert (gap > 20.0 * ROUNDING_V).all()
    assert (missed < ROUNDING_V + 0.02 * gap).all(), (missed, gap)  # those samples move the calibration a little


def test_whitened_residuals_are_white_only_once_the_cause_is_modelled(residuals: GapResiduals) -> None:
    assert residuals.white_after is not None
    count = residuals.white_after.size
    # The 600 samples fluctuate, and so does the floor of about 1,400; 28 parameters are fitted. Six standard deviations
    # of a mean square: a failure in 1e9 runs of other seeds.
    width = 6.0 * np.sqrt(2.0 / count * (1.0 + 600.0 / 1400.0)) + 28.0 / count
    assert abs(float(np.mean(residuals.white_after**2)) - 1.0) < width
    assert float(np.mean(residuals.white_before**2)) > 1.0 + 3.0 * width


def test_named_noise_is_whitened_and_defects_are_left_out() -> None:
    noisy = make_effect("noise_excess", {"where": "mag2", "extra_sigma": 0.03})
    spikes = make_effect("outliers", {"where": "acquisition", "share": 0.003})
    run, locked = recorded(noisy, spikes)
    causes = (
        cause("noise_excess", "mag2", extra_sigma=(0.03, 0.001, "V")),
        cause("outliers", "acquisition", share=(0.003, 0.001, "relative")),
    )
    found = gap_residuals(run, by_hand(causes=causes), locked)
    assert found.white_after is not None
    spiked = np.abs(found.before) > 0.3  # half a volt off, where the noise has 0.03 V
    assert spiked.sum() >= 3
    # one alone in the channel whose noise is raised may be the tail of that noise
    assert found.left_out[spiked].sum() >= spiked.sum() - 1
    assert found.left_out.sum() <= spiked.sum() + 2
    quiet = ~(found.left_out | spiked)[:, 4]
    mean_square = float(np.mean(found.white_after[quiet, 4] ** 2))
    assert abs(mean_square - 1.0) < 6.0 * np.sqrt(2.0 / 600.0)  # fitted: nearer than that
    assert float(np.mean(found.white_before[quiet, 4] ** 2)) > 3.0


@pytest.mark.parametrize(("size", "there", "low", "high"), [(1.0, 1, 0, 8), (3.0, 1, 0, 20), (8.0, 0, 980, 1000)])
def test_a_cause_that_hardly_shows_elsewhere_is_not_said_to_be_absent(
    size: float, there: int, low: int, high: int
) -> None:
    """Of 1,000 draws of a signal-to-noise: expected .3, 6.5 and 1,000 of them; outside the bounds once in 10,000."""
    rng, count = np.random.default_rng(0), 500
    change = np.zeros(count)
    change[0] = size
    data = SimpleNamespace(absorbed=Basis((), count), size=count, whiten=lambda values: values)
    found = 0
    for _ in range(1000):
        data.whitened = rng.standard_normal(count) + there * change
        share = elsewhere(data, change)  # type: ignore[arg-type]
        found += share is not None and share < 0.0
    assert low <= found <= high


def test_causes_become_effects_with_vectors_and_names() -> None:
    causes = (
        cause("mounting_slip", "mount", rotation_rad=((1e-3, 0.0, 2e-3), (1e-4,) * 3, "rad"), at_s=(31.0, None, "s")),
        cause("channel_crosstalk", "mag1", source=("accel3", None, "name"), coefficient=(0.01, 1e-3, "relative")),
    )
    slip, crosstalk = diagnosed_effects(by_hand(causes=causes))
    assert slip == make_effect("mounting_slip", {"where": "mount", "rotation_rad": (1e-3, 0.0, 2e-3), "at_s": 31.0})
    assert crosstalk == make_effect("channel_crosstalk", {"where": "mag1", "source": "accel3", "coefficient": 0.01})


def test_values_that_no_effect_can_have_are_moved_to_their_bounds() -> None:
    (clipped,) = diagnosed_effects(by_hand(causes=(cause("saturation", "accel1", level=(1e13, 1.0, "V")),)))
    assert clipped == make_effect("saturation", {"where": "accel1", "level": 1e12})


def test_axes_of_maps_part_the_directions_of_travel(residuals: GapResiduals) -> None:
    (roll, pitch), (yaw, flat) = axis_pairs(residuals)
    assert (roll.name, pitch.name, yaw.name, flat.name) == ("q6", "q5", "q1", "q5")
    assert pitch.folded
    assert yaw.folded
    assert not flat.folded
    q5 = residuals.recording.q[:, 4]  # type: ignore[index]
    away = np.abs(np.gradient(q5)) > 0.02
    assert away.mean() > 0.9
    assert ((pitch.place < 0.5) == (np.gradient(q5) > 0))[away].all()
    for axis in (roll, pitch, yaw, flat):
        assert axis.place.min() >= 0.0
        assert axis.place.max() <= 1.0


@pytest.mark.parametrize("case", SHOWN)
def test_the_page_is_whole_and_needs_nothing_else(case: str, small: tuple[Recording, Recording]) -> None:
    diagnosis = SHOWN[case]
    text = page(diagnosis, gap_residuals(small[0], diagnosis, small[1]))
    assert text.startswith("<!DOCTYPE html>")
    assert "<script" not in text
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:|#)""", text)
    assert not re.search(r"url\((?!#)|@import|https?://(?!www\.w3\.org/(?:2000/svg|1999/xlink))", text)
    assert "default-src 'none'" in text
    drawings = re.findall(r"<svg.*?</svg>", text, flags=re.DOTALL)
    assert len(drawings) >= 4
    for drawing in drawings:
        root = ElementTree.fromstring(drawing)  # well formed
        assert root.attrib["aria-label"]
        numbers = [float(x) for x in re.findall(r' (?:x|y|x1|x2|y1|y2|width|height)="([^"]*?)(?:pt)?"', drawing)]
        assert np.isfinite(numbers).all()
    assert "nan" not in re.sub(r'"data:[^"]*"', "", text)
    for tag in ("main", "section", "figure", "table", "dl", "div", "h1", "h2", "h3", "p", "ul"):
        assert len(re.findall(rf"<{tag}[ >]", text)) == text.count(f"</{tag}>"), tag


@pytest.mark.parametrize("case", SHOWN)
def test_page_terminal_and_json_say_the_same(case: str, residuals: GapResiduals) -> None:
    diagnosis = SHOWN[case]
    document = json.loads(json.dumps(diagnosis.to_json(), allow_nan=False))
    said = {"terminal": spoken(diagnosis_tables(diagnosis, UNITS)), "page": read(page(diagnosis, residuals))}
    assert document["verdict"] == verdict_of(diagnosis.posterior, diagnosis.hypotheses, diagnosis.causes)
    assert sum(document["posterior"].values()) == pytest.approx(1.0)
    assert sum(one["probability"] for one in document["hypotheses"]) + document["omitted"] == pytest.approx(1.0)
    expected = [document["recordings"][0], "What to do next", *next_steps(diagnosis)]
    expected += [chance(share) for share in document["posterior"].values()]
    expected += [cause_title(*cause) for one in document["hypotheses"][:5] for cause in one["causes"]]
    expected += [chance(one["probability"]) for one in document["hypotheses"][:5]]
    expected += [cause_title(each["effect"], each["where"]) for one in document["causes"] for each in one["equivalent"]]
    expected += [chance(cause["probability"]) for cause in document["causes"]]
    expected += [f"{left['source']}" for left in document["remainder"]["follows"]]
    expected += [f"up to {document['remainder']['could_hide_snr']:.2g}"]
    if document["closed"]["value"] is not None:
        expected.append(share_words(diagnosis.closed))
    for where, text in said.items():
        for words in expected:
            assert words.lower() in text.lower(), (where, words)
        assert VERDICTS[document["verdict"]].lower() in text.lower()
        if document["remainder"]["verdict"] == "structured":
            assert "nothing is left above" not in text
            assert "nothing seen above" not in text
        if document["closed"]["value"] is None:
            assert "squared gap, judged on" not in text
        if document["verdict"] not in ("named", "ambiguous"):
            assert "--save-scenario" not in text
        for other, words in VERDICTS.items():
            assert other == document["verdict"] or not re.search(rf"\b{words} ({diagnosis.samples}|Of)", text)


@pytest.mark.parametrize("case", SHOWN)
def test_there_is_something_to_do_after_every_verdict(case: str) -> None:
    steps = next_steps(SHOWN[case])
    assert steps
    assert len(set(steps)) == len(steps)
    for step in steps:
        assert step.endswith(".")
        assert "{" not in step
    assert any("at rest" in step for step in steps) == (SHOWN[case].floor != "locked recording")


def test_the_page_says_what_the_diagnosis_says(residuals: GapResiduals) -> None:
    text = read(page(by_hand(), residuals, without=("latency",)))
    for words in ("Backlash of joint 5", "2.865 ± 0.023 deg", "97 %", "95–99", "direction of joint 5"):
        assert words in text, words
    assert "joint_offset (joint6)" in text
    assert "without latency in the catalogue" in text
    assert "accel1.sensitivity" in text
    assert "mag1.offset" not in text  # a tenth of a sigma is not worth a line
    ambiguous = read(page(SHOWN["ambiguous"], residuals))
    assert "Joint offset of joint 5 or joint offset of joint 2" in ambiguous
    unknown = read(page(by_hand("unknown"), residuals))
    assert "More than noise." in unknown
    assert "a turn of the tool time 10 %" in unknown
    assert "the mount of the sensors" in unknown
    many = read(page(SHOWN["unknown, many fit"], residuals))
    assert "not felt" in many
    assert "not in this maneuver" in many
    assert "possible, not in the likeliest explanation" in many


def test_the_next_maneuver_is_shown_with_what_it_promises(residuals: GapResiduals) -> None:
    one, other = ([{"effect": "joint_offset", "where": where}] for where in ("joint4", "joint5"))
    known = {"truth": one, "rival": other, "chi_square": 930.2, "low": 749.0, "high": 1111.0, "recorded_maneuver": 0.0}
    step = {"why": "q3 <tells> them apart", "maneuver": "joint 2 over 60 deg", "scenario": "small.next.toml"}
    step["separates"] = [known, {**known, "truth": other, "rival": one, "high": None}]  # type: ignore[assignment]
    text = page(replace(by_hand(), next=step), residuals)
    assert "q3 &lt;tells&gt; them apart" in text
    assert "Joint 2 over 60 deg" in text
    assert "rig sweep small.next.toml" in text
    assert "930 (749–1111)" in text
    assert "at least 749" in text


def test_a_hostile_name_stays_text(residuals: GapResiduals) -> None:
    text = page(by_hand(name="<script>alert(1)</script>"), residuals)
    assert "<script" not in text
    assert "&lt;script&gt;" in text


def test_one_sensor_and_tool_poses_have_a_page_too(small: tuple[Recording, Recording]) -> None:
    run, locked = small
    poses = Arm.a465().poses(run.q)  # type: ignore[arg-type]
    quaternion = quaternions(poses.R_base_tool)
    tool = replace(run, q=None, tool_quaternion=quaternion, tool_position=poses.position)
    alone = replace(run, magnetometer=None, units={"accelerometer": "V"})
    slip = cause("bias_step", "accel1", volts=(0.01, 1e-3, "V"), at_s=(31.0, None, "s"))
    full = by_hand(causes=(slip,))
    half = replace(full, channels={name: full.channels[name] for name in ("accel1", "accel2", "accel3")})
    assert "azimuth of the vertical in the tool" in page(full, gap_residuals(tool, full, locked))
    text = page(half, gap_residuals(alone, half, locked))
    assert "accel3" in text
    assert ">mag1<" not in text


@pytest.mark.parametrize(
    ("estimate", "own", "people"),
    [
        (Estimate(0.05, 0.0004, "rad"), "0.05000 ± 0.00040 rad", "2.865 ± 0.023 deg"),
        (Estimate(0.003, 0.001, "relative"), "0.0030 ± 0.0010", "0.30 ± 0.10 %"),
        (Estimate(-0.5, None, "s"), "−0.5 s", ""),
        (Estimate("accel3", None, "name"), "accel3", ""),
        (
            Estimate((1e-3, -2e-3), (1e-4, 1e-4), "V"),
            "(0.00100 ± 0.00010, −0.00200 ± 0.00010) V",
            "(1.00 ± 0.10, −2.00 ± 0.10) mV",
        ),
        (Estimate((3.0, 4.0) * 5, (0.1,) * 10, "1/m"), "10 numbers, RMS 3.54 1/m", ""),
        (Estimate(2.0, 0.0, "Hz"), "2 Hz as sampled", ""),
        (Estimate(0.01, 0.001, "m^3"), "0.0100 ± 0.0010 m³", ""),
        (Estimate(None, None, "rad", "why"), "not felt", ""),
        (Estimate((None, None), (None, None), "V", "why"), "not felt", ""),
        (
            Estimate((1e-3, None), (1e-4, None), "V", "why"),
            "(0.00100 ± 0.00010, not felt) V",
            "(1.00 ± 0.10, not felt) mV",
        ),
        (Estimate((3.0, None) * 5, (0.1, None) * 5, "1/m", "why"), "10 numbers, RMS 3 1/m, 5 of them not felt", ""),
        (
            Estimate((3e-3, None) * 5, (1e-3, None) * 5, "V", "why"),
            "10 numbers, RMS 0.003 V, 5 of them not felt",
            "RMS 3 mV",
        ),
    ],
)
def test_estimates_in_words(estimate: Estimate, own: str, people: str) -> None:
    assert estimate_words(estimate) == own
    assert estimate_for_people(estimate) == people


def test_titles_and_headlines() -> None:
    assert cause_title("backlash", "joint5") == "backlash of joint 5"
    assert cause_title("field_gradient", "base") == "field gradient"  # it has no other place
    assert share_words(by_hand().closed) == "97 % (95–99)"
    assert headline(SHOWN["named"]) == "Backlash of joint 5, width 2.865 ± 0.023 deg"
    twins = "Either joint offset of joint 5 (.68; offset 0.5730 ± 0.0057 deg) or joint offset of joint 2 (.30)"
    assert headline(SHOWN["named with a twin"]) == twins
    assert headline(SHOWN["ambiguous"]) == "Joint offset of joint 5 or joint offset of joint 2"
    assert headline(SHOWN["partly"]).startswith("Backlash of joint 5, width 2.865 ± 0.023 deg, and something outside")
    assert headline(SHOWN["partly, many fit"]).endswith(" deg, and perhaps more")
    assert headline(SHOWN["unknown"]) == "Something outside the catalogue"
    assert headline(SHOWN["unknown, many fit"]) == "No explanation stands out"
    assert headline(SHOWN["unknown, one is likely"]) == "Link soft iron of link 4 is likely, but not certain"
    assert headline(SHOWN["no-gap"]).startswith("No gap")


def test_only_the_likeliest_explanation_is_simulated() -> None:
    many = SHOWN["unknown, many fit"]
    assert len(many.causes) == 2
    assert diagnosed_effects(many) == (
        make_effect("link_soft_iron", {"where": "link4", "chi": (0.01, 0.0, 0.02, 0.0, 0.0, 0.03)}),
    )
    alone = replace(many, hypotheses=(Hypothesis((("backlash", "joint1"),), False, 0.5),))
    assert diagnosed_effects(alone) == (make_effect("backlash", {"where": "joint1"}),)  # not felt: neutral
    twice = by_hand(causes=(cause("bias_step", "mag1", volts=(0.1, 0.1, "V")),) * 2)
    assert len(diagnosed_effects(twice)) == 2


@pytest.mark.parametrize("case", SHOWN)
def test_tables_of_the_terminal(case: str, capsys: pytest.CaptureFixture[str]) -> None:
    diagnosis: Diagnosis = SHOWN[case]
    show(diagnosis_tables(diagnosis, {"accelerometer": "V", "magnetometer": "V"}))
    text = capsys.readouterr().out
    assert "accel1" in text
    assert "joint_offset (joint6)" in text
    assert "small" in text
    assert "What to do next" in text


def test_what_all_explanations_have_is_said_once_and_may_be_repaired() -> None:
    sure, one, other = ("scale_cubic", "mag3"), ("bias_step", "mag1"), ("bias_warmup", "accelerometer")
    causes = tuple(cause(*each, probability=share) for each, share in ((sure, 0.99), (one, 0.6)))
    diagnosis = by_hand("ambiguous", causes, rivals=((sure, other),))
    assert headline(diagnosis) == "Scale cubic of mag3 with bias step of mag1 or with bias warmup of accelerometer"
    listed = "scale_cubic of mag3 with bias_step of mag1 (.60) or with bias_warmup of accelerometer (.38)"
    assert listed in diagnosis.sentence()
    shared = "Repair only what the two likeliest explanations by known causes all have (scale cubic of mag3):"
    assert next_steps(diagnosis)[0].startswith(shared)  # a third, less likely, may lack it
    assert next_steps(SHOWN["ambiguous"])[0].startswith("Do not repair anything yet")
    assert apart_words((sure, one), (sure, other)) == ("bias step of mag1", "bias warmup of accelerometer")
    assert apart_words((sure, one), (sure,)) == ("scale cubic of mag3 and bias step of mag1", "scale cubic of mag3")
    assert choice_words([(sure,), (sure, one)]) == "scale_cubic of mag3 alone or with bias_step of mag1"
