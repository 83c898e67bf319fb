"""The noise of a sensor at rest: how large, how coloured, how it grows with averaging."""

from estimators.noise.procedure import DB_PER_BIT, FULL_SCALE_V, NoiseFloor, given_floor, held_poses, noise_floor

__all__ = ["DB_PER_BIT", "FULL_SCALE_V", "NoiseFloor", "given_floor", "held_poses", "noise_floor"]
