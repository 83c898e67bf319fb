"""Calibrate a magnetometer that was turned by hand: only the field's magnitude is known."""

import estimators
import scenarios

run = scenarios.load("camps2009-magnetometer").simulate(seed=0)
calibration = estimators.calibrate(run, method="ellipsoid")
print(calibration)
