"""The nodes of a logged path: where it was really read, if what lies between was filled in by straight lines.

A controller that logs its pose at 10 to 20 Hz beside a sensor at 100 Hz gives a path of chords. Their kinks tell when
the pose was read; a smooth path through these nodes is nearer to the motion than the chords are.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, make_smoothing_spline
from scipy.ndimage import percentile_filter
from scipy.spatial.transform import Rotation, Slerp

from rig.arrays import Array, Mask, Rows
from rig.read_times import read_times

#: A kink's change of velocity is this many times that of the samples around it, and not below this share of the path's
#: large ones: rounding makes kinks at rest.
_KINK, _SMALLEST = 6.0, 1e-6
#: So many samples around count, and of these such a percentile: at a node in every four samples most are none, at more
#: nodes, each between two samples and a kink at both, a quarter is.
_AROUND: Final = 9
_QUIET: Final = (50, 25)
#: Fewer nodes show no habit.
_FEWEST: Final = 8
#: Chords through the nodes must meet the path to this share of the kinks' height, or it is not made of chords.
_CHORD: Final = 0.05
#: A longer gap than this many intervals is filled with nodes: on a straight line there are no kinks.
_GAP: Final = 1.5


@dataclass(frozen=True)
class PoseNodes:
    """The nodes of a path of chords.

    Attributes:
        t: (m,) [s] rising.
        quaternion: (m, 4) R_base_tool, scalar first, of one sign from node to node.
        position: (m, 3) [m]; (0, 0) where it was not logged.
        read: (m,) [s] when they were read; None: what the path makes likeliest.
        smoothed: waves shorter than so many times two intervals are noise, of orientations and of positions.
    """

    t: Array
    quaternion: Array
    position: Array
    read: Array | None = None
    smoothed: tuple[float, float] = (0.0, 0.0)
    _last: list[Array] = field(default_factory=list, init=False, repr=False, compare=False)

    @property
    def interval_s(self) -> float:
        """The usual interval between nodes [s]."""
        return float(np.median(np.diff(self.t)))

    def later(self, by: float) -> PoseNodes:
        """The same nodes on a clock that tells so much more [s]."""
        return replace(self, t=self.t + by, read=self.read_s + by)

    def smooth(self, t: Array) -> tuple[Array, Array]:
        """Orientations (n, 3, 3) and positions (n, 3) at times t: cubic splines through the nodes, when they were read.

        The components of the unit quaternions are interpolated and scaled to length one. Where nodes are noisy, the
        splines are smoothing ones.
        """
        at = np.clip(t, self.read_s[0], self.read_s[-1])
        quaternion, position = self._splines
        rotation = Rotation.from_quat(quaternion(at), scalar_first=True).as_matrix()
        return np.asarray(rotation), np.zeros((len(at), 0)) if position is None else np.asarray(position(at))

    def away(self, t: Array, R_base_tool: Array) -> tuple[Array, Array]:
        """From logged orientations (n, 3, 3) at times t to the smooth path.

        The answer to the last question is kept: an effect asks it again for each of its strengths.

        Returns:
            Rotation vectors (n, 3) [rad] in the tool's frame, and the path's positions (n, 3).
        """
        if not self._last or self._last[0] is not t or self._last[1] is not R_base_tool:
            smooth, path = self.smooth(t)
            turn = Rotation.from_matrix(np.swapaxes(R_base_tool, 1, 2) @ smooth)
            self._last[:] = [t, R_base_tool, turn.as_rotvec(), path]
        return self._last[2], self._last[3]

    @property
    def read_s(self) -> Array:
        """(m,) [s] when the poses were read, by the stamps and by how smooth the path is."""
        return self.likely_read_s[0] if self.read is None else self.read

    @cached_property
    def likely_read_s(self) -> tuple[Array, ...]:
        """As ``read_s``, with other times that the path makes likely."""
        turns = 2.0 * self.quaternion  # [rad]
        return read_times(self.t, [turns, self.position] if self.position.size else [turns])

    @cached_property
    def _splines(self) -> tuple[CubicSpline | BSpline, CubicSpline | BSpline | None]:
        turns, moves = self.smoothed
        position = self._spline(self.position, moves) if self.position.size else None
        return self._spline(self.quaternion, turns), position

    def _spline(self, values: Array, smoothed: float) -> CubicSpline | BSpline:
        """Through nodes' coordinates (m, k), or near them: halving waves of so many times two intervals."""
        if smoothed == 0.0:
            return CubicSpline(self.read_s, values, axis=0)
        # a spline of penalty p through nodes h apart halves waves of angular frequency (1/(p h))^(1/4)
        penalty = (smoothed / np.pi) ** 4 * self.interval_s**3
        return make_smoothing_spline(self.read_s, values, lam=penalty)


def find_nodes(t: Array, R_base_tool: Array, position: Array) -> PoseNodes | None:
    """The nodes of a logged path; None where it is not made of chords.

    Args:
        t: (n,) [s] rising. R_base_tool: (n, 3, 3).
        position: (n, 3) [m], or (0, 0).
    """
    if len(t) < 3 * _FEWEST:
        return None
    rotation = Rotation.from_matrix(R_base_tool)
    steps = np.diff(t)[:, None]
    speed = (rotation[:-1].inv() * rotation[1:]).as_rotvec() / steps
    velocity = np.diff(position, axis=0) / steps if position.size else np.zeros((len(t) - 1, 0))
    change = np.zeros((len(t), 3 + velocity.shape[1]))
    change[1:-1] = np.diff(np.hstack([speed, velocity]), axis=0)
    size = np.linalg.norm(change, axis=1)
    large = float(np.quantile(size, 0.98))
    if large == 0.0:
        return None
    for percentile in _QUIET:
        around = percentile_filter(size, percentile, _AROUND, mode="nearest")
        kinked = size > np.maximum(_KINK * around, _SMALLEST * large)
        kinked[[0, -1]] = False
        found = _of_kinks(kinked, t, rotation, position, speed, velocity, change)
        if found is not None:
            return found
    return None


def _of_kinks(
    kinked: Mask, t: Array, rotation: Rotation, position: Array, speed: Array, velocity: Array, change: Array
) -> PoseNodes | None:
    """The nodes at kinks (n,) of a path; None where the chords between them are not the path.

    Args:
        speed, velocity: (n - 1, 3) between samples. change: (n, 6) of both at each sample.
    """
    if np.count_nonzero(kinked) < _FEWEST:
        return None
    rows, share = _instants(kinked, change)
    late = share * np.diff(t)[rows]
    at = np.concatenate([t[:1], t[rows] + late, t[-1:]])
    turned = rotation[rows] * Rotation.from_rotvec(late[:, None] * speed[rows - 1])
    nodes = Rotation.concatenate([rotation[[0]], turned, rotation[[-1]]])
    moved = position[rows] + late[:, None] * velocity[rows - 1] if position.size else position
    points = np.vstack([position[:1], moved, position[-1:]]) if position.size else position
    found = _filled(at, nodes, points)
    smooth, path = found.smooth(t)
    chords, lines = _chords(at, nodes, points, t)
    missed = np.hypot(
        (rotation.inv() * chords).magnitude(), np.linalg.norm(position - lines if position.size else lines, axis=1)
    )
    curved = np.hypot((chords.inv() * Rotation.from_matrix(smooth)).magnitude(), np.linalg.norm(path - lines, axis=1))
    return found if np.linalg.norm(missed) < _CHORD * np.linalg.norm(curved) else None


def _instants(kinked: Mask, change: Array) -> tuple[Rows, Array]:
    """The sample at or before each node, and the share of the way to the next one.

    A node between two samples kinks the path at both, in proportion to how near they are.
    """
    rows, shares = [], []
    taken = -1
    for row in map(int, np.flatnonzero(kinked)):
        if row == taken:
            continue
        share = 0.0
        if kinked[row + 1]:
            own, after = np.linalg.norm(change[row]), np.linalg.norm(change[row + 1])
            share, taken = float(after / (own + after)), row + 1
        rows.append(row)
        shares.append(share)
    return np.array(rows), np.array(shares)


def quaternions(R_base_tool: Array) -> Array:
    """Unit quaternions (n, 4), scalar first, of rotations (n, 3, 3) or (n, 9) by rows."""
    return np.asarray(Rotation.from_matrix(R_base_tool.reshape(-1, 3, 3)).as_quat(scalar_first=True))


def one_sign(quaternion: Array) -> Array:
    """Quaternions (n, 4) with the sign that keeps each near the one before."""
    turns = np.einsum("ni,ni->n", quaternion[1:], quaternion[:-1]) < 0.0
    sign = np.concatenate([[1.0], np.where(np.cumsum(turns) % 2 == 1, -1.0, 1.0)])
    return np.asarray(quaternion * sign[:, None])


def _chords(at: Array, nodes: Rotation, points: Array, t: Array) -> tuple[Rotation, Array]:
    """Orientations and positions (n, 3) between nodes: turns about one axis, straight lines."""
    lines = np.stack([np.interp(t, at, column) for column in points.T], axis=1) if points.size else points
    return Slerp(at, nodes)(np.clip(t, at[0], at[-1])), lines if points.size else np.zeros((len(t), 0))


def _filled(at: Array, nodes: Rotation, points: Array) -> PoseNodes:
    """The nodes, with the gaps filled evenly on the chords."""
    gaps = np.diff(at)
    interval = float(np.median(gaps))
    pieces = [
        np.linspace(start, start + gap, max(1, round(gap / interval)) if gap > _GAP * interval else 1, endpoint=False)
        for start, gap in zip(at[:-1], gaps, strict=True)
    ]
    every = np.concatenate([*pieces, at[-1:]])
    rotation, lines = _chords(at, nodes, points, every)
    return PoseNodes(every, one_sign(rotation.as_quat(scalar_first=True)), lines if points.size else points)
