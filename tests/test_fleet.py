"""Many recordings at once: what is kept, what is made again, one table wherever it is made, and what it tells."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from pathlib import Path

import pytest
from cli_support import Rig
from diagnosed_recordings import backlash, by_hand, cause, only, recorded
from local_cluster import cluster
from rich.console import Console

from estimators.gap import Diagnosis
from estimators.gap.reading import diagnosis_of, read_diagnosis
from rig.errors import RigError
from rig.recording import read_recording
from scenarios.diagnosing.fleet import Entry, History, fleet_csv, fleet_json, histories
from scenarios.diagnosing.task import About
from scenarios.gap_report.fleet_page import fleet_page
from scenarios.gap_report.terminal import diagnosis_tables

QUICK = only("backlash")
FLEET = {"fleet.csv", "fleet.json", "fleet.html"}


@pytest.fixture
def lab(here: Path) -> list[str]:
    """Two arms with two recordings each; the first arm has a backlash from its second recording on."""
    names = []
    for number, (serial, month, effects) in enumerate(
        [("A7", 1, []), ("A7", 2, [backlash()]), ("B1", 1, []), ("B1", 2, [])]
    ):
        run, locked = recorded(*effects, seed=number)
        about = replace(run.metadata, serial=serial, recorded=f"2026-0{month}-15T08:00")
        replace(run, metadata=about).write(f"{serial}-{month}.parquet")
        locked.write(f"{serial}-{month}.locked.parquet")
        names.append(f"{serial}-{month}.parquet")
    return names


def stamps(folder: str) -> dict[str, int]:
    return {path.name: path.stat().st_mtime_ns for path in Path(folder).iterdir() if path.name not in FLEET}


def test_what_is_there_is_kept_and_the_rest_is_made(rig: Rig, lab: list[str]) -> None:
    text = rig.done("diagnose", *lab, "--out", "o", "--jobs", "1", *QUICK)
    assert "backlash of joint 5 (now)" in text
    assert "2026-02-15T08:00 (A7-2)  2026-01-15T08:00 (A7-1)" in text
    before, table = stamps("o"), Path("o/fleet.csv").read_bytes()
    rows = list(csv.DictReader(table.decode().splitlines()))
    assert [(row["arm"], row["recording"], row["effect"], row["since"]) for row in rows] == [
        ("A7", "A7-1", "", ""),
        ("A7", "A7-2", "backlash", "A7-2"),
        ("B1", "B1-1", "", ""),
        ("B1", "B1-2", "", ""),
    ]
    assert "4 of them kept" in rig.done("diagnose", *lab, "--out", "o", "--jobs", "1", *QUICK)
    assert stamps("o") == before
    assert Path("o/fleet.csv").read_bytes() == table

    # Another recording, a page that is gone, a damaged diagnosis: these are made again, and no other.
    read_recording(lab[1]).select(slice(0, 500)).write(lab[0])
    Path("o/B1-1.html").unlink()
    Path("o/B1-2.diagnosis.json").write_text("{}")
    assert "1 of them kept" in rig.done("diagnose", *lab, "--out", "o", "--jobs", "1", *QUICK)
    untouched = {name for name, stamp in stamps("o").items() if before[name] == stamp}
    assert untouched == {f"A7-2.{kind}" for kind in ("diagnosis.json", "html", "calibration.json")}
    assert json.loads(Path("o/A7-1.diagnosis.json").read_text())["samples"] == 500
    # Other options are another diagnosis.
    assert "kept" not in rig.done("diagnose", *lab[2:], "--out", "o", "--jobs", "1", *QUICK, "--minutes", "5")


def test_a_cluster_with_a_worker_killed_gives_the_same_table(
    rig: Rig, lab: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a recording that is missing among them; nothing is made again afterwards."""
    pytest.importorskip("distributed", reason="Dask is not installed (the extra torusrig[cluster])")
    from scenarios.diagnosing import kept

    runs = [*lab, "missing.parquet"]
    rig("diagnose", *runs, "--out", "here", "--jobs", "1", *QUICK)
    (tmp_path / "dask").mkdir()
    with cluster(tmp_path / "dask", 2) as (address, workers):
        write = kept.write_outcome

        def killing(*arguments: object) -> None:
            if workers[0].poll() is None:
                workers[0].kill()
                workers[0].wait()
            write(*arguments)  # type: ignore[arg-type]

        monkeypatch.setattr(kept, "write_outcome", killing)
        result = rig("diagnose", *runs, "--out", "there", "--cluster", address, *QUICK)
        assert workers[0].poll() is not None
        assert result.status == 2
        assert result.err.startswith("rig: missing.parquet: no such file")
        assert result.err.count("\n") == 1
        monkeypatch.setattr(kept, "write_outcome", None)
        assert "4 of them kept" in rig("diagnose", *lab, "--out", "there", "--cluster", address, *QUICK).out
        Path("here/fleet.csv").write_bytes(b"")
        rig("diagnose", *lab, "--out", "here", "--jobs", "1", *QUICK)
    for name in ("fleet.csv", "fleet.json", "fleet.html"):
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes()


def entry(name: str, diagnosis: Diagnosis | None, arm: str = "A7", **options: object) -> Entry:
    about = None if diagnosis is None else About("a465", serial=arm, recorded=f"2026-01-{name}")
    return Entry(name, diagnosis, about, **options)  # type: ignore[arg-type]


def none() -> Diagnosis:
    return by_hand("no-gap", causes=())


TWIN = ({"effect": "joint_offset", "where": "joint5", "probability": 0.4},)
LASH = cause("backlash", "joint5", width_rad=(0.05, 0.0004, "rad"))


def only(entries: list[Entry]) -> History:
    (found,) = histories(entries)
    return found


def test_since_when_is_the_latest_unbroken_run() -> None:
    named, quiet = by_hand("named", causes=(LASH,)), none()
    found = only([entry(f"{day:02d}", named if day in (2, 5, 7) else quiet) for day in range(1, 8)])
    assert found.seen == ("absent", "found", "absent", "absent", "found", "absent", "found")
    assert found.since.name == "07"
    assert found.before is not None
    assert found.before.name == "06"
    assert found.now
    gone = only([entry("01", named), entry("02", quiet)])
    assert not gone.now
    assert (gone.since.name, gone.before) == ("01", None)


def test_what_could_not_be_told_is_not_said_to_be_absent() -> None:
    """After an unexplained gap, where the effect was left out, cannot be told or nothing was diagnosed."""
    named, open_ = by_hand("named", causes=(LASH,)), by_hand("unknown", causes=())
    blind = replace(none(), cannot_tell=({"effect": "backlash", "where": "joint5", "why": "it turns one way"},))
    days = [
        entry("01", named),
        entry("02", open_),
        entry("03", blind),
        entry("04", none(), without=("backlash",)),
        Entry("05", None, About("a465", "A7", "2026-01-05"), "refused"),
        entry("06", named),
        entry("07", open_),
    ]
    found = only(days)
    assert found.seen == ("found", "open", "open", "open", "open", "found", "open")
    assert found.since.name == "01"
    assert found.now


def test_a_cause_by_two_names_is_one_cause_by_the_name_that_both_share() -> None:
    twin = by_hand("named", causes=(replace(LASH, equivalent=TWIN),))
    offset = by_hand("named", causes=(cause("joint_offset", "joint5", offset_rad=(0.01, 0.001, "rad")),))
    assert only([entry("01", twin), entry("02", offset)]).names == (("joint_offset", "joint5"),)
    both = histories([entry("01", offset, arm="A7"), entry("01", offset, arm="B1")])
    assert [each.arm for each in both] == ["A7", "B1"]


def test_the_table_does_not_depend_on_the_order_of_the_work() -> None:
    days = [entry("01", none()), entry("02", by_hand("named", causes=(LASH,))), Entry("x", None, None, "no such file")]
    for made in (fleet_csv, fleet_page, lambda each: json.dumps(fleet_json(each))):
        assert made(days) == made(days[::-1])
    page = fleet_page(days)
    assert 'href="02.html"' in page
    assert "no such file" in page
    assert "&lt;b&gt;" in fleet_page([entry("<b>", none())])


@pytest.mark.parametrize("verdict", ["no-gap", "named", "ambiguous", "partly", "unknown"])
def test_a_diagnosis_reads_back_as_it_was_written(tmp_path: Path, verdict: str) -> None:
    vector = cause("bias_step", "mag3", TWIN, step=((0.1, None), (0.01, None), "V"), source=("supply", None, "name"))
    made = replace(by_hand(verdict, causes=(LASH, vector)), next={"maneuver": None}, names={"joint5": "wrist_2"})
    made.write(tmp_path / "x.json")
    again = read_diagnosis(tmp_path / "x.json")
    assert again.to_json() == made.to_json()
    assert again.names == {"joint5": "wrist_2"}
    assert again.leading == made.leading


def test_a_reader_is_told_the_arms_own_names() -> None:
    made = replace(
        by_hand("named", causes=(LASH,)),
        names={"joint5": "wrist_2"},
        next={"maneuver": "stops", "why": "joint 5 moves"},
    )
    shown = Console(width=200, record=True, file=io.StringIO())
    shown.print(diagnosis_tables(made, {"accelerometer": "V", "magnetometer": "V"}))
    for words in (shown.export_text(), fleet_page([Entry("01", made, None)])):
        assert "wrist_2" in words
        assert "joint5" not in words
        assert "joint 5" not in words
    assert '"joint5"' in made.to_text()  # other programs go by the catalogue's places


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("format", "rig-diagnosis/9", "expected 'rig-diagnosis/2'"),
        ("verdict", "nmaed", "named"),
        ("hypotheses", [{"causes": ["x"], "probability": 1.0}], "pairs"),
        ("causes", [{"effect": "backlash"}], "equivalent"),
        ("samples", -1, "whole number"),
        ("closed", None, "expected an object"),
    ],
)
def test_what_is_no_diagnosis_is_refused_in_a_line(key: str, value: object, words: str) -> None:
    document = {**by_hand().to_json(), key: value}
    with pytest.raises(RigError, match=words) as error:
        diagnosis_of(document, "x.json")
    assert str(error.value).count("\n") == 0
    assert "x.json" in str(error.value)


@pytest.mark.parametrize("bad", ["yesterday", 20260515, ""])
def test_a_time_that_is_none_is_refused(bad: object) -> None:
    run, _ = recorded()
    with pytest.raises(RigError, match=r"recorded: found .* expected a date"):
        replace(run.metadata, recorded=bad)
