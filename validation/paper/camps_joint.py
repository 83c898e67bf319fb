"""Three tests of Camps et al. against triples of the rig's: all parameters of a table at once, two-sided."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import chi2

from rig.arrays import Array
from rig.maneuver import HandTumble
from validation.paper.camps import TESTS, column_in_row, scenario_of, tumbles
from validation.paper.published import ellipsoid_table

#: Triples of experiments that the published three tests are held against.
TRIPLES: Final = 20_000


@dataclass(frozen=True)
class JointScatter:
    """All parameters of one table at once: do three tests scatter as three of the rig's do?

    Attributes:
        table, sensor: which. speed_deg_per_s: RMS, of the rig's tumbles.
        level: geometric mean over the parameters of scatter over the rig's. level_p: of a level so far off, two-sided.
        unevenness: standard deviation over the parameters of the logarithm of that ratio. unevenness_p: two-sided.
        chi_square, degrees_of_freedom, p_value: of the three tests about their mean, by the covariance of the rig's;
            the probability is two-sided.
        left_out: the parameter whose row is misprinted; None if there is none.
    """

    table: str
    sensor: str
    speed_deg_per_s: float
    level: float
    level_p: float
    unevenness: float
    unevenness_p: float
    chi_square: float
    degrees_of_freedom: int
    p_value: float
    left_out: str | None


def joint_scatter(number: str, speed_deg_per_s: float | None = None) -> JointScatter:
    """Held against triples of the rig's experiments, so that the parameters' correlation is in it.

    Args:
        number: of the table.
        speed_deg_per_s: of the hand; None: the scenario's.
    """
    table = ellipsoid_table(number)
    many = tumbles(table.sensor, speed_deg_per_s)
    slip = column_in_row(table)
    names = [name for name in table.rows if name != slip]
    own = many.estimates[table.parameters][:, [many.names[table.parameters].index(name) for name in names]]
    unit = own.std(axis=0)
    rng = np.random.default_rng([2009, int(number)])
    # Normal ones with the experiments' covariance: there are more triples of them than of sixty experiments.
    root = np.linalg.cholesky(np.corrcoef(own.T))
    triples = rng.standard_normal((TRIPLES, TESTS, len(names))) @ root.T
    logs = np.log(triples.std(axis=1, ddof=1))
    published = np.array([[one.value for one in table.rows[name]] for name in names])
    found = np.log(published.std(axis=1, ddof=1) / unit)
    level, uneven = float(found.mean()), float(found.std())
    away = published - published.mean(axis=1, keepdims=True)
    chi_square = float(np.einsum("it,ij,jt->", away, np.linalg.inv(np.cov(own.T)), away))
    freedom = (TESTS - 1) * len(names)
    tail = float(chi2.sf(chi_square, freedom))
    maneuver = scenario_of(table.sensor).maneuver
    assert isinstance(maneuver, HandTumble)
    return JointScatter(
        number,
        table.sensor,
        speed_deg_per_s or maneuver.speed_deg_per_s,
        float(np.exp(level)),
        _rank(level, logs.mean(axis=1)),
        uneven,
        _rank(uneven, logs.std(axis=1)),
        chi_square,
        freedom,
        2.0 * min(tail, 1.0 - tail),
        slip,
    )


def _rank(value: float, drawn: Array) -> float:
    """Two-sided probability of a value among drawn ones."""
    below = (float((drawn <= value).sum()) + 1.0) / (len(drawn) + 2.0)
    return 2.0 * min(below, 1.0 - below)
