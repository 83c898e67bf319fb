"""Is a calibration good? What its recording says about that, and how to calibrate in spite of outliers."""

from estimators.goodness.by_direction import ByDirection, by_direction
from estimators.goodness.hold_out import HoldOut, hold_out
from estimators.goodness.judgement import is_it_good, judged
from estimators.goodness.outliers import Outliers, outliers
from estimators.goodness.own_optimum import Transfer, at_optimum
from estimators.goodness.raw_readings import Clipped, Repeats, clipped, repeats
from estimators.goodness.residuals import Residuals, residuals_of
from estimators.goodness.robust_calibration import Rejection, reject_outliers, robust_calibrate
from estimators.goodness.several import as_one, judged_together
from estimators.goodness.whiteness import Whiteness, whiteness
from estimators.goodness.words import Goodness

__all__ = [
    "ByDirection",
    "Clipped",
    "Goodness",
    "HoldOut",
    "Outliers",
    "Rejection",
    "Repeats",
    "Residuals",
    "Transfer",
    "Whiteness",
    "as_one",
    "at_optimum",
    "by_direction",
    "clipped",
    "hold_out",
    "is_it_good",
    "judged",
    "judged_together",
    "outliers",
    "reject_outliers",
    "repeats",
    "residuals_of",
    "robust_calibrate",
    "whiteness",
]
