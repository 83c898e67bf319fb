"""What is said where no maneuver was found that tells explanations apart: whether this arm has none."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from estimators.gap.data.basefit import set_up
from estimators.gap.data.whitened import WhitenedData
from estimators.gap.diagnosis import Diagnosis
from estimators.gap.report.separation import Explanation, Trial, contest
from rig.arm import Arm
from rig.effects import Effect
from rig.signals import Signals
from scenarios.gap_report.gap_residuals import GapResiduals
from scenarios.gap_report.words import apart_words

#: Rows of the recording to which the rivals are fitted.
_FITTED: Final = 7000
#: Poses all over the joints' ranges, each with a speed of its own: more freedom than any maneuver has.
_POSES: Final = 400
_SPEED_RAD_S: Final = 0.5
_WARMER_DEGC: Final = 10.0
#: Two explanations are one where what tells them apart is below this share of their squared change: the rounding of two
#: fits to each other leaves less, and a millionth part of the change is nothing that a maneuver would show.
_IDENTICAL: Final = 1e-12
_PARALLEL: Final = 1e-9  # of the sine of the angle between two axes
_SHOWN: Final = 3

NONE_FOUND: Final = (
    "No maneuver that was tried tells them apart in this time: allow more of it (--minutes M), or repair one cause and "
    "see whether the gap changes."
)
_REMEMBERS: Final = (
    "No maneuver is proposed for what depends on the motion before a reading, as a delay or hysteresis does: repair"
    " one cause and see whether the gap changes."
)


def fewer_rows(residuals: GapResiduals) -> WhitenedData:
    """The data of the recording, or of some of its rows where it is long, without the readings that defects spoilt."""
    recording = residuals.recording
    stride = -(-len(recording) // _FITTED)
    if stride == 1:
        return residuals.data.without(residuals.left_out)
    rows = np.arange(0, len(recording), stride)
    data = set_up(recording.select(rows), residuals.floor, residuals.data.base.arm)
    return data.without(residuals.left_out[rows])


def undecided_words(residuals: GapResiduals, diagnosis: Diagnosis) -> str:
    """What to do where no maneuver was found: another one that takes longer, or none, which would not help either."""
    arm = residuals.data.base.arm
    group = contest(fewer_rows(residuals), diagnosis)
    if arm is None or not group:
        return NONE_FOUND
    same = identical_pairs(residuals, arm, group)
    remembering = any(effect.remembers for each in group for effect in each.effects)
    rest = _REMEMBERS if remembering else NONE_FOUND
    if not same:
        return rest
    told = "; ".join(_pair_words(*pair, arm) for pair in same[:_SHOWN])
    more = f" and {len(same) - _SHOWN} more pairs" if len(same) > _SHOWN else ""
    words = (
        f"No maneuver of this arm tells these apart, which do the same to the readings in every pose: {told}{more}. To"
        " the calibration it is the same which of them is there: measure one by other means, as at a hard stop or with"
        " a level, or repair one and see whether the gap changes."
    )
    all_pairs = len(group) * (len(group) - 1) // 2
    return words if len(same) == all_pairs else f"{words} Of the others: {rest[0].lower()}{rest[1:]}"


def identical_pairs(
    residuals: GapResiduals, arm: Arm, group: Sequence[Explanation]
) -> list[tuple[tuple[Effect, ...], tuple[Effect, ...]]]:
    """The pairs of explanations that no maneuver of the arm can tell apart: not even poses all over its joints' ranges.

    Contacts and the way between the poses are left out of account: they leave an arm less freedom, never more. What
    both of a pair have is left out too. Of effects that depend on the motion before a reading poses tell nothing: a
    pair that differs in such an effect is not among these.
    """
    rng = np.random.default_rng(0)
    low, high = (np.where(np.isfinite(end), end, turn) for end, turn in ((arm.lower, -np.pi), (arm.upper, np.pi)))
    warm = residuals.recording.temperature is not None
    t = np.sort(rng.uniform(0.0, max(residuals.recording.duration_s, 1.0), _POSES))
    signals = Signals(
        t,
        arm=arm,
        q_encoder=rng.uniform(low, high, (_POSES, arm.dof)),
        velocity=rng.uniform(-_SPEED_RAD_S, _SPEED_RAD_S, (_POSES, arm.dof)),
        temperature=rng.uniform(20.0, 20.0 + _WARMER_DEGC, _POSES) if warm else None,
    )
    trial = Trial.of(signals, residuals.calibrated, residuals.floor, 1, tuple(group))
    found = []
    for one, other in itertools.combinations(group, 2):
        pair = replace(trial, explanations=(_own(one, other), _own(other, one)))
        effects = [effect for each in pair.explanations for effect in each.effects]
        if all(each.effects for each in pair.explanations) and not any(effect.remembers for effect in effects):
            apart = min(pair.promise(0, 1).noncentrality, pair.promise(1, 0).noncentrality)
            if apart < _IDENTICAL * max(float(change @ change) for change in pair.changes):
                found.append((one.effects, other.effects))
    return found


def _own(one: Explanation, other: Explanation) -> Explanation:
    """What an explanation has and another has not, at the fitted values."""
    there = {(effect.name, effect.where) for effect in other.effects}
    fits = tuple(fit for fit in one.fits if (fit.effect.name, fit.effect.where) not in there)
    size = sum(len(fit.values) for fit in fits)
    return Explanation(fits, np.zeros((size, size)), np.empty((size, 0)))


def titles(one: Sequence[Effect], other: Sequence[Effect]) -> tuple[str, str]:
    """Two explanations in words, without what both have."""
    first, second = ([(effect.name, effect.where) for effect in each] for each in (one, other))
    return apart_words(first, second)


def _pair_words(one: Sequence[Effect], other: Sequence[Effect], arm: Arm) -> str:
    words = "“{}” and “{}”".format(*titles(one, other))
    joints = [_own_joint(each, others) for each, others in ((one, other), (other, one))]
    if None not in joints and _parallel(arm, *sorted(joint for joint in joints if joint is not None)):
        names = " and ".join(arm.joint_names[joint] for joint in joints if joint is not None)
        words += f" (the axes of {names} are parallel in every pose)"
    return words


def _own_joint(effects: Sequence[Effect], others: Sequence[Effect]) -> int | None:
    """The joint, from 0, of the one effect that an explanation has and the other has not; None where there is none."""
    there = [(each.name, each.where) for each in others]
    own = [each.where for each in effects if (each.name, each.where) not in there]
    return int(own[0].removeprefix("joint")) - 1 if len(own) == 1 and own[0].startswith("joint") else None


def _parallel(arm: Arm, first: int, last: int) -> bool:
    """Whether two joints' axes are parallel at every pose: so are those of all joints between that turn."""
    turning = [joint for joint in range(first, last + 1) if joint in (first, last) or not arm.slides[joint]]
    axes = arm.joint_axes[turning]
    return not any(arm.slides[joint] for joint in (first, last)) and bool(
        np.linalg.norm(np.cross(axes, axes[0]), axis=1).max() < _PARALLEL
    )
