"""What the page on both papers rests on, as plain data."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any, Final

import numpy as np

from validation.paper.camps_joint import joint_scatter
from validation.paper.camps_rotations import told
from validation.paper.camps_text import SLOWER
from validation.paper.compare import Comparison, findings

FILE: Final = "comparison.json"
#: Other processors differ in the last digits.
_DIGITS: Final = 6


def document(comparison: Comparison) -> dict[str, Any]:
    """A JSON object: findings, rows, statements, and the numbers behind them; what is no number is null."""
    joint = [joint_scatter(number) for number in ("1", "2", "3", "4")] + [joint_scatter("1", SLOWER)]
    made: dict[str, Any] = {
        "format": "rig-paper/1",
        "findings": findings(comparison),
        "rows": [asdict(row) for row in comparison.rows],
        "statements": [asdict(statement) for statement in comparison.statements],
        "misfits": [asdict(row) for row in comparison.misfits],
        "one_draws": [asdict(row) for row in comparison.one_draws],
        "dip": asdict(comparison.dip),
        "early_stops": [asdict(row) for row in comparison.early_stops],
        "three_tests_together": [asdict(row) for row in joint],
        "turns_about_axes": [asdict(row) for row in told()],
    }
    plain: dict[str, Any] = _plain(made)
    return plain


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float):
        return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None
    return value
