"""``rig plan``: the best maneuver of an arm in a given time."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click

from rig.errors import RigError, check_name
from scenarios.cli._options import (
    PATH,
    POSITIVE,
    Choice,
    FiniteNumber,
    answer,
    arm_options,
    check_output,
    check_picture,
    json_option,
    number,
    numbers,
    on_arm,
    progress_bar,
)

_STEMS = ("sensitivity", "offset", "axis", "field")
#: The criterion of a plan that fits into the time must stay below that of one that does not.
_HEAVIEST = 100.0


def _weights(context: click.Context, option: click.Parameter, given: tuple[str, ...]) -> dict[str, float]:
    """Name -> weight.

    Raises:
        RigError: no such name, or no number.
    """
    found = {}
    known = [*_STEMS, *(f"{stem}{k}" for stem in _STEMS[:3] for k in (1, 2, 3))]
    for text in given:
        name, _, weight = text.partition("=")
        check_name("--weight", name, known)
        found[name] = number(weight)
        if not 0.0 <= found[name] <= _HEAVIEST:
            raise RigError(f"--weight: found {text!r}, expected {name}=W with a number from 0 to {_HEAVIEST:g}")
    return found


def _causes(context: click.Context, option: click.Parameter, given: tuple[str, ...]) -> list[tuple[str, str]] | None:
    """Effects and places; none for all; None where nothing is asked for.

    Raises:
        RigError: no such effect, or no place.
    """
    if not given:
        return None
    if "all" in given:
        return []
    from rig.effects import EFFECTS

    found = []
    for text in given:
        effect, at, where = text.partition("@")
        check_name("effect of --tell", effect, EFFECTS)
        if not at or not where:
            raise RigError(f"--tell: found {text!r}, expected EFFECT@PLACE such as joint_offset@joint5, or all")
        found.append((effect, where))
    return found


def _boxes(context: click.Context, option: click.Parameter, given: tuple[str, ...]) -> list[list[float]]:
    corners = [numbers(text) for text in given]
    for text, found in zip(given, corners, strict=True):
        if len(found) != 6:
            raise RigError(f"--box: found {text!r}, expected six numbers x,y,z,X,Y,Z [m]")
    return corners


def _radians(context: click.Context, option: click.Parameter, degrees: float | None) -> float | None:
    return None if degrees is None else math.radians(degrees)


@click.command(short_help="The best maneuver of an arm in a given time.")
@click.argument("scenario", default="ann-arbor")
@click.option("--seconds", type=float, required=True, metavar="T", help="For all of it, moves included.")
@click.option("-o", "--output", type=PATH, required=True, metavar="SCENARIO", help="Write it as a scenario: .toml.")
@click.option("--csv", "csv", type=PATH, metavar="F.csv", help="The joint trajectory, for a controller.")
@click.option("--plot", type=PATH, metavar="PLOT", help="A picture of it: .png, .svg or .pdf.")
@arm_options
@click.option(
    "--kind",
    type=Choice(["poses", "sweep"]),
    default="poses",
    show_default=True,
    help="Poses with holds, or a continuous sweep of all joints.",
)
@click.option(
    "--weight",
    "weights",
    multiple=True,
    callback=_weights,
    metavar="NAME=W",
    help="sensitivity, offset, axis or field (axis2, ..): W.",
)
@click.option(
    "--tell",
    multiple=True,
    callback=_causes,
    metavar="EFFECT@PLACE|all",
    help="Plan to tell these causes apart, or as many as can be, instead of to calibrate.",
)
@click.option("--table", "table_m", type=FiniteNumber(), metavar="Z", help="Height of a table in the base frame [m].")
@click.option(
    "--box",
    "boxes",
    multiple=True,
    callback=_boxes,
    metavar="x,y,z,X,Y,Z",
    help="What stands around: two corners [m].",
)
@click.option("--margin", "margin_m", type=FiniteNumber(min=0.0, max=1.0), default=0.01, show_default=True, help="[m]")
@click.option("--speed", type=POSITIVE, callback=_radians, metavar="DEG/S", help="At most so much in every joint.")
@click.option(
    "--acceleration", type=POSITIVE, callback=_radians, metavar="DEG/S²", help="At most so much in every joint."
)
@click.option("--seed", type=click.IntRange(min=0), default=0, help="Of the search.")
@json_option
def plan(
    scenario: str,
    seconds: float,
    output: Path,
    csv: Path | None,
    plot: Path | None,
    arm_file: Path | None,
    tip: str | None,
    as_json: bool,
    **given: Any,
) -> None:
    """Plan the maneuver from which a calibration is most certain, with the sensors and surroundings of SCENARIO.

    The arm stays within its limits, speeds and accelerations, and touches neither itself nor what its file, --table and
    --box put around it. Of poses, readings at rest count: calibrate the recording with rig calibrate --still. Along a
    sweep an accelerometer feels its own acceleration, which a calibration takes for gravity: the plan keeps that error
    small and states it, and rig calibrate sees it in the residuals; --acceleration limits that of the joints.

    \b
    Example:
      rig plan --seconds 90 -o plan.toml --csv plan.csv --plot plan.png
      rig plan --seconds 90 --kind sweep --acceleration 20 -o sweep.toml
      rig plan --seconds 120 --tell joint_offset@joint5 --tell base_rocking@base -o tell.toml
      rig plan ann-arbor --arm ur5e.urdf --tip tool0 --seconds 60 --table 0 -o plan.toml
      rig sweep plan.toml -o run.parquet --engine dynamic && rig calibrate run.parquet --still
    """
    check_output(output, (".toml",), Path(scenario), arm_file)
    check_output(csv, (".csv",), arm_file)
    check_picture(plot, arm_file)
    from rig.files import write_text, write_together
    from scenarios.loader import load
    from scenarios.plan.plan import make_plan, trajectory_csv
    from scenarios.plan.report import plan_figure, plan_report
    from scenarios.plots import save

    base = on_arm(load(scenario), arm_file, tip, None)
    with progress_bar("planning") as progress:
        found = make_plan(base, seconds, name=output.stem, progress=progress, **given)
    write_together(
        (output, lambda path: write_text(path, found.scenario.to_toml())),
        (csv, lambda path: write_text(path, trajectory_csv(found))),
        (plot, lambda path: save(plan_figure(found), path)),
    )
    answer(as_json, {**found.to_json(), "file": output}, lambda _: plan_report(found), output, csv, plot)
