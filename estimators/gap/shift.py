"""What the gap had done to the calibration: every parameter before and after, in standard deviations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimators.calibration import Calibration
from estimators.dispatch import calibrate
from estimators.gap.basefit import cleared
from estimators.gap.bench import Bench
from estimators.gap.channel_noise import ChannelNoise
from rig.channels import CHANNELS, CHANNELS_OF, COLUMNS_OF
from rig.effects import Effect
from rig.errors import RigError
from rig.recording import Recording


def calibration_shift(
    recording: Recording, bench: Bench, effects: Sequence[Effect], floor: tuple[ChannelNoise, ...]
) -> dict[str, dict[str, float]]:
    """Parameter -> before, after, sigmas; of the recording as it is and with the causes' change taken out.

    Names are ``accel1.sensitivity`` and so on; angles in degrees, of axes and fields that can be told.
    """
    recording = cleared(recording, bench.given_change)
    corrected = cleared(recording, bench.change(effects))
    noise = {
        sensor: np.sqrt([floor[column].variance for column in range(*COLUMNS_OF[sensor].indices(len(CHANNELS)))])
        for sensor in recording.sensors
    }
    arm = bench.base.arm
    try:
        before, after = (calibrate(each, noise=noise, arm=arm) for each in (recording, corrected))
    except RigError:  # the correction made a fit that is refused: nothing to compare
        return {}
    return _compared(before, after)


def _compared(before: Calibration, after: Calibration) -> dict[str, dict[str, float]]:
    found = {}
    for sensor, fitted in after.sensors.items():
        for name in fitted.parameters:
            old, new, std = before.sensors[sensor].value(name), fitted.value(name), fitted.std(name)
            if not np.isfinite(std) or std <= 0:
                continue
            difference = (new - old + 180.0) % 360.0 - 180.0 if name.endswith("_deg") else new - old
            found[_spelt(sensor, name)] = {"before": old, "after": new, "sigmas": float(difference / std)}
    return found


def _spelt(sensor: str, name: str) -> str:
    stem = name.removesuffix("_deg")
    if stem[-1].isdigit():
        return f"{CHANNELS_OF[sensor][int(stem[-1]) - 1]}.{name.replace(stem[-1], '', 1)}"
    return f"{sensor}.{name}"
