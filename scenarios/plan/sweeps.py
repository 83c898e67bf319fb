"""Continuous sweeps for a calibration: Fourier series of all joints, bettered by linear programs, free of contacts.

A sensor that moves feels its own acceleration, which a calibration takes for gravity. So what is made small is the
error: the standard deviation, and by how much the acceleration along the sweep moves what is found.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import linprog

from rig.arrays import Array
from rig.channels import ACCELEROMETER
from rig.errors import RigError
from rig.maneuver import FourierSweep
from rig.maneuver.fitting import checked_limits
from rig.maneuver.fourier_sweep import series
from rig.progress import Progress, unheard
from rig.threads import one_blas_thread
from rig.trajectory import JointTrajectory
from scenarios.plan.poses import FAR, WORTHLESS, PoseSearch

HARMONICS: Final = 8
#: Random sweeps that are looked at; the best of them that are bettered, and in how many steps.
_DRAWN: Final = 40
_BETTERED: Final = 6
_STEPS: Final = 20
#: The largest step of a coefficient and the least, of half a joint's range; and that of a derivative.
_FAR, _NEAR, _SMALL = 0.1, 1e-4, 1e-5
#: Instants at which a sweep is judged; the share of a joint's range that it may go between looks for contacts.
INSTANTS: Final = 200
_POSES: Final = 1000  # of which one at least must be free
_FINE: Final = 0.01
#: Speeds and accelerations stay below the limits by this factor, which leaves room for rounding.
_SLOWER: Final = 0.99
_DIGITS: Final = 4


@dataclass(frozen=True, eq=False)
class SweepPlan:
    """A sweep.

    Attributes:
        values: (N, 1 + 2 L) constant, cosines and sines of each joint [rad, m]. seconds: its period.
        worst: the criterion: the largest error over its reference.
        acceleration: of the sensor, root of the mean square and the greatest [m/s^2].
    """

    values: Array
    seconds: float
    worst: float
    acceleration: tuple[float, float]

    @property
    def motion(self) -> JointTrajectory:
        """At the instants at which it is judged."""
        return motion(self.values, self.seconds)

    @property
    def samples_s(self) -> float:
        """Time of readings that count [s]."""
        return self.seconds


def motion(values: Array, seconds: float, instants: int = INSTANTS) -> JointTrajectory:
    """A sweep at so many instants of its period."""
    harmonics = values.shape[1] // 2
    t = np.linspace(0.0, seconds, instants, endpoint=False)
    return series(t, seconds, values[:, 0], values[:, 1 : 1 + harmonics].T, values[:, 1 + harmonics :].T)


class SweepSearch:
    """Looks for the sweep that a calibration gains most from in a given time.

    Args:
        room: the arm, what it may do and touch, the sensors' criteria.
    """

    def __init__(self, room: PoseSearch) -> None:
        self.room, self.arm = room, room.arm
        self.span = 0.5 * (room.high - room.low)[:, None]

    def best(self, seconds: float, progress: Progress = unheard) -> SweepPlan:
        """The best sweep in this time.

        Raises:
            RigError: no sweep that was drawn is free of contacts, or the time is too short for any to tell something.
        """
        with one_blas_thread():
            drawn = sorted(self.drawn(seconds, _DRAWN), key=lambda each: each[0])[:_BETTERED]
            found = []
            for done, (_, values) in enumerate(drawn):
                found.append(self._bettered(values, seconds))
                progress((done + 1) / len(drawn))
        best = min(found, key=lambda each: each.worst)
        if best.worst >= FAR:
            raise RigError(
                f"--seconds: found {seconds:g}, expected more, or parameters left out with --weight NAME=0: no sweep of"
                f" arm {self.arm.name} tells all of them in it"
            )
        return best

    def plan(self, values: Array, seconds: float) -> SweepPlan:
        """A sweep with what it is worth."""
        path = motion(values, seconds)
        size = np.linalg.norm(self.arm.site_acceleration(path.q, path.qd, path.qdd), axis=1)
        worst = float(np.exp(self._errors(values[None], seconds)[0].max()))
        return SweepPlan(values, seconds, worst, (float(np.sqrt(np.mean(size**2))), float(size.max())))

    def fitted(self, values: Array, seconds: float) -> Array:
        """The sweep at rest at both ends, and as much smaller as the arm's limits ask for."""
        low, high = self.room.low, self.room.high
        harmonics = values.shape[1] // 2
        number = np.arange(1.0, harmonics + 1)
        cosine, sine = values[:, 1 : 1 + harmonics], values[:, 1 + harmonics :]
        cosine = cosine - (cosine @ number**2)[:, None] * number**2 / (number**4).sum()
        sine = sine - (sine @ number)[:, None] * number / (number**2).sum()
        waves = np.hstack([np.zeros((len(values), 1)), cosine, sine])
        path = motion(waves, seconds, 4 * INSTANTS)
        up, down = path.q.max(axis=0), -path.q.min(axis=0)
        use = np.max(
            [
                (up + down) / (high - low),
                np.abs(path.qd).max(axis=0) / (_SLOWER * self.room.dynamics.speed),
                np.abs(path.qdd).max(axis=0) / (_SLOWER * self.room.dynamics.acceleration),
                np.ones(len(values)),
            ],
            axis=0,
        )
        waves /= use[:, None]
        waves[:, 0] = np.clip(values[:, 0], low + down / use, high - up / use)
        return waves

    def free(self, values: Array, seconds: float) -> bool:
        """Whether the arm touches nothing on the way."""
        return not self.room.clearance.touching(self.way(values, seconds)).any()

    def way(self, values: Array, seconds: float) -> Array:
        """(m, N) joint values along a sweep, near enough to each other to look for contacts."""
        travel = np.abs(np.diff(motion(values, seconds).q, axis=0)).sum(axis=0) / (2.0 * self.span[:, 0])
        return motion(values, seconds, max(INSTANTS, int(np.ceil(travel.max() / _FINE)))).q

    def grams(self, path: JointTrajectory, samples: float) -> tuple[Array, Array]:
        """Of instants (n,) that stand for so many samples each: (n, 10, 10) Gram matrices, and (n, 10, 3) products with
        what the sensor's acceleration adds to the field, frame 6."""
        rotations = self.arm.rotation_map.rotations(path.q)
        felt = -np.einsum(
            "nji,nj->ni", rotations.reshape(-1, 3, 3), self.arm.site_acceleration(path.q, path.qd, path.qdd)
        )
        x = np.hstack([rotations, np.ones((len(rotations), 1))])
        return samples * x[:, :, None] * x[:, None], samples * x[:, :, None] * felt[:, None]

    def rounded(self, values: Array) -> Array:
        """Coefficients (N, 1 + 2 L) as a person reads them [deg, m]."""
        slides = np.array(self.arm.slides)[:, None]
        shown = np.where(slides, np.round(values, _DIGITS + 2), np.round(np.degrees(values), _DIGITS))
        return np.asarray(shown + 0.0)

    def values_of(self, maneuver: FourierSweep) -> Array:
        """(N, 1 + 2 L) of a maneuver."""
        shown = np.hstack([np.array(maneuver.centre_deg)[:, None], maneuver.cosine_deg, maneuver.sine_deg])
        return self.arm.from_degrees(shown.T).T

    def maneuver(self, values: Array, seconds: float) -> FourierSweep:
        """The maneuver of a sweep."""
        shown = self.rounded(values)
        harmonics = shown.shape[1] // 2
        rows = [tuple(map(float, row)) for row in shown]
        return FourierSweep(
            centre_deg=tuple(row[0] for row in rows),
            cosine_deg=tuple(row[1 : 1 + harmonics] for row in rows),
            sine_deg=tuple(row[1 + harmonics :] for row in rows),
            duration_s=seconds,
            rate_Hz=self.room.rate_Hz,
            limits_deg=checked_limits(self.arm),
            slides=self.arm.slide_numbers,
        )

    def drawn(self, seconds: float, count: int) -> list[tuple[float, Array]]:
        """Random sweeps that touch nothing, with their worst errors.

        Raises:
            RigError: none is found.
        """
        number = np.tile(np.arange(1.0, HARMONICS + 1), 2)
        found: list[tuple[float, Array]] = []
        anywhere = np.random.default_rng(0).uniform(self.room.low, self.room.high, (_POSES, self.arm.dof))
        tries = 0 if self.room.clearance.touching(anywhere).all() else 10 * count  # no pose is free, so no sweep is
        for _ in range(tries):
            waves = self.span * self.room.rng.standard_normal((self.arm.dof, 2 * HARMONICS)) / number
            size = self.room.rng.uniform(0.1, 1.0)
            centre = self.room.rng.uniform(self.room.low, self.room.high)[:, None]
            values = self.fitted(np.hstack([centre, size * waves]), seconds)
            if self.free(values, seconds):
                found.append((float(self._errors(values[None], seconds)[0].max()), values))
            if len(found) == count:
                break
        if not found:
            raise RigError(
                f"arm {self.arm.name}: no random sweep is free of contacts, expected more room: a lower table, fewer"
                " boxes, or a smaller --margin"
            )
        return found

    def _bettered(self, values: Array, seconds: float) -> SweepPlan:
        """By sequential linear programs: the errors are linear over a small step, whose largest a program makes small
        (K. Madsen, "Minimization of non-linear approximation functions", 1986)."""
        here, step = self._errors(values[None], seconds)[0], _FAR
        held = np.zeros(self.arm.dof, dtype=bool)
        for _ in range(_STEPS):
            slopes = self._slopes(values, here, seconds)
            bounds = np.where(held, 0.0, step)[:, None] + np.zeros_like(values)
            moved = _least(here, slopes, bounds.ravel()).reshape(values.shape)
            while step > _NEAR:
                tried = self.fitted(values + self.span * moved, seconds)
                there = self._errors(tried[None], seconds)[0]
                better = there.max() < here.max()
                free = better and self.free(tried, seconds)
                if free:
                    values, here, step = tried, there, min(1.5 * step, _FAR)
                    held[:] = False
                    break
                moved, step = 0.5 * moved, 0.5 * step
                if better:  # something is in the way: other joints next
                    held = self.room.rng.random(self.arm.dof) < 0.5
            else:
                if not held.any():
                    break
                step = 0.1 * _FAR
        return self.plan(values, seconds)

    def _slopes(self, values: Array, here: Array, seconds: float) -> Array:
        """(k, N (1 + 2 L)) of the errors by steps of the coefficients, in half ranges."""
        steps = _SMALL * np.eye(values.size).reshape(-1, *values.shape) * self.span
        tried = np.array([self.fitted(values + each, seconds) for each in steps])
        return (self._errors(tried, seconds) - here).T / _SMALL

    def _errors(self, values: Array, seconds: float) -> Array:
        """(m, k) logarithms of the errors of all sensors over their references, of sweeps (m, N, 1 + 2 L)."""
        paths = [motion(each, seconds) for each in values]
        joined = JointTrajectory(*(np.concatenate([getattr(path, name) for path in paths]) for name in _FIELDS))
        each = self.grams(joined, seconds * self.room.rate_Hz / INSTANTS)
        gram, cross = (part.reshape(len(values), INSTANTS, *part.shape[1:]).sum(axis=1) for part in each)
        found = []
        for criterion in self.room.criteria:
            information = criterion.information(gram)
            moved = criterion.moved(information, cross) if criterion.sensor == ACCELEROMETER else None
            found.append(criterion.ratios(information, moved))
        return np.log(np.maximum(np.hstack(found), 1e-12))


def sweep_curve(search: SweepSearch, swept: SweepPlan, times: Array, whole: bool) -> Array:
    """(m, 2) times [s] and the worst error of the sweep in them, slowed or with fewer harmonics as is best then; slowed
    where it is to stay ``whole``."""
    kept = [swept.values] if whole else _nested(swept.values)
    found = []
    for seconds in times:
        tried = [search.plan(search.fitted(fewer, seconds), seconds) for fewer in kept]
        free = (each for each in sorted(tried, key=lambda each: each.worst) if search.free(each.values, seconds))
        worst = next((each.worst for each in free), WORTHLESS)
        if worst < WORTHLESS:
            found.append((float(seconds), worst))
    return np.array(found).reshape(-1, 2)


def _nested(values: Array) -> list[Array]:
    """The sweep (N, 1 + 2 L), and with fewer harmonics; two are the fewest that begin at rest."""
    constant, waves = values[:, :1], values[:, 1:].reshape(len(values), 2, -1)
    return [np.hstack([constant, waves[:, 0, :left], waves[:, 1, :left]]) for left in range(waves.shape[2], 1, -1)]


_FIELDS: Final = ("t", "q", "qd", "qdd")


def _least(here: Array, slopes: Array, bounds: Array) -> Array:
    """The step (n,) within bounds (n,) that makes the largest of ``here`` (k,) + ``slopes`` (k, n) step least."""
    count = len(bounds)
    found = linprog(
        np.append(np.zeros(count), 1.0),
        A_ub=np.column_stack([slopes, -np.ones(len(here))]),
        b_ub=-here,
        bounds=[*zip(-bounds, bounds, strict=True), (None, None)],
    )
    return np.zeros(count) if found.x is None else np.asarray(found.x[:count])
