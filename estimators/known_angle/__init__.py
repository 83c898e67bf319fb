"""Calibration at known joint angles or poses: the model of Renk et al., its fit, and what the poses can tell."""
