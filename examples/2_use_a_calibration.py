"""Turn readings into fields: field = matrix @ (reading - bias)."""

import numpy as np

import estimators
import scenarios

run = scenarios.load("ann-arbor").simulate(seed=0)
calibration = estimators.calibrate(run)

magnetometer = calibration["magnetometer"]
field = (run.readings("magnetometer") - magnetometer.bias) @ magnetometer.matrix.T  # (n, 3), frame 6
strength = np.linalg.norm(field, axis=1)
print(f"the field's strength: {strength.mean():.4f} ± {strength.std():.4f} G")
print(f"stated: {magnetometer.reference_magnitude:.4f} G")
