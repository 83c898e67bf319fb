"""The calibration that comes with a diagnosis: it covers the truth, whatever explains the gap."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosed_recordings import backlash, recorded, scenario
from scipy.special import chdtri

from estimators import calibrate, noise_floor
from estimators.calibration import Calibration
from estimators.gap import diagnose
from estimators.gap.data.tangent import stepped
from estimators.gap.report.corrected import Component, mixed, solved
from rig.effects import make_effect
from scenarios.comparison import compare

#: The chance that a test of coverage fails without a reason.
FALSE_FAILURE = 1e-4
#: The floor of a channel is learned from some 1,400 samples: its standard deviations are wrong by so much, 3 sigma.
OF_FLOOR = 1.0 + 3.0 / np.sqrt(2.0 * 1400.0)


def distance(calibration: Calibration) -> tuple[float, int]:
    """Squared distance from the truth in the calibration's own covariance, and its degrees of freedom."""
    total, freedom = 0.0, 0
    rows = compare(scenario().truth, calibration)
    for name, sensor in calibration.sensors.items():
        own = [row for row in rows if row.sensor == name]
        told = [index for index, row in enumerate(own) if row.error_sigmas is not None]
        sigma = np.sqrt(np.diag(sensor.covariance)[told])
        error = np.array([own[index].error_sigmas for index in told])
        correlation = sensor.covariance[np.ix_(told, told)] / np.outer(sigma, sigma)
        total += float(error @ np.linalg.solve(correlation, error))
        freedom += len(told)
    return total, freedom


@pytest.mark.parametrize("gap", ["two causes", "something that the catalogue does not have"])
def test_it_covers_the_truth(gap: str) -> None:
    """28 parameters, which the gap shifts by tens of sigmas in a plain calibration."""
    offset = make_effect("joint_offset", {"where": "joint5", "offset_rad": 0.03})
    causes = (backlash(), offset) if gap == "two causes" else ()
    run, locked = recorded(*causes)
    if not causes:
        q = np.array(run.q)
        q[:, 4] += 0.02 * np.sin(2.0 * np.pi * run.t / 17.0)  # an encoder that swings
        run = replace(run, q=q)
    found = diagnose(run, locked)
    assert found.calibration is not None
    plain = calibrate(run, noise=noise_floor(locked))
    square, freedom = distance(Calibration.from_text(found.calibration.to_text()))
    assert freedom >= 24
    assert distance(plain)[0] > 3.0 * square
    assert square < OF_FLOOR**2 * chdtri(freedom, FALSE_FAILURE)
    # nor is it so wide that it says nothing: of a true covariance the sum is small as rarely
    assert square > chdtri(freedom, 1.0 - FALSE_FAILURE)
    if not causes:
        assert found.posterior["other"] > 0.5


def test_a_mixture_has_the_mean_and_covariance_of_its_draws() -> None:
    centre = scenario().rig.pipeline
    rng = np.random.default_rng(0)
    size = 28
    scale = np.tile([*[1e-3] * 12, 1e-3, 1e-3], 2) * 0.1
    parts = []
    for weight in (0.7, 0.3):
        root = scale[:, None] * rng.standard_normal((size, size)) / np.sqrt(size)
        parts.append(
            Component(weight, stepped(centre, scale * rng.standard_normal(size)), np.zeros(size), root @ root.T)
        )
    mean, covariance = mixed(parts, centre)
    draws = np.concatenate(
        [
            rng.multivariate_normal(mixed([part], centre)[0], part.covariance, int(40_000 * part.weight))
            for part in parts
        ]
    )
    # Six standard errors of 40,000 draws
    np.testing.assert_allclose(draws.mean(axis=0), mean, atol=6.0 * np.sqrt(np.diag(covariance).max() / 40_000))
    np.testing.assert_allclose(np.var(draws, axis=0), np.diag(covariance), rtol=6.0 * np.sqrt(2.0 / 40_000) * 2.0)


def test_a_prior_widens_by_what_is_not_known_of_a_cause() -> None:
    rng = np.random.default_rng(1)
    columns = rng.standard_normal((200, 5))
    left = rng.standard_normal(200)
    precision = np.array([0.0, 0.0, 0.0, 4.0, 9.0])
    mean, covariance = solved(columns.T @ columns, columns.T @ left, precision, np.zeros(5), 3)
    # the same by integrating the two causes out of the readings' covariance
    inverse = np.linalg.inv(np.eye(200) + columns[:, 3:] / precision[3:] @ columns[:, 3:].T)
    information = columns[:, :3].T @ inverse @ columns[:, :3]
    np.testing.assert_allclose(covariance, np.linalg.inv(information), rtol=1e-9)
    np.testing.assert_allclose(mean, np.linalg.solve(information, columns[:, :3].T @ inverse @ left), rtol=1e-9)
    alone = np.linalg.inv(columns[:, :3].T @ columns[:, :3])
    assert (np.diag(covariance) > np.diag(alone)).all()
