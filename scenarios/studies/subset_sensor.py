"""The subsets of one sensor: their fits, their scatter beside the bound, and their fields."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.special import chdtrc

from estimators.batch import ManyFits, fit_many
from estimators.known_angle.agreement import common_field
from estimators.known_angle.fit import SensorFit, fit_sensor
from estimators.known_angle.identifiability import Information
from estimators.known_angle.model import Method, SensorParameters, columns_of_channels
from estimators.known_angle.reported import Reported, report
from estimators.known_angle.statistics import Statistics
from rig.arrays import Array
from rig.channels import CHANNELS_OF
from rig.units import parameter_unit
from scenarios.studies.coordinates import Coordinates
from scenarios.studies.intervals import spread_interval
from scenarios.studies.subset_results import FieldAgreement, SubsetChannel, SubsetParameter

#: A subset's three fields disagree where their chi-square is less probable than this.
DISAGREEMENT: Final = 0.01
#: Bounds from a pole within which an elevation folds over.
_NEAR_POLE: Final = 3.0


@dataclass(frozen=True, eq=False)
class SubsetsOfSensor:
    """One sensor's subsets.

    Attributes:
        name, unit, field_unit, magnitude: of the sensor, as of its calibration. where: the recording, for messages.
        whole: of all samples. parts: of the subsets. floor: (3,) known noise, or None.
    """

    name: str
    unit: str
    field_unit: str | None
    magnitude: float
    where: str
    whole: Statistics
    parts: Sequence[Statistics]
    floor: Array | None

    @cached_property
    def fit(self) -> SensorFit:
        """All samples, separately for each channel.

        Raises:
            RigError: they do not determine the fit.
        """
        return self._whole_fit("separate", self.floor)

    @cached_property
    def fits(self) -> ManyFits:
        """Each subset, likewise; errors as of ``fit``."""
        return _fit(self.parts, self.fit.parameters, self.fit.noise, "separate")

    def _whole_fit(self, method: Method, noise: Array | None) -> SensorFit:
        return fit_sensor(self.whole, self.magnitude, method=method, noise=noise, name=f"{self.where}: {self.name}")

    def parameters(self, method: Method) -> tuple[list[SubsetParameter], Array]:
        """The parameters of a method, and the subsets' estimates of them (p, subsets)."""
        whole, fits = self.fit.parameters, self.fits
        noise = self.floor if self.floor is not None else self.fit.rms
        if method != "separate":
            whole = self._whole_fit(method, noise).parameters
            fits = _fit(self.parts, whole, noise, method)
        gram = self.whole.gram / len(self.parts)
        reported = report(whole, Information.of(gram, whole, noise, method).covariance, method)
        values = _values(reported, fits)
        low, high = spread_interval(len(self.parts) - 1)
        found = []
        for row, name in enumerate(reported.names):
            std = float(values[row].std(ddof=1))
            bound = float(np.sqrt(reported.covariance[row, row]))
            ratio = std / bound if bound > 0.0 else np.nan
            found.append(
                SubsetParameter(
                    self.name,
                    name,
                    parameter_unit(name, self.unit, self.field_unit),
                    float(reported.values[row]),
                    float(values[row].mean()),
                    std,
                    bound,
                    ratio,
                    low * ratio,
                    high * ratio,
                    reported.untold.get(name) or _folded(name, float(reported.values[row]), bound),
                )
            )
        return found, values

    def noise_like(self) -> Array:
        """(3,) the noise that the subsets' scatter comes from [recorded unit], from each channel's six parameters."""
        coordinates = Coordinates(self.fit.parameters, "separate")
        errors = coordinates.errors(self.fits.parameters)
        bound = coordinates.bound(self.whole.gram / len(self.parts), np.ones(3))
        levels = np.empty(3)
        for k, start, of_field in columns_of_channels("separate"):
            own = slice(start, of_field.stop)
            centred = errors[:, own] - errors[:, own].mean(axis=0)
            distance = (centred * np.linalg.solve(bound[own, own], centred.T).T).sum()
            levels[k] = np.sqrt(distance / self._freedom)
        return levels

    @property
    def _freedom(self) -> int:
        return 6 * (len(self.parts) - 1)

    def channels(self, levels: Array) -> list[SubsetChannel]:
        """The fit error of each channel, divided into noise and the rest by ``levels`` (3,) of ``noise_like``."""
        low, high = spread_interval(self._freedom)
        found = []
        for k, channel in enumerate(CHANNELS_OF[self.name]):
            error, level = float(self.fit.rms[k]), float(levels[k])
            systematic = [float(np.sqrt(max(error**2 - x**2, 0.0))) for x in (level, high * level, low * level)]
            share = [min((x / error) ** 2, 1.0) for x in (level, low * level, high * level)]
            floor = np.nan if self.floor is None else float(self.floor[k])
            found.append(
                SubsetChannel(
                    channel,
                    self.unit,
                    error,
                    floor,
                    level,
                    low * level,
                    high * level,
                    systematic[0],
                    systematic[1],
                    systematic[2],
                    share[0],
                    share[1],
                    share[2],
                    float(chdtrc(self._freedom, self._freedom * (level / floor) ** 2)) if floor > 0.0 else np.nan,
                )
            )
        return found

    def agreement(self, levels: Array) -> FieldAgreement:
        """Whether the channels' field directions agree, with noise of ``levels`` (3,) [recorded unit]."""
        scale = levels / self.fit.noise
        found = common_field(self.fit.parameters, _scaled(self.fit.covariance, scale))
        fields = self.fit.parameters.fields
        apart = max(float(np.linalg.norm(fields[i] - fields[j])) for i, j in ((0, 1), (0, 2), (1, 2)))
        blocks = [
            s**2 * self.fit.covariance[of_field, of_field]
            for s, (_, _, of_field) in zip(scale, columns_of_channels("separate"), strict=True)
        ]
        uncertainty = max(float(np.linalg.eigvalsh(block)[-1]) for block in blocks)
        own = [
            common_field(parameters, _scaled(covariance, scale))
            for parameters, covariance in zip(self.fits.parameters, self.fits.covariance, strict=True)
        ]
        return FieldAgreement(
            self.name,
            found.chi_square,
            found.degrees_of_freedom,
            float(chdtrc(found.degrees_of_freedom, found.chi_square)),
            float(np.degrees(2.0 * np.arcsin(min(0.5 * apart, 1.0)))),
            float(np.degrees(np.sqrt(uncertainty))),
            sum(bool(chdtrc(one.degrees_of_freedom, one.chi_square) < DISAGREEMENT) for one in own),
        )


def _fit(parts: Sequence[Statistics], near: SensorParameters, noise: Array, method: Method) -> ManyFits:
    return fit_many(
        np.stack([part.gram for part in parts]),
        np.stack([part.cross for part in parts]),
        np.stack([part.square.diagonal() for part in parts]),
        np.array([part.count for part in parts]),
        noise,
        method,
        reference_magnitude=near.reference_magnitude,
        field_points=near.fields[0],
    )


def _values(reported: Reported, fits: ManyFits) -> Array:
    """(p, m) the parameters of many fits; angles by the shorter way from those of all samples."""
    values = fits.parameters.values(fits.method).T
    for row, name in enumerate(reported.names):
        if name.endswith("_deg"):
            whole = reported.values[row]
            values[row] = whole + (values[row] - whole + 180.0) % 360.0 - 180.0
    return values


def _folded(name: str, value: float, bound: float) -> str:
    """Why an elevation near a pole, which is at most 90 deg, scatters less than its linear bound; else empty.

    At the pole itself its distance from there is Rayleigh's: sqrt(2 - pi/2) = 0.66 standard deviations.
    """
    if not name.startswith(("beta", "phi")) or not 90.0 - abs(value) < _NEAR_POLE * bound:
        return ""
    return (
        f"{90.0 - abs(value):.2g} deg from the pole, where elevations fold over: noise alone makes its std / bound"
        " anything from 0.66 to 1"
    )


def _scaled(covariance: Array, scale: Array) -> Array:
    """The covariance of separate fits (18, 18) with each channel's noise times ``scale`` (3,)."""
    factor = np.repeat(scale, 6)
    return covariance * factor[:, None] * factor
