"""Planned maneuvers: free of contacts, within what the arm may do, and as certain as they promise."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from arm_files import written
from cli_support import Rig

import estimators
import scenarios
from estimators.batch import ManyParameters, fit_many
from estimators.design.exchange import Criterion, exchange
from estimators.known_angle.identifiability import bound
from estimators.known_angle.model import SensorParameters
from estimators.stillness.at_rest import SETTLE_S, at_rest_samples
from rig.arm import Arm
from rig.arm.clearance import Clearance, finite_limits
from rig.channels import COLUMNS_OF
from rig.engine_dynamic import follow
from rig.errors import RefusedFit, RigError
from rig.maneuver import TorusSweep
from rig.maneuver.moves import Dynamics
from rig.maneuver.profile import PEAK_ACCELERATION, PEAK_SPEED, quintic
from rig.signals import Signals
from scenarios.bound import noise_of
from scenarios.isolability import isolability_of
from scenarios.plan import poses, sweeps, telling
from scenarios.plan.plan import Plan, criteria_of, make_plan, trajectory_csv


@pytest.fixture(scope="module")
def plan() -> Plan:
    """A short search: what it finds is worse than with patience, and as true."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(poses, "_CLIMBS", 300)
        patch.setattr(poses, "_COUNTS", (8,))
        patch.setattr(poses, "_CANDIDATES", 200)
        return make_plan(scenarios.load("ann-arbor"), 60.0, seed=1, name="short")


def test_it_stays_within_what_the_arm_may_do(plan: Plan) -> None:
    arm = Arm.a465()
    motion = plan.maneuver.trajectory()
    assert plan.maneuver.duration_s <= 60.0
    arm.check_limits(motion.q, "the plan")
    arm.check_speeds(motion.qd, "the plan")
    assert (np.abs(motion.qdd) <= Dynamics.of(arm).acceleration).all()
    assert not Clearance.of(arm).touching(motion.q[::10]).any()


def test_recordings_of_it_are_as_certain_as_promised(plan: Plan) -> None:
    """The servos drive it once, without a contact; 300 draws of noise and converter on what the sensors then feel.

    RMSE over the Cramer-Rao bound of 28 parameters: one of them within .8 and 1.2 (4.9 standard deviations of 300
    draws), the rest of the moves, which has not died down .1 s after them, counted; pooled within .94 and 1.06, four
    standard deviations were a third of them independent. One false failure in 10,000.
    """
    scenario, rng = plan.scenario, np.random.default_rng(0)
    truth, arm = scenario.truth, scenario.rig.arm
    assert arm is not None
    followed = follow(arm, plan.maneuver, truth.environment.gravity)
    assert not Clearance.of(arm, margin_m=0.0).touching(followed.q[::10]).any()
    felt = arm.site_acceleration(followed.q, followed.qd, followed.qdd)
    signals = Signals(followed.t, arm=arm, q_encoder=followed.q, acceleration=felt)
    volts, acquisition = scenario.rig.pipeline.expected(signals, rng).volts, scenario.rig.acquisition
    still = np.isin(followed.t, at_rest_samples(scenario.rig.record(signals, rng, 100.0)).t)
    assert still.sum() == pytest.approx(plan.found.samples_s * 100.0, abs=30 * plan.to_json()["poses"])
    x = np.hstack([arm.rotation_map.rotations(followed.q[still]), np.ones((still.sum(), 1))])
    drawn = [acquisition.convert(acquisition.add_noise(volts, rng))[still] for _ in range(300)]
    ratios = []
    for name, sensor in truth.sensors.items():
        known, noise = SensorParameters.of(sensor, truth.environment.field(name)), noise_of(scenario)[COLUMNS_OF[name]]
        readings = [each[:, COLUMNS_OF[name]] for each in drawn]
        fits = fit_many(
            x.T @ x,
            np.array([x.T @ each for each in readings]),
            np.array([(each**2).sum(axis=0) for each in readings]),
            len(x),
            noise,
            "simultaneous",
            reference_magnitude=known.reference_magnitude,
            field_points=known.fields[0],
        )
        errors = ManyParameters.stacked([known] * len(drawn)).errors(fits.parameters, "simultaneous")
        ratios.append(np.square(errors).mean(axis=0) / bound(x.T @ x, known, noise, "simultaneous").diagonal())
    found = np.sqrt(np.concatenate(ratios))
    assert found.min() > 0.8
    assert found.max() < 1.2
    assert 0.94 < np.sqrt(np.mean(found**2)) < 1.06


def test_the_bound_of_the_reference_is_one() -> None:
    scenario = scenarios.load("ann-arbor")
    x = np.hstack(
        [Arm.a465().rotation_map.rotations(TorusSweep().trajectory().q[::25]).reshape(-1, 9), np.ones((6656, 1))]
    )
    for criterion in criteria_of(scenario):
        assert criterion.worst(criterion.information(x.T @ x)[None])[0] == pytest.approx(1.0)
        assert criterion.worst(criterion.information(4.0 * x.T @ x)[None])[0] == pytest.approx(0.5)


def test_its_standard_deviations_are_those_of_the_bound() -> None:
    """Sensitivities and offsets are the same coordinates; an axis counts along elevation, which is beta."""
    scenario = scenarios.load("ann-arbor")
    bound = scenarios.bound.bound_of(scenario)
    for criterion in criteria_of(scenario):
        found = bound.sensors[criterion.sensor].prediction
        known = dict(zip(found.names, found.std, strict=True))
        truth = scenario.truth.sensors[criterion.sensor]
        for k in range(3):
            own = criterion.reference[4 * k : 4 * k + 4]
            assert own[0] * truth.sensitivity[k] == pytest.approx(known[f"sensitivity{k + 1}"], rel=1e-6)
            assert np.degrees(own[2]) == pytest.approx(known[f"beta{k + 1}_deg"], rel=1e-6)
        assert np.degrees(criterion.reference[12]) == pytest.approx(known["phi_deg"], rel=1e-6)


def test_an_exchange_only_helps() -> None:
    scenario = scenarios.load("ann-arbor")
    criteria = criteria_of(scenario)
    rng = np.random.default_rng(0)
    rotations = np.linalg.qr(rng.standard_normal((150, 3, 3)))[0]
    x = np.hstack([rotations.reshape(-1, 9), np.ones((150, 1))])
    grams = x[:, :, None] * x[:, None, :]
    start = np.arange(10)
    before = max(float(one.worst(one.information(500.0 * grams[start].sum(axis=0))[None])[0]) for one in criteria)
    chosen, value = exchange(criteria, grams, 10, 500.0, start, np.ones(150, dtype=bool))
    assert len(set(chosen.tolist())) == 10
    assert value < 0.8 * before
    again = max(float(one.worst(one.information(500.0 * grams[chosen].sum(axis=0))[None])[0]) for one in criteria)
    assert value == pytest.approx(again)


def test_weights_leave_out_and_count_more() -> None:
    scenario = scenarios.load("ann-arbor")
    truth = next(iter(criteria_of(scenario)))
    noise = np.asarray(scenario.rig.acquisition.noise_V)[COLUMNS_OF["accelerometer"]]
    assert truth.noise == pytest.approx(noise, rel=0.01)
    weighted = criteria_of(scenario, {"field": 0.0, "offset2": 3.0})[0]
    assert weighted.weight[-2:].tolist() == [0.0, 0.0]
    assert weighted.weight[5] == 3.0
    assert isinstance(weighted, Criterion)


def test_moves_take_as_long_as_speed_and_acceleration_ask() -> None:
    arm = Arm.a465()
    dynamics = Dynamics.of(arm)
    t = np.linspace(0.0, 1.0, 100_001)
    _, speed, change = quintic(t)
    assert speed.max() == pytest.approx(PEAK_SPEED)
    assert np.abs(change).max() == pytest.approx(PEAK_ACCELERATION, rel=1e-6)
    rng = np.random.default_rng(1)
    low, high = finite_limits(arm)
    one, other = rng.uniform(low, high, (2, 50, 6))
    seconds = dynamics.seconds(one, other)[:, None]
    assert (PEAK_SPEED * np.abs(other - one) / seconds <= dynamics.speed).all()
    assert (PEAK_ACCELERATION * np.abs(other - one) / seconds**2 <= dynamics.acceleration).all()
    assert "speeds" not in dynamics.assumed
    with pytest.raises(RigError, match="speed: found -1"):
        Dynamics.of(arm, speed=-1.0)


#: A rod of 0.5 m that turns about the vertical, 0.3 m above a plate that carries it.
ROD = """
<mujoco><worldbody><body name="plate"><geom type="box" size=".05 .05 .01"/>
  <body name="rod" pos="0 0 .3"><joint name="turn" axis="0 0 1" range="-170 170"/>
    <geom type="capsule" fromto="0 0 0 .5 0 0" size=".02"/><site name="imu" pos=".5 0 0"/>
  </body></body></worldbody></mujoco>
"""


@pytest.mark.parametrize("margin_m", [0.0, 0.01, 0.1, 0.4, 1.0])
def test_the_margin_is_the_distance_at_which_a_box_counts_as_touched(tmp_path: Path, margin_m: float) -> None:
    (tmp_path / "rod.xml").write_text(ROD)
    arm = Arm.from_file(tmp_path / "rod.xml", "imu")
    for distance_m in (margin_m - 1e-3, margin_m + 1e-3):
        face = 0.5 + 0.02 + distance_m  # the capsule's end is round
        box = (face, -1.0, -1.0, face + 1.0, 1.0, 1.0)
        clear = Clearance.of(arm, boxes=[box], margin_m=margin_m)
        assert clear.touching([[0.0]])[0] == (distance_m < margin_m)


def test_what_turns_above_the_table_is_not_asked_to_keep_off_it(tmp_path: Path) -> None:
    (tmp_path / "rod.xml").write_text(ROD)
    arm = Arm.from_file(tmp_path / "rod.xml", "imu")
    turns = np.linspace(-2.0, 2.0, 9)[:, None]
    assert not Clearance.of(arm, 0.0, margin_m=0.4).touching(turns).any()
    assert Clearance.of(arm, 0.3, margin_m=0.4).touching(turns).all()  # it lies in the table


@pytest.mark.parametrize("kind", ["poses", "sweep"])
def test_a_margin_beyond_the_room_there_is(rig: Rig, tmp_path: Path, kind: str) -> None:
    options = ("--seconds", "60", "--kind", kind, "--table", "0", "--margin", "0.6")
    line = rig.refused("plan", *options, "-o", tmp_path / "no.toml")
    assert line.endswith("expected more room: a lower table, fewer boxes, or a smaller --margin")
    assert not (tmp_path / "no.toml").exists()


def test_contacts_with_the_table_with_boxes_and_with_the_arm_itself(tmp_path: Path) -> None:
    arm = Arm.a465()
    clear = Clearance.of(arm)
    upright = np.radians([[0.0, 90.0, -90.0, 0.0, 0.0, 0.0]])
    assert not clear.touching(upright)[0]
    tool = arm.poses(upright).position[0]
    box = (*(tool - 0.05), *(tool + 0.05))
    assert Clearance.of(arm, boxes=[box]).touching(upright)[0]  # type: ignore[list-item]
    assert Clearance.of(arm, table_m=float(tool[2])).touching(upright)[0]
    folded = np.radians([[0.0, 90.0, 110.0, 0.0, 105.0, 0.0]])
    found = clear.first_contact(np.vstack([upright, folded, np.radians([[0.0, 0.0, -109.0, 0.0, 0.0, 0.0]])]))
    assert found is not None
    with pytest.raises(RigError, match="two opposite corners"):
        Clearance.of(arm, boxes=[(0.0, 0.0, 0.0, 0.0, 1.0, 1.0)])
    other = Arm.from_file(written(tmp_path, "ur5e"))
    slender = Clearance.of(other, table_m=0.0)
    assert slender.slender
    # Down through the table; straight up.
    assert slender.touching([[0.0, 1.2, 0.0, 0.0, 0.0, 0.0]])[0]
    assert not slender.touching([[0.0, -1.57, 0.0, -1.57, 0.0, 0.0]])[0]


def test_samples_at_rest_are_those_of_the_holds(plan: Plan) -> None:
    run = plan.scenario.simulate(seed=0)
    still = at_rest_samples(run)
    assert plan.maneuver.holding(still.t).all()
    holding = plan.maneuver.holding(run.t)
    inner = [holding[np.searchsorted(run.t, t - 0.9 * SETTLE_S)] for t in still.t if t > SETTLE_S]
    assert all(inner)
    with pytest.raises(RefusedFit, match="never at rest"):
        at_rest_samples(scenarios.load("ann-arbor").simulate(seed=0))


def test_the_trajectory_for_a_controller(plan: Plan) -> None:
    lines = trajectory_csv(plan).splitlines()
    header = lines[0].split(",")
    assert header[:2] == ["t_s", "joint1_deg"]
    table = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    assert table.shape == (round(100.0 * plan.maneuver.duration_s), 13)
    np.testing.assert_allclose(np.gradient(table[:, 1], 0.01)[2:-2], table[2:-2, 7], atol=2.0)


def test_the_command_plans_what_sweep_runs(rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(poses, "_CLIMBS", 60)
    monkeypatch.setattr(poses, "_COUNTS", (8,))
    monkeypatch.setattr(poses, "_CANDIDATES", 100)
    made, picture, table = tmp_path / "p.toml", tmp_path / "p.png", tmp_path / "p.csv"
    text = rig.done("plan", "--seconds", "40", "-o", made, "--csv", table, "--plot", picture)
    assert "readings at rest" in text
    assert picture.stat().st_size > 10_000
    assert table.read_text().startswith("t_s,")
    refused = rig("plan", made, "--seconds", "40", "-o", made)
    assert refused.status == 2
    assert "that is read, expected another name" in refused.err
    run = tmp_path / "run.parquet"
    rig.done("sweep", made, "-o", run)
    document = json.loads(rig.done("calibrate", run, "--still", "--json"))
    assert set(document["sensors"]) == {"accelerometer", "magnetometer"}
    ur5e = written(tmp_path, "ur5e")
    other = tmp_path / "u.toml"
    found = json.loads(rig.done("plan", "--arm", ur5e, "--seconds", "40", "-o", other, "--json"))
    assert found["links_as_capsules"] is True
    assert found["poses"] == 8
    assert len(scenarios.load(str(other)).simulate(seed=0)) == round(100.0 * found["seconds"])


def test_causes_are_told_apart_better_than_by_the_first_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(poses, "_CANDIDATES", 60)
    monkeypatch.setattr(telling, "_COUNTS", (10,))
    monkeypatch.setattr(telling, "_DRAWS", 1)
    base = scenarios.load("ann-arbor")
    keys = [("joint_offset", "joint5"), ("joint_offset", "joint2")]
    least = []
    for climbs in (0, 25):
        monkeypatch.setattr(telling, "_CLIMBS", (climbs, 0))
        made = make_plan(base, 60.0, tell=keys, seed=3)
        assert made.told is not None
        least.append(float(made.told.pairs[0, 1]))
        # In the time that was asked for, the curve has the plan itself, though fewer of its poses calibrate better.
        assert made.curve[:, 1][made.curve[:, 0] == 60.0] == pytest.approx(made.found.worst, rel=1e-12)
    assert least[1] > least[0]
    # The sweep cannot tell them apart at all.
    assert least[0] > 5.0 > isolability_of(base, keys).here.pairs[0, 1]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--seconds", "-1"), "--seconds: found -1"),
        (("--seconds", "3"), "do not fit into it"),
        (("--seconds", "0.1", "--kind", "sweep"), "--seconds: found 0.1, expected more, or parameters left out"),
        (("--seconds", "1e-300", "--kind", "sweep"), "--seconds: found 1e-300, expected 0.01, the time of a sample"),
        (("--seconds", "1e12"), "--seconds 1e+12 s at rate_Hz 100 Hz, 1e+14 samples: takes 5.46e+04 TiB of memory"),
        (("--seconds", "inf"), "--seconds inf s"),
        (("--seconds", "nan"), "--seconds: found nan"),
        (("--seconds", "60", "--weight", "speed=1"), "unknown --weight 'speed'"),
        (("--seconds", "60", "--weight", "field=x"), "expected field=W"),
        (("--seconds", "60", "--weight", "field=1e300"), "expected field=W with a number from 0 to 100"),
        (("--seconds", "60", "--box", "1,2"), "expected six numbers"),
        (("--seconds", "60", "--margin", "1e300"), "'--margin': found 1e+300, expected a number 0.0<=x<=1.0"),
        (("--seconds", "60", "--table", "nan"), "'--table': found 'nan', expected a finite number"),
        (("--seconds", "60", "--speed", "0"), "'--speed': found 0.0, expected a number x>0.0"),
        (("--seconds", "60", "--acceleration", "inf"), "'--acceleration': found 'inf', expected a finite number"),
        (("--seconds", "60", "--tell", "all", "--table", "9"), "expected more room"),
        (("--seconds", "60", "--tell", "joint_offset@joint5"), "found one cause"),
        (("--seconds", "60", "--tell", "joint_offset"), "expected EFFECT@PLACE"),
        (("--seconds", "60", "--tell", "gremlin@base"), "unknown effect of --tell 'gremlin'"),
    ],
)
def test_wrong_calls_are_refused(
    rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], message: str
) -> None:
    monkeypatch.setattr(poses, "_CLIMBS", 10)
    monkeypatch.setattr(poses, "_COUNTS", (8,))
    monkeypatch.setattr(poses, "_CANDIDATES", 60)
    monkeypatch.setattr(sweeps, "_BETTERED", 1)
    assert message in rig.refused("plan", *options, "-o", tmp_path / "p.toml")
    assert not (tmp_path / "p.toml").exists()


@pytest.fixture(scope="module")
def sweep() -> Plan:
    """A short search for a sweep, as for the poses."""
    with pytest.MonkeyPatch.context() as patch:
        for name, least in (("HARMONICS", 4), ("_DRAWN", 6), ("_BETTERED", 1), ("_STEPS", 3)):
            patch.setattr(sweeps, name, least)
        return make_plan(scenarios.load("ann-arbor"), 60.0, kind="sweep", acceleration=0.5, seed=1, name="swept")


def test_a_sweep_stays_within_what_the_arm_may_do(sweep: Plan) -> None:
    arm = Arm.a465()
    motion = sweep.maneuver.trajectory()
    assert sweep.maneuver.duration_s == 60.0
    arm.check_limits(motion.q, "the sweep")
    assert (np.abs(motion.qd) <= Dynamics.of(arm).speed).all()
    assert (np.abs(motion.qdd) <= 0.5).all()
    assert not Clearance.of(arm).touching(motion.q[::10]).any()
    # Rounded to 1e-4 deg, a joint's four harmonics of at most .42 rad/s begin within 1e-5 rad/s of rest.
    assert np.abs(motion.qd[0]).max() < 1e-5
    assert np.abs(motion.qdd[0]).max() < 1e-5
    assert sweep.scenario.motion == "inertial"
    table = [line.split(",") for line in trajectory_csv(sweep).splitlines()]
    assert len(table) == 6001
    arm.check_speeds(np.radians([[float(cell) for cell in row[7:]] for row in table[1:]]), "the trajectory")


def test_a_sweep_errs_as_it_says(sweep: Plan) -> None:
    """Nearly without noise, and without the converter's steps, what a calibration finds is off by what the acceleration
    moves it, to first order: the second is not to matter beside the noise. Its standard deviations are the bound's."""
    found = estimators.calibrate(sweep.scenario.with_acquisition(bits=None).scaled_noise(1e-3).simulate(seed=0))
    promised = scenarios.bound.bound_of(sweep.scenario)
    for each in sweep.parameters:
        truth, axes = sweep.scenario.truth.sensors[each.sensor], found[each.sensor].axes
        assert axes is not None
        off = [axis.sensitivity / own - 1.0 for axis, own in zip(axes, truth.sensitivity, strict=True)]
        np.testing.assert_allclose(off, each.moved[[0, 4, 8]], rtol=0.05, atol=0.2 * each.std[[0, 4, 8]].max())
        assert np.any(each.moved) == (each.sensor == "accelerometer")
        prediction = promised.sensors[each.sensor].prediction
        known = dict(zip(prediction.names, prediction.std, strict=True))
        # Judged at 200 instants instead of 6,000 samples.
        assert each.std[0] * truth.sensitivity[0] == pytest.approx(known["sensitivity1"], rel=1e-3)
        np.testing.assert_allclose(each.share.sum(axis=0), 1.0)
    worst = max(float(np.nanmax(each.ratio)) for each in sweep.parameters)
    assert sweep.found.worst == pytest.approx(worst)
    assert (np.diff(sweep.curve[:, 1]) < 0.0).all()


def test_linear_programs_better_a_sweep(sweep: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sweeps, "HARMONICS", 4)
    arm = Arm.a465()
    room = poses.PoseSearch(arm, Clearance.of(arm), Dynamics.of(arm), criteria_of(scenarios.load("ann-arbor")), 100.0)
    drawn = sweeps.SweepSearch(room).drawn(60.0, 6)
    assert sweep.found.worst < 0.7 * min(np.exp(worst) for worst, _ in drawn)


def test_a_sweep_tells_causes_apart_better_than_the_first_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    keys = [("joint_offset", "joint5"), ("joint_offset", "joint2")]
    least = []
    monkeypatch.setattr(sweeps, "HARMONICS", 3)
    for climbs in (0, 8):
        monkeypatch.setattr(telling, "_CLIMBS", (climbs, 0))
        made = make_plan(scenarios.load("ann-arbor"), 60.0, kind="sweep", tell=keys, seed=3)
        assert made.told is not None
        least.append(float(made.told.pairs[0, 1]))
    assert least[1] > least[0]


def test_the_command_plans_a_sweep_on_another_arm(rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, least in (("HARMONICS", 3), ("_DRAWN", 3), ("_BETTERED", 1), ("_STEPS", 1)):
        monkeypatch.setattr(sweeps, name, least)
    made, picture = tmp_path / "s.toml", tmp_path / "s.png"
    options = ("--arm", written(tmp_path, "iiwa"), "--kind", "sweep", "--seconds", "40", "--plot", picture)
    text = rig.done("plan", *options, "-o", made)
    assert "the sensor accelerates by" in text
    assert picture.stat().st_size > 10_000
    assert len(scenarios.load(str(made)).simulate(seed=0)) == 4000
    assert "no random sweep is free" in rig.refused("plan", *options, "--table", "9", "-o", tmp_path / "no.toml")
