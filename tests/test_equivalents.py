"""What does the same as a cause, with the size and the sign that it would have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosed_recordings import by_hand, cause, recorded

from rig.arm import Arm
from rig.effects import make_effect
from scenarios.diagnosing.equivalents import equivalents_of
from scenarios.gap_report import gap_residuals
from scenarios.gap_report.advice import next_steps

OFFSET_RAD = 0.03


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_parallel_joint_has_its_own_offset(sign: float) -> None:
    """The axes of joints 2 and 3 are parallel at every pose: an offset of one is one of the other."""
    truth = sign * OFFSET_RAD
    run, locked = recorded(make_effect("joint_offset", {"where": "joint2", "offset_rad": truth}))
    same = {"effect": "joint_offset", "where": "joint3", "probability": 0.5}
    diagnosis = by_hand(causes=(cause("joint_offset", "joint2", (same,), offset_rad=(truth, 1e-4, "rad")),))
    (found,) = equivalents_of(diagnosis, gap_residuals(run, diagnosis, locked))
    assert (found["effect"], found["where"], found["instead_of"]) == (
        "joint_offset",
        "joint3",
        ["joint_offset", "joint2"],
    )
    offset = found["parameters"]["offset_rad"]
    axes = Arm.a465().joint_axes
    expected = truth * float(axes[1] @ axes[2])
    # Its own width, from 600 readings; five of it
    assert 0.0 < offset["std"] < 0.1 * OFFSET_RAD
    assert abs(offset["value"] - expected) < 5.0 * offset["std"]
    assert offset["unit"] == "rad"


def test_the_sizes_are_among_what_to_do_next() -> None:
    diagnosis = by_hand(
        causes=(
            cause(
                "joint_offset",
                "joint2",
                ({"effect": "joint_offset", "where": "joint3", "probability": 0.5},),
                offset_rad=(np.radians(1.0), np.radians(0.01), "rad"),
            ),
        )
    )
    same = {"effect": "joint_offset", "where": "joint3", "size": "offset -1.000 +- 0.010 deg"}
    steps = next_steps(replace(diagnosis, next={"maneuver": None, "why": "no other", "equivalents": [same]}))
    assert "joint offset of joint 2 (offset 1.000 ± 0.010 deg)" in steps[1]
    assert "joint offset of joint 3 (offset −1.000 ± 0.010 deg)" in steps[1]


def test_without_equivalents_nothing_is_fitted() -> None:
    run, locked = recorded()
    diagnosis = by_hand(causes=())
    assert equivalents_of(diagnosis, gap_residuals(run, diagnosis, locked)) == []
