"""Pictures of coverage: what is drawn is what was seen, and what is shaded is what was not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from numpy.typing import NDArray

import estimators
from estimators.coverage import (
    SphereCells,
    coverage,
)
from estimators.coverage.seen import CELLS
from rig.arm import Arm
from rig.errors import RigError
from rig.recording import Recording
from scenarios.overlay import Overlay, overlays
from scenarios.plots import coverage_figure
from scenarios.plots.coverage import outlines
from validation.plots.camps_directions import projection_figure, spherical

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def laid(recording: Recording) -> dict[str, Overlay]:
    return overlays(recording, estimators.calibrate(recording), Arm.a465())


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
