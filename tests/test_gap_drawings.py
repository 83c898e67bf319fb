"""The drawings of a diagnosis' page: densities, block means, maps, and the SVG they are drawn with."""

from __future__ import annotations

import re
from base64 import b64decode
from io import BytesIO
from xml.etree import ElementTree

import matplotlib.image
import numpy as np
import pytest
from diagnosed_recordings import by_hand
from scipy.stats import binom, chi2

from estimators.gap.floor.channel_noise import ChannelNoise
from rig.effects import make_effect
from scenarios.gap_report.charts import follow_bars, posterior_bar
from scenarios.gap_report.curves import _frame, block_error, density, floor_density, named_density
from scenarios.gap_report.maps import Axis, cells, shape_of
from scenarios.gap_report.svg import Drawing, Scale

#: Two readings of the same voltage differ by the converter's rounding: sqrt(2) 1.2207 mV / sqrt(12).
ROUNDING_V = np.sqrt(2.0 / 12.0) * 20.0 / 2**14


def test_density_of_white_noise_is_flat_and_that_of_the_floor() -> None:
    rng, interval, sigma = np.random.default_rng(1), 0.25, 0.0134
    frequency, found = density(sigma * rng.standard_normal(4096), interval)
    floor = floor_density(ChannelNoise(sigma**2), frequency, interval)
    np.testing.assert_allclose(floor, 2.0 * interval * sigma**2, rtol=1e-12)
    # A band of m lines of a Hann periodogram has at least m degrees of freedom; the widest hold over 100. 1e-9 each.
    wide = slice(-10, None)
    low, high = chi2.ppf([1e-9, 1.0 - 1e-9], 100) / 100
    assert ((found / floor)[wide] > low).all()
    assert ((found / floor)[wide] < high).all()


def test_densities_integrate_to_the_variance() -> None:
    interval = 0.25
    frequency = np.linspace(0.0, 2.0, 20_001)
    noise = ChannelNoise(white=1e-4, parts=((3e-4, 0.9),))
    np.testing.assert_allclose(np.trapezoid(floor_density(noise, frequency, interval), frequency), 4e-4, rtol=1e-4)
    excess = make_effect("noise_excess", {"where": "mag2", "extra_sigma": 0.02})
    walk = make_effect("timing_jitter", {"where": "acquisition", "sigma_s": 0.01})  # has no spectrum
    inside = frequency[1:-1]
    np.testing.assert_allclose(named_density((excess, walk), 4, inside, interval), 2.0 * interval * 4e-4, rtol=1e-12)
    assert not named_density((excess,), 3, inside, interval).any()
    coloured = make_effect("noise_coloured", {"where": "magnetometer", "sigma_V": (0.01, 0.02, 0.03), "tau_s": 1.0})
    total = np.trapezoid(named_density((coloured,), 5, frequency, interval), frequency)
    np.testing.assert_allclose(total, 9e-4, rtol=1e-4)


def test_error_of_a_block_mean_is_that_of_its_covariance() -> None:
    noise = ChannelNoise(white=1e-4, parts=((3e-4, 0.9),))
    at = 0.25 * np.arange(40)
    covariance = noise.autocovariance(at[:, None] - at[None, :])
    np.testing.assert_allclose(block_error(noise, 40, 0.25), np.sqrt(covariance.sum()) / 40, rtol=1e-12)
    np.testing.assert_allclose(block_error(ChannelNoise(4e-4), 100, 0.25), 0.002, rtol=1e-12)


def map_axes(count: int, rng: np.random.Generator) -> tuple[Axis, Axis]:
    across, up = rng.random(count), rng.random(count)
    return Axis("q6", "deg", across, ()), Axis("q5", "deg", up, ())


def test_maps_show_a_mean_in_its_standard_errors_and_empty_cells_as_nothing() -> None:
    across = Axis("q6", "deg", np.array([0.1, 0.1, 0.9, 0.9, 0.9]), ())
    up = Axis("q5", "deg", np.array([0.9, 0.9, 0.1, 0.1, 0.1]), ())
    pixels = cells(np.array([-2.0, -2.0, 0.0, 2.0, 2.0]), across, up, (2, 2))
    assert pixels.shape == (2, 2, 4)
    assert pixels[..., 3].tolist() == [[255, 0], [0, 255]]
    assert pixels[0, 0, 2] > pixels[0, 0, 0]  # above and left: below zero is blue
    assert pixels[1, 1, 0] > pixels[1, 1, 2]  # above zero is red, and the reading left out (zero) does not count


def test_noise_alone_leaves_maps_within_two_standard_errors() -> None:
    rng = np.random.default_rng(2)
    horizontal, vertical = map_axes(6656, rng)
    down, across = shape_of(horizontal, vertical)
    assert down % 2 == across % 2 == 0  # the fold lies between two cells
    white = rng.standard_normal(6656)
    row = np.minimum(((1.0 - vertical.place) * down).astype(int), down - 1)
    column = np.minimum((horizontal.place * across).astype(int), across - 1)
    index = row * across + column
    score = np.bincount(index, white) / np.sqrt(np.bincount(index))
    inside = int((np.abs(score) < 1.96).sum())
    assert binom.cdf(inside, len(score), 0.95) > 1e-6
    assert binom.sf(inside, len(score), 0.95) > 1e-6
    pixels = cells(white, horizontal, vertical, (down, across)).reshape(-1, 4).astype(int)
    redder = pixels[:, 0] > pixels[:, 2]
    assert (redder == (score > 0)).mean() > 0.97  # the palest cells are as red as blue


def test_pixels_survive_in_a_drawing() -> None:
    pixels = np.random.default_rng(3).integers(0, 256, (5, 7, 4), dtype=np.uint8)
    drawing = Drawing(70.0, 50.0, "pixels")
    drawing.image(0.0, 0.0, 70.0, 50.0, pixels)
    data = str(drawing).partition("data:image/png;base64,")[2].partition('"')[0]
    read = matplotlib.image.imread(BytesIO(b64decode(data)), format="png")
    np.testing.assert_array_equal(np.round(255 * read).astype(np.uint8), pixels)


def test_scales_place_and_tick() -> None:
    linear = Scale(0.0, 13.4, 100.0, 234.0)
    assert linear.at(6.7) == pytest.approx(167.0)
    assert linear.ticks() == [0.0, 5.0, 10.0]
    log = Scale(0.03, 40.0, 0.0, 10.0, log=True)
    assert log.ticks() == [0.1, 1.0, 10.0]
    assert log.at(np.sqrt(0.03 * 40.0)) == pytest.approx(5.0)


def test_a_drawing_escapes_its_words_and_breaks_lines_at_gaps() -> None:
    drawing = Drawing(10, 10, 'a "label" <b>')
    drawing.text(1, 2, "a < b & c")
    drawing.path(np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.0, np.nan, 1.0, 2.0]), "line")
    root = ElementTree.fromstring(str(drawing))
    assert root.attrib["aria-label"] == 'a "label" <b>'
    assert root[0].text == "a < b & c"
    assert root[1].attrib["d"] == "M0 0M2 1L3 2"


def test_names_of_bars_do_not_hang_over_the_left_edge() -> None:
    names = (
        "the direction and angle of joint7",
        "speed and acceleration of joint7",
        "the angle of joint7, once a turn",
    )
    drawings = [follow_bars([{"variable": name, "share": 0.5} for name in names]), posterior_bar(by_hand())]
    for x, words in re.findall(
        r'<text x="([^"]*)" y="[^"]*" class="name" text-anchor="end">([^<]*)<', "".join(drawings)
    ):
        assert float(x) > 7.0 * len(words)  # 13 pixels high, DejaVu Sans' letters are 6.6 wide in the mean


@pytest.mark.parametrize("high", [10.0, 1e3, 1e5, 1e9])
def test_the_values_beside_a_spectrum_keep_apart(high: float) -> None:
    drawing, y = Drawing(300, 140, "a panel"), Scale(0.8, high, 120.0, 0.0, log=True)
    _frame(drawing, Scale(0.001, 2.0, 40.0, 298.0, log=True), y)
    at = sorted(float(each) for each in re.findall(r'y="([\d.]+)" class="tick" text-anchor="end"', str(drawing)))
    assert len(at) >= 2
    assert min(np.diff(at)) >= 11.5  # the height of a tick's letters
