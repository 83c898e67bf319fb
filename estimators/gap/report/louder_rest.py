"""A recording at rest that is louder than the recording whose floor it is to be."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

from estimators.gap.diagnosis import Channel
from estimators.gap.floor.channel_noise import ChannelNoise
from rig.channels import CHANNELS
from rig.recording import Recording

#: Standard deviations below the floor that no channel's residuals reach by chance: once in 30,000.
_SIGNIFICANT: Final = 4.0
#: A floor that is too loud by less than this share of its RMS does no harm.
_HARMLESS: Final = 0.1
#: Parameters at most that a channel's residuals have paid for.
_PARAMETERS: Final = 5


def loud_floor_words(
    recordings: Sequence[Recording],
    channels: Sequence[Mapping[str, Channel]],
    floors: Sequence[tuple[ChannelNoise, ...]],
    sources: Sequence[str],
) -> list[str]:
    """A line for each recording whose residuals are below the floor that was learned at rest.

    Args:
        channels, floors, sources: of each recording; channels by name.
    """
    found = []
    for recording, own, floor, source in zip(recordings, channels, floors, sources, strict=True):
        if source != "locked recording":
            continue
        loud = {
            name: row.rms_before / row.noise_floor
            for name, row in own.items()
            if _below(row, floor[CHANNELS.index(name)], recording)
        }
        if not loud:
            continue
        noise = floor[CHANNELS.index(next(iter(loud)))]
        few, many = min(loud.values()), max(loud.values())
        ratios = f"{few:.2g}" if f"{few:.2g}" == f"{many:.2g}" else f"{few:.2g} to {many:.2g}"
        before = f"{recording.name}: " if len(recordings) > 1 else ""
        found.append(
            f"{before}the locked recording is too loud: the residuals of {', '.join(loud)} are {ratios} times its noise"
            f" ({noise.samples:,} samples at rest in {noise.duration_s:.3g} s; the readings come at"
            f" {recording.rate_Hz:.3g} Hz): what is weaker than that is not seen, and probabilities and widths are"
            " wrong: take one at the rate and the settings of the recording"
        )
    return found


def _below(row: Channel, floor: ChannelNoise, recording: Recording) -> bool:
    """Whether a channel's residuals are below its floor by more than chance explains."""
    if not row.noise_floor > 0.0:
        return False
    square = (row.rms_before / row.noise_floor) ** 2 + _PARAMETERS / len(recording)
    if square > (1.0 - _HARMLESS) ** 2:
        return False
    spread = spread_of(floor, len(recording), recording.duration_s)
    spread += spread_of(floor, floor.samples, floor.duration_s)
    return (1.0 - square) / math.sqrt(spread) > _SIGNIFICANT


def spread_of(floor: ChannelNoise, samples: int, duration_s: float) -> float:
    """The relative variance of a variance that so many samples tell: a correlated part counts by its time."""
    if not samples or not duration_s:
        return math.inf
    white = 2.0 / samples * (floor.white / floor.variance) ** 2
    return white + sum(2.0 * (part / floor.variance) ** 2 * tau_s / duration_s for part, tau_s in floor.parts)
