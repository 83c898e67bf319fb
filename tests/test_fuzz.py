"""A seeded sample of hostile files, and commands killed at random moments.

``RIG_FUZZ`` and ``RIG_KILLS`` ask for more of either: inputs a call, and kills.
"""

from __future__ import annotations

import os
import random
from pathlib import Path

import pytest
from cli_support import SMALL
from fuzzing import complaint_about
from hostile_calls import CALLS, Call, make_good
from killing import SHORT, SIGNALS, Kill
from killing import complaint_about as complaint_about_kill

INPUTS = int(os.environ.get("RIG_FUZZ", "12"))
KILLS = int(os.environ.get("RIG_KILLS", "2"))


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("good")
    make_good(folder)
    return folder


@pytest.mark.filterwarnings("ignore")  # as the command does
@pytest.mark.parametrize(
    "call", [call for call in CALLS if not call.more], ids=lambda call: f"{call.name}: {call.arguments[0]}"
)
def test_hostile_files(good: Path, call: Call) -> None:
    """None ends in a bug, hangs, leaves a file after a failure, or gives an error of 300 letters or more."""
    complaints = []
    for number in range(INPUTS // call.slow):
        wrong = complaint_about(call, good, random.Random(f"{call.name} {call.arguments} {number}"))
        complaints += [f"{number}: {wrong}"] if wrong else []
    assert not complaints


#: Which of the calls, and the seed.
FOUND = ((2, "1 275"), (2, "7 5777"), (0, "7 882"), (2, "7 6176"), (14, "3 203"), (22, "202 322"), (22, "202 502"))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("call", "seed"), FOUND)
def test_what_was_found_stays_mended(good: Path, call: int, seed: str) -> None:
    """Inputs of longer runs that ended in a bug, or in a line without end."""
    assert complaint_about(CALLS[call], good, random.Random(seed)) == ""


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")
@pytest.mark.parametrize("number", range(KILLS))
def test_a_kill_at_any_moment_tears_nothing(tmp_path: Path, number: int) -> None:
    """No torn file, no process, one line for a signal that can be heard; no temporary after the next run."""
    rng = random.Random(number)
    (tmp_path / "small.toml").write_text(SMALL)
    after_s = rng.uniform(0.4, 3.0)  # after the interpreter's own start
    kill = Kill(rng.choice(SIGNALS), after_s)
    assert complaint_about_kill(tmp_path, SHORT[number % len(SHORT)], [kill]) == ""
