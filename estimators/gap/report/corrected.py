"""The corrected calibration: what the sensors are once everything that may explain the gap is allowed for.

The posterior of the calibration given an explanation is normal: its causes' parameters have their prior, a discrepancy
its own, the calibration a flat one, all to first order about the refit. Over the explanations it is a mixture, of which
mean and covariance are given: the covariance is wider by what is not known of the causes, by a discrepancy, and by the
explanations' disagreement. What the calibration of this maneuver absorbs stays in it: that nobody can tell.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimators.calibration import Calibration
from estimators.calibration.turned import turned
from estimators.gap.data.basefit import cleared
from estimators.gap.data.projection import orthonormal
from estimators.gap.data.tangent import stepped
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.evidence.common import is_common
from estimators.gap.evidence.converge import converged
from estimators.gap.evidence.refine import Fitted, tangents
from estimators.gap.evidence.weighed import Weighed
from estimators.gap.search.hypothesis import Hypothesis
from estimators.gap.search.posterior import Posterior
from estimators.known_angle.assemble import assemble
from estimators.known_angle.fit import fit_sensor
from estimators.known_angle.from_recording import reads_of, summarise
from estimators.known_angle.identifiability import Told
from estimators.known_angle.model import SensorParameters
from rig.arrays import Array
from rig.channels import CHANNELS, COLUMNS_OF, READS
from rig.directions import tangent_basis
from rig.pipeline import Pipeline
from rig.recording import Recording

#: Explanations that count: how likely they must be, how many at most; and of each the terms of a discrepancy.
_LIKELY, _MOST, _TERMS = 0.005, 12, 4
#: Places at which a cause does the same to the readings that are refitted, as their calibrations differ.
_ALTERNATIVES: Final = 4
#: Parameters of a sensor.
_OWN: Final = 14


@dataclass(frozen=True)
class Component:
    """One normal component of the mixture.

    Attributes:
        weight: its probability.
        pipeline: about which its parameters are. mean: (p,) by which it is moved from there.
        covariance: (p, p), in the coordinates of ``WhitenedData.tangent``.
    """

    weight: float
    pipeline: Pipeline
    mean: Array
    covariance: Array


def corrected_calibration(recording: Recording, data: WhitenedData, posterior: Posterior, source: str) -> Calibration:
    """The calibration with its covariance, over all explanations.

    Args:
        recording: what was diagnosed. data: it, defects left out.
        posterior: over the explanations. source: where the noise floor comes from.
    """
    components = list(_components(data, posterior))
    centre = max(components, key=lambda each: each.weight).pipeline
    mean, covariance = mixed(components, centre)
    leading = posterior.leading.explanation
    settled = data.like(leading.data)
    change = settled.given_change + settled.change([fit.effect for fit in leading.fits])
    return _assembled(cleared(recording, change), data, stepped(centre, mean), covariance, source)


def mixed(components: Sequence[Component], centre: Pipeline) -> tuple[Array, Array]:
    """Mean (p,) and covariance (p, p) of a mixture, as a move from a pipeline."""
    weights = np.array([each.weight for each in components])
    weights = weights / weights.sum()
    means = np.stack([_apart(stepped(each.pipeline, each.mean), centre) for each in components])
    mean = weights @ means
    within = np.einsum("k,kij->ij", weights, np.stack([each.covariance for each in components]))
    off = means - mean
    return mean, within + (weights[:, None] * off).T @ off


def _apart(pipeline: Pipeline, centre: Pipeline) -> Array:
    """(p,) how far a pipeline's parameters are from another's, in the coordinates of ``WhitenedData.tangent``."""
    parts = []
    for name, sensor in pipeline.sensors.items():
        there = centre.sensors[name]
        fields = [each.environment.field(name) for each in (pipeline, centre)]
        own, other = (field / np.linalg.norm(field) for field in fields)
        turned = np.einsum("kai,ki->ka", tangent_basis(there.axes), sensor.axes)
        moved = np.subtract(sensor.sensitivity, there.sensitivity), np.subtract(sensor.offset, there.offset)
        parts += [np.column_stack([*moved, turned]).ravel(), tangent_basis(other) @ own]
    return np.concatenate(parts)


def _components(data: WhitenedData, posterior: Posterior) -> Iterator[Component]:
    """Every likely explanation with every likely discrepancy, and its causes at each place where they do the same."""
    likely = [
        (each, float(p))
        for each, p in zip(posterior.hypotheses, posterior.probabilities, strict=True)
        if p > _LIKELY and each.explanation.felt
    ][:_MOST]
    for hypothesis, probability in likely or [(posterior.leading, 1.0)]:
        for fits, at, share in _alternatives(hypothesis, posterior, probability):
            own = data.stepped(_steps(hypothesis, data)).around(at.pipeline)
            for weight, mean, covariance in _posteriors(hypothesis, fits, own, posterior):
                yield Component(probability * share * weight, own.pipeline, mean, covariance)


def _steps(hypothesis: Hypothesis, data: WhitenedData) -> tuple:  # type: ignore[type-arg]
    """What the explanation's noise adds to the whitening."""
    shared = [step for each in hypothesis.state.fitted if is_common(type(each.effect)) for step in each.steps(data)]
    return (*hypothesis.state.steps, *shared)


def _alternatives(
    hypothesis: Hypothesis, posterior: Posterior, probability: float
) -> Iterator[tuple[list[Fitted], WhitenedData, float]]:
    """The explanation's fits, and those with a cause moved to a place where it does the same; with their shares.

    What the readings cannot tell apart the calibration takes up differently.
    """
    members, data = hypothesis.explanation.members, hypothesis.explanation.data
    fits = [member.fit for member in members]
    shares = [
        {label: posterior.prior.weight(member.fit.candidate.effect.name, label) for label in member.labels}
        for member in members
    ]
    moved: list[tuple[list[Fitted], WhitenedData, float]] = []
    known = {candidate.label: candidate for candidate in posterior.candidates}
    left = 1.0
    for index, (member, weights) in enumerate(zip(members, shares, strict=True)):
        total = sum(weights.values())
        others = [label for label in member.labels[1:] if label in known][:_ALTERNATIVES]
        for label in others if probability > 0.05 else []:
            changed = [*fits]
            changed[index] = replace(member.fit, candidate=known[label])
            again = converged(changed, data)
            share = weights[label] / total / len(members)
            left -= share
            moved.append((again.fits, again.data, share))
    yield fits, data, left
    yield from moved


def _posteriors(
    hypothesis: Hypothesis, fits: Sequence[Fitted], data: WhitenedData, posterior: Posterior
) -> Iterator[tuple[float, Array, Array]]:
    """Weight, mean (p,) and covariance (p, p) of the calibration's move, for each likely term of the discrepancy."""
    linear = hypothesis.explanation.linear
    left = data.whiten(data.residual - data.change([fit.effect for fit in fits]))
    columns = np.hstack([data.tangent, *tangents(fits, data)]) if fits else data.tangent
    size = data.tangent.shape[1]
    precision = np.concatenate([np.zeros(size), linear.likeliest])
    pull = np.concatenate([np.zeros(size), linear.pull])
    if not hypothesis.terms:
        yield 1.0, *solved(columns.T @ columns, columns.T @ left, precision, pull, size)
        return
    terms = hypothesis.terms[:_TERMS]
    masses = np.array([each.log_mass for each in terms])
    for each, weight in zip(terms, np.exp(masses - np.logaddexp.reduce(masses)), strict=True):
        gram, moment = _under(each, left, columns, size)
        yield float(weight), *solved(gram, moment, precision, pull, size)


def _under(each: Weighed, left: Array, columns: Array, size: int) -> tuple[Array, Array]:
    """columns' S columns and columns' S left, S the inverse covariance under a term at its likeliest amplitude.

    The term adds v B B' to the covariance: S = I - B (I / v + B'B)^-1 B' (Woodbury).
    """
    variance = float(each.term.variances[int(np.argmax(each.gains))])
    along = each.term.along_with_calibration(np.column_stack([left, columns]))
    inner = np.diag(1.0 / variance + each.term.values)
    if each.term.projected:  # its values are without what the calibration takes: that is part of B'B
        absorbed = each.term.along_with_calibration(orthonormal(columns[:, :size]))
        inner += absorbed @ absorbed.T
    taken = np.linalg.solve(inner, along) if each.term.projected else along / np.diag(inner)[:, None]
    return columns.T @ columns - along[:, 1:].T @ taken[:, 1:], columns.T @ left - along[:, 1:].T @ taken[:, 0]


def solved(gram: Array, moment: Array, precision: Array, pull: Array, size: int) -> tuple[Array, Array]:
    """Mean (size,) and covariance (size, size) of the first parameters of a normal posterior.

    Args:
        gram, moment: T'S T and T'S left. precision: prior precisions, zero where flat. pull: prior mean less the point.
    """
    covariance = Told.of(gram + np.diag(precision)).covariance
    mean = covariance @ (moment + precision * pull)
    return mean[:size], covariance[:size, :size]


def _assembled(
    recording: Recording, data: WhitenedData, pipeline: Pipeline, covariance: Array, source: str
) -> Calibration:
    """The contract's calibration of a pipeline with this covariance (p, p).

    Args:
        recording: with the causes' change taken out.
    """
    arm = data.base.arm
    summed = summarise(recording, recording.sensors, arm)
    found = {}
    for place, (name, sensor) in enumerate(pipeline.sensors.items()):
        columns = range(len(CHANNELS))[COLUMNS_OF[name]]
        magnitude = recording.metadata.magnitude(name)
        noise = np.sqrt([data.floor[column].variance for column in columns])
        of_floor = noise / np.sqrt(2.0 * np.maximum(data.floor_samples[list(columns)], 1.0))
        field = pipeline.environment.field(name)
        parameters = SensorParameters.of(sensor, field)
        towards = (0.0, 0.0, -1.0 if field[2] <= 0.0 else 1.0)
        fit = fit_sensor(
            summed.statistics.select(slice(3 * place, 3 * place + 3)),
            magnitude,
            noise=noise,
            field_points=towards,
            name=f"{recording.name}: {name}",
            refuse=False,
        )
        scale = np.ones(_OWN)
        scale[:12].reshape(3, 4)[:, :2] = parameters.scales
        own = slice(_OWN * place, _OWN * (place + 1))
        fit = replace(fit, parameters=parameters, covariance=covariance[own, own] / np.outer(scale, scale))
        reads = reads_of(recording.metadata, name)
        own_calibration = assemble(
            fit,
            unit=recording.unit(name),
            noise_source="locked recording" if source == "locked recording" else "residuals",
            floor_std=of_floor,
            field_points=towards,
            reads=None if reads is None else READS[0],
            field_unit=recording.metadata.stated_field_unit(name),
        )
        found[name] = turned(own_calibration) if reads == READS[1] else own_calibration
    return Calibration(found, recording.name, summed.arm)
