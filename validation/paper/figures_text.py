"""Figures 3 and 4 of Renk et al.: what one draw of the noise can show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import erf

from estimators.known_angle.model import Method
from rig.channels import ACCELEROMETER
from scenarios.loader import load
from scenarios.studies.coordinates import Coordinates
from scenarios.studies.settings import Settings, expected
from validation.paper.published import renk


@dataclass(frozen=True)
class OneDraw:
    """What the text says of the end of a curve, beside the bound there.

    Attributes:
        figure, method, noise_factor, samples: which curve, where.
        parameter, unit: "sensitivity1" or "offset1".
        within: how far off the estimate is at most. bound: the standard deviation of an efficient estimate there.
        probability: of an efficient estimate to be no farther off than that.
    """

    figure: str
    method: Method
    noise_factor: float
    samples: int
    parameter: str
    unit: str
    within: float
    bound: float
    probability: float


def one_draws() -> tuple[OneDraw, ...]:
    """Every such remark."""
    settings = Settings.of(load("renk2005-table2"), 2)
    poses = expected(settings)
    x = np.hstack([poses.rotations, np.ones((len(poses.rotations), 1))])
    found = []
    for entry in renk()["figures"]:
        rows = x[: entry["samples"]]
        method: Method = entry["method"]
        coordinates = Coordinates(poses.truth[ACCELEROMETER], method)
        noise = entry["noise_factor"] * poses.noise[ACCELEROMETER]
        bound = np.sqrt(coordinates.bound(rows.T @ rows, noise).diagonal())
        for name in ("sensitivity", "offset"):
            if name not in entry:
                continue
            own = float(bound[coordinates.names.index(f"{name}1")])
            within = float(entry[name])
            unit = "V" if name == "offset" else "V s²/m"
            found.append(
                OneDraw(
                    entry["figure"],
                    method,
                    float(entry["noise_factor"]),
                    entry["samples"],
                    f"{name}1",
                    unit,
                    within,
                    own,
                    float(erf(within / own / np.sqrt(2.0))),
                )
            )
    return tuple(found)
