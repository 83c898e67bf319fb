"""What the base model leaves of a recording, and what is left once the diagnosed causes are modelled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimators.dispatch import calibrate
from estimators.gap.data.basefit import (
    all_readings,
    cleared,
    estimated_floor,
    fitted_pipeline,
    floor_of,
    learn_floor,
    posed,
    set_up,
)
from estimators.gap.data.defects import find_defects, lattice, masked, relieved
from estimators.gap.data.projection import Basis
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.diagnosis import Diagnosis
from estimators.gap.floor.channel_noise import ChannelNoise
from estimators.gap.hypotheses.noise_effects import fit_effect
from estimators.gap.hypotheses.score import Explained
from estimators.gap.hypotheses.stochastic import Left
from rig.arm import Arm
from rig.arrays import Array, Mask
from rig.channels import CHANNELS
from rig.effects import EFFECTS, Effect, Kind, make_effect, without_nulls
from rig.errors import RigError
from rig.pipeline import Pipeline
from rig.recording import Recording


@dataclass(frozen=True, eq=False)
class GapResiduals:
    """A recording's residuals before and after the causes are modelled; channels that were not recorded are NaN.

    Attributes:
        recording: what was diagnosed.
        floor: the noise of each channel at rest.
        before: (n, 6) [recorded unit] reading minus base fit.
        after: (n, 6) [recorded unit] reading minus the fit with the causes' change in it; None where it has no causes.
        left_out: (n, 6) readings that a named defect has spoilt, such as a spike; they do not count in ``after``.
        white_before, white_after: (n, 6) the same residuals whitened: independent and of variance one where only the
            floor (and, after, the named noise) is left.
        causes: the effects of the likeliest explanation.
        data: the base fit.
        calibrated: the rig calibrated with the causes in place, without them; the base fit's where there are none.
    """

    recording: Recording
    floor: tuple[ChannelNoise, ...]
    before: Array
    after: Array | None
    left_out: Mask
    white_before: Array
    white_after: Array | None
    causes: tuple[Effect, ...]
    data: WhitenedData
    calibrated: Pipeline


def gap_residuals(
    recording: Recording,
    diagnosis: Diagnosis,
    locked: Recording | None = None,
    arm: Arm | None = None,
    data: WhitenedData | None = None,
) -> GapResiduals:
    """Refit the calibration with the causes of a diagnosis in place.

    Args:
        locked: the locked recording that the diagnosis took its floor from; None: the floor is estimated as there.
        arm: None: as ``estimators.gap.diagnose`` has it.
        data: the recording's, as the diagnosis left it; made anew by default.

    Raises:
        RigError, RefusedFit: as ``estimators.gap.diagnose``.
    """
    if data is None:
        recording, arm = posed(recording, arm)
        if locked is None:
            floor = estimated_floor(recording, arm)
        else:
            floor = learn_floor(locked, float(np.median(np.diff(recording.t))))
        data = set_up(recording, floor, arm)
    floor = data.floor
    causes = diagnosed_effects(diagnosis)
    clean, left_out = _without_defects(data, causes, locked)
    known = _recalibrated(recording, clean, causes, floor, left_out) if causes else clean
    after = known.residual - known.change(mean_effects(causes)) if causes else None
    # long tails are drawn in as they are after: what single readings are off by stays
    before = np.where(left_out, data.residual, relieved(data).residual)
    return GapResiduals(
        recording=recording,
        floor=floor,
        before=before,
        after=after,
        left_out=left_out,
        white_before=whitened(data, before),
        white_after=None if after is None else whitened(with_noise(known, causes, after), after),
        causes=causes,
        data=data,
        calibrated=known.pipeline,
    )


def diagnosed_effects(diagnosis: Diagnosis) -> tuple[Effect, ...]:
    """The causes of the likeliest explanation as effects that the simulator can apply.

    Values beyond their bounds are moved to these. What the recording did not feel is as it stood in the fit, to which
    the other values belong: alone they would not do again what was found. Where nothing stood there it is neutral.
    """
    found = []
    for cause in diagnosis.leading:
        given = {
            name: estimate.value if estimate.fitted is None else estimate.fitted
            for name, estimate in cause.parameters.items()
        }
        values = without_nulls(cause.effect, {"where": cause.where, **given})
        for item in EFFECTS[cause.effect].parameters():
            if item.name in values:
                values[item.name] = np.clip(values[item.name], item.lower, item.upper).tolist()
        found.append(make_effect(cause.effect, values))
    return tuple(found)


def mean_effects(effects: Sequence[Effect]) -> list[Effect]:
    """Those effects that move the expected reading."""
    return [effect for effect in effects if effect.kind is Kind.MEAN]


def _without_defects(
    data: WhitenedData, causes: Sequence[Effect], locked: Recording | None
) -> tuple[WhitenedData, Mask]:
    """The data without the readings that named defects have spoilt, and which these are."""
    names = {effect.name for effect in causes if effect.kind is Kind.DISTRIBUTION}
    nothing = np.zeros(data.readings.shape, dtype=bool)
    if not names:
        return relieved(data), nothing
    step = np.full(len(CHANNELS), np.nan) if locked is None else lattice(all_readings(locked))
    defects = [defect for defect in find_defects(data, step) if defect.effect in names]
    return masked(data, defects), np.logical_or.reduce([nothing, *(defect.affected for defect in defects)])


def _recalibrated(
    recording: Recording, data: WhitenedData, causes: Sequence[Effect], floor: Sequence[ChannelNoise], left_out: Mask
) -> WhitenedData:
    """The data with the recording's calibration once the causes' change and the readings they spoil are left out."""
    corrected = cleared(recording, data.given_change + data.change(mean_effects(causes)))
    noise = floor_of(recording, floor)
    whole = np.flatnonzero(~left_out.any(axis=1))
    try:
        pipeline = fitted_pipeline(calibrate(corrected.select(whole), noise=noise, arm=data.base.arm), recording)
    except RigError:  # too little is left: the first calibration, then
        return data
    return data.around(pipeline)


def with_noise(data: WhitenedData, causes: Sequence[Effect], after: Array) -> WhitenedData:
    """The data with the named noise whitened as well."""
    for effect in causes:
        if effect.kind is Kind.NOISE:
            explained = Explained(Basis((), data.size), data.whiten(after))  # the calibration is refitted already
            fitted = fit_effect(type(effect), effect.where, Left(data, explained))
            data = data if fitted is None else data.stepped(fitted.steps(data))
    return data


def whitened(data: WhitenedData, residual: Array) -> Array:
    """(n, 6) a residual in whitened coordinates, channel by channel."""
    white = np.full_like(residual, np.nan)
    white[:, data.columns] = data.whiten(residual).reshape(len(data.columns), -1).T
    return white
