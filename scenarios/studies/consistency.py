"""Is the estimator consistent? Estimates against the number of samples, for thousands of draws of the noise.

Renk et al. look at one draw (Figures 3 and 4) and see "the possibility of a slight inconsistency". Errors at n and at
m > n samples of one growing data set are correlated by sqrt(n / m): one draw that is off stays off, and shows nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from estimators.batch import fit_many
from estimators.known_angle.model import METHODS
from estimators.known_angle.reported import NORMAL_95
from rig.arrays import Array, Mask
from rig.progress import Progress, unheard
from rig.threads import one_blas_thread
from scenarios.studies.coordinates import Coordinates, coordinate_names
from scenarios.studies.settings import Settings, expected, increments
from scenarios.studies.store import StudyFolder
from scenarios.workers import Workers

#: Every coordinate of either method, as columns of the table.
COORDINATES: Final = tuple(dict.fromkeys(name for method in METHODS for name in coordinate_names(method)))
_LABEL: Final = pa.dictionary(pa.int8(), pa.string())


def trial(settings: Settings, number: int) -> pa.Table:
    """One block of draws in one order: the errors of every fit, a row a fit.

    Columns: sensor, method, order, noise_factor, count, draw; told: False where a calibration would be refused;
    error_NAME: estimate minus truth of every coordinate; covered_NAME: whether the fit's own 95 % interval holds the
    truth. Coordinates that a method does not have are null.
    """
    order, block = settings.place(number)
    poses = expected(settings)
    sums = increments(settings, order, block)
    start = block * settings.block
    draws = min(settings.block, settings.draws - start)
    seeds = settings.seeds(order, block).spawn(1 + len(sums) * len(settings.noise_factors))[1:]
    parts: list[pa.Table] = []
    with one_blas_thread():
        for position, (sensor, base) in enumerate(sums.items()):
            truth = poses.truth[sensor]
            drawn = []
            for level, factor in enumerate(settings.noise_factors):
                rng = np.random.default_rng(seeds[position * len(settings.noise_factors) + level])
                drawn.append(base.draw(rng, factor * poses.noise[sensor], draws))
            cross, square = (np.concatenate([pair[part] for pair in drawn], axis=1) for part in (0, 1))
            levels = np.repeat(settings.noise_factors, draws)
            for method in settings.methods:
                coordinates = Coordinates(truth, method)
                for index, count in enumerate(settings.counts):
                    fits = fit_many(
                        base.gram[index],
                        cross[index],
                        square[index],
                        count,
                        levels[:, None] * poses.noise[sensor],
                        method,
                        reference_magnitude=truth.reference_magnitude,
                        field_points=truth.fields[0],
                    )
                    errors = coordinates.errors(fits.parameters)
                    with np.errstate(invalid="ignore"):
                        covered = np.abs(errors) <= NORMAL_95 * coordinates.standard_deviations(fits)
                    labels = (sensor, method, order, count)
                    number_of = np.tile(np.arange(start, start + draws), len(drawn))
                    parts.append(_rows(labels, levels, number_of, fits.told, coordinates.names, errors, covered))
    return pa.concat_tables(parts).unify_dictionaries()


def _rows(
    labels: tuple[str, str, str, int],
    levels: Array,
    draw: NDArray[np.int_],
    told: Mask,
    names: Sequence[str],
    errors: Array,
    covered: Mask,
) -> pa.Table:
    sensor, method, order, count = labels
    m = len(draw)
    columns: dict[str, pa.Array] = {
        "sensor": pa.array([sensor] * m, _LABEL),
        "method": pa.array([method] * m, _LABEL),
        "order": pa.array([order] * m, _LABEL),
        "noise_factor": pa.array(levels),
        "count": pa.array(np.full(m, count, dtype=np.int32)),
        "draw": pa.array(draw.astype(np.int32)),
        "told": pa.array(told),
    }
    for name in COORDINATES:
        there = name in names
        values = errors[:, names.index(name)].astype(np.float32) if there else None
        columns[f"error_{name}"] = pa.nulls(m, pa.float32()) if values is None else pa.array(values)
        columns[f"covered_{name}"] = pa.array(covered[:, names.index(name)]) if there else pa.nulls(m, pa.bool_())
    return pa.table(columns)


def run(
    settings: Settings,
    folder: StudyFolder,
    workers: Workers | None = None,
    progress: Progress = unheard,
) -> pa.Table:
    """Make all trials that the folder does not hold yet, and merge them.

    Args:
        settings: of the study; the folder keeps them.
        folder: holds what is done; a study that was ended in the middle goes on.
        workers: where; local processes by default.
        progress: called with the share done, 0 to 1.

    Returns:
        The table of ``trial``, ordered by trial, whoever made them.

    Raises:
        RigError: as of ``Workers.completed`` and ``StudyFolder``.
    """
    return folder.fill(trial, settings, settings.trials, workers or Workers(), progress)
