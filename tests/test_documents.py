"""JSON and TOML of others: read in bounded time and memory, or refused in one line."""

from __future__ import annotations

import os
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest

from rig.arm import Arm
from rig.documents import parse_json, parse_toml, read_bytes, read_json, read_toml
from rig.errors import RigError
from scenarios.importing.bag_log import read_bag
from scenarios.importing.text_log import read_text_log

DEEP = 100_000


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[" * DEEP, "nested too deep"),
        ('{"a":' * DEEP + "1" + "}" * DEEP, "nested too deep"),
        ("9" * 5000, "5000 digits"),
        ("1e999", "beyond the floating-point range"),
        ("NaN", "NaN is not JSON"),
        ("-Infinity", "Infinity is not JSON"),
        (b"\xff\xfe", "not UTF-8 text"),
        ('{"a": 1', "is not JSON"),
    ],
    ids=lambda value: str(value)[:12],
)
def test_json_that_is_refused(text: str | bytes, complaint: str) -> None:
    with pytest.raises(RigError, match=f"^a.json: .*{complaint}") as refused:
        parse_json(text, "a.json")
    assert len(str(refused.value)) < 300


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("a = " + "[" * DEEP, "nested too deep"),
        ("a = " + "{a=" * DEEP, "nested too deep"),
        (".".join("a" * 100_000) + " = 1", "line 1 has a key of 32 parts"),
        ("x = 1\n[" + " . ".join(['"a"'] * 1000) + "]", "line 2 has a key of 32 parts"),
        ("a = 0x" + "f" * 10_000, "an integer of 40000 bits"),
        ("a = " + "9" * 10_000, "is not TOML|not TOML"),
        ("a" * 2_000_000, "expected TOML of at most"),
    ],
    ids=lambda value: str(value)[:12],
)
def test_toml_that_is_refused(text: str, complaint: str) -> None:
    tracemalloc.start()
    with pytest.raises(RigError, match=f"^a.toml: .*({complaint})") as refused:
        parse_toml(text, "a.toml")
    assert len(str(refused.value)) < 300
    assert tracemalloc.get_traced_memory()[1] < 256 << 20
    tracemalloc.stop()


def test_what_is_no_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.json")
    for name, complaint in (
        ("pipe.json", "no ordinary file"),
        (".", "is a folder"),
        ("pip.json", "nearest: 'pipe.json'"),
    ):
        with pytest.raises(RigError, match=complaint):
            read_json(tmp_path / name, "a calibration")
    with pytest.raises(RigError, match=r"no such file|cannot be read"):
        read_bytes("a\0b", "a calibration")
    (tmp_path / "large.toml").write_bytes(b"#" * (1 << 21))
    with pytest.raises(RigError, match="found 2097152 bytes, expected a scenario of at most 1048576"):
        read_toml(tmp_path / "large.toml", "a scenario")


def test_lists_of_numbers_are_no_deep_keys() -> None:
    numbers = ", ".join(["0.125"] * 1000)
    assert len(parse_toml(f"a = [{numbers}]\nb = 'one. two. three.'", "a.toml")["a"]) == 1000


@pytest.mark.parametrize(
    "read", [read_bytes, lambda path, expected: read_text_log(path), lambda path, expected: read_bag(path)]
)
@pytest.mark.parametrize("name", ["pipe.csv", "pipe.mcap", "pipe.urdf"])
def test_nobody_waits_for_a_pipe(tmp_path: Path, read: Callable[[Path, str], object], name: str) -> None:
    os.mkfifo(tmp_path / name)
    with pytest.raises(RigError, match="is no ordinary file"):
        read(tmp_path / name, "a document")
    with pytest.raises(RigError, match="is no ordinary file"):
        Arm.from_file(tmp_path / name)
