"""What to do next, after every verdict: the same words for the terminal, the page and the JSON."""

from __future__ import annotations

from typing import Final

from estimators.gap.choices import and_words, parted
from estimators.gap.diagnosis import NAMED, Diagnosis
from estimators.gap.remainder_words import error_words, is_noise, is_second, source_words
from estimators.gap.report.by_channel import ABSORBED
from estimators.gap.report.separation import rivals
from estimators.gap.share_words import chance
from scenarios.gap_report.maneuver_words import decides
from scenarios.gap_report.words import cause_title, explanation_words, readable

#: What is left over acts like an error; how its name begins -> what to look at on the rig.
_LOOK: Final = {
    "the angle of ": "look at {source} (its encoder, gears, bearing and cable, and whether the arm bends there)",
    "the clock": "see when the poses and the readings are time-stamped, and whether samples are lost",
    "a turn of the tool": "look at the mount of the sensors and the last link (screws, adhesive, bending)",
    "a turn of link": "see whether that link bends, and look at the bearings at its ends",
    "a turn of the base": "see whether the table under the arm is level, gives way or moves",
    "the acceleration": "look for what shakes or accelerates the sensor: motors, fans, fast moves",
    "the magnetic field": "look for iron, magnets and currents near the arm, and in it",
    "a turn of the ": "look at how the board of the {source} is fixed",
    "the offset of all": "look at the converter and the common ground",
    "the offset": "look at the supply, temperature and wiring of {source}",
    "the gain of all": "look at the converter's reference and the supply",
    "the gain": "look at the amplifier, reference voltage and range of {source}",
    "the strength of ": "see what changes {source} during the maneuver",
    "single readings": "look at the cable, the connector and the converter's range",
}

#: Where another maneuver speaks against the causes.
_REFUTED: Final = (
    "Do not rely on what is named: the other maneuver speaks against it. Diagnose both with rig diagnose RUN OTHER "
    "--together; where the rig was changed between them, each by itself."
)


def next_steps(diagnosis: Diagnosis) -> tuple[str, ...]:
    """What to do next, one sentence or two each, the most useful first."""
    verdicts = {
        "no-gap": _no_gap,
        "named": _named,
        "ambiguous": _ambiguous,
        "partly": _partly,
        "unknown": _unknown,
    }
    refuted = diagnosis.closed_elsewhere is not None and diagnosis.closed_elsewhere < 0.0
    steps = [_REFUTED] if refuted else verdicts[diagnosis.verdict](diagnosis)
    if diagnosis.floor != "locked recording":
        steps.append(
            "Record the arm at rest in several poses, as NAME.locked.parquet beside NAME.parquet: without that "
            "recording the noise floor is a guess, and noise can hardly be told from a cause."
        )
    return tuple(steps)


def _no_gap(diagnosis: Diagnosis) -> list[str]:
    rig = diagnosis.rig
    if rig is None:
        steps = ["Use the model with this calibration: nothing has to be added to the simulator."]
    elif rig["better"]:
        steps = [f"Use the fitted rig, {rig['name']}, in the simulator: nothing has to be added to it."]
    else:
        steps = [
            f"Judge {rig['name']} by another recording: this one does not show it to be better than the ideal rig."
        ]
    likely = [one for one in diagnosis.hypotheses if one.causes or one.other]
    if diagnosis.posterior["nothing"] < NAMED and likely:
        steps.append(
            f"Record for longer to be sure: {explanation_words(likely[0])} may be there (probability "
            f"{chance(likely[0].probability)}), too weak for this recording to show."
        )
    elif diagnosis.remainder.could_hide_snr is not None:
        steps.append("If gaps matter that are too small for this recording to show, record for longer.")
    if any(each["why"] == ABSORBED for each in diagnosis.cannot_tell):
        steps.append(
            "If an effect that the calibration absorbs is likely on the rig (see what this recording cannot tell), "
            "record a maneuver that moves other joints."
        )
    return steps


def _named(diagnosis: Diagnosis) -> list[str]:
    rig = diagnosis.rig
    simulate = (
        "Put what is named into the simulator: rig diagnose RUN --save-scenario improved.toml, then rig sweep "
        "improved.toml -o AGAIN.parquet."
        if rig is None
        else f"What is named comes on top of what {rig['name']} has: fit the rig anew, with rig diagnose RUN "
        "--save-scenario improved.toml, and judge that by another recording."
    )
    repair = "repair it on the rig, record again and diagnose that: the verdict should be no gap."
    if rivals(diagnosis):
        return [
            f"{simulate} On this maneuver that is right whichever of the causes that do the same it is.",
            _alike(diagnosis) + _maneuver(diagnosis),
            f"Then {repair}",
        ]
    steps = [simulate] if rig is not None else [simulate, f"Or {repair}"]
    if diagnosis.closed_elsewhere is None and rig is None and len(diagnosis.recordings) == 1:
        steps.append("To be surer, record another maneuver of the same rig and give it with --maneuver2.")
    return steps


def _alike(diagnosis: Diagnosis) -> str:
    """What the leading causes cannot be told from on this maneuver."""
    groups = "; ".join(
        and_words(
            [cause_title(cause.effect, cause.where)]
            + [cause_title(each["effect"], each["where"]) for each in cause.equivalent]
        )
        for cause in diagnosis.leading
        if cause.equivalent
    )
    return f"On this maneuver these do the same to the readings: {groups}. " if groups else ""


def _ambiguous(diagnosis: Diagnosis) -> list[str]:
    shared, _ = parted([one.causes for one in diagnosis.alternatives])
    established = [(cause.effect, cause.where) for cause in diagnosis.established]
    sure = [cause_title(*cause) for cause in shared if cause in established]
    first = (
        f"Repair only what all explanations have ({and_words(sure)}): the recording does not tell which of the rest is "
        "there. "
        if sure
        else "Do not repair anything yet: several explanations fit, and the recording does not decide between them. "
    )
    return [
        first + _alike(diagnosis) + _maneuver(diagnosis),
        "A simulator that only has to repeat this maneuver can use the likeliest explanation: rig diagnose RUN "
        "--save-scenario improved.toml.",
    ]


def _maneuver(diagnosis: Diagnosis) -> str:
    step = diagnosis.next or {}
    if step.get("maneuver"):
        apart = "some of them" if step.get("cannot_separate") else "them"
        tells = "tells" if all(decides(pair["low"]) for pair in step.get("separates", ())) else "may tell"
        together = "rig diagnose RUN NEXT --together"
        return f"Record the maneuver below, which {tells} {apart} apart, and diagnose both: {together}."
    if step.get("why"):  # in words only
        return str(step["why"])
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
    if len(diagnosis.established) < len(diagnosis.causes):
        steps.append("Do not trust the causes with a probability below .95: they may stand in for something else.")
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


def _owner(source: str) -> str:
    """Whose error it is: "joint 5" of "the angle of joint5"."""
    name = source.removeprefix("a turn of the ")
    return readable(name.partition(" of ")[2] or name)


def _looks(diagnosis: Diagnosis) -> list[str]:
    """Where on the rig to look, for what is left over: for errors, one of which is meant, and for noise."""
    found: list[str] = []
    looked: set[str] = set()
    noisy = [each for each in diagnosis.remainder.follows if is_noise(each)]
    for each in diagnosis.remainder.follows:
        source = str(each["source"])
        words = next((words for start, words in _LOOK.items() if source.startswith(start)), None)
        if words is not None:
            look = words.format(source=_owner(source))
            like = f"acts like {readable(error_words(each))}"
            if is_second(each):
                if look not in looked:
                    found.append(f"Beside that, {look}: more of what is left {like}.")
            else:
                upper = f"{look[0].upper()}{look[1:]}"
                found.append(f"{upper}: what is left {like}." if not found else f"Or {look}: it also {like}.")
            looked.add(look)
    found = list(dict.fromkeys(found))[:4]
    if noisy:
        bands = and_words([f"{source_words(str(each['source']))} ({each['course']})" for each in noisy])
        these = "that channel's" if len(noisy) == 1 else "these channels'"
        found.append(f"Look at {these} wiring, shielding and supply while the arm moves: what is left has {bands}.")
    return found
