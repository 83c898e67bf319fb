"""The sentences of a diagnosis: true for the recording at hand, and the same wherever they are said."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from diagnosed_recordings import backlash, by_hand, cause, recorded
from shown_diagnoses import SHOWN, TWIN, TWINS, UNITS, read, spoken

from estimators.gap.diagnosis import Channel, Closed, Hypothesis
from estimators.gap.remainder_words import course_words
from rig.maneuver import TorusSweep
from scenarios.gap_report import GapResiduals, diagnosis_tables, gap_residuals
from scenarios.gap_report.advice import next_steps
from scenarios.gap_report.charts import channel_bars, shift_bars
from scenarios.gap_report.html import with_commands
from scenarios.gap_report.maneuver_words import described
from scenarios.gap_report.page import page
from scenarios.gap_report.words import left_words, sentence
from scenarios.shown_units import shown_units


@pytest.fixture(scope="module")
def residuals() -> GapResiduals:
    run, locked = recorded(backlash())
    return gap_residuals(run, by_hand(), locked)


def test_what_is_left_is_said_as_errors_of_the_rig_and_noise_beside_them(residuals: GapResiduals) -> None:
    angle = {"source": "the angle of joint5", "course": "time", "share": 0.2}
    iron = {"source": "the magnetic field along link1", "course": "the recording", "share": 0.04}
    noise = [
        {"source": f"noise of {name} by itself", "course": "2 to 9 Hz", "share": 0.01} for name in ("mag1", "mag2")
    ]
    left = replace(by_hand("partly").remainder, follows=(iron, *noise, angle))
    diagnosis = replace(by_hand("partly"), remainder=left)
    words = (
        "an error of the angle of joint 5 that changes with time (20 % of the squared gap), or an error of the "
        "magnetic field fixed in link 1 that differs between the recordings (4 % of the squared gap)"
    )
    assert left_words(diagnosis).startswith(f"{words}, and noise of mag1 alone, 2 to 9 Hz (1 % of the squared gap) and")
    assert f"acts like {words}" in sentence(diagnosis)
    look, iron_too, channels = (step for step in next_steps(diagnosis) if "what is left" in step or "it also" in step)
    assert look.startswith("Look at joint 5 (its encoder")
    assert iron_too.startswith("Or look for iron")
    assert channels.startswith("Look at the wiring, shielding and supply of mag1 and mag2 while")
    text = read(page(diagnosis, residuals))
    assert "the magnetic field fixed in link 1 the recording 4 %" in text
    assert "noise of mag1 alone 2 to 9 Hz 1 %" in text
    alone = replace(diagnosis, remainder=replace(left, follows=tuple(noise)))
    assert "it acts like noise of mag1 alone" in alone.sentence()


@pytest.mark.parametrize(("closed", "first"), [(0.9, "Repair what is established"), (0.1, "Look at joint 5")])
def test_what_most_of_the_gap_is_comes_first(closed: float, first: str) -> None:
    angle = {"source": "the angle of joint5", "course": "time", "share": 0.8}
    told = by_hand("partly")
    left = replace(told, remainder=replace(told.remainder, follows=(angle,)), closed=Closed(closed, 0.0, 1.0))
    steps = next_steps(left)
    assert steps[0].startswith(first)
    assert sum(step.startswith(("Repair what is established", "Look at joint 5")) for step in steps) == 2


@pytest.mark.parametrize(
    ("course", "at"),
    [
        ("time, once about 1208 s for 5.4 s, at 1.1 Hz", "1208 s"),
        ("time, 4 times, first from 3.2 s for 0.1 s", "3.2 s"),
    ],
)
def test_of_what_passes_it_is_said_when_to_look(course: str, at: str) -> None:
    told = by_hand("unknown")
    knock = {"source": "the offsets of the accelerometer", "course": course, "share": 0.8}
    first, *_ = next_steps(replace(told, remainder=replace(told.remainder, follows=(knock,))))
    assert f"what happened there at {at}, too" in first


@pytest.mark.parametrize(
    ("course", "words"),
    [
        ("time, throughout", "that is constant"),
        ("time, steadily", "that drifts steadily with time"),
        ("time, steadily from a start", "that drifts steadily with time from a start"),
        ("temperature, from a reference", "that changes with temperature, from a reference"),
        ("time, in 1 jumps", "that changes in 1 jump"),
        ("time, in 3 jumps", "that changes in 3 jumps"),
        ("time, in 512 pieces", "that changes with time, 512 times in the recording"),
        ("a sine of 0.5 Hz", "that repeats as a sine of 0.5 Hz"),
        ("level", "that changes with the level of the reading"),
        ("the angle of joint5, once a turn", "that changes with the angle of joint5, once a turn"),
        ("temperature", "that changes with temperature"),
    ],
)
def test_how_an_error_changes_is_said_in_words(course: str, words: str) -> None:
    assert course_words(course) == words


def test_no_gap_says_the_residual_and_what_may_be_there_where_it_is_not_sure(residuals: GapResiduals) -> None:
    sure = SHOWN["no-gap"]
    assert "13.40 mV 1.00 × floor" in read(page(sure, residuals))
    assert "RMS / floor" in spoken(diagnosis_tables(sure, UNITS))
    assert "gap after" not in spoken(diagnosis_tables(sure, UNITS))
    assert "--with" not in page(sure, residuals)  # there is no cause to simulate
    drift = Hypothesis((("bias_warmup", "magnetometer"),), False, 0.3)
    masses = {"nothing": 0.66, "known": 0.33, "other": 0.01}
    unsure = replace(sure, hypotheses=(replace(sure.hypotheses[0], probability=0.66), drift), posterior=masses)
    assert "bias warmup of magnetometer may be there (probability .30)" in next_steps(unsure)[1]
    assert not any("may be there" in step for step in next_steps(sure))
    lacking = {"effect": "pose_noise", "where": "acquisition", "why": "the recording lacks tool poses"}
    assert not any("other joints" in step for step in next_steps(replace(sure, cannot_tell=(lacking,))))


def test_where_no_maneuver_is_proposed_the_advice_in_words_is_a_step() -> None:
    words = "Sweep as fast as the arm may."
    assert words in next_steps(replace(SHOWN["ambiguous"], next={"why": words, "maneuver": None}))[0]
    some = {"maneuver": "another sweep", "why": "It tells.", "cannot_separate": [[[], []]]}
    assert "which tells some of them apart" in next_steps(replace(SHOWN["ambiguous"], next=some))[0]


def test_a_maneuver_that_may_be_too_little_is_said_to_be_one() -> None:
    """A chi-square of 4.4 makes an even chance a probability of .9."""
    step = {"maneuver": "another sweep", "why": "It tells.", "separates": [{"low": 4.5}, {"low": 100.0}]}
    assert "which tells them apart" in next_steps(replace(SHOWN["ambiguous"], next=step))[0]
    step = {**step, "separates": [{"low": 0.0}, {"low": 100.0}]}
    assert "which may tell them apart" in next_steps(replace(SHOWN["ambiguous"], next=step))[0]


def test_named_noise_stays_in_the_residual_and_is_said_to(residuals: GapResiduals) -> None:
    words = "RMS after still has the noise"
    noise = by_hand(causes=(cause("noise_excess", "accel1", extra_sigma=(0.005, 0.0004, "V")),))
    assert words in read(page(noise, residuals))
    assert words not in read(page(by_hand(), residuals))
    assert "``" not in page(
        by_hand(causes=(cause("outliers", "acquisition", share=(1e-3, 1e-4, "relative")),)), residuals
    )


def test_what_does_the_same_is_said_as_one_row_of_names() -> None:
    twins = tuple({**TWIN, "where": where} for where in ("joint2", "joint3"))
    steps = next_steps(by_hand(causes=(replace(TWINS, equivalent=twins),)))
    assert any(
        "joint offset of joint 5, joint offset of joint 2 and joint offset of joint 3." in step for step in steps
    )


def test_a_verdict_beside_a_fitted_rig_says_so(residuals: GapResiduals) -> None:
    row = dict.fromkeys(("noise_floor", "rms_ideal", "gap_ideal", "rms_fitted", "gap_fitted"), 0.01)
    rig = {"name": "improved", "better": False, "why": "it is not", "left": 38.9, "channels": {"accel1": row}}
    named, quiet = (replace(by_hand(verdict), rig=rig) for verdict in ("named", "no-gap"))
    assert "beside the fitted rig improved" in read(page(named, residuals))
    assert "beside the fitted rig improved" in spoken(diagnosis_tables(named, UNITS))
    assert "39 times as large" in spoken(diagnosis_tables(named, UNITS))
    assert next_steps(named)[0].startswith("What is named comes on top of what improved has")
    assert not any("repair it" in step for step in next_steps(named))
    assert next_steps(quiet)[0].startswith("Judge improved by another recording")
    assert next_steps(replace(quiet, rig={**rig, "better": True}))[0].startswith("Use the fitted rig, improved,")


def test_the_sentence_names_the_channels_with_the_largest_gap_only() -> None:
    named = by_hand()
    words = "relative to the noise floor, the gap is largest in"
    assert f"{words} accel1 and accel2; not modelled, it shifts accel1.sensitivity by 12.0 standard" in named.sentence()
    quiet = replace(named.channels["accel2"], gap_before=0.0)
    alone = replace(named, channels={**dict.fromkeys(named.channels, quiet), "mag3": named.channels["mag3"]})
    assert f"{words} mag3;" in alone.sentence()


def test_a_gap_that_grows_is_drawn_within_the_picture_and_written_without_exponents() -> None:
    row = Channel(
        noise_floor=0.0085, rms_before=0.118, gap_before=0.118, rms_after=0.192, gap_after=0.192, closed=-0.46
    )
    drawing = channel_bars(replace(by_hand(), channels={"mag1": row}), shown_units({"magnetometer": "V"}))
    assert "118.00 → 192.00 mV" in drawing  # of 600 samples, to a quarter of a millivolt
    assert "13.9 × floor, −46 % closed" in drawing
    right = max(
        float(x) + float(width) for x, width in re.findall(r'<rect x="([\d.]+)" y="[\d.]+" width="([\d.]+)"', drawing)
    )
    assert right <= 1000.0 - 190.0  # where the values begin


def test_large_shifts_are_written_without_tenths() -> None:
    moved = {"mag2.sensitivity": {"before": 2.4, "after": 1.2, "sigmas": -15422.23}}
    diagnosis = replace(by_hand(), calibration_shift=moved)
    assert "it shifts mag2.sensitivity by 15,422 standard deviations" in sentence(diagnosis)
    assert "mag2.sensitivity by 15,422 standard" in spoken(diagnosis_tables(diagnosis, UNITS))
    assert "+15,422" in shift_bars([("mag2.sensitivity", 15422.23)])
    assert "−29.8" in shift_bars([("mag2.sensitivity", -29.8)])


def test_commands_in_the_advice_stand_apart_and_break_at_no_option() -> None:
    words = with_commands(
        "Diagnose both: rig diagnose RUN NEXT --together. Or rig sweep improved.toml -o AGAIN.parquet."
    )
    assert (
        "<code><span>rig</span> <span>diagnose</span> <span>RUN</span> <span>NEXT</span> <span>--together</span></code>"
        in words
    )
    assert words.endswith("<span>-o</span> <span>AGAIN.parquet</span></code>.")
    assert with_commands("the rig moves & stops") == "the rig moves &amp; stops"


def test_effects_of_the_catalogue_are_written_as_words_wherever_an_error_is_described(residuals: GapResiduals) -> None:
    follows = ({"source": "the strength of bias_step at accel2", "course": "time", "share": 0.2},)
    left = replace(by_hand("unknown").remainder, verdict="structured", follows=follows)
    diagnosis = replace(by_hand("unknown"), remainder=left)
    words = "a bias step of accel2 whose strength changes with time"
    for text in (left_words(diagnosis), read(page(diagnosis, residuals)), spoken(diagnosis_tables(diagnosis, UNITS))):
        assert words in text
        assert "bias_step at" not in text
    assert "the strength of bias step of accel2 time 20 %" in read(page(diagnosis, residuals))


def test_a_maneuver_is_told_in_tenths_of_a_degree() -> None:
    sweep = TorusSweep(yaw_range_deg=339.997, yaw_centre_deg=-0.001, pitch_range_deg=179.996, pitch_centre_deg=-0.002)
    words = described(sweep, 5.0)
    assert words.startswith("joint 1 over 340 deg about 0 in 15 passes, joint 5 over 180 deg about 0 in 7 passes")
    assert "joint 3 at −90," in words
    assert words.endswith("the room 5 °C warmer or colder")
