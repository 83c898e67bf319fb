"""Interleaved subsets of one recording: what scatters from one to the next is noise, what they share is systematic.

Renk et al., Tables 7 and 12, take every 25th sample 25 times over and fit each subset. Neighbouring samples see nearly
the same pose, so whatever the model misses, as long as it depends on the pose or on time, is the same in all subsets:
it is in the fit error, but not in the scatter of the estimates. The scatter beside the Cramer-Rao bound thus tells the
noise-like part of the fit error from the systematic one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import reduce
from operator import add
from typing import Final

import numpy as np

from estimators.known_angle.from_recording import Summed, summarise
from estimators.known_angle.model import Method
from estimators.known_angle.statistics import Statistics
from rig.arm import Arm
from rig.arrays import Array
from rig.errors import RigError
from rig.progress import unheard
from rig.recording import Recording, RecordingScan
from rig.threads import one_blas_thread
from scenarios.studies.subset_results import (
    FieldAgreement,
    FloorSource,
    SubsetChannel,
    SubsetParameter,
    SubsetStudy,
)
from scenarios.studies.subset_sensor import SubsetsOfSensor

#: The fewest samples of a subset: some more than the 18 parameters of a separate fit.
_FEWEST: Final = 24


def study(
    source: Recording | RecordingScan,
    subsets: int = 25,
    *,
    method: Method = "simultaneous",
    noise: Callable[[str, str], Array | None] = lambda sensor, unit: None,
    noise_source: FloorSource = "residuals",
    arm: Arm | None = None,
    progress: Callable[[int], None] = unheard,
) -> SubsetStudy:
    """Fit every k-th sample, k times over.

    Args:
        source: a recording that knows its attitude; a scan is read once, in constant memory.
        subsets: k; 25 in the paper.
        method: of the parameters that are listed; the split of the fit error always rests on separate fits.
        noise: sensor, recorded unit -> the floor of its channels (3,) [recorded unit], or None.
        noise_source: where that comes from.
        arm, progress: as of ``estimators.calibrate``.

    Raises:
        RigError: fewer than two subsets, too few samples in each, or as of ``estimators.calibrate``.
        RefusedFit: the whole recording cannot be calibrated.
    """
    if subsets < 2:
        raise RigError(f"subsets: found {subsets}, expected 2 or more")
    rows = len(source) if isinstance(source, Recording) else source.rows
    if rows is not None and rows < subsets:  # before the memory for each of them is asked for
        raise _too_few(source.name, rows, subsets)
    summed, parts = _interleaved(source, subsets, arm, progress)
    if summed.statistics.count < subsets * _FEWEST:
        raise RigError(
            f"{summed.where}: found {summed.statistics.count} samples for {subsets} subsets, expected at least"
            f" {_FEWEST} each"
        )
    parameters: list[SubsetParameter] = []
    channels: list[SubsetChannel] = []
    agreements: list[FieldAgreement] = []
    estimates: list[Array] = []
    known = False
    with one_blas_thread():
        for position, sensor in enumerate(source.sensors):
            columns = slice(3 * position, 3 * position + 3)
            unit = summed.units[sensor]
            floor = noise(sensor, unit)
            known = known or floor is not None
            one = SubsetsOfSensor(
                sensor,
                unit,
                summed.metadata.stated_field_unit(sensor),
                summed.metadata.magnitude(sensor),
                summed.where,
                summed.statistics.select(columns),
                [part.select(columns) for part in parts],
                floor,
            )
            listed, values = one.parameters(method)
            parameters += listed
            estimates.append(values)
            levels = one.noise_like()
            channels += one.channels(levels)
            agreements.append(one.agreement(levels))
    return SubsetStudy(
        source.name,
        summed.statistics.count,
        subsets,
        method,
        noise_source if known else "residuals",
        tuple(parameters),
        tuple(channels),
        tuple(agreements),
        np.concatenate(estimates),
    )


def _interleaved(
    source: Recording | RecordingScan, subsets: int, arm: Arm | None, progress: Callable[[int], None]
) -> tuple[Summed, list[Statistics]]:
    """One pass: the statistics of all samples, and of every k-th."""
    batches: Iterable[Recording] = (source,) if isinstance(source, Recording) else source
    parts: dict[int, Statistics] = {}
    found: Summed | None = None
    row = 0
    for batch in batches:
        for number in range(subsets):
            first = (number - row) % subsets
            if first >= len(batch):
                continue
            own = batch.select(slice(first, None, subsets))
            summed = summarise(own, source.sensors, arm)
            found = found or summed
            parts[number] = parts[number] + summed.statistics if number in parts else summed.statistics
        row += len(batch)
        progress(len(batch))
    if found is None or len(parts) < subsets:
        raise _too_few(source.name, row, subsets)
    each = [parts[number] for number in range(subsets)]
    return Summed(reduce(add, each), found.units, source.metadata, found.arm, found.where), each


def _too_few(name: str, rows: int, subsets: int) -> RigError:
    return RigError(f"{name}: found {rows} samples, expected at least {_FEWEST} for each of {subsets} subsets")
