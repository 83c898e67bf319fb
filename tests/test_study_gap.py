"""The rig whose gap is like the paper's: its fit errors and its scatter at once, and whether the page is up to date."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

import scenarios
from rig.channels import SENSORS
from rig.errors import RigError
from scenarios.plots.style import save
from validation.paper.dip import dip_argument
from validation.paper.renk import spread_limits
from validation.paper.renk_text import misfits
from validation.paper.twin import SCENARIO, settled, spread_ratios, stray_fields, subsets_of_twin
from validation.paper.twin_page import (
    DIAGNOSIS,
    FOLDER,
    PAGE,
    PICTURE,
    from_earth,
    make_gap_page,
    meets,
    page,
)
from validation.plots.gap import gap_figure

DOCS = Path(__file__).parents[1] / "docs"


def test_fit_errors_and_their_noise_like_part_are_the_papers() -> None:
    """The paper prints the accelerometers' to half a millivolt; the magnet was fitted to 1 %, its grid is 1e-4 m."""
    published = [row for sensor in SENSORS for row in misfits(sensor)]
    for paper, rig in zip(published, subsets_of_twin().channels, strict=True):
        assert rig.fit_error == pytest.approx(paper.fit_error, rel=0.02, abs=5e-4)
        # Two 95 % intervals of one value overlap but for one case in 180 (5.5e-3 at equal widths), six of them here.
        assert rig.noise_low < paper.noise_high
        assert paper.noise_low < rig.noise_high


def test_the_scatter_is_the_papers_but_for_gravitys_elevation() -> None:
    """Of 25 ratios one lies beyond the 95 % on average; more than five do so with a probability of 1 %."""
    low, high = spread_limits()
    ratios = spread_ratios(subsets_of_twin())
    assert len(ratios) == 25
    beyond = {name for name, ratio in ratios.items() if not low < ratio < high}
    assert ("7", "phi_deg") in beyond
    assert len(beyond - {("7", "phi_deg")}) <= 5


def test_the_scenarios_truth_gives_tables_5_and_10() -> None:
    scenario = scenarios.load(SCENARIO)
    made = settled(scenario)
    for sensor, truth in scenario.truth.sensors.items():
        wanted = made.truth.sensors[sensor]
        # The file is rounded to five digits.
        np.testing.assert_allclose(truth.sensitivity, wanted.sensitivity, atol=1e-4)
        np.testing.assert_allclose(truth.offset, wanted.offset, atol=1e-4)
        np.testing.assert_allclose(truth.axes, wanted.axes, atol=1e-4)
    towards = scenario.rig.environment.magnetic_direction
    np.testing.assert_allclose(towards, made.rig.environment.magnetic_direction, atol=1e-4)


def test_magnets_at_other_places_do_as_well_and_iron_in_the_forearm_does_not() -> None:
    found = {field.name: meets(field) for field in stray_fields()}
    assert sum(like for name, like in found.items() if "magnet" in name) == 4
    assert not found["a field fixed in the forearm"]


def test_the_page_is_up_to_date(tmp_path: Path) -> None:
    """Everything on it but the diagnosis is made again."""
    document = json.loads((DOCS / FOLDER / DIAGNOSIS).read_text(encoding="utf-8"))
    assert document["recordings"] == [SCENARIO]
    assert (DOCS / PAGE).read_text(encoding="utf-8") == page(document), "stale: run `rig study gap -o docs`"
    save(gap_figure(subsets_of_twin()), tmp_path / PICTURE)
    made, kept = imread(tmp_path / PICTURE), imread(DOCS / FOLDER / PICTURE)
    assert made.shape == kept.shape
    assert (np.abs(made - kept).max(axis=2) > 0.1).mean() < 1e-3, "stale: run `rig study gap -o docs`"


def test_another_diagnosis_is_told_as_it_is() -> None:
    document = json.loads((DOCS / FOLDER / DIAGNOSIS).read_text(encoding="utf-8"))
    text = page({**document, "verdict": "no-gap", "causes": [], "closed": {**document["closed"], "value": None}})
    assert "**no-gap**" in text
    assert "closes" not in text


def test_one_magnet_makes_the_dip_too() -> None:
    """From the Earth's own field; of the others none is added to that one."""
    [one] = [field for field in stray_fields() if from_earth(field)]
    assert meets(one)
    # The simultaneous fit's phi, which the search took to a few hundredths of a degree.
    assert one.dip_deg == pytest.approx(dip_argument().found_deg, abs=0.05)


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "none").write_text("")
    with pytest.raises(RigError, match="cannot be made"):
        make_gap_page(tmp_path / "none")
