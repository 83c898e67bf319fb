"""A short sweep with and without a known cause, and diagnoses of it made by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from cli_support import SMALL

from estimators.gap import Cause, Channel, Diagnosis, Estimate
from estimators.gap.diagnosis import Closed, Hypothesis, Remainder
from rig.channels import CHANNELS
from rig.effects import EFFECTS, Effect, make_effect
from rig.recording import Recording
from scenarios.loader import from_toml
from scenarios.scenario import Scenario

#: 0.05 rad of lash: over twenty times the noise in projection, so that no seed hides it.
BACKLASH = {"where": "joint5", "width_rad": 0.05}


def scenario() -> Scenario:
    return from_toml(SMALL, "small.toml")


def recorded(*effects: Effect, seed: int = 0) -> tuple[Recording, Recording]:
    """A recording of 600 samples with these effects, and a locked recording of the same rig without them."""
    return scenario().with_effects(effects).simulate(seed), scenario().simulate_locked(seed)


def backlash() -> Effect:
    return make_effect("backlash", BACKLASH)


def only(*names: str) -> list[str]:
    """Options of ``rig diagnose``, with which it takes a second: these effects are all that the catalogue has."""
    return [word for name in EFFECTS if name not in names for word in ("--without", name)]


#: The probability of the likeliest explanation that each verdict rests on.
LEADING = {"no-gap": 0.95, "named": 0.93, "ambiguous": 0.6, "partly": 0.5, "unknown": 0.6}
#: What a handmade remainder follows where something is left.
LEFT = ({"source": "a turn of the tool", "course": "time", "share": 0.1},)


def by_hand(
    verdict: str = "named",
    causes: tuple[Cause, ...] | None = None,
    name: str = "small",
    other: bool | None = None,
    rivals: tuple[tuple[tuple[str, str], ...], ...] = (),
    first: float | None = None,
) -> Diagnosis:
    """A diagnosis with every field filled, as the verdict would have it.

    Args:
        causes: of the likeliest explanation.
        other: whether something outside the catalogue is part of that; by default of partly and unknown.
        rivals: further explanations, which share what the likeliest leaves.
        first: the probability of the likeliest; by default one that suits the verdict.
    """
    own = replace(BY_HAND, probability=0.7) if verdict == "unknown" else BY_HAND
    found = (own,) if causes is None else causes
    there = verdict in ("partly", "unknown") if other is None else other
    first = LEADING[verdict] if first is None else first
    leading = Hypothesis(tuple((cause.effect, cause.where) for cause in found), there, first)
    each = (0.98 - first) / max(len(rivals), 1)
    latency = ("latency", "accelerometer")
    second = rivals or ((*leading.causes, latency) if verdict == "partly" else (latency,),)
    beside = [Hypothesis(each_set, there, each) for each_set in second]
    masses = {"nothing": 0.0, "known": 0.0, "other": 0.0}
    for one in (leading, *beside):
        masses["other" if one.other else "known" if one.causes else "nothing"] += one.probability
    masses["known"] += 0.02
    gap = Channel(
        noise_floor=0.0134, rms_before=0.0151, gap_before=0.007, rms_after=0.0134, gap_after=0.001, closed=0.98
    )
    quiet = Channel(noise_floor=0.0134, rms_before=0.0134, gap_before=0.0, rms_after=0.0134, gap_after=0.0, closed=None)
    there_is = verdict != "no-gap"
    return Diagnosis(
        recordings=(name,),
        samples=600,
        seconds=1.3,
        verdict=verdict,  # type: ignore[arg-type]
        posterior=masses,
        omitted=0.02,
        hypotheses=(leading, *beside),
        causes=found,
        channels=dict.fromkeys(CHANNELS, gap if there_is else quiet),
        follows=({"variable": "the direction of joint5", "share": 0.8}, {"variable": "time", "share": 0.02})
        if there_is
        else (),
        closed=Closed(0.97, 0.95, 0.99) if found else Closed(None, None, None),
        closed_on="held-out blocks",
        remainder=Remainder("structured" if there else "noise", LEFT if there else (), 9.0),
        calibration_shift={
            "accel1.sensitivity": {"before": 0.1420, "after": 0.1426, "sigmas": 12.0},
            "mag1.offset": {"before": 2.4, "after": 2.3999, "sigmas": -0.1},
        }
        if found
        else {},
        cannot_tell=(
            {"effect": "joint_offset", "where": "joint6", "why": "the calibration absorbs it on this maneuver"},
        ),
        next=None,
        floor="locked recording",
    )


def cause(
    effect: str,
    where: str,
    equivalent: tuple[dict[str, object], ...] = (),
    probability: float = 0.98,
    **parameters: tuple[object, object, str],
) -> Cause:
    estimates = {name: Estimate(*values) for name, values in parameters.items()}  # type: ignore[arg-type]
    return Cause(effect, where, probability, equivalent, estimates, Closed(0.97, 0.95, 0.99))


BY_HAND = cause("backlash", "joint5", width_rad=(0.05, 0.0004, "rad"))


def write_small(folder: Path, *effects: Effect, name: str = "run") -> Path:
    """The recording and its locked recording as files."""
    run, locked = recorded(*effects)
    run.write(folder / f"{name}.parquet")
    locked.write(folder / f"{name}.locked.parquet")
    return folder / f"{name}.parquet"
