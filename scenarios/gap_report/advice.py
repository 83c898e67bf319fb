"""What to do next, after every verdict: the same words for the terminal, the page and the JSON."""

from __future__ import annotations

from typing import Final

from estimators.gap.choices import and_words, parted
from estimators.gap.diagnosis import Diagnosis
from estimators.gap.report.by_channel import MAY_BE_FLOOR
from estimators.gap.report.separation import rivals
from scenarios.gap_report.words import alike_words, cause_title, place_words

#: What is left over follows an error source; how its name begins -> where on the rig to look.
_LOOK: Final = {
    "the angle of ": "look at {source}: its encoder, gears, bearing and cable, and whether the arm bends there",
    "the clock": "look at the clock: when the poses and the readings are stamped, and whether samples are lost",
    "a turn of the tool": "look at the mount of the sensors and the last link: screws, adhesive, bending",
    "a turn of link": "look at that link: whether it bends, and at the bearings at its ends",
    "a turn of the base": "look at the table under the arm: is it level, and does it give way or move",
    "the acceleration": "look for what shakes or accelerates the sensor: motors, fans, fast moves",
    "the magnetic field": "look for iron, magnets and currents near the arm, and in it",
    "a turn of the ": "look at how that sensor's board is fixed",
    "the offset of all": "look at the converter and the common ground",
    "the offset": "look at that sensor's supply, temperature and wiring",
    "the gain of all": "look at the converter's reference and the supply",
    "the gain": "look at that channel's amplifier, reference voltage and range",
    "noise of ": "look at that channel's wiring, shielding and supply while the arm moves",
    "single readings": "look at the cable, the connector and the converter's range",
}


def next_steps(diagnosis: Diagnosis) -> tuple[str, ...]:
    """What to do next, one sentence or two each, the most useful first."""
    steps = {
        "no-gap": _no_gap,
        "named": _named,
        "ambiguous": _ambiguous,
        "partly": _partly,
        "unknown": _unknown,
    }[diagnosis.verdict](diagnosis)
    if diagnosis.floor != "locked recording":
        steps.append(
            "Record the arm at rest in several poses, as NAME.locked.parquet beside NAME.parquet: without that "
            "recording the noise floor is a guess, and noise can hardly be told from a cause."
        )
    return tuple(steps)


def _no_gap(diagnosis: Diagnosis) -> list[str]:
    steps = ["Use the model with this calibration: nothing has to be added to the simulator."]
    if diagnosis.remainder.could_hide_snr is not None:
        steps.append("Where smaller gaps matter than this recording can show, record for longer.")
    if any(each["why"] != MAY_BE_FLOOR for each in diagnosis.cannot_tell):
        steps.append(
            "Where one of the effects that this recording cannot show is likely on the rig, record a maneuver that "
            "moves other joints."
        )
    return steps


def _named(diagnosis: Diagnosis) -> list[str]:
    simulate = (
        "Put what is named into the simulator: rig diagnose RUN --save-scenario improved.toml, then rig sweep "
        "improved.toml -o AGAIN.parquet."
    )
    repair = "repair it on the rig, record again and diagnose that: the verdict should be no gap."
    if rivals(diagnosis):
        return [
            f"{simulate} On this maneuver that is right whichever of them it is.",
            _alike(diagnosis) + _maneuver(diagnosis),
            f"Then {repair}",
        ]
    steps = [simulate, f"Or {repair}"]
    if diagnosis.closed_elsewhere is None:
        steps.append("To be surer, record another maneuver of the same rig and give it with --maneuver2.")
    return steps


def _alike(diagnosis: Diagnosis) -> str:
    """What the leading causes cannot be told from on this maneuver."""
    groups = "; ".join(
        f"{cause_title(cause.effect, cause.where)} and {alike_words(cause)}"
        for cause in diagnosis.leading
        if cause.equivalent
    )
    return f"On this maneuver these do the same to the readings: {groups}. " if groups else ""


def _ambiguous(diagnosis: Diagnosis) -> list[str]:
    shared, _ = parted([one.causes for one in diagnosis.alternatives])
    established = [(cause.effect, cause.where) for cause in diagnosis.established]
    sure = [cause_title(*cause) for cause in shared if cause in established]
    first = (
        f"Repair no more than what all explanations have, {and_words(sure)}: which of the rest is there, the recording "
        "does not tell. "
        if sure
        else "Do not repair anything yet: several explanations fit, and the recording does not decide between them. "
    )
    return [
        first + _alike(diagnosis) + _maneuver(diagnosis),
        "A simulator that only has to repeat this maneuver can use the likeliest explanation: rig diagnose RUN "
        "--save-scenario improved.toml.",
    ]


def _maneuver(diagnosis: Diagnosis) -> str:
    if diagnosis.next and diagnosis.next.get("maneuver"):
        return "Record the maneuver below, which tells them apart, and diagnose both: rig diagnose RUN NEXT --together."
    return "Record another maneuver: other joints, other speeds, or longer."


def _partly(diagnosis: Diagnosis) -> list[str]:
    names = and_words([cause_title(cause.effect, cause.where) for cause in diagnosis.established])
    steps = [
        f"Repair what is established ({names}), or put it into the simulator, and record again: the rest is easier to "
        "tell once this is gone.",
        *_looks(diagnosis),
    ]
    if diagnosis.posterior["other"] < 0.5:
        steps.append("For the rest, record longer, or a maneuver that moves other joints: more than one thing fits it.")
    steps.append("Do not trust causes with a probability below .95: they may stand in for something else.")
    return steps


def _unknown(diagnosis: Diagnosis) -> list[str]:
    if diagnosis.posterior["other"] < 0.5:
        return [
            "Record longer, or a maneuver that moves other joints, and diagnose that: many explanations fit this "
            "recording, and none stands out.",
            "Do not repair or simulate any of the causes yet.",
        ]
    return [
        *(
            _looks(diagnosis)
            or ["Look at the maps and spectra of this recording's page for what the gap repeats with."]
        ),
        "Change one thing on the rig at a time, record the same maneuver again, and see whether the gap changes.",
    ] + (
        ["Do not simulate the causes that are listed: they may stand in for something outside the catalogue."]
        if diagnosis.causes
        else []
    )


def _looks(diagnosis: Diagnosis) -> list[str]:
    """Where on the rig to look, for what is left over."""
    found: list[str] = []
    for each in diagnosis.remainder.follows:
        source = str(each["source"])
        words = next((words for start, words in _LOOK.items() if source.startswith(start)), None)
        if words is not None:
            place = place_words(source.removeprefix("the angle of "))
            what = f"an error of {source}" if source.startswith("the ") else source
            begin = "Or it acts" if found else "What is left acts"
            found.append(
                f"{begin} like {place_words(what)}, along {place_words(str(each['course']))}: "
                f"{words.format(source=place)}."
            )
    return list(dict.fromkeys(found))[:3]
