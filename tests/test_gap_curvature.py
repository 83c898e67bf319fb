"""Widths where an effect is not straight over them, against densities whose moments are known."""

from __future__ import annotations

import numpy as np
import pytest

from estimators.gap.report.curvature import Ray, is_curved
from rig.arrays import Array
from rig.effects import EFFECTS


class Split(Ray):
    """A density that is normal to either side, of widths 1 and 2, with a second parameter that follows squared."""

    def at(self, place: float, along: Array) -> tuple[float, Array]:
        width = 2.0 if place > 0.0 else 1.0
        return -0.5 * (place / width) ** 2, np.array([place, place**2])


class Normal(Ray):
    def at(self, place: float, along: Array) -> tuple[float, Array]:
        return -0.5 * place**2, place * along


def test_a_split_normal_has_its_own_second_moment() -> None:
    """(1 + 8) / (1 + 2) = 3 about its mode; the square's is 3 (1 + 32) / (1 + 2) = 33. Beyond four narrow widths,
    two wide ones, the wide side is guessed: a tenth of the square, a third of the square's may come of that."""
    ray = Split(None, 0, np.array([0]))  # type: ignore[arg-type]
    along = np.array([1.0, 0.0])
    found = ray.second_moment(along, np.array([0, 1]), ray.at(0.0, along))
    assert found[0, 0] == pytest.approx(3.0, rel=0.1)
    assert found[1, 1] == pytest.approx(33.0, rel=0.33)


def test_a_normal_one_stays() -> None:
    along = np.array([0.7, -0.2, 1.5])
    own = np.array([0, 2])
    ray = Normal(None, 0, np.array([0]))  # type: ignore[arg-type]
    np.testing.assert_allclose(ray.second_moment(along, own, ray.at(0.0, along)), np.outer(along[own], along[own]))


def test_places_and_times_are_curved_and_phases_and_tones_are_not() -> None:
    curved = {(name, item.name) for name, each in EFFECTS.items() for item in each.parameters() if is_curved(item)}
    assert {("base_dipole", "position_m"), ("bias_warmup", "tau_s")} <= curved
    assert not any(name in ("phase_rad", "freq_Hz", "direction") for _, name in curved)
