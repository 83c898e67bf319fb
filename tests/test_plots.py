"""The plots: they show what they say and what was seen, are legible, and leave matplotlib as it was."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.text import Text
from mpl_toolkits.mplot3d.art3d import Line3DCollection

import estimators
import scenarios
from documenting.arm_picture import arm_picture
from documenting.arm_picture import main as arm_picture_command
from estimators.coverage import (
    SphereCells,
    coverage,
)
from estimators.coverage.seen import CELLS
from rig.arm import Arm
from rig.channels import CHANNELS, SENSORS
from rig.effects import EFFECTS, Kind
from rig.errors import RigError
from rig.recording import Recording
from scenarios.colours import AXES_ON_DARK, AXES_ON_PAPER, BLUE, VERMILLION, elapsed, rgb, signed
from scenarios.comparison import Compared, compare
from scenarios.overlay import Overlay, overlays
from scenarios.plots import coverage_figure, errors_figure, residuals_figure, save, sweep_figure
from scenarios.plots.coverage import outlines
from scenarios.plots.effects import effect_change, effect_figure
from validation.plots.camps_directions import projection_figure, spherical

Make = Callable[[], Figure]


@pytest.fixture(scope="module")
def laid(recording: Recording) -> dict[str, Overlay]:
    return overlays(recording, estimators.calibrate(recording), Arm.a465())


@pytest.fixture(scope="module")
def compared(recording: Recording) -> tuple[Compared, ...]:
    return compare(scenarios.load("ann-arbor").truth, estimators.calibrate(recording))


@pytest.fixture(params=["residuals", "coverage", "sweep", "errors"])
def make(
    request: pytest.FixtureRequest, recording: Recording, laid: dict[str, Overlay], compared: tuple[Compared, ...]
) -> Make:
    makers: dict[str, Make] = {
        "residuals": lambda: residuals_figure(recording.t, laid),
        "coverage": lambda: coverage_figure(recording.t, laid),
        "sweep": lambda: sweep_figure(recording, Arm.a465()),
        "errors": lambda: errors_figure(compared),
    }
    return makers[request.param]


def test_no_text_is_cut_off(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    figure = make()
    drawn: list[Text] = []
    draw = Text.draw
    monkeypatch.setattr(Text, "draw", lambda text, renderer: (drawn.append(text), draw(text, renderer)))
    figure.canvas.draw()
    frame = figure.bbox
    texts = [text for text in drawn if text.get_visible() and text.get_text().strip()]
    assert len(texts) > 10
    for text in texts:
        box = text.get_window_extent()
        inside = box.x0 >= -1 and box.y0 >= -1 and box.x1 <= frame.x1 + 1 and box.y1 <= frame.y1 + 1
        assert inside, f"{text.get_text()!r} at {box} in {frame}"


def test_matplotlib_is_left_as_it_was(make: Make) -> None:
    before = dict(mpl.rcParams)
    make()
    assert dict(mpl.rcParams) == before


def test_no_window_is_ever_involved() -> None:
    code = "import sys, scenarios.plots; sys.exit('matplotlib.pyplot' in sys.modules)"
    root = Path(__file__).parents[1]
    assert subprocess.run([sys.executable, "-c", code], cwd=root).returncode == 0


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_the_same_plot_is_the_same_file(suffix: str, compared: tuple[Compared, ...], tmp_path: Path) -> None:
    before = dict(mpl.rcParams)
    first, second = tmp_path / f"first{suffix}", tmp_path / f"second{suffix}"
    save(errors_figure(compared), first)
    save(errors_figure(compared), second)
    assert first.read_bytes() == second.read_bytes()
    assert len(first.read_bytes()) > 5000
    assert dict(mpl.rcParams) == before


def test_another_ending_is_refused(compared: tuple[Compared, ...], tmp_path: Path) -> None:
    with pytest.raises(RigError, match=r"found the ending '\.jpeg', expected one of \.png"):
        save(errors_figure(compared), tmp_path / "plot.jpeg")
    with pytest.raises(RigError, match="does not exist"):
        save(errors_figure(compared), tmp_path / "no" / "plot.png")
    assert list(tmp_path.iterdir()) == []


def test_residuals_are_drawn_with_their_band_mean_and_distribution(
    recording: Recording, laid: dict[str, Overlay]
) -> None:
    axes = residuals_figure(recording.t, laid).axes
    assert len(axes) == 12
    rows = [(laid[sensor], k) for sensor in SENSORS for k in range(3)]
    for number, (overlay, k) in enumerate(rows):
        left, right = axes[2 * number], axes[2 * number + 1]
        assert left.get_ylabel() == f"{CHANNELS[number]} [mV]"
        _zero, points, means = left.get_lines()
        assert np.array_equal(points.get_ydata(), overlay.residuals[:, k])
        assert len(means.get_ydata()) == 60
        assert np.mean(means.get_ydata()) == pytest.approx(overlay.residuals[:, k].mean(), abs=0.02 * overlay.sigma[k])
        [band] = left.patches
        assert band.get_extents().transformed(left.transData.inverted()).intervaly == pytest.approx(
            [-3.0 * overlay.sigma[k], 3.0 * overlay.sigma[k]]
        )
        [histogram] = right.patches
        values, edges, _ = histogram.get_data()
        assert (values * np.diff(edges)).sum() / overlay.sigma[k] == pytest.approx(1.0)  # every sample is in it


def test_errors_are_drawn_where_they_are(compared: tuple[Compared, ...]) -> None:
    untold = replace(compared[-1], sigma=None, error_sigmas=None, why="gravity lies along joint 1")
    far = replace(compared[0], error_sigmas=7.5)
    rows = (far, *compared[1:-1], untold)
    figure = errors_figure(rows)
    assert len(figure.axes) == 2
    drawn = []
    for axis in figure.axes:
        marks = [line for line in axis.get_lines() if line.get_marker() in ("o", "D")]
        drawn += [(float(line.get_xdata()[0]), line.get_color()) for line in marks]
        low, high = axis.get_xlim()
        assert low < -1.96 < 1.96 < high
        assert high > 7.5
    assert [value for value, _ in drawn] == [row.error_sigmas for row in rows[:-1]]
    assert all(colour == (BLUE if abs(value) <= 1.96 else VERMILLION) for value, colour in drawn)
    assert "cannot be told" in [text.get_text() for text in figure.axes[1].texts]
    assert "of 13 within" in figure.axes[1].get_title(loc="left")
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert labels[:4] == ["$S_1$", "$δ_1$", "$β_1$", "$γ_1$"]
    assert labels[-2:] == ["$φ$", "$ψ$"]


def test_the_map_shows_directions_and_both_ends_of_the_axes(recording: Recording, laid: dict[str, Overlay]) -> None:
    maps = coverage_figure(recording.t, laid).axes[:2]
    for axis, overlay in zip(maps, laid.values(), strict=True):
        azimuth, elevation = axis.collections[0].get_offsets().T
        back = np.stack(
            [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1
        )
        assert np.asarray(back) == pytest.approx(overlay.directions, abs=1e-7)
        ends = [line for line in axis.get_lines() if line.get_marker() in ("o", "X")]
        assert len(ends) == 6
        assert [line.get_color() for line in ends] == [colour for colour in AXES_ON_PAPER for _ in range(2)]


def test_the_sweep_shows_moving_joints_and_the_torus(recording: Recording) -> None:
    arm = Arm.a465()
    figure = sweep_figure(recording, arm)
    labels = [axis.get_ylabel() for axis in figure.axes]
    assert labels[:3] == ["joint1 [deg]", "joint5 [deg]", "joint6 mod 360 [deg]"]
    assert figure.axes[0].get_title(loc="left") == "Joint angles; locked: joint2 90°, joint3 −90°, joint4 0°"
    roll = figure.axes[2].get_lines()[0].get_ydata()
    assert np.nanmax(np.abs(roll)) <= 180.0
    assert np.nanmax(np.abs(np.diff(roll))) < 10.0  # 3.5 deg a sample: no line runs back across the plot
    [bristles] = [item for item in figure.findobj(Line3DCollection) if isinstance(item, Line3DCollection)]
    segments = np.array(bristles._segments3d)
    assert len(segments) == 1600
    assert np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1) == pytest.approx(0.1062)
    assert "z [m]" in [axis.get_zlabel() for axis in figure.axes if hasattr(axis, "get_zlabel")]


def test_what_there_is_not_cannot_be_plotted(recording: Recording) -> None:
    hand = replace(recording, q=None)
    for wrong in (
        lambda: residuals_figure(recording.t, {}),
        lambda: coverage_figure(recording.t, {}),
        lambda: errors_figure(()),
        lambda: sweep_figure(hand, None),
    ):
        with pytest.raises(RigError, match="expected"):
            wrong()


def test_a_single_sample_and_noiseless_residuals_can_be_plotted(laid: dict[str, Overlay]) -> None:
    overlay = laid["accelerometer"]
    rounding = np.full(3, np.finfo(float).eps)
    still = replace(overlay, residuals=np.zeros((1, 3)), sigma=rounding, directions=overlay.directions[:1])
    residuals_figure(np.zeros(1), {"accelerometer": still}).canvas.draw()
    coverage_figure(np.zeros(1), {"accelerometer": still}).canvas.draw()


def test_colours_differ_for_everybody() -> None:
    assert len({*AXES_ON_DARK}) == len({*AXES_ON_PAPER}) == 3
    assert rgb("#0072B2") == (0, 0x72, 0xB2)
    ends = signed(np.array([-3.0, 0.0, 3.0, 99.0]), 3.0)
    assert tuple(ends[0]) == rgb(BLUE)
    assert ends[1].min() > 230
    assert tuple(ends[2]) == tuple(ends[3]) == rgb(VERMILLION)
    # In time the colour only ever grows lighter (relative luminance, sRGB weights), so that it also reads in grey.
    luminance = elapsed(np.linspace(0.0, 1.0, 50)) @ [0.2126, 0.7152, 0.0722]
    assert np.diff(luminance).min() > 0.0


def test_the_arm_is_drawn_in_its_sweep(recording: Recording, tmp_path: Path) -> None:
    path = tmp_path / "arm.png"
    try:
        arm_picture(Arm.a465(), recording.q, path, pose=2000, bristles=200, size=(480, 360))
    except RigError as error:
        if "no OpenGL" in str(error):
            pytest.skip(str(error))
        raise
    pixels = imread(path)[:, :, :3]
    assert pixels.shape == (360, 480, 3)
    upper = pixels[40:160]  # where the torus is, against a grey-blue sky
    saturation = upper.max(axis=2) - upper.min(axis=2)
    assert 0.01 < (saturation > 0.25).mean() < 0.6


def test_without_opengl_it_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "none-such")
    assert arm_picture_command([str(tmp_path / "arm.png")]) == 2
    assert "no OpenGL to draw the arm with (none-such: RuntimeError" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    assert arm_picture_command([]) == 2


@pytest.mark.parametrize("name", [name for name, effect in EFFECTS.items() if not effect.of_log])
def test_every_effect_changes_the_sweep(name: str) -> None:
    found = effect_change(EFFECTS[name])
    assert found.columns
    assert (found.left is not None) == (EFFECTS[name].kind is Kind.MEAN)
    if found.left is not None:  # what a calibration leaves is no more than what there was, by its own measure
        before, after = (float(np.sum((values / found.floor) ** 2)) for values in (found.change, found.left))
        assert 0.0 < after <= before * (1.0 + 1e-9)


def test_the_change_is_the_effects_own() -> None:
    found = effect_change(EFFECTS["bias_step"], "mag3")
    assert found.columns == [5]
    np.testing.assert_allclose(found.change[:, 5], 5.0 * (found.t >= 600.0), atol=1e-9)
    assert effect_change(EFFECTS["joint_offset"], "joint6").left is not None
    with pytest.raises(RigError, match="joint9"):
        effect_change(EFFECTS["backlash"], "joint9")


@pytest.mark.parametrize("name", ["backlash", "outliers", "vibration"])
def test_effects_are_drawn(name: str, tmp_path: Path) -> None:
    found = effect_change(EFFECTS[name])
    figure = effect_figure(found)
    assert len(figure.axes) == 2 * len(found.columns)
    assert found.effect.where in figure.get_suptitle()
    save(figure, tmp_path / "effect.png")
    assert (tmp_path / "effect.png").stat().st_size > 10_000


@pytest.mark.parametrize("count", CELLS)
def test_polygons_have_the_area_of_their_cells(count: int) -> None:
    """In azimuth and z, in which the sphere's areas are true; nothing lies beyond +-pi."""
    cells = SphereCells.of(count)
    shapes, owners = outlines(cells, range(count))
    areas = np.zeros(count)
    for (x, z), owner in zip((shape.T for shape in shapes), owners, strict=True):
        areas[owner] += 0.5 * abs(np.sum(x * np.roll(z, -1) - z * np.roll(x, -1)))
        assert np.abs(x).max() <= np.pi + 1e-12
    assert areas == pytest.approx(np.full(count, 4.0 * np.pi / count), rel=1e-9)


def test_the_projection_shows_directions_and_shades_what_is_missing(
    recording: Recording, laid: dict[str, Overlay]
) -> None:
    overlay = laid["accelerometer"]
    part = overlay.directions[:, 2] > -0.5
    lacking = replace(overlay, directions=overlay.directions[part])
    for found, empty in ((overlay, False), (lacking, True)):
        figure = projection_figure(recording.t[: len(found.directions)], {"accelerometer": found})
        figure.canvas.draw()
        panel = next(axis for axis in figure.axes if axis.get_ylabel() == r"$\theta$")
        shading, points = panel.collections
        assert isinstance(shading, PolyCollection)
        assert bool(shading.get_paths()) is empty
        phi, theta = np.radians(np.asarray(points.get_offsets())).T
        assert theta == pytest.approx(spherical(found.directions)[1], abs=1e-6)
        assert phi == pytest.approx(spherical(found.directions)[2], abs=1e-6)
        assert ("missing" in panel.get_title(loc="left")) is empty
        # A missing cell is where theta counts up to 0 at the -z pole.
        for path in shading.get_paths():
            assert path.vertices[:, 1].mean() < 0.0
            assert path.vertices[:, 1].mean() > -62.0


def test_the_map_shades_what_is_missing(recording: Recording, laid: dict[str, Overlay]) -> None:
    overlay = laid["accelerometer"]
    part = overlay.directions[:, 0] > -0.5
    lacking = replace(overlay, directions=overlay.directions[part])
    figure = coverage_figure(recording.t[: part.sum()], {"accelerometer": lacking})
    figure.canvas.draw()
    shading = figure.axes[0].collections[1]
    missing = coverage(lacking.directions).missing
    assert len(shading.get_paths()) >= len(missing) > 10
    assert f"{100 * coverage(lacking.directions).share:.0f} % of 162" in figure.axes[0].get_title(loc="left")


def test_nothing_cannot_be_projected(recording: Recording) -> None:
    with pytest.raises(RigError, match="expected a calibration"):
        projection_figure(recording.t, {})
