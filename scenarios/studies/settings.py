"""What a consistency study studies, and what every trial of it needs: poses, readings without noise, statistics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Literal, Self

import numpy as np
from scipy.stats.qmc import Halton

from estimators.known_angle.model import METHODS, Method, SensorParameters
from rig.arrays import Array, Rows
from rig.channels import ACCELEROMETER, COLUMNS_OF, MAGNETOMETER
from rig.effects import Kind
from rig.errors import RigError, check_name, unknown_name
from rig.memory import check_fits
from scenarios.bound import noise_of
from scenarios.loader import from_toml
from scenarios.scenario import Scenario
from scenarios.studies.increments import Increments

#: In which order the samples of a maneuver are taken, as their number grows.
Order = Literal["first", "every-kth", "random"]
ORDERS: Final[tuple[Order, ...]] = ("first", "every-kth", "random")
#: Blocks are made so that there are as many random orders as this, from whose scatter their intervals come; but large
#: enough to be fitted together quickly.
_ORDERS_DRAWN: Final = 20
_SMALLEST_BLOCK, _LARGEST_BLOCK = 5, 100
#: Of the table that a study ends with: a fit of each of two sensors, of some 20 coordinates.
_BYTES_A_ROW: Final = 200
#: The fewest samples: some more than the 18 parameters of a separate fit.
_FEWEST: Final = 24


@dataclass(frozen=True)
class Settings:
    """What is studied.

    Attributes:
        scenario: its TOML text; whatever a worker needs to know.
        name: of the scenario.
        counts: numbers of samples, growing.
        noise_factors: the scenario's white noise times these.
        methods, orders: of ``estimators.known_angle.model.METHODS`` and ``ORDERS``.
        draws: of the noise, for each of these.
        block: draws that one trial makes; the random order is drawn anew for each block.
        seed: of everything random.

    Raises:
        RigError: a value out of its range, or an unknown name.
    """

    scenario: str
    name: str
    counts: tuple[int, ...]
    noise_factors: tuple[float, ...] = (1.0, 10.0)
    methods: tuple[Method, ...] = ("separate", "simultaneous")
    orders: tuple[Order, ...] = ORDERS
    draws: int = 2000
    block: int = 100
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("draws", "block"):
            if getattr(self, name) < 1:
                raise RigError(f"{name}: found {getattr(self, name)}, expected 1 or more")
        if not self.counts or self.counts[0] < _FEWEST or any(np.diff(self.counts) <= 0):
            raise RigError(f"counts: found {self.counts}, expected growing numbers of samples from {_FEWEST}")
        if not self.noise_factors or min(self.noise_factors) <= 0 or not np.isfinite(self.noise_factors).all():
            raise RigError(f"noise factors: found {', '.join(map(str, self.noise_factors))}, expected positive numbers")
        for given, choices, what in ((self.methods, METHODS, "method"), (self.orders, ORDERS, "order")):
            if not given:
                raise RigError(f"{what}: found none, expected at least one of {', '.join(choices)}")
            for item in given:
                check_name(what, item, choices)
        rows = self.draws * len(self.counts) * len(self.noise_factors) * len(self.methods) * len(self.orders)
        check_fits(float(rows) * _BYTES_A_ROW, f"draws: {self.draws} with {len(self.counts)} counts, {rows:.6g} fits")
        for name in ("noise_factors", "methods", "orders"):
            values = getattr(self, name)
            if len(set(values)) < len(values):
                raise RigError(f"{name.replace('_', ' ')}: found {', '.join(map(str, values))}, expected each once")

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        counts: int | Sequence[int] = 25,
        *,
        first: int = 100,
        noise_factors: Sequence[float] = (1.0, 10.0),
        methods: Sequence[Method] = ("separate", "simultaneous"),
        orders: Sequence[Order] = ORDERS,
        draws: int = 2000,
        seed: int = 0,
    ) -> Self:
        """The settings for a scenario.

        Args:
            scenario: with an arm or known poses, and with effects that move the mean at most.
            counts: how many numbers of samples, evenly spaced on a logarithmic scale; or these numbers themselves.
            first: the smallest of them. The largest is all samples of the scenario.
            noise_factors, methods, orders, draws, seed: as of ``Settings``.

        Raises:
            RigError: as of ``Settings``, the scenario does not suit, or more samples than it has.
        """
        for effect in scenario.rig.effects:
            if effect.kind is not Kind.MEAN:
                raise RigError(
                    f"scenario {scenario.name}: effect {effect.name} changes the {effect.kind.value}, expected white"
                    " noise and effects that change the mean: a consistency study draws no samples"
                )
        text = scenario.to_toml()
        samples = len(_expected(text, scenario.name).rotations)
        if isinstance(counts, int):
            if not 2 <= counts <= samples or first >= samples:
                raise RigError(
                    f"counts: found {counts} from {first} samples, expected two or more, from fewer than the"
                    f" {samples} that the scenario has, and not more than these"
                )
            numbers = np.unique(np.round(np.geomspace(first, samples, counts)).astype(int)).tolist()
        else:
            numbers = [int(count) for count in counts]
            if max(numbers, default=0) > samples:
                raise RigError(f"counts: found {max(numbers)} samples, expected at most the scenario's {samples}")
        return cls(
            text,
            scenario.name,
            tuple(numbers),
            tuple(float(factor) for factor in noise_factors),
            tuple(methods),
            tuple(orders),
            draws,
            min(max(draws // _ORDERS_DRAWN, _SMALLEST_BLOCK), _LARGEST_BLOCK, draws),
            seed,
        )

    @property
    def blocks(self) -> int:
        """Blocks of draws of every order."""
        return -(-self.draws // self.block)

    @property
    def trials(self) -> int:
        """The number of trials."""
        return len(self.orders) * self.blocks

    def place(self, number: int) -> tuple[Order, int]:
        """The order and the block of draws that a trial stands for."""
        return self.orders[number // self.blocks], number % self.blocks

    def seeds(self, order: Order, block: int) -> np.random.SeedSequence:
        """The seeds of a block: the same whatever else is studied, and wherever it runs."""
        return np.random.SeedSequence(self.seed).spawn(len(ORDERS))[ORDERS.index(order)].spawn(block + 1)[block]


@dataclass(frozen=True, eq=False)
class Expected:
    """A scenario's poses and readings without noise.

    Attributes:
        rotations: (n, 9) vec R_base_tool by rows, as recorded.
        readings: sensor -> (n, 3) [recorded unit].
        truth: sensor -> its parameters.
        noise: sensor -> (3,) standard deviation of the white noise, and of the converter's rounding, together.
        units: sensor -> the units of its readings and of the field.
    """

    rotations: Array
    readings: dict[str, Array]
    truth: dict[str, SensorParameters]
    noise: dict[str, Array]
    units: dict[str, tuple[str, str | None]]


@lru_cache(maxsize=2)
def _expected(text: str, name: str) -> Expected:
    scenario = from_toml(text, f"{name}.toml")
    recording = scenario.with_acquisition(noise_V=(0.0,) * 6, range_V=None, bits=None).simulate(0)
    if recording.q is None and recording.tool_quaternion is None:
        raise RigError(f"scenario {name}: records no pose, expected joint angles or tool poses")
    environment, sigma = scenario.rig.environment, noise_of(scenario)
    truth = {name: SensorParameters.of(axes, environment.field(name)) for name, axes in scenario.truth.sensors.items()}
    readings = {sensor: recording.readings(sensor) for sensor in truth}
    noise = {sensor: sigma[COLUMNS_OF[sensor]] for sensor in truth}
    fields = {ACCELEROMETER: "m_s2", MAGNETOMETER: scenario.magnetic_field_unit}
    units = {sensor: (scenario.rig.acquisition.unit_of[sensor], fields[sensor]) for sensor in truth}
    return Expected(recording.rotations(scenario.rig.arm), readings, truth, noise, units)


def expected(settings: Settings) -> Expected:
    """Poses and readings without noise; made once a process."""
    return _expected(settings.scenario, settings.name)


@lru_cache(maxsize=64)
def increments(settings: Settings, order: Order, block: int) -> dict[str, Increments]:
    """Sensor -> the statistics that the draws of a block add noise to; only the random order differs by block."""
    poses = expected(settings)
    if order != "random" and block > 0:
        return increments(settings, order, 0)
    rng = np.random.default_rng(settings.seeds(order, block).spawn(1)[0])
    rows = order_of(order, len(poses.rotations), rng)
    return {
        sensor: Increments.of(poses.rotations, readings, rows, settings.counts)
        for sensor, readings in poses.readings.items()
    }


def order_of(order: Order, count: int, rng: np.random.Generator) -> Rows:
    """Row numbers (count,), each once: the first n of them are the n samples that are taken.

    Args:
        order: "first": as recorded, so that n samples are the maneuver's beginning (Renk et al., Figures 3 and 4).
            "every-kth": samples spread evenly over the whole maneuver. They are nested: every 64th, say, then those in
            the middle between, and so on, so that n = count / 2^m samples are exactly every (2^m)th (van der Corput).
            "random": without replacement.
        count: number of samples.
        rng: of "random".

    Raises:
        RigError: another order.
    """
    if order == "first":
        return np.arange(count)
    if order == "every-kth":
        return np.argsort(Halton(1, scramble=False).random(count).ravel())
    if order == "random":
        return rng.permutation(count)
    raise unknown_name("order", order, ORDERS)
