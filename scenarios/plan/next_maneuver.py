"""The next maneuver where a recording does not decide between explanations: the one that separates them best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from estimators.design.maneuver_bound import predict
from estimators.gap.diagnosis import Diagnosis
from estimators.gap.report.separation import Explanation, Separation, Trial, contest, rivals
from estimators.known_angle.model import SensorParameters
from estimators.known_angle.statistics import Statistics
from rig.arm import Arm
from rig.arrays import Array, Mask
from rig.channels import ACCELEROMETER, COLUMNS_OF
from rig.effects import Effect
from rig.maneuver import StaticPoses, TorusSweep
from rig.signals import Signals
from scenarios.gap_report.gap_residuals import GapResiduals
from scenarios.gap_report.maneuver_words import decides, described, interval_words, noise_advice, speed_advice
from scenarios.plan.closest_maneuver import closest_maneuver
from scenarios.plan.maneuver_family import Family, family, neighbours
from scenarios.plan.undecided import fewer_rows, titles, undecided_words
from scenarios.scenario import Scenario
from scenarios.writer import set_fields, toml_table

Joint = TorusSweep | StaticPoses

#: Samples of a maneuver while maneuvers are compared, and when the best one's promise is made.
_COMPARED: Final = 250
_PROMISED: Final = 1800
#: A pair that no maneuver separates by this noncentrality, five standard deviations, is told as such.
_SEPARATED: Final = 25.0
#: The arm's own acceleration, that the model does without, stays below so many standard deviations in all.
_QUASI_STATIC: Final = 3.0
#: A maneuver counts as one that can be calibrated if it still can with so many times the noise and gap of the
#: recording: another maneuver shows more of what is not modelled.
_NOISIER: Final = 2.0
#: By how much another room's temperature differs [degC]: as much as a window or a heater does.
_ANOTHER_ROOM: Final = 5.0
#: Rounds of refinement, with ever smaller steps.
_STEPS: Final = (1.0, 0.4)


@dataclass(frozen=True)
class NextManeuver:
    """A maneuver and what it promises.

    Attributes:
        maneuver: within the arm's limits.
        separations: for each pair of explanations that it separates, in the order truth, rival.
        recorded: the same pairs on the recorded maneuver, had it been made again in the same time.
        alike: pairs that no maneuver tried separates.
        tried: how many were.
        felt: whether it is so fast that the accelerometer feels the arm's own acceleration.
        warmer_degC: of the room, where only that separates them, judged together with the recording there is.
    """

    maneuver: Joint
    separations: tuple[Separation, ...]
    recorded: tuple[float, ...]
    alike: tuple[tuple[tuple[Effect, ...], tuple[Effect, ...]], ...]
    tried: int
    felt: bool = False
    warmer_degC: float = 0.0

    @property
    def worst(self) -> Separation:
        """The pair that is separated least."""
        return min(self.separations, key=lambda pair: pair.noncentrality)

    @property
    def why(self) -> str:
        """What it is for, in a sentence."""
        worst = self.worst
        truth, rival = titles(worst.truth, worst.rival)
        words = (
            f"If “{truth}” is true, “{rival}” fits worse by a chi-square of "
            f"{interval_words(worst.noncentrality, worst.low, worst.high)}"
        )
        if not decides(worst.low):
            words += ", which may be too little to decide"
        if len(self.separations) > 2:
            words += "; every other pair differs by more"
        if self.alike:
            words += ". No maneuver tried separates " + "; ".join(
                "“{}” from “{}”".format(*titles(*pair)) for pair in self.alike
            )
        words += "."
        if self.felt:
            words += " So fast an arm makes an acceleration of its own as well, which the model leaves out."
        if self.warmer_degC:
            words = (
                f"No other maneuver tells them apart; the same one does with the room {self.warmer_degC:g} "
                f"°C warmer or colder, both recordings diagnosed together. {words}"
            )
        return words

    def to_json(self) -> dict[str, Any]:
        """For a diagnosis' ``next``."""
        return {
            "why": self.why,
            "maneuver": described(self.maneuver, self.warmer_degC),
            "minutes": round(self.maneuver.duration_s / 60.0, 2),
            "separates": [
                {
                    "truth": _names(pair.truth),
                    "rival": _names(pair.rival),
                    "chi_square": pair.noncentrality,
                    "low": pair.low,
                    "high": pair.high if np.isfinite(pair.high) else None,
                    "mistaken": pair.mistaken,
                    "recorded_maneuver": before,
                }
                for pair, before in zip(self.separations, self.recorded, strict=True)
            ],
            "cannot_separate": [[_names(each) for each in pair] for pair in self.alike],
        }

    def to_toml(self, rig: Scenario) -> str:
        """The rig on this maneuver as a scenario, with its causes; those of other explanations stand in comments."""
        there = {(each.name, each.where) for each in rig.rig.effects}
        others = {
            f"{effect.name} {effect.where}": effect
            for pair in self.separations
            for effect in (*pair.truth, *pair.rival)
            if (effect.name, effect.where) not in there
        }
        room = rig.rig.environment
        room = replace(room, temperature_degC=room.temperature_degC + self.warmer_degC)
        made = replace(
            rig,
            rig=replace(rig.rig, environment=room),
            motion="inertial" if self.felt else rig.motion,
            maneuver=replace(self.maneuver, rate_Hz=self.maneuver.rate_Hz * rig.rig.acquisition.decimation),
            title=f"What to do next with the rig of {rig.name}",
            description=self.why,
            source="Proposed by rig diagnose: the recorded maneuver in another room."
            if self.warmer_degC
            else f"Proposed by rig diagnose: the best of {self.tried} maneuvers, by the least separated pair.",
        )
        lines = ["The rig has the likeliest explanation. What the others have instead of it or beside it:"]
        for effect in others.values():
            lines += toml_table(f"[[effects.{effect.name}]]", set_fields(effect)).splitlines()
        return "".join(f"# {line}\n" for line in lines) + "\n" + made.to_toml()


def next_maneuver(
    diagnosis: Diagnosis, residuals: GapResiduals, rig: Scenario | None, minutes: float | None = None
) -> NextManeuver | None:
    """The maneuver that separates a diagnosis' explanations best, by the least separated pair (T-optimality).

    Args:
        residuals: of the diagnosed recording.
        rig: its temperature is the next recording's.
        minutes: how long it may take; None: as long as the recording.

    Returns:
        None where there is nothing to separate, no arm, or no maneuver that separates any of the explanations.
    """
    recording, arm = residuals.recording, residuals.data.base.arm
    if arm is None or recording.q is None:
        return None
    group = contest(fewer_rows(residuals), diagnosis)
    if not group:
        return None
    played = closest_maneuver(recording.t, recording.q, recording.rate_Hz, arm).maneuver
    assert isinstance(played, TorusSweep | StaticPoses)
    search = Search(residuals, rig, group, Family.of(arm, recording.t, recording.q))
    same = _lasting(played, played.duration_s if minutes is None else 60.0 * minutes, arm)
    search.most_acceleration = max(_QUASI_STATIC, 1.2 * search.acceleration(same))
    found = None if search.remembers else search.best(same)
    if found is None and not search.remembers:  # what slow maneuvers do not separate, faster ones may
        search.most_acceleration = np.inf
        fast = search.best(same)
        found = None if fast is None else replace(fast, felt=True)
    if found is None and not search.remembers:
        found = search.in_another_room(same)
    return found


def next_step(
    diagnosis: Diagnosis, residuals: GapResiduals, rig: Scenario | None, minutes: float | None = None
) -> tuple[dict[str, Any], str | None]:
    """What would tell the explanations apart between which a recording does not decide.

    Args:
        residuals: of the diagnosed recording.
        rig: calibrated, with the causes; None where no scenario can describe it.
        minutes: how long it may take; None: as long as the recording.

    Returns:
        For a diagnosis' ``next``, nothing where the recording decides; and as a scenario, where the rig can run it.
    """
    if not rivals(diagnosis):
        return {}, None
    found = next_maneuver(diagnosis, residuals, rig, minutes)
    advice = " ".join(filter(None, [speed_advice(diagnosis), noise_advice(diagnosis)]))
    if found is None:
        if residuals.data.base.arm is None:
            advice = "Without joint angles no maneuver can be proposed: record tool poses that differ more, or faster."
        return {"why": advice or undecided_words(residuals, diagnosis)}, None
    scenario = None if rig is None else found.to_toml(rig)
    words = {**found.to_json(), "why": " ".join(filter(None, [found.why, advice]))}
    if scenario is not None:
        words["scenario"] = f"{diagnosis.name}.next.toml"
    return words, scenario


class Search:
    """Tries maneuvers on the calibrated rig.

    Attributes:
        most_acceleration: the arm's own acceleration allowed, in standard deviations of the accelerometer over all
            readings.
        remembers: whether an effect depends on the samples before a reading.
    """

    def __init__(
        self, residuals: GapResiduals, rig: Scenario | None, group: tuple[Explanation, ...], room: Family
    ) -> None:
        self._pipeline = residuals.calibrated
        self._floor = residuals.floor
        self._environment = residuals.calibrated.environment if rig is None else rig.rig.environment
        self._warm = residuals.recording.temperature is not None
        self._group = group
        effects = [effect for each in group for effect in each.effects]
        self.remembers = any(effect.remembers for effect in effects)
        self.room = room
        self.most_acceleration = np.inf
        self._sensors = {
            name: SensorParameters.of(sensor, self._pipeline.environment.field(name))
            for name, sensor in self._pipeline.sensors.items()
        }
        rms = np.sqrt(np.mean(np.square(residuals.before), axis=0))
        self._noise = {name: _NOISIER * rms[COLUMNS_OF[name]] for name in self._sensors}

    def best(self, recorded: Joint) -> NextManeuver | None:
        """The allowed maneuver that tells best apart the pair of explanations it tells worst, by a local search.

        Only pairs count that some maneuver separates. None where none is allowed, or separates any.

        Args:
            recorded: the maneuver from whose family the search starts.
        """
        allowed = [each for each in family(self.room, recorded) if self.allowed(each)]
        if not allowed:
            return None
        tables = [self._table(each) for each in allowed]
        within = np.max(tables, axis=0) >= _SEPARATED  # (pairs,): what some maneuver separates
        if not within.any():
            return None
        worth = [float(table[within].min()) for table in tables]
        chosen, value = allowed[int(np.argmax(worth))], max(worth)
        tried = len(allowed)
        for step in _STEPS:
            for other in neighbours(self.room, chosen, step):
                if self.allowed(other):
                    tried += 1
                    if (new := float(self._table(other)[within].min())) > value:
                        chosen, value = other, new
        return self._promised(chosen, recorded, within, tried)

    def in_another_room(self, recorded: Joint) -> NextManeuver | None:
        """The recorded maneuver once more at another room temperature, where that separates any of the explanations.

        What as many readings more would tell in the same room does not count.
        """
        if not self._warm or not self._calibrates(recorded):  # it was made already
            return None
        same, another = (self._table(recorded, (0.0, warmer)) for warmer in (0.0, _ANOTHER_ROOM))
        within = another - same >= _SEPARATED
        return self._promised(recorded, recorded, within, 1, _ANOTHER_ROOM) if within.any() else None

    def _promised(self, chosen: Joint, recorded: Joint, within: Mask, tried: int, warmer: float = 0.0) -> NextManeuver:
        trial = self._trial(chosen, _PROMISED, (0.0, warmer) if warmer else (0.0,))
        before = self._table(recorded)
        separations, known, alike = [], [], []
        for index, (truth, rival) in enumerate(self._pairs):
            if within[index]:
                separations.append(trial.promise(truth, rival))
                known.append(float(before[index]))
            elif truth < rival or (rival, truth) not in self._pairs:
                alike.append((trial.explanations[truth].effects, trial.explanations[rival].effects))
        return NextManeuver(chosen, tuple(separations), tuple(known), tuple(alike), tried, warmer_degC=warmer)

    @property
    def _pairs(self) -> list[tuple[int, int]]:
        """Truth and rival of every ordered pair; a rival with more effects than the truth never fits worse."""
        numbers = range(len(self._group))
        return [
            (truth, rival)
            for truth in numbers
            for rival in numbers
            if truth != rival and not self._group[truth].within(self._group[rival])
        ]

    def _table(self, maneuver: Joint, rooms: Sequence[float] = (0.0,)) -> Array:
        """(pairs,) noncentralities, for a pair the smaller of both directions where both count."""
        found, pairs = self._trial(maneuver, _COMPARED, rooms).noncentralities, self._pairs
        return np.array([min(found[a, b], found[b, a]) if (b, a) in pairs else found[a, b] for a, b in pairs])

    def _trial(self, maneuver: Joint, samples: int, rooms: Sequence[float] = (0.0,)) -> Trial:
        """A maneuver tried once in each room, so much warmer than this one [degC], each time begun cold."""
        count = round(maneuver.duration_s * maneuver.rate_Hz)
        stride = max(1, count // samples)
        motion = maneuver.trajectory(np.arange(0, count, stride) / maneuver.rate_Hz)
        again = np.tile(np.arange(len(motion.t)), len(rooms))
        board = np.add.outer(rooms, self._environment.temperature(motion.t)).ravel() if self._warm else None
        signals = Signals(
            motion.t[again],
            arm=self.room.arm,
            q_encoder=motion.q[again],
            velocity=motion.qd[again],
            temperature=board,
        )
        return Trial.of(signals, self._pipeline, self._floor, stride, self._group)

    def allowed(self, maneuver: Joint) -> bool:
        """Whether the arm can make it, a calibration of it alone is not refused, and it is slow enough."""
        return (
            self.room.allows(maneuver)
            and self.acceleration(maneuver) <= self.most_acceleration
            and self._calibrates(maneuver)
        )

    def _calibrates(self, maneuver: Joint) -> bool:
        count = round(maneuver.duration_s * maneuver.rate_Hz)
        t = np.linspace(0.0, maneuver.duration_s, min(count, _COMPARED), endpoint=False)
        rotations = self.room.arm.rotation_map.rotations(maneuver.trajectory(t).q)
        gram = Statistics.from_rotations(rotations).gram * (count / len(t))
        return all(
            predict(gram, count, truth, self._noise[name]).problem is None for name, truth in self._sensors.items()
        )

    def acceleration(self, maneuver: Joint) -> float:
        """The arm's own acceleration that the accelerometer would feel, over all readings, in standard deviations."""
        sensor = self._pipeline.accelerometer
        if sensor is None:
            return 0.0
        motion = maneuver.trajectory(np.linspace(0.0, maneuver.duration_s, _COMPARED, endpoint=False))
        felt = self.room.arm.site_acceleration(motion.q, motion.qd, motion.qdd)
        sigma = np.sqrt([channel.variance for channel in self._floor[COLUMNS_OF[ACCELEROMETER]]])
        ratio = float(np.mean(np.asarray(sensor.sensitivity) / sigma))
        count = maneuver.duration_s * maneuver.rate_Hz
        return ratio * float(np.sqrt(count * np.mean(np.sum(felt**2, axis=1))))


def _lasting(maneuver: Joint, duration_s: float, arm: Arm) -> Joint:
    """The maneuver in another time, at about the same speeds."""
    factor = duration_s / maneuver.duration_s
    if factor == 1.0:
        return maneuver
    if isinstance(maneuver, TorusSweep):
        passes = [max(1, round(factor * count)) for count in (maneuver.yaw_passes, maneuver.pitch_passes)]
        corner = min(maneuver.corner_s, 0.5 * duration_s / max(passes))
        return replace(maneuver, duration_s=duration_s, yaw_passes=passes[0], pitch_passes=passes[1], corner_s=corner)
    count = max(2, round(factor * len(maneuver.angles)))
    poses = arm.in_degrees(maneuver.angles)[np.arange(count) % len(maneuver.angles)]
    cycle = duration_s / count
    return replace(maneuver, poses_deg=tuple(map(tuple, poses.tolist())), hold_s=0.1 * cycle, move_s=0.9 * cycle)


def _names(effects: Sequence[Effect]) -> list[dict[str, str]]:
    return [{"effect": effect.name, "where": effect.where} for effect in effects]
