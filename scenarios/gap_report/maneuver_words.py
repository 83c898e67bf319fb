"""A next maneuver in words: what the arm does, what it promises, and what no maneuver helps against."""

from __future__ import annotations

import numpy as np

from estimators.gap.choices import and_words
from estimators.gap.diagnosis import NAMED, Diagnosis
from estimators.gap.report.separation import rivals
from rig.effects import EFFECTS, Kind
from rig.maneuver import StaticPoses, TorusSweep
from scenarios.gap_report.words import cause_title


def described(maneuver: TorusSweep | StaticPoses, warmer_degC: float = 0.0) -> str:
    """A maneuver in words, and how much warmer or colder than before the room should be."""
    minutes = f"{maneuver.duration_s / 60.0:.3g} minutes"
    if warmer_degC:
        minutes += f", the room {warmer_degC:g} °C warmer or colder"
    if isinstance(maneuver, StaticPoses):
        return (
            f"{len(maneuver.angles)} poses of all joints, each held for {maneuver.hold_s:.3g} s, with "
            f"{maneuver.move_s:.3g} s to move to the next; {minutes}"
        )
    yaw, pitch, roll = maneuver.joints
    turning = (
        f"joint {roll} turning at {_degrees(maneuver.roll_deg_per_s)} deg/s"
        if maneuver.roll == "continuous"
        else f"joint {roll} to and fro over {_degrees(maneuver.roll_range_deg)} deg in {maneuver.roll_passes} passes"
    )
    still = [joint for joint in range(1, len(maneuver.locked_deg) + 4) if joint not in maneuver.joints]
    locked = ", ".join(
        f"joint {joint} at {_degrees(angle)}" for joint, angle in zip(still, maneuver.locked_deg, strict=True)
    )
    return (
        f"joint {yaw} over {_degrees(maneuver.yaw_range_deg)} deg about {_degrees(maneuver.yaw_centre_deg)} in "
        f"{maneuver.yaw_passes} passes, joint {pitch} over {_degrees(maneuver.pitch_range_deg)} deg about "
        f"{_degrees(maneuver.pitch_centre_deg)} in "
        f"{maneuver.pitch_passes} passes, {turning}; {locked} deg; {minutes}"
    )


def _degrees(angle: float) -> str:
    """To a tenth, with a true minus sign."""
    return f"{round(angle, 1) + 0.0:g}".replace("-", "−")


def interval_words(size: float, low: float, high: float | None) -> str:
    """A promised chi-square: "930 (749–1111)", or "930 (at least 749)" where parts of the cause are not known."""
    if high is None or not np.isfinite(high):
        return f"{size:.0f} (at least {max(low, 0.0):.0f})"
    return f"{size:.0f} ({max(low, 0.0):.0f}–{high:.0f})"


def decides(chi_square: float) -> bool:
    """Whether a chi-square makes the right one of two explanations, as likely as the other before, a named one."""
    return chi_square >= 2.0 * float(np.log(NAMED / (1.0 - NAMED)))


def speed_advice(diagnosis: Diagnosis) -> str:
    """What tells effects apart that depend on the samples before a reading; empty where there are none.

    Their difference is of second order in speed, which samples thinned for a search do not resolve.
    """
    contested = [effect for effect, _ in _contested(diagnosis) if EFFECTS[effect].remembers]
    if not contested:
        return ""
    return (
        "Sweep as fast as the arm may, at the board's full rate: only fast motion that is sampled closely shows what "
        f"{and_words(list(dict.fromkeys(each.replace('_', ' ') for each in contested)))} do to the readings."
    )


def noise_advice(diagnosis: Diagnosis) -> str:
    """What tells noise effects apart, where these are what is contested; empty otherwise."""
    contested = [each for each in _contested(diagnosis) if EFFECTS[each[0]].kind is Kind.NOISE]
    if not contested:
        return ""
    titles = and_words([cause_title(*each) for each in contested])
    return (
        f"Record longer, or at rest at a higher rate: only the spectrum of noise tells what it is ({titles}), and no "
        "maneuver changes that."
    )


def _contested(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """The causes that some of the explanations have and others have not."""
    sets = rivals(diagnosis)
    every = dict.fromkeys(each for one in sets for each in one)
    return [each for each in every if not all(each in one for one in sets)]
