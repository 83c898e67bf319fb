"""What a file of this project holds, and what is wrong with it."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from rig.documents import read_json
from rig.errors import RigError, one_line
from rig.recording import Recording, RecordingScan, locked_beside, scan_recording
from rig.recording.findings import degrees_words, gap_words, stuck_words, unit_words, unstated_words

_AT_AN_END: Final = 0.02  # of the samples at the least or greatest value are many
_POSSIBLE_DEGC: Final = (-100.0, 300.0)  # of a board that works
#: Columns that other readings of a log would be, and what to do with them.
_MEANT: Final = (
    (re.compile(r"theta[156].*", re.IGNORECASE), "Renk's angles? rig import --angles renk2005 takes them"),
    (
        re.compile(r"(acc|mag|q|joint|r[123][123]).*", re.IGNORECASE),
        "poses or readings? rig import takes logs as they come",
    ),
)


@dataclass(frozen=True)
class Checked:
    """A file's kind, what it holds and what looks wrong, in lines."""

    kind: str
    holds: dict[str, Any]
    findings: tuple[str, ...]


def check_file(path: Path, joints: int | None = None) -> Checked:
    """Look into a recording, scenario, mapping, prior, calibration, diagnosis or cause.

    Args:
        path: the file.
        joints: of the arm that a recording belongs to, where it is known.

    Raises:
        RigError: it cannot be read, or is not what its ending says.
    """
    suffix = path.suffix.casefold()
    if suffix in (".parquet", ".csv"):
        found = _recording(scan_recording(path, joints=joints))
        words = "" if joints is not None else _arm_words(found)
        return replace(found, holds={**found.holds, "arm_model": words}) if words else found
    if suffix == ".toml":
        return _toml(path)
    if suffix == ".json":
        return _json(path)
    raise RigError(f"{path}: found ending {suffix!r}, expected .parquet, .csv, .toml or .json")


def _recording(scan: RecordingScan) -> Checked:
    run = scan.read()
    steps = np.diff(run.t)
    meta = run.metadata
    holds: dict[str, Any] = {
        "samples": len(run),
        "duration_s": run.duration_s,
        "rate_Hz": None if len(run) < 2 else float(1.0 / np.median(steps)),
        "pose": run.pose,
        "joints": 0 if run.q is None else run.q.shape[1],
        "units": dict(run.units),
        "locked": locked_beside(scan.path),
        # what the import found is among the findings
        "metadata": {key: value for key, value in meta.to_json().items() if key != "findings"},
    }
    return Checked("recording", holds, tuple(_findings(scan, run)))


def _arm_words(found: Checked) -> str:
    """Of joint angles alone, whose orientations only the arm tells, which arm's model is missing; empty for none."""
    from estimators.known_angle.from_recording import BUILT_IN

    named = found.holds["metadata"].get("arm")
    if found.holds["pose"] != "joints" or named == BUILT_IN:
        return ""
    return f"that of {named or 'the arm'} is not built in: calibrate and diagnose need it (--arm FILE)"


def _findings(scan: RecordingScan, run: Recording) -> list[str]:
    found = []
    meta, steps = run.metadata, np.diff(run.t)
    if unused := unused_words(scan):
        found.append(unused)
    found += [*unstated_words(scan, scan.stated).values(), *gap_words(run.t)]
    if meta.rate_Hz and len(steps) and not 0.8 < meta.rate_Hz * float(np.median(steps)) < 1.25:
        found.append(f"rate_Hz says {meta.rate_Hz:g}, the times say {1.0 / float(np.median(steps)):.4g}")
    found += [*stuck_words(run), *unit_words(run)]
    for sensor in run.sensors:
        values = run.readings(sensor)
        ends = ((values == values.min(axis=0)) | (values == values.max(axis=0))).mean(axis=0)
        found += [
            f"{sensor}: channel {channel + 1} is at an end of its range in {100 * share:.3g} % of the samples: clipped?"
            for channel, share in enumerate(ends)
            if share > max(_AT_AN_END, 20 / len(run)) and np.ptp(values[:, channel]) > 0.0
        ]
    if (
        run.temperature is not None
        and not _POSSIBLE_DEGC[0] < run.temperature.min() <= run.temperature.max() < (_POSSIBLE_DEGC[1])
    ):
        ends = f"{run.temperature.min():.4g} to {run.temperature.max():.4g}"
        found.append(f"temperature_degC goes from {ends}, expected {_POSSIBLE_DEGC[0]:g} to {_POSSIBLE_DEGC[1]:g}")
    if degrees := degrees_words(run):
        found.append(degrees)
    return [*found, *(f"rig import found: {line}" for line in meta.findings if line not in found)]


def _toml(path: Path) -> Checked:
    from estimators.gap.hypotheses.prior import read_prior
    from rig.documents import parse_toml, read_toml
    from scenarios.importing.mapping import FORMAT, read_mapping
    from scenarios.loader import load

    content = parse_toml(read_toml(path, "a scenario, a mapping or a prior"), str(path))
    if content.get("format") == FORMAT:
        mapping = read_mapping(path)
        return Checked("mapping", {"columns": mapping.columns}, ())
    if set(content) == {"effects"}:  # a scenario has its sensors as well
        return Checked("prior", {"weights": dict(read_prior(path))}, ())
    scenario = load(path)
    arm = scenario.rig.arm
    holds = {
        "arm": None if arm is None else arm.name,
        "joints": [] if arm is None else list(arm.joint_names),
        "maneuver": scenario.kind,
        "duration_s": scenario.maneuver.duration_s,
        "sensors": list(scenario.truth.sensors),
        "effects": [f"{effect.name} at {effect.where}" for effect in scenario.rig.effects],
    }
    return Checked("scenario", holds, ())


def _json(path: Path) -> Checked:
    document = read_json(path, "a calibration, a diagnosis or a cause")
    kind = document.get("format", "") if isinstance(document, dict) else ""
    if str(kind).startswith("rig-calibration/"):
        from estimators import Calibration

        found = Calibration.read(path)
        warnings = [f"{name}: {text}" for name, sensor in found.sensors.items() for text in sensor.quality.warnings]
        holds = {"recording": found.recording, "sensors": list(found.sensors), "arm": found.arm}
        return Checked("calibration", holds, tuple(warnings))
    if str(kind).startswith("rig-diagnosis/"):
        from estimators.gap.reading import read_diagnosis

        said = read_diagnosis(path)
        return Checked("diagnosis", {"format": kind, "verdict": said.verdict, "samples": said.samples}, ())
    if isinstance(document, list) or (isinstance(document, dict) and "effect" in document):
        from scenarios.causes import read_causes

        effects = [f"{effect.name} at {effect.where}" for effect in read_causes(path)]
        return Checked("cause" if len(effects) == 1 else "list of causes", {"effects": effects}, ())
    raise RigError(f"{path}: found format {kind!r}, expected rig-calibration/1, a diagnosis or a cause")


def unused_words(scan: RecordingScan) -> str:
    """The columns that are passed over, and what they may have been meant as; empty where there are none."""
    if not scan.unused:
        return ""
    listed = ", ".join(scan.unused[:8]) + (" .." if len(scan.unused) > 8 else "")
    meant = next((words for pattern, words in _MEANT for name in scan.unused if pattern.fullmatch(name)), "")
    return one_line(f"{scan.path}: columns not used: {listed}" + (f" ({meant})" if meant else ""))
