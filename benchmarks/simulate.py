"""The simulation of the whole sweep, beside MuJoCo's bare kinematics and beside real time."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import mujoco
import numpy as np
from mujoco.batch import Batch
from mujoco.rollout import Rollout

import scenarios
from benchmarks._measure import Cell, Goal, Report, Settings, Table, Timing, interleaved, timing_table
from rig.arm import Arm
from rig.arrays import Array
from rig.maneuver import TorusSweep
from scenarios.scenario import Scenario

TITLE = "simulating both sensors over the whole sweep, beside MuJoCo alone"

_BLOCK: Final = 4096
_BARE = "bare MuJoCo kinematics (mujoco.batch)"
_LOOP = "one mj_kinematics a sample (Python loop)"
_YOURDFPY = "yourdfpy, one pose a sample (extrapolated)"
_FEW: Final = 1000  # poses that yourdfpy is timed on


def run(settings: Settings) -> Report:
    kinematic, first = _kinematic(settings)
    dynamic, second = _dynamic(settings)
    return Report(
        (kinematic[0], dynamic[0]), (*kinematic[1], *dynamic[1]), {kinematic[0].title: first, dynamic[0].title: second}
    )


def _kinematic(settings: Settings) -> tuple[tuple[Table, tuple[Goal, ...]], dict[str, Timing]]:
    scenario = scenarios.load("ann-arbor").with_acquisition(decimation=1)
    arm = Arm.a465()
    q = scenario.simulate(settings.seed).q
    assert q is not None
    calls: dict[str, Callable[[], object]] = {
        "torusrig, quasi-static": lambda: scenario.simulate(settings.seed),
        "torusrig, with accelerations": lambda: replace(scenario, motion="inertial").simulate(settings.seed),
        _BARE: lambda: bare_kinematics(arm.chain.bare, q),
        _LOOP: lambda: rotations_one_by_one(arm, q),
    }
    timings = interleaved(calls, settings.rounds_of(9, 2))
    some = yourdfpy_poses(arm, q[:: len(q) // _FEW][:_FEW])
    few = interleaved({_YOURDFPY: some}, settings.rounds_of(3, 1), fewer={_YOURDFPY: 3})[_YOURDFPY]
    timings[_YOURDFPY] = Timing(tuple(seconds * len(q) / _FEW for seconds in few.seconds))
    error = _volts_error(scenario, arm)
    errors: dict[str, Cell] = {"torusrig, quasi-static": error}
    table = timing_table(
        f"{len(q):,} samples of both sensors, joint angles to volts with noise and converter",
        timings,
        beside=[_BARE, _LOOP],
        further={"largest error [V]": errors},
        formats={"largest error [V]": ".1e"},
        note="Error: without noise and converter, against one mj_kinematics a sample and the sensor's equation."
        " MuJoCo and yourdfpy give poses only.",
    )
    seconds = timings["torusrig, quasi-static"].median
    return (
        table,
        (Goal(f"{len(q):,} samples of both sensors, kinematic engine [s]", seconds, "at most", 1.0),),
    ), timings


def _dynamic(settings: Settings) -> tuple[tuple[Table, tuple[Goal, ...]], dict[str, Timing]]:
    sweep = TorusSweep()
    if settings.quick:
        sweep = replace(sweep, duration_s=60.0, yaw_passes=1, pitch_passes=1)
    scenario = replace(scenarios.load("ann-arbor").with_acquisition(decimation=1), maneuver=sweep, engine="dynamic")
    arm = Arm.a465()
    duration = sweep.duration_s
    calls: dict[str, Callable[[], object]] = {
        "torusrig, dynamic engine": lambda: scenario.simulate(settings.seed),
        "bare MuJoCo steps (mujoco.rollout)": lambda: bare_steps(arm.model, duration),
    }
    rounds = settings.rounds_of(3, 1)
    timings = interleaved(calls, rounds, fewer=dict.fromkeys(calls, rounds))
    faster: dict[str, Cell] = {name: duration / timing.median for name, timing in timings.items()}
    table = timing_table(
        f"{duration:,.0f} s of the sweep at 1 kHz, driven by position actuators",
        timings,
        beside=["bare MuJoCo steps (mujoco.rollout)"],
        further={"times real time": faster},
    )
    goal = Goal(
        f"dynamic engine, {duration:,.0f} s of the sweep, times real time",
        float(faster["torusrig, dynamic engine"] or 0),
        "at least",
        100.0,
    )
    return (table, (goal,)), timings


def bare_kinematics(model: mujoco.MjModel, q: Array) -> None:
    """The site's pose at every row of q, on all cores; nothing is kept."""
    batch = Batch(model, _BLOCK, 0)
    qpos, _, _ = batch.bind("qpos"), batch.bind("site_xmat"), batch.bind("site_xpos")
    stage = mujoco.mjtStage.mjSTAGE_POS.value
    for start in range(0, len(q), _BLOCK):
        count = min(_BLOCK, len(q) - start)
        qpos[:count] = q[start : start + count]
        batch.forward(np.arange(count) if count < _BLOCK else None, stage=stage)


def rotations_one_by_one(arm: Arm, q: Array) -> Array:
    """R_base_tool (n, 3, 3) by one ``mj_kinematics`` a sample."""
    model = arm.chain.bare
    data = mujoco.MjData(model)
    qpos, site = data.qpos, data.site_xmat
    result = np.empty((len(q), 9))
    for row, angles in enumerate(q):
        qpos[:] = angles
        mujoco.mj_kinematics(model, data)
        result[row] = site[0]
    return result.reshape(-1, 3, 3)


def yourdfpy_poses(arm: Arm, q: Array) -> Callable[[], object]:
    """A call that has yourdfpy pose the arm's URDF at every row of q."""
    from yourdfpy import URDF

    urdf = URDF.load(str(arm.urdf), load_meshes=False, build_scene_graph=True)
    tip = urdf.robot.links[-1].name

    def poses() -> None:
        for angles in q:
            urdf.update_cfg(angles)
            urdf.get_transform(tip, urdf.base_link)

    return poses


def bare_steps(model: mujoco.MjModel, duration_s: float) -> None:
    """As many steps of 1 ms, in blocks of 10 s, towards one place."""
    model = copy.copy(model)
    model.opt.timestep = 1e-3
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0) if model.nkey else mujoco.mj_resetData(model, data)
    physics = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty(mujoco.mj_stateSize(model, physics))
    mujoco.mj_getState(model, data, state, physics)
    control = np.tile(data.qpos[: model.nu], (1, 10_000, 1))
    for _ in range(round(duration_s / 10.0)):
        with Rollout(nthread=0) as rollout:
            states, _ = rollout.rollout(model, data, state[None], control)
        state = states[0, -1].copy()


def _volts_error(scenario: Scenario, arm: Arm) -> float:
    """The largest difference from the sensor's equation with rotations one by one [V], every 25th sample."""
    clean = scenario.with_acquisition(noise_V=(0.0,) * 6, bits=None, decimation=25).simulate(0)
    assert clean.q is not None
    rotations = rotations_one_by_one(arm, clean.q)
    worst = 0.0
    for name, sensor in scenario.truth.sensors.items():
        field = scenario.rig.environment.field(name)
        gain = np.array(sensor.sensitivity)[:, None] * sensor.axes
        expected = np.einsum("i,nij->nj", field, rotations) @ gain.T + np.array(sensor.offset)
        worst = max(worst, float(np.abs(clean.readings(name) - expected).max()))
    return worst
