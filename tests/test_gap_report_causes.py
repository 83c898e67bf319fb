"""How causes and explanations are told: with what does the same, with every rival, with sizes that have names."""

from __future__ import annotations

from dataclasses import replace

import pytest
from diagnosed_recordings import backlash, by_hand, cause, recorded
from shown_diagnoses import SHOWN, UNITS, read, spoken

from estimators.gap.choices import and_words, cause_names, plural
from estimators.gap.diagnosis import INFORMATIVE, Hypothesis, OneOf
from estimators.gap.parameter_words import parameter_name, told_parameters
from estimators.gap.remainder_words import noise_and_bands
from rig.effects import EFFECTS
from scenarios.cli.diagnose import _calibrated
from scenarios.gap_report import GapResiduals, diagnosis_tables, gap_residuals
from scenarios.gap_report.advice import next_steps
from scenarios.gap_report.page import page
from scenarios.gap_report.words import (
    cause_words,
    consequences,
    explanation_words,
    formula,
    headline,
    left_words,
    noise_words,
    one_of_words,
    sentence,
)

MOTOR = cause(
    "motor_current_field",
    "joint6",
    ({"effect": "link_hard_iron", "where": "link5", "probability": 0.49},),
    probability=0.98,
    field=((-1e-3, -0.02, None), (2e-4, 2e-4, None), "relative"),
)
ROCKING = cause("base_rocking", "base", tilt_rad=(0.0014, 0.0002, "rad"), phase_rad=(0.3, 0.07, "rad"))
STEPS = tuple(
    cause("bias_step", "mag2", volts=(volts, 2e-4, "V"), at_s=(at_s, 2.0, "s"))
    for volts, at_s in ((-0.0015, 1341.0), (0.004, 400.0))
)


@pytest.fixture(scope="module")
def residuals() -> GapResiduals:
    run, locked = recorded(backlash())
    return gap_residuals(run, by_hand(), locked)


def told(diagnosis: object, residuals: GapResiduals) -> tuple[str, str]:
    """What the terminal and the page say."""
    return spoken(diagnosis_tables(diagnosis, UNITS)), read(page(diagnosis, residuals))  # type: ignore[arg-type]


def test_the_lead_begins_after_the_causes_whatever_these_are_called(residuals: GapResiduals) -> None:
    """The names of what does the same, and their sizes, hold brackets, stops and conjunctions of their own."""
    diagnosis = by_hand(causes=(MOTOR, ROCKING))
    assert consequences(diagnosis).startswith("Closes 97 % (95–99) of the squared gap; ")
    assert consequences(diagnosis) in read(page(diagnosis, residuals))
    assert sentence(diagnosis).endswith(f"probability .93: c{consequences(diagnosis)[1:]}")
    assert consequences(by_hand("unknown")) == sentence(by_hand("unknown"))


def test_each_of_what_does_the_same_has_its_own_probability(residuals: GapResiduals) -> None:
    either = "either motor current field of joint 6 (.49) or link hard iron of link 5 (.49)"
    diagnosis = by_hand(causes=(MOTOR, ROCKING))
    assert explanation_words(diagnosis.hypotheses[0], diagnosis.causes) == f"{either}, and base rocking"
    assert headline(diagnosis).startswith(f"E{either[1:]}, and base rocking (tilt ")
    for text in told(diagnosis, residuals):
        assert text.lower().count(either) >= 3  # in the sentence or headline, of the explanation, of the cause
        assert "established, as one of these" in text
    (found,) = (each for each in diagnosis.to_json()["causes"] if each["effect"] == "motor_current_field")
    assert found["probability"] == 0.98  # the file's contract: of all that do the same
    many = tuple({"effect": "link_hard_iron", "where": f"link{n}", "probability": 0.1} for n in range(1, 6))
    words = cause_words(replace(MOTOR, equivalent=many))
    assert words == "motor current field of joint 6"
    words = explanation_words(diagnosis.hypotheses[0], (replace(MOTOR, equivalent=many),))
    assert "link hard iron of link 2 (.10) or one of 3 others (.30), and" in words


def test_of_what_one_at_least_is_there_is_not_said_to_be_there_and_not(residuals: GapResiduals) -> None:
    group = OneOf((("joint_offset", "joint5"), ("axis_misalignment", "joint1")), 0.99)
    diagnosis = replace(by_hand("unknown"), at_least_one=(group,))
    words = "at least one of joint offset of joint 5 and axis misalignment of joint 1 is there"
    assert one_of_words(diagnosis) == [f"{words}, probability .99"]
    assert words in sentence(diagnosis)
    assert f"{words}, but which is not known; any single one may stand in for" in next_steps(diagnosis)[-1]
    assert "they may stand in for" in next_steps(by_hand("unknown"))[-1]
    either = replace(by_hand(causes=(MOTOR,)), at_least_one=(OneOf((("motor_current_field", "joint6"),), 0.98),))
    assert "of either motor current field of joint 6 (.49) or link hard iron" in one_of_words(either)[0]
    assert "None of these causes is established." in told(diagnosis, residuals)[1]
    assert "Trust those causes only that are established." in told(by_hand("partly"), residuals)[1]


def test_no_likelier_explanation_is_left_out_of_a_sentence() -> None:
    """Of every kind: causes alone, with something outside the catalogue, that alone, and none at all."""
    scale, lag = (("joint_scale", "joint6"),), (("sensor_lag", "magnetometer"),)
    sets = (Hypothesis(scale, False, 0.82), Hypothesis((), True, 0.16), Hypothesis(lag, False, 0.01))
    masses = {"nothing": 0.0, "known": 0.84, "other": 0.16}
    likely = replace(SHOWN["unknown, one is likely"], hypotheses=sets, posterior=masses)
    words = (
        "Joint scale of joint 6 (.82) is likely, but not certain: something outside the catalogue (.16) may be there"
    )
    assert sentence(likely) == f"{words} instead."
    assert [step for step in next_steps(likely) if "joint scale of joint 6 is likely, but not certain" in step]
    assert not any("stands out" in step for step in next_steps(likely))
    open_sets = (Hypothesis(scale, False, 0.42), Hypothesis((), True, 0.2), Hypothesis(scale, True, 0.17))
    many = replace(likely, hypotheses=(*open_sets, Hypothesis(lag, False, 0.16), Hypothesis((), False, 0.03)))
    assert sentence(many) == (
        "No explanation stands out: joint scale of joint 6 (.42) or something outside the catalogue (.20) or joint "
        "scale of joint 6 and something outside the catalogue (.17) or sensor lag of magnetometer (.16)."
    )
    drive = cause("harmonic_drive_error", "joint6", amplitude_rad=(1e-3, 1e-4, "rad"))
    partly = by_hand("partly", (drive,), other=False)
    beside = replace(partly.hypotheses[0], other=True, probability=0.3)
    partly = replace(partly, hypotheses=(partly.hypotheses[0], beside))
    assert (
        "open: harmonic drive error of joint 6 alone (.50) or with something outside the catalogue (.30)"
    ) in sentence(partly)


@pytest.mark.parametrize("case", ["unknown", "unknown, many fit", "unknown, one is likely"])
def test_nothing_invites_to_simulate_what_is_unknown(case: str, residuals: GapResiduals) -> None:
    assert "--with" not in told(SHOWN[case], residuals)[1]
    assert "improved rig" not in told(SHOWN[case], residuals)[1]
    assert "in place, for rig apply" not in _calibrated(SHOWN[case])
    assert "covariance is over all explanations" in _calibrated(SHOWN[case])
    assert _calibrated(SHOWN["named"]) == "the calibration with the causes in place, for rig apply"
    assert _calibrated(SHOWN["no-gap"]) == "the calibration, for rig apply"


def test_an_effect_that_is_there_twice_is_counted(residuals: GapResiduals) -> None:
    diagnosis = by_hand(causes=STEPS)
    assert headline(diagnosis) == (
        "Two bias steps of mag2 (jump −1.50 ± 0.20 mV at 1341.0 ± 2.0 s; jump 4.00 ± 0.20 mV at 400.0 ± 2.0 s)"
    )
    assert "two bias_steps of mag2" in diagnosis.sentence()
    for text in told(diagnosis, residuals):
        assert "two bias steps of mag2" in text
        assert "bias_steps" not in text
    assert cause_names([("latency", "mag1")] * 3) == ["three latencies of mag1"]
    assert [plural(each) for each in ("hysteresis", "noise_excess", "outliers")] == [
        "hystereses",
        "noise_excesses",
        "outliers",
    ]
    assert and_words(["a", "either b or c", "d"]) == "a, either b or c, and d"


def test_what_is_left_is_said_to_be_noise_only_where_nothing_else_is_likely(residuals: GapResiduals) -> None:
    sure = by_hand("partly", other=False)
    assert noise_words(sure) == "noise"
    unsure = replace(sure, posterior={"nothing": 0.0, "known": 0.72, "other": 0.28})
    terminal, text = told(unsure, residuals)
    assert "left over noise, if the likeliest explanation holds" in terminal
    assert "Noise, if the likeliest explanation holds." in text
    assert "nothing seen above the floor" in told(sure, residuals)[1]
    assert "nothing seen above the floor" not in text


def test_shifts_below_half_a_deviation_are_none(residuals: GapResiduals) -> None:
    still = {"mag3.offset": {"before": 2.4, "after": 2.4, "sigmas": 0.04}}
    for text in told(replace(by_hand(), calibration_shift=still), residuals):
        assert "othing: all 1 parameters stay within 0.5 standard deviations" in text
        assert "mag3.offset" not in text


def test_terminal_and_page_list_as_many_explanations(residuals: GapResiduals) -> None:
    terminal, text = told(SHOWN["unknown, many fit"], residuals)  # seven of them: two of .10, and what is not listed
    assert "all other explanations together .21" in terminal
    assert "all other explanations together .21" in text


def test_sizes_have_names_in_words(residuals: GapResiduals) -> None:
    assert cause_words(STEPS[0]) == "bias step of mag2, jump −1.50 ± 0.20 mV at 1341.0 ± 2.0 s"
    assert cause_words(ROCKING) == "base rocking, tilt 0.080 ± 0.011 deg, phase 17.2 ± 4.0 deg"
    quadratic = cause("scale_quadratic", "mag3", fraction_of_full=(0.044, 4e-4, "relative"))
    terminal, text = told(by_hand(causes=(quadratic, STEPS[0])), residuals)
    for code in ("fraction_of_full", "at_s"):
        assert code not in terminal
        assert code in text  # in the table, beside the words: it is its name in the file
    assert "at full scale 4.400 ± 0.040 %" in text
    assert parameter_name("new_thing") == "new thing"


@pytest.mark.parametrize("name", EFFECTS)
def test_a_formula_says_which_of_its_letters_a_parameter_is(name: str) -> None:
    for item in EFFECTS[name].parameters():
        assert parameter_name(item.name) in formula(name) or item.name in formula(name), item.name


def test_a_phase_of_an_amplitude_that_may_be_zero_is_not_felt(residuals: GapResiduals) -> None:
    faint = cause("joint_eccentricity", "joint1", amplitude_rad=(1e-4, 6e-5, "rad"), phase_rad=(-0.5, 2.6, "rad"))
    clear = replace(faint, parameters={**faint.parameters, "amplitude_rad": ROCKING.parameters["tilt_rad"]})
    assert cause_words(faint) == "joint eccentricity of joint 1, amplitude 0.0057 ± 0.0034 deg"
    assert "phase" in cause_words(clear)
    for text in told(by_hand(causes=(faint,)), residuals):
        assert "not felt" in text
        assert "−0.5" not in text
        assert "−28.6" not in text  # in degrees
    hum = cause(
        "mains_hum",
        "acquisition",
        amplitude=((1e-3, 1e-5), (1e-4, 1e-4), "V"),
        phase_rad=((1.0, 2.0), (0.1, 3.0), "rad"),
    )
    assert told_parameters(hum)["phase_rad"].value == (1.0, None)
    assert hum.parameters["phase_rad"].value == (1.0, 2.0)  # the file keeps what was fitted


def test_the_largest_share_of_what_is_left_is_told_first_and_next_to_nothing_gives_no_advice() -> None:
    offset = {"source": "the offset of accel2", "course": "a sine of 0.05 Hz", "share": 0.05}
    link = {"source": "a turn of link1", "course": "temperature", "share": 0.3}
    loud = {"source": "noise of accel2 by itself", "course": "0.01 to 0.02 Hz", "share": 0.81}
    faint = {"source": "noise of mag2 by itself", "course": "1 to 2 Hz", "share": 0.009}
    left = replace(by_hand("unknown").remainder, follows=(offset, link, faint, loud))
    diagnosis = replace(by_hand("unknown"), remainder=left)
    order = [left_words(diagnosis).index(words) for words in ("a turn of link 1", "offset of accel2", "accel2 alone")]
    assert order == sorted(order)
    steps = next_steps(diagnosis)
    assert steps[0].startswith(
        "Look at the wiring, shielding and supply of accel2 while the arm moves: what is left has"
    )
    assert steps[1].startswith("See whether link 1 bends")
    assert steps[2].startswith("Or look at the supply, temperature and wiring of accel2")
    assert not any("mag2" in step for step in steps)
    assert "noise of mag2 alone" in left_words(diagnosis)


@pytest.mark.parametrize(
    ("course", "look"),
    [
        ("every 3 deg of joint5", "Look at joint 5 for what has that period: gear teeth"),
        ("a sine of 12 deg of joint1", "Look at joint 1 for what has that period: gear teeth"),
        ("every 60 s", "Look for what is switched, pulsed or sent every 60 s: what is left"),
        ("a sine of 0.5 Hz", "Look at the supply, temperature and wiring of accel2"),
        ("time", "Look at the supply, temperature and wiring of accel2"),
        (
            "time, irregularly",
            "Look at the supply, temperature and wiring of accel2; look for what comes and goes nearby, too: draughts",
        ),
        (
            "the fading memory of its level",
            "Look at the supply, temperature and wiring of accel2; look for what stores and gives back, too: steel",
        ),
    ],
)
def test_what_repeats_is_looked_for_where_it_has_its_period(course: str, look: str) -> None:
    offset = {"source": "the offset of accel2", "course": course, "share": 0.5}
    left = by_hand("unknown").remainder
    steps = next_steps(replace(by_hand("unknown"), remainder=replace(left, follows=(offset,))))
    assert steps[0].startswith(look)


def test_a_cause_of_another_form_is_looked_at_once() -> None:
    form = {"source": "the strength of joint_eccentricity at joint1", "course": "the angle of joint1", "share": 0.1}
    angle = {"source": "the angle of joint1", "course": "the angle of joint1", "share": 0.09}
    left = by_hand("unknown").remainder
    alone, both = (
        replace(by_hand("unknown"), remainder=replace(left, follows=each)) for each in ((form,), (form, angle))
    )
    assert "a joint eccentricity of joint 1 whose strength changes with the angle of joint 1" in (left_words(alone))
    assert next_steps(alone)[0].startswith("Look at what could change joint eccentricity of joint 1 (in the")
    assert next_steps(both)[0].startswith("Look at joint 1 (its encoder")
    assert not any("what could change" in step for step in next_steps(both))


def test_noise_of_several_channels_is_told_by_its_bands() -> None:
    bands = {"accel1": "0.5 to 0.9 Hz", "mag2": "0.5 to 0.9 Hz", "mag3": "about 0.1 Hz"}
    noise = [{"source": f"noise of {name} by itself", "course": band, "share": 0.2} for name, band in bands.items()]
    told = "noise of accel1 and mag2, each by itself (0.5 to 0.9 Hz) and mag3 alone (about 0.1 Hz)"
    assert noise_and_bands(noise) == told
    left = replace(by_hand("unknown").remainder, follows=tuple(noise))
    assert told in next_steps(replace(by_hand("unknown"), remainder=left))[0]


def test_what_any_maneuver_absorbs_calls_for_no_other_maneuver() -> None:
    """A turn of the first joint is one of the fields' azimuth, one of the last a turn of the sensor."""
    ends = [
        {"effect": "joint_offset", "where": where, "why": "the calibration absorbs it on this maneuver"}
        for where in ("joint1", "joint6")
    ]
    other = {**ends[0], "effect": "backlash", "where": "joint6"}
    free, bound = (replace(SHOWN["no-gap"], cannot_tell=each) for each in (tuple(ends), (*ends, other)))
    assert not any("moves other joints" in step for step in next_steps(free))
    assert any("moves other joints" in step for step in next_steps(bound))
    assert "cannot tell joint_offset (joint1, joint6): on any maneuver the same as" in spoken(
        diagnosis_tables(bound, UNITS)
    )
    assert "cannot tell backlash (joint6): the calibration absorbs it" in spoken(diagnosis_tables(bound, UNITS))
    own = {f"joint{number}": f"axis_{number}" for number in range(1, 5)}
    short = ({**ends[0], "where": "axis_1"}, {**ends[0], "where": "axis_4"})
    assert not any("moves other joints" in step for step in next_steps(replace(free, cannot_tell=short, names=own)))
    middle = ({**ends[0], "where": "axis_3"},)
    assert any("moves other joints" in step for step in next_steps(replace(free, cannot_tell=middle, names=own)))


def test_without_an_arm_another_maneuver_moves_no_joints() -> None:
    lacking = {"effect": "backlash", "where": "joints", "why": "the recording lacks joint angles"}
    steps = next_steps(replace(SHOWN["unknown, many fit"], cannot_tell=(lacking,)))
    assert "turns the sensor in other ways" in steps[0]
    assert not any("joint" in step for step in steps)


def test_warnings_that_speak_against_the_recording_come_first() -> None:
    plain = SHOWN["named"]
    told = replace(plain, warnings=tuple(f"{beginning}: run" for beginning in INFORMATIVE))
    assert next_steps(told) == next_steps(plain)
    stuck = replace(plain, warnings=("each pose is repeated in 5 rows",))
    assert next_steps(stuck)[0].startswith("See to what the warnings say first")
    assert next_steps(stuck)[1:] == next_steps(plain)


def test_what_could_hide_is_said_of_one_channel_too() -> None:
    """A signal-to-noise of 9 over 600 samples is 9 / sqrt(600) of each."""
    assert "for an error of one channel all along, about 0.37 of its noise" in spoken(
        diagnosis_tables(SHOWN["no-gap"], UNITS)
    )
