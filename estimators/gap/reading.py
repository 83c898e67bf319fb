"""A diagnosis read back from its JSON file."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Final

from estimators._json import Reader
from estimators.gap.diagnosis import (
    FORMAT,
    Cause,
    Channel,
    Closed,
    Diagnosis,
    Estimate,
    Hypothesis,
    Number,
    OneOf,
    Remainder,
)
from estimators.gap.pooled import pooled
from rig.documents import read_json
from rig.errors import RigError, shown, unknown_name

_VERDICTS: Final = ("no-gap", "named", "ambiguous", "partly", "unknown")


def read_diagnosis(path: str | os.PathLike[str]) -> Diagnosis:
    """The diagnosis in a file that ``Diagnosis.write`` has written; keys beyond the contract's are passed over.

    Raises:
        RigError: the file cannot be read, or holds something else.
    """
    return diagnosis_of(read_json(Path(path), "a diagnosis"), str(path))


def diagnosis_of(document: Any, where: str) -> Diagnosis:
    """The diagnosis of a JSON object; ``where`` begins every message.

    Raises:
        RigError: it is something else.
    """
    top = Reader(document, where)
    if (found := top.plain("format")) != FORMAT:
        raise RigError(f"{where}: format: found {shown(found)}, expected {FORMAT!r}")
    if (verdict := top.text("verdict")) not in _VERDICTS:
        raise unknown_name(f"verdict in {where}", verdict, _VERDICTS)
    place, left = top.within("where"), top.within("remainder")
    recordings, channels = top.strings("recordings"), place.within("channels")
    own = [recordings[0]] if len(recordings) == 1 else list(channels.content)
    each_channel = {name: channels if len(recordings) == 1 else channels.within(name) for name in own}
    by_recording = {
        name: {channel: _channel(held.within(channel)) for channel in held.content}
        for name, held in each_channel.items()
    }
    closed = top.within("closed")
    return Diagnosis(
        recordings=recordings,
        samples=top.whole("samples"),
        seconds=top.number("seconds"),
        verdict=verdict,  # type: ignore[arg-type]
        posterior=top.numbers("posterior"),
        omitted=top.number("omitted"),
        hypotheses=tuple(
            Hypothesis(_labels(each), bool(each.plain("other")), each.number("probability"))
            for each in top.items("hypotheses")
        ),
        at_least_one=tuple(
            OneOf(_labels(each), each.number("probability"))
            for each in (top.items("at_least_one") if "at_least_one" in top.content else ())
        ),
        causes=tuple(_cause(each) for each in top.items("causes")),
        channels=pooled(list(by_recording.values())),
        follows=tuple(each.content for each in place.items("follows")),
        closed=_closed(closed),
        closed_on=closed.text("on"),
        remainder=Remainder(
            left.text("verdict"), tuple(each.content for each in left.items("follows")), _number(left, "could_hide_snr")
        ),
        calibration_shift={
            name: top.within("calibration_shift").numbers(name) for name in top.within("calibration_shift").content
        },
        cannot_tell=tuple(each.content for each in top.items("cannot_tell")),
        next=None if (following := top.optional("next")) is None else following.content,
        floor=top.text("floor"),
        warnings=top.strings("warnings", ()),
        closed_elsewhere=_number(closed, "other_maneuver"),
        rig=None if (rig := top.optional("rig")) is None else rig.content,
        by_recording=by_recording if len(recordings) > 1 else {},
        names={
            each.text("where"): name for each in top.items("causes") if (name := each.optional_text("name")) is not None
        },
    )


def _labels(hypothesis: Reader) -> tuple[tuple[str, str], ...]:
    causes = hypothesis.plain("causes")
    if not isinstance(causes, list) or not all(
        isinstance(each, list) and len(each) == 2 and all(isinstance(part, str) for part in each) for each in causes
    ):
        raise RigError(f"{hypothesis.where}.causes: found {shown(causes)}, expected pairs of an effect and a place")
    return tuple((effect, where) for effect, where in causes)


def _cause(cause: Reader) -> Cause:
    equivalent = tuple(
        {"effect": each.text("effect"), "where": each.text("where"), "probability": each.number("probability")}
        for each in cause.items("equivalent")
    )
    parameters = cause.within("parameters")
    return Cause(
        cause.text("effect"),
        cause.text("where"),
        cause.number("probability"),
        equivalent,
        {name: _estimate(parameters.within(name)) for name in parameters.content},
        _closed(cause.within("closed")),
        cause.optional_text("recording"),
        cause.numbers("evidence") if cause.plain("evidence") else {},
    )


def _estimate(estimate: Reader) -> Estimate:
    value = estimate.plain("value")
    return Estimate(
        value if isinstance(value, str) else _numbers(estimate, "value"),
        _numbers(estimate, "std"),
        estimate.text("unit"),
        estimate.optional_text("why"),
        _numbers(estimate, "fitted") if "fitted" in estimate.content else None,
    )


def _numbers(holder: Reader, name: str) -> Number | tuple[Number, ...]:
    value = holder.plain(name)
    if not isinstance(value, list):
        return _number(holder, name)
    return tuple(_number(Reader({name: each}, holder.where), name) for each in value)


def _number(holder: Reader, name: str) -> Number:
    return None if holder.plain(name) is None else holder.number(name)


def _channel(channel: Reader) -> Channel:
    names = ("noise_floor", "rms_before", "gap_before", "rms_after", "gap_after")
    return Channel(**{name: channel.number(name) for name in names}, closed=_number(channel, "closed"))


def _closed(closed: Reader) -> Closed:
    return Closed(_number(closed, "value"), _number(closed, "low"), _number(closed, "high"))
