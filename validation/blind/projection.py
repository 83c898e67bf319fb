"""What a change of the readings leaves once the calibration has taken up its part: the maker's own computation.

The tangent of the true calibration at the encoder's angles, whitened by the true floor: a channel's own parameters move
its reading by any vector along R^T f and by a constant; turning the field moves the three channels of a sensor
together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rig.arrays import Array
from rig.channels import ACCELEROMETER, CHANNELS, COLUMNS_OF
from rig.pipeline import Pipeline
from validation.blind.floors import Floor

_SINGULAR = 1e-8  # relative to the largest singular value: parameters that the maneuver cannot tell


@dataclass(frozen=True)
class Projection:
    """M and W of one setting: whiten, then project the calibration out.

    Attributes:
        floor: the true floor.
        interval_s: between samples.
        tangents: sensor -> (n, 3, p) [V] the calibration's tangent.
        bases: sensor -> (3 n, rank) orthonormal basis of the whitened tangent.
    """

    floor: Floor
    interval_s: float
    tangents: Mapping[str, Array]
    bases: Mapping[str, Array]

    @classmethod
    def of(cls, pipeline: Pipeline, R_base_tool: Array, floor: Floor, interval_s: float) -> Projection:
        """Of the true sensors at orientations (n, 3, 3), those that the recording's own angles give."""
        tangents, bases = {}, {}
        for sensor, axes in pipeline.sensors.items():
            environment = pipeline.environment
            field = environment.gravity if sensor == ACCELEROMETER else environment.magnetic
            tangents[sensor] = _tangent(R_base_tool, field, np.asarray(axes.sensitivity)[:, None] * axes.axes)
            full = np.zeros((len(R_base_tool), len(CHANNELS), tangents[sensor].shape[2]))
            full[:, COLUMNS_OF[sensor]] = tangents[sensor]
            white = _stacked(floor.whiten(full, interval_s)[:, COLUMNS_OF[sensor]])
            left, singular, _ = np.linalg.svd(white / np.linalg.norm(white, axis=0), full_matrices=False)
            bases[sensor] = left[:, singular > _SINGULAR * singular[0]]
        return cls(floor, interval_s, tangents, bases)

    def __call__(self, change: Array) -> Array:
        """Changes (n, 6) or (n, 6, m) [V] whitened, without what the calibration takes up: (rows,) or (rows, m)."""
        white = self.floor.whiten(change, self.interval_s)
        parts = []
        for sensor, basis in self.bases.items():
            part = _stacked(white[:, COLUMNS_OF[sensor]])
            parts.append(part - basis @ (basis.T @ part))
        return np.concatenate(parts)

    def snr(self, change: Array) -> float:
        """The projected, whitened signal-to-noise ||M Z phi||/sigma of a change (n, 6) [V]."""
        return float(np.linalg.norm(self(change)))

    def left_over(self, change: Array) -> Array:
        """(n, 6) [V]: the part of a change (n, 6) that the calibration cannot take up."""
        white = self.floor.whiten(change, self.interval_s)
        left = change.copy()
        for sensor, tangent in self.tangents.items():
            columns = COLUMNS_OF[sensor]
            full = np.zeros((*change.shape, tangent.shape[2]))
            full[:, columns] = tangent
            design = _stacked(self.floor.whiten(full, self.interval_s)[:, columns])
            scale = np.linalg.norm(design, axis=0)
            found, *_ = np.linalg.lstsq(design / scale, _stacked(white[:, columns]), rcond=_SINGULAR)
            left[:, columns] -= tangent @ (found / scale)
        return left

    def gap_V(self, change: Array) -> Array:
        """(6,) [V] RMS of what the calibration cannot take up of a change (n, 6), channel by channel."""
        return np.asarray(np.sqrt(np.mean(self.left_over(change) ** 2, axis=0)))


def _tangent(R_base_tool: Array, field: Array, rows: Array) -> Array:
    """(n, 3, 14): for each channel R^T f and one; for two turns of the field what they do to all channels.

    Args:
        field: (3,) base frame. rows: (3, 3) S_k P_k.
    """
    count = len(R_base_tool)
    seen = np.einsum("nij,i->nj", R_base_tool, field)
    tangent = np.zeros((count, 3, 14))
    for channel in range(3):
        tangent[:, channel, 4 * channel : 4 * channel + 3] = seen
        tangent[:, channel, 4 * channel + 3] = 1.0
    across = np.linalg.svd(field[None])[2][1:]  # two unit vectors at right angles to the field
    for turn in range(2):
        turned = np.linalg.norm(field) * np.einsum("nij,i->nj", R_base_tool, across[turn])
        tangent[:, :, 12 + turn] = turned @ rows.T
    return tangent


def _stacked(values: Array) -> Array:
    """(n, 3, ...) -> (3 n, ...)."""
    return values.reshape(-1, *values.shape[2:])
