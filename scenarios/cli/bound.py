"""``rig bound``: what a maneuver can tell, before it is run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rig.errors import RigError
from scenarios.cli._options import (
    PATH,
    Choice,
    answer,
    arm_options,
    check_picture,
    json_option,
    maneuver_option,
    on_arm,
    progress_bar,
)


@click.command(short_help="What a scenario's maneuver can tell, before it is run.")
@click.argument("scenario")
@click.option("-o", "--output", type=PATH, metavar="PLOT", help="Draw it against time: .png, .svg or .pdf.")
@click.option(
    "--method",
    type=Choice(("simultaneous", "separate")),
    help="One field for all axes, or one each; simultaneous by default.",
)
@click.option("--effects", is_flag=True, help="Which effects it can show and tell apart, instead of the parameters.")
@arm_options
@maneuver_option
@json_option
def bound(
    scenario: str,
    output: Path | None,
    method: Any,
    effects: bool,
    arm_file: Path | None,
    tip: str | None,
    kind: str | None,
    as_json: bool,
) -> None:
    """The Cramer-Rao bound of SCENARIO, a name of rig scenarios or a TOML file.

    No calibration of its recording can be more certain than this, and rig calibrate is as certain: every parameter's
    standard deviation, what stays open and why, and what each minute of the maneuver pays. Nothing is simulated.

    With --effects: which unmodelled effects of typical size it can show beside a calibration, which of them it can tell
    apart, in standard deviations, and what changes if the joints that it locks move too.

    \b
    Example:
      rig bound ann-arbor
      rig bound mine.toml -o bound.png
      rig bound ann-arbor --effects -o effects.png
      rig bound ann-arbor --arm ur5e.urdf --maneuver static-poses
    """
    if effects and method is not None:
        raise RigError("--method: found with --effects, which asks for no parameters, expected one of them")
    check_picture(output, Path(scenario), arm_file)
    from scenarios.bound import bound_of
    from scenarios.isolability import isolability_of
    from scenarios.loader import load
    from scenarios.terminal.bound import bound_report, isolability_report

    chosen = on_arm(load(scenario), arm_file, tip, kind)
    found: Any
    if effects:
        with progress_bar(f"effects on {chosen.name}") as progress:
            found = isolability_of(chosen, progress=progress)
    else:
        found = bound_of(chosen, method or "simultaneous")
    if output is not None:
        from scenarios.plots import save
        from scenarios.plots.bound import bound_figure, isolability_figure

        save((isolability_figure if effects else bound_figure)(found), output)
    answer(as_json, found, isolability_report if effects else bound_report, output)
