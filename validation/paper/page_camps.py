"""The page's part on Camps et al.: Tables 1 to 4, Figures 4 to 7, and turns about three axes."""

from __future__ import annotations

import math
from collections.abc import Iterator

from validation.markdown import table_of
from validation.paper.camps_rotations import told
from validation.paper.compare import Comparison
from validation.paper.published import ellipsoid_table
from validation.paper.rows import published_rows


def camps_section(comparison: Comparison, folder: str) -> Iterator[str]:
    """Its blocks; the pictures are in ``folder``, beside the page."""
    yield "## Tables 1 to 4 of [2]"
    yield (
        "The rig's truth is the mean of the three nine-parameter tests; the estimator and its start are the paper's,"
        " with 600 readings of a tumble by hand each. The paper does not state its noise: it is set so that the median"
        " parameter scatters as in the three tests. Gains are named by row and column of the symmetric matrix of (6)."
    )
    yield f"![The three tests beside the rig]({folder}/camps.png)"
    for table in comparison.tables("camps"):
        yield f"### Table {table}: {ellipsoid_table(table).title}"
        yield published_rows(comparison.table("camps", table))
    yield "### Figures 4 to 7: the directions seen, and the ellipsoids"
    yield (
        "One tumble of the rig. Left the directions on the sphere, right by the angles of (3), with what is not yet"
        " seen shaded. Below, the readings with the ellipsoid that fits them, and corrected."
    )
    yield f"![Directions of one tumble]({folder}/coverage.png)"
    yield f"![Readings with their ellipsoid, raw and corrected]({folder}/ellipsoids.png)"
    yield from _rotations()


def _rotations() -> Iterator[str]:
    yield "## The least procedure of [2], Figure 3: turns about three axes"
    yield (
        "A full turn about each of the sensor's axes (`axis-rotations`; the scenario is `camps2009-rotations`), 600"
        " readings with the noise above, beside a tumble by hand. The worst standard deviation of nine parameters, by"
        " the Cramer-Rao bound; `rig bound camps2009-rotations` has them all."
    )
    rows = [
        (
            one.maneuver,
            one.sensor,
            f"{one.gain:.2%}" if math.isfinite(one.gain) else "–",
            f"{1e3 * one.offset:.1f} mV",
            f"{one.condition:.3g}" if one.condition < 1e9 else "singular",
            ", ".join(one.untold) or "–",
        )
        for one in told()
    ]
    titles = (
        "maneuver",
        "sensor",
        "gains and cross terms, of the largest gain",
        "offsets",
        "condition",
        "cannot be told",
    )
    yield table_of(titles, rows)
