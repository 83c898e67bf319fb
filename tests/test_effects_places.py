"""Where an effect can be on any arm, and in which unit its sizes are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effects_rig import made, measured, signals, volts

from rig.channels import CHANNELS
from rig.effects import EFFECTS
from rig.errors import RigError


def test_places_are_those_of_the_recordings_arm() -> None:
    still = signals()
    angles = np.repeat(still.encoder_angles[:, :3], 3, axis=1)
    nine = replace(still, q_encoder=np.where(np.arange(9) % 2 == 0, angles, 0.3), arm=None)
    assert EFFECTS["joint_offset"].places_on(nine) == tuple(f"joint{n}" for n in range(1, 10))
    assert EFFECTS["backlash"].places_on(nine) == tuple(f"joint{n}" for n in (1, 3, 5, 7, 9))
    assert EFFECTS["axis_misalignment"].places_on(nine) == tuple(f"joint{n}" for n in range(1, 9))
    assert EFFECTS["link_hard_iron"].places_on(nine) == tuple(f"link{n}" for n in range(1, 9))
    assert EFFECTS["joint_compliance"].places_on(still) == ("joint2", "joint3", "joint5")
    assert EFFECTS["bias_step"].places_on(nine) == CHANNELS
    assert EFFECTS["backlash"].places_on(measured()) == ()
    turned = made("joint_offset", "joint9").apply(replace(nine, q=nine.encoder_angles), np.random.default_rng(0))
    assert np.array_equal(np.flatnonzero((turned.q != nine.encoder_angles).any(axis=0)), [8])
    with pytest.raises(RigError, match="joint9: the arm has 6 joints, expected joint1 to joint6"):
        volts(made("joint_offset", "joint9"))
