"""A recording at rest that hardly shows how large the noise is: it is short, or it drifts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from estimators.gap.diagnosis import UNSURE_FLOOR
from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.gap.report.louder_rest import spread_of
from rig.channels import CHANNELS, CHANNELS_OF
from rig.errors import in_short
from rig.recording import Recording

#: Standard deviation of a floor's RMS, as a share of it, from which on it is told.
_UNSURE: Final = 0.1


def unsure_floor_words(
    recordings: Sequence[Recording], floors: Sequence[tuple[ChannelNoise, ...]], sources: Sequence[str]
) -> list[str]:
    """A line for each recording whose locked recording tells the RMS of some channel's noise to 10 % or worse.

    Args:
        floors, sources: of each recording.
    """
    found = []
    for recording, floor, source in zip(recordings, floors, sources, strict=True):
        if source != "locked recording":
            continue
        own = [channel for sensor in recording.sensors for channel in CHANNELS_OF[sensor]]
        shares = {channel: _unsure(floor[CHANNELS.index(channel)]) for channel in own}
        unsure = {channel: share for channel, share in shares.items() if share > _UNSURE}
        if not unsure:
            continue
        worst = floor[CHANNELS.index(max(unsure, key=lambda channel: unsure[channel]))]
        slow_V2, slow_s = max(worst.parts, default=(0.0, 0.0))
        drifts = slow_V2 > 0.5 * worst.variance
        drift = f", most of it a drift that changes within {_seconds(slow_s)}" if drifts else ""
        found.append(
            f"{UNSURE_FLOOR}{f', of {recording.name}' * (len(recordings) > 1)}: that of"
            f" {in_short(list(unsure))} to ±{100.0 * max(unsure.values()):.2g} % ({worst.samples:,} samples at"
            f" rest in {_seconds(worst.duration_s)}{drift}): probabilities allow for it, and what is as"
            f" {'slow' if drifts else 'weak'} as that is hardly seen: take a longer one"
            f"{', once the sensor is warm' if drifts else ''}"
        )
    return found


def _unsure(floor: ChannelNoise) -> float:
    """The standard deviation of a floor's RMS, as a share of it."""
    return 0.5 * math.sqrt(spread_of(floor, floor.samples, floor.duration_s))


def _seconds(value: float) -> str:
    return f"{value:,.0f} s" if value >= 100.0 else f"{value:.3g} s"
