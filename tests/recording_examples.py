"""Recordings and refusals that the tests of recordings share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.spatial.transform import Rotation

from rig.errors import RigError
from rig.recording import Metadata, Recording, read_recording, scan_recording

SUFFIXES = (".parquet", ".csv")


def example(n: int = 40, **changes: Any) -> Recording:
    """A recording with everything in it but the tool's pose."""
    rng = np.random.default_rng(20)
    contents: dict[str, Any] = {
        "t": np.arange(n) / 4.0,
        "q": rng.uniform(-2.0, 2.0, (n, 6)),
        "accelerometer": rng.normal(2.5, 1.0, (n, 3)),
        "magnetometer": rng.normal(2.5, 1.0, (n, 3)),
        "temperature": rng.normal(25.0, 1.0, n),
        "currents": {1: rng.normal(size=n), 5: rng.normal(size=n)},
        "supply": rng.normal(5.0, 0.01, n),
        "metadata": Metadata(rate_Hz=4.0, notes="a sweep", extra={"operator": {"name": "Ann"}}),
    }
    return Recording(**{**contents, **changes})


def tumble(n: int = 40, **changes: Any) -> Recording:
    """A recording with tool poses."""
    rng = np.random.default_rng(21)
    turns = Rotation.random(n, rng=rng).as_quat(scalar_first=True)
    return example(n, q=None, tool_quaternion=turns, tool_position=rng.normal(size=(n, 3)), **changes)


def assert_same(found: Recording, expected: Recording) -> None:
    """Bit by bit, the sign of zero included."""
    assert found.columns == expected.columns
    assert found.metadata == expected.metadata
    for name, column in expected.table().items():
        assert found.table()[name].tobytes() == column.tobytes(), name


def write_parquet(path: Path, columns: dict[str, Any], metadata: str | bytes | None = None) -> Path:
    table = pa.table(columns)
    if metadata is not None:
        table = table.replace_schema_metadata({"rig": metadata})
    pq.write_table(table, path)
    return path


def columns_of(recording: Recording) -> dict[str, Any]:
    return dict(recording.table())


def refusal(path: Path, read: Callable[[Path], object] = read_recording) -> str:
    """The one line with which a file is refused; it begins with the file."""
    with pytest.raises(RigError) as caught:
        read(path)
    message = str(caught.value)
    assert caught.value.exit_status == 2
    assert message.startswith(str(path))
    assert "\n" not in message
    return message.removeprefix(str(path))


def scan_all(path: Path) -> None:
    for _ in scan_recording(path, batch_rows=7):
        pass
