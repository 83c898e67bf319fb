"""What an effect is: one small frozen dataclass, used by the simulator and by the diagnosis alike."""

from __future__ import annotations

import dataclasses
import itertools
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import TYPE_CHECKING, Any, ClassVar, Final, Literal, Self, TypeVar

import numpy as np

from rig.arrays import Array
from rig.channels import CHANNELS, COLUMNS_OF
from rig.effects.parameters import Parameter, Value, choices_of, parameters_of
from rig.effects.readings import ErrorsShown, Finding, Readings
from rig.environment import MAGNITUDES
from rig.errors import RigError, check_name, nearest, unknown_name
from rig.signals import Signals
from rig.units import ELECTRICAL

if TYPE_CHECKING:
    from rig.arm import Arm
    from rig.pipeline import Pipeline


class Stage(IntEnum):
    """Where on its way from encoder angles to volts a reading is changed, in this order."""

    TRANSMISSION = 0  #: q, the true joint angles
    POSE = 1  #: R_base_tool, position, acceleration
    FIELD = 2  #: gravity, magnetic, acceleration
    INPUT = 3  #: inputs: what the axes feel
    VOLTS = 4  #: volts, before sampling
    ELECTRONIC = 5  #: volts, sampled and noisy, before the converter


class Kind(Enum):
    """What an effect changes, hence which test can find it."""

    MEAN = "mean"  #: the expected reading
    NOISE = "noise"  #: the covariance of the readings
    DISTRIBUTION = "distribution"  #: clipping, steps, spikes, repeats


#: Within a stage noise comes before what is done to a noisy reading: a repeat repeats the noise too.
_ORDER: Final = {kind: order for order, kind in enumerate(Kind)}

JOINTS: Final = tuple(f"joint{number}" for number in range(1, 7))
SWEPT_JOINTS: Final = ("joint1", "joint5", "joint6")
LINKS: Final = tuple(f"link{number}" for number in range(1, 6))

_NUMBERED: Final = re.compile(r"(joint|link)([1-9]\d?)")
MOVED_RAD: Final = 1e-3  #: a joint that turns by less is locked

Requirement = Literal["joints", "position", "temperature", "poses", "nodes", "volts"]


@dataclass(frozen=True)
class Effect(ABC):
    """An unmodelled effect at its place.

    Attributes:
        where: the place, one of ``places``; of an effect on joints or links, any number of them.
    """

    name: ClassVar[str]
    stage: ClassVar[Stage]
    kind: ClassVar[Kind] = Kind.MEAN
    #: On the A465 in its sweep; on another arm and maneuver see ``places_on``.
    places: ClassVar[tuple[str, ...]]
    #: Of an effect on joints: True where only a joint that moves can show it.
    needs_motion: ClassVar[bool] = False
    #: True where not the world but the log of its poses errs: the simulator calls ``log``, the diagnosis ``apply``.
    of_log: ClassVar[bool] = False
    #: The sensor that alone can show it, where no place names one.
    of_sensor: ClassVar[str] = ""
    #: True where the sensor moves on the tool: what logs the tool's pose does not see it.
    on_mount: ClassVar[bool] = False
    #: What a recording must have for the effect to act on it.
    requires: ClassVar[tuple[Requirement, ...]] = ()
    #: True where its parameters are those of one recording: a phase, a warm-up, a course in time. In several recordings
    #: it is another one each; a jump is not, as it stays.
    of_recording: ClassVar[bool] = False
    #: True where the effect acts by being there, even with all its strengths at zero.
    acts_at_zero: ClassVar[bool] = False
    #: True where the effect is a sine in time of ``freq_Hz`` and ``phase_rad``. At frequency zero and phase pi/2 it is
    #: the envelope of that tone, so that one Fourier transform searches all frequencies.
    tone: ClassVar[bool] = False
    #: Where a tone lies [Hz], as pairs of bounds; empty: anywhere.
    bands: ClassVar[tuple[tuple[float, float], ...]] = ()

    #: True where the change varies from sample to sample of a sweep, so that means over neighbours hide it.
    rapid: ClassVar[bool] = False
    #: True where the change jumps from one sample to the next, as at a reversal.
    jumps: ClassVar[bool] = False
    #: True where it depends on the samples before or beside a reading, so that these must lie close.
    remembers: ClassVar[bool] = False
    #: Of a noise effect: True where its variance follows time (the slope of the signal), False where it is the same
    #: throughout.
    adds_in_time: ClassVar[bool] = False

    where: str

    def added_spectrum(self, frequency: Array, interval_s: float) -> Array:
        """The spectrum of each error of a noise effect, at strength one: white, unless the effect says otherwise.

        Args:
            frequency: (m,) [cycles a sample], above zero.
            interval_s: between samples [s].

        Returns:
            (m,) such that its mean over all frequencies is the variance; white noise of variance one has one.
        """
        return np.ones_like(frequency)

    def response(self, base: Signals, pipeline: Pipeline) -> Array:
        """What the errors of a noise effect do to the readings, each at size one.

        The effect adds sum_r s_r response[:, :, r] e_r(t): independent errors e_r of ``added_spectrum``, s_r the
        strengths (one for all errors where there is one only). The covariance between readings (t, k) and (u, l) is
        sum_r s_r^2 response[t, k, r] response[u, l, r] c(u - t), c the autocovariance of that spectrum.

        Args:
            base: the recording after all stages of ``pipeline``. pipeline: without effects.

        Returns:
            (n, 6, r) [recorded unit]; by default the error of each channel of the place is its own.
        """
        touched = range(*self.columns.indices(len(CHANNELS)))
        response = np.zeros((len(base), len(CHANNELS), len(touched)))
        for error, column in enumerate(touched):
            response[:, column, error] = 1.0
        return response

    def errors_shown(self, base: Signals) -> ErrorsShown | None:
        """What the recording itself shows of a noise effect's errors; None where it shows nothing, as by default."""
        return None

    def added_variance(self, base: Signals, pipeline: Pipeline) -> Array:
        """(n, 6) [recorded unit^2] variance that a noise effect adds to each reading; of a walk, on average in time."""
        interval_s = float(np.median(np.diff(base.t)))
        count = max(len(base), 2)
        mean = float(np.mean(self.added_spectrum(np.arange(1, count) / (2.0 * count), interval_s)))
        response = self.response(base, pipeline)
        return np.asarray(mean * (response**2 @ np.broadcast_to(self.strengths**2, response.shape[2:])))

    @property
    def strengths(self) -> Array:
        """All strengths, one number each, in the order of the parameters."""
        found = [np.atleast_1d(getattr(self, item.name)) for item in self.parameters() if item.strength]
        return np.concatenate(found) if found else np.ones(1)

    @classmethod
    def examined(cls, readings: Readings, where: str) -> Finding | None:
        """What an effect on single readings shows in them; None where it shows nothing.

        Raises:
            NotImplementedError: the effect is not of the distribution.
        """
        raise NotImplementedError(f"effect {cls.name} does not act on single readings")

    @abstractmethod
    def apply(self, signals: Signals, rng: np.random.Generator) -> Signals:
        """The signals with the effect; the input is left as it is. Neutral strengths change nothing.

        Of an error of the log: from the logged poses to the true ones.
        """

    def log(self, signals: Signals, rng: np.random.Generator) -> Signals:
        """From true poses to logged ones, of an effect ``of_log``.

        Raises:
            NotImplementedError: the effect is none.
        """
        raise NotImplementedError(f"effect {self.name} is not of the log")

    def __post_init__(self) -> None:
        if self.where not in self.places and not self._is_numbered_place():
            raise unknown_name(f"place of effect {self.name}", str(self.where), self.places)
        for name, choices in self.choices().items():
            check_name(f"{name} of effect {self.name}", getattr(self, name), choices)
        for item in self.parameters():
            value = getattr(self, item.name)
            if item.holds(value):
                continue
            try:
                values = np.asarray(value, dtype=float)
            except (TypeError, ValueError):
                values = np.asarray(np.nan)
            shape = () if item.size == 1 else (item.size,)
            if values.shape != shape or not (np.abs(values) <= MAGNITUDES[1]).all():
                count = "a finite number" if item.size == 1 else f"{item.size} finite numbers"
                raise RigError(f"effect {self.name}.{item.name}: found {value!r}, expected {count} [{item.unit}]")
            if (values < item.lower).any() or (values > item.upper).any():
                bounds = f"{item.lower:g} to {item.upper:g} [{item.unit}]"
                raise RigError(f"effect {self.name}.{item.name}: found {value}, expected {bounds}")
            object.__setattr__(self, item.name, float(values) if item.size == 1 else tuple(float(x) for x in values))

    @classmethod
    def numbered(cls) -> str:
        """``"joint"`` or ``"link"`` where the effect's places are those of an arm, else empty."""
        found = _NUMBERED.fullmatch(cls.places[0])
        return found[1] if found else ""

    def _is_numbered_place(self) -> bool:
        found = _NUMBERED.fullmatch(str(self.where))
        return found is not None and found[1] == self.numbered()

    @classmethod
    def places_on(cls, signals: Signals) -> tuple[str, ...]:
        """The places at which the effect can act on a recording: of its arm every joint that turns, or that turns and
        moves; every link but the last, which carries the sensor; else ``places``."""
        kind = cls.numbered()
        if not kind:
            return cls.places
        if signals.q_encoder is None:
            return ()
        count = signals.q_encoder.shape[1]
        if kind == "link":
            return tuple(f"link{number}" for number in range(1, count))
        slides = signals.arm.slides if signals.arm is not None else (False,) * count
        turning = [joint for joint in range(count) if not slides[joint]]
        if cls.needs_motion:
            turning = [joint for joint in turning if np.ptp(signals.q_encoder[:, joint]) > MOVED_RAD]
        return tuple(f"joint{joint + 1}" for joint in turning)

    def misplaced(self, signals: Signals) -> str:
        """Why the place is none of the recording's arm, in words; empty where it is one."""
        if not self.numbered() or signals.q_encoder is None:
            return ""
        return self.misplaced_on(signals.q_encoder.shape[1], signals.arm.slides if signals.arm is not None else ())

    def misplaced_on(self, dof: int, slides: Sequence[bool]) -> str:
        """As ``misplaced``, of an arm with ``dof`` joints, some of which may slide."""
        kind = self.numbered()
        if kind and self.joint >= dof:
            choices = [f"{kind}{number}" for number in range(1, dof + 1)]
            return f"the arm has {dof} joints, expected {kind}1 to {kind}{dof}{nearest(self.where, choices)}"
        if kind == "joint" and self.joint < len(slides) and slides[self.joint]:
            return f"{self.where} slides, expected a joint that turns"
        return ""

    @classmethod
    def parameters(cls) -> tuple[Parameter, ...]:
        """The parameters in the order of the class."""
        return parameters_of(cls)

    @classmethod
    def choices(cls) -> dict[str, tuple[str, ...]]:
        """The fields that are names, each with the names it may be."""
        return dict(choices_of(cls))

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Self:
        """From a table of a scenario or a cause: ``where``, parameters and choices by name.

        Raises:
            RigError: a name the effect does not have, no ``where`` although there are several places, a bad value.
        """
        names = [item.name for item in dataclasses.fields(cls)]
        for key in values:
            if key not in names:
                expected = f"expected {', '.join(names)}{nearest(key, names)}"
                raise RigError(f"effect {cls.name}: unknown key {key!r}, {expected}")
        given = {"where": cls.places[0], **values} if len(cls.places) == 1 else dict(values)
        choices = {"where": cls.places, **cls.choices()}
        for item in dataclasses.fields(cls):
            if item.default is dataclasses.MISSING and item.name not in given:
                raise RigError(
                    f"effect {cls.name}: {item.name!r} is missing, expected one of {', '.join(choices[item.name])}"
                )
        return cls(**given)

    @classmethod
    def lacking(cls, signals: Signals) -> str:
        """What the recording lacks for this effect, in words; empty where it has all."""
        joints = signals.q_encoder is not None
        has = {
            "joints": (joints, "joint angles (columns q1_rad..qN_rad)"),
            "position": (joints or signals.position.size > 0, "the sensor's position (columns tool_x_m..tool_z_m)"),
            "temperature": (signals.temperature is not None, "the temperature (column temperature_degC)"),
            "volts": (signals.electrical, f"readings as the sensors give them ({', '.join(ELECTRICAL)})"),
            "poses": (not joints and signals.R_base_tool.size > 0, "tool poses (columns tool_qw..tool_qz)"),
        }
        if "nodes" in cls.requires:
            words = "tool poses that were interpolated (columns tool_qw..tool_qz, straight between nodes)"
            has["nodes"] = signals.pose_nodes is not None, words
        return " and ".join(has[requirement][1] for requirement in cls.requires if not has[requirement][0])

    @classmethod
    def searched(cls, signals: Signals) -> list[dict[str, Value]]:
        """The shapes to try on a recording: every combination of the grids; one empty table where there is none."""
        grids = {item.name: item.grid for item in cls.parameters() if item.grid}
        return [dict(zip(grids, values, strict=True)) for values in itertools.product(*grids.values())]

    @classmethod
    def ranges(cls, signals: Signals) -> dict[str, tuple[Array, ...]]:
        """Of each shape that is searched on a grid, the values of each of its components, in order."""
        return {item.name: (np.asarray(item.grid, dtype=float),) for item in cls.parameters() if len(item.grid) > 1}

    @classmethod
    def spanning(cls) -> list[dict[str, Value]]:
        """The shapes whose effects together span, to first order, those of all values of the spanned parameters."""
        spans = {item.name: item.spanned for item in cls.parameters() if item.spanned}
        return [dict(zip(spans, values, strict=True)) for values in itertools.product(*spans.values())]

    @property
    def joint(self) -> int:
        """The column of the joint or link that ``where`` names."""
        found = _NUMBERED.fullmatch(self.where)
        if found is None:
            raise ValueError(f"{self.where} is neither a joint nor a link")
        return int(found[2]) - 1

    @property
    def columns(self) -> slice:
        """The channels (columns of ``inputs`` and ``volts``) that ``where`` names; all where it names no sensor."""
        if self.where in CHANNELS:
            column = CHANNELS.index(self.where)
            return slice(column, column + 1)
        return COLUMNS_OF.get(self.where, slice(0, len(CHANNELS)))


EffectClass = TypeVar("EffectClass", bound=type[Effect])

#: Every effect by its name in the catalogue; command line, diagnosis, report and documentation read it.
EFFECTS: dict[str, type[Effect]] = {}


def register(effect: EffectClass) -> EffectClass:
    """Class decorator: enter an effect into the registry."""
    if effect.name in EFFECTS:
        raise ValueError(f"effect {effect.name!r} is registered twice")
    EFFECTS[effect.name] = effect
    return effect


def make_effect(name: str, values: Mapping[str, Any], arm: Arm | None = None) -> Effect:
    """An effect by its name in the catalogue and a table of ``where``, parameters and choices.

    Args:
        name, values: what it is.
        arm: where one is given, ``where`` may be a joint's own name, and must be a place that the arm has.

    Raises:
        RigError: the catalogue has no such effect, or its table is wrong.
    """
    check_name("effect", name, EFFECTS)
    if arm is None:
        return EFFECTS[name].from_mapping(values)
    own = {joint: place for place, joint in arm.place_names.items()}
    where = values.get("where")
    effect = EFFECTS[name].from_mapping(
        {**values, "where": own[where]} if isinstance(where, str) and where in own else values
    )
    if misplaced := effect.misplaced_on(arm.dof, arm.slides):
        raise RigError(f"effect {name} at {effect.where}: {misplaced}")
    return effect


def without_nulls(name: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """An effect's table in which what is null, whole or a component, is what it is by default: neutral for a strength.

    Raises:
        RigError: the catalogue has no such effect.
    """
    check_name("effect", name, EFFECTS)
    defaults = {each.name: each.default for each in dataclasses.fields(EFFECTS[name])}
    found: dict[str, Any] = {}
    for key, value in values.items():
        default = defaults.get(key)
        if isinstance(value, list | tuple) and isinstance(default, tuple) and len(value) == len(default):
            found[key] = tuple(own if each is None else each for each, own in zip(value, default, strict=True))
        elif value is not None:
            found[key] = value
    return found


def apply_stage(effects: Sequence[Effect], stage: Stage, signals: Signals, rng: np.random.Generator) -> Signals:
    """Apply the effects that act on ``stage``: in their order, but noise before what is done to noisy readings, and
    errors of the log before all others, which act on the true poses.

    Raises:
        RigError: the signals lack what an effect needs.
    """
    acting = [effect for effect in effects if effect.stage is stage]
    for effect in sorted(acting, key=lambda each: (not each.of_log, _ORDER[each.kind])):
        if lacking := effect.lacking(signals):
            raise RigError(f"effect {effect.name} at {effect.where}: the recording lacks {lacking}")
        if misplaced := effect.misplaced(signals):
            raise RigError(f"effect {effect.name} at {effect.where}: {misplaced}")
        signals = effect.apply(signals, rng)
    return signals
