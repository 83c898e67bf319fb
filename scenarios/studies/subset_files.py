"""A subset study as the files of its folder, and back."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rig.errors import RigError
from scenarios.studies.store import SUMMARY, TABLE, StudyFolder
from scenarios.studies.subset_results import FieldAgreement, SubsetChannel, SubsetParameter, SubsetStudy

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
        RigError: files are missing.
    """
    settings = SubsetSettings(**folder.settings)
    tables: list[pa.Table] = []
    for name in (TABLE, SUMMARY, CHANNELS, FIELDS):
        file = folder.path / name
        if not file.is_file():
            raise RigError(f"{file}: is missing, expected a finished study: run it again")
        tables.append(pq.read_table(file))
    estimates, parameters, channels, agreements = tables
    return SubsetStudy(
        settings.recording,
        settings.samples,
        settings.subsets,
        settings.method,  # type: ignore[arg-type]
        settings.noise_source,  # type: ignore[arg-type]
        tuple(_rows(SubsetParameter, parameters)),
        tuple(_rows(SubsetChannel, channels)),
        tuple(_rows(FieldAgreement, agreements)),
        estimates["estimate"].to_numpy().reshape(parameters.num_rows, settings.subsets),
    )


def _rows(kind: Any, table: pa.Table) -> list[Any]:
    names = [field.name for field in fields(kind)]
    return [kind(**{name: row[name] for name in names}) for row in table.to_pylist()]
