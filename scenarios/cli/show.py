"""``rig view``, ``rig scenarios``, ``rig effects``: what there is to look at."""

from __future__ import annotations

from pathlib import Path
from shutil import rmtree
from subprocess import Popen, TimeoutExpired
from tempfile import mkdtemp
from typing import TYPE_CHECKING

import click

from rig.errors import RigError, check_name, in_short
from scenarios.cli._options import (
    PATH,
    answer,
    arm_options,
    check_output,
    check_picture,
    chosen_arm,
    json_option,
    memory_option,
    print_json,
    progress_bar,
    tell,
)

if TYPE_CHECKING:
    from estimators import Calibration
    from rig.arm import Arm
    from rig.recording import Recording

_VIEWER_STARTS_S = 1.5
#: Memory that a view takes while it is made [bytes a sample].
_DRAWN = 600.0


@click.command(short_help="List the scenarios, or print one.")
@click.argument("name", required=False)
@json_option
def scenarios(name: str | None, as_json: bool) -> None:
    """List the scenarios that come with the rig, or print one as the TOML it is.

    A printed scenario is the start of an own one: save it, change it, and give its path to rig sweep.

    \b
    Example:
      rig scenarios
      rig scenarios ann-arbor > mine.toml
    """
    if name is None:
        from scenarios.catalogue import titles
        from scenarios.terminal.tables import table

        rows = titles()
        listed = [{"name": key, "title": title} for key, title in rows.items()]
        answer(as_json, listed, lambda _: table("scenario", "what it is", rows=rows.items()))
        return
    from scenarios.loader import load, read_text

    scenario = load(name)
    if not as_json:
        click.echo(read_text(name), nl=False)
        return
    import tomllib

    content = tomllib.loads(read_text(name))
    truth = {sensor: scenario.truth.values(sensor) for sensor in scenario.truth.sensors}
    print_json({"name": scenario.name, **content, "truth": truth})


@click.command(short_help="List the unmodelled effects, or describe one.")
@click.argument("name", required=False)
@click.option("-o", "--output", type=PATH, metavar="F.png", help="Draw what it does to a sweep: .png, .svg or .pdf.")
@click.option("--where", metavar="PLACE", help="Where it is drawn; by default where a calibration leaves most of it.")
@json_option
def effects(name: str | None, output: Path | None, where: str | None, as_json: bool) -> None:
    """List the unmodelled effects that a scenario can add, or describe one.

    \b
    Example:
      rig effects
      rig effects backlash
      rig effects backlash -o backlash.png --where joint1
    """
    from rig.effects import EFFECTS

    if name is not None:
        check_name("effect", name, EFFECTS)
    if output is not None or where is not None:
        _draw_effect(name, output, where)
    from scenarios.terminal.tables import effect_description, effect_record, effects_table

    if name:
        answer(as_json, effect_record(EFFECTS[name]), lambda _: effect_description(EFFECTS[name]), output)
    else:
        records = [effect_record(effect) for effect in EFFECTS.values()]
        answer(as_json, records, lambda _: effects_table(EFFECTS.values()))


def _draw_effect(name: str | None, output: Path | None, where: str | None) -> None:
    if name is None or output is None:
        missing = "the NAME of an effect" if name is None else "-o F.png"
        raise RigError(f"{'-o' if output is not None else '--where'}: found without {missing}, expected both")
    check_picture(output)
    from rig.effects import EFFECTS
    from scenarios.plots import save
    from scenarios.plots.effects import effect_change, effect_figure

    with progress_bar(f"drawing {name}"):
        save(effect_figure(effect_change(EFFECTS[name], where)), output)


@click.command(short_help="Look at a recording, or a study, in the rerun viewer.")
@click.argument("run", type=PATH)
@click.option("-o", "--output", type=PATH, metavar="F.rrd", help="Write the view instead of opening it.")
@click.option("--calibration", type=PATH, metavar="CAL", help="Lay this calibration over it; its own otherwise.")
@click.option("--diagnosis", type=PATH, metavar="D", help="Show on the arm what this diagnosis of RUN found.")
@click.option("--web", is_flag=True, help="Serve the viewer to a browser of this machine, until Ctrl-C.")
@arm_options
@memory_option
@json_option
def view(
    run: Path,
    output: Path | None,
    calibration: Path | None,
    diagnosis: Path | None,
    web: bool,
    arm_file: Path | None,
    tip: str | None,
    as_json: bool,
) -> None:
    """Look at RUN in the rerun viewer: the arm in its sweep, the readings, and what a calibration leaves over; or at a
    study, which is a folder.

    A recording whose poses are known is calibrated for this, unless a calibration is given. With --diagnosis the joint,
    link or sensor at fault is painted and named, a stray magnet stands where it sits with its uncertainty, and what the
    causes do and what is left before and after are beside it. Without -o the viewer opens; nothing but this machine can
    reach it, nor with --web, for machines without a screen.

    \b
    Example:
      rig view run.parquet
      rig view run.parquet --calibration cal.json -o run.rrd
      rig view run.parquet --diagnosis diagnosis/run.diagnosis.json --web
    """
    if diagnosis is not None and calibration is not None:
        raise RigError("--calibration: found beside --diagnosis, which has its own, expected one or the other")
    check_output(output, (".rrd",), run, calibration, diagnosis, arm_file)
    target = output if output is not None else Path(mkdtemp(prefix="rig-view-")) / f"{run.stem}.rrd"
    try:
        arm = chosen_arm(arm_file, tip)
        if arm is not None and arm.urdf is not None:
            _tell_left_out(arm.urdf)
        if diagnosis is None:
            _draw(run, calibration, arm, target)
        else:
            _draw_diagnosis(run, diagnosis, arm, target)
        if web:
            _serve(target)
        elif output is None:
            from scenarios.view import open_view

            _watch(open_view(target))
    except BaseException:
        if output is None:
            rmtree(target.parent, ignore_errors=True)
        raise
    if as_json:
        print_json({"view": target, "opened": output is None})
    else:
        click.echo(f"{target}: {'opened in the viewer' if output is None else 'written'}")


def _serve(target: Path) -> None:
    """Serve the view until somebody ends it."""
    from scenarios.view import serve_view

    server, address = serve_view(target)
    try:
        click.echo(f"{address}\nserved to this machine until Ctrl-C", err=True)
        server.wait()
    finally:
        server.terminate()
        server.wait()
    raise RigError(f"the viewer for browsers ended by itself with status {server.returncode}, expected it to stay")


def _draw_diagnosis(run: Path, diagnosis: Path, arm: Arm | None, target: Path) -> None:
    from estimators.gap.data.basefit import posed
    from estimators.gap.reading import read_diagnosis
    from rig.files import in_utf8
    from rig.recording import locked_beside, whole_or_means
    from scenarios.diagnosing.task import BYTES_A_SAMPLE
    from scenarios.gap_report import gap_residuals
    from scenarios.view import write_diagnosis_view

    found = read_diagnosis(diagnosis)
    if (name := in_utf8(run.stem)) not in found.recordings:
        raise RigError(f"{diagnosis}: is of {' and '.join(found.recordings)}, expected a diagnosis of {name}")
    joints = None if arm is None else arm.dof
    with progress_bar(f"drawing {run}"):
        recording, block = whole_or_means(run, joints, BYTES_A_SAMPLE)
        recording, arm = posed(recording, arm)
        beside = locked_beside(run)
        locked = None if beside is None else whole_or_means(beside, joints, block=block)[0]
        write_diagnosis_view(found, gap_residuals(recording, found, locked, arm), target)


def _draw(run: Path, calibration: Path | None, arm: Arm | None, target: Path) -> None:
    if run.is_dir():
        from scenarios.view.study import write_study_view

        with progress_bar(f"drawing {run}"):
            write_study_view(run, target)
        return
    if not run.exists() and not run.suffix:
        raise RigError(f"{run}: no such file or folder, expected a recording or a study")
    from rig.recording import scan_recording, whole_or_thinned

    recording, thinned = whole_or_thinned(scan_recording(run, joints=None if arm is None else arm.dof), _DRAWN)
    tell(thinned)
    from estimators import Calibration
    from scenarios.sensor_motion import arm_of

    arm = arm or arm_of(recording)
    found = _fitted(run, recording, arm) if calibration is None else Calibration.read(calibration)
    from scenarios.view import write_view

    with progress_bar(f"drawing {run}"):
        write_view(recording, found, target, arm)


def _tell_left_out(urdf: Path) -> None:
    """One line on the meshes that are not drawn."""
    from rig.arm.urdf_file import drawable_urdf

    left_out = drawable_urdf(urdf)[1]
    what = "a mesh is" if len(left_out) == 1 else f"{len(left_out)} meshes are"
    tell(f"{urdf}: {what} left out: {in_short(left_out)}" if left_out else "")


def _fitted(run: Path, recording: Recording, arm: Arm | None) -> Calibration | None:
    """The recording's own calibration, with the locked recording beside it; None where none can be told."""
    from estimators import calibrate

    if recording.pose == "none" or (recording.q is not None and arm is None):
        return None
    try:
        return calibrate(run, arm=arm)
    except RigError as reason:
        tell(f"without a calibration: {reason}")
        return None


def _watch(viewer: Popen[bytes]) -> None:
    """A viewer that ends at once has found no screen."""
    try:
        status = viewer.wait(_VIEWER_STARTS_S)
    except TimeoutExpired:
        return
    if status != 0:
        raise RigError(f"the viewer ended at once with status {status}: no screen? Write the view with -o F.rrd")
