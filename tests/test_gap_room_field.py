"""A magnetic field that stands in the room is one thing, however many dipoles could be fitted to it."""

from __future__ import annotations

import numpy as np
import pytest
from whitened_examples import data, discrepancies, unexplained  # noqa: F401

from estimators.gap.data.projection import project
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.discrepancy import Discrepancies, weighed
from estimators.gap.evidence.static_field import SPHERES, static_fields
from estimators.gap.hypotheses.sources import MAGNETIC, Source, sources
from rig.arrays import Array


def cable(position: Array) -> Array:
    """(n, 3) the field of a current in a straight cable, half a metre below a path about the origin."""
    along, through = np.array([0.3, 0.95, 0.0]) / np.hypot(0.3, 0.95), np.array([0.2, 0.0, position[:, 2].min() - 0.5])
    way = position - through
    way = way - np.outer(way @ along, along)
    return np.asarray(np.cross(along, way) / np.sum(way**2, axis=1)[:, None])


def of_field(data: WhitenedData, field: Array) -> Array:
    """(c n,) whitened: what a field (n, 3) along the base's axes does, beside the calibration."""
    source = magnetic(data)
    return project(data.absorbed, np.einsum("icn,ni->cn", source.series, field).ravel())


def magnetic(data: WhitenedData) -> Source:
    (found,) = [each for each in sources(data) if each.name == MAGNETIC]
    return found


@pytest.mark.parametrize("name", SPHERES)
def test_a_cable_is_charges_around_the_path(data: WhitenedData, name: str) -> None:
    """Outside the wider sphere, of twice the path's radius, a cable is not; of its square all but a thousandth."""
    terms = {each.course: each for each in static_fields(data.absorbed, magnetic(data), data.base.position, 0.0)}
    change = of_field(data, cable(data.base.position))
    held = terms[name].along(change[:, None])[:, 0]
    assert 0.999 < float(np.sum(held**2 / terms[name].values)) / float(change @ change) < 1.0 + 1e-9


def test_a_static_field_leads_where_a_cable_is(data: WhitenedData, discrepancies: Discrepancies) -> None:
    """Forty times the noise: no other course of the field is as short."""
    change = of_field(data, cable(data.base.position))
    noise = np.random.default_rng(1).standard_normal(len(change))
    left = project(data.absorbed, 40.0 * change / np.linalg.norm(change) + noise)
    leading = weighed(unexplained(left), discrepancies)[0].term
    assert leading.source == MAGNETIC
    assert leading.course in SPHERES


def test_without_a_path_there_is_none(data: WhitenedData) -> None:
    still = np.zeros_like(data.base.position)
    assert static_fields(data.absorbed, magnetic(data), still, 0.0) == []
    assert static_fields(data.absorbed, magnetic(data), np.zeros((0, 3)), 0.0) == []
