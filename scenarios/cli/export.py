"""``rig export``: a calibration for use elsewhere."""

from __future__ import annotations

from pathlib import Path

import click

from scenarios.cli._options import PATH, Choice, check_output, json_option, print_json

_SUFFIXES = {"yaml": (".yaml", ".yml"), "json": (".json",), "c": (".h",), "ros": (".yaml", ".yml")}


@click.command(short_help="Write a calibration as YAML, JSON, a C header or for ROS.")
@click.argument("calibration", type=PATH, metavar="CAL")
@click.option("--to", "target", type=Choice(("yaml", "json", "c", "ros")), required=True, help="The kind of file.")
@click.option("-o", "--output", type=PATH, metavar="F", help="The file; stdout by default.")
@click.option(
    "--field-unit", type=Choice(("G", "uT", "nT")), help="The magnetic field's, of a CAL that does not say it."
)
@json_option
def export(calibration: Path, target: str, output: Path | None, field_unit: str | None, as_json: bool) -> None:
    """Write CAL for use elsewhere: matrix and bias of each sensor, with the formula that applies them in the file.

    The C header holds a function for each sensor and needs nothing else. ros is YAML for the pipelines of
    sensor_msgs/Imu (specific force, m/s^2) and sensor_msgs/MagneticField (tesla), with covariances in their layout.

    CAL says which unit its magnetic field is in, if its recording did. Of one that does not, --field-unit states it.

    \b
    Example:
      rig export cal.json --to yaml
      rig export cal.json --to c -o calibration.h
      rig export cal.json --to ros -o imu.yaml
    """
    check_output(output, _SUFFIXES[target], calibration)
    from estimators.calibration import Calibration
    from estimators.calibration.export import export as exported
    from rig.files import write_text

    text = exported(Calibration.read(calibration), target, field_unit)
    if output is not None:
        write_text(output, text)
    if as_json:
        print_json({"to": target, "file": output, "text": text})
    else:
        click.echo(text if output is None else f"{output}: written\n", nl=False)
