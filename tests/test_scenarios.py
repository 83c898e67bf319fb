"""Scenarios: the published numbers, the Earth's field on a leaning base, and what a wrong file is told."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import scenarios
from rig.channels import SENSORS
from rig.effects import EFFECTS, make_effect
from rig.errors import RigError
from rig.maneuver import FourierSweep, HandTumble, Maneuver, StaticPoses, TorusSweep
from scenarios.loader import from_toml
from scenarios.scenario import Scenario
from scenarios.terminal.tables import example
from scenarios.toml_tables import EarthTable

RENK_TABLE_5 = {  # sensitivity, offset, beta, gamma
    1: (0.14259, 2.3754, 85.3089, 89.8537),
    2: (0.14251, 2.4491, -1.2394, 0.8943),
    3: (0.14198, 2.1096, 1.2829, 272.1489),
}
RENK_TABLE_10 = {
    1: (1.3006, 2.4216, 0.96237, 270.2059),
    2: (1.3283, 2.3967, -85.6307, 185.8359),
    3: (1.3342, 2.7643, -4.0172, 1.2153),
}
RENK_TABLE_2 = {1: (0.1, 2.45, -89.0, 2.0), 2: (0.15, 2.55, 1.0, 93.5), 3: (0.095, 2.3, -3.75, 358.0)}

EARTH = "[environment.earth]\nnorth_G = 1\neast_G = 1\ndown_G = 1\n"
SMALL = """
[maneuver]
kind = "torus-sweep"
duration_s = 20.0
[acquisition]
decimation = 10
[accelerometer]
sensitivity = [0.1, 0.15, 0.095]
offset = [2.45, 2.55, 2.3]
beta_deg = [-89.0, 1.0, -3.75]
gamma_deg = [2.0, 93.5, -2.0]
noise_V = [0.0134, 0.0136, 0.0146]
"""


@pytest.mark.parametrize(
    ("name", "sensor", "published", "phi_deg"),
    [
        ("renk2005-table2", "accelerometer", RENK_TABLE_2, 90.0),
        ("renk2005-table2-noise10", "accelerometer", RENK_TABLE_2, 90.0),
        (
            "renk2005-accelerometer",
            "accelerometer",
            RENK_TABLE_5,
            180.0 - 90.0023,
        ),  # phi within [-90, 90], psi half a turn on
        ("renk2005-magnetometer", "magnetometer", RENK_TABLE_10, 59.4127),
        ("ann-arbor", "accelerometer", RENK_TABLE_5, 87.0),  # 3 deg from straight down
    ],
)
def test_the_truth_is_the_published_table(
    name: str, sensor: str, published: dict[int, tuple[float, ...]], phi_deg: float
) -> None:
    values = scenarios.load(name).truth.values(sensor)
    for axis, expected in published.items():
        names = (f"sensitivity{axis}", f"offset{axis}", f"beta{axis}_deg", f"gamma{axis}_deg")
        # Through sines and back: some 1e-14, gamma at beta = -89 a hundred times that.
        assert [values[name] for name in names] == pytest.approx(expected, abs=1e-10)
    assert values["phi_deg"] == pytest.approx(phi_deg, abs=1e-10)


def test_noise_is_the_published_one_and_ten_times_that() -> None:
    assert scenarios.load("renk2005-table2").rig.acquisition.noise_V == (0.0134, 0.0136, 0.0146, 0.0, 0.0, 0.0)
    assert scenarios.load("renk2005-table2-noise10").rig.acquisition.noise_V[:3] == (0.134, 0.136, 0.146)
    assert scenarios.load("renk2005-magnetometer").rig.acquisition.noise_V == (0.0, 0.0, 0.0, 0.0085, 0.0068, 0.0117)


def test_table2_has_white_noise_and_nothing_else() -> None:
    acquisition = scenarios.load("renk2005-table2").rig.acquisition
    assert acquisition.bits is None
    assert acquisition.range_V is None


def test_the_field_of_ann_arbor_is_the_recorded_one() -> None:
    environment = scenarios.load("ann-arbor").rig.environment
    assert environment.magnetic_field == pytest.approx(math.hypot(0.18534, -0.02118, 0.51927), rel=1e-15)
    between = math.degrees(math.acos(np.dot(environment.gravity_direction, environment.magnetic_direction)))
    # The dip, which no base can change; the field has five digits after the point, so the dip is good to 0.001 deg.
    assert 90.0 - between == pytest.approx(70.24, abs=0.006)


def test_a_leaning_base_sees_gravity_along_its_lean() -> None:
    # Level, heading east: the base's y axis points north, its z axis up.
    level = EarthTable(0.2, 0.1, 0.4, base_yaw_deg=90.0)
    assert level.R_local_base == pytest.approx(np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]), abs=1e-15)
    # Its x axis to the north-west-up frame's north, leaning north by 30 deg: the z axis tips north, x points down.
    lean = EarthTable(0.2, 0.1, 0.4, base_tilt_deg=30.0).R_local_base
    assert lean[:, 2] == pytest.approx([0.5, 0.0, math.sqrt(0.75)], abs=1e-15)
    assert lean[:, 0] == pytest.approx([math.sqrt(0.75), 0.0, -0.5], abs=1e-15)
    # Leaning towards any heading: the z axis has that heading, clockwise from north; y of this frame is west.
    z = EarthTable(0.2, 0.1, 0.4, base_yaw_deg=77.0, base_tilt_deg=3.0, base_tilt_azimuth_deg=140.0).R_local_base[:, 2]
    assert math.degrees(math.atan2(-z[1], z[0])) == pytest.approx(140.0, abs=1e-9)
    assert math.degrees(math.acos(z[2])) == pytest.approx(3.0, abs=1e-9)


def test_truth_is_given_for_the_field_that_points_down_or_up() -> None:
    truth = scenarios.load("renk2005-magnetometer").truth
    down, up = truth.values("magnetometer"), truth.values("magnetometer", field_points="up")
    assert up["phi_deg"] == pytest.approx(-down["phi_deg"], abs=1e-12)
    assert up["beta2_deg"] == pytest.approx(-down["beta2_deg"], abs=1e-12)
    assert (up["psi_deg"] - down["psi_deg"]) % 360.0 == pytest.approx(180.0, abs=1e-12)
    assert up["sensitivity1"] == down["sensitivity1"]


@pytest.mark.parametrize("name", scenarios.names())
def test_every_scenario_says_what_it_is_and_where_from(name: str) -> None:
    scenario = scenarios.load(name)
    assert scenario.title
    assert scenario.description
    assert scenario.source


def same_recordings(one: Scenario, other: Scenario) -> bool:
    first, second = one.simulate(seed=3), other.simulate(seed=3)
    # A direction may lose a bit when its length is made one again: 1e-16 of some volts.
    return all(np.allclose(first.readings(s), second.readings(s), rtol=0, atol=1e-13) for s in first.sensors)


@pytest.mark.parametrize("name", scenarios.names())
def test_a_scenario_written_and_read_again_is_the_same(name: str) -> None:
    scenario = scenarios.load(name)
    again = from_toml(scenario.to_toml(), f"{name}.toml")
    assert replace(again, rig=scenario.rig) == scenario
    assert again.rig.acquisition == scenario.rig.acquisition
    assert again.to_toml() == scenario.to_toml()
    assert same_recordings(scenario, again)


@pytest.mark.parametrize(
    "maneuver",
    [
        TorusSweep(duration_s=10.0, roll="sweep", limits_deg=None),
        StaticPoses(count=3, seed=1),
        FourierSweep(duration_s=12.0),
        HandTumble(seed=5, duration_s=5.0, coverage="hemisphere"),
    ],
    ids=lambda maneuver: type(maneuver).__name__,
)
def test_every_maneuver_can_be_written(maneuver: Maneuver) -> None:
    scenario = replace(from_toml(SMALL, "small.toml"), maneuver=maneuver)
    assert from_toml(scenario.to_toml(), "small.toml").maneuver == maneuver


def test_every_effect_can_be_written_and_twice() -> None:
    made = [make_effect(name, example(effect)) for name, effect in EFFECTS.items()]
    twice = make_effect("joint_offset", {"where": "joint1", "offset_rad": 1e-3})
    scenario = scenarios.load("ann-arbor").with_effects([*made, twice])
    again = from_toml(scenario.to_toml(), "ann-arbor.toml").rig.effects
    assert sorted(again, key=repr) == sorted([*made, twice], key=repr)


def test_how_well_a_fitted_rig_is_known_is_written_and_read() -> None:
    effects = [
        make_effect("joint_offset", {"where": "joint1", "offset_rad": 1e-3}),
        make_effect("field_gradient", {"where": "base", "gradient_per_m": [0.01] * 5}),
        make_effect("joint_offset", {"where": "joint5", "offset_rad": 2e-3}),
    ]
    known = ({"offset_rad": 1e-4}, {"gradient_per_m": (1e-3,) * 5}, {})
    scenario = replace(scenarios.load("ann-arbor").with_effects(effects), fitted_std=known)
    again = from_toml(scenario.to_toml(), "small.toml")
    assert dict(zip(again.rig.effects, map(repr, again.fitted_std), strict=True)) == dict(
        zip(effects, map(repr, known), strict=True)
    )


def test_the_seed_decides_the_recording() -> None:
    scenario = from_toml(SMALL, "small.toml")
    one, same, other = (scenario.simulate(seed).readings("accelerometer") for seed in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)
    assert np.array_equal(replace(scenario, seed=1).simulate().readings("accelerometer"), one)


def test_the_locked_recording_keeps_every_sample() -> None:
    text = (
        SMALL
        + "[locked]\nhold_s = 2.0\nrate_Hz = 500.0\nposes_deg = [[0, 90, -90, 0, 0, 0], [10, 90, -90, 0, 20, 0]]\n"
    )
    locked = from_toml(text, "small.toml").simulate_locked(seed=0)
    assert len(locked) == 2000
    assert locked.rate_Hz == 500.0
    assert len(np.unique(np.asarray(locked.q), axis=0)) == 2


def test_noise_can_be_scaled_and_effects_added() -> None:
    scenario = from_toml(SMALL, "small.toml")
    silent = scenario.scaled_noise(0.0)
    assert silent.rig.acquisition.noise_V == (0.0,) * 6
    assert scenario.scaled_noise(10.0).rig.acquisition.noise_V[0] == pytest.approx(0.134)
    effect = make_effect("joint_offset", {"where": "joint5", "offset_rad": 0.01})
    changed = silent.with_effects([effect])
    assert changed.rig.effects == (effect,)
    assert not same_recordings(silent, changed)
    with pytest.raises(RigError, match="noise factor: found nan"):
        scenario.scaled_noise(math.nan)


def test_a_hand_tumble_needs_no_arm_and_has_none_to_lock() -> None:
    text = (
        SMALL.replace('kind = "torus-sweep"\nduration_s = 20.0', 'kind = "hand_tumble"\nduration_s = 5.0')
        + '[arm]\nmodel = "none"\n'
    )
    scenario = from_toml(text, "tumble.toml")
    assert scenario.simulate(0).pose == "none"
    assert from_toml(scenario.to_toml(), "tumble.toml").rig.arm is None
    with pytest.raises(RigError, match="found no arm, expected one that can be locked"):
        scenario.simulate_locked(0)


def test_a_urdf_is_found_beside_the_scenario(tmp_path: Path) -> None:
    from rig.assets import model_path

    (tmp_path / "mine.urdf").write_bytes(model_path("a465/a465.urdf").read_bytes())
    text = SMALL + '[arm]\nfile = "mine.urdf"\ntip = "imu"\n'
    (tmp_path / "mine.toml").write_text(text)
    scenario = scenarios.load(tmp_path / "mine.toml")
    assert scenario.rig.arm is not None
    assert same_recordings(scenario, from_toml(SMALL, "small.toml"))
    saved = from_toml(scenario.to_toml(), "saved-elsewhere.toml")
    assert saved.rig.arm is not None
    assert saved.rig.arm.urdf == tmp_path / "mine.urdf"


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (
            ("[maneuver]", "[manoeuvre]"),
            r"^my\.toml: unknown section \[manoeuvre\], expected one of .*\(nearest: 'maneuver'\)$",
        ),
        (
            ("duration_s", "duraton_s"),
            r"\[maneuver\] unknown key 'duraton_s' with value 20\.0, expected .*\(nearest: 'duration_s'\)$",
        ),
        (("20.0", '"long"'), r'\[maneuver\] duration_s: found "long", expected a finite number, no extreme one$'),
        (
            ("[0.1, 0.15, 0.095]", "[1e308, 0.15, 0.095]"),
            r"found \[1e\+308, .*, expected a list of 3 numbers$",
        ),
        (("20.0", "5e-324"), r"duration_s: found 5e-324, expected a finite number, no extreme one$"),
        (("20.0", "nan"), r"\[maneuver\] duration_s: found nan, expected a finite number, no extreme one$"),
        (("20.0", "-1"), r"\[maneuver\] duration_s: found -1"),
        (
            ("duration_s = 20.0", 'roll = "swep"'),
            r"found \"swep\", expected one of \"continuous\", \"sweep\" \(nearest: 'sweep'\)$",
        ),
        (
            ('"torus-sweep"', '"torus-swep"'),
            r"\[maneuver\] kind: found \"torus-swep\", expected one of .*\(nearest: 'torus-sweep'\)$",
        ),
        (('kind = "torus-sweep"', ""), r"\[maneuver\] kind: is missing, expected one of torus-sweep"),
        (("decimation = 10", "decimation = 2.5"), r"\[acquisition\] decimation: found 2\.5, expected an integer$"),
        (("decimation = 10", "decimation = 0"), r"\[acquisition\] decimation: found 0, expected 1 or more$"),
        (("decimation = 10", "decimation = true"), r"decimation: found true, expected an integer$"),
        (("decimation = 10", 'bits = "few"'), r'\[acquisition\] bits: found "few", expected an integer or "none"$'),
        (("decimation = 10", "noise_V = [1, 1, 1]"), r"noise_V: found here, expected it in \[accelerometer\]"),
        (("decimation = 10", 'pose = "jonts"'), r"\(nearest: 'joints'\)$"),
        (
            ("[2.45, 2.55, 2.3]", "[2.45, 2.55]"),
            r"\[accelerometer\] offset: found \[2\.45, 2\.55\], expected a list of 3 numbers$",
        ),
        (
            ("[0.1, 0.15, 0.095]", "[0.1, -0.15, 0.095]"),
            r"\[accelerometer\] sensitivity: found -0\.15, expected numbers above zero",
        ),
        (
            ("noise_V = [0.0134, 0.0136, 0.0146]", "noise_V = [0.0134, -0.0136, 0.0146]"),
            r"\[accelerometer\] noise_V: found",
        ),
        (
            ("noise_V = [0.0134, 0.0136, 0.0146]", "noise = [0.0134, -0.0136, 0.0146]"),
            r"\[accelerometer\] noise: found \[0.0134, -0.0136, 0.0146\], expected three numbers, none negative",
        ),
        (
            ("noise_V = [0.0134, 0.0136, 0.0146]", "noise_V = [0.1, 0.1, 0.1]\nnoise = [0.1, 0.1, 0.1]"),
            r"\[accelerometer\] noise: found beside noise_V, expected one or the other",
        ),
        (("offset = [2.45, 2.55, 2.3]", ""), r"\[accelerometer\] offset: is missing, expected a list of 3 numbers$"),
        (
            ("offset =", 'datasheet = "3dn"\noffset ='),
            r"\[accelerometer\] unknown datasheet '3dn': expected one of .*\(nearest: '3dm'\)$",
        ),
        (
            ("[maneuver]", 'engine = "dinamic"\n[maneuver]'),
            r"my\.toml: engine: found \"dinamic\", .*\(nearest: 'dynamic'\)$",
        ),
        (("[maneuver]", "seed = -1\n[maneuver]"), r"my\.toml: seed: found -1, expected an integer, zero or above$"),
        (("[maneuver]", "arm = 3\n[maneuver]"), r"my\.toml: arm: found 3, expected a table \[arm\]$"),
        (
            ("[maneuver]", "[environment]\ngravity_phi_deg = 90\n[maneuver]"),
            r"\[environment\] gravity_psi_deg: is missing",
        ),
        (
            ("[maneuver]", "[environment]\ngravity_direction = [0, 0, 0]\n[maneuver]"),
            r"\[environment\] gravity_direction: found .*, expected three numbers, not all zero$",
        ),
        (
            ("[maneuver]", "[environment]\nmagnetic_field = 2.0\n[environment.earth]\nnorth_G = 1\n[maneuver]"),
            r"\[environment\] magnetic_field: found beside \[environment\.earth\]",
        ),
        (("[maneuver]", "[environment.earth]\nnorth_G = 1\n[maneuver]"), r"\[environment\.earth\] east_G: is missing"),
        (("[maneuver]", "[environment.erth]\nnorth_G = 1\n[maneuver]"), r"\[environment\.erth\], .*'earth'"),
        (("[maneuver]", "[environment]\nearth = 3\n[maneuver]"), r"\[environment\] earth: found 3, expected a table"),
        (
            ("[maneuver]", f"[environment]\ngravity_m_s2 = -1\n{EARTH}[maneuver]"),
            r"my\.toml: \[environment\] gravity_m_s2: found -1\.0, expected a positive number",
        ),
        (
            ("[maneuver]", f"{EARTH.replace('1', '0')}[maneuver]"),
            r"my\.toml: \[environment\.earth\] north_G, east_G, down_G: found a field of zero",
        ),
        (("[maneuver]", '[arm]\nmodel = "a456"\n[maneuver]'), r"\[arm\] unknown model 'a456': .*\(nearest: 'a465'\)$"),
        (("[maneuver]", '[arm]\ntip = "imu"\n[maneuver]'), r"\[arm\] file: is missing, expected the arm's file"),
        (("[maneuver]", '[arm]\nfile = "no.urdf"\ntip = "imu"\n[maneuver]'), r"\[arm\] no\.urdf: no such file"),
        (
            ("[maneuver]", '[effects.baklash]\nwhere = "joint5"\n[maneuver]'),
            r"\[effects\] unknown effect 'baklash': .*\(nearest: 'backlash'\)$",
        ),
        (
            ("[maneuver]", '[effects.backlash]\nwhere = "joint55"\n[maneuver]'),
            r"\[effects\.backlash\] effect backlash at joint55: the arm has 6 joints, .*\(nearest: 'joint5'\)$",
        ),
        (
            ("[maneuver]", '[[effects.backlash]]\nwhere = "joint5"\nwidth = 0.1\n[maneuver]'),
            r"\[effects\.backlash\] effect backlash: unknown key 'width', .*\(nearest: 'width_rad'\)$",
        ),
        (
            ("[maneuver]", '[[effects.backlash]]\nwhere = "joint5"\nwidth_rad_std = -0.1\n[maneuver]'),
            r"\[effects\.backlash\] width_rad_std: found -0\.1, expected a number of zero or more$",
        ),
        (
            ("[maneuver]", '[effects.hysteresis]\nwhere = "mag1"\n[maneuver]'),
            r"\[effects\.hysteresis\] effect hysteresis at mag1: the rig has no magnetometer, expected an effect on its"
            r" accelerometer$",
        ),
        (("[maneuver]", "[effects.base_dipole]\n[maneuver]"), r"base_dipole at base: the rig has no magnetometer"),
        (
            ("[maneuver]", '[effects.channel_crosstalk]\nwhere = "accel1"\nsource = "mag2"\n[maneuver]'),
            r"channel_crosstalk at accel1: the rig has no magnetometer",
        ),
        (("[maneuver]", "[effects]\nbacklash = 3\n[maneuver]"), r"\[effects\] backlash: found 3, expected a table"),
        (("[maneuver]", "[locked]\nhold = 3\n[maneuver]"), r"\[locked\] unknown key 'hold' .*\(nearest: 'hold_s'\)$"),
        (("[maneuver]", "[locked]\nhold_s = -3\n[maneuver]"), r"\[locked\] hold_s: found -3"),
        (("[maneuver]", "[maneuver"), r"^my\.toml: not TOML: .*line 2"),
        (("[accelerometer]", "[magnetometr]"), r"unknown section \[magnetometr\], .*\(nearest: 'magnetometer'\)$"),
    ],
)
def test_a_wrong_file_is_told_what_where_and_what_else(change: tuple[str, str], expected: str) -> None:
    assert change[0] in SMALL, "the change must change something"
    with pytest.raises(RigError, match=expected) as caught:
        from_toml(SMALL.replace(*change, 1), "my.toml")
    assert str(caught.value).startswith("my.toml: ")
    assert "\n" not in str(caught.value)


def test_a_file_without_a_sensor_is_refused() -> None:
    with pytest.raises(RigError, match=r"^my\.toml: no sensor: expected a section \[accelerometer\]"):
        from_toml(SMALL[: SMALL.index("[accelerometer]")], "my.toml")


def test_what_cannot_be_read_is_named(tmp_path: Path) -> None:
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"title = '\xff'")
    for given, expected in (
        ("ann-arbr", r"unknown scenario 'ann-arbr': .*\(nearest: 'ann-arbor'\)$"),
        (tmp_path / "none.toml", "no such file"),
        (tmp_path, "is a folder"),
        (binary, "not UTF-8 text"),
    ):
        with pytest.raises(RigError, match=expected):
            scenarios.load(given)


def test_a_joint_beyond_its_limit_is_named() -> None:
    text = SMALL.replace("duration_s = 20.0", 'duration_s = 20.0\nlimits_deg = "none"\npitch_centre_deg = 20.0')
    with pytest.raises(RigError, match="joint5 is at 105"):
        from_toml(text, "my.toml").simulate(0)


def test_a_misspelt_attribute_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="lod"):
        scenarios.lod  # noqa: B018
    assert set(SENSORS) >= set(scenarios.load("ann-arbor").truth.sensors)
