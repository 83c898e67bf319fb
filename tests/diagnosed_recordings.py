"""A short sweep with and without a known cause, and diagnoses of it made by hand."""

from __future__ import annotations

from pathlib import Path

from cli_support import SMALL

from estimators.gap import Cause, Channel, Diagnosis, Estimate
from rig.channels import CHANNELS
from rig.effects import Effect, make_effect
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


def by_hand(
    verdict: str = "named", causes: tuple[Cause, ...] | None = None, remainder: str = "noise", name: str = "small"
) -> Diagnosis:
    """A diagnosis with every field filled."""
    channel = Channel(
        noise_floor=0.0134, rms_before=0.0151, gap_before=0.007, rms_after=0.0134, gap_after=0.001, closed=0.98
    )
    found = (cause("backlash", "joint5", width_rad=(0.05, 0.0004, "rad")),) if causes is None else causes
    left = ({"variable": "frequency", "channel": "mag1", "share": 1.0},) if remainder == "structured" else ()
    return Diagnosis(
        recording=name,
        samples=600,
        seconds=1.3,
        verdict=verdict,  # type: ignore[arg-type]
        causes=found,
        channels=dict.fromkeys(CHANNELS, channel),
        follows=({"variable": "q5 direction", "share": 0.8}, {"variable": "time", "share": 0.01}),
        closed=0.97 if found else None,
        closed_low=0.95 if found else None,
        closed_high=0.99 if found else None,
        closed_on="held-out blocks",
        remainder=remainder,
        remainder_follows=left,
        calibration_shift={
            "accel1.sensitivity": {"before": 0.1420, "after": 0.1426, "sigmas": 12.0},
            "mag1.offset": {"before": 2.4, "after": 2.3999, "sigmas": -0.1},
        },
        cannot_tell=(
            {"effect": "joint_offset", "where": "joint6", "why": "the calibration absorbs it on this maneuver"},
        ),
        next=None,
        floor="locked recording",
    )


def cause(
    effect: str,
    where: str,
    equivalent: tuple[dict[str, str], ...] = (),
    **parameters: tuple[float | tuple[float, ...] | str, float | tuple[float, ...] | None, str],
) -> Cause:
    estimates = {name: Estimate(*values) for name, values in parameters.items()}
    return Cause(effect, where, 0.98, equivalent, estimates, 1e-30, 0.97)


def write_small(folder: Path, *effects: Effect, name: str = "run") -> Path:
    """The recording and its locked recording as files."""
    run, locked = recorded(*effects)
    run.write(folder / f"{name}.parquet")
    locked.write(folder / f"{name}.locked.parquet")
    return folder / f"{name}.parquet"
