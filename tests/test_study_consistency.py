"""Consistency studies: the trial against plain fits, the summary against plain arithmetic, and the verdicts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from scipy.stats import binomtest, chi2

import scenarios
from estimators.known_angle.fit import fit_sensor
from estimators.known_angle.statistics import Statistics
from rig.channels import ACCELEROMETER
from rig.effects import make_effect
from rig.errors import RigError
from scenarios.scenario import Scenario
from scenarios.studies import consistency
from scenarios.studies.coordinates import Coordinates
from scenarios.studies.error_summary import Cell, Summary
from scenarios.studies.intervals import clopper_pearson
from scenarios.studies.settings import Settings, expected, increments
from scenarios.studies.store import StudyFolder
from scenarios.studies.verdict import COARSEST, departures, verdicts
from scenarios.workers import Workers

COUNTS = (100, 300, 900, 2500, 6656)


@pytest.fixture(scope="module")
def settings() -> Settings:
    # Five random orders instead of twenty: fewer and larger trials are quicker.
    return replace(Settings.of(scenarios.load("renk2005-table2"), COUNTS, draws=400), block=80)


@pytest.fixture(scope="module")
def table(settings: Settings, tmp_path_factory: pytest.TempPathFactory) -> pa.Table:
    folder = StudyFolder.begin(tmp_path_factory.mktemp("consistency") / "study", "consistency", settings)
    return consistency.run(settings, folder, Workers(0))


@pytest.fixture(scope="module")
def summary(settings: Settings, table: pa.Table) -> Summary:
    return Summary.of(settings, table)


def rows(table: pa.Table, order: str, method: str, factor: float, count: int) -> pa.Table:
    chosen = [
        line["order"] == order
        and line["method"] == method
        and line["noise_factor"] == factor
        and line["count"] == count
        for line in table.select(["order", "method", "noise_factor", "count"]).to_pylist()
    ]
    return table.filter(pa.array(chosen))


def test_a_row_is_what_a_plain_fit_finds(settings: Settings) -> None:
    """The first draw of a block, fitted by ``fit_sensor``: both searches end within 1e-6 of a standard deviation."""
    order, block = settings.place(settings.blocks)
    assert (order, block) == ("every-kth", 0)
    found = consistency.trial(settings, settings.blocks)
    poses, sums = expected(settings), increments(settings, order, block)[ACCELEROMETER]
    seed = settings.seeds(order, block).spawn(3)[1]
    noise = poses.noise[ACCELEROMETER]
    cross, square = sums.draw(np.random.default_rng(seed), noise, settings.block)
    for index in (0, 3):
        statistics = Statistics(COUNTS[index], sums.gram[index], cross[index, 0], np.diag(square[index, 0]))
        for method in ("separate", "simultaneous"):
            truth = poses.truth[ACCELEROMETER]
            fit = fit_sensor(statistics, 9.8, method=method, noise=noise, field_points=truth.fields[0])
            coordinates = Coordinates(truth, method)
            line = next(
                line
                for line in found.to_pylist()
                if (line["method"], line["count"], line["noise_factor"], line["draw"])
                == (method, COUNTS[index], 1.0, 0)
            )
            bound = np.sqrt(coordinates.bound(sums.gram[index], noise).diagonal())
            error = [line[f"error_{name}"] for name in coordinates.names]
            assert line["told"]
            assert error[0] == pytest.approx(fit.parameters.sensitivity[0] - truth.sensitivity[0], abs=1e-4 * bound[0])
            assert error[1] == pytest.approx(fit.parameters.offset[0] - truth.offset[0], abs=1e-4 * bound[1])


def test_the_table_is_complete(settings: Settings, table: pa.Table) -> None:
    fits = 400 * len(COUNTS) * 2 * 2 * 3
    assert table.num_rows == fits
    assert settings.trials == 15
    separate = table.filter(pa.compute.equal(table["method"], "separate"))
    assert separate["error_field_phi_deg"].null_count == separate.num_rows
    assert separate["error_field2_phi_deg"].null_count == 0
    assert sorted(set(rows(table, "random", "separate", 10.0, 900)["draw"].to_pylist())) == list(range(400))


def test_the_summary_is_plain_arithmetic(settings: Settings, table: pa.Table, summary: Summary) -> None:
    errors = rows(table, "every-kth", "simultaneous", 10.0, 900)["error_offset1"].to_numpy().astype(float)
    [cell] = [
        cell
        for cell in summary.cells
        if (cell.order, cell.method, cell.noise_factor, cell.count, cell.parameter)
        == ("every-kth", "simultaneous", 10.0, 900, "offset1")
    ]
    assert cell.truth == 2.45
    assert cell.unit == "V"
    assert cell.draws == 400
    assert cell.bias == pytest.approx(errors.mean())
    assert cell.bias_std == pytest.approx(errors.std(ddof=1) / 20.0)
    assert cell.rmse == pytest.approx(np.sqrt(np.mean(errors**2)))
    assert cell.ratio == pytest.approx(cell.rmse / cell.bound)
    sum_of_squares = 400 * cell.ratio**2
    assert sum_of_squares / cell.ratio_low**2 == pytest.approx(chi2.ppf(0.975, 400))
    assert sum_of_squares / cell.ratio_high**2 == pytest.approx(chi2.ppf(0.025, 400))
    exact = binomtest(round(400 * cell.coverage), 400).proportion_ci(0.95, "exact")
    assert (cell.coverage_low, cell.coverage_high) == pytest.approx((exact.low, exact.high))
    # The bound of sqrt(n) poses spread evenly: S g is told to about sigma / sqrt(n / 3).
    assert cell.bound == pytest.approx(0.134 / 30.0, rel=0.05)


def test_clopper_pearson_holds_at_its_ends() -> None:
    low, high = clopper_pearson(np.array([0, 10]), 10)
    assert low[0] == 0.0
    assert high[1] == 1.0
    assert high[0] == pytest.approx(1.0 - 0.025**0.1)


def test_both_fits_are_consistent_and_efficient(summary: Summary) -> None:
    """The study's answer. Each of its four verdicts is wrong by chance in one of 250 studies (four kinds of tests, each
    with a false alarm in a thousand studies)."""
    found = verdicts(summary)
    assert [verdict.word for verdict in found] == ["consistent and efficient"] * 4
    for verdict in found:
        assert "Bias: " in verdict.sentences[0]
        assert any(f"With 400 draws a bias of 0.{digit}" in verdict.sentences[-1] for digit in (24, 25, 26))


def test_the_first_samples_tell_little_and_their_errors_are_large(summary: Summary) -> None:
    """100 samples of the beginning hardly turn joint 5: their bound is not small, and falls faster than 1/sqrt(n)."""
    cells = {
        (cell.order, cell.count): cell
        for cell in summary.cells
        if (cell.method, cell.noise_factor, cell.parameter) == ("separate", 1.0, "sensitivity1")
    }
    assert not cells["first", 100].small
    assert cells["first", 100].told < 0.01
    assert cells["every-kth", 100].small
    assert cells["first", 300].bound / cells["first", 6656].bound > 3.0 * np.sqrt(6656 / 300)
    assert cells["every-kth", 300].bound / cells["every-kth", 6656].bound == pytest.approx(
        np.sqrt(6656 / 300), rel=0.02
    )


def test_a_slope_comes_with_an_interval_that_knows_the_correlation(summary: Summary, table: pa.Table) -> None:
    """Against the bootstrap over draws: 300 resamples tell a standard error to 4 %, five of which are allowed."""
    [rate] = [
        rate
        for rate in summary.rates
        if (rate.method, rate.order, rate.noise_factor, rate.parameter) == ("separate", "every-kth", 1.0, "offset2")
    ]
    errors = np.stack([rows(table, "every-kth", "separate", 1.0, n)["error_offset2"].to_numpy() for n in COUNTS])
    rng = np.random.default_rng(0)
    resampled = []
    for _ in range(300):
        chosen = errors[:, rng.integers(0, 400, 400)].astype(float)
        resampled.append(np.polyfit(np.log(COUNTS), 0.5 * np.log(np.mean(chosen**2, axis=1)), 1)[0])
    assert rate.slope == pytest.approx(np.polyfit(np.log(COUNTS), 0.5 * np.log(np.mean(errors**2, axis=1)), 1)[0])
    assert rate.slope_std == pytest.approx(np.std(resampled), rel=0.2)
    assert rate.bound_slope == pytest.approx(-0.5, abs=0.01)


def test_an_effect_the_model_lacks_makes_it_inconsistent() -> None:
    """A wrong angle of joint 1 shifts the field by as much, whatever the number of samples."""
    scenario = scenarios.load("renk2005-magnetometer").with_effects(
        [make_effect("joint_offset", {"where": "joint5", "offset_rad": 0.01})]
    )
    settings = Settings.of(scenario, (200, 1000, 6656), draws=100, noise_factors=(1.0,), orders=("every-kth",))
    parts = [consistency.trial(settings, number) for number in range(settings.trials)]
    found = verdicts(Summary.of(settings, pa.concat_tables(parts)))
    assert [verdict.word for verdict in found] == ["not consistent", "not consistent"]
    assert "without an explanation" in found[0].sentences[0]


def test_too_few_draws_decide_nothing() -> None:
    settings = Settings.of(scenarios.load("renk2005-table2"), (200, 6656), draws=20, orders=("every-kth",))
    parts = [consistency.trial(settings, number) for number in range(settings.trials)]
    found = verdicts(Summary.of(settings, pa.concat_tables(parts)))
    assert {verdict.word for verdict in found} == {"undecided"}
    assert 5.0 / np.sqrt(20) > COARSEST


def cell(**changes: object) -> Cell:
    plain = Cell(
        *(ACCELEROMETER, "separate", "first", 1.0, 100, "offset1", "V", 2.45, 2000, 1.0, 1e-3, 0.01),
        *(0.0, 2e-5, 0.0, 1e-3, 1.0, 0.97, 1.03, 0.95, 0.94, 0.96),
    )
    return replace(plain, **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"bias": 6e-5}, None),
        ({"bias": 8e-5}, "chance"),
        ({"bias": 2e-4}, "unexplained"),
        ({"bias": 2e-4, "bias_expected": 1.9e-4}, "curvature"),
        ({"bias": 2e-4, "bias_expected": -1.9e-4}, "unexplained"),
        ({"bias": 2e-4, "largest_bound": 0.2}, "large errors"),
    ],
)
def test_a_bias_is_given_a_reason(changes: dict[str, object], reason: str | None) -> None:
    found = list(departures([cell(**changes)], 4000))
    assert [departure.reason for departure in found] == ([] if reason is None else [reason])


def test_seeds_do_not_depend_on_what_else_is_studied(settings: Settings) -> None:
    """The same block of the same order gives the same errors in a smaller study."""
    alone = replace(settings, orders=("random",), methods=("simultaneous",))
    both = consistency.trial(settings, 2 * settings.blocks + 4)
    one = consistency.trial(alone, 4)
    assert settings.place(2 * settings.blocks + 4) == alone.place(4) == ("random", 4)
    part = both.filter(pa.compute.equal(both["method"], "simultaneous"))
    assert part["error_sensitivity1"].to_pylist() == one["error_sensitivity1"].to_pylist()


def test_the_random_order_differs_from_block_to_block(settings: Settings) -> None:
    grams = [increments(settings, "random", block)[ACCELEROMETER].gram[0] for block in (0, 1)]
    assert np.abs(grams[0] - grams[1]).max() > 1e-3
    same = [increments(settings, "first", block)[ACCELEROMETER].gram[0] for block in (0, 1)]
    assert np.array_equal(*same)


def unsuitable() -> dict[str, tuple[Scenario, dict[str, object], str]]:
    table2 = scenarios.load("renk2005-table2")
    coloured = table2.with_effects([make_effect("noise_excess", {"where": "accel1", "extra_sigma": 1.0})])
    return {
        "noise": (coloured, {}, "effect noise_excess changes the noise, expected white noise"),
        "silent": (table2.scaled_noise(0.0), {}, "the accelerometer has a channel without noise"),
        "counts": (table2, {"counts": (500, 100)}, "expected growing numbers of samples"),
        "few": (table2, {"counts": (10, 100)}, "expected growing numbers of samples from 24"),
        "many": (table2, {"counts": (100, 9000)}, "found 9000 samples, expected at most the scenario's 6656"),
        "first": (table2, {"first": 7000}, "expected two or more, from fewer than the 6656"),
        "factor": (table2, {"noise_factors": (0.0,)}, "noise factors: found"),
        "order": (table2, {"orders": ("last",)}, "unknown order 'last'"),
        "method": (table2, {"methods": ("joint",)}, "unknown method 'joint'"),
        "draws": (table2, {"draws": 0}, "draws: found 0"),
    }


@pytest.mark.parametrize("case", list(unsuitable()))
def test_what_does_not_suit_is_refused(case: str) -> None:
    scenario, options, message = unsuitable()[case]
    with pytest.raises(RigError, match=message.replace("(", r"\(")):
        Settings.of(scenario, **{"counts": 5, **options})  # type: ignore[arg-type]


def test_a_digital_sensor_has_its_own_units() -> None:
    scenario = scenarios.load("renk2005-table2")
    digital = scenario.with_acquisition(units=("m_s2", "uT"), bits=None, range_V=None)
    assert expected(Settings.of(scenario, (100,))).units == {"accelerometer": ("V", "m_s2")}
    assert expected(Settings.of(digital, (100,))).units == {"accelerometer": ("m_s2", "m_s2")}
