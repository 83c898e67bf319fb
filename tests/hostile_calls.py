"""Commands, each with a file that is to be spoilt before, and good files of every format."""

from __future__ import annotations

import contextlib
import io
import json
import random
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
from cli_support import SMALL
from imperfect_recordings import imperfect, locked_imperfect
from mutations import bytes_of, document_of, table_of, text_of
from rosbags.rosbag2 import StoragePlugin

from rig.files import file_hash, own_folder
from scenarios.studies.store import HASHES, StudyFolder, _digest
from scenarios.workers import Workers
from validation.blind.answers import Answers
from validation.loop.play import Settings, Step


@dataclass(frozen=True)
class Call:
    """A command and the file that is spoilt before it is called.

    Attributes:
        name: of the format.
        file: relative to the folder.
        arguments: of the command line.
        spoil: from the good folder's file to the bad content.
        slow: with the tests, one input for so many of others: it takes seconds where the file is good enough.
        more: needs ``make_more``, whose files take the rig some time.
        keeps: what is sound stays where the rest is refused: a stream's recording, a diagnosis without its scenario.
        forge: makes what is beside the spoilt file agree with it, checksums say.
    """

    name: str
    file: str
    arguments: tuple[str, ...]
    spoil: Callable[[Path, random.Random], bytes]
    slow: int = 1
    keeps: bool = False
    more: bool = False
    forge: Callable[[Path], None] | None = None


def _noted(table: Path) -> None:
    """The study says that its table is as it was written."""
    file = table.with_name(HASHES)
    file.write_text(json.dumps({**json.loads(file.read_text()), table.name: file_hash(table)}))


def _stated(study: Path) -> None:
    """The document of a study says that nothing was changed in it."""
    with contextlib.suppress(ValueError, TypeError, AttributeError):
        document = json.loads(study.read_text())
        document.pop("sha256", None)
        study.write_text(json.dumps({**document, "sha256": _digest(document)}))


def a_loop(settings: Settings, number: int) -> pa.Table:
    """Steps of a hidden rig as they might be: a diagnosis of each takes minutes, and is tried by other calls."""
    steps = [
        Step(number, strategy, step, "backlash", "joint5", 8.0, 1, 14.0 * step, "torus sweep", "named", 0.97, 1,
             "backlash@joint5", True, "named" if step == 2 else "")
        for strategy in settings.strategies for step in (1, 2)
    ]  # fmt: skip
    return pa.Table.from_pylist([vars(step) for step in steps])


_CALIBRATE: Final = ("calibrate", "run.csv", "--json")
_LIVE: Final = ("live", "log.csv", "--idle", "0.05")
_PLAN: Final = ("plan", "--seconds", "30", "-o", "out.toml")
_DIAGNOSE: Final = ("diagnose", "sweep.parquet", "--save-scenario", "out.toml", "--json")
#: Three of each kind of parameter: a place, a direction, a list of effects.
EFFECTS: Final = """
[effects.base_dipole]
position_m = [0.3036, 0.0601, 0.3632]
moment = [-0.003145, 0.003437, -0.000457]
[effects.backlash]
where = "joint5"
width_rad = 0.006
[[effects.noise_excess]]
where = "accel1"
extra_sigma = 0.0075
[[effects.noise_excess]]
where = "mag2"
extra_sigma = 0.0081
"""
POSES: Final = 'kind = "static-poses"\ncount = 8\nhold_s = 1.0\nmove_s = 4.0'
JOINTS: Final = [f"joint{number}" for number in range(1, 7)]

_RRD: Final = ("-o", "out.rrd")
_STUDY: Final = ("study", "consistency", "small.toml", "--draws", "3", "--counts", "2", "--first", "40")
_CONSISTENCY: Final = (*_STUDY, "--workers", "0", "-o", "begun")
_LOOP: Final = ("study", "loop", "-o", "looped", "--rigs", "2", "--samples", "400", "--workers", "0")
_SOLVE: Final = ("blind", "solve", "sealed", "--jobs", "0")
_FLEET: Final = ("diagnose", "little.parquet", "run.parquet", "--out", "kept", "--jobs", "1")
_CORRECTED: Final = ("apply", "kept/little.calibration.json", "run.csv", "-o", "out.csv")
_WITH_FOUND: Final = ("sweep", "small.toml", "-o", "out.csv", "--with", "kept/little.diagnosis.json")
CALLS: Final = (
    Call("recording, CSV", "run.csv", _CALIBRATE, text_of),
    Call("recording, CSV", "run.csv", ("noise", "run.csv"), text_of),
    Call("recording, Parquet", "run.parquet", ("calibrate", "run.parquet", "-o", "out.json"), table_of),
    Call("recording, Parquet", "run.parquet", ("calibrate", "run.parquet", "--method", "ellipsoid"), table_of),
    Call("recording, Parquet", "run.parquet", ("apply", "cal.json", "run.parquet", "-o", "out.parquet"), table_of),
    Call("locked recording", "run.locked.parquet", ("noise", "run.locked.parquet", "--json"), table_of),
    Call("locked recording", "run.locked.parquet", ("calibrate", "run.parquet"), table_of),
    Call("scenario", "small.toml", ("bound", "small.toml"), text_of),
    Call("scenario", "small.toml", ("sweep", "small.toml", "-o", "out.parquet", "--memory", "256M"), text_of),
    Call("calibration", "cal.json", ("export", "cal.json", "--to", "c"), text_of),
    Call("calibration", "cal.json", ("export", "cal.json", "--to", "yaml", "-o", "out.yaml"), text_of),
    Call("calibration", "cal.json", ("apply", "cal.json", "run.csv", "-o", "out.csv"), text_of),
    Call("cause", "cause.json", ("sweep", "small.toml", "-o", "out.csv", "--with", "cause.json"), text_of),
    Call("diagnosis", "found.json", ("sweep", "small.toml", "-o", "out.csv", "--with", "found.json"), text_of),
    Call("URDF", "arm.urdf", ("calibrate", "run.csv", "--arm", "arm.urdf", "--tip", "imu"), text_of),
    Call("study", "study/study.json", ("view", "study", "-o", "out.rrd"), text_of),
    Call("study", "study/tables.json", ("view", "study", "-o", "out.rrd"), text_of),
    Call("study", "study/summary.parquet", ("view", "study", "-o", "out.rrd"), table_of),
    Call("sealed set", "set/manifest.json", ("blind", "score", "set"), text_of),
    Call("import map", "map.toml", ("import", "log.csv", "-o", "out.parquet", "--map", "map.toml"), text_of),
    Call("log", "log.csv", ("import", "log.csv", "-o", "out.parquet"), text_of),
    Call("log, to check", "log.csv", ("check", "log.csv"), text_of),
    Call("stream", "log.csv", (*_LIVE, "-o", "out.parquet"), text_of, keeps=True),
    Call(
        "stream, calibrated",
        "cal.json",
        (*_LIVE, "-o", "out.parquet", "--calibration", "cal.json"),
        text_of,
        keeps=True,
    ),
    Call("stream, mapped", "map.toml", (*_LIVE, "-o", "out.csv", "--map", "map.toml"), text_of, keeps=True),
    Call("recording, as a stream", "run.parquet", ("replay", "run.parquet", "--speed", "max"), table_of),
    Call("recording, to show", "run.parquet", ("view", "run.parquet", "-o", "out.rrd"), table_of),
    Call(
        "URDF, to show", "arm.urdf", ("view", "run.csv", "--arm", "arm.urdf", "--tip", "imu", "-o", "out.rrd"), text_of
    ),
    Call("URDF, to plan", "arm.urdf", (*_PLAN, "--arm", "arm.urdf", "--tip", "imu"), text_of, slow=100),
    Call("scenario, to plan", "small.toml", (*_PLAN, "small.toml"), text_of, slow=100),
    Call("recording, to diagnose", "run.parquet", ("diagnose", "run.parquet", "--out", "out"), table_of),
    Call("weights", "prior.toml", ("diagnose", "run.parquet", "--prior", "prior.toml"), text_of),
    Call("imperfect recording", "sweep.parquet", _DIAGNOSE, imperfect, slow=12, keeps=True),
    Call("imperfect recording, alone", "alone.parquet", ("diagnose", "alone.parquet"), imperfect, slow=12),
    Call("imperfect locked recording", "sweep.locked.parquet", _DIAGNOSE, locked_imperfect, slow=12, keeps=True),
    Call("calibration, compared", "cal.json", ("compare", "cal.json", "free.json"), document_of),
    Call(
        "calibration, compared with the truth", "cal.json", ("compare", "cal.json", "small.toml", "--json"), document_of
    ),
    Call("scenario, as the truth", "small.toml", ("compare", "cal.json", "small.toml"), text_of),
    Call("recording, compared", "run.parquet", ("compare", "run.parquet", "small.toml"), table_of),
    Call("rig, compared", "small.toml", ("compare", "run.parquet", "small.toml"), text_of),
    Call("ellipsoid", "free.json", ("apply", "free.json", "run.csv", "-o", "out.parquet"), document_of),
    Call("calibration, for robots", "cal.json", ("export", "cal.json", "--to", "ros"), document_of),
    Call("calibration, shown", "cal.json", ("view", "run.parquet", "--calibration", "cal.json", *_RRD), document_of),
    Call("diagnosis, shown", "found.json", ("view", "run.parquet", "--diagnosis", "found.json", *_RRD), document_of),
    Call("one of several", "run.csv", ("calibrate", "sweep.parquet", "run.csv", "-o", "out.json"), text_of),
    Call(
        "journal",
        "out.csv",
        ("live", "log.csv", "--idle", "0.05", "--resume", "-o", "out.parquet"),
        text_of,
        keeps=True,
    ),
    Call("effects", "effects.toml", ("sweep", "effects.toml", "-o", "out.parquet", "--memory", "256M"), text_of),
    Call("poses", "poses.toml", ("sweep", "poses.toml", "-o", "out.parquet", "--memory", "256M"), text_of),
    Call("tumble", "tumble.toml", ("sweep", "tumble.toml", "-o", "out.parquet", "--memory", "256M"), text_of),
    Call("dynamics", "small.toml", ("sweep", "small.toml", "-o", "out.csv", "--engine", "dynamic"), text_of, slow=4),
    Call("effects, bounded", "small.toml", ("bound", "small.toml", "--effects"), text_of, slow=8),
    Call("MJCF", "arm.xml", ("calibrate", "run.csv", "--arm", "arm.xml"), text_of),
    Call("MCAP", "log.mcap", ("import", "log.mcap", "-o", "out.parquet"), bytes_of),
    Call("bag", "bag/bag.db3", ("import", "bag", "-o", "out.parquet"), bytes_of),
    Call("bag, its index", "bag/metadata.yaml", ("import", "bag", "-o", "out.parquet"), text_of),
    Call("two logs", "log.csv", ("import", "log.csv", "imported.csv", "-o", "out.parquet"), text_of),
    Call("study that goes on", "begun/study.json", _CONSISTENCY, document_of, slow=100, keeps=True, more=True),
    Call("study's hashes that go on", "begun/tables.json", _CONSISTENCY, document_of, slow=100, keeps=True, more=True),
    Call("study's tables that go on", "begun/table.parquet", _CONSISTENCY, table_of, slow=100, keeps=True, more=True),
    Call("study's tables, forged", "begun/table.parquet", _CONSISTENCY, table_of, 4, True, True, _noted),
    Call("study, forged", "study/summary.parquet", ("view", "study", "-o", "out.rrd"), table_of, forge=_noted),
    Call("study's table, forged", "study/table.parquet", ("view", "study", "-o", "out.rrd"), table_of, forge=_noted),
    Call(
        "study's settings, forged", "study/study.json", ("view", "study", "-o", "out.rrd"), document_of, forge=_stated
    ),
    Call("loop", "looped/loop/study/study.json", _LOOP, document_of, 4, True, True),
    Call("loop, forged", "looped/loop/study/study.json", _LOOP, document_of, 4, True, True, _stated),
    Call("loop's hashes", "looped/loop/study/tables.json", _LOOP, document_of, 4, True, True),
    Call("loop's table", "looped/loop/study/table.parquet", _LOOP, table_of, 4, True, True),
    Call("loop's table, forged", "looped/loop/study/table.parquet", _LOOP, table_of, 4, True, True, _noted),
    Call("set to solve", "set/manifest.json", ("blind", "solve", "set", "--jobs", "0"), document_of),
    Call("sound set to solve", "sealed/manifest.json", _SOLVE, document_of, 4, True, True),
    Call("answers", "sealed/answers/solver.json", _SOLVE, document_of, 50, True, True),
    Call("rig", "effects.toml", ("diagnose", "little.parquet", "--rig", "effects.toml"), text_of, slow=12),
    Call(
        "earlier calibration",
        "cal.json",
        ("diagnose", "little.parquet", "--calibration", "cal.json"),
        document_of,
        slow=12,
    ),
    Call("one together", "run.parquet", ("diagnose", "little.parquet", "run.parquet", "--together"), table_of, slow=12),
    Call(
        "recording of some length", "little.parquet", ("diagnose", "little.parquet", "--out", "out"), table_of, slow=12
    ),
    Call("one of a fleet", "run.parquet", _FLEET, table_of, slow=100, keeps=True, more=True),
    Call("kept diagnosis", "kept/little.diagnosis.json", _FLEET, document_of, slow=100, keeps=True, more=True),
    Call("corrected calibration", "kept/little.calibration.json", _CORRECTED, document_of, more=True),
    Call("diagnosis, applied", "kept/little.diagnosis.json", _WITH_FOUND, document_of, more=True),
)


def make_good(folder: Path) -> None:
    """One good file of every format."""
    from bag_examples import write_bag

    import scenarios
    from rig.assets import model_path
    from rig.recording import read_recording
    from scenarios.cli._app import run

    (folder / "small.toml").write_text(SMALL.replace("decimation = 10", "decimation = 50"))
    (folder / "cause.json").write_text(
        '{"effect": "backlash", "where": "joint5", "parameters": {"width_rad": {"value": 0.005, "std": 1e-4}}}'
    )
    (folder / "effects.toml").write_text(SMALL.replace("decimation = 10", "decimation = 50") + EFFECTS)
    (folder / "poses.toml").write_text(SMALL.replace('kind = "torus-sweep"\nduration_s = 60.0', POSES))
    shutil.copy(Path(scenarios.__file__).with_name("camps2009-rotations.toml"), folder / "tumble.toml")
    shutil.copy(model_path("a465/a465.xml"), folder / "arm.xml")
    (folder / "sweep.toml").write_text(SMALL.replace("duration_s = 60.0", "duration_s = 80.0"))
    (folder / "prior.toml").write_text("# of this arm\n[effects]\nbacklash = 5\nsensor_lag = 0.2\nstray_dipole = 0\n")
    shutil.copy(model_path("a465/a465.urdf"), folder / "arm.urdf")
    with quietly(folder):
        assert run(["sweep", "small.toml", "-o", "run.parquet", "--locked"]) == 0
        assert run(["sweep", "small.toml", "-o", "run.csv"]) == 0
        assert run(["sweep", "sweep.toml", "-o", "sweep.parquet", "--locked"]) == 0
        shutil.copy("sweep.parquet", "alone.parquet")
        read_recording("sweep.parquet").select(slice(0, 250)).write("little.parquet")
        shutil.copy("sweep.locked.parquet", "little.locked.parquet")
        assert run(["calibrate", "run.parquet", "--method", "ellipsoid", "-o", "free.json"]) in (0, 1)
        write_bag(Path("bag"), read_recording("run.parquet"), StoragePlugin.SQLITE3, 0.0, JOINTS)
        write_bag(Path("mcap"), read_recording("run.parquet"), StoragePlugin.MCAP, 0.0, JOINTS)
        next(Path("mcap").glob("*.mcap")).rename("log.mcap")
        shutil.rmtree("mcap")
        assert run(["calibrate", "run.parquet", "-o", "cal.json"]) in (0, 1)
        assert run(["study", "subsets", "run.parquet", "--subsets", "3", "-o", "study"]) == 0
        for name in ("out.csv", "log.csv"):
            shutil.copy("run.csv", name)
        text = (folder / "log.csv").read_text().split("\n", 1)[1]  # without the metadata
        (folder / "log.csv").write_text(text)
        (folder / "imported.csv").write_text(text)
        assert run(["import", "log.csv", "-o", "imported.parquet", "--map", "map.toml"]) in (0, 1)
    cause = json.loads((folder / "cause.json").read_text())
    place = [cause["effect"], cause["where"]]
    diagnosis: dict[str, Any] = {
        "format": "rig-diagnosis/2", "verdict": "named", "causes": [cause],
        "hypotheses": [{"causes": [place], "other": False, "probability": 0.97}],
    }  # fmt: skip
    (folder / "found.json").write_text(json.dumps(diagnosis))
    (folder / "set").mkdir()
    digest = "0" * 64
    case = {"name": "case000", "recording": "case000.parquet", "locked": "case000.locked.parquet"}
    hashes = {"recording_sha256": digest, "locked_sha256": digest, "commitment": digest}
    (folder / "set" / "manifest.json").write_text(json.dumps({"format": "rig-blind/1", "cases": [{**case, **hashes}]}))
    seal(folder)


def seal(folder: Path) -> None:
    """A sealed set of two recordings, whose truth nobody knows."""
    set_ = folder / "sealed"
    set_.mkdir()
    cases = []
    for name in ("little", "sweep"):
        files = {"recording": f"{name}.parquet", "locked": f"{name}.locked.parquet"}
        for file, source in zip(files.values(), (f"{name}.parquet", "little.locked.parquet"), strict=True):
            shutil.copy(folder / source, set_ / file)
        hashes = {f"{key}_sha256": file_hash(set_ / file) for key, file in files.items()}
        cases.append({"name": name, **files, **hashes, "commitment": "0" * 64})
    (set_ / "manifest.json").write_text(json.dumps({"format": "rig-blind/1", "cases": cases}))


def make_more(folder: Path) -> None:
    """What takes some time to make, beside the good files."""
    from scenarios.cli._app import run

    with quietly(folder):
        assert run(["sweep", "effects.toml", "-o", "out.parquet"]) == 0
        assert run(["sweep", "poses.toml", "-o", "out.parquet"]) == 0
        Path("out.parquet").unlink()
        assert run(list(_CONSISTENCY)) == 0
        assert run(["diagnose", "little.parquet", "--out", "kept"]) == 0
        StudyFolder.begin(own_folder(Path("looped/loop")) / "study", "loop", Settings(2, 400)).fill(
            a_loop, Settings(2, 400), 2, Workers(0)
        )
        answers = Answers(Path("sealed/answers"))
        answers.begin()
        for name in ("little", "sweep"):
            shutil.copy("kept/little.diagnosis.json", answers.path(name))
            answers.note(name)


@contextlib.contextmanager
def quietly(folder: Path) -> Iterator[tuple[io.TextIOWrapper, io.StringIO]]:
    """In a folder, with what is printed."""
    out, err = io.TextIOWrapper(io.BytesIO(), "utf-8"), io.StringIO()  # some commands write bytes
    with contextlib.chdir(folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        yield out, err
