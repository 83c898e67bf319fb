"""A wrong cause forced in: of all others the one that takes up the most of a gap and still leaves some."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from rig.effects import Effect
from rig.effects.parameters import Value
from rig.errors import RigError
from validation.blind.likeness import at_zero, candidates, small_steps
from validation.blind.settings import Setting
from validation.loop.rigs import DRAWS, rigs_with_a_cause

#: Signal-to-noise that a wrong cause leaves at least, and the share of the truth's that it leaves at most.
LEFT: Final = 5.0
SHARE: Final = 0.9


@dataclass(frozen=True)
class ForcedRig:
    """A rig with one cause, and the wrong cause that is put into its model.

    Attributes:
        setting: everything but the cause. truth, wrong: the two. snr: of the truth. left: signal-to-noise that the
            wrong one leaves of it, calibration refitted. std: how well a recording tells the wrong one's strengths.
    """

    setting: Setting
    truth: Effect
    wrong: Effect
    snr: float
    left: float
    std: Mapping[str, Value]


def forced_rig(seed: int, number: int, samples: int) -> ForcedRig:
    """Draw rigs until one has a gap of which a wrong cause takes up a part, and leaves what could be seen.

    Args:
        seed: of the study. number: of the rig. samples: of a recording, at 4 Hz.

    Raises:
        RigError: no draw had one.
    """
    for setting, truth, snr in rigs_with_a_cause(seed, number, samples):
        found = [each for each in _others(setting, truth) if LEFT <= each[0] <= SHARE * snr]
        if found:
            left, wrong, std = min(found, key=lambda each: each[0])
            return ForcedRig(setting, truth, wrong, snr, left, std)
    raise RigError(f"rig {number}: none of {DRAWS} draws has a gap of which a wrong cause takes up a part")


def _others(setting: Setting, truth: Effect) -> list[tuple[float, Effect, Mapping[str, Value]]]:
    """What each other effect leaves at its best strengths [signal-to-noise], the effect so, and how well it is told."""
    change = setting.change((truth,))
    found = []
    for effect, fixed in candidates(setting.ideal):
        steps_in = any(each.name == "at_s" for each in effect.parameters())
        if (effect.name, fixed["where"]) == (truth.name, truth.where) or steps_in or effect.tone:
            continue
        try:
            fitted, std = _fitted(setting, effect, {**next(iter(effect.spanning())), **fixed}, change)
            left = setting.projection.snr(change - setting.change((fitted,)))
        except RigError:  # its best strength is beyond its bounds
            continue
        found.append((left, fitted, std))
    return found


def _fitted(
    setting: Setting, effect: type[Effect], shape: dict[str, Any], change: np.ndarray
) -> tuple[Effect, Mapping[str, Value]]:
    """The effect with the strengths that leave the least of a change (n, 6) [V], to first order, and their standard
    deviations."""
    strengths = [each for each in effect.parameters() if each.strength]
    zero = at_zero(effect)

    def plain(values: dict[str, np.ndarray]) -> dict[str, Value]:
        return {name: float(each[0]) if each.size == 1 else tuple(map(float, each)) for name, each in values.items()}

    start = setting.change((effect.from_mapping(shape | zero),)) if effect.acts_at_zero else 0.0
    columns = [
        (setting.change((effect.from_mapping(shape | zero | step),)) - start) / size
        for step, size in small_steps(effect)
    ]
    design = setting.projection(np.stack(columns, axis=2))
    size = np.maximum(np.linalg.norm(design, axis=0), np.finfo(float).tiny)
    best = np.linalg.lstsq(design / size, setting.projection(change), rcond=1e-6)[0] / size
    cuts = np.cumsum([each.size for each in strengths])[:-1]
    typical = np.concatenate([np.full(each.size, each.typical) for each in strengths])
    inverse = np.linalg.pinv(design * typical, rcond=1e-6) * typical[:, None]  # zero of what is not felt
    names = [each.name for each in strengths]
    std = np.split(np.linalg.norm(inverse, axis=1), cuts)
    fitted = effect.from_mapping(shape | plain(dict(zip(names, np.split(best, cuts), strict=True))))
    return fitted, plain(dict(zip(names, std, strict=True)))
