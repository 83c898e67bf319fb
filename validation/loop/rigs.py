"""Hidden rigs whose cause the first maneuver cannot tell from another, by their truth and not by any diagnosis."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from rig.effects import EFFECTS, Effect, Kind
from rig.errors import RigError
from rig.maneuver import StaticPoses, TorusSweep
from rig.recording import Recording
from scenarios.loader import load
from validation.blind.draws import BY_BEING_THERE, draw_effect
from validation.blind.likeness import likenesses
from validation.blind.settings import FINER, RATE_HZ, Setting, draw_setting
from validation.blind.strength import strength_for
from validation.blind.truth import Label

SCENARIO: Final = "ann-arbor"
#: Signal-to-noise of the cause in the first recording: strong enough that nobody takes it for noise.
STRENGTHS: Final = (15.0, 60.0)
#: Rigs are drawn so often at most until one is what is looked for.
DRAWS: Final = 300


def drawn() -> tuple[str, ...]:
    """The effects that a rig may have: they move the mean, and are the same in every recording of it.

    What happens at an instant is over when the next recording begins, and what needs the board's own log is not moved
    by a maneuver.
    """
    return tuple(
        name
        for name, effect in EFFECTS.items()
        if effect.kind is Kind.MEAN
        and not effect.of_log
        and not effect.tone
        and name not in BY_BEING_THERE
        and all(each.name != "at_s" for each in effect.parameters())
    )


@dataclass(frozen=True)
class HiddenRig:
    """A rig with one cause.

    Attributes:
        setting: everything but the cause, on the first maneuver.
        effect: the cause. snr: its signal-to-noise there.
        alike: what leaves less than 2.5 standard deviations of it there.
        seed: of its noise.
    """

    setting: Setting
    effect: Effect
    snr: float
    alike: tuple[Label, ...]
    seed: tuple[int, ...]

    @property
    def cause(self) -> Label:
        """Effect and place."""
        return self.effect.name, self.effect.where

    def locked(self) -> Recording:
        """The rig at rest, recorded once."""
        found = self.setting.record_locked(np.random.default_rng([*self.seed, 1]), "hidden.locked")
        assert found is not None  # the laboratory makes one
        return found

    def recording(self, number: int) -> Recording:
        """The first maneuver."""
        return self.setting.record((self.effect,), np.random.default_rng([*self.seed, 2, number]), f"run{number}")

    def on(self, maneuver: TorusSweep | StaticPoses, felt: bool = False, warmer_degC: float = 0.0) -> HiddenRig:
        """The same rig on another maneuver.

        Args:
            felt: whether the arm is so fast that its own acceleration counts.
            warmer_degC: of the room, then.
        """
        finer = replace(maneuver, rate_Hz=RATE_HZ * FINER)
        room = self.setting.rig.environment
        room = replace(room, temperature_degC=room.temperature_degC + warmer_degC)
        rig = replace(self.setting.rig, environment=room)
        return replace(self, setting=replace(self.setting, maneuver=finer, inertial=felt, rig=rig))


def hidden_rig(seed: int, number: int, samples: int) -> HiddenRig:
    """Draw rigs until one has a cause that the first maneuver takes for another.

    Args:
        seed: of the study. number: of the rig. samples: of the first recording, at 4 Hz.

    Raises:
        RigError: no draw had one.
    """
    for setting, effect, snr in rigs_with_a_cause(seed, number, samples):
        own = effect.name, effect.where
        found = likenesses(setting.change((effect,)), setting)
        alike = tuple((each.effect, each.where) for each in found if (each.effect, each.where) != own)
        if alike:
            return HiddenRig(setting, effect, snr, alike, (seed, number))
    raise RigError(f"rig {number}: none of {DRAWS} draws has a cause that the first maneuver takes for another")


def rigs_with_a_cause(seed: int, number: int, samples: int) -> Iterator[tuple[Setting, Effect, float]]:
    """Draws of everything but the cause, the cause, and its signal-to-noise; arguments as of ``hidden_rig``."""
    rng = np.random.default_rng([seed, number])
    names = drawn()
    for _ in range(DRAWS):
        setting = draw_setting(load(SCENARIO), samples, rng)
        name = str(rng.choice(names))
        wanted = float(np.exp(rng.uniform(*np.log(STRENGTHS))))
        try:
            effect, snr = strength_for(draw_effect(name, rng, setting), wanted, setting)
        except RigError:  # a cause that cannot be so strong here
            continue
        yield setting, effect, snr
