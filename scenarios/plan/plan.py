"""The best maneuver of an arm in a given time, as a scenario, with what it promises."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np

from estimators.design.exchange import OPEN, Criterion
from estimators.design.isolability import Isolability, Key
from estimators.known_angle.model import SensorParameters
from estimators.known_angle.statistics import Statistics
from estimators.stillness.at_rest import SETTLE_S
from rig.arm import Arm
from rig.arm.clearance import Clearance
from rig.arrays import Array
from rig.channels import ACCELEROMETER, COLUMNS_OF
from rig.errors import RigError
from rig.maneuver import FourierSweep, StaticPoses, TorusSweep
from rig.maneuver.fitting import stops_at
from rig.maneuver.moves import Dynamics
from rig.maneuver.static_poses import between
from rig.progress import Progress, unheard
from rig.trajectory import check_samples
from scenarios.bound import noise_of
from scenarios.isolability import shown_by
from scenarios.plan.poses import WORTHLESS, PosePlan, PoseSearch
from scenarios.plan.sweeps import INSTANTS, SweepPlan, SweepSearch, sweep_curve
from scenarios.plan.telling import telling, telling_sweep
from scenarios.scenario import Scenario
from scenarios.terminal.bound import names

Kind = Literal["poses", "sweep"]

#: What a plan is compared with: the paper's sweep on its arm, every so many samples of it.
REFERENCE: Final = "the sweep of Renk et al. (27.7 min, 6,656 samples)"
_EVERY: Final = 25
_RATE_HZ: Final = 100.0
#: Shares of the time for which the curve tells what shortening loses.
_SHORTER: Final = (0.25, 0.35, 0.5, 0.65, 0.8, 1.0, 1.25, 1.5)
_FEWEST_POSES: Final = 5
_DIGITS: Final = 2


@dataclass(frozen=True, eq=False)
class Parameters:
    """What a plan promises for one sensor.

    Attributes:
        sensor: which. names: (14,) as of ``Criterion``.
        std, reference: (14,) in a sensitivity's share, an offset over the full reading, and rad; ``OPEN`` where nothing
            is told.
        moved: (14,) by how much the sensor's acceleration moves what is found, in the same; zero at rest.
        share: (k, 14) of what is learned of each parameter, what each pose, or tenth of a sweep, has paid for.
    """

    sensor: str
    names: tuple[str, ...]
    std: Array
    reference: Array
    moved: Array
    share: Array

    @classmethod
    def of(cls, criterion: Criterion, gram: Array, cross: Array) -> Parameters:
        """Of parts of a maneuver: (k, 10, 10), and (k, 10, 3) as of ``SweepSearch.grams``."""
        each = criterion.information(gram)
        total = each.sum(axis=0)
        std = criterion.std(total[None])[0]
        moved = criterion.moved(total[None], cross.sum(axis=0)[None])[0]
        share = np.einsum("ij,kji->ki", np.linalg.pinv(total, hermitian=True), each)
        return cls(criterion.sensor, criterion.names, std, criterion.reference, moved, share)

    @property
    def ratio(self) -> Array:
        """(14,) error, of ``std`` and ``moved`` in squares, over the reference; NaN where that tells nothing."""
        return np.where(self.reference < OPEN, np.hypot(self.std, self.moved) / self.reference, np.nan)


@dataclass(frozen=True, eq=False)
class Plan:
    """A planned maneuver.

    Attributes:
        scenario: that makes it. found: its poses, or its sweep.
        parameters: by sensor, the standard deviations that it promises.
        curve: (m, 2) shorter and longer times [s] and the worst ratio in them, with fewer poses or harmonics where
            that is better; of a plan that is to tell effects apart with the same ones.
        assumed: what the arm's file does not state. slender: whether links were taken for capsules.
        told: what it shows of the effects that it is to tell apart; None where it is to calibrate.
    """

    scenario: Scenario
    found: PosePlan | SweepPlan
    parameters: tuple[Parameters, ...]
    curve: Array
    assumed: str
    slender: bool
    told: Isolability | None = None

    @property
    def maneuver(self) -> StaticPoses | FourierSweep:
        """Of the scenario."""
        maneuver = self.scenario.maneuver
        assert isinstance(maneuver, StaticPoses | FourierSweep)
        return maneuver

    def to_json(self) -> dict[str, Any]:
        """A JSON object; what cannot be told is null."""
        return {
            "format": "rig-plan/1",
            "scenario": self.scenario.name,
            "seconds": self.maneuver.duration_s,
            **self._kind(),
            "samples": round(self.found.samples_s * self.maneuver.rate_Hz),
            "worst": self.found.worst,
            "reference": REFERENCE,
            "parameters": {
                each.sensor: {
                    name: {
                        "std": _told(each.std[place]),
                        "reference": _told(each.reference[place]),
                        "moved_by_acceleration": float(each.moved[place]),
                        "share": [round(float(share), 4) for share in each.share[:, place]],
                    }
                    for place, name in enumerate(each.names)
                }
                for each in self.parameters
            },
            "curve": [{"seconds": float(t), "worst": _told(value)} for t, value in self.curve],
            "effects": None if self.told is None else self.told.to_json(),
            "assumed": self.assumed,
            "links_as_capsules": self.slender,
        }

    def _kind(self) -> dict[str, Any]:
        """What it consists of; what a plan of the other kind has is null."""
        names = (
            "poses",
            "hold_s",
            "move_s",
            "settle_s",
            "harmonics",
            "acceleration_rms_m_s2",
            "acceleration_peak_m_s2",
        )
        if isinstance(self.found, PosePlan):
            own: tuple[Any, ...] = (len(self.found.q), self.found.hold_s, self.found.move_s, SETTLE_S, None, None, None)
        else:
            own = (None, None, None, None, self.found.values.shape[1] // 2, *self.found.acceleration)
        return dict(zip(names, own, strict=True))


def _told(value: float) -> float | None:
    return float(value) if value < 0.5 * OPEN else None


def criteria_of(scenario: Scenario, weights: Mapping[str, float] | None = None) -> list[Criterion]:
    """Of a scenario's sensors, relative to the paper's sweep on its own arm.

    Raises:
        RigError: a channel without noise.
    """
    noise = noise_of(scenario)
    rotations = Arm.a465().rotation_map.rotations(TorusSweep().trajectory().q[::_EVERY])
    gram = Statistics.from_rotations(rotations).gram
    found = []
    for name, sensor in scenario.truth.sensors.items():
        parameters = SensorParameters.of(sensor, scenario.rig.environment.field(name))
        found.append(Criterion.of(name, parameters, noise[COLUMNS_OF[name]], gram, weights))
    return found


def make_plan(
    base: Scenario,
    seconds: float,
    *,
    kind: Kind = "poses",
    weights: Mapping[str, float] | None = None,
    table_m: float | None = None,
    boxes: Sequence[tuple[float, float, float, float, float, float]] = (),
    margin_m: float = 0.01,
    speed: float | None = None,
    acceleration: float | None = None,
    tell: Sequence[Key] | None = None,
    seed: int = 0,
    name: str = "plan",
    progress: Progress = unheard,
) -> Plan:
    """The poses with holds, or the sweep, from which a calibration is most certain in this time, moves included.

    To tell causes apart, those that separate the least separated pair of them most.

    Args:
        base: arm, sensors and surroundings. seconds: for all of it. kind: poses with holds, or a continuous sweep.
        weights: as of ``Criterion.of``. table_m, boxes, margin_m: as of ``Clearance.of``; without a table and without
            surroundings in the arm's file, the arm stands on a table at the height of its base.
        speed, acceleration: as of ``Dynamics.of``. tell: effects and places to tell apart, none for all that it can
            show; None: to calibrate. seed: of the search. name: of the scenario.
        progress: called with the share done.

    Raises:
        RigError: no arm, no noise, too little time or room, or too much time to be simulated.
    """
    arm = base.rig.arm
    if arm is None:
        raise RigError(f"scenario {base.name}: has no arm, expected one that a maneuver can be planned for, or --arm")
    if not seconds >= 1.0 / _RATE_HZ:
        raise RigError(f"--seconds: found {seconds:g}, expected {1.0 / _RATE_HZ:g}, the time of a sample, or more")
    check_samples(seconds, _RATE_HZ, "--seconds")
    criteria = criteria_of(base, weights)
    height = table_m if table_m is not None or arm.is_a465 else 0.0
    clearance = Clearance.of(arm, height, boxes, margin_m)
    dynamics = Dynamics.of(arm, speed, acceleration)
    search = PoseSearch(arm, clearance, dynamics, criteria, _RATE_HZ, seed)
    if kind == "sweep":
        sweeps = SweepSearch(search)
        swept = sweeps.best(seconds, progress) if tell is None else telling_sweep(base, sweeps, seconds, tell, progress)
        made = _swept(base, sweeps, swept, name, tell is not None)
    else:
        found = search.best(seconds, progress) if tell is None else telling(base, search, seconds, tell, progress)
        made = _posed(base, search, found, seconds, name, tell is not None)
    if tell is None:
        return made
    told = shown_by(made.scenario, made.maneuver, tell or None)
    causes = "all effects that it can show" if not tell else names(tell, arm.place_names)
    scenario = replace(made.scenario, description=f"Planned to tell apart: {causes}.")
    return replace(made, scenario=scenario, told=told)


def _posed(base: Scenario, search: PoseSearch, found: PosePlan, seconds: float, name: str, whole: bool) -> Plan:
    """The plan of poses that were found: rounded as a person reads them, and judged as they then are.

    ``whole``: in other times it is to have all of the poses, as where they were not chosen to calibrate.
    """
    arm = search.arm
    shown = arm.in_degrees(found.q)
    shown = np.where(arm.slides, np.round(shown, 4), np.round(shown, _DIGITS)) + 0.0
    q = arm.from_degrees(shown)
    poses = search.timed(q, seconds)
    maneuver = stops_at(arm, shown, poses.hold_s, poses.move_s, _RATE_HZ)
    said = "Readings at rest count: rig calibrate --still."
    made = _scenario(base, search, maneuver, name, f"{len(q)} poses", poses.worst, said)
    gram = (poses.hold_s - 2.0 * SETTLE_S) * search.rate_Hz * search.grams(poses.q)
    curve = _curve(search, poses, seconds, whole)
    return _promised(search, made, poses, between(q), gram, np.zeros((len(q), 10, 3)), curve)


def _swept(base: Scenario, search: SweepSearch, found: SweepPlan, name: str, whole: bool) -> Plan:
    """The plan of a sweep that was found: rounded as a person reads it, and judged as it then is; ``whole`` as of
    ``_posed``, of its harmonics."""
    room, seconds = search.room, found.seconds
    maneuver = search.maneuver(found.values, seconds)
    swept = search.plan(search.values_of(maneuver), seconds)
    said = (
        "The sensor's acceleration, which a calibration takes for gravity, is counted as an error: simulated with it."
    )
    made = replace(_scenario(base, room, maneuver, name, "Sweep", swept.worst, said), motion="inertial")
    each = search.grams(swept.motion, seconds * room.rate_Hz / INSTANTS)
    gram, cross = (part.reshape(10, -1, *part.shape[1:]).sum(axis=1) for part in each)  # over tenths of the time
    curve = sweep_curve(search, swept, np.array(_SHORTER) * seconds, whole)
    return _promised(room, made, swept, search.way(swept.values, seconds), gram, cross, curve)


def _promised(
    room: PoseSearch, made: Scenario, found: PosePlan | SweepPlan, way: Array, gram: Array, cross: Array, curve: Array
) -> Plan:
    """The plan of what was found, whose ``way`` (m, N) [rad, m] must be free; ``gram`` and ``cross`` as of
    ``Parameters.of``, of which an accelerometer alone feels the latter."""
    if contact := room.clearance.first_contact(way):
        raise RigError(f"plan: {contact[1]} and {contact[2]} come too near each other on the way: try another --seed")
    still = np.zeros_like(cross)
    parameters = tuple(
        Parameters.of(one, gram, cross if one.sensor == ACCELEROMETER else still) for one in room.criteria
    )
    return Plan(made, found, parameters, curve, room.dynamics.assumed, room.clearance.slender)


def _scenario(
    base: Scenario,
    search: PoseSearch,
    maneuver: StaticPoses | FourierSweep,
    name: str,
    what: str,
    worst: float,
    said: str,
) -> Scenario:
    return replace(
        base.with_arm(search.arm).with_acquisition(decimation=1),
        name=name,
        maneuver=maneuver,
        title=f"{what} of the {search.arm.name} in {maneuver.duration_s:.1f} s",
        description=f"Planned to calibrate: the worst error is {worst:.3f} of that of {REFERENCE}. {said}",
        source=f"rig plan; sensors and surroundings of {base.name}",
    )


def _curve(search: PoseSearch, poses: PosePlan, seconds: float, whole: bool) -> Array:
    """(m, 2) times and the worst ratio in them, with as many of the poses as are best then, or the ``whole``."""
    nested, q = [poses.q], poses.q
    while len(q) > _FEWEST_POSES and not whole:
        fewer = [np.delete(q, place, axis=0) for place in range(len(q))]
        q = min(fewer, key=lambda rest: search.timed(rest, 2.0 * seconds).worst)
        nested.append(q)
    times = np.array(_SHORTER) * seconds
    worst = [min(search.timed(each, time).worst for each in nested) for time in times]
    return np.array([(time, value) for time, value in zip(times, worst, strict=True) if value < WORTHLESS])


def trajectory_csv(plan: Plan) -> str:
    """Joint trajectory for a controller: time, positions, velocities, at the plan's rate; deg, or m of joints that
    slide."""
    arm = plan.scenario.rig.arm
    assert arm is not None
    motion = plan.maneuver.trajectory()
    units = ["m" if slide else "deg" for slide in arm.slides]
    header = ["t_s", *(f"{name}_{unit}" for name, unit in zip(arm.joint_names, units, strict=True))]
    header += [f"{name}_{unit}_per_s" for name, unit in zip(arm.joint_names, units, strict=True)]
    text = io.StringIO()
    rows = np.column_stack([motion.t, arm.in_degrees(motion.q), arm.in_degrees(motion.qd)]) + 0.0
    np.savetxt(text, rows, "%.6f", ",", header=",".join(header), comments="")  # encoders do not resolve 1e-6
    return text.getvalue()
