"""One step of the benchmarks ``stream`` and ``memory`` in a process of its own, so that its memory is its own too.

    python -m benchmarks._stream write FILE ROWS SEED | rest FILE ROWS SEED | calibrate FILE | decode FILE | read FILE

One JSON object on stdout: ``seconds`` and ``cpu_seconds`` of the step without start-up, ``peak_MiB`` of the process,
``start_MiB`` before.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks._child import peak_MiB

_CHUNK = 1 << 20  # bytes, of a bare read


def write(path: Path, rows: int, seed: int) -> dict[str, Any]:
    """The sweep of ann-arbor at 100 Hz again and again, with new noise, through the converter."""
    import scenarios
    from rig.recording import RecordingWriter

    scenario = scenarios.load("ann-arbor")
    acquisition = replace(scenario.rig.acquisition, decimation=1)
    clean = scenario.with_acquisition(decimation=1, noise_V=(0.0,) * 6, bits=None).simulate(seed)
    volts = np.hstack([clean.readings(sensor) for sensor in clean.sensors])
    rng = np.random.default_rng(seed)
    left = rows
    with RecordingWriter(path) as writer:
        while left:
            count = min(left, len(clean))
            part = clean.select(slice(0, count))
            noisy = acquisition.convert(acquisition.add_noise(volts[:count], rng))
            t = part.t + (rows - left) / 100.0
            writer.write(replace(part, t=t, accelerometer=noisy[:, :3], magnetometer=noisy[:, 3:]))
            left -= count
    return {"bytes": path.stat().st_size}


def rest(path: Path, rows: int, seed: int) -> dict[str, Any]:
    """The arm of ann-arbor locked in four poses, again with noise through the converter, at 1 kHz."""
    import scenarios
    from rig.recording import Recording, RecordingWriter

    scenario = scenarios.load("ann-arbor")
    acquisition = scenario.rig.acquisition
    still = scenario.simulate(seed).select(slice(0, 6400, 1600))
    volts = np.hstack([still.readings(sensor) for sensor in still.sensors])
    rng = np.random.default_rng(seed)
    part = 1 << 20
    with RecordingWriter(path) as writer:
        for first in range(0, rows, part):
            number = np.arange(first, min(first + part, rows))
            pose = number * len(still) // rows
            noisy = acquisition.convert(acquisition.add_noise(volts[pose], rng))
            writer.write(
                Recording(
                    t=number / 1e3,
                    q=np.asarray(still.q)[pose],
                    accelerometer=noisy[:, :3],
                    magnetometer=noisy[:, 3:],
                    units=still.units,
                    metadata=still.metadata,
                )
            )
    return {"bytes": path.stat().st_size}


def calibrate(path: Path) -> dict[str, Any]:
    """Both sensors, joint angles in, covariance out; the largest error in its own standard deviations."""
    import estimators
    import scenarios
    from scenarios.comparison import compare

    found = estimators.calibrate(path, noise="residuals")
    rows = compare(scenarios.load("ann-arbor").truth, found)
    return {
        "largest_error_sigmas": max(abs(row.error_sigmas or 0.0) for row in rows),
        "rows": found["magnetometer"].samples,
    }


def decode(path: Path) -> dict[str, Any]:
    """pyarrow alone, as it decodes by itself: every batch is dropped at once."""
    import pyarrow.parquet

    count = 0
    with pyarrow.parquet.ParquetFile(path) as file:
        for batch in file.iter_batches(batch_size=65536):
            count += batch.num_rows
    return {"rows": count}


def read(path: Path) -> dict[str, Any]:
    """The bytes alone."""
    count = 0
    with path.open("rb", buffering=0) as file:
        while block := file.read(_CHUNK):
            count += len(block)
    return {"bytes": count}


def forget(path: Path) -> None:
    """Ask the system to forget what it has of the file in memory, so that it comes from the disk."""
    if hasattr(os, "posix_fadvise"):
        with path.open("rb") as file:
            os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def main() -> None:
    name, path, *numbers = sys.argv[1:]
    if name not in ("write", "rest"):
        # Start-up is not the step's.
        import pyarrow.parquet  # noqa: F401

        import estimators  # noqa: F401
        import scenarios.comparison  # noqa: F401
        from rig.arm import Arm

        Arm.a465().rotation_map  # noqa: B018
        forget(Path(path))
    steps: dict[str, Callable[..., dict[str, Any]]] = {
        "write": write,
        "rest": rest,
        "calibrate": calibrate,
        "decode": decode,
        "read": read,
    }
    start = peak_MiB()
    busy, begun = time.process_time(), time.perf_counter()
    found = steps[name](Path(path), *map(int, numbers))
    spent = {"seconds": time.perf_counter() - begun, "cpu_seconds": time.process_time() - busy}
    print(json.dumps({**found, **spent, "peak_MiB": peak_MiB(), "start_MiB": start}))


if __name__ == "__main__":
    main()
