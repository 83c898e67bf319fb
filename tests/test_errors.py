"""Whatever is wrong is said in one short line that any terminal can show."""

from __future__ import annotations

import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.errors import LONGEST_MESSAGE, RigError, nearest, one_line, shown, unknown_name


@given(st.text() | st.binary().map(lambda content: content.decode("utf-8", "surrogateescape")))
def test_any_text_becomes_one_short_printable_line(text: str) -> None:
    for line in (one_line(text), one_line(text * 1000, 100), str(RigError(f"{text}: {text!r}"))):
        assert len(line) <= LONGEST_MESSAGE
        assert line.isprintable()
        line.encode("utf-8")


def test_beginning_and_end_of_a_long_message_stay() -> None:
    line = str(RigError(f"run.csv: found {'x' * 50_000_000}, expected a number"))
    assert line.startswith("run.csv: found xxx")
    assert line.endswith("xxx, expected a number")


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (1 << 100_000, "an integer of 100001 bits"),
        (-(1 << 100_000), "-an integer of 100001 bits"),
        ([1] * 1000, "list of 1000"),
        ("a\x1b[31m\n", r"'a\x1b[31m\n'"),
        ("\udce9.csv", r"'\udce9.csv'"),
        (1e308, "1e+308"),
        (5e-324, "5e-324"),
    ],
    ids=["large", "negative", "list", "control", "surrogate", "huge", "denormal"],
)
def test_values(value: object, expected: str) -> None:
    assert shown(value) == expected


def test_values_that_python_does_not_write() -> None:
    deep: list[object] = []
    for _ in range(sys.getrecursionlimit() * 20):
        deep = [deep]
    assert shown(deep) == "a list"
    assert shown([1 << 100_000]) == "a list"
    while deep:  # or the interpreter's own end would be deep as well
        deep = deep.pop()  # type: ignore[assignment]


def test_long_names_are_not_compared() -> None:
    """Comparing takes time with the square of their length."""
    assert nearest("x" * 1_000_000, ["x" * 999_999]) == ""
    assert "nearest: 'backlash'" in str(unknown_name("effect", "baklash", ["backlash", "y" * 1_000_000]))
    assert len(str(unknown_name("effect", "z" * 1_000_000, map(str, range(100_000))))) <= LONGEST_MESSAGE


def test_a_long_message_is_cut_between_words() -> None:
    """And once, also where it is cut again to make room for what stands before it."""
    words = [f"word{number}" for number in range(100)]
    line = one_line(f"run.parquet: {one_line(' '.join(words))}", 200)
    assert len(line) <= 200
    assert line.count("...") == 1
    assert set(line.replace("...", " ").split()) <= {"run.parquet:", *words}
