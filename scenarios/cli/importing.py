"""``rig import`` and ``rig check``: logs as they come into recordings, and what a file holds."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rig.channels import ACCELEROMETER, SENSORS
from rig.errors import RigError
from rig.files import check_different
from scenarios.cli._options import (
    PATH,
    RECORDING_SUFFIXES,
    Choice,
    arm_options,
    check_output,
    chosen_arm,
    json_option,
    number,
    print_json,
    progress_bar,
)
from scenarios.cli._stated import stated_by_place, stated_metadata, stated_options

if TYPE_CHECKING:
    from scenarios.importing import Imported, Mapping


def _offset(context: click.Context, option: click.Parameter, text: str | None) -> Any:
    if text is None or text == "auto":
        return text
    offset = number(text)
    if not math.isfinite(offset):
        raise RigError(f"--clock-offset: found {text!r}, expected a number of seconds or auto")
    return offset


@click.command("import", short_help="Make a recording of logs as they come: CSV, TSV, MCAP, ROS 2 bags.")
@click.argument("logs", type=PATH, nargs=-1, required=True, metavar="LOG...")
@click.option("-o", "--output", type=PATH, metavar="RUN", help="The recording: .parquet or .csv.")
@click.option(
    "--map", "map_file", type=PATH, metavar="MAP.toml", help="Which column is what; written if it is not there."
)
@arm_options
@click.option("--angles", type=Choice(("joints", "renk2005")), help="renk2005: theta1, theta5, theta6 of its Table 1.")
@click.option("--rotation", type=Choice(("base<-tool", "tool<-base")), help="Of quaternions and matrices.")
@click.option("--euler", metavar="ZYX", help="Three Euler angles: capital about turned axes, small about fixed ones.")
@click.option(
    "--specific-force",
    "accelerometer_reads",
    flag_value="a-g",
    help="The accelerometer reads +1 g upward at rest; else detected.",
)
@click.option(
    "--clock-offset",
    "clock_offset_s",
    callback=_offset,
    metavar="S|auto",
    help="Added to the times of the poses; auto: estimated.",
)
@click.option("--base-frame", metavar="FRAME", help="Of a bag's transforms: where the pose is taken in; else guessed.")
@click.option("--tool-frame", metavar="FRAME", help="The frame whose pose it is: the sensor's; else guessed.")
@click.option("--time-unit", type=Choice(("s", "ms", "us", "ns")), help="Of the time column.")
@stated_options
@json_option
def import_(
    logs: tuple[Path, ...],
    output: Path | None,
    map_file: Path | None,
    arm_file: Path | None,
    tip: str | None,
    gravity: float | None,
    field: str | None,
    at: str | None,
    date: str | None,
    as_json: bool,
    **conventions: Any,
) -> None:
    """Make one recording of LOGs: text tables, MCAP files, ROS 2 bags; several of them are joined by their times.

    Delimiter, decimal comma, header, columns and units are found by looking, shown, and written to MAP.toml, which is
    read instead once it is there. Poses and readings are held against each other: gravity must come out constant in the
    base, so that a transposed rotation, another order of a quaternion, a joint of the other sign or a late clock is
    recognised and said.

    Of a bag with transforms (/tf, /tf_static) the pose is that of the chain of frames from the base to the sensor's
    frame, each interpolated between its own messages; with --arm and joint states these are taken instead.

    \b
    A column is one of: t; accel1_UNIT .. accel3_UNIT (V mV raw g mg m_s2); mag1_UNIT .. mag3_UNIT (V mV raw G mG T uT
    nT); q1_UNIT .. (rad deg m); qw qx qy qz; r11 .. r33; euler1_UNIT .. euler3_UNIT; theta1_UNIT, theta5, theta6;
    x_m y_m z_m (or mm); temperature_degC; supply_V. A minus sign before it turns its sign.

    \b
    Example:
      rig import log.csv -o run.parquet --map map.toml
      rig import imu.csv poses.csv -o run.parquet --clock-offset auto
      rig import bag_folder --arm ur5e.urdf -o run.parquet
      rig import bag.mcap --base-frame base_link --tool-frame imu_link -o run.parquet
      rig import log.csv --at 42.28,-83.74,260 --date 2026-11-22 -o run.parquet
    """
    check_different(logs)
    check_output(output, RECORDING_SUFFIXES, *logs, map_file, arm_file)
    from rig.files import write_text, write_together
    from scenarios.importing import import_logs

    given, there = _mapping(map_file, conventions, gravity, field)
    if not there:
        check_output(map_file, (".toml",), *logs)
    given, place = _placed(given, at, date)
    arm = chosen_arm(arm_file, tip)
    with progress_bar(f"importing {logs[0]}"):
        found = import_logs(logs, given if there else None, arm, given)
    written = None if there else map_file
    text = found.mapping.to_toml([f"Of {', '.join(log.name for log in logs)}: confirm or change."])
    write_together((written, lambda path: write_text(path, text)), (output, found.recording.write))
    if place:
        found = replace(found, said=(*found.said, place))
    if as_json:
        print_json(_document(found, output, map_file))
        return
    _tell(found, output, written)


def _mapping(
    path: Path | None, conventions: dict[str, Any], gravity: float | None, field: str | None
) -> tuple[Mapping, bool]:
    """The mapping file with the options over it, and whether there is one."""
    from scenarios.importing.mapping import Mapping, read_mapping

    there = path is not None and path.is_file()
    mapping = read_mapping(path) if path is not None and there else Mapping()
    stated = replace(mapping.metadata, **stated_metadata(gravity, field))
    given = {key: value for key, value in conventions.items() if value is not None}
    return replace(mapping, conventions=replace(mapping.conventions, **given), metadata=stated), there


def _placed(mapping: Mapping, at: str | None, date: str | None) -> tuple[Mapping, str]:
    """The mapping with gravity and, of a day, the field of a place, where they are not stated; and this in words."""
    stated = mapping.metadata
    sensors = SENSORS if date is not None else (ACCELEROMETER,)
    found, words = stated_by_place(stated.known, at, date, sensors, stated.magnetic_field_unit or "uT")
    return replace(mapping, metadata=replace(stated, **found)), words


def _document(found: Imported, output: Path | None, map_file: Path | None) -> dict[str, Any]:
    recording = found.recording
    return {
        "recording": output,
        "map": map_file,
        "samples": len(recording),
        "duration_s": recording.duration_s,
        "pose": recording.pose,
        "units": dict(recording.units),
        "columns": found.mapping.columns,
        "said": list(found.said),
        "findings": list(found.findings),
        "unused": {log: list(names) for log, names in found.unused.items()},
    }


def _tell(found: Imported, output: Path | None, written: Path | None) -> None:
    width = max(len(name) for name in found.mapping.columns)
    for name, target in found.mapping.columns.items():
        click.echo(f"  {name:<{min(width, 40)}}  {target}")
    for line in found.said:
        click.echo(f"- {line}")
    for line in found.findings:
        click.echo(f"! {line}")
    recording = found.recording
    if written is not None:
        click.echo(f"{written}: written; confirm or change it, and give it with --map again")
    what = f"{len(recording):,} samples of {' and '.join(recording.sensors)}, pose: {recording.pose}"
    click.echo(f"{output}: {what}" if output is not None else f"{what}; not written: expected -o RUN.parquet")


@click.command(short_help="What a file holds and what is wrong with it.")
@click.argument("file", type=PATH)
@arm_options
@json_option
def check(file: Path, arm_file: Path | None, tip: str | None, as_json: bool) -> int:
    """Look into FILE: a recording, scenario, mapping, prior, calibration, diagnosis or cause.

    Exit status 1: it looks wrong.

    \b
    Example:
      rig check run.parquet
      rig check log.csv --json
    """
    from scenarios.checking import check_file

    arm = chosen_arm(arm_file, tip)
    found = check_file(file, None if arm is None else arm.dof)
    if as_json:
        print_json({"file": file, "kind": found.kind, "holds": found.holds, "findings": list(found.findings)})
    else:
        click.echo(f"{file}: a {found.kind}")
        for key, value in found.holds.items():
            click.echo(f"  {key:<12} {_held(value)}")
        for line in found.findings:
            click.echo(f"! {line}")
    return 1 if found.findings else 0


def _held(value: Any) -> str:
    """What a file holds, for a person."""
    if isinstance(value, dict):
        return "; ".join(f"{key} {_held(each)}" for key, each in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(map(_held, value)) or "-"
    return "-" if value in (None, "") else f"{value:.7g}" if isinstance(value, float) else str(value)
