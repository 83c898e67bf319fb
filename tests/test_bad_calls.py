"""Calls that make no sense through the command line: one line on stderr, exit status 2, nothing written."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_support import SMALL, Rig

from scenarios.loader import from_toml


@pytest.fixture
def rig(capfd: pytest.CaptureFixture[str]) -> Rig:
    return Rig(capfd)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with a scenario and a recording of it."""
    monkeypatch.chdir(tmp_path)
    Path("small.toml").write_text(SMALL)
    from_toml(SMALL, "small.toml").simulate(0).write("run.csv")
    return tmp_path


@pytest.mark.parametrize("again", ["run.csv", "./run.csv", "link.csv"])
@pytest.mark.parametrize(
    "command",
    [
        ("import", "-o", "out.parquet"),
        ("calibrate", "-o", "out.json"),
        ("diagnose", "--together", "--out", "out"),
    ],
    ids=lambda command: command[0],
)
def test_a_file_is_not_taken_twice(here: Path, rig: Rig, command: tuple[str, ...], again: str) -> None:
    Path("link.csv").symlink_to("run.csv")
    line = rig.refused(*command, "run.csv", again)
    assert line.startswith(f"rig: {Path(again)}: is ")
    assert line.endswith("expected each once")
    assert not list(here.glob("out*"))
