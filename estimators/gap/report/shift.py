"""What the gap had done to the calibration: every parameter before and after, in standard deviations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimators.calibration import Calibration
from estimators.dispatch import calibrate
from estimators.gap.data.basefit import cleared, floor_of
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.known_angle.together import calibrate_together
from rig.channels import CHANNELS_OF
from rig.effects import Effect
from rig.errors import RigError
from rig.recording import Recording


def calibration_shift(
    recordings: Sequence[Recording],
    data: WhitenedData,
    effects: Sequence[Effect],
    floors: Sequence[tuple[ChannelNoise, ...]],
) -> dict[str, dict[str, float]]:
    """Parameter -> before, after, sigmas; of the recordings as they are and with the causes' change taken out.

    Names are ``accel1.sensitivity`` and so on; angles in degrees, of axes and fields that can be told.
    """
    change, given = data.change(effects), data.given_change
    whole = len(data.base)
    given = np.broadcast_to(given, (whole, given.shape[-1])) if len(given) != whole else given
    before_all, corrected, noise = [], [], []
    for recording, rows, floor in zip(recordings, data.single, floors, strict=False):
        own = cleared(recording, given[rows])
        before_all.append(own)
        corrected.append(cleared(own, change[rows]))
        noise.append(floor_of(recording, floor))
    arm = data.base.arm
    try:
        if len(corrected) == 1:
            before, after = (calibrate(each, noise=noise[0], arm=arm) for each in (before_all[0], corrected[0]))
        else:
            before, after = (calibrate_together(each, noise=noise, arm=arm) for each in (before_all, corrected))
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
