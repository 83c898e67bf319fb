"""Attitude-free calibration: what the constant magnitude of a field tells of a triaxial sensor; Camps et al. (2009)."""

from estimators.ellipsoid.alignment import Alignment, align
from estimators.ellipsoid.assembly import assemble
from estimators.ellipsoid.calibrate import AttitudeFree, Options, calibrate_attitude_free, read_thinned
from estimators.ellipsoid.fit import EllipsoidFit, fit_ellipsoid
from estimators.ellipsoid.levenberg import Start

__all__ = [
    "Alignment",
    "AttitudeFree",
    "EllipsoidFit",
    "Options",
    "Start",
    "align",
    "assemble",
    "calibrate_attitude_free",
    "fit_ellipsoid",
    "read_thinned",
]
