"""The report of a diagnosis: residuals, spectra, maps and the page."""

from __future__ import annotations

import re
from io import BytesIO
from xml.etree import ElementTree

import matplotlib.image
import numpy as np
import pytest
from diagnosed_recordings import backlash, by_hand, cause, recorded
from scipy.stats import binom, chi2

from estimators.gap import Diagnosis, Estimate
from estimators.gap.channel_noise import ChannelNoise
from rig.effects import make_effect
from rig.recording import Recording
from scenarios.gap_report import GapResiduals, diagnosis_tables, gap_residuals, page, summary_table
from scenarios.gap_report.curves import block_error, density, floor_density, named_density
from scenarios.gap_report.maps import Axis, axis_pairs, cells, shape_of
from scenarios.gap_report.residuals import diagnosed_effects
from scenarios.gap_report.svg import Drawing, Scale, png
from scenarios.gap_report.words import cause_title, closed_words, estimate_for_people, estimate_words, headline
from scenarios.report import show

#: Two readings of the same voltage differ by the converter's rounding: sqrt(2) 1.2207 mV / sqrt(12).
ROUNDING_V = np.sqrt(2.0 / 12.0) * 20.0 / 2**14


@pytest.fixture(scope="module")
def small() -> tuple[Recording, Recording]:
    return recorded(backlash())


@pytest.fixture(scope="module")
def residuals(small: tuple[Recording, Recording]) -> GapResiduals:
    return gap_residuals(small[0], by_hand(), small[1])


def test_modelled_causes_leave_what_the_same_noise_leaves_without_them(residuals: GapResiduals) -> None:
    clean, locked = recorded()  # the same seed: the same noise
    nothing = gap_residuals(clean, by_hand("no-gap", causes=()), locked)
    assert nothing.after is None
    assert nothing.white_after is None
    assert residuals.after is not None
    # At rest and at a reversal the encoder, read every 0.1 s, and the simulator, stepped every 0.01 s, differ about the
    # direction of travel.
    slow = np.abs(np.gradient(residuals.recording.q[:, 4])) < 0.02  # type: ignore[index]
    away = ~slow & (np.arange(len(clean)) > 0)
    assert away.mean() > 0.9
    gap = np.sqrt(np.mean((residuals.before - nothing.before)[away] ** 2, axis=0))
    missed = np.sqrt(np.mean((residuals.after - nothing.before)[away] ** 2, axis=0))
    assert (gap > 20.0 * ROUNDING_V).all()
    assert (missed < ROUNDING_V + 0.02 * gap).all(), (missed, gap)  # those samples move the calibration a little


def test_whitened_residuals_are_white_only_once_the_cause_is_modelled(residuals: GapResiduals) -> None:
    assert residuals.white_after is not None
    count = residuals.white_after.size
    # The 600 samples fluctuate, and so does the floor of about 1,400; 28 parameters are fitted. Six standard deviations
    # of a mean square: a failure in 1e9 runs of other seeds.
    width = 6.0 * np.sqrt(2.0 / count * (1.0 + 600.0 / 1400.0)) + 28.0 / count
    assert abs(float(np.mean(residuals.white_after**2)) - 1.0) < width
    assert float(np.mean(residuals.white_before**2)) > 1.0 + 3.0 * width


def test_named_noise_is_whitened_and_defects_are_left_out() -> None:
    noisy = make_effect("noise_excess", {"where": "mag2", "extra_sigma": 0.03})
    spikes = make_effect("outliers", {"where": "acquisition", "share": 0.003})
    run, locked = recorded(noisy, spikes)
    causes = (
        cause("noise_excess", "mag2", extra_sigma=(0.03, 0.001, "V")),
        cause("outliers", "acquisition", share=(0.003, 0.001, "relative")),
    )
    found = gap_residuals(run, by_hand(causes=causes), locked)
    assert found.white_after is not None
    spiked = np.abs(found.before) > 0.3  # half a volt off, where the noise has 0.03 V
    assert spiked.sum() >= 3
    assert found.left_out[spiked].all()
    assert found.left_out.sum() <= spiked.sum() + 2
    mean_square = float(np.mean(found.white_after[~found.left_out[:, 4], 4] ** 2))
    assert abs(mean_square - 1.0) < 6.0 * np.sqrt(2.0 / 600.0)  # fitted: nearer than that
    assert float(np.mean(found.white_before[~found.left_out[:, 4], 4] ** 2)) > 3.0


def test_causes_become_effects_with_vectors_and_names() -> None:
    causes = (
        cause("mounting_slip", "mount", rotation_rad=((1e-3, 0.0, 2e-3), (1e-4,) * 3, "rad"), at_s=(31.0, None, "s")),
        cause("channel_crosstalk", "mag1", source=("accel3", None, "name"), coefficient=(0.01, 1e-3, "relative")),
    )
    slip, crosstalk = diagnosed_effects(by_hand(causes=causes))
    assert slip == make_effect("mounting_slip", {"where": "mount", "rotation_rad": (1e-3, 0.0, 2e-3), "at_s": 31.0})
    assert crosstalk == make_effect("channel_crosstalk", {"where": "mag1", "source": "accel3", "coefficient": 0.01})


def test_values_that_no_effect_can_have_are_moved_to_their_bounds() -> None:
    (clipped,) = diagnosed_effects(by_hand(causes=(cause("saturation", "accel1", level=(1e13, 1.0, "V")),)))
    assert clipped == make_effect("saturation", {"where": "accel1", "level": 1e12})


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


def test_axes_of_maps_part_the_directions_of_travel(residuals: GapResiduals) -> None:
    (roll, pitch), (yaw, flat) = axis_pairs(residuals)
    assert (roll.name, pitch.name, yaw.name, flat.name) == ("q6", "q5", "q1", "q5")
    assert pitch.folded
    assert yaw.folded
    assert not flat.folded
    q5 = residuals.recording.q[:, 4]  # type: ignore[index]
    away = np.abs(np.gradient(q5)) > 0.02
    assert away.mean() > 0.9
    assert ((pitch.place < 0.5) == (np.gradient(q5) > 0))[away].all()
    for axis in (roll, pitch, yaw, flat):
        assert axis.place.min() >= 0.0
        assert axis.place.max() <= 1.0


def test_pixels_survive_as_png() -> None:
    pixels = np.random.default_rng(3).integers(0, 256, (5, 7, 4), dtype=np.uint8)
    read = matplotlib.image.imread(BytesIO(png(pixels)), format="png")
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


AMBIGUOUS = (
    cause("joint_offset", "joint5", ({"effect": "joint_offset", "where": "joint2"},), offset_rad=(0.01, 1e-4, "rad")),
)
SHOWN = {
    "named": by_hand(),
    "ambiguous": by_hand("ambiguous", AMBIGUOUS),
    "unknown": by_hand("unknown", remainder="structured"),
    "nothing named": by_hand("unknown", (), "structured"),
    "imitated": by_hand("unknown", AMBIGUOUS),
    "no-gap": by_hand("no-gap", ()),
}


@pytest.mark.parametrize("case", SHOWN)
def test_the_page_is_whole_and_needs_nothing_else(case: str, small: tuple[Recording, Recording]) -> None:
    diagnosis = SHOWN[case]
    text = page(diagnosis, gap_residuals(small[0], diagnosis, small[1]))
    assert text.startswith("<!DOCTYPE html>")
    assert "<script" not in text
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:)""", text)
    assert not re.search(r"url\(|@import|https?://(?!www\.w3\.org/2000/svg)", text)
    assert "default-src 'none'" in text
    drawings = re.findall(r"<svg.*?</svg>", text, flags=re.DOTALL)
    assert len(drawings) >= 4
    for drawing in drawings:
        root = ElementTree.fromstring(drawing)  # well formed
        assert root.attrib["aria-label"]
        numbers = [float(x) for x in re.findall(r' (?:x|y|x1|x2|y1|y2|width|height)="([^"]*)"', drawing)]
        assert np.isfinite(numbers).all()
    assert "nan" not in re.sub(r'"data:[^"]*"', "", text)
    for tag in ("main", "section", "figure", "table", "dl", "div", "h1", "h2", "h3", "p", "ul"):
        assert len(re.findall(rf"<{tag}[ >]", text)) == text.count(f"</{tag}>"), tag


def test_the_page_says_what_the_diagnosis_says(small: tuple[Recording, Recording], residuals: GapResiduals) -> None:
    text = page(by_hand(), residuals, without=("latency",))
    for words in ("Backlash of joint 5", "2.865 ± 0.023 deg", "97 %", "95–99", "q5 direction", "joint_offset (joint6)"):
        assert words in text, words
    assert "without latency in the catalogue" in text
    assert "accel1.sensitivity" in text
    assert "mag1.offset" not in text  # a tenth of a sigma is not worth a line
    ambiguous = page(by_hand("ambiguous", AMBIGUOUS), residuals)
    assert "joint offset of joint 2" in ambiguous
    unknown = page(by_hand("unknown", remainder="structured"), residuals)
    assert "More than noise. It follows:" in unknown
    assert "frequency, mag1" in unknown


def test_the_next_maneuver_is_shown_with_what_it_promises(residuals: GapResiduals) -> None:
    from dataclasses import replace

    one, other = ({"effect": "joint_offset", "where": where} for where in ("joint4", "joint5"))
    known = {"truth": one, "rival": other, "chi_square": 930.2, "low": 749.0, "high": 1111.0, "recorded_maneuver": 0.0}
    step = {"why": "q3 <tells> them apart", "maneuver": "joint 2 over 60 deg", "scenario": "small.next.toml"}
    step["separates"] = [known, {**known, "truth": other, "rival": one, "high": None}]  # type: ignore[assignment]
    text = page(replace(by_hand(), next=step), residuals)
    assert "q3 &lt;tells&gt; them apart" in text
    assert "Joint 2 over 60 deg" in text
    assert "rig sweep small.next.toml" in text
    assert "930 (749-1111)" in text
    assert "at least 749" in text


def test_a_hostile_name_stays_text(residuals: GapResiduals) -> None:
    text = page(by_hand(name="<script>alert(1)</script>"), residuals)
    assert "<script" not in text
    assert "&lt;script&gt;" in text


def test_one_sensor_and_tool_poses_have_a_page_too(small: tuple[Recording, Recording]) -> None:
    from dataclasses import replace

    from rig.arm import Arm
    from rig.simulate import quaternions

    run, locked = small
    poses = Arm.a465().poses(run.q)  # type: ignore[arg-type]
    quaternion = quaternions(poses.R_base_tool)
    tool = replace(run, q=None, tool_quaternion=quaternion, tool_position=poses.position)
    alone = replace(run, magnetometer=None, units={"accelerometer": "V"})
    slip = cause("bias_step", "accel1", volts=(0.01, 1e-3, "V"), at_s=(31.0, None, "s"))
    full = by_hand(causes=(slip,))
    half = replace(full, channels={name: full.channels[name] for name in ("accel1", "accel2", "accel3")})
    assert "attitude" in page(full, gap_residuals(tool, full, locked))
    text = page(half, gap_residuals(alone, half, locked))
    assert "accel3" in text
    assert ">mag1<" not in text


@pytest.mark.parametrize(
    ("estimate", "own", "people"),
    [
        (Estimate(0.05, 0.0004, "rad"), "0.05000 ± 0.00040 rad", "2.865 ± 0.023 deg"),
        (Estimate(0.003, 0.001, "relative"), "0.0030 ± 0.0010", "0.30 ± 0.10 %"),
        (Estimate(-0.5, None, "s"), "−0.5 s", ""),
        (Estimate("accel3", None, "name"), "accel3", ""),
        (
            Estimate((1e-3, -2e-3), (1e-4, 1e-4), "V"),
            "(0.00100 ± 0.00010, −0.00200 ± 0.00010) V",
            "(1.00 ± 0.10, −2.00 ± 0.10) mV",
        ),
        (Estimate((3.0, 4.0) * 5, (0.1,) * 10, "1/m"), "10 numbers, RMS 3.54 1/m", ""),
        (Estimate(2.0, 0.0, "Hz"), "2 Hz", ""),
    ],
)
def test_estimates_in_words(estimate: Estimate, own: str, people: str) -> None:
    assert estimate_words(estimate) == own
    assert estimate_for_people(estimate) == people


def test_titles_and_headlines() -> None:
    assert cause_title("backlash", "joint5") == "backlash of joint 5"
    assert cause_title("field_gradient", "base") == "field gradient"  # it has no other place
    assert closed_words(by_hand()) == "97 % (95–99)"
    assert headline(SHOWN["named"]) == "Backlash of joint 5, 2.865 ± 0.023 deg"
    assert headline(SHOWN["ambiguous"]).endswith(" (or joint offset of joint 2)")
    assert headline(SHOWN["unknown"]).startswith("Something that the catalogue does not have, beside backlash")
    assert "imitate" in headline(SHOWN["imitated"])


@pytest.mark.parametrize("case", SHOWN)
def test_tables_of_the_terminal(case: str, capsys: pytest.CaptureFixture[str]) -> None:
    diagnosis: Diagnosis = SHOWN[case]
    show(
        diagnosis_tables(diagnosis, {"accelerometer": "V", "magnetometer": "V"}), summary_table([diagnosis, diagnosis])
    )
    text = capsys.readouterr().out
    assert "accel1" in text
    assert "joint_offset (joint6)" in text
    assert text.count("small") >= 3
    if diagnosis.causes:
        assert "deg" in text
