"""A hum that the sampling folds onto the arm's own motion is one all the same: half of all mains are near 60 Hz."""

from __future__ import annotations

import numpy as np
import pytest
from diagnosed_recordings import recorded

import estimators
from rig.effects import EFFECTS, make_effect


@pytest.mark.parametrize("turns", [1, 2])
def test_a_hum_is_found_where_a_joint_turns_as_fast(turns: int) -> None:
    """At ten readings a second 60 Hz and the rate of joint 5 is that rate. Two noises of amplitude in six channels of
    600 readings: a squared signal-to-noise of 6 * 600 * 2, far beyond any draw."""
    without = [name for name in EFFECTS if name not in ("mains_hum", "joint_eccentricity", "backlash")]
    plain, _ = recorded()
    assert plain.q is not None
    rate = float(np.median(np.abs(np.gradient(plain.q[:, 4], plain.t)))) / (2.0 * np.pi)
    sigma = (0.0134, 0.0136, 0.0146, 0.0085, 0.0068, 0.0117)
    hum = make_effect(
        "mains_hum",
        {"freq_Hz": 60.0 + turns * rate, "amplitude": tuple(2.0 * own for own in sigma), "phase_rad": (0.3,) * 6},
    )
    run, locked = recorded(hum)
    found = estimators.diagnose(run, locked, without=without)
    assert found.verdict == "named"
    assert [(cause.effect, cause.probability > 0.9) for cause in found.causes] == [("mains_hum", True)]
    assert found.causes[0].parameters["freq_Hz"].value == pytest.approx(turns * rate, abs=0.002)
