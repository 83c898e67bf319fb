"""From the errors of all draws to bias, RMSE, coverage and rate, each with its interval."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any, Final, Self

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from scipy.stats import t

from estimators.known_angle.model import Method, columns_of_channels
from rig.arrays import Array, Mask
from rig.units import parameter_unit
from scenarios.studies.coordinates import Coordinates
from scenarios.studies.intervals import LEVEL, clopper_pearson, spread_interval
from scenarios.studies.settings import Expected, Order, Settings, expected, increments
from scenarios.studies.table_files import rows_of

#: The file of the rates in a study's folder; the cells are its summary.
RATES: Final = "rates.parquet"
#: A bound is small where that of every parameter of the same fit is below this share of its value (of S, delta) or of
#: a radian: there the model is linear within the errors.
SMALL_BOUND: Final = 0.05


@dataclass(frozen=True)
class Cell:
    """One coordinate at one number of samples.

    Attributes:
        sensor, method, order, noise_factor, count, parameter: which.
        unit: of what follows. truth: the value to be found.
        draws: number of data sets. told: share for which a calibration would not be refused.
        bound: root of the Cramer-Rao bound. largest_bound: that of the fit's least certain parameter, as a share of its
            value or of a radian.
        bias, bias_std: mean error and its standard error.
        bias_expected: what the curvature of the model lets expect (Box, 1971).
        rmse: root mean square error.
        ratio, ratio_low, ratio_high: RMSE over bound with its interval, by chi-square.
        coverage, coverage_low, coverage_high: share of the fits' own 95 % intervals that hold the truth, with its
            interval (Clopper-Pearson).
    """

    sensor: str
    method: Method
    order: Order
    noise_factor: float
    count: int
    parameter: str
    unit: str
    truth: float
    draws: int
    told: float
    bound: float
    largest_bound: float
    bias: float
    bias_std: float
    bias_expected: float
    rmse: float
    ratio: float
    ratio_low: float
    ratio_high: float
    coverage: float
    coverage_low: float
    coverage_high: float

    @property
    def small(self) -> bool:
        """Whether the errors are small enough for the model to be linear within them."""
        return self.largest_bound < SMALL_BOUND


@dataclass(frozen=True)
class Rate:
    """How one coordinate's RMSE falls with the number of samples: the slope of log RMSE over log n.

    Attributes:
        sensor, method, order, noise_factor, parameter: which.
        counts: how many numbers of samples it is taken over: those where the bound is small.
        slope, slope_low, slope_high: with its interval (Student). Errors of one data set at several n are correlated;
            the interval comes from the scatter of each draw's share in the slope, and of each random order's.
        slope_std, units: standard error of the slope, and from how many draws or random orders it comes.
        bound_slope: the same of the bound.
    """

    sensor: str
    method: Method
    order: Order
    noise_factor: float
    parameter: str
    counts: int
    slope: float
    slope_low: float
    slope_high: float
    slope_std: float
    units: int
    bound_slope: float


@dataclass(frozen=True)
class Summary:
    """What a consistency study says.

    Attributes:
        cells: one for each coordinate, count, noise level, order and method. rates: one for each of these but the
            count.
    """

    cells: tuple[Cell, ...]
    rates: tuple[Rate, ...]

    @classmethod
    def of(cls, settings: Settings, table: pa.Table) -> Self:
        """Summarise the table of ``consistency.run``."""
        poses = expected(settings)
        cells: list[Cell] = []
        rates: list[Rate] = []
        for group in _groups(settings, poses, table):
            cells += group.cells()
            rates += group.rates()
        return cls(tuple(cells), tuple(rates))

    def some_counts(self, number: int) -> set[int]:
        """So many numbers of samples, from the smallest to the largest."""
        counts = sorted({cell.count for cell in self.cells})
        return {counts[round(k * (len(counts) - 1) / (number - 1))] for k in range(number)}

    def tables(self) -> tuple[pa.Table, pa.Table]:
        """The cells and the rates as tables, one row each."""
        return _table(Cell, self.cells), _table(Rate, self.rates)

    @classmethod
    def from_tables(cls, cells: pa.Table, rates: pa.Table) -> Self:
        """Back from ``tables``; RigError where they are no such tables."""
        return cls(tuple(rows_of(Cell, cells)), tuple(rows_of(Rate, rates)) if rates.num_rows else ())


def _table(kind: type, rows: tuple[Any, ...]) -> pa.Table:
    names = [field.name for field in fields(kind)]
    return pa.table({name: [getattr(row, name) for row in rows] for name in names})


@dataclass(frozen=True, eq=False)
class _Group:
    """All draws of one sensor by one method, in one order, at one noise level.

    Attributes:
        sensor, method, order, noise_factor: which.
        units: of the readings and of the field, as recorded.
        coordinates: about the truth. counts: (c,).
        errors: (c, m, p). covered: (c, m, p). told: (c, m).
        block: (m,) the block of each draw.
        bounds: (b, c, p) root of the bound, for each block. bias: (b, c, p) expected.
    """

    sensor: str
    method: Method
    order: Order
    noise_factor: float
    units: tuple[str, str | None]
    coordinates: Coordinates
    counts: Array
    errors: Array
    covered: Mask
    told: Mask
    block: NDArray[np.int_]
    bounds: Array
    bias: Array

    def cells(self) -> list[Cell]:
        m = self.errors.shape[1]
        with np.errstate(invalid="ignore", divide="ignore"):
            scaled = np.square(self.errors / self.bounds[self.block].swapaxes(0, 1))
            ratio = np.sqrt(scaled.mean(axis=1))
        low, high = spread_interval(m)
        bound = np.sqrt(np.square(self.bounds).mean(axis=0))
        inside = self.covered.sum(axis=1)
        inside_low, inside_high = clopper_pearson(inside, m)
        numbers = {
            "bound": bound,
            "largest_bound": self._largest(bound),
            "bias": self.errors.mean(axis=1),
            "bias_std": self.errors.std(axis=1, ddof=1) / np.sqrt(m),
            "bias_expected": self._over_blocks(self.bias),
            "rmse": np.sqrt(np.square(self.errors).mean(axis=1)),
            "ratio": ratio,
            "ratio_low": low * ratio,
            "ratio_high": high * ratio,
            "coverage": inside / m,
            "coverage_low": inside_low,
            "coverage_high": inside_high,
        }
        found = []
        for c, count in enumerate(self.counts):
            for p, name in enumerate(self.coordinates.names):
                found.append(
                    Cell(
                        self.sensor,
                        self.method,
                        self.order,
                        self.noise_factor,
                        int(count),
                        name,
                        parameter_unit(name, *self.units),
                        float(self.coordinates.values[p]),
                        m,
                        float(self.told[c].mean()),
                        **{key: float(values[c, p]) for key, values in numbers.items()},
                    )
                )
        return found

    def rates(self) -> list[Rate]:
        bound = np.sqrt(np.square(self.bounds).mean(axis=0))
        largest = self._largest(bound)
        logarithm = np.log(self.counts)
        found = []
        for p, name in enumerate(self.coordinates.names):
            small = largest[:, p] < SMALL_BOUND
            if small.sum() < 3:
                continue
            weight = logarithm[small] - logarithm[small].mean()
            weight /= np.square(weight).sum()
            square = np.square(self.errors[small, :, p])
            mean = square.mean(axis=1)
            slope = float(weight @ (0.5 * np.log(mean)))
            influence = weight @ (0.5 * (square / mean[:, None] - 1.0))
            if self.order == "random":  # draws of a block share their poses
                influence = np.bincount(self.block, influence) / np.bincount(self.block)
            units = len(influence)
            std = float(influence.std(ddof=1) / np.sqrt(units)) if units > 1 else np.inf
            half = float(t.ppf(0.5 * (1.0 + LEVEL), units - 1)) * std if units > 1 else np.inf
            found.append(
                Rate(
                    self.sensor,
                    self.method,
                    self.order,
                    self.noise_factor,
                    name,
                    int(small.sum()),
                    slope,
                    slope - half,
                    slope + half,
                    std,
                    units,
                    float(weight @ np.log(bound[small, p])),
                )
            )
        return found

    def _largest(self, bound: Array) -> Array:
        """(c, p) the largest relative bound among the parameters that one minimisation finds together."""
        share = np.nan_to_num(bound / self.coordinates.sizes, nan=np.inf)
        if self.method == "simultaneous":
            return np.broadcast_to(share.max(axis=1, keepdims=True), share.shape)
        result = np.empty_like(share)
        for _, start, of_field in columns_of_channels(self.method):
            own = slice(start, of_field.stop)
            result[:, own] = share[:, own].max(axis=1, keepdims=True)
        return result

    def _over_blocks(self, values: Array) -> Array:
        """(c, p) the mean over draws of what each block (b, c, p) has."""
        number = np.bincount(self.block, minlength=len(values)) / len(self.block)
        return np.asarray(np.tensordot(number, values, axes=1))


def _groups(settings: Settings, poses: Expected, table: pa.Table) -> Iterator[_Group]:
    counts = np.array(settings.counts, dtype=float)
    for order in settings.orders:
        of_order = table.filter(pc.equal(table["order"], order))
        for sensor, truth in poses.truth.items():
            of_sensor = of_order.filter(pc.equal(of_order["sensor"], sensor))
            for method in settings.methods:
                of_method = of_sensor.filter(pc.equal(of_sensor["method"], method))
                coordinates = Coordinates(truth, method)
                blocks = settings.blocks if order == "random" else 1
                sums = [increments(settings, order, block)[sensor].gram for block in range(blocks)]
                for factor in settings.noise_factors:
                    part = of_method.filter(pc.equal(of_method["noise_factor"], factor))
                    part = part.sort_by([("count", "ascending"), ("draw", "ascending")])
                    shape = (len(counts), settings.draws)
                    noise = factor * poses.noise[sensor]
                    yield _Group(
                        sensor,
                        method,
                        order,
                        factor,
                        poses.units[sensor],
                        coordinates,
                        counts,
                        _stacked(part, "error", coordinates.names, shape).astype(float),
                        _stacked(part, "covered", coordinates.names, shape).astype(bool),
                        part["told"].to_numpy().reshape(shape),
                        np.arange(settings.draws) // settings.block if blocks > 1 else np.zeros(settings.draws, int),
                        np.sqrt([[coordinates.bound(gram, noise).diagonal() for gram in grams] for grams in sums]),
                        np.array([[coordinates.bias(gram, noise) for gram in grams] for grams in sums]),
                    )


def _stacked(part: pa.Table, stem: str, names: tuple[str, ...], shape: tuple[int, int]) -> NDArray[Any]:
    return np.stack([part[f"{stem}_{name}"].to_numpy().reshape(shape) for name in names], axis=2)


def first_draw(errors: pa.Table | None, cells: Sequence[Cell]) -> Array | None:
    """(c,) the errors of the first draw at the counts of cells, ascending, that differ in nothing else.

    Args:
        errors: of a study, or part of them.

    Returns:
        None where they are not all there.
    """
    if errors is None or not cells:
        return None
    cell = cells[0]
    chosen = pc.equal(errors["draw"], 0)
    for column in ("sensor", "method", "order", "noise_factor"):
        chosen = pc.and_(chosen, pc.equal(errors[column], getattr(cell, column)))
    name = f"error_{cell.parameter}"
    part = errors.select(["count", name]).filter(chosen).sort_by("count")
    return np.asarray(part[name].to_numpy(), dtype=float) if part.num_rows == len(cells) else None
