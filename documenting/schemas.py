"""JSON Schemas (draft 2020-12) of every JSON format that the commands write, from the classes behind them.

As a command: ``python -m documenting.schemas docs/schemas``. What cannot be told is null; objects hold what is listed
and nothing else, but where a class keeps further keys.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, Final

from documenting.command_schemas import checked, compared, imported, live
from documenting.documented import attribute_texts
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
    of_type,
    one_of,
    open_,
    or_null,
    said,
    table_of,
)
from estimators.calibration import contract as calibrations
from estimators.calibration import export as exports
from estimators.calibration import parts
from estimators.design.isolability import Isolability
from estimators.gap import diagnosis as diagnoses
from estimators.gap.diagnosis import Cause, Channel, Closed, Estimate, Remainder
from rig.channels import CHANNELS, READS, SENSORS
from rig.effects import EFFECTS
from rig.files import write_text
from rig.recording.metadata import FORMAT as RECORDING_FORMAT
from rig.recording.metadata import Metadata
from rig.units import FIELD_UNITS
from scenarios.diagnosing.fleet import FORMAT as FLEET_FORMAT
from scenarios.diagnosing.kept import ABOUT, CORRECTED, ORIGIN
from scenarios.diagnosing.task import About
from scenarios.studies.store import FORMAT as STUDY_FORMAT

DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"


def schemas() -> dict[str, Schema]:
    """Name -> schema; the name is that of its file."""
    made = {
        "recording-metadata": _metadata(),
        "calibration": _calibration(),
        "diagnosis": _diagnosis(),
        "cause": _causes(),
        "export": _export(),
        "noise": _noise(),
        "fleet": _fleet(),
        "bound": _bound(),
        "isolability": _isolability(),
        "plan": _plan(),
        "compare": compared(),
        "check": checked(),
        "import": imported(),
        "live": live(_calibration()["properties"]["sensors"]),
        "study": _study(),
        "study-tables": table_of(TEXT),
    }
    return {name: {"$schema": DIALECT, "title": name, **schema} for name, schema in made.items()}


def _metadata() -> Schema:
    own = of_class(Metadata, ("extra",))["properties"]
    numbers = {"gravity_m_s2": NUMBER, "magnetic_field": NUMBER}
    own |= {name: said(schema, own[name].get("description", "")) for name, schema in numbers.items()}
    always = ("gravity_m_s2", "magnetic_field", "arm", "notes")
    return open_(
        object_of(
            {"format": {"const": RECORDING_FORMAT}, **{name: own.pop(name) for name in always}},
            {**own, "rows": said(WHOLE, "of a Parquet file")},
        )
    )


def _calibration() -> Schema:
    texts = attribute_texts(calibrations.SensorCalibration)
    three, square = list_of(NUMBER, 3), list_of(list_of(TOLD))
    field = object_of(
        {"phi_deg": NUMBER, "psi_deg": NUMBER, "vector": three, "vector_covariance": list_of(list_of(TOLD, 3), 3)}
    )
    axis = object_of(
        dict.fromkeys(("sensitivity", "offset", "beta_deg", "gamma_deg"), NUMBER)
        | {"axis": three, "axis_covariance": list_of(list_of(TOLD, 3), 3)},
        {"field": field},
    )
    required: dict[str, Schema] = {
        "method": TEXT,
        "unit": TEXT,
        "reference_magnitude": NUMBER,
        "matrix": list_of(list_of(TOLD, 3), 3),
        "bias": three,
        "use": TEXT,
        "fit_rms": list_of(TOLD, 3),
        "fit_rms_root_sum_square": NUMBER,
        "parameters": list_of(TEXT),
        "values": list_of(TOLD),
        "covariance": square,
        "identifiable": table_of({"anyOf": [{"const": True}, TEXT]}),
        "samples": WHOLE,
        "quality": of_class(parts.Quality, **_quality()),
    }
    optional: dict[str, Schema] = {
        "axes": list_of(axis, 3),
        "angles_between_deg": table_of(TOLD, "1-2", "1-3", "2-3"),
        "angles_between_std_deg": table_of(TOLD, "1-2", "1-3", "2-3"),
        "field": field,
        "noise": list_of(TOLD, 3),
        "noise_degrees_of_freedom": list_of(TOLD, 3),
        "noise_source": TEXT,
        "weighting": TEXT,
        "convention": TEXT,
        "reads": one_of(*READS),
        "field_unit": one_of(*(unit for units in FIELD_UNITS.values() for unit in units)),
        "vector_parameters": list_of(TEXT),
        "vector_values": list_of(TOLD),
        "vector_covariance": square,
    }
    named = {**texts, "field": texts["field_direction"], "use": "how matrix and bias are applied"}
    sensor = object_of(
        *({name: said(schema, named.get(name, "")) for name, schema in each.items()} for each in (required, optional))
    )
    return open_(
        object_of(
            {
                "format": {"const": calibrations.FORMAT},
                "recording": TEXT,
                "arm": TEXT_OR_NONE,
                "sensors": {**table_of(open_(sensor), *SENSORS), "minProperties": 1},
            }
        )
    )


def _quality() -> dict[str, Any]:
    return {name: or_null(table_of(ANY)) for name in ("chi_square", "field_agreement", "verdict")}


def _pair() -> Schema:
    return list_of(TEXT, 2)


def _estimate() -> Schema:
    own = of_class(Estimate)
    for name in ("why", "fitted"):
        own["required"].remove(name)
    return own


def _cause() -> Schema:
    equivalent = object_of({"effect": _effect(), "where": TEXT, "probability": NUMBER})
    own = of_class(Cause, effect=_effect(), equivalent=list_of(equivalent), parameters=table_of(_estimate()), name=TEXT)
    own["properties"]["name"] = said(TEXT, "the arm's own name of the place, where it differs")
    for key in ("recording", "evidence", "name"):
        own["required"].remove(key)
    return own


def _effect() -> Schema:
    return one_of(*EFFECTS)


def _diagnosis() -> Schema:
    texts = attribute_texts(diagnoses.Diagnosis)
    channels = table_of(of_class(Channel), *CHANNELS)
    followed = table_of(ANY)
    closed = of_class(Closed, on=TEXT, other_maneuver=TOLD)
    hypothesis = object_of({"causes": list_of(_pair()), "other": YES, "probability": NUMBER})
    required: dict[str, Schema] = {
        "format": {"const": diagnoses.FORMAT},
        "recordings": list_of(TEXT),
        "samples": WHOLE,
        "seconds": NUMBER,
        "verdict": of_type(diagnoses.Verdict),
        "posterior": object_of(dict.fromkeys(("nothing", "known", "other"), NUMBER)),
        "omitted": NUMBER,
        "hypotheses": list_of(hypothesis),
        "causes": list_of(_cause()),
        "where": object_of({"channels": {"anyOf": [channels, table_of(channels)]}, "follows": list_of(followed)}),
        "closed": closed,
        "remainder": of_class(Remainder),
        "calibration_shift": table_of(object_of(dict.fromkeys(("before", "after", "sigmas"), TOLD))),
        "cannot_tell": list_of(table_of(TEXT)),
        "next": or_null(table_of(ANY)),
        "floor": TEXT,
        "warnings": list_of(TEXT),
    }
    optional: dict[str, Schema] = {
        "rig": table_of(ANY),
        "at_least_one": list_of(object_of({"causes": list_of(_pair()), "probability": NUMBER})),
        ABOUT: of_class(About),
        CORRECTED: said(YES, "whether NAME.calibration.json was written"),
        ORIGIN: said(table_of(ANY), "version, files and options that it was made from"),
    }
    return object_of(
        *({name: said(schema, texts.get(name, "")) for name, schema in each.items()} for each in (required, optional))
    )


def _causes() -> Schema:
    value = {"anyOf": [NUMBER, list_of(NUMBER), TEXT, open_(object_of({"value": ANY}))]}
    cause = object_of({"effect": _effect(), "where": TEXT, "parameters": table_of(value)})
    diagnosis = open_(object_of({"format": {"const": diagnoses.FORMAT}, "causes": list_of(ANY)}))
    return {"anyOf": [cause, list_of(cause), diagnosis]}


def _export() -> Schema:
    three = list_of(NUMBER, 3)
    sensor = object_of(
        {
            **dict.fromkeys(("field", "field_unit", "reading_unit", "method"), TEXT),
            "channels": list_of(one_of(*CHANNELS), 3),
            "reference_magnitude": NUMBER,
            "matrix": list_of(three, 3),
            "bias": three,
            "bias_std": list_of(TOLD, 3),
            "noise": or_null(three),
            "samples": WHOLE,
            "warnings": list_of(TEXT),
        }
    )
    head = {"format": {"const": exports.FORMAT}, "recording": TEXT, "formula": TEXT}
    return object_of({**head, "sensors": table_of(sensor, *SENSORS)})


def _noise() -> Schema:
    floor = {"unit": TEXT, "rms": TOLD, "rms_std": TOLD, "pose_rms": list_of(TOLD)}
    floor |= dict.fromkeys(("dynamic_range_dB", "dynamic_range_std_dB", "bits", "bits_std"), TOLD)
    curve = {name: list_of(TOLD) for name in ("tau_s", "deviation", "low_95", "high_95", "model")}
    statistic = dict.fromkeys(("statistic", "degrees_of_freedom", "p_value"), NUMBER)
    white = object_of({"test": TEXT, "lags": WHOLE, **statistic})
    term = object_of({"value": TOLD, "unit": TEXT}, {"std": TOLD, "upper_95": TOLD})
    coloured = {
        "allan": object_of(curve),
        "terms": table_of(term),
        "terms_p_value": TOLD,
        "spectrum": object_of(
            {"unit": TEXT, "frequency_Hz": list_of(TOLD), "density": list_of(TOLD), "degrees_of_freedom": NUMBER}
        ),
        "whiteness": white,
        "autoregression": object_of(
            {"order": WHOLE, "coefficients": list_of(NUMBER), "sigma": NUMBER, "left_over": white}
        ),
    }
    channel = object_of(floor, coloured)
    return object_of(
        {"format": {"const": "rig-noise/1"}, "pose_samples": list_of(WHOLE), "channels": table_of(channel, *CHANNELS)},
        {"rate_Hz": NUMBER, "warnings": list_of(TEXT)},
    )


def _fleet() -> Schema:
    own = _diagnosis()["properties"]
    cause = _cause()["properties"]
    brief = object_of({name: cause[name] for name in ("effect", "where", "probability", "equivalent", "parameters")})
    about = of_class(About)["properties"]
    told = {name: own[name] for name in ("samples", "verdict", "posterior")}
    told |= {"closed": TOLD, "causes": list_of(brief)}
    recording = object_of({"recording": TEXT}, {**about, **told, "error": TEXT})
    moment = table_of(ANY)
    history = object_of(
        {
            "arm": TEXT,
            "effect": _effect(),
            "where": TEXT,
            "equivalent": list_of(_pair()),
            "since": moment,
            "not_yet": or_null(moment),
            "now": YES,
            "recordings": table_of(one_of("found", "absent", "open")),
        }
    )
    return object_of({"format": {"const": FLEET_FORMAT}, "recordings": list_of(recording), "causes": list_of(history)})


def _bound() -> Schema:
    return object_of(
        {
            "format": {"const": "rig-bound/1"},
            "scenario": TEXT,
            "attitude": YES,
            "sensors": table_of(table_of(ANY), *SENSORS),
            "time_s": list_of(TOLD),
            "given": list_of(TEXT),
            "effects_left_out": list_of(TEXT),
        }
    )


def _isolated() -> dict[str, Schema]:
    pair = object_of({"pair": list_of(_pair(), 2), "sigmas": NUMBER})
    texts = attribute_texts(Isolability)
    return {
        "effects": list_of(object_of({"effect": _effect(), "where": TEXT, "sigmas": TOLD, "visible": YES})),
        "separation_sigmas": said(list_of(list_of(NUMBER)), texts.get("apart", "")),
        "alike": said(list_of(pair), texts.get("alike", "")),
        "seen_from": NUMBER,
        "left_out": table_of(TEXT),
    }


def _isolability() -> Schema:
    pair = object_of({"pair": list_of(_pair(), 2), "sigmas": NUMBER})
    more = {"newly_seen": list_of(_pair()), "newly_told_apart": list_of(pair)}
    return object_of(
        {
            "format": {"const": "rig-isolability/1"},
            "scenario": TEXT,
            "locked_joints": list_of(WHOLE),
            **_isolated(),
            "if_every_joint_moves": or_null(object_of({**_isolated(), **more})),
        }
    )


def _plan() -> Schema:
    told = object_of({"std": TOLD, "reference": TOLD, "moved_by_acceleration": NUMBER, "share": list_of(TOLD)})
    of_poses = ("hold_s", "move_s", "settle_s")
    of_sweeps = ("acceleration_rms_m_s2", "acceleration_peak_m_s2")
    return object_of(
        {
            "format": {"const": "rig-plan/1"},
            "scenario": TEXT,
            "seconds": NUMBER,
            **dict.fromkeys((*of_poses, *of_sweeps), or_null(NUMBER)),
            **dict.fromkeys(("poses", "harmonics"), or_null(WHOLE)),
            "samples": WHOLE,
            "worst": TOLD,
            "reference": TEXT,
            "parameters": table_of(table_of(told), *SENSORS),
            "curve": list_of(object_of({"seconds": NUMBER, "worst": TOLD})),
            "effects": or_null(object_of(_isolated())),
            "assumed": TEXT,
            "links_as_capsules": YES,
        },
        {"file": TEXT_OR_NONE},
    )


def _study() -> Schema:
    """Of study.json; what study-tables holds is table -> SHA-256."""
    own = {"format": one_of(STUDY_FORMAT), "kind": TEXT, "version": TEXT, "settings": table_of(ANY)}
    return object_of(own, {"sha256": TEXT})


def text_of(schema: Schema) -> str:
    """The file."""
    return json.dumps(schema, indent=1) + "\n"


def main() -> None:
    """Write every schema into a folder."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/schemas")
    folder.mkdir(parents=True, exist_ok=True)
    for name, schema in schemas().items():
        write_text(folder / f"{name}.json", text_of(schema))


if __name__ == "__main__":
    main()
