"""What to do next, after every verdict: the same words for the terminal, the page and the JSON."""

from __future__ import annotations

import re
from typing import Final

from estimators.gap.cause_words import naming
from estimators.gap.choices import and_words, cause_names, count_words, parted
from estimators.gap.diagnosis import INFORMATIVE, NAMED, Diagnosis
from estimators.gap.hypotheses.sources import STRENGTH
from estimators.gap.parameter_words import sizes_words
from estimators.gap.remainder_words import (
    WORTH_A_LOOK,
    error_words,
    grouped,
    noise_and_bands,
    noisy_channel,
    of_constant_strength,
)
from estimators.gap.report.separation import rivals
from estimators.gap.share_words import chance
from scenarios.gap_report.maneuver_words import decides
from scenarios.gap_report.untold import another_maneuver_tells
from scenarios.gap_report.words import cause_title, explanation_words, on_paper, readable

#: What is left over acts like an error; how its name begins -> what to look at on the rig.
_LOOK: Final = {
    "the angle of ": "look at {source} (its encoder, gears, bearing and cable, and whether the arm bends there)",
    "the clock": "see when the poses and the readings are time-stamped, and whether samples are lost",
    "a turn of the tool": "look at the mount of the sensors and the last link (screws, adhesive, bending)",
    "a turn of link": "see whether {source} bends, and look at the bearings at its ends",
    "a turn of the base": "see whether the table under the arm is level, gives way or moves",
    "the acceleration": "look for what shakes or accelerates the sensor: motors, fans, fast moves",
    "the magnetic field": "look for iron, magnets and currents near the arm, and in it",
    "a turn of the ": "look at how the board of the {source} is fixed",
    "the offset of all": "look at the converter and the common ground",
    "the offset": "look at the supply, temperature and wiring of {source}",
    "the gain of all": "look at the converter's reference and the supply",
    "the whole reading": "look at the amplifier behind {source}, its reference voltage, supply and connector",
    "the gain": "look at the amplifier, reference voltage and range of {source}",
    STRENGTH: "look at what could change {source} (in the catalogue its strength is constant)",
    "single readings": "look at the cable, the connector and the converter's range",
}

#: What repeats, in a joint's angle, a channel's level or in time: as what it is left over acts, whatever is off -> what
#: to look at.
_REPEATS: Final = (
    (
        re.compile(r"(?:every|a sine of) .* of (joint\d+)"),
        "look at {0} for what has that period: gear teeth, bearings, the poles of its motor, the lines of its encoder",
    ),
    (
        re.compile(r"(?:every|a sine of) .* of the span of (\w+)"),
        "look at the converter of {0}: a bit that sticks, codes of unequal width",
    ),
    (re.compile(r"every (.* s)"), "look for what is switched, pulsed or sent every {0}"),
)
#: What else to look for: of what changes at any rate, and of what remembers.
_ALSO: Final = {
    "time, irregularly": "; look for what comes and goes nearby, too: draughts, vehicles, other machines",
    "position, as a static": "; look for what stands there all along, too: cables with a steady current, beams",
    "the fading memory": "; look for what stores and gives back, too: steel near the sensor, a filter, what creeps",
}
#: What comes once or a few times and passes: when to look.
_PASSES: Final = re.compile(r"time, (?:once|\d+ times, first) (?:about|from) (\S+ s)\b.*")
#: A command on the recordings of a diagnosis.
_OF_RECORDINGS: Final = re.compile(r"rig diagnose RUN(?: OTHER| NEXT)?")
#: So many errors at most are looked for.
_LOOKS: Final = 4
#: Share of the squared gap below which what closes it is less than what is left.
_LITTLE: Final = 0.5
#: Where another maneuver speaks against the causes.
_REFUTED: Final = (
    "Do not rely on what is named: the other maneuver speaks against it. Diagnose both with rig diagnose RUN OTHER "
    "--together; where the rig was changed between them, each by itself."
)

#: Where a warning speaks against the recordings.
_WARNED: Final = (
    "See to what the warnings say first, and record again: what is named, or is not, may come from that alone."
)


def next_steps(diagnosis: Diagnosis, options: str = "") -> tuple[str, ...]:
    """What to do next, one sentence or two each, the most useful first; as the diagnosis has them, where it does.

    Args:
        options: that its recordings need in a command, such as ``--arm ur5e.urdf``.
    """
    if stored := (diagnosis.next or {}).get("steps"):
        return tuple(map(str, stored))
    steps = _steps(diagnosis)
    return (
        tuple(_OF_RECORDINGS.sub(lambda found: f"{found[0]} {options}", step) for step in steps) if options else steps
    )


def _steps(diagnosis: Diagnosis) -> tuple[str, ...]:
    verdicts = {
        "no-gap": _no_gap,
        "named": _named,
        "ambiguous": _ambiguous,
        "partly": _partly,
        "unknown": _unknown,
    }
    refuted = diagnosis.closed_elsewhere is not None and diagnosis.closed_elsewhere < 0.0
    steps = [_REFUTED] if refuted else verdicts[diagnosis.verdict](diagnosis)
    if any(not warning.startswith(INFORMATIVE) for warning in diagnosis.warnings):
        steps.insert(0, _WARNED)
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
            f"Record for longer to be sure: {explanation_words(likely[0], diagnosis.causes)} may be there (probability "
            f"{chance(likely[0].probability)}), too weak for this recording to show."
        )
    elif diagnosis.remainder.could_hide_snr is not None:
        steps.append("If gaps matter that are too small for this recording to show, record for longer.")
    if another_maneuver_tells(diagnosis):
        steps.append(
            "If an effect that the calibration absorbs is likely on the rig (see what this recording cannot tell), "
            f"record {_another_maneuver(diagnosis)}."
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
            f"{simulate} On this maneuver that is right whichever of those that do the same is there.",
            _alike(diagnosis) + _maneuver(diagnosis),
            f"Then {repair}",
        ]
    steps = [simulate] if rig is not None else [simulate, f"Or {repair}"]
    if diagnosis.closed_elsewhere is None and rig is None and len(diagnosis.recordings) == 1:
        steps.append("To be surer, record another maneuver of the same rig and give it with --maneuver2.")
    return steps


def _alike(diagnosis: Diagnosis) -> str:
    """What the leading causes cannot be told from on this maneuver."""
    sizes = {(each["effect"], each["where"]): each["size"] for each in (diagnosis.next or {}).get("equivalents", ())}

    def titled(effect: str, where: str, size: str) -> str:
        return cause_title(effect, where) + (f" ({on_paper(size)})" if size and sizes else "")

    groups = "; ".join(
        and_words(
            [titled(cause.effect, cause.where, sizes_words(cause))]
            + [
                titled(each["effect"], each["where"], sizes.get((each["effect"], each["where"]), ""))
                for each in cause.equivalent
            ]
        )
        for cause in diagnosis.leading
        if cause.equivalent
    )
    return f"On this maneuver these do the same to the readings: {groups}. " if groups else ""


def _ambiguous(diagnosis: Diagnosis) -> list[str]:
    sets = diagnosis.alternatives
    shared, _ = parted([one.causes for one in sets])
    established = [(cause.effect, cause.where) for cause in diagnosis.established]
    sure = cause_names([cause for cause in shared if cause in established], naming(diagnosis.causes, cause_title))
    first = (
        f"Repair only what the {count_words(len(sets))} likeliest explanations by known causes all have "
        f"({and_words(sure)}): the recording does not tell which of the rest is there. "
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
    return (
        f"Record another maneuver: {'other turns' if _armless(diagnosis) else 'other joints'}, other speeds, or longer."
    )


def _another_maneuver(diagnosis: Diagnosis) -> str:
    return f"a maneuver that {'turns the sensor in other ways' if _armless(diagnosis) else 'moves other joints'}"


def _armless(diagnosis: Diagnosis) -> bool:
    """Whether nobody knows of any joints."""
    return any(each["where"] == "joints" for each in diagnosis.cannot_tell)


def _partly(diagnosis: Diagnosis) -> list[str]:
    name = naming(diagnosis.causes, cause_title)
    names = and_words(cause_names([(cause.effect, cause.where) for cause in diagnosis.established], name))
    repair = (
        f"Repair what is established ({names}), or put it into the simulator, and record again: the rest is easier to "
        "tell once this is gone."
    )
    looks = _looks(diagnosis)
    little = diagnosis.closed.value is not None and diagnosis.closed.value < _LITTLE
    steps = [*looks, repair] if looks and little else [repair, *looks]
    if diagnosis.posterior["other"] < 0.5:
        steps.append(f"To see what else is there, if anything, record longer, or {_another_maneuver(diagnosis)}.")
    if len(diagnosis.established) < len(diagnosis.causes):
        steps.append("Do not trust any single cause with a probability below .95: it may stand in for something else.")
    return steps


def _unknown(diagnosis: Diagnosis) -> list[str]:
    if diagnosis.posterior["other"] < 0.5:
        more = f"Record longer, or {_another_maneuver(diagnosis)}, and diagnose that: "
        if diagnosis.likely is None:
            return [
                more + "many explanations fit this recording, and none stands out.",
                "Do not repair or simulate any of the causes yet.",
            ]
        likely = explanation_words(diagnosis.likely, diagnosis.causes)
        return [f"{more}{likely} is likely, but not certain.", "Do not repair or simulate it yet."]
    return [
        *(
            _looks(diagnosis)
            or ["Look at the maps and spectra of this recording's page for what the gap repeats with."]
        ),
        "Change one thing on the rig at a time, record the same maneuver again, and see whether the gap changes.",
        *_not_to_simulate(diagnosis),
    ]


def _not_to_simulate(diagnosis: Diagnosis) -> list[str]:
    """Beside something outside the catalogue: which causes are no part of a simulator, and why."""
    if not diagnosis.causes:
        return []
    name = naming(diagnosis.causes, cause_title, chances=False)
    groups = [and_words([name(*each) for each in one.causes]) for one in diagnosis.at_least_one]
    if not groups:
        return ["Do not simulate the causes that are listed: they may stand in for something outside the catalogue."]
    there = "".join(f"at least one of {names} is there, but which is not known; " for names in groups)
    return [
        f"Do not simulate the causes that are listed: {there}any single one may stand in for something outside the "
        "catalogue."
    ]


def _owner(source: str) -> str:
    """Whose error it is: "joint 5" of "the angle of joint5"."""
    if source.startswith(STRENGTH):
        return readable(of_constant_strength(source))
    name = source.removeprefix("a turn of the ")
    return readable(name.partition(" of ")[2] or name)


def _look(source: str, course: str) -> str:
    """Where on the rig to look for an error of a source along a course; empty where nothing is known."""
    for pattern, words in _REPEATS:
        if found := pattern.fullmatch(course):
            return words.format(readable(found[1]))
    words = next((words for start, words in _LOOK.items() if source.startswith(start)), "")
    also = next((text for start, text in _ALSO.items() if course.startswith(start)), "")
    if passes := _PASSES.fullmatch(course):
        also = f"; see what happened there at {passes[1]}, too: a knock, a brake, a gripper, something carried past"
    return words.format(source=_owner(source)) + (also if words else "")


def _looks(diagnosis: Diagnosis) -> list[str]:
    """Where on the rig to look, for what is left over: for errors, one of which is meant, and for noise.

    The largest share first; what has next to none of the gap is no reason to look anywhere.
    """
    errors, second, noise = (
        [each for each in group if each["share"] >= WORTH_A_LOOK] for group in grouped(diagnosis.remainder.follows)
    )
    owners = {_owner(str(each["source"])) for each in errors if not str(each["source"]).startswith(STRENGTH)}
    found: list[str] = []
    looked: set[str] = set()
    for each in [*errors, *second]:
        source = str(each["source"])
        look = _look(source, str(each["course"]))
        # a joint that another entry has is looked at whole
        again = source.startswith(STRENGTH) and readable(source.rpartition(" at ")[2]) in owners
        if not look or look in looked or again:
            continue
        looked.add(look)
        like = f"acts like {readable(error_words(each))}"
        if not found:
            found.append(f"{look[0].upper()}{look[1:]}: what is left {like}.")
        elif each in second:
            found.append(f"Beside that, {look}: more of what is left {like}.")
        else:
            found.append(f"Or {look}: it also {like}.")
    found = found[:_LOOKS]
    if not noise:
        return found
    channels = and_words(list(dict.fromkeys(noisy_channel(str(each["source"])) for each in noise)))
    look = (
        f"Look at the wiring, shielding and supply of {channels} while the arm moves: what is left has "
        f"{readable(noise_and_bands(noise))}."
    )
    largest = max((each["share"] for each in [*errors, *second]), default=0.0)
    return [look, *found] if noise[0]["share"] > largest else [*found, look]
