"""From a recording and its floor to whitened data: the base fit that every test stands on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from estimators.calibration import Calibration
from estimators.calibration.turned import turned
from estimators.dispatch import calibrate
from estimators.gap.data.defects import lattice
from estimators.gap.data.likely_path import likely_path
from estimators.gap.data.modelled import known
from estimators.gap.data.rest_tones import without_rest_tones
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.gap.floor.clean_rest import sound
from estimators.gap.floor.colour import fit_floor, held
from estimators.gap.floor.resonant import resonant
from estimators.gap.floor.rounded import COARSE, rounded_floor
from estimators.gap.floor.shared import correlations, slow_correlations
from estimators.gap.floor.tails_at_rest import of_sweep, relieved_rest
from estimators.gap.floor.tones_at_rest import amplitude_of, made_by_an_effect, toneless_readings, without_tones
from estimators.gap.floor.unsteady import Unsteady, unsteadiness
from estimators.goodness.residuals import residuals_of
from estimators.known_angle.from_recording import arm_of
from estimators.noise import held_poses
from rig.arm import Arm
from rig.arrays import Array, Mask, Rows
from rig.channels import ACCELEROMETER, CHANNELS, COLUMNS_OF, MAGNETOMETER
from rig.effects import Effect
from rig.effects.tails import beside_neighbours, drawn_in, tails_of
from rig.environment import Environment
from rig.errors import RigError
from rig.pipeline import Pipeline
from rig.recording import Recording, RecordingScan
from rig.recording.columns import JOINTS_OF_ARM
from rig.recording.repeated_poses import straight_between
from rig.sensor import TriaxialSensor
from rig.signals import Signals
from rig.units import ELECTRICAL

#: Time at the ends of a recording in which its poses do not tell all that its readings show [s]: as long as boards,
#: buses and filters of laboratories delay.
_ENDS_S = 0.5
#: A locked recording is thinned to this many samples for each of the sweep's: finer ones teach nothing of its colour.
_FINER = 10
#: Normal noise of so many steps leaves of their lattice a ripple of 2 exp(-2 pi^2 .7^2) = 1e-4 (Widrow and Kollar,
#: Quantization Noise, 2008).
_DITHER = 0.7
#: Tones of two channels at rest are one where they are no farther apart [cycles a sample].
_SAME = 1e-3
#: Readings at rest show which tones the sweep has where they are as fast as its own, give or take a little.
_AS_FAST = 0.98
#: Four standard deviations of the logarithm of the ratio of both medians, times the root of the samples, where there is
#: white noise alone (simulated).
_TONAL = 6.2
#: Lines of a spectrum that a few tones are, with those beside that they leak to.
_LINES = 24


def learn_floor(locked: Recording, interval_s: float, steps: Array | None = None) -> tuple[ChannelNoise, ...]:
    """The noise of each channel at rest; channels that were not recorded have none.

    Args:
        locked: several poses held still.
        interval_s: between samples of the sweep.
        steps: (6,) of the sweep's converter, where they are known.
    """
    labels = held_poses(locked)
    stride = max(1, int(interval_s * locked.rate_Hz / _FINER))
    readings = all_readings(locked)
    numbers = [label for label in np.unique(labels) if label >= 0]
    if not numbers:
        raise _never_at_rest(locked)
    channels, tails, coarse, known, humming = {}, {}, {}, {}, {}
    thinned, held_still = readings[::stride], labels[::stride]
    rounded = lattice(readings)  # a file at rest may be rounded more coarsely than that of the sweep
    steps = rounded if steps is None else np.fmax(steps, rounded)
    unsteady = _unsteady(thinned, steps, held_still, stride / locked.rate_Hz)
    for column in map(int, np.flatnonzero(np.isfinite(readings[0]))):
        segments = [readings[labels == label, column] for label in numbers]
        step = float(steps[column])
        own = held(segments, 1.0 / locked.rate_Hz)
        if own.segments and own.silent:
            raise _constant(locked, column)
        if own.segments and step**2 > COARSE**2 * own.variance:
            coarse[column] = rounded_floor(segments, step, sum(map(len, segments)) / locked.rate_Hz)
            continue
        louder = unsteady.get(column)
        steady = louder is None or not louder.normal  # else what is large is of louder times
        segments, known[column] = sound(readings[:, column], labels, step, spiky=steady)
        if not segments:
            found = f"{CHANNELS[column]} stays at {len(np.unique(readings[labels >= 0, column]))} values"
            raise RigError(f"{locked.origin or locked.name}: {found} at rest, expected readings that show its noise")
        humming[column] = segments
    cleared = dict(zip(humming, without_tones(list(humming.values())), strict=True))
    tones = {column: own for column, (_, own) in cleared.items()}
    loud = {column: [amplitude_of(humming[column], each) for each in own] for column, own in tones.items()}
    still = {column: segments for column, (segments, _) in cleared.items()}
    for column, segments in still.items():
        less, tails[column] = relieved_rest(segments)
        louder = unsteady.get(column)
        still[column] = segments if louder and louder.normal else less
        channels[column] = held(still[column], 1.0 / locked.rate_Hz, stride, 4)  # what is white four series tell
    if not all(channel.segments for channel in channels.values()):
        raise _never_at_rest(locked)
    if silent := [column for column, channel in channels.items() if channel.silent]:
        raise _constant(locked, silent[0])
    boards = [sensor for column in channels for sensor, own in COLUMNS_OF.items() if column in range(6)[own]]
    fitted = coarse | {
        column: of_sweep(
            resonant(still[column], locked.rate_Hz, interval_s, noise).shortened(known[column]),
            unsteady.get(column),
            tails[column],
        )
        for column, noise in zip(channels, fit_floor(list(channels.values()), boards), strict=True)
    }
    toneless = toneless_readings(thinned, held_still, [column for column in tones if tones[column]])
    shared = correlations(toneless, held_still)
    slow = slow_correlations(toneless, held_still, fitted, stride / locked.rate_Hz, shared)
    return tuple(
        replace(
            fitted.get(column, ChannelNoise(np.nan)),
            tones_Hz=tuple(each * locked.rate_Hz for each in tones.get(column, ())),
            hums=_hums(tones, loud, column, locked.rate_Hz) if locked.rate_Hz * interval_s > _AS_FAST else (),
            shared=() if np.array_equal(row, unit) else tuple(row.tolist()),
            shared_slow=() if np.array_equal(late, unit) else tuple(late.tolist()),
        )
        for column, (row, late, unit) in enumerate(zip(shared, slow, np.eye(len(shared)), strict=True))
    )


def _hums(
    tones: Mapping[int, Sequence[float]], loud: Mapping[int, Sequence[float]], column: int, rate_Hz: float
) -> tuple[tuple[float, float], ...]:
    """Of one channel's tones at rest those that no effect makes: frequency [Hz] and amplitude.

    Args:
        tones, loud: of each channel, [cycles a sample] and amplitudes.
    """
    found = []
    for each, size in zip(tones.get(column, ()), loud.get(column, ()), strict=True):
        alike = [other for other, own in tones.items() if any(abs(one - each) < _SAME for one in own)]
        if not made_by_an_effect(each * rate_Hz, alike, rate_Hz, _SAME * rate_Hz):
            found.append((each * rate_Hz, size))
    return tuple(found)


def _unsteady(readings: Array, steps: Array, labels: Rows, interval_s: float) -> dict[int, Unsteady]:
    """Of each channel whose level changes at rest.

    Dithered, as of noise of a few of the converter's steps (6,) the sizes depend on where between two the pose is.
    """
    readings = readings + _DITHER * np.nan_to_num(steps) * np.random.default_rng(0).standard_normal(readings.shape)
    boards = [range(6)[where] for where in COLUMNS_OF.values() if np.isfinite(readings[0, where]).all()]
    found = unsteadiness(readings, labels, interval_s, boards)
    return {column: unsteady for unsteady in found for column in unsteady.columns}


def _constant(locked: Recording, column: int) -> RigError:
    return RigError(f"{locked.origin or locked.name}: {CHANNELS[column]} is constant, expected its noise at rest")


def _never_at_rest(locked: Recording) -> RigError:
    return RigError(f"{locked.origin or locked.name}: the arm is never at rest, expected a locked recording")


def all_readings(recording: Recording) -> Array:
    """(n, 6) readings [recorded unit]; NaN where a sensor was not recorded."""
    readings = np.full((len(recording), len(CHANNELS)), np.nan)
    for sensor in recording.sensors:
        readings[:, COLUMNS_OF[sensor]] = recording.readings(sensor)
    return readings


def cleared(recording: Recording, change: Array) -> Recording:
    """The recording with a change (n, 6) [recorded unit] taken out of its readings."""
    if not change.any():
        return recording
    left = {sensor: recording.readings(sensor) - change[:, COLUMNS_OF[sensor]] for sensor in recording.sensors}
    return replace(recording, accelerometer=left.get(ACCELEROMETER), magnetometer=left.get(MAGNETOMETER))


def fitted_pipeline(calibration: Calibration, recording: Recording) -> Pipeline:
    """The pipeline with a calibration's sensors and fields; of an accelerometer g - a, whatever it reads."""
    sensors: dict[str, TriaxialSensor] = {}
    environment = Environment(recording.metadata.gravity_m_s2, magnetic_field=recording.metadata.magnetic_field)
    for name, own in calibration.sensors.items():
        found = turned(own) if own.reads == "a-g" else own
        sensors[name] = TriaxialSensor.from_axes(found.sensitivity, found.offset, found.axis_vectors)
        assert found.field_direction is not None
        x, y, z = (float(component) for component in found.field_direction.vector)
        if name == ACCELEROMETER:
            environment = replace(environment, gravity_direction=(x, y, z))
        else:
            environment = replace(environment, magnetic_direction=(x, y, z))
    return Pipeline(environment, sensors.get(ACCELEROMETER), sensors.get(MAGNETOMETER))


def signals_of(recording: Recording, arm: Arm | None) -> Signals:
    """The recording's angles or poses as they enter the pipeline."""
    rotation = np.empty((0, 0)) if recording.q is not None else recording.rotations(None).reshape(-1, 3, 3)
    position = np.empty((0, 0)) if recording.tool_position is None else recording.tool_position
    return Signals(
        t=recording.t,
        arm=arm if recording.q is not None else None,
        q_encoder=recording.q,
        R_base_tool=rotation,
        position=position,
        temperature=recording.temperature,
        currents=recording.currents,
        supply=recording.supply,
        electrical=all(unit in ELECTRICAL for unit in recording.units.values()),
    )


def posed(recording: Recording, arm: Arm | None) -> tuple[Recording, Arm | None]:
    """As ``with_arm``, with straight lines between the poses of a slower log."""
    recording, arm = with_arm(recording, arm)
    return straight_between(recording), arm


def with_arm(recording: Recording, arm: Arm | None) -> tuple[Recording, Arm | None]:
    """A recording with the arm that its joint angles are of, the A465 where the metadata name it.

    Where nobody knows the arm but the tool's poses were recorded, these serve, and the angles are left out.

    Raises:
        RigError: no pose, or nothing but joint angles of an arm that is not known.
    """
    if arm is not None or recording.q is None:
        return recording, arm
    if recording.metadata.arm in JOINTS_OF_ARM:
        return recording, Arm.a465()
    arm_of(recording, None, recording.origin or recording.name)
    return replace(recording, q=None), None


def fitted_model(scan: RecordingScan, arm: Arm | None) -> Callable[[Recording], Mapping[str, Array]]:
    """What the base model, fitted to all of a recording, makes of the poses of a part of it: sensor -> (n, 3).

    Raises:
        RigError, RefusedFit: as ``calibrate``.
    """
    calibration = calibrate(scan.path, noise="residuals", arm=arm)

    def readings(part: Recording) -> Mapping[str, Array]:
        own, its_arm = with_arm(part, arm)
        return {
            sensor: part.readings(sensor) - residuals_of(own, sensor, calibration[sensor], its_arm).values
            for sensor in part.sensors
        }

    return readings


#: Calibrations at most until given effects and calibration fit together, and the change [of the floor] that ends it.
_ROUNDS, _SETTLED = 6, 1e-3


def set_up(
    recording: Recording, floor: tuple[ChannelNoise, ...], arm: Arm | None, given: Sequence[Effect] = ()
) -> WhitenedData:
    """Fit the base model and whiten what it leaves of the recording.

    Args:
        given: mean effects that the model has: the calibration is fitted with these in place.

    Raises:
        RigError, RefusedFit: as ``calibrate``; a given effect has no place on this recording.
    """
    data = _set_up(recording, floor, arm, np.zeros((1, 1)), given)
    sigma = np.sqrt([channel.variance for channel in floor])
    for _ in range(_ROUNDS if given else 0):
        fresh = _set_up(recording, floor, arm, data.given_change, given)
        moved = float(np.nanmax(np.abs(fresh.given_change - data.given_change) / sigma))
        data = fresh
        if moved < _SETTLED:
            break
    return data


def _set_up(
    recording: Recording,
    floor: tuple[ChannelNoise, ...],
    arm: Arm | None,
    change: Array,
    given: Sequence[Effect],
) -> WhitenedData:
    """The data around the calibration of the readings less a change (n, 6)."""
    noise = floor_of(recording, floor)
    left = cleared(recording, change)
    calibration = calibrate(left, noise=noise, arm=arm if recording.q is not None else None)
    data = placed(recording, signals_of(recording, arm), fitted_pipeline(calibration, recording), floor)
    return replace(data, given=tuple(given))


def placed(recording: Recording, signals: Signals, pipeline: Pipeline, floor: tuple[ChannelNoise, ...]) -> WhitenedData:
    """A recording, its angles or poses, whitened beside a fitted pipeline with its sensors.

    The readings at either end are left out: how the arm moved before and after, which some of them still or already
    show, nobody knows.
    """
    readings = all_readings(recording)
    base = on_likely_path(recording, known(pipeline.expected(signals, np.random.default_rng(0))))
    data = WhitenedData(base, pipeline, readings, floor, np.ones_like(readings), floor)
    data = without_rest_tones(data)
    if recording.metadata.still_poses:
        return data
    return data.without(np.broadcast_to(_ends(recording)[:, None], readings.shape))


def on_likely_path(recording: Recording, signals: Signals) -> Signals:
    """With the path through the nodes of a log that the recording's readings tell."""
    if (nodes := signals.pose_nodes) is None:
        return signals
    readings = {sensor: recording.readings(sensor) for sensor in recording.sensors}
    return replace(signals, known_nodes=(likely_path(nodes, signals.t, readings, ~_ends(recording)),))


def _ends(recording: Recording) -> Mask:
    """(n,) the samples at either end."""
    t = recording.t
    return np.asarray(np.minimum(t - t[0], t[-1] - t) < _ENDS_S)


def floor_of(recording: Recording, floor: Sequence[ChannelNoise]) -> dict[str, Array]:
    """sensor -> (3,) standard deviation of its readings at rest."""
    return {
        sensor: np.sqrt([floor[column].variance for column in range(*COLUMNS_OF[sensor].indices(len(CHANNELS)))])
        for sensor in recording.sensors
    }


def estimated_floor(recording: Recording, arm: Arm | None) -> tuple[ChannelNoise, ...]:
    """A floor from the recording itself, where none was measured: the second differences of the residual, as if white.

    Smooth gaps cancel in second differences; coloured noise does too, so that this floor is a lower bound of it. Spikes
    do not move the median of these. Fast tones do, but not that of their spectrum: where it is smaller, that is taken.
    """
    calibration = calibrate(recording, noise="residuals", arm=arm if recording.q is not None else None)
    return floor_beside(recording, arm, fitted_pipeline(calibration, recording))


def _between_tones(differences: Array) -> float:
    """The standard deviation of white noise of second differences (n,), by the median of the faster half of their
    spectrum, the periodogram's being ln 2 of its mean; infinite where there is more than that and a few lines."""
    frequency = np.fft.rfftfreq(len(differences))
    power = np.abs(np.fft.rfft(differences)) ** 2 / len(differences)
    fast = frequency >= 0.25
    variance = float(np.median(power[fast] / (2.0 * np.sin(np.pi * frequency[fast])) ** 4) / np.log(2.0))
    beside = float(np.mean(np.sort(power)[:-_LINES])) if len(power) > _LINES else np.inf
    return float(np.sqrt(variance)) if beside < 2.0 * 6.0 * variance else np.inf


def floor_beside(recording: Recording, arm: Arm | None, pipeline: Pipeline) -> tuple[ChannelNoise, ...]:
    """As ``estimated_floor``, beside a fitted pipeline with the recording's sensors."""
    base = pipeline.expected(signals_of(recording, arm), np.random.default_rng(0))
    floors = []
    for values in (all_readings(recording) - base.volts).T:
        if np.isnan(values).any():  # a sensor that was not recorded
            floors.append(ChannelNoise(np.nan, samples=len(values) // 20, degrees=None))
            continue
        differences = np.diff(values, n=2)
        spread = float(np.median(np.abs(differences - np.median(differences)))) / 0.6745
        between = np.sqrt(6.0) * _between_tones(differences)
        spread = between if between < (1.0 - _TONAL / np.sqrt(len(values))) * spread else spread
        local = beside_neighbours(values * np.sqrt(6.0) / spread)
        if np.isfinite((tails := tails_of(local, None))[0]):  # of long tails the median tells too little
            less = values + (drawn_in(local, *tails) - local) * spread / np.sqrt(6.0)
            spread = float(np.std(np.diff(less, n=2)))
        # a median of overlapping differences tells a twentieth of what as many independent samples would
        floors.append(ChannelNoise(spread**2 / 6.0, samples=len(values) // 20, degrees=None))
    return tuple(floors)
