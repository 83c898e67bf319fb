"""Would an optimiser that stops early make the scatter of Table 7, or Table 3's fields? The paper's way, on 25 data
sets of the rig."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from estimators.known_angle.model import Method
from estimators.known_angle.quasi_newton import FIELD_START, QuasiNewton, quasi_newton
from estimators.known_angle.statistics import Statistics
from rig.arrays import Array
from rig.channels import ACCELEROMETER
from rig.directions import angles_from_direction
from scenarios.studies.increments import Increments
from scenarios.studies.settings import Settings, expected
from validation.paper.published import parameter_table, renk, spread_table
from validation.paper.renk import spread_limits
from validation.paper.renk_text import misfits
from validation.paper.simulated import displacement_deg, scenario_of

#: A search ends with the first iteration that lowers the cost by a smaller share; phi at the start [deg]: straight
#: down, and far from it.
CASES: Final = ((None, 90.0), (1e-6, 90.0), (1e-4, 90.0), (1e-4, 60.0))
#: Data sets that are also fitted channel by channel.
_SEPARATE: Final = 5
_SEED: Final = 7


@dataclass(frozen=True)
class EarlyStop:
    """Scatter of 25 fits that end early.

    Attributes:
        tolerance: relative fall of the cost that ends a search; None: the gradient. start_deg: phi at the start.
        iterations: median.
        phi_deg, beta2_deg: standard deviations over the data sets. fit_error: mean, root of the summed squares [V].
        apart_deg: between the fields of three separate fits, the largest angle: its largest value.
        like_table_7: whether both scatters are as in Table 7, as far as 25 values tell (95 %).
        like_table_3: whether separate fields come as far apart as in Table 3.
    """

    tolerance: float | None
    start_deg: float
    iterations: float
    phi_deg: float
    beta2_deg: float
    fit_error: float
    apart_deg: float
    like_table_7: bool
    like_table_3: bool


@cache
def early_stops() -> tuple[EarlyStop, ...]:
    """Every tolerance from every start, on the same data sets."""
    settings = Settings.of(scenario_of(ACCELEROMETER), 2)
    poses = expected(settings)
    truth = poses.truth[ACCELEROMETER]
    noise = np.array([row.noise_like for row in misfits(ACCELEROMETER)])  # what Table 7 scatters by
    count, sets = len(poses.rotations), int(renk()["subsets"])
    sums = Increments.of(poses.rotations, poses.readings[ACCELEROMETER], np.arange(count), [count])
    cross, square = sums.draw(np.random.default_rng(_SEED), noise, sets)
    published = spread_table("7").std
    low, high = spread_limits()
    data = [Statistics(count, sums.gram[0], cross[0][k], np.diag(square[0][k])) for k in range(sets)]
    there = _largest_apart(parameter_table("3").fields)
    found = []
    for tolerance, start in CASES:

        def fitted(statistics: Statistics, method: Method, start: float, tolerance: float | None) -> QuasiNewton:
            begin = (float(np.radians(start)), FIELD_START[1])
            return quasi_newton(statistics, truth.reference_magnitude, method, begin, tolerance)

        ends = [fitted(each, "simultaneous", start, tolerance) for each in data]
        alone = [fitted(each, "separate", start, tolerance).parameters.fields for each in data[:_SEPARATE]]
        # Beyond the pole phi runs on, as the paper's does.
        phi = float(np.degrees([end.angles[0, 0] for end in ends]).std(ddof=1))
        beta = np.array([angles_from_direction(end.parameters.axes[1])[0] for end in ends])
        beta2 = float(beta.std(ddof=1))
        ratios = np.array([phi / published["phi_deg"].value, beta2 / published["beta2_deg"].value])
        # (g, P) and (-g, -P) fit alike: of each the one whose field points down.
        apart = max(_largest_apart(np.where(fields[:, 2:] > 0.0, -fields, fields)) for fields in alone)
        found.append(
            EarlyStop(
                tolerance,
                start,
                float(np.median([end.iterations for end in ends])),
                phi,
                beta2,
                float(np.sqrt(np.mean([end.cost for end in ends]) / count)),
                apart,
                bool(((low <= ratios) & (ratios <= high)).all()),
                apart >= there,
            )
        )
    return tuple(found)


def _largest_apart(fields: Array) -> float:
    """The largest angle between two of three unit vectors (3, 3) [deg]."""
    return max(displacement_deg(fields[i], fields[j]) for i, j in ((0, 1), (0, 2), (1, 2)))
