"""How many channels that share nothing tell as much as some that share noise."""

from __future__ import annotations

import numpy as np

from rig.arrays import Array


def equivalent_channels(values: Array) -> float:
    """The number of independent channels whose mean square scatters as much as that of some which are correlated
    (Satterthwaite, Biometrics Bulletin 2, 1946).

    Args:
        values: (n, c) about zero, of each channel not all zero.
    """
    alike = values / np.sqrt(np.mean(values**2, axis=0))
    return float(values.shape[1] ** 2 / np.sum((alike.T @ alike / len(alike)) ** 2))
