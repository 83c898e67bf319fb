"""What holds for every effect of the catalogue, whatever it does; a new effect is tried here by being registered."""

from __future__ import annotations

import inspect
import re
from dataclasses import fields, replace

import numpy as np
import pytest
from effects_rig import (
    EVERYWHERE,
    MEAN,
    SENSORS,
    frozen,
    logged,
    made,
    measured,
    neutral,
    pipeline,
    recording_for,
    signals,
    values,
    volts,
)

from rig.channels import CHANNELS, COLUMNS_OF
from rig.effects import EFFECTS, Effect, Kind, Stage, apply_stage, make_effect
from rig.errors import RigError
from rig.pipeline import Pipeline
from rig.signals import Signals

J = tuple(f"joint{n}" for n in range(1, 7))
SWEPT = ("joint1", "joint5", "joint6")
LINK = tuple(f"link{n}" for n in range(1, 6))
SENSOR = ("accelerometer", "magnetometer")

#: The names that reports, files and other programs rely on: effect -> (places, its parameters).
CONTRACT: dict[str, tuple[tuple[str, ...], dict[str, int]]] = {
    "joint_offset": (J, {"offset_rad": 1}),
    "joint_scale": (SWEPT, {"scale": 1}),
    "joint_eccentricity": (SWEPT, {"amplitude_rad": 1, "phase_rad": 1}),
    "harmonic_drive_error": (SWEPT, {"amplitude_rad": 1, "phase_rad": 1, "order": 1}),
    "backlash": (SWEPT, {"width_rad": 1}),
    "joint_compliance": (("joint2", "joint3", "joint5"), {"droop_rad": 1}),
    "axis_misalignment": (J[:5], {"twist_rad": 1}),
    "base_rocking": (("base",), {"tilt_rad": 1, "phase_rad": 1}),
    "mounting_slip": (("mount",), {"rotation_rad": 3, "at_s": 1}),
    "latency": (("acquisition", *SENSOR), {"delay_s": 1}),
    "motion_acceleration": (("accelerometer",), {"lever_m": 3}),
    "vibration": (("accelerometer",), {"freq_Hz": 1, "amplitude_m_s2": 1}),
    "field_gradient": (("base",), {"gradient_per_m": 5}),
    "base_dipole": (("base",), {"position_m": 3, "moment": 3}),
    "link_hard_iron": (LINK, {"field": 3}),
    "link_soft_iron": (LINK, {"chi": 6}),
    "motor_current_field": (SWEPT, {"field": 3}),
    "scale_quadratic": (CHANNELS, {"fraction_of_full": 1}),
    "scale_cubic": (CHANNELS, {"fraction_of_full": 1}),
    "bias_warmup": (SENSOR, {"coefficient": 3, "tau_s": 1}),
    "bias_temperature": (SENSOR, {"coefficient_per_degC": 3}),
    "scale_temperature": (SENSOR, {"coefficient_per_degC": 3}),
    "bias_step": (CHANNELS, {"volts": 1, "at_s": 1}),
    "bias_random_walk": (SENSOR, {"rate": 3}),
    "sensor_lag": (SENSOR, {"tau_s": 1}),
    "hysteresis": (CHANNELS, {"half_width": 1}),
    "supply_ratiometric": (("supply",), {"waveform": 24, "supply_V": 1}),
    "channel_crosstalk": (CHANNELS, {"coefficient": 1}),
    "mains_hum": (("acquisition",), {"freq_Hz": 1, "amplitude": 6}),
    "saturation": (CHANNELS, {"level": 1}),
    "adc_quantisation": (("acquisition",), {"lsb_V": 1}),
    "outliers": (("acquisition",), {"share": 1}),
    "dropouts": (("acquisition",), {"share": 1}),
    "noise_excess": (CHANNELS, {"extra_sigma": 1}),
    "noise_coloured": (SENSOR, {}),
    "timing_jitter": (("acquisition",), {"sigma_s": 1}),
    "pose_interpolation": (("acquisition",), {"node_interval_s": 1, "jitter_s": 1}),
    "pose_noise": (("acquisition",), {"sigma_rad": 1, "tau_s": 1}),
}


def rng() -> np.random.Generator:
    return np.random.default_rng(1)


def at_stage(effect: Effect) -> Signals:
    """The signals as the effect meets them."""
    last = min(effect.stage, Stage.VOLTS)
    return frozen(pipeline().expected(recording_for(effect), rng(), last=last))


def same(first: Signals, second: Signals) -> bool:
    pairs = [(getattr(first, item.name), getattr(second, item.name)) for item in fields(Signals)]
    return all(bool(np.all(a == b)) for a, b in pairs if isinstance(a, np.ndarray))  # (3,) equals n rows alike


def test_names_places_and_parameters_are_the_contract() -> None:
    assert set(EFFECTS) == set(CONTRACT)
    for name, (places, parameters) in CONTRACT.items():
        effect = EFFECTS[name]
        sizes = {item.name: item.size for item in effect.parameters()}
        assert effect.places == places, name
        assert parameters.items() <= sizes.items(), name
    assert EFFECTS["channel_crosstalk"].choices() == {"source": CHANNELS}


@pytest.mark.parametrize("name", EFFECTS)
def test_the_docstring_says_what_the_effect_is(name: str) -> None:
    effect = EFFECTS[name]
    text = inspect.getdoc(effect) or ""
    assert not text.startswith(f"{effect.__name__}("), "the dataclass's own: nobody wrote one"
    assert re.search(r"guess|data sheet|catalogue|Renk|MathWorks|ctu_crs", text), "where its size comes from"
    assert all(item.unit for item in effect.parameters())
    assert any(item.strength for item in effect.parameters())
    for item in effect.parameters():
        assert item.lower <= item.typical <= item.upper, item.name


@pytest.mark.parametrize(("name", "where"), EVERYWHERE)
def test_neutral_strengths_change_nothing_at_all(name: str, where: str) -> None:
    effect = neutral(name, where)
    before = at_stage(effect)
    if effect.acts_at_zero:  # then, and only then, being there is what it does
        assert not same(effect.apply(before, rng()), before)
        before = replace(before, acceleration=np.ones((len(before), 3)))
    assert same(effect.apply(before, rng()), before)


@pytest.mark.parametrize(("name", "where"), EVERYWHERE)
def test_an_effect_changes_what_it_is_said_to_change_and_nothing_it_was_given(name: str, where: str) -> None:
    effect = made(name, where)
    before = at_stage(effect)
    kept = frozen(before)
    after = effect.apply(before, rng())
    assert same(before, kept)
    changed = {
        item.name
        for item in fields(Signals)
        if isinstance(value := getattr(before, item.name), np.ndarray)
        and not np.array_equal(value, getattr(after, item.name))
    }
    may = {
        Stage.TRANSMISSION: {"q"},
        Stage.POSE: {"R_base_tool", "position", "acceleration"},
        Stage.FIELD: {"gravity", "magnetic", "acceleration"},
        Stage.INPUT: {"inputs"},
        Stage.VOLTS: {"volts"},
        Stage.ELECTRONIC: {"volts"},
    }
    if name not in {"outliers", "dropouts"}:  # may spare a short recording
        assert changed
    assert changed <= may[effect.stage]
    for array in changed & {"inputs", "volts"}:
        untouched = np.ones(len(CHANNELS), dtype=bool)
        untouched[effect.columns] = False
        assert np.array_equal(getattr(before, array)[:, untouched], getattr(after, array)[:, untouched])


@pytest.mark.parametrize("name", MEAN)
def test_mean_effects_draw_no_random_numbers(name: str) -> None:
    generator = np.random.default_rng(1)
    effect = made(name)
    effect.apply(at_stage(effect), generator)
    assert generator.random() == np.random.default_rng(1).random()


@pytest.mark.parametrize("name", MEAN)
def test_changes_converge_to_a_derivative_at_zero_strength(name: str) -> None:
    """(V(h) - V(0))/h for h and h/2: they differ by the curvature, which is of the order h.

    h is 1e-4 of the typical size, so the curvature's share is 1e-4 where the effect is of the order of its square at
    typical size; 1e-2 allows for effects a hundred times as curved, and for rounding: 1e-16 V in 1e-7 V.
    """
    effect = EFFECTS[name]
    base = volts(neutral(name))
    for item in effect.parameters():
        if not item.strength:
            continue
        for component in range(item.size):
            slopes = []
            for step in (1e-4 * item.typical, 0.5e-4 * item.typical):
                value = np.zeros(item.size)
                value[component] = step
                zeros = {other.name: np.zeros(other.size) for other in effect.parameters() if other.strength}
                table = {
                    key: tuple(row) if len(row) > 1 else float(row[0])
                    for key, row in (zeros | {item.name: value}).items()
                }
                slopes.append((volts(made(name, **table)) - base) / step)
            assert np.linalg.norm(slopes[0]) > 0.0
            assert np.linalg.norm(slopes[0] - slopes[1]) <= 1e-2 * np.linalg.norm(slopes[1]), (item.name, component)


@pytest.mark.parametrize(
    "name", [name for name in MEAN if name not in {"hysteresis", "backlash"}]
)  # piecewise linear: below
def test_central_differences_converge_quadratically(name: str) -> None:
    """At the values of the trial, for every parameter: half the step, a quarter of the error, or it is rounding."""
    effect = EFFECTS[name]
    for item in effect.parameters():
        if item.name == "at_s" or item.scatter:  # an instant between two samples, or noise: nothing depends on it
            continue
        at = np.atleast_1d(np.asarray(values(effect)[item.name], dtype=float))
        direction = np.cos(np.arange(item.size))
        size = 1e-2 * item.typical if item.strength else {"order": 1e-4, "freq_Hz": 1e-4}.get(item.name, 1e-2)
        slopes = []
        for step in (size, 0.5 * size, 0.25 * size):
            ends = [at + sign * step * direction for sign in (1.0, -1.0)]
            tables = [{item.name: tuple(end) if item.size > 1 else float(end[0])} for end in ends]
            slopes.append((volts(made(name, **tables[0])) - volts(made(name, **tables[1]))) / (2.0 * step))
        coarse, fine = np.linalg.norm(slopes[0] - slopes[1]), np.linalg.norm(slopes[1] - slopes[2])
        rounding = 1e-15 * np.linalg.norm(volts()) / (0.25 * size)
        assert np.linalg.norm(slopes[2]) > 0.0, item.name
        assert fine <= 0.3 * coarse + 4.0 * rounding, item.name


@pytest.mark.parametrize(("name", "width"), [("hysteresis", "half_width"), ("backlash", "width_rad")])
def test_a_play_changes_linearly_until_a_step_of_the_input_is_as_small_as_it(name: str, width: str) -> None:
    base, small, half = volts(), volts(made(name, **{width: 1e-6})), volts(made(name, **{width: 5e-7}))
    assert np.abs(small - base).max() > 0.0
    np.testing.assert_allclose(small - base, 2.0 * (half - base), atol=1e-12)  # 1e-6 rad squared, in volts


@pytest.mark.parametrize(("name", "where"), EVERYWHERE)
def test_the_pipeline_takes_every_effect_on_a_joint_recording(name: str, where: str) -> None:
    effect = made(name, where)
    readings = volts(effect)
    assert readings.shape == volts().shape
    assert np.isfinite(readings).all()
    electronic = apply_stage((effect,), Stage.ELECTRONIC, replace(recording_for(effect), volts=readings), rng())
    assert np.isfinite(electronic.volts).all()


@pytest.mark.parametrize("sensor", SENSOR)
@pytest.mark.parametrize(("name", "where"), EVERYWHERE)
def test_a_rig_with_one_sensor_takes_them_too(name: str, where: str, sensor: str) -> None:
    alone = {"accelerometer": None, "magnetometer": None, sensor: SENSORS[SENSOR.index(sensor)]}
    rig = Pipeline(pipeline().environment, alone["accelerometer"], alone["magnetometer"], (made(name, where),))
    through = rig.expected(recording_for(made(name, where)), rng())
    through = apply_stage(rig.effects, Stage.ELECTRONIC, through, rng())
    there = np.isfinite(through.volts)
    own, other = COLUMNS_OF[sensor], COLUMNS_OF[SENSOR[1 - SENSOR.index(sensor)]]
    disturbed_by_the_missing = name == "channel_crosstalk" and made(name, where).source not in CHANNELS[own]  # type: ignore[attr-defined]
    assert disturbed_by_the_missing or there[:, own].all()
    assert not there[:, other].any()


@pytest.mark.parametrize(("name", "where"), EVERYWHERE)
def test_measured_poses_take_what_makes_sense_there_and_refuse_the_rest(name: str, where: str) -> None:
    effect = made(name, where)
    recording = logged() if effect.of_log else measured()
    from_joints = volts(effect) if effect.kind is Kind.MEAN else None
    if effect.lacking(recording):
        assert effect.lacking(recording) == "joint angles (columns q1_rad..qN_rad)"
        with pytest.raises(RigError, match="joint") as caught:
            pipeline(effect).expected(recording, rng())
        assert "\n" not in str(caught.value)
    elif from_joints is not None:  # the same poses: the same readings
        np.testing.assert_allclose(pipeline(effect).expected(recording, rng()).volts, from_joints, atol=1e-13)


def test_what_a_recording_lacks_is_said() -> None:
    bare = replace(measured(), position=np.empty((0, 0)), temperature=None)
    lacking = {name: effect.lacking(bare) for name, effect in EFFECTS.items() if effect.lacking(bare)}
    # At least these: a new effect may need as much.
    assert {name for name, text in lacking.items() if "joint" in text} >= {
        "joint_offset", "joint_scale", "joint_eccentricity", "harmonic_drive_error", "backlash", "joint_compliance",
        "axis_misalignment", "base_rocking", "link_hard_iron", "link_soft_iron", "motor_current_field",
    }  # fmt: skip
    assert {name for name, text in lacking.items() if "position" in text} >= {
        "motion_acceleration", "field_gradient", "base_dipole",
    }  # fmt: skip
    assert {name for name, text in lacking.items() if "temperature" in text} >= {
        "bias_temperature",
        "scale_temperature",
    }
    missing = ("joints", "position", "temperature", "nodes")
    assert set(lacking) == {name for name, effect in EFFECTS.items() if set(effect.requires) & set(missing)}
    assert {name for name, text in lacking.items() if "nodes" in text} >= {"pose_interpolation"}
    for name, text in lacking.items():
        with pytest.raises(RigError) as caught:
            apply_stage((made(name),), EFFECTS[name].stage, bare, rng())
        assert text in str(caught.value) or "joint angles" in str(caught.value)
    chips = replace(measured(), electrical=False)
    assert EFFECTS["supply_ratiometric"].lacking(chips) == "readings as the sensors give them (V, mV, raw)"
    assert not EFFECTS["supply_ratiometric"].lacking(measured())


@pytest.mark.parametrize("name", EFFECTS)
def test_bad_parameters_are_refused_in_one_line(name: str) -> None:
    effect = EFFECTS[name]
    good = {"where": effect.places[0], **values(effect)}
    if good.get("source") == good["where"]:
        good["source"] = "mag2"
    bad = [good | {"where": "joint0"}, good | {"widht": 1.0}]
    for item in effect.parameters():
        wrong = [np.nan, np.inf, "much", None, (1.0,) * (item.size + 1), (1.0,) * max(item.size - 1, 0)]
        bad += [good | {item.name: value} for value in wrong[(2 if item.name == "order" else 0) :]]
        for bound in (item.lower, item.upper):
            if np.isfinite(bound):
                outside = bound + np.copysign(max(abs(bound), 1.0), bound - 0.5 * (item.lower + item.upper))
                bad.append(good | {item.name: outside if item.size == 1 else (outside,) * item.size})
    bad += [good | {choice: "nowhere"} for choice in effect.choices()]
    if len(effect.places) > 1:
        bad.append({key: value for key, value in good.items() if key != "where"})
    assert isinstance(make_effect(name, good), effect)
    for table in bad:
        with pytest.raises(RigError) as caught:
            make_effect(name, table)
        message = str(caught.value)
        assert "\n" not in message
        assert name in message
        assert "expected" in message


def test_an_unknown_effect_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(RigError, match=r"nearest: 'backlash'"):
        make_effect("backlsh", {})
    with pytest.raises(RigError, match="'source' is missing"):
        make_effect("channel_crosstalk", {"where": "mag1"})
    with pytest.raises(RigError, match="another channel"):
        make_effect("channel_crosstalk", {"where": "mag1", "source": "mag1"})
    with pytest.raises(RigError, match="direction"):
        make_effect("vibration", {"direction": (0.0, 0.0, 0.0)})


@pytest.mark.parametrize("name", [name for name in MEAN if EFFECTS[name].spanning() != [{}]])
def test_spanned_shapes_span_all_others_to_first_order(name: str) -> None:
    """The change at any phase and direction lies in the space of the changes at the spanning ones, to second order."""
    effect = EFFECTS[name]
    strengths = [item for item in effect.parameters() if item.strength]
    small = {
        item.name: 1e-4 * item.typical if item.size == 1 else (1e-4 * item.typical,) * item.size for item in strengths
    }
    base = volts()
    columns = []
    for shape in effect.spanning():
        for item in strengths:
            for component in range(item.size):
                one = np.where(np.arange(item.size) == component, 1e-4 * item.typical, 0.0)
                table = {item.name: tuple(one) if item.size > 1 else float(one[0])}
                columns.append((volts(made(name, **(small | table | shape))) - base).ravel())
    change = (volts(made(name, **small)) - base).ravel()
    solution, *_ = np.linalg.lstsq(np.array(columns).T, change, rcond=1e-9)
    assert np.linalg.norm(change) > 0.0
    assert np.linalg.norm(np.array(columns).T @ solution - change) <= 1e-3 * np.linalg.norm(change)


@pytest.mark.parametrize("name", EFFECTS)
def test_shapes_to_search_are_shapes_the_effect_can_have(name: str) -> None:
    effect = EFFECTS[name]
    shapes = effect.searched(pipeline().expected(recording_for(made(name)), rng()))
    assert shapes
    assert len({tuple(shape.items()) for shape in shapes}) == len(shapes)
    assert len({frozenset(shape) for shape in shapes}) == 1, "every shape names the same parameters"
    named = {key for shape in (*shapes, *effect.spanning()) for key in shape} | ({"freq_Hz"} if effect.tone else set())
    shaped = {item.name for item in effect.parameters() if not item.strength}
    assert named <= shaped
    assert named == shaped or name == "outliers", "a shape that is neither searched nor spanned"
    for shape in shapes[:: max(1, len(shapes) // 8)]:
        made(name, **shape)


@pytest.mark.parametrize("name", [name for name in EFFECTS if EFFECTS[name].tone])
def test_a_tone_at_frequency_zero_is_its_envelope(name: str) -> None:
    size = EFFECTS[name].parameters()
    phases = {
        item.name: (np.pi / 2.0 if item.size == 1 else (np.pi / 2.0,) * item.size)
        for item in size
        if item.name == "phase_rad"
    }
    envelope = volts(made(name, freq_Hz=0.0, **phases)) - volts()
    tone = volts(made(name, freq_Hz=17.3, **phases)) - volts()
    np.testing.assert_allclose(tone, envelope * np.cos(2.0 * np.pi * 17.3 * signals().t)[:, None], atol=1e-12)


def test_noise_comes_before_what_is_done_to_noisy_readings() -> None:
    effects = (made("dropouts", share=0.5), made("noise_excess", "mag1", extra_sigma=1.0))
    readings = np.random.default_rng(0).random((1000, 6))
    out = apply_stage(effects, Stage.ELECTRONIC, Signals(t=np.arange(1000.0), volts=readings), rng()).volts
    assert (np.diff(out[:, 3]) == 0.0).sum() > 400  # repeats with their noise; 500 +- 16 expected
