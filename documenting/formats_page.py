"""The reference page of all formats, made from the registries that the code itself reads.

As a command: ``python -m documenting.formats_page docs/formats.md``, with the drawing of the angles beside it.
"""

from __future__ import annotations

import dataclasses
import sys
import typing
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from documenting.documented import attribute_texts
from estimators.calibration import SensorCalibration
from rig.acquisition import Acquisition
from rig.channels import READS
from rig.effects import EFFECTS
from rig.files import write_text
from rig.maneuver import MANEUVERS
from rig.recording.columns import POSITION, QUATERNION, SUPPLY, TEMPERATURE, TIME
from rig.recording.metadata import FORMAT, Metadata
from rig.units import UNITS
from scenarios.importing.mapping import FORMAT as MAPPING_FORMAT
from scenarios.importing.mapping import Conventions, Stated
from scenarios.importing.quantities import TARGETS
from scenarios.schema import described
from scenarios.toml_tables import ArmTable, EarthTable, EnvironmentTable, RunTable, SensorTable

_HEAD: Final = """# Formats

Made by `python -m documenting.formats_page docs/formats.md` from the code's own registries; a test finds it stale.

## Frames, angles and signs

![The angles of an axis and of a field](formats.png)

- The **base frame** is that of the body that carries joint 1 (a URDF's root link); the **tool frame** is the sensor's
  site or `--tip` (frame 6 of the A465). `R_base_tool` turns tool coordinates into base coordinates.
- An axis P of a sensor is given in the tool frame by **beta** and **gamma**, a field in the base frame by **phi** and
  **psi**, both as (cos a cos e, sin a cos e, -sin e) with elevation e = beta, phi and azimuth a = gamma, psi (Renk et
  al., equations 6 and 12). An elevation of +90 deg points along -z: gravity on a level base has phi = 90 deg. beta
  and phi lie in [-90, 90], gamma and psi in [0, 360) deg.
- A reading is S P . R^T (g - a) + delta of an accelerometer, S P . R^T B + delta of a magnetometer: g points down, a
  is the sensor's acceleration. The common chips read a - g, up at rest: S P . R^T (a - g) + delta. A recording says
  so by `accelerometer_reads` (`rig import --specific-force`, or found by the handedness of the axes), a scenario in
  `[acquisition]`, and a calibration by `reads`: its axes are those on the chip, its field is -g, up, and `matrix` and
  `rig apply` give a - g. `rig export --to ros` gives a - g of either.
- (field, P) and (-field, -P) give the same readings: the one whose field points down (z < 0 in the base) is given,
  unless `--field-points up`; of an accelerometer that reads a - g the one where gravity does. Right-handed axes have a
  positive determinant; `rig import` says where they are left-handed.
- Joint values are the file's own. Of the A465 by standard Denavit-Hartenberg with q2 = 90, q3 = -90, q4 = 0 deg
  locked, theta1 = q1 + 90 deg, theta5 = q5, theta6 = q6 + 180 deg are the angles of Table 1 of Renk et al. (2005)
  (`rig import --angles renk2005`).
- `joint1` .. `jointN` and `link1` .. `linkN` count the arm's joints that move by themselves, base to sensor; a
  joint's own name is understood wherever a place is asked for.
"""


def page() -> str:
    """The page as Markdown."""
    parts = [_HEAD, _recording(), _mapping(), _scenario(), _calibration(), _diagnosis(), _schemas()]
    return "\n".join(parts)


def _recording() -> str:
    rows = [
        (
            f"`{TIME}`",
            "s",
            "increasing; left out at will where the metadata state `still_poses`: then their number",
        ),
        ("`q1_rad` .. `qN_rad`", "rad", "joint angles; or `_deg`; `q3_m` of a joint that slides"),
        (f"`{', '.join(QUATERNION)}`", "1", "the tool's orientation, base <- tool, scalar first"),
        (f"`{', '.join(POSITION)}`", "m", "the tool in the base frame"),
        *(
            (
                f"`{'accel' if sensor == 'accelerometer' else 'mag'}1_UNIT` .. `3_UNIT`",
                ", ".join(units),
                f"{sensor} readings",
            )
            for sensor, units in UNITS.items()
        ),
        (f"`{TEMPERATURE}`", "degC", "of the board"),
        ("`current1_A` ..", "A", "motor current of a joint"),
        (f"`{SUPPLY}`", "V", "of the sensor"),
    ]
    return (
        f"## Recording (`{FORMAT}`)\n\nA table, one row a sample: Parquet with the metadata as JSON under the key `rig`"
        " of its schema, or CSV with them in a first line `# rig: {json}`. Poses: joints, tool quaternions, none.\n\n"
        + _table(("column", "unit", "what"), rows)
        + "\n### Metadata\n\n"
        + _table(("key", "default", "what"), _documented(Metadata, leave_out=("extra",)))
        + f"\n`accelerometer_reads` is one of {', '.join(READS)}. `NAME.locked.parquet` beside `NAME.parquet` is a"
        " recording of poses held still, taken as the noise floor.\n"
    )


def _mapping() -> str:
    return (
        f"## Mapping of a log (`{MAPPING_FORMAT}`)\n\n`rig import --map` writes and reads it. `[columns]` has a log's"
        " column and what it is, with a minus sign before it where its sign is turned:\n\n"
        + ", ".join(f"`{target}`" for target in TARGETS)
        + ".\n\n### `[conventions]`\n\n"
        + _table(("key", "default", "what"), _documented(Conventions))
        + "\n### `[metadata]`\n\n"
        + _table(("key", "default", "what"), _documented(Stated))
    )


def _scenario() -> str:
    parts = ["## Scenario (TOML)\n\nA table's keys; what has no default must be stated.\n"]
    sections: list[tuple[str, type[Any], tuple[str, ...]]] = [
        ("top of the file", RunTable, ()),
        ("`[arm]`", ArmTable, ()),
        *((f'`[maneuver]` with `kind = "{kind}"`', cls, ()) for kind, cls in MANEUVERS.items()),
        ("`[environment]`", EnvironmentTable, ()),
        ("`[environment.earth]`", EarthTable, ()),
        ("`[accelerometer]`, `[magnetometer]`", SensorTable, ()),
        ("`[acquisition]`", Acquisition, ("noise_V",)),
    ]
    for title, cls, left in sections:
        parts.append(f"### {title}\n\n" + _table(("key", "default", "may hold", "what"), _keys(cls, left)))
    parts.append("`[locked]` has the keys of `locked-poses`.\n\n### `[effects.NAME]`\n")
    rows = []
    for name, effect in EFFECTS.items():
        units = ", ".join(f"`{item.name}` [{item.unit}]" for item in effect.parameters())
        kind = effect.numbered()
        rows.append((f"`{name}`", f"{kind}1 .. {kind}N" if kind else ", ".join(effect.places), units))
    parts.append(_table(("effect", "where", "parameters"), rows))
    parts.append(
        "`NAME_std` beside a parameter NAME is its standard deviation, in its unit, where the rig was fitted: "
        "`rig diagnose --save-scenario` writes it, `--rig` judges by it.\n"
    )
    return "\n".join(parts)


def _calibration() -> str:
    return (
        "## Calibration (`rig-calibration/1`, JSON)\n\n`sensors` has one object a sensor; `field = matrix @ (reading -"
        " bias)`, in the tool frame, m/s^2 (g - a or a - g, as `reads` says) or field units; `offset` and `bias` in the"
        " recorded unit.\n\n" + _table(("attribute", "what"), _attributes(SensorCalibration))
    )


def _diagnosis() -> str:
    from estimators.gap.diagnosis import Diagnosis

    # The arm's own names of places are written with each cause.
    return "## Diagnosis (JSON)\n\n" + _table(("attribute", "what"), _attributes(Diagnosis, ("names",)))


def _schemas() -> str:
    from documenting.schemas import schemas

    links = ", ".join(f"[{name}](schemas/{name}.json)" for name in schemas())
    return (
        "## JSON Schemas\n\nOf the JSON formats that are written to files, and of what `--json` prints of them, made"
        " from the code by `python -m documenting.schemas docs/schemas` (draft 2020-12). What cannot be told is null."
        f"\n\n{links}.\n"
    )


def _table(header: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [header, tuple("---" for _ in header), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


def _keys(cls: type[Any], leave_out: tuple[str, ...]) -> list[tuple[str, str, str, str]]:
    hints = typing.get_type_hints(cls)
    return [
        (key, default, described(hints[key.strip("`")]), text) for key, default, text in _documented(cls, leave_out)
    ]


def _attributes(cls: type[Any], leave_out: tuple[str, ...] = ()) -> list[tuple[str, str]]:
    """The fields of a dataclass, and what its docstring says; those that share a sentence share a row."""
    told: dict[str, list[str]] = {}
    for key, _, text in _documented(cls, leave_out):
        told.setdefault(text, []).append(key)
    return [(", ".join(keys), text) for text, keys in told.items()]


def _documented(cls: type[Any], leave_out: tuple[str, ...] = ()) -> list[tuple[str, str, str]]:
    """The fields of a dataclass: name, default, and what its docstring says of it."""
    texts = attribute_texts(cls)
    rows = []
    for item in dataclasses.fields(cls):
        if not item.init or item.name in leave_out or item.name.startswith("_"):
            continue
        default = item.default
        if default is dataclasses.MISSING and item.default_factory is not dataclasses.MISSING:
            default = item.default_factory()
        shown = "" if default is dataclasses.MISSING else f"`{_shown(default)}`"
        rows.append((f"`{item.name}`", shown, texts.get(item.name, "").replace("``", "`")))
    return rows


def _shown(value: object) -> str:
    from scenarios.schema import written

    try:
        return written(value)
    except TypeError:
        return str(value)


def main() -> None:
    """Write the page and the drawing beside it."""
    path = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/formats.md")
    write_text(path, page())
    from documenting.angles import angles_figure
    from scenarios.plots import save

    save(angles_figure(), path.with_suffix(".png"))


if __name__ == "__main__":
    main()
