"""Numbers that a reader sees: no longer than their deviation makes them, in units in which they are short."""

from __future__ import annotations

import pytest

from estimators.gap import Cause, Estimate
from estimators.gap.diagnosis import Closed
from estimators.gap.readable_units import readable_unit, rms_text, two_digits
from estimators.gap.remainder_words import share_left
from estimators.gap.share_words import percent
from scenarios.gap_report.words import estimate_for_people, estimate_words, parameter_for_people


@pytest.mark.parametrize(
    ("value", "std", "unit", "own", "people"),
    [
        (0.00567, 0.0004, "V", "0.00567 ± 0.00040 V", "5.67 ± 0.40 mV"),
        (3.59985, 0.00014, "V", "3.59985 ± 0.00014 V", ""),
        (2e-5, 3e-6, "V", "0.0000200 ± 0.0000030 V", "20.0 ± 3.0 µV"),
        (-1.2e-5, 2e-6, "V/degC", "−0.0000120 ± 0.0000020 V/°C", "−12.0 ± 2.0 µV/°C"),
        (0.01, 0.0002, "rad", "0.01000 ± 0.00020 rad", "0.573 ± 0.011 deg"),
        (0.0012, 0.0002, "relative", "0.00120 ± 0.00020", "0.120 ± 0.020 %"),
        (12.0, 1.0, "s", "12.0 ± 1.0 s", ""),
    ],
)
def test_a_parameter_is_written_to_its_deviation_in_a_unit_that_suits_it(
    value: float, std: float, unit: str, own: str, people: str
) -> None:
    estimate = Estimate(value, std, unit)
    assert estimate_words(estimate) == own
    assert estimate_for_people(estimate) == people


def test_the_unit_of_several_numbers_suits_the_largest() -> None:
    estimate = Estimate((0.0, 0.004, None), (1e-3, 1e-3, None), "V")
    assert estimate_for_people(estimate) == "(0.0 ± 1.0, 4.0 ± 1.0, not felt) mV"
    assert readable_unit("V", 0.0) == (1.0, "V")


def test_a_direction_has_no_per_cent() -> None:
    """Three shares have, whatever their length; a direction that is known in part has none either."""
    std = (0.1, 0.1, 0.1)
    for value in ((-0.28, 0.0, 0.96), (-0.28, 0.0, None)):
        told = {name: Estimate(value, std, "relative") for name in ("direction", "share")}
        cause = Cause("vibration", "accelerometer", 1.0, (), told, Closed(1.0, 0.9, 1.0))
        assert parameter_for_people(cause, "direction") == ""
        assert parameter_for_people(cause, "share").endswith(" %")


def test_a_channels_sizes_end_at_the_second_digit_of_what_its_noise_leaves_open() -> None:
    """Of 13.4 mV in 6,656 readings: 0.12 mV."""
    assert rms_text(0.0134, 0.0134, 6656, 1e3) == "13.40"
    assert rms_text(5.19e-6, 0.0134, 6656, 1e3) == "0.01"
    assert rms_text(3.59985, 0.0134, 6656, 1e3) == "3599.85"
    assert rms_text(3.59985, 0.0134, 6656) == "3.59985"
    assert rms_text(0.5, 0.0, 6656) == "0.5"


def test_ratios_have_two_digits_and_no_exponent() -> None:
    assert [two_digits(each) for each in (0.0213, 9.96, 12.4, 123.0, 1e6)] == ["0.021", "10", "12", "120", "1,000,000"]


def test_a_share_that_rounds_to_nothing_is_not_called_nothing() -> None:
    assert percent(0.002, 0.0, 0.004) == "< 1 %"
    assert percent(0.002, 0.0, 0.03) == "< 1 % (0-3)"
    assert percent(0.0) == "< 1 %"  # one form for what is not touched
    assert percent(-0.001) == "< 1 %"


def test_a_share_that_rounds_to_everything_is_not_called_everything() -> None:
    assert percent(0.9997) == "> 99.9 %"
    assert percent(0.9997, 0.998, 1.0) == "> 99.9 % (99.8-100)"
    assert percent(0.9998, 0.9996, 1.0) == "> 99.9 %"
    assert percent(1.0) == "100 %"
    assert [share_left(each) for each in (0.002, 0.25, 0.9997, 1.0)] == [
        "less than 1 %",
        "25 %",
        "more than 99.9 %",
        "100 %",
    ]
