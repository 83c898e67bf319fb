"""``rig live`` and ``rig replay``: streams, calibrated and watched while they run."""

from __future__ import annotations

import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from rig.errors import RigError
from scenarios.cli._options import (
    PATH,
    POSITIVE,
    RECORDING_SUFFIXES,
    Choice,
    FiniteNumber,
    answer,
    arm_options,
    check_output,
    chosen_arm,
    json_option,
    number,
    print_json,
)

if TYPE_CHECKING:
    from estimators import Calibration
    from estimators.live import Guide
    from rig.recording import Metadata
    from scenarios.live.session import Display, Plan, Session

#: A file that does not grow for so long is taken to be whole [s].
_FILE_IDLE_S: Final = 3.0
_LEAST_SHARE: Final = 1e-9


@click.command(short_help="A recording as a stream of lines.")
@click.argument("run", type=PATH)
@click.option("--speed", default="1", metavar="N|max", help="Times as fast as it was recorded; 1 by default.")
@click.option("--from", "from_s", type=float, metavar="S", help="From this time of the recording on.")
@click.option("--until", "until_s", type=float, metavar="S", help="Up to this time of it.")
@click.option("--without-pose", is_flag=True, help="Leave out joint angles and tool poses, as if turned by hand.")
@click.option("--to", "port", metavar="connect:PORT", help="Send it to a port of this machine, not to stdout.")
@click.option("--json", "as_json", is_flag=True, help="A JSON object a line, not CSV.")
def replay(
    run: Path,
    speed: str,
    from_s: float | None,
    until_s: float | None,
    without_pose: bool,
    port: str | None,
    as_json: bool,
) -> None:
    """Write the recording RUN as lines, at the pace at which it was recorded or faster.

    \b
    Example:
      rig replay run.parquet | rig live -
      rig replay run.parquet --speed max --json > lines.jsonl
      rig replay run.parquet --speed 10 --to connect:5555
    """
    from rig.recording import scan_recording
    from scenarios.live.replay import replay as replayed

    scan = scan_recording(run, batch_rows=1 << 15)
    with ExitStack() as opened:
        write: Callable[[bytes], object]
        write = _written if port is None else opened.enter_context(_connected(port)).sendall
        try:
            count = replayed(
                scan, write, _speed(speed), "json" if as_json else "csv", from_s, until_s, not without_pose
            )
        except ConnectionError:
            if port is None:
                raise
            raise RigError(f"{port}: the receiver has gone") from None
    if count == 0:
        begin, end = ("any time" if each is None else f"{each:g} s" for each in (from_s, until_s))
        raise RigError(f"{run}: has no sample from {begin} to {end}, expected times of the recording")


def _written(data: bytes) -> None:
    sys.stdout.buffer.write(data)
    sys.stdout.buffer.flush()


def _speed(text: str) -> float | None:
    if text == "max":
        return None
    speed = number(text)
    if not 0.0 < speed < float("inf"):
        raise RigError(f"--speed: found {text!r}, expected a positive number or max")
    return speed


def _connected(text: str) -> socket.socket:
    from rig.stream.sources import ADDRESS

    kind, _, port = text.partition(":")
    if kind != "connect" or not port.isdecimal() or not 0 < int(port) < 65536:
        raise RigError(f"--to: found {text!r}, expected connect:PORT, as in connect:5555")
    try:
        return socket.create_connection((ADDRESS, int(port)), timeout=5.0)
    except OSError as error:
        raise RigError(f"--to {text}: nobody listens: {error.strerror or error}, expected rig live tcp:PORT") from error


@click.command(short_help="Calibrate, or watch, a sensor while it moves.")
@click.argument("source", default="-")
@click.option("-o", "--output", type=PATH, metavar="RUN", help="The recording: .parquet or .csv; live-TIME by default.")
@click.option("--cal", type=PATH, metavar="CAL", help="The calibration: .json; RUN.calibration.json by default.")
@click.option("--resume", is_flag=True, help="Go on with what an interrupted session has left of -o RUN.")
@click.option("--columns", metavar="NAMES", help="Of lines without a header, with commas; - for those to pass over.")
@click.option("--map", "mapping", type=PATH, metavar="MAP", help="What the columns are: a mapping of rig import.")
@click.option("--rate", type=POSITIVE, metavar="HZ", help="Of lines without a time.")
@click.option("--gravity", type=POSITIVE, metavar="M_S2", help="Gravity's magnitude, where the stream does not say it.")
@click.option("--field", type=POSITIVE, metavar="F", help="The magnetic field's, in the unit wanted; else relative.")
@click.option("--to", default="0.1%", metavar="P%", help="Enough is: every 95 % interval within ±P %; 0.1% by default.")
@click.option("--forget", type=POSITIVE, metavar="SECONDS", help="Only the last SECONDS count.")
@click.option("--parameters", type=Choice(("6", "9")), default="9", help="Without the attitude; 9 by default.")
@click.option("--without-pose", is_flag=True, help="Calibrate without the attitude, though poses come.")
@click.option("--guide", metavar="NAME", help="Show a procedure step by step; 'list' lists them.")
@click.option("--keep-going", is_flag=True, help="Do not stop when it is enough.")
@click.option("--seconds", type=POSITIVE, metavar="S", help="Stop after so much of the stream's time.")
@click.option("--idle", type=POSITIVE, metavar="S", help="Stop when nothing comes so long; of a file 3 s by default.")
@click.option("--calibration", type=PATH, metavar="CAL", help="Watch this calibration instead: alarms when it fails.")
@click.option("--alarms", type=POSITIVE, metavar="N", help="False alarms a day at most; 1 by default.")
@click.option("--learn", type=FiniteNumber(min=0.0), metavar="S", help="The noise's memory is learnt so long; 60 s.")
@arm_options
@click.option("--view/--no-view", default=False, help="Show it in the rerun viewer.")
@click.option("--view-file", type=PATH, metavar="F.rrd", help="Write what the viewer would show.")
@json_option
def live(source: str, output: Path | None, as_json: bool, **given: Any) -> None:
    """Calibrate a sensor while SOURCE runs, and stop when it is enough; or watch a calibration.

    SOURCE is - (standard input), a file that may still grow, tcp:PORT (waits on 127.0.0.1), connect:PORT or
    serial:DEVICE@BAUD. Lines are CSV with a header, or JSON objects, with a recording's column names: t_s,
    accel1_V..accel3_V, mag1_uT.., in any unit, with a pose or without. Samples are appended to RUN.csv as they come; at
    the end it becomes RUN.parquet, and its calibration is judged on held-out pieces.

    \b
    Example:
      rig replay run.parquet --speed 20 | rig live - -o live.parquet
      rig live serial:/dev/ttyUSB0@115200 --guide four-turns --to 0.5%
      rig live imu.log --columns accel1_m_s2,accel2_m_s2,accel3_m_s2,-,-,- --rate 100 --gravity 9.80665
      rig live tcp:5555 --calibration cal.json --alarms 1
    """
    if given["guide"] == "list":
        _list_procedures(as_json)
        return
    path = Path(time.strftime("live-%Y%m%d-%H%M%S.parquet", time.gmtime())) if output is None else output
    inputs = (Path(source), given["calibration"], given["mapping"], given["arm_file"])
    check_output(path, RECORDING_SUFFIXES, *inputs)
    cal = given["cal"] if given["cal"] is not None else path.with_suffix(".calibration.json")
    check_output(cal, (".json",), *inputs)
    check_output(given["view_file"], (".rrd",), *inputs)
    if given["resume"]:
        from scenarios.live.session import check_resumable

        check_resumable(path)
    elif path.with_suffix(".csv").exists():
        raise RigError(f"{path.with_suffix('.csv')}: is there already: expected --resume, or another -o")
    plan = _plan(source, given)
    session = _session(source, path, plan, given)
    try:
        with _stoppable() as stopped:
            if given["resume"]:
                session.resume()
            session.run(stopped)
    finally:
        made = session.close()
    if made is None:
        raise RigError(f"{source}: found {_nothing(session)}, expected readings under the names of their columns")
    _finish(session, made, cal, plan, as_json)


def _nothing(session: Session) -> str:
    """What came instead of a reading."""
    reader = session.feed.reader
    if reader.broken:
        return f"{reader.broken} broken line{'s' if reader.broken > 1 else ''} and no reading"
    return "nothing" if reader.layout is None else "the names of columns and no reading"


def _plan(source: str, given: dict[str, Any]) -> Plan:
    from estimators import Calibration
    from estimators.live import Options
    from scenarios.live.session import Plan

    is_file = source != "-" and ":" not in source
    idle = given["idle"] if given["idle"] is not None else _FILE_IDLE_S if is_file else None
    known = None if given["calibration"] is None else Calibration.read(given["calibration"])
    for name in ("alarms", "learn"):
        if known is None and given[name] is not None:
            raise RigError(f"--{name}: found without --calibration, expected the calibration to watch")
    watched = {"alarms_a_day": given["alarms"], "learn_s": given["learn"]}
    return Plan(
        Options(
            to=_share(given["to"]),
            forget_s=given["forget"],
            parameters=6 if given["parameters"] == "6" else 9,
            attitude=not given["without_pose"],
        ),
        known,
        chosen_arm(given["arm_file"], given["tip"]),
        _guide(given["guide"]),
        not given["keep_going"],
        idle,
        given["seconds"],
        **{name: value for name, value in watched.items() if value is not None},
    )


def _share(text: str) -> float:
    share = text.strip()
    value = number(share.rstrip("% ")) * (0.01 if share.endswith("%") else 1.0)
    if not _LEAST_SHARE <= value < 1.0:
        raise RigError(f"--to: found {text!r}, expected a share such as 0.1% or 0.001, {_LEAST_SHARE:g} or more")
    return value


def _guide(name: str | None) -> Guide | None:
    if name is None:
        return None
    from estimators.live import Guide, procedure

    return Guide(procedure(name))


def _list_procedures(as_json: bool) -> None:
    from estimators.live import PROCEDURES

    rows: list[dict[str, Any]] = [
        {
            "name": each.name,
            "title": each.title,
            "steps": [step.words for step in each.steps],
            "lacking": each.lacking(),
        }
        for each in PROCEDURES.values()
    ]
    from scenarios.terminal.tables import table

    columns = ("procedure", "steps", "what it is", "what it lacks")
    cells = [(row["name"], str(len(row["steps"])), row["title"], row["lacking"] or "") for row in rows]
    answer(as_json, rows, lambda _: table(*columns, numbers=("steps",), rows=cells))


def _session(source: str, path: Path, plan: Plan, given: dict[str, Any]) -> Session:
    from rig.stream import Feed, open_source
    from scenarios.live.panel import Lines, TerminalPanel
    from scenarios.live.session import Session

    names = None if given["columns"] is None else [name.strip() for name in given["columns"].split(",")]
    joints = None if plan.arm is None else plan.arm.dof
    columns, stated = None, None
    if given["mapping"] is not None:
        from scenarios.live.mapped import renamed

        columns, stated = renamed(given["mapping"])
    metadata = _metadata(given, stated)
    feed = Feed(open_source(source), names, metadata, given["rate"], joints, renamed=columns)
    displays: list[Display] = []
    if given["view"] or given["view_file"] is not None:
        from scenarios.live.view import LiveView

        displays.append(LiveView(given["view"], given["view_file"], plan.arm))
    displays.append(TerminalPanel("standard input" if source == "-" else source) if sys.stderr.isatty() else Lines())
    return Session(feed, path, plan, displays)


def _metadata(given: dict[str, Any], mapped: Metadata | None) -> Metadata | None:
    """What the command line says of the stream, over what a mapping says; None where the stream itself is to say."""
    from rig.recording import Metadata
    from rig.recording.metadata import FIELD_SIZES

    said = dict(zip(FIELD_SIZES, (given["gravity"], given["field"]), strict=True))
    known = {name: size for name, size in said.items() if size is not None}
    if mapped is not None:
        return replace(mapped, **known, assumed=tuple(name for name in mapped.assumed if name not in known))
    if not known and given["columns"] is None:
        return None
    return Metadata(**known, assumed=tuple(name for name in FIELD_SIZES if name not in known))


@contextmanager
def _stoppable() -> Iterator[Callable[[], bool]]:
    """Signals end the session, not the program: nothing that came is lost. The second time they end both."""
    from scenarios.cli._signals import WORDS, Ending

    asked = False

    def ask(number: int, frame: object) -> None:
        nonlocal asked
        if asked:
            raise Ending(number)
        asked = True

    asking = (number for number in WORDS if signal.getsignal(number) is not signal.SIG_IGN)
    before = {number: signal.signal(number, ask) for number in asking}
    try:
        yield lambda: asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _finish(session: Session, made: Path, cal: Path, plan: Plan, as_json: bool) -> None:
    """Calibrate and judge what was recorded, write it and say so; exit status 1 where the answer is bad."""
    alarms = session.alarms
    calibration: Calibration | None = None
    refused: RigError | None = None
    if plan.calibration is None:
        from scenarios.live.finish import calibrated

        try:
            calibration, others = calibrated(made, plan.options, plan.arm, alarms, session.forgotten_s)
            calibration.write(cal)
            refused = next(iter(others), None)
        except RigError as error:
            refused = error
    if as_json:
        print_json(_document(session, made, cal, calibration, refused))
    else:
        _report(session, made, cal, calibration)
    if refused is not None:
        raise type(refused)(f"{made}: is recorded, but {refused}")
    verdicts = [] if calibration is None else [sensor.quality.verdict for sensor in calibration.sensors.values()]
    good = not alarms if calibration is None else all(verdict is not None and verdict["good"] for verdict in verdicts)
    if not good or (calibration is not None and plan.stop and not session.enough):
        click.get_current_context().exit(1)


def _document(
    session: Session, made: Path, cal: Path, calibration: Calibration | None, refused: RigError | None
) -> dict[str, Any]:

    return {
        "recording": made,
        "samples": session.samples,
        "seconds": session.seconds,
        "enough": session.enough,
        "left_out": session.left_out,
        "calibration": None if calibration is None else cal,
        "refused": None if refused is None else str(refused),
        "sensors": {} if calibration is None else calibration.to_json()["sensors"],
        "alarms": [
            {
                "sensor": alarm.sensor,
                "t_s": alarm.t_s,
                "since_s": alarm.since_s,
                "test": alarm.test,
                "p_value": alarm.p_value,
                "looks_like": [{"effect": each.name, "where": each.where} for each in alarm.names],
            }
            for alarm in session.alarms
        ],
        "events": [{"t_s": event.t_s, "words": event.words} for event in session.events],
    }


def _report(session: Session, made: Path, cal: Path, calibration: Calibration | None) -> None:
    ended = "enough" if session.enough else "not enough" if calibration is not None else "ended"
    recorded = session.samples if session.journal is None else session.journal.total
    click.echo(f"{made}: {recorded:,} samples, {session.seconds:.1f} s: {ended}")
    for alarm in session.alarms:
        click.echo(f"{alarm}; it looks like {alarm.looks_like}")
    if calibration is None:
        return
    from scenarios.terminal.calibration import calibration_report
    from scenarios.terminal.tables import show

    show(calibration_report(calibration))
    click.echo(f"{cal}: written")
