"""What a study of interleaved subsets finds, as the files of its folder too."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Final, Literal

import numpy as np
import pyarrow as pa

from estimators.known_angle.model import Method
from rig.arrays import Array
from scenarios.studies.store import SUMMARY, TABLE, StudyFolder
from scenarios.studies.table_files import rows_of

FloorSource = Literal["locked recording", "given", "residuals"]

CHANNELS: Final = "channels.parquet"
FIELDS: Final = "fields.parquet"


@dataclass(frozen=True)
class SubsetParameter:
    """One parameter over all subsets.

    Attributes:
        sensor, parameter, unit: which; angles as in the paper [deg].
        whole: the estimate from all samples.
        mean, std: of the subsets' estimates, the latter with n - 1.
        bound: root of the Cramer-Rao bound of one subset; NaN where the angle cannot be told.
        ratio, ratio_low, ratio_high: std over bound, with its interval by chi-square.
        why: the angle cannot be told, or may scatter less than the bound; else empty.
    """

    sensor: str
    parameter: str
    unit: str
    whole: float
    mean: float
    std: float
    bound: float
    ratio: float
    ratio_low: float
    ratio_high: float
    why: str


@dataclass(frozen=True)
class SubsetChannel:
    """The fit error of one channel, taken apart.

    Attributes:
        channel, unit: which.
        fit_error: RMS residual of the separate fit to all samples.
        floor: noise with the arm locked; NaN where that is not known.
        noise_like, noise_low, noise_high: the white noise that makes estimates scatter as the subsets' do, with its
            interval.
        systematic, systematic_low, systematic_high: the rest of the fit error, root of the difference of squares; zero
            where there is none.
        share, share_low, share_high: of the fit error's square that is noise-like, at most 1.
        p_value: of a scatter as large as this by noise at the floor; NaN without a floor.
    """

    channel: str
    unit: str
    fit_error: float
    floor: float
    noise_like: float
    noise_low: float
    noise_high: float
    systematic: float
    systematic_low: float
    systematic_high: float
    share: float
    share_low: float
    share_high: float
    p_value: float


@dataclass(frozen=True)
class FieldAgreement:
    """Whether three separate fits find one field direction: the paper's check of sensor, data and model, as a test.

    Attributes:
        sensor: which.
        chi_square, degrees_of_freedom, p_value: of the three directions from all samples against a common one, for the
            noise-like part of the fit error.
        apart_deg: the largest angle between two of them [deg]; uncertainty_deg: the largest standard deviation of one.
        disagreeing: subsets whose own three directions disagree at 1 %.
    """

    sensor: str
    chi_square: float
    degrees_of_freedom: int
    p_value: float
    apart_deg: float
    uncertainty_deg: float
    disagreeing: int


@dataclass(frozen=True, eq=False)
class SubsetSettings:
    """What was studied, as a study's folder says it.

    Attributes:
        recording: its name. samples: of it. subsets: their number.
        method: of the parameters. noise_source: of the bound.
    """

    recording: str
    samples: int
    subsets: int
    method: Method
    noise_source: FloorSource


@dataclass(frozen=True, eq=False)
class SubsetStudy(SubsetSettings):
    """What interleaved subsets of a recording say.

    Attributes:
        parameters, channels, agreements: the results.
        estimates: parameter by parameter, as in ``parameters``: (p, subsets).
    """

    parameters: tuple[SubsetParameter, ...]
    channels: tuple[SubsetChannel, ...]
    agreements: tuple[FieldAgreement, ...]
    estimates: Array


def write_subsets(study: SubsetStudy, path: Path) -> StudyFolder:
    """Keep a study: estimates (table), parameters (summary), channels and field directions as Parquet.

    Raises:
        RigError: something else is there, or the folder cannot be written.
    """
    settings = SubsetSettings(*(getattr(study, field.name) for field in fields(SubsetSettings)))
    folder = StudyFolder.begin(path, "subsets", settings)
    rows = study.parameters
    estimates = {
        "sensor": np.repeat([row.sensor for row in rows], study.subsets),
        "parameter": np.repeat([row.parameter for row in rows], study.subsets),
        "subset": np.tile(np.arange(study.subsets, dtype=np.int32), len(rows)),
        "estimate": study.estimates.ravel(),
    }
    folder.write(TABLE, pa.table(estimates))
    for name, items in ((SUMMARY, rows), (CHANNELS, study.channels), (FIELDS, study.agreements)):
        folder.write(name, pa.Table.from_pylist([asdict(item) for item in items]))
    return folder


def read_subsets(folder: StudyFolder) -> SubsetStudy:
    """Back from ``write_subsets``.

    Raises:
        RigError: files are missing, or are not what was written.
    """
    estimates, parameters, channels, agreements = map(folder.table, (TABLE, SUMMARY, CHANNELS, FIELDS))
    return SubsetStudy(
        **folder.settings,
        parameters=tuple(rows_of(SubsetParameter, parameters)),
        channels=tuple(rows_of(SubsetChannel, channels)),
        agreements=tuple(rows_of(FieldAgreement, agreements)) if agreements.num_rows else (),
        estimates=estimates["estimate"].to_numpy().reshape(parameters.num_rows, folder.settings["subsets"]),
    )
