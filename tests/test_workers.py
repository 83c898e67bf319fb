"""Trials in this process, in local processes and on a Dask cluster; killed, resumed, and always the same table."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from local_cluster import ROOT, cluster, wait_until
from study_trials import always_dying, dying, failing, squares

import scenarios
from rig.errors import RigError
from scenarios import workers as where
from scenarios.studies import consistency
from scenarios.studies.settings import Settings
from scenarios.studies.store import TABLE, StudyFolder
from scenarios.workers import Workers


@dataclass(frozen=True)
class Plain:
    seed: int = 5


def small() -> Settings:
    """Twelve trials of some tens of milliseconds each."""
    return Settings.of(scenarios.load("renk2005-table2"), (200, 600), draws=60, orders=("every-kth",))


def table_of(path: Path) -> bytes:
    return (path / TABLE).read_bytes()


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The table made in this process."""
    path = tmp_path_factory.mktemp("reference") / "study"
    consistency.run(small(), StudyFolder.begin(path, "consistency", small()), Workers(0))
    return table_of(path)


@pytest.mark.parametrize("processes", [0, 1, 2])
def test_every_trial_is_made_once(processes: int) -> None:
    found = dict(Workers(processes).completed(partial(squares, 7), range(9)))
    assert sorted(found) == list(range(9))
    for number, table in found.items():
        assert table.equals(squares(7, number))


def test_in_this_process_they_come_one_after_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is made that was not asked for yet: a study that ends has lost no more than the trial at hand."""
    made: list[int] = []
    results = Workers(0).completed(made.append, range(5))
    next(results)
    assert made == [0]
    next(results)
    assert made == [0, 1]


def test_one_process_and_two_give_the_same_table(reference: bytes, tmp_path: Path) -> None:
    for processes in (1, 2):
        path = tmp_path / f"study{processes}"
        consistency.run(small(), StudyFolder.begin(path, "consistency", small()), Workers(processes))
        assert table_of(path) == reference


def test_a_killed_process_is_replaced(tmp_path: Path) -> None:
    found = dict(Workers(2).completed(partial(dying, str(tmp_path)), range(8)))
    assert (tmp_path / "died").exists()
    assert sorted(found) == list(range(8))
    assert all(table.equals(squares(0, number)) for number, table in found.items())


def test_a_trial_that_no_process_survives_is_an_error() -> None:
    with pytest.raises(RigError, match=r"trial 0: its process was killed twice .* run the same command again"):
        list(Workers(1).completed(partial(always_dying, 0), range(2)))


@pytest.mark.parametrize("processes", [0, 1])
def test_what_a_trial_raises_comes_through(processes: int) -> None:
    with pytest.raises(RigError, match="trial 0: found nothing"):
        list(Workers(processes).completed(partial(failing, 0), range(3)))


def test_a_study_goes_on_where_it_was(reference: bytes, tmp_path: Path) -> None:
    """Ended by an error in the middle: what is there is kept, and only the rest is made."""
    path = tmp_path / "study"
    settings, made = small(), []

    def breaking(chosen: Settings, number: int) -> pa.Table:
        if number == 7:
            raise RigError("the power went")
        made.append(number)
        return consistency.trial(chosen, number)

    study = StudyFolder.begin(path, "consistency", settings)
    with pytest.raises(RigError, match="the power went"):
        study.fill(breaking, settings, settings.trials, Workers(0))
    assert set(study.finished()) == set(range(7)) == set(made)
    assert not study.done

    def counting(chosen: Settings, number: int) -> pa.Table:
        made.append(number)
        return consistency.trial(chosen, number)

    shares: list[float] = []
    StudyFolder.begin(path, "consistency", settings).fill(
        counting, settings, settings.trials, Workers(0), shares.append
    )
    assert sorted(made) == list(range(settings.trials)), "a trial was made twice, or not at all"
    assert shares[0] == 7 / settings.trials
    assert shares[-1] == 1.0
    assert table_of(path) == reference
    assert not (path / "trials").exists()
    StudyFolder.begin(path, "consistency", settings).fill(failing, settings, settings.trials, Workers(0))  # all there


def test_a_study_that_ends_before_its_first_trial_leaves_nothing(tmp_path: Path) -> None:
    """Nor bars its folder to another; but what is there beside it stays."""
    path = tmp_path / "study"
    for seed in (5, 6):
        study = StudyFolder.begin(path, "consistency", Plain(seed))
        with pytest.raises(RigError, match="trial 0: found nothing"):
            study.fill(failing, seed, 2, Workers(0))
        assert not path.exists()
    study = StudyFolder.begin(path, "consistency", Plain())
    (path / "notes.txt").touch()
    with pytest.raises(RigError, match="trial 0: found nothing"):
        study.fill(failing, 5, 2, Workers(0))
    assert (path / "notes.txt").exists()
    assert StudyFolder.read(path).settings == {"seed": 5}


def test_a_study_killed_in_the_middle_goes_on(
    reference: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """SIGKILL at about half: identical table, and of all trials at most one is made twice."""
    path, log = tmp_path / "study", tmp_path / "log"
    program = (
        "import sys, time; sys.path.insert(0, 'tests'); from pathlib import Path\n"
        "from test_workers import small; from scenarios.studies import consistency\n"
        "from scenarios.workers import Workers; from scenarios.studies.store import StudyFolder\n"
        "def trial(settings, number):\n"
        f"    found = consistency.trial(settings, number); open({str(log)!r}, 'a').write(f'{{number}}\\n')\n"
        "    time.sleep(0.05); return found\n"
        f"study = StudyFolder.begin(Path({str(path)!r}), 'consistency', small())\n"
        "study.fill(trial, small(), small().trials, Workers(0))\n"
    )
    process = subprocess.Popen([sys.executable, "-c", program], cwd=ROOT)
    wait_until(lambda: len(list((path / "trials").glob("[0-9]*.parquet"))) >= small().trials // 2, process)
    process.send_signal(signal.SIGKILL)
    process.wait()
    done = StudyFolder.read(path).finished()
    assert 0 < len(done) < small().trials
    made = [int(line) for line in log.read_text().split()]

    def counting(chosen: Settings, number: int) -> pa.Table:
        made.append(number)
        return consistency.trial(chosen, number)

    StudyFolder.begin(path, "consistency", small()).fill(counting, small(), small().trials, Workers(0))
    assert set(made) == set(range(small().trials))
    assert len(made) <= small().trials + 1
    assert table_of(path) == reference


def test_orphaned_processes_end(tmp_path: Path) -> None:
    """The processes of a study that was killed do not wait for work for ever."""
    program = (
        "import os, sys, time; sys.path.insert(0, 'tests'); from pathlib import Path\n"
        "from functools import partial; from study_trials import squares; from scenarios.workers import Workers\n"
        "import multiprocessing\n"
        "if __name__ == '__main__':\n"
        "    results = Workers(1).completed(partial(squares, 0), range(50)); next(results)\n"
        "    child = multiprocessing.active_children()[0].pid\n"
        "    Path(sys.argv[1]).write_text(str(child)); time.sleep(60)\n"
    )
    file, script = tmp_path / "child", tmp_path / "orphan.py"
    script.write_text(program)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests")])}
    process = subprocess.Popen([sys.executable, str(script), str(file)], cwd=ROOT, env=environment)
    wait_until(lambda: file.exists() and file.read_text() != "", process)
    child = int(file.read_text())
    process.kill()
    process.wait()
    wait_until(lambda: not alive(child), None)


def test_a_study_that_is_given_up_leaves_no_process() -> None:
    """Nor an exception in the pool's own thread, which pytest would report."""
    results = Workers(1).completed(partial(squares, 0), range(200))
    next(results)
    children = multiprocessing.active_children()
    assert len(children) == 1
    results.close()  # type: ignore[attr-defined]
    wait_until(lambda: not multiprocessing.active_children(), None)
    assert not alive(children[0].pid or 0)


def alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"  # dead, and not yet collected


def test_a_pool_given_up_while_it_starts_says_nothing(tmp_path: Path) -> None:
    """A process that is slow to start comes when all that it needs is gone: no traceback of its own."""
    program = tmp_path / "slow.py"
    program.write_text(
        "import gc, time\n"
        "if __name__ == '__mp_main__':\n"
        "    time.sleep(1.0)\n"
        "from scenarios.workers import WorkerPool\n"
        "if __name__ == '__main__':\n"
        "    pool = WorkerPool(1)\n"
        "    pool.submit(print)\n"
        "    pool.give_up()\n"
        "    pool.shutdown(wait=False)\n"
        "    del pool\n"
        "    gc.collect()\n"
    )
    done = subprocess.run([sys.executable, program], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_dask_cluster_with_a_worker_killed_gives_the_same_table(reference: bytes, tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="Dask is not installed (the extra torusrig[cluster])")
    path = tmp_path / "study"
    with cluster(tmp_path, 2) as (address, workers):

        def progress(share: float) -> None:
            if share >= 0.25 and workers[0].poll() is None:
                workers[0].kill()
                workers[0].wait()

        study = StudyFolder.begin(path, "consistency", small())
        consistency.run(small(), study, Workers(cluster=address), progress)
        assert workers[0].poll() is not None
    assert table_of(path) == reference


def test_a_cluster_that_is_not_there_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="Dask is not installed (the extra torusrig[cluster])")
    monkeypatch.setattr(where, "_CLUSTER_TIMEOUT_S", 0.5)
    for address in ("tcp://127.0.0.1:9", "nonsense://x", "nonsense", "tcp://127.0.0.1"):
        with pytest.raises(RigError, match=f"cluster {address}: no Dask scheduler answers"):
            list(Workers(cluster=address).completed(partial(squares, 0), range(2)))


def test_without_dask_the_way_to_it_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(RigError, match=r"pip install 'torusrig\[cluster\]'"):
        list(Workers(cluster="tcp://127.0.0.1:9").completed(partial(squares, 0), range(2)))


def test_a_folder_holds_one_study(tmp_path: Path) -> None:
    path = tmp_path / "study"
    StudyFolder.begin(path, "consistency", Plain())
    assert StudyFolder.begin(path, "consistency", Plain()).settings == {"seed": 5}
    with pytest.raises(RigError, match="found a study with seed 5, expected 6"):
        StudyFolder.begin(path, "consistency", Plain(6))
    with pytest.raises(RigError, match="found a consistency study, expected subsets"):
        StudyFolder.begin(path, "subsets", Plain())
    with pytest.raises(RigError, match=r"holds no study\.json"):
        StudyFolder.read(tmp_path)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.tex").touch()
    with pytest.raises(RigError, match="something that is no study"):
        StudyFolder.begin(tmp_path / "other", "consistency", Plain())
    with pytest.raises(RigError, match="cannot be made"):
        StudyFolder.begin(tmp_path / "other" / "thesis.tex" / "study", "consistency", Plain())
    (path / "study.json").write_text('{"format": "rig-study/9"}')
    with pytest.raises(RigError, match="format: found 'rig-study/9', expected 'rig-study/1'"):
        StudyFolder.read(path)


def test_a_spoilt_trial_is_made_again(reference: bytes, tmp_path: Path) -> None:
    study = StudyFolder.begin(tmp_path / "study", "consistency", small())
    (study.path / "trials").mkdir()
    for number in (0, 1):
        study._keep(number, consistency.trial(small(), number))
    assert set(study.finished()) == {0, 1}
    spoilt = next((study.path / "trials").glob("00001-*.parquet"))
    spoilt.write_bytes(b"")
    assert set(study.finished()) == {0}
    consistency.run(small(), study, Workers(0))
    assert table_of(study.path) == reference


def test_nobody_else_fills_the_same_study(tmp_path: Path) -> None:
    fcntl = pytest.importorskip("fcntl", reason="no file locks on this system")
    study = StudyFolder.begin(tmp_path / "study", "consistency", Plain())
    with open(study.path / "study.json", "rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        with pytest.raises(RigError, match="another process is running this study"):
            study.fill(squares, 0, 2, Workers(0))


def test_a_negative_number_of_workers_is_refused() -> None:
    with pytest.raises(RigError, match="workers: found -1, expected zero"):
        Workers(-1)


def flipped(path: Path, where: float) -> None:
    """One bit of a file is another; ``where`` is a share of its length."""
    content = bytearray(path.read_bytes())
    content[int(where * (len(content) - 1))] ^= 4
    path.write_bytes(bytes(content))


@pytest.mark.parametrize("where", [0.0, 0.1, 0.5, 0.9, 0.99, 1.0, None])
def test_a_damaged_table_is_named_and_made_again(reference: bytes, tmp_path: Path, where: float | None) -> None:
    """Wherever a bit has changed, in the data or at the end, and where nothing is left (None)."""
    study = StudyFolder.begin(tmp_path / "study", "consistency", small())
    consistency.run(small(), study, Workers(0))
    path = study.path / TABLE
    if where is None:
        path.write_bytes(b"")
    else:
        flipped(path, where)
    assert not study.done
    with pytest.raises(RigError, match=r"table.parquet: is damaged .*run the study again"):
        study.table(TABLE)
    consistency.run(small(), StudyFolder.begin(study.path, "consistency", small()), Workers(0))
    assert table_of(study.path) == reference
    assert not (study.path / "trials").exists()


def test_sound_trials_of_a_damaged_table_are_kept(tmp_path: Path) -> None:
    study = StudyFolder.begin(tmp_path / "study", "consistency", small())
    consistency.run(small(), study, Workers(0))
    flipped(study.path / TABLE, 0.5)
    made: list[int] = []

    def counted(settings: Settings, number: int) -> pa.Table:
        made.append(number)
        return consistency.trial(settings, number)

    study.fill(counted, small(), small().trials, Workers(0))
    assert len(made) == 1


def test_no_bit_of_a_study_changes_unseen(tmp_path: Path) -> None:
    """Of 300 flipped bits none reads back as another study."""
    study = StudyFolder.begin(tmp_path / "study", "consistency", Plain())
    study.write("a.parquet", pa.table({"x": np.arange(1000) * 0.1}))
    before = {path.name: path.read_bytes() for path in study.path.iterdir()}
    rng = np.random.default_rng(1)
    for _ in range(300):
        name = str(rng.choice(sorted(before)))
        content = bytearray(before[name])
        content[rng.integers(len(content))] ^= 1 << rng.integers(8)
        (study.path / name).write_bytes(bytes(content))
        with suppress(RigError):
            found = StudyFolder.read(study.path)
            assert (found.kind, found.settings) == ("consistency", {"seed": 5})
            assert found.table("a.parquet")["x"].to_numpy().tolist() == (np.arange(1000) * 0.1).tolist()
        (study.path / name).write_bytes(before[name])


def test_trials_are_not_written_through_a_link(tmp_path: Path) -> None:
    study = StudyFolder.begin(tmp_path / "study", "consistency", small())
    (tmp_path / "elsewhere").mkdir()
    (study.path / "trials").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(RigError, match="trials: is a link"):
        consistency.run(small(), study, Workers(0))
    assert not list((tmp_path / "elsewhere").iterdir())
