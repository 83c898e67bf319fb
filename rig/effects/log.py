"""Errors of the log of the tool's poses: the world is right, what was written down of it is not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.fft import dct, idct
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation, Slerp
from typing_extensions import override

from rig.arrays import Array
from rig.effects._numerics import exponential_spectrum, gauss_markov
from rig.effects.base import Effect, Kind, Stage, register
from rig.effects.parameters import parameter
from rig.effects.readings import ErrorsShown
from rig.pose_nodes import one_sign, quaternions
from rig.signals import Signals

if TYPE_CHECKING:
    from rig.pipeline import Pipeline


#: Turn [rad] by which the readings' response to a turn of the tool is taken.
_TURN: Final = 1e-6
#: Fewer poses show no path.
_FEWEST: Final = 16
#: Logarithm of the weight of a path's squared second differences: from none at all to a straight line.
_WEIGHTS: Final = (-12.0, 24.0)


@register
@dataclass(frozen=True)
class PoseInterpolation(Effect):
    """Poses logged every node_interval_s, give or take jitter_s, and filled in by straight lines: what moves faster is
    missing.

    The poses are read every node_interval_s, stamped as they arrive, off by jitter_s, and interpolated linearly. The
    kinks of the log show its nodes, T apart; the true path is taken as the cubic spline through them at the times that
    make it smooth (``rig.read_times``), of which node_interval_s/T is added to the chords: for a smooth path the two
    times agree, and their difference checks the hypothesis. The stamps' scatter is noise in proportion to the slope of
    the readings, a straight line from node to node.

    20-100 ms, jitter a few ms: robot controllers log at 10 to 50 Hz beside sensors at 100 Hz; a guess.
    """

    name = "pose_interpolation"
    stage = Stage.POSE
    places = ("acquisition",)
    requires = ("nodes",)
    of_log = True
    remembers = True
    adds_in_time = True

    node_interval_s: float = parameter("s", 0.05, lower=0.0, upper=100.0)
    jitter_s: float = parameter(
        "s", 3e-3, lower=0.0, upper=10.0, strength=False, default=0.0, grid=(0.0,), scatter=True
    )

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        nodes = signals.pose_nodes
        if nodes is None or self.node_interval_s == 0.0:
            return signals
        share = self.node_interval_s / nodes.interval_s
        away, path = nodes.away(signals.t, signals.R_base_tool)
        rotation = signals.R_base_tool @ Rotation.from_rotvec(share * away).as_matrix()
        position = signals.position
        if position.size and path.size:
            position = position + share * (path - position)
        return replace(signals, R_base_tool=rotation, position=position, known_nodes=(nodes,))

    @override
    def log(self, signals: Signals, rng: np.random.Generator) -> Signals:
        if self.node_interval_s == 0.0 or len(signals) < 4:
            return signals
        t = signals.t
        read = np.append(np.arange(t[0], t[-1], self.node_interval_s), t[-1])
        furthest = 0.4 * self.node_interval_s
        late = np.clip(self.jitter_s * rng.standard_normal(len(read)), -furthest, furthest)
        late[[0, -1]] = 0.0
        kept = np.append((read + late)[:-1] < t[-1], True)
        read, stamped = read[kept], (read + late)[kept]
        path = one_sign(quaternions(signals.R_base_tool))
        nodes = Rotation.from_quat(CubicSpline(t, path, axis=0)(read), scalar_first=True)
        position = signals.position
        if position.size:
            points = CubicSpline(t, position, axis=0)(read)
            position = np.stack([np.interp(t, stamped, column) for column in points.T], axis=1)
        return replace(signals, R_base_tool=np.asarray(Slerp(stamped, nodes)(t).as_matrix()), position=position)

    def response(self, base: Signals, pipeline: Pipeline) -> Array:
        """(n, 6, 1) [recorded unit/s]: the slope of the readings, which a node's wrong time moves along the path."""
        return np.gradient(base.volts, base.t, axis=0)[:, :, None]

    def added_spectrum(self, frequency: Array, interval_s: float) -> Array:
        """Of straight lines between independent nodes: the squared response of a triangle, one node in m samples."""
        m = max(1.0, round(self.node_interval_s / interval_s))
        sine = np.sin(np.pi * frequency)
        triangle = np.where(sine == 0.0, m, (np.sin(np.pi * frequency * m) / np.where(sine == 0.0, 1.0, sine)) ** 2 / m)
        return np.asarray(triangle**2 / m)


@register
@dataclass(frozen=True)
class PoseNoise(Effect):
    """The logged pose errs by a small rotation: R exp([e]x), e in frame 6, each component normal with
    sigma_rad and forgotten over tau_s.

    With tau_s zero the errors are independent; else they forget as exp(-|lag|/tau_s). All channels of both sensors see
    the same turn: k moves by S_k P_k . (R^T f x e), f the field.

    0.1-5 mrad: 0.02-0.1 mm over the links of an arm, tenths of a degree of an optical tracker; a guess.
    """

    name = "pose_noise"
    stage = Stage.POSE
    kind = Kind.NOISE
    places = ("acquisition",)
    requires = ("poses",)
    of_log = True
    adds_in_time = True

    sigma_rad: float = parameter("rad", 1e-3, lower=0.0, upper=1.0)
    tau_s: float = parameter("s", 1.0, lower=0.0, upper=1e6, strength=False, default=0.0, grid=(0.0, 0.1, 1.0, 10.0))

    @override
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        if self.sigma_rad == 0.0:
            return signals
        drive = self.sigma_rad * rng.standard_normal((len(signals), 3))
        if self.tau_s > 0.0:
            drive = gauss_markov(signals.t, self.tau_s, drive)
        turns = Rotation.from_rotvec(drive).as_matrix()
        return replace(signals, R_base_tool=signals.R_base_tool @ turns)

    @override
    def log(self, signals: Signals, rng: np.random.Generator) -> Signals:
        return self.apply(signals, rng)

    def response(self, base: Signals, pipeline: Pipeline) -> Array:
        """(n, 6, 3) [recorded unit/rad]: what a turn of the tool about each of its axes does to the readings."""
        rng = np.random.default_rng(0)  # the pipeline has no effects: nothing is drawn
        result = np.zeros((len(base), base.volts.shape[1], 3))
        for axis, unit in enumerate(np.eye(3)):
            R_tool = Rotation.from_rotvec(_TURN * unit).as_matrix()
            moved = replace(base, R_base_tool=base.R_base_tool @ R_tool)
            result[:, :, axis] = (pipeline.carried(base, rng, moved, first=Stage.FIELD).volts - base.volts) / _TURN
        return result

    @override
    def errors_shown(self, base: Signals) -> ErrorsShown:
        """Turns [rad] away from a smooth path: an arm moves smoothly, its noise does not."""
        return smooth_path(base.R_base_tool)

    @override
    def added_spectrum(self, frequency: Array, interval_s: float) -> Array:
        return exponential_spectrum(frequency, interval_s, self.tau_s)


def smooth_path(R_base_tool: Array) -> ErrorsShown:
    """How poses (n, 3, 3) at even times err about a smooth path through them, and what the path keeps of them.

    Of unit quaternions, a discrete spline of the weight that generalised cross-validation finds, by cosine transform:
    Garcia, Computational Statistics and Data Analysis 54 (2010), equations 5 to 13. Poses without noise are their own
    smooth path, however rough.

    Returns:
        Rotation vectors (n, 3) [rad], in the tool's frame, from the poses to the path; and (n,) the share of each
        cosine, from the slowest to the fastest, that the path keeps.
    """
    count = len(R_base_tool)
    logged = one_sign(quaternions(R_base_tool))
    waves = dct(logged, axis=0, norm="ortho")
    power = np.sum(waves**2, axis=1)
    if count < _FEWEST or not power[1:].any():
        return ErrorsShown(np.zeros((count, 3)), np.ones(count))
    rough = (2.0 - 2.0 * np.cos(np.pi * np.arange(count) / count)) ** 2

    def score(weight: float) -> float:
        left = 1.0 - 1.0 / (1.0 + np.exp(weight) * rough)
        return float(np.log(left**2 @ power) - 2.0 * np.log(left.sum()))

    weight = float(minimize_scalar(score, bounds=_WEIGHTS, method="bounded").x)
    kept = 1.0 / (1.0 + np.exp(weight) * rough)
    smooth = Rotation.from_quat(idct(waves * kept[:, None], axis=0, norm="ortho"), scalar_first=True)
    turns = (Rotation.from_quat(logged, scalar_first=True).inv() * smooth).as_rotvec()
    return ErrorsShown(np.asarray(turns), np.asarray(kept))
