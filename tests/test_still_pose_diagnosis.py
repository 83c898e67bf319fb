"""Poses without times: they have an order, and what needs times is left out of their diagnosis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import estimators
import scenarios


def test_a_diagnosis_of_poses_without_times_names_nothing_that_needs_them() -> None:
    run = scenarios.load("ann-arbor").simulate(seed=3).select(slice(None, None, 16))
    poses = replace(run, t=np.arange(float(len(run))), metadata=replace(run.metadata, still_poses=True, rate_Hz=None))
    assert poses.untimed
    assert not run.untimed
    found = estimators.diagnose(poses)
    left_out = {each["effect"] for each in found.cannot_tell if "no times" in each["why"]}
    assert {"latency", "sensor_lag", "bias_warmup", "vibration", "motion_acceleration"} <= left_out
    assert not {"bias_step", "joint_offset", "scale_cubic"} & left_out
    assert not {cause.effect for cause in found.causes} & left_out
