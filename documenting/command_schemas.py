"""JSON Schemas of what commands only print: ``rig compare``, ``rig check``, ``rig import`` and ``rig live``."""

from __future__ import annotations

from documenting.json_schema import (
    ANY,
    NUMBER,
    TEXT,
    TEXT_OR_NONE,
    TOLD,
    WHOLE,
    YES,
    Schema,
    list_of,
    object_of,
    of_class,
    one_of,
    table_of,
)
from rig.channels import SENSORS
from rig.effects import EFFECTS
from scenarios.beside_simulation import ChannelApart
from scenarios.comparison import Apart, Compared


def compared() -> Schema:
    """What ``rig compare`` prints: calibrations, or a recording beside its simulation."""
    head = {"first": TEXT, "second": TEXT, "alike": YES}
    two = {"parameters": list_of(of_class(Compared)), "together": table_of(of_class(Apart), *SENSORS)}
    beside = {"averaged": WHOLE, "channels": list_of(of_class(ChannelApart))}
    return {"anyOf": [object_of({**head, **two}), object_of({**head, **beside})]}


def checked() -> Schema:
    """What ``rig check`` prints."""
    return object_of({"file": TEXT, "kind": TEXT, "holds": table_of(ANY), "findings": list_of(TEXT)})


def imported() -> Schema:
    """What ``rig import`` prints."""
    return object_of(
        {
            "recording": TEXT_OR_NONE,
            "map": TEXT_OR_NONE,
            "samples": WHOLE,
            "duration_s": NUMBER,
            "pose": one_of("joints", "tool", "none"),
            "units": table_of(TEXT, *SENSORS),
            "columns": table_of(TEXT),
            "said": list_of(TEXT),
            "findings": list_of(TEXT),
            "unused": table_of(list_of(TEXT)),
        }
    )


def live(sensors: Schema) -> Schema:
    """What a session ends with. sensors: as a calibration has them; none while a given one is watched."""
    alarm = {"sensor": one_of(*SENSORS), "t_s": NUMBER, "since_s": NUMBER, "test": TEXT, "p_value": NUMBER}
    likeness = object_of({"effect": one_of(*EFFECTS), "where": TEXT})
    return object_of(
        {
            "recording": TEXT,
            "samples": WHOLE,
            "seconds": NUMBER,
            "enough": YES,
            "left_out": WHOLE,
            "calibration": TEXT_OR_NONE,
            "refused": TEXT_OR_NONE,
            "sensors": {**sensors, "minProperties": 0},
            "alarms": list_of(object_of({**alarm, "looks_like": list_of(likeness)})),
            "events": list_of(object_of({"t_s": TOLD, "words": TEXT})),
        }
    )
