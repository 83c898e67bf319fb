"""Simulate a recording, calibrate its sensors, and count the errors in standard deviations."""

import estimators
import scenarios

scenario = scenarios.load("ann-arbor")
calibration = estimators.calibrate(scenario.simulate(seed=0))
print(calibration)

for row in scenarios.compare(scenario.truth, calibration):
    sigmas = "cannot be told" if row.error_sigmas is None else f"{row.error_sigmas:+.1f} standard deviations off"
    print(f"{row.sensor:13}  {row.parameter:14}  {sigmas}")
