"""Recordings made ready: checked, calibrated, whitened by their floors, the calibration projected out."""
