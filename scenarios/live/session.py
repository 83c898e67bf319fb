"""One session: samples in; journal, calibration, monitor and display brought up to date; an end that loses nothing."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from estimators.live import Calibrator, Guide, Options, SensorState
from estimators.live.alarm import Alarm
from estimators.live.watch import Watch
from rig.arrays import Array
from rig.channels import ACCELEROMETER
from rig.errors import RigError
from rig.recording import Recording, scan_recording
from rig.stream import Feed, Journal
from rig.stream.journal import mended
from rig.stream.straight_poses import StraightPoses

if TYPE_CHECKING:
    from estimators import Calibration
    from rig.arm import Arm


#: The source is waited for so long at a time [s].
TICK_S: Final = 0.02
#: Estimates are brought up to date this often at most, take this share of the time at most, and in a flood of samples
#: come at every such growth of their number.
_ESTIMATE_S: Final = 0.05
_SHARE: Final = 0.2
#: How much the last one counts in the mean processor time that one takes.
_RECENT: Final = 0.1
_GROWTH: Final = 1.05
_MANY: Final = 20_000
_LATER_GROWTH: Final = 1.2
#: The stop rule is asked this often [s].
_RULE_S: Final = 0.25
_FIRST: Final = 50
#: The rule has to hold so long [s] of the stream before the session ends.
_HOLD_S: Final = 0.5
_EVENTS: Final = 1000
#: After so few samples the next ones are left to gather for so long [s]: each batch costs as much as hundreds of them.
_FEW: Final = 500
_GATHERED_S: Final = 0.015


@dataclass(frozen=True)
class Event:
    """Something to say.

    Attributes:
        t_s: of the stream [s]; NaN before its first sample.
        words: what.
        alarm: whether it is about the sensor, not about the stream.
    """

    t_s: float
    words: str
    alarm: bool = False

    def __str__(self) -> str:
        """One line."""
        return self.words if np.isnan(self.t_s) else f"{self.t_s:.2f} s: {self.words}"


class Display:
    """Something that shows a session; what it has not of its own does nothing."""

    def samples(self, batch: Recording) -> None:
        """New samples, before they are taken up."""

    def show(self, session: Session) -> None:
        """The state as it is now, some ten times a second at most."""

    def event(self, event: Event) -> None:
        """Something to say."""

    def close(self) -> None:
        """The end."""


@dataclass(frozen=True)
class Plan:
    """What a session is to do.

    Attributes:
        options: of the calibration. calibration: to be watched instead; None: calibrate.
        arm: for joint angles. guide: the procedure to be shown.
        stop: whether to end when it is enough.
        idle_s: end after so long without a sample [s]; None: never.
        seconds: end after so long of the stream [s]; None: never.
        alarms_a_day: false ones, on average. learn_s: how long the monitor learns the noise's memory [s].
    """

    options: Options = field(default_factory=Options)
    calibration: Calibration | None = None
    arm: Arm | None = None
    guide: Guide | None = None
    stop: bool = True
    idle_s: float | None = None
    seconds: float | None = None
    alarms_a_day: float = 1.0
    learn_s: float = 60.0


class Session:
    """A stream being calibrated, or watched.

    Attributes:
        events: the last ones.
        enough: whether it ended because it was enough.
        samples: so far. t_s: of the last one.
        states: of each sensor; none while a given calibration is watched.
        watch: the monitor; None while nothing is told.
    """

    def __init__(self, feed: Feed, path: Path, plan: Plan, displays: Sequence[Display] = ()) -> None:
        """Args:
        feed: of samples.
        path: the recording to be made.
        plan: what to do.
        displays: that show it.
        """
        self.feed, self.plan = feed, plan
        self.path = path
        self.events: deque[Event] = deque(maxlen=_EVENTS)
        self.enough = False
        self.samples = 0
        self.calibrator: Calibrator | None = None
        self.watch: Watch | None = None
        self.journal: Journal | None = None
        self.states: tuple[SensorState, ...] = ()
        self._displays = tuple(displays)
        self._straight = StraightPoses()
        self._begun_s = np.nan
        self.t_s = np.nan
        self._next = float(_FIRST)
        self._at = 0.0
        self._took = 0.0
        self._ruled_at = -np.inf
        self._since: float | None = None
        self._stale = False

    def resume(self) -> None:
        """Take up what an earlier session has left on disk.

        Raises:
            RigError: there is nothing to resume.
        """
        csv = self.path.with_suffix(".csv")
        cut = mended(csv)
        scan = scan_recording(csv, joints=None if self.plan.arm is None else self.plan.arm.dof)
        self.journal = Journal(self.path, scan.metadata, resumed=True)
        for batch in scan:
            self._take(batch, recorded=True)
            self.journal.total += len(batch)
        self.feed.clock.last = self.t_s
        lost = f", {cut} bytes of a broken last line were cut" if cut else ""
        self._say(f"resumed with {self.samples:,} samples up to {self.t_s:.2f} s{lost}")

    def run(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """Until it is enough, the source ends, nothing comes any more, or ``stopped``.

        Raises:
            RigError: the stream makes no recording, or the disk is full. What came before is on disk.
        """
        quiet_since = time.monotonic()
        while not stopped():
            batch = self.feed.next(TICK_S)
            for words in self.feed.words():
                self._say(words)
            if batch is not None:
                self._take(batch)
                quiet_since = time.monotonic()
                if len(batch) < _FEW:
                    time.sleep(_GATHERED_S)
            else:
                self._idle()
            if self.enough or self.feed.ended or (self.plan.seconds is not None and self.seconds >= self.plan.seconds):
                return
            if self.plan.idle_s is not None and time.monotonic() - quiet_since > self.plan.idle_s:
                self._say(f"nothing has come for {self.plan.idle_s:g} s")
                return

    def close(self) -> Path | None:
        """Show the last state, close the journal and the source; the recording, or None without a sample."""
        self.feed.close()
        if self.samples:
            self._estimate(shown=True)
        for display in self._displays:
            display.close()
        return None if self.journal is None else self.journal.close()

    @property
    def seconds(self) -> float:
        """Of the stream so far [s]."""
        return self.t_s - self._begun_s

    @property
    def forgotten_s(self) -> float:
        """As of ``Calibrator``."""
        return -np.inf if self.calibrator is None else self.calibrator.forgotten_s

    @property
    def alarms(self) -> list[Alarm]:
        """All changes that the monitor has seen, with their names as far as they are known."""
        return [] if self.watch is None else self.watch.alarms

    @property
    def rate_Hz(self) -> float:
        """Of the stream; NaN where it is not known."""
        period = self.feed.clock.period
        return np.nan if not period else 1.0 / period

    @property
    def left_out(self) -> int:
        """Lines and samples that were left out."""
        return self.feed.reader.broken + self.feed.clock.left_out

    @property
    def guidance(self) -> str:
        """What the procedure says now; empty without one."""
        if self.plan.guide is None:
            return ""
        seen = self._ups()
        return self.plan.guide.words(np.empty((0, 3)) if seen is None else seen)

    def _say(self, words: str, alarm_s: float | None = None) -> None:
        event = Event(self.t_s if alarm_s is None else alarm_s, words, alarm_s is not None)
        self.events.append(event)
        for display in self._displays:
            display.event(event)

    def _take(self, batch: Recording, recorded: bool = False) -> None:
        if self.calibrator is None and self.watch is None:
            self._begin(batch)
        first = 0
        while first < len(batch):
            room = max(int(self._next) - self.samples, 1)
            part = batch if first == 0 and len(batch) <= room else batch.select(slice(first, first + room))
            first += len(part)
            if not recorded:
                assert self.journal is not None
                self.journal.write(part)
            self._add(part)
            if self.samples >= self._next:
                self._estimate()
                growth = _GROWTH if self.samples < _MANY else _LATER_GROWTH
                self._next = max(self._next * growth, self._next + _FIRST)
                if self.enough:
                    return
        self._stale = True
        self._idle()

    def _begin(self, batch: Recording) -> None:
        plan = self.plan
        self._begun_s = float(batch.t[0])
        if self.journal is None:
            self.journal = Journal(self.path, batch.metadata)
        if plan.calibration is None:
            self.calibrator = Calibrator(batch, plan.options, plan.arm)
            arm = self.calibrator.arm
            self._warn_of_guide()
        else:
            arm = plan.arm
        self.watch = Watch.of(batch, plan.calibration, arm, plan.alarms_a_day, plan.learn_s)

    def _warn_of_guide(self) -> None:
        guide, calibrator = self.plan.guide, self.calibrator
        if guide is None or calibrator is None:
            return
        if calibrator.posed:
            self._say("the poses are recorded: the procedure is shown, but the arm's own sweep decides")
        lacking = guide.procedure.lacking(calibrator.options.parameters)
        if lacking is not None and ACCELEROMETER in calibrator.sensors and not calibrator.posed:
            self._say(lacking)

    def _add(self, part: Recording) -> None:
        for display in self._displays:
            display.samples(part)
        self.t_s = float(part.t[-1])
        self.samples += len(part)
        told, known = self._straight.words, self._straight(part)
        if self._straight.words != told:
            self._say(self._straight.words)
        if known is None:
            return
        if self.calibrator is not None:
            self.calibrator.add(known)
        if self.watch is not None:
            for alarm in self.watch.add(known):
                self._say(str(alarm), alarm.t_s)

    def _idle(self) -> None:
        """Bring the estimates up to date if there is something new and time for it."""
        now = time.monotonic()
        if self._stale and now - self._at >= max(_ESTIMATE_S, self._took / _SHARE):
            self._estimate()

    def _estimate(self, shown: bool = False) -> None:
        begun, used = time.monotonic(), time.thread_time()
        if self.calibrator is not None:
            self._ask(begun - self._ruled_at >= _RULE_S or shown or self.samples >= self._next, whole=shown)
            if self.watch is not None:
                self.watch.refer({state.sensor: state.estimate for state in self.states if state.estimate is not None})
            self._see()
            self._decide()
        self._stale = False
        self._at = time.monotonic()
        for display in self._displays:
            display.show(self)
        self._took += _RECENT * (time.thread_time() - used - self._took)

    def _ask(self, ruled: bool, whole: bool) -> None:
        """Bring the states up to date; ``ruled``: with the stop rule, ``whole``: by a fit of all samples."""
        assert self.calibrator is not None
        calibrator, last = self.calibrator, {} if ruled else {state.sensor: state for state in self.states}
        self.states = tuple(calibrator.state(sensor, last.get(sensor), whole) for sensor in calibrator.sensors)
        if ruled:
            self._ruled_at = time.monotonic()

    def _decide(self) -> None:
        if not self.states or not all(state.enough for state in self.states):
            self._since = None
            return
        if self._since is None:
            self._since = self.t_s
        if self.plan.stop and not self.enough and self.t_s - self._since >= _HOLD_S:
            self.enough = True
            self._say("enough: every interval is as narrow as was asked for")

    def _see(self) -> None:
        guide, seen = self.plan.guide, self._ups()
        if guide is not None and seen is not None:
            guide.see(seen)

    def _ups(self) -> Array | None:
        state = next((s for s in self.states if s.estimate is not None and s.rule is not None), None)
        if state is None or self.calibrator is None or state.estimate is None:
            return None
        return self.calibrator.up(state.sensor, state.estimate.directions)


def check_resumable(path: Path) -> None:
    """Refuse to resume what is not there.

    Raises:
        RigError: no journal, or it was closed already.
    """
    csv = path.with_suffix(".csv")
    if not csv.is_file():
        closed = f" ({path} was closed already)" if path.is_file() else ""
        raise RigError(f"--resume: {csv}: no such file{closed}, expected what an interrupted session has left")
