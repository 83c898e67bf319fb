"""The drawings of a diagnosis' page: densities, block means, maps, and the SVG they are drawn with."""

from __future__ import annotations

import re
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from scipy.stats import binom, chi2

from estimators.gap.floor.channel_noise import ChannelNoise
from rig.effects import make_effect
from scenarios.gap_report import html
from scenarios.gap_report.curves import block_error, density, floor_density, label_decades, named_density
from scenarios.gap_report.maps import Axis, cells, shape_of
from scenarios.plots.inline_svg import inline_svg, page_panels
from scenarios.plots.style import style

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
    scores = cells(np.array([-2.0, -2.0, 0.0, 2.0, 2.0]), across, up, (2, 2))  # what is left out is zero
    np.testing.assert_allclose(scores, [[-2.0 * np.sqrt(2.0), np.nan], [np.nan, 2.0 * np.sqrt(2.0)]], rtol=1e-15)


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
    np.testing.assert_allclose(cells(white, horizontal, vertical, (down, across)).ravel(), score, rtol=1e-12)


def test_a_figure_of_a_page_escapes_its_words_and_is_the_same_every_time() -> None:
    drawings = []
    for _ in range(2):
        with style():
            figure, panels = page_panels((300.0, 150.0), 1, 2, (60.0, 5.0, 20.0, 40.0), (10.0, 0.0))
            for panel in panels.flat:
                panel.plot([0.0, 1.0], [2.0, 1.0])
                panel.set_xlabel("a < b & c z Q")
        drawings.append(inline_svg(figure, 'a "label" <b>'))
    assert drawings[0] == drawings[1]
    root = ElementTree.fromstring(drawings[0])
    assert root.attrib["aria-label"] == 'a "label" <b>'
    assert [each.text for each in root.iter() if each.tag.endswith("}text")].count("a < b & c z Q") == 2
    assert root.attrib["width"] == "225pt"  # 300 pixels


def test_drawings_of_a_page_share_no_names_and_find_their_own() -> None:
    with style():
        figure, panels = page_panels((300.0, 150.0), 1, 1, (60.0, 5.0, 20.0, 40.0))
        panels[0, 0].plot([0.0, 1.0], [2.0, 1.0])
    text = html.document("two alike", [inline_svg(figure, "one"), inline_svg(figure, "one")])
    first, second = (
        (set(re.findall(r' id="([^"]*)"', drawing)), set(re.findall(r'(?:href="#|url\(#)([^")]*)', drawing)))
        for drawing in re.findall(r"<svg.*?</svg>", text, flags=re.DOTALL)
    )
    assert first[0] >= first[1] > set()
    assert second[0] >= second[1] > set()
    assert not first[0] & second[0]


@pytest.mark.parametrize("high", [1.0, 10.0, 1e3, 1e5, 1e9])
def test_the_values_beside_a_spectrum_keep_apart(high: float) -> None:
    with style():
        figure, panels = page_panels((300.0, 186.0), 1, 1, (66.0, 12.0, 24.0, 42.0))
        panels[0, 0].plot([1e-3, 2.0], [0.8, high])
        label_decades(panels[0, 0])
        FigureCanvasAgg(figure).draw()
        low, top = panels[0, 0].get_ylim()
        places = [
            tick.get_window_extent() for tick in panels[0, 0].get_yticklabels() if low <= tick.get_position()[1] <= top
        ]
    assert len(places) >= 2
    assert all(below.y1 < above.y0 for below, above in pairwise(places))
