"""The gate's study: what is forced in is wrong and leaves what is said, and the page counts rightly."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from scenarios.workers import Workers
from validation.gate import run
from validation.gate.forced import LEFT, SHARE, forced_rig
from validation.gate.run import Row, Settings, make_gate

WRONG = Row(0, "backlash of joint 5", "joint scale of joint 5", 30.0, 6.0, False, True, True, 0.01)


@pytest.mark.parametrize("number", range(3))
def test_what_is_forced_in_is_wrong_and_leaves_something(number: int) -> None:
    rig = forced_rig(5, number, 400)
    assert (rig.wrong.name, rig.wrong.where) != (rig.truth.name, rig.truth.where)
    assert LEFT <= rig.left <= SHARE * rig.snr
    project, change = rig.setting.projection, rig.setting.change
    assert project.snr(change((rig.truth,))) == pytest.approx(rig.snr)
    # at its best strength: half and twice as much of it leave more
    own = change((rig.wrong,))
    at_zero = change((rig.truth,))
    assert rig.left == pytest.approx(project.snr(at_zero - own))
    assert all(project.snr(at_zero - share * own) > rig.left for share in (0.5, 2.0))


def test_the_page_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [WRONG, replace(WRONG, rig=1, passed=True, found=False, better=False, share=np.nan)]
    monkeypatch.setattr(run, "trial", lambda settings, number: pa.Table.from_pylist([vars(rows[number])]))
    page, found = make_gate(tmp_path, Settings(rigs=2), Workers(0, None))
    assert len(found) == 2
    text = page.read_text(encoding="utf-8")
    assert "refused in 50 % (9-91)" in text
    assert "called better in 100 % (21-100); it leaves 1 %" in text
    assert "joint scale of joint 5" in text
