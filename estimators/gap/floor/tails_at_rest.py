"""Long tails of the noise at rest: what readings are relieved of, and what that does to those of a sweep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.gap.floor.unsteady import Unsteady
from rig.arrays import Array
from rig.effects.tails import drawn_in, level_spread, student, variance_beside_neighbours


@dataclass(frozen=True, eq=False)
class Tails:
    """The distribution of single readings of a channel.

    Attributes:
        noise: (n,) about the mean of each pose [V]. degrees, scale: of Student's distribution, the likeliest; infinite
            degrees where normal noise is likelier. lost: variance that is lost where the ends are drawn in [V^2].
    """

    noise: Array
    degrees: float = np.inf
    scale: float = 0.0
    lost: float = 0.0


def relieved_rest(segments: Sequence[Array]) -> tuple[list[Array], Tails]:
    """Readings (n,) of poses at rest with the ends of long tails drawn in, and their tails."""
    means = [float(segment.mean()) for segment in segments]
    noise = np.concatenate([segment - mean for segment, mean in zip(segments, means, strict=True)])
    if not noise.any():
        return list(segments), Tails(noise)
    degrees, scale, _ = student(noise)
    less = [drawn_in(segment - mean, degrees, scale) for segment, mean in zip(segments, means, strict=True)]
    lost = float(np.mean(noise**2) - np.mean(np.concatenate(less) ** 2))
    return [each + mean for each, mean in zip(less, means, strict=True)], Tails(noise, degrees, scale, lost)


def of_sweep(noise: ChannelNoise, unsteady: Unsteady | None, tails: Tails) -> ChannelNoise:
    """The floor of long-tailed noise as the sweep's readings have it, drawn in beside their neighbours."""
    spread = level_spread(tails.noise, tails.degrees, tails.scale)
    noise = replace(noise, unsteady=unsteady, degrees=tails.degrees, spread=spread)
    if not noise.relieved:
        return noise
    grown = variance_beside_neighbours(tails.noise, tails.degrees, tails.scale)
    return replace(noise.scaled(grown), tails=tails.lost - (grown - 1.0) * noise.white)
