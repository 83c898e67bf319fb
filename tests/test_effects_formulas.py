"""Every mean effect against its formula, sample by sample, by a program that shares nothing with the effects."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import effects_reference as reference
import mujoco
import numpy as np
import pytest
from effects_reference import FIELD, FULL, Sample, about_z, readings, rodrigues
from effects_rig import EVERYWHERE, MEAN, TIMES, made, pipeline, signals, values, volts

from rig.arm import Arm
from rig.arrays import Array
from rig.channels import CHANNELS
from rig.effects import EFFECTS

Formula = Callable[[str, dict[str, Any]], Array]

#: A dozen roundings of volts, of which the 64 turns of joint 6 cost the most.
ROUNDING = 1e-12
MAGNITUDE = float(np.linalg.norm(FIELD))
COLUMNS = {"accelerometer": range(3), "magnetometer": range(3, 6)} | {name: [k] for k, name in enumerate(CHANNELS)}


def on_joint(where: str, angle: Callable[[float, Sample], float]) -> Array:
    column = int(where[-1]) - 1

    def joints(sample: Sample) -> Array:
        q = sample.q.copy()
        q[column] = angle(q[column], sample)
        return q

    return readings(TIMES, joints=joints)


def backlash(where: str, p: dict[str, Any]) -> Array:
    column = int(where[-1]) - 1
    encoder = reference.joint_angles(TIMES)[:, column]
    travel = encoder[2:] - encoder[:-2]
    side = [np.sign(travel[0])]
    for row, moved in enumerate(np.concatenate([travel[:1], travel, travel[-1:]])[1:], start=1):
        last = encoder[row] - encoder[row - 1]  # at the turn itself the lash lies where the last motion left it
        side.append(np.sign(moved) if abs(moved) > 2e-4 else np.sign(last))
    joint = encoder - 0.5 * p["width_rad"] * np.array(side)
    return on_joint(where, lambda q, s: joint[s.row])


def compliance(where: str, p: dict[str, Any]) -> Array:
    if where == "joint5":
        return on_joint(where, lambda q, s: q - p["droop_rad"] * np.cos(q))
    column = int(where[-1]) - 1
    return on_joint(where, lambda q, s: q - p["droop_rad"] * torque(s.q, column) / largest_torque(column))


def torque(q: Array, column: int) -> float:
    """How fast the arm's potential energy grows with a joint, by differences; exact but for rounding (1e-10 N m)."""
    model = Arm.a465().model
    data = mujoco.MjData(model)
    energy = []
    for step in (np.pi / 2.0, -np.pi / 2.0):  # the energy is a + b cos q + c sin q
        data.qpos[:] = q
        data.qpos[column] += step
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        energy.append(-float(model.body_mass @ (data.xipos @ model.opt.gravity)))
    return 0.5 * (energy[0] - energy[1])


@cache
def largest_torque(column: int) -> float:
    """Of all poses with the arm in one plane at right angles: the stretched one is among them."""
    right = np.pi / 2.0 * np.arange(4)
    return max(abs(torque(np.array([0.0, *q, 0.0]), column)) for q in itertools.product(right, repeat=4))


def misalignment(where: str, p: dict[str, Any]) -> Array:
    return readings(TIMES, twist=(int(where[-1]), p["twist_rad"]))


def rocking(where: str, p: dict[str, Any]) -> Array:
    soft = np.array([np.cos(p["phase_rad"]), np.sin(p["phase_rad"]), 0.0])

    def pose(s: Sample) -> None:
        reach = about_z(s.q[0]) @ [1.0, 0.0, 0.0]  # the arm's azimuth
        tilt = rodrigues(np.cross([0.0, 0.0, 1.0], soft), p["tilt_rad"] * float(reach @ soft))
        s.R, s.p = tilt @ s.R, tilt @ s.p

    return readings(TIMES, pose=pose)


def slip(where: str, p: dict[str, Any]) -> Array:
    r = np.array(p["rotation_rad"])

    def pose(s: Sample) -> None:
        if s.t >= p["at_s"]:
            s.R = s.R @ rodrigues(r / np.linalg.norm(r), float(np.linalg.norm(r)))

    return readings(TIMES, pose=pose)


def vibration(where: str, p: dict[str, Any]) -> Array:
    d = p["amplitude_m_s2"] * np.array(p["direction"]) / np.linalg.norm(p["direction"])

    def pose(s: Sample) -> None:
        fixed_in = {"base": np.eye(3), "link1": s.frames[1][:3, :3], "tool": s.R}[p.get("frame", "base")]
        s.a = fixed_in @ d * np.sin(2.0 * np.pi * p["freq_Hz"] * s.t + p["phase_rad"])

    return readings(TIMES, pose=pose)


def field(change: Callable[[Sample], Array]) -> Array:
    def pose(s: Sample) -> None:
        s.B = s.B + MAGNITUDE * change(s)

    return readings(TIMES, pose=pose)


def gradient(where: str, p: dict[str, Any]) -> Array:
    xx, yy, xy, xz, yz = p["gradient_per_m"]
    G = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, -xx - yy]])
    return field(lambda s: G @ s.p)


def dipole(where: str, p: dict[str, Any]) -> Array:
    m = np.array(p["moment"])

    def change(s: Sample) -> Array:
        d = float(np.linalg.norm(s.p - p["position_m"]))
        u = (s.p - p["position_m"]) / d
        return (3.0 * u * float(u @ m) - m) / d**3

    return field(change)


def link_frame(s: Sample, where: str) -> Array:
    return s.frames[int(where[-1])][:3, :3]


def soft_iron(where: str, p: dict[str, Any]) -> Array:
    xx, yy, zz, xy, xz, yz = p["chi"]
    X = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return field(lambda s: link_frame(s, where) @ X @ link_frame(s, where).T @ FIELD / MAGNITUDE)


def motor(where: str, p: dict[str, Any]) -> Array:
    link = {"joint1": "link1", "joint5": "link4", "joint6": "link5"}[where]
    column = int(where[-1]) - 1
    return field(lambda s: link_frame(s, link) @ p["field"] * np.tanh(s.speed[column] / 1e-3))


def on_axis(where: str, input_: Callable[[float, float, Sample, int], float]) -> Array:
    def axis(x: Array, s: Sample) -> Array:
        return np.array([input_(x[k], FULL[k], s, k) if k in COLUMNS[where] else x[k] for k in range(6)])

    return readings(TIMES, axis=axis)


def hysteresis(where: str, p: dict[str, Any]) -> Array:
    memory: dict[int, float] = {}

    def played(x: float, X: float, s: Sample, k: int) -> float:
        r = p["half_width"] * X
        before = memory.get(k, x)
        memory[k] = x - r if before < x - r else x + r if before > x + r else before
        return memory[k]

    return on_axis(where, played)


def on_volts(where: str, reading: Callable[[float, Sample, int, Array], float]) -> Array:
    def changed(V: Array, s: Sample) -> Array:
        return np.array([reading(V[k], s, k, V) if k in COLUMNS.get(where, range(6)) else V[k] for k in range(6)])

    return readings(TIMES, volts=changed)


def supply(where: str, p: dict[str, Any]) -> Array:
    recorded = signals().supply
    assert recorded is not None
    span = TIMES[-1] - TIMES[0]

    def e(s: Sample) -> float:
        slow = sum(w * np.cos(np.pi * (k + 1) * s.elapsed / span) for k, w in enumerate(p["waveform"]))
        return float(slow + p["supply_V"] * (recorded[s.row] / recorded.mean() - 1.0))

    return on_volts(where, lambda V, s, k, all_: V * (1.0 + e(s)))


def hum(where: str, p: dict[str, Any]) -> Array:
    def reading(V: float, s: Sample, k: int, all_: Array) -> float:
        return V + p["amplitude"][k] * float(np.sin(2.0 * np.pi * p["freq_Hz"] * s.t + p["phase_rad"][k]))

    return on_volts(where, reading)


FORMULAS: dict[str, Formula] = {
    "joint_offset": lambda where, p: on_joint(where, lambda q, s: q + p["offset_rad"]),
    "joint_scale": lambda where, p: on_joint(where, lambda q, s: (1.0 + p["scale"]) * q),
    "joint_eccentricity": lambda where, p: on_joint(
        where, lambda q, s: q + p["amplitude_rad"] * np.sin(q + p["phase_rad"])
    ),
    "harmonic_drive_error": lambda where, p: on_joint(
        where, lambda q, s: q + p["amplitude_rad"] * np.sin(p["order"] * q + p["phase_rad"])
    ),
    "backlash": backlash,
    "joint_compliance": compliance,
    "axis_misalignment": misalignment,
    "base_rocking": rocking,
    "mounting_slip": slip,
    "vibration": vibration,
    "field_gradient": gradient,
    "base_dipole": dipole,
    "link_hard_iron": lambda where, p: field(lambda s: link_frame(s, where) @ p["field"]),
    "link_soft_iron": soft_iron,
    "motor_current_field": motor,
    "scale_quadratic": lambda where, p: on_axis(where, lambda x, X, s, k: x + p["fraction_of_full"] * x**2 / X),
    "scale_cubic": lambda where, p: on_axis(where, lambda x, X, s, k: x + p["fraction_of_full"] * x**3 / X**2),
    "hysteresis": hysteresis,
    "bias_warmup": lambda where, p: on_volts(
        where, lambda V, s, k, _: V + p["coefficient"][k % 3] * float(np.exp(-s.elapsed / p["tau_s"]))
    ),
    "bias_temperature": lambda where, p: on_volts(
        where, lambda V, s, k, _: V + p["coefficient_per_degC"][k % 3] * s.warmth
    ),
    "scale_temperature": lambda where, p: on_axis(
        where, lambda x, X, s, k: x * (1.0 + p["coefficient_per_degC"][k % 3] * s.warmth)
    ),
    "bias_step": lambda where, p: on_volts(where, lambda V, s, k, _: V + (p["volts"] if s.t >= p["at_s"] else 0.0)),
    "supply_ratiometric": supply,
    "channel_crosstalk": lambda where, p: on_volts(
        where, lambda V, s, k, all_: V + p["coefficient"] * (all_[CHANNELS.index(p["source"])] - 2.5)
    ),
    "mains_hum": hum,
}
#: Effects of time, which need the readings between the samples: ``test_effects_time.py``, ``test_effects_log.py``.
BETWEEN_SAMPLES = {"latency", "sensor_lag", "motion_acceleration", "pose_interpolation"}


def table(name: str, where: str) -> dict[str, Any]:
    effect = made(name, where)
    return {key: getattr(effect, key) for key in (*values(type(effect)), *effect.choices())}


def test_the_plain_model_is_the_rig() -> None:
    np.testing.assert_allclose(volts(), readings(TIMES), rtol=0.0, atol=ROUNDING)


def test_every_mean_effect_has_its_formula_here() -> None:
    assert set(FORMULAS) | BETWEEN_SAMPLES == set(MEAN)


@pytest.mark.parametrize(("name", "where"), [pair for pair in EVERYWHERE if pair[0] in FORMULAS])
def test_the_change_equals_the_formula(name: str, where: str) -> None:
    expected = FORMULAS[name](where, table(name, where))
    changed = volts(made(name, where))
    size = np.abs(expected - readings(TIMES)).max()
    assert size > 1e4 * ROUNDING, "the formula must have something to say"
    np.testing.assert_allclose(changed, expected, rtol=0.0, atol=ROUNDING)


@pytest.mark.parametrize("frame", ["base", "link1", "tool"])
def test_a_vibration_is_fixed_in_its_frame(frame: str) -> None:
    effect = made("vibration", frame=frame)
    expected = vibration("accelerometer", table("vibration", "accelerometer") | {"frame": frame})
    np.testing.assert_allclose(volts(effect), expected, rtol=0.0, atol=ROUNDING)


@pytest.mark.parametrize("where", EFFECTS["motor_current_field"].places)
def test_a_motors_field_follows_the_logged_current(where: str) -> None:
    current = 0.4 + np.sin(0.1 * TIMES)
    logged = replace(signals(), currents={int(where[-1]): current})
    changed = pipeline(made("motor_current_field", where)).expected(logged, np.random.default_rng(0)).volts
    p = table("motor_current_field", where)
    link = {"joint1": "link1", "joint5": "link4", "joint6": "link5"}[where]
    expected = field(lambda s: link_frame(s, link) @ p["field"] * current[s.row])
    np.testing.assert_allclose(changed, expected, rtol=0.0, atol=ROUNDING)


def test_the_harmonic_drives_order_is_twice_the_ratio_of_its_joint() -> None:
    orders = {where: EFFECTS["harmonic_drive_error"](where=where) for where in ("joint1", "joint5", "joint6")}
    assert {where: effect.order for where, effect in orders.items()} == {"joint1": 200, "joint5": 200, "joint6": 202}  # type: ignore[attr-defined]


def test_the_gradient_is_free_of_curl_and_divergence() -> None:
    effect = made("field_gradient")
    matrix = effect.matrix  # type: ignore[attr-defined]
    assert np.array_equal(matrix, matrix.T)
    assert abs(np.trace(matrix)) < 1e-17


def test_a_dipoles_field_is_free_of_curl_and_divergence() -> None:
    """By differences over 1 mm, 0.4 m away: their error is (1 mm / 0.4 m)^2 of the gradient, with a factor of ten."""
    step = 1e-3
    at = np.array([0.8, 0.5, 0.6])
    points = np.array([at + sign * step * axis for axis in np.eye(3) for sign in (1.0, -1.0)])
    posed = replace(
        signals(np.arange(6.0)), position=points, magnetic=np.zeros(3), references=np.ones(6), R_base_tool=np.eye(3)
    )
    B = made("base_dipole", position_m=(0.5, 0.3, 0.4)).apply(posed, np.random.default_rng(0)).magnetic
    gradient_ = (B[::2] - B[1::2]) / (2.0 * step)  # [axis, component]
    size = np.linalg.norm(gradient_)
    assert size > 1e-3
    assert abs(np.trace(gradient_)) < 10.0 * (step / 0.4) ** 2 * size
    assert np.abs(gradient_ - gradient_.T).max() < 10.0 * (step / 0.4) ** 2 * size


def test_levels_and_steps_of_the_converter() -> None:
    readings_ = np.random.default_rng(3).uniform(0.0, 5.0, (500, 6))
    before = replace(signals(np.arange(500.0)), volts=readings_)
    rng = np.random.default_rng(0)
    for k, where in enumerate(CHANNELS):
        for level in (3.6, 1.4):
            out = made("saturation", where, level=level).apply(before, rng).volts
            for row in range(500):
                clipped = min(readings_[row, k], level) if level > 2.5 else max(readings_[row, k], level)
                assert out[row, k] == clipped
            assert np.array_equal(np.delete(out, k, axis=1), np.delete(readings_, k, axis=1))
    coarse = made("adc_quantisation", lsb_V=0.011).apply(before, rng).volts
    for value, given in zip(coarse.ravel(), readings_.ravel(), strict=True):
        assert abs(value - given) <= 0.0055 * (1.0 + 1e-12)
        assert abs(value / 0.011 - round(value / 0.011)) < 1e-9


def test_the_reference_arm_is_not_the_rigs() -> None:
    """The two agree because both are right: this one is DH matrices, the other a MuJoCo model."""
    poses = Arm.a465().poses(reference.joint_angles(TIMES))
    links = Arm.a465().link_poses(reference.joint_angles(TIMES))
    for row in range(0, len(TIMES), 40):
        frames = reference.frames(reference.joint_angles(TIMES)[row])
        np.testing.assert_allclose(poses.R_base_tool[row], frames[6][:3, :3], atol=1e-13)
        for joint in range(6):
            np.testing.assert_allclose(links.rotation[row, joint], frames[joint + 1][:3, :3], atol=1e-13)
