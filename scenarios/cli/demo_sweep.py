"""``rig demo`` and ``rig sweep``: the rig runs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from scenarios.cli._options import (
    PATH,
    RECORDING_SUFFIXES,
    Choice,
    arm_options,
    check_output,
    json_option,
    maneuver_option,
    memory_option,
    on_arm,
    print_json,
    progress_bar,
)

if TYPE_CHECKING:
    from rig.recording import Recording
    from scenarios.scenario import Scenario


@click.command(short_help="The whole story on a built-in scenario, artefacts in ./out.")
@click.option("-o", "--output", type=PATH, default="out", metavar="FOLDER", help="For the results; ./out by default.")
@click.option("--seed", type=click.IntRange(min=0), default=0, help="Of the noise.")
@json_option
def demo(output: Path, seed: int, as_json: bool) -> None:
    """Tell the whole story on the scenario ann-arbor, a fault and its diagnosis included, and leave recordings,
    calibration, diagnosis, plots and views in FOLDER.

    \b
    Example:
      rig demo
      rig demo -o results --seed 7
    """
    from scenarios.demo import run_demo
    from scenarios.terminal.tables import show

    result = run_demo(output, seed, tell=(lambda _: None) if as_json else show, working=progress_bar)
    if as_json:
        summary = {
            "scenario": result.scenario.name,
            "seed": seed,
            "seconds": result.seconds,
            "files": list(result.files.values()),
            "parameters": [vars(row) for row in result.compared],
            "diagnosis": {"verdict": result.diagnosis.verdict, "causes": result.diagnosis.to_json()["causes"]},
        }
        print_json(summary)
        return
    run, calibration = result.files["the recording"], result.files["the calibration"]
    click.echo(f"\nDone in {result.seconds:.1f} s. Look at it: rig view {run} --calibration {calibration}")
    fault, diagnosis = result.files["the recording of the faulty arm"], result.files["its diagnosis"]
    click.echo(f"The fault on the arm: rig view {fault} --diagnosis {diagnosis}")


@click.command(short_help="Simulate a scenario and write its recording.")
@click.argument("scenario")
@click.option("-o", "--output", type=PATH, required=True, metavar="RUN", help="The recording: .parquet or .csv.")
@click.option("--seed", type=click.IntRange(min=0), help="Of the noise; the scenario's own by default.")
@click.option("--engine", type=Choice(("kinematic", "dynamic")), help="Joints as wanted, or driven by actuators.")
@click.option("--motion", type=Choice(("quasi-static", "inertial")), help="Without or with the sensor's acceleration.")
@click.option(
    "--with", "causes", type=PATH, multiple=True, metavar="CAUSE.json", help="Add the effects that a diagnosis names."
)
@click.option("--noise", type=float, metavar="K", help="White noise times K.")
@click.option("--locked", is_flag=True, help="Also write RUN.locked.parquet, for the noise floor.")
@arm_options
@maneuver_option
@memory_option
@json_option
def sweep(
    scenario: str,
    output: Path,
    seed: int | None,
    engine: Any,
    motion: Any,
    causes: tuple[Path, ...],
    noise: float | None,
    locked: bool,
    arm_file: Path | None,
    tip: str | None,
    kind: str | None,
    as_json: bool,
) -> None:
    """Simulate SCENARIO, a name of rig scenarios or a TOML file, and write its recording.

    With --arm the scenario's sensor, surroundings and maneuver are put on that arm: the torus sweep picks the arm's own
    yawing, tilting and rolling joints and keeps to its limits and speeds.

    CAUSE.json is a diagnosis, or one cause such as
    {"effect": "backlash", "where": "joint5", "parameters": {"width_rad": 0.005}}.

    \b
    Example:
      rig sweep ann-arbor -o run.parquet --locked
      rig sweep mine.toml -o run.csv --seed 7 --engine dynamic --with backlash.json
      rig sweep ann-arbor --arm ur5e.urdf --tip tool0 -o run.parquet --locked
    """
    check_output(output, RECORDING_SUFFIXES, Path(scenario), arm_file, *causes)
    locked_path = output.with_name(f"{output.stem}.locked.parquet") if locked else None
    check_output(locked_path, RECORDING_SUFFIXES, output)
    from rig.files import write_together
    from scenarios.causes import read_causes
    from scenarios.loader import load

    chosen = on_arm(load(scenario), arm_file, tip, kind)
    rig = chosen.rig
    found = [effect for path in causes for effect in read_causes(path, rig.arm, rig.pipeline.sensors)]
    chosen = chosen.with_effects(found)
    if noise is not None:
        chosen = chosen.scaled_noise(noise)
    chosen = replace(chosen, engine=engine or chosen.engine, motion=motion or chosen.motion)
    with progress_bar(f"sweeping {chosen.name}") as progress:
        recording = chosen.simulate(seed, progress)

    def write_locked(path: Path) -> None:
        with progress_bar("locked arm") as progress:
            chosen.simulate_locked(seed, progress).write(path)

    write_together((locked_path, write_locked), (output, recording.write))
    summary = _summary(chosen, recording, output, seed)
    if as_json:
        print_json(summary)
    else:
        sensors = " and ".join(recording.sensors)
        click.echo(f"{output}: {len(recording):,} samples of {sensors} in {recording.duration_s:,.0f} s")
        for channel, share in summary["clipped"].items():
            click.echo(
                f"! {channel}: the motion leaves the board's range in {100 * share:.3g} % of the samples: clipped"
            )
        if locked_path is not None:
            click.echo(f"{locked_path}: the arm locked, for the noise floor")
        elif (older := summary["locked"]) is not None:
            click.echo(f"{older}: was there before; rig calibrate takes it for the noise floor of {output}")


def _summary(scenario: Scenario, recording: Recording, path: Path, seed: int | None) -> dict[str, Any]:
    from rig.recording import locked_beside

    return {
        "scenario": scenario.name,
        "seed": scenario.seed if seed is None else seed,
        "engine": scenario.engine,
        "motion": scenario.motion,
        "effects": [{"effect": effect.name, "where": effect.where} for effect in scenario.rig.effects],
        "recording": path,
        "locked": locked_beside(path),
        "samples": len(recording),
        "duration_s": recording.duration_s,
        "sensors": list(recording.sensors),
        "clipped": _clipped(scenario, recording),
    }


def _clipped(scenario: Scenario, recording: Recording) -> dict[str, float]:
    """Channel -> the share of its readings that lie at an end of the board's range; only where there are any."""
    import numpy as np

    from rig.channels import CHANNELS_OF

    ends = scenario.rig.acquisition.range_V
    step = scenario.rig.acquisition.step_V
    shares: dict[str, float] = {}
    for sensor in recording.sensors if ends is not None else ():
        if recording.unit(sensor) != "V":
            continue
        low, high = np.asarray(ends)
        values = recording.readings(sensor)
        share = ((values <= low + step / 2) | (values >= high - step / 2)).mean(axis=0)
        shares |= dict(zip(CHANNELS_OF[sensor], map(float, share), strict=True))
    return {channel: share for channel, share in shares.items() if share > 0.0}
