"""A subset study as the files of its folder, and back."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa

from scenarios.studies.store import SUMMARY, TABLE, StudyFolder
from scenarios.studies.subset_results import FieldAgreement, SubsetChannel, SubsetParameter, SubsetStudy
from scenarios.studies.table_files import rows_of

CHANNELS: Final = "channels.parquet"
FIELDS: Final = "fields.parquet"


@dataclass(frozen=True)
class SubsetSettings:
    """What a folder says of a subset study.

    Attributes:
        recording: its name. samples, subsets: numbers. method: of the parameters. noise_source: of the bound.
    """

    recording: str
    samples: int
    subsets: int
    method: str
    noise_source: str


def write_subsets(study: SubsetStudy, path: Path) -> StudyFolder:
    """Keep a study: estimates (table), parameters (summary), channels and field directions as Parquet.

    Raises:
        RigError: something else is there, or the folder cannot be written.
    """
    settings = SubsetSettings(study.recording, study.samples, study.subsets, study.method, study.noise_source)
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
    settings = SubsetSettings(**folder.settings)
    estimates, parameters, channels, agreements = map(folder.table, (TABLE, SUMMARY, CHANNELS, FIELDS))
    return SubsetStudy(
        settings.recording,
        settings.samples,
        settings.subsets,
        settings.method,  # type: ignore[arg-type]
        settings.noise_source,  # type: ignore[arg-type]
        tuple(rows_of(SubsetParameter, parameters)),
        tuple(rows_of(SubsetChannel, channels)),
        tuple(rows_of(FieldAgreement, agreements)) if agreements.num_rows else (),
        estimates["estimate"].to_numpy().reshape(parameters.num_rows, settings.subsets),
    )
