"""``rig noise``: what the noise of a locked arm is like."""

from __future__ import annotations

from pathlib import Path

import click

from scenarios.cli._options import PATH, answer, check_picture, json_option, memory_option, progress_bar, tell


@click.command(short_help="What the noise of a locked-arm recording is like.")
@click.argument("locked", type=PATH)
@click.option("-o", "--output", type=PATH, metavar="PLOT", help="Draw Allan deviation and spectrum: .png, .svg, .pdf.")
@click.option("--calibration", type=PATH, metavar="CAL", help="Also give white noise in field units.")
@memory_option
@json_option
def noise(locked: Path, output: Path | None, calibration: Path | None, as_json: bool) -> None:
    """Study the noise of LOCKED, a recording of poses held still.

    RMS of each pose, dynamic range and bits as in Renk et al.; the terms of the Allan deviation with their uncertainty:
    white noise, bias instability, random walk, quantisation, ramp; whether the noise is white, and which autoregression
    whitens it.

    \b
    Example:
      rig noise run.locked.parquet
      rig noise run.locked.parquet -o noise.png --calibration cal.json
    """
    check_picture(output, locked, calibration)
    from estimators.calibration import Calibration
    from estimators.noise.study import study_noise
    from rig.recording import whole_or_beginning

    found = None if calibration is None else Calibration.read(calibration)
    recording, shortened = whole_or_beginning(locked)
    tell(shortened)
    with progress_bar(f"studying {locked}"):
        study = study_noise(recording)
    if output is not None:
        from scenarios.plots import save
        from scenarios.plots.noise import noise_figure

        save(noise_figure(study, recording.name), output)
    from scenarios.terminal.noise import noise_report

    if found is not None:
        found = found.with_field_unit(recording.metadata.magnetic_field_unit)
    answer(as_json, study, lambda noise: noise_report(noise, found), output)
