"""One case: its recordings and its truth, from a plan and a seed."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Final

import numpy as np

from rig.arrays import Array
from rig.effects import EFFECTS, Effect, Kind
from rig.errors import RigError
from rig.recording import Recording
from scenarios.scenario import Scenario
from validation.blind.draws import ABSORBED, BY_BEING_THERE, draw_effect, places_of
from validation.blind.forms import FORMS
from validation.blind.laboratories import LABORATORIES
from validation.blind.likeness import ALIKE, TWIN, Likeness, columns_at, likenesses
from validation.blind.mechanics import MECHANISMS
from validation.blind.mechanics.driven_readings import see
from validation.blind.outside import OUTSIDE
from validation.blind.settings import FAST, SWEEPS, Setting, draw_setting
from validation.blind.strata import MECHANICS, Plan
from validation.blind.strength import added_variance, signal_to_noise, single_readings, strength_for
from validation.blind.truth import TrueCause, Truth, parameters_of

_DRAWS: Final = 40  # a draw that cannot have the wanted strength within its bounds is drawn again
_GENTLE_S: Final = 2.0
_TOO_WEAK: Final = 0.3  # of the wanted strength
_SAME: Final = 1e-6  # of the largest singular value: two columns that do the same
_APART: Final = 0.7  # two causes of a case keep so much of their signal beside each other


@dataclass(frozen=True)
class Case:
    """A case's recordings, its truth, and the true change (n, 6) [V] of the expected readings."""

    recording: Recording
    locked: Recording | None
    truth: Truth
    change: Array


def make_case(name: str, plan: Plan, scenario: Scenario, samples: int, seed: np.random.SeedSequence) -> Case:
    """Draw a case.

    Args:
        name: of the recording.
        scenario: what to draw around.
        samples: of the recording.
        seed: of everything random in it.

    Raises:
        RigError: no draw could have the wanted strength.
    """
    rng = np.random.default_rng(seed)
    reasons = ""
    for _ in range(_DRAWS):
        try:
            if plan.stratum == MECHANICS:
                return _mechanical(name, plan, scenario, samples, rng)
            return _drawn(name, plan, scenario, samples, rng)
        except RigError as error:
            reasons = str(error)
    raise RigError(f"{name}: no draw of {', '.join(plan.names)} could be as strong as wanted; the last: {reasons}")


def _drawn(name: str, plan: Plan, scenario: Scenario, samples: int, rng: np.random.Generator) -> Case:
    there = any(each in BY_BEING_THERE for each in plan.names)
    sweeps = FAST + SWEEPS[3:] if there else SWEEPS
    setting = draw_setting(scenario, samples, rng, plan.floor, sweeps, LABORATORIES[plan.laboratory])
    effects, causes = [], []
    for each, wanted, where in zip(plan.names, plan.strengths, _places(plan, setting, rng), strict=True):
        effect, cause = _cause(each, wanted, plan.stratum, setting, rng, where)
        effects.append(effect)
        causes.append(cause)
    if len(effects) > 1:
        causes = _beside(effects, causes, setting)
    change, gap = _gap(tuple(effects), setting)
    recording = setting.record(tuple(effects), rng, name)
    locked = setting.record_locked(rng, f"{name}.locked")
    truth = Truth.of(name, plan.stratum, plan.strengths, tuple(causes), gap, setting)
    return Case(recording, locked, replace(truth, floor_kind=plan.floor), change)


def _places(plan: Plan, setting: Setting, rng: np.random.Generator) -> list[str | None]:
    """The place of each effect where the stratum asks for one; None: anywhere."""
    if plan.stratum == "two places":
        return [str(each) for each in rng.choice(places_of(EFFECTS[plan.names[0]], setting), 2, replace=False)]
    if plan.stratum == "one joint":
        both = [set(places_of(EFFECTS[name], setting)) for name in plan.names]
        shared = sorted(both[0] & both[1])
        if not shared:
            raise RigError("the two effects share no joint")
        return [str(rng.choice(shared))] * 2
    return [None] * len(plan.names)


def _cause(
    name: str, wanted: float, stratum: str, setting: Setting, rng: np.random.Generator, where: str | None = None
) -> tuple[Effect, TrueCause]:
    outside = stratum in ("outside", "known and outside") and name in OUTSIDE
    if stratum == "absorbed":
        known, where, values = ABSORBED[int(name)]
        sign = float(rng.choice([-1.0, 1.0]))
        effect = EFFECTS[known].from_mapping({"where": where, **{key: sign * value for key, value in values.items()}})
        snr = signal_to_noise((effect,), setting)
        return effect, TrueCause(known, known, where, snr, snr, parameters=parameters_of(effect))
    if name in BY_BEING_THERE:
        effect = draw_effect(name, rng, setting)(float(rng.uniform(0.3, 2.0)))
        snr = signal_to_noise((effect,), setting)
    else:
        families, make = FORMS[name] if stratum == "form" else ((), None)
        if make is None:
            one = stratum == "one axis"
            make = OUTSIDE[name] if outside else lambda rng, setting: draw_effect(name, rng, setting, where, one)
        effect, snr = strength_for(make(rng, setting), wanted, setting)
    if outside:
        return effect, _with_likenesses(
            TrueCause(name, "", effect.where, snr, snr, parameters=parameters_of(effect)), effect, setting
        )
    first, *others = families if stratum == "form" else (name,)
    cause = TrueCause(
        name,
        first,
        effect.where,
        snr,
        snr,
        families=tuple((other, effect.where) for other in others),
        parameters=parameters_of(effect),
    )
    return effect, _with_likenesses(cause, effect, setting)


def _with_likenesses(cause: TrueCause, effect: Effect, setting: Setting) -> TrueCause:
    if effect.kind is not Kind.MEAN:
        return cause
    return _with_others(cause, likenesses(setting.change((effect,)), setting, getattr(effect, "freq_Hz", None)))


def _with_others(cause: TrueCause, found: list[Likeness]) -> TrueCause:
    others = [each for each in found if (each.effect, each.where) != (cause.effect, cause.where)]
    twins = tuple((each.effect, each.where) for each in others if each.left < TWIN)
    alike = tuple((each.effect, each.where) for each in others if TWIN <= each.left < ALIKE)
    return replace(cause, twins=twins, alike=alike)


def _beside(effects: list[Effect], causes: list[TrueCause], setting: Setting) -> list[TrueCause]:
    """Several causes with what each of them adds beyond all that the others could do at other strengths and phases.

    Raises:
        RigError: too much alike to ask for all: an eccentric joint does what its spring does, at another phase.
    """
    freedoms = [setting.projection(_freedom(effect, setting)) for effect in effects]
    found = []
    for index, (effect, cause) in enumerate(zip(effects, causes, strict=True)):
        part = setting.projection(setting.change((effect,)))
        others = np.hstack([freedom for each, freedom in enumerate(freedoms) if each != index])
        others = others[:, np.linalg.norm(others, axis=0) > 0.0]
        others = others / np.linalg.norm(others, axis=0)
        left = part - others @ np.linalg.lstsq(others, part, rcond=_SAME)[0]
        alone = float(np.linalg.norm(left) / np.linalg.norm(part))
        if alone < _APART:
            raise RigError("the effects are too much alike")
        found.append(replace(cause, beyond=alone * cause.snr))
    return found


def _freedom(effect: Effect, setting: Setting) -> Array:
    """(n, 6, k) [V] what an effect could do with its shape, but for phases; as it is where no catalogue has it."""
    if effect.name not in EFFECTS:
        return setting.change((effect,))[..., None]
    known = EFFECTS[effect.name]
    spanned = {key for shape in known.spanning() for key in shape}
    strengths = {each.name for each in known.parameters() if each.strength}
    fixed = {key: value for key, value in asdict(effect).items() if key not in spanned | strengths}
    return columns_at(known, fixed, setting)


def _gap(effects: tuple[Effect, ...], setting: Setting) -> tuple[Array, Array]:
    """The change (n, 6) of the expected readings, and the RMS (6,) of all that the calibration cannot take up."""
    mean = tuple(effect for effect in effects if effect.kind is Kind.MEAN)
    change = setting.change(mean) if mean else np.zeros((len(setting.ideal), 6))
    squared = setting.projection.gap_V(change) ** 2
    for effect in effects:
        if effect.kind is Kind.NOISE:
            squared += added_variance(effect, setting).mean(axis=0)
        elif effect.kind is Kind.DISTRIBUTION:
            squared += np.mean(single_readings((effect,), setting, np.random.default_rng(0)) ** 2, axis=0)
    return change, np.sqrt(squared)


def _mechanical(name: str, plan: Plan, scenario: Scenario, samples: int, rng: np.random.Generator) -> Case:
    """A mechanism, stepped: once at its typical strength, once more at the one that has the wanted signal-to-noise."""
    kind = MECHANISMS[plan.names[0]]
    setting = draw_setting(scenario, samples, rng, plan.floor, FAST if kind.fast else SWEEPS[:3])
    if not kind.fast:  # gentle corners: what the arm's own acceleration does is not the question
        setting = replace(setting, maneuver=replace(setting.sweep, corner_s=_GENTLE_S))
    mechanism = kind.draw(rng, setting)
    seen = see(mechanism, setting)
    if not kind.fast:
        mechanism = mechanism.scaled(plan.strengths[0] / setting.projection.snr(seen.change))
        seen = see(mechanism, setting)
    snr = setting.projection.snr(seen.change)
    if snr < _TOO_WEAK * plan.strengths[0]:
        raise RigError(f"{plan.names[0]} at signal-to-noise {snr:.3g}")
    where = mechanism.where
    cause = TrueCause(plan.names[0], mechanism.effect, where, snr, snr, mechanism.families, asdict(mechanism))
    cause = _with_others(cause, likenesses(seen.change, setting, getattr(mechanism, "frequency_Hz", None)))
    cause = replace(cause, alike=(*cause.alike, *mechanism.besides))
    recording = setting.record_volts(seen.volts, rng, name, seen.q, seen.t)
    locked = setting.record_locked(rng, f"{name}.locked")
    gap = setting.projection.gap_V(seen.change)
    causes = (cause,) if kind.fast else (cause, *_motion(setting))
    return Case(recording, locked, Truth.of(name, plan.stratum, plan.strengths, causes, gap, setting), seen.change)


def _motion(setting: Setting) -> tuple[TrueCause, ...]:
    """What the arm's own acceleration does on the same sweep, as a cause beside the mechanism."""
    moving = replace(setting, inertial=True).ideal.volts - setting.ideal.volts
    snr = setting.projection.snr(moving)
    return (TrueCause("motion", "motion_acceleration", "accelerometer", snr, snr),)
