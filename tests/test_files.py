"""Files are written whole or not at all, under the names that were asked for, and leave nothing beside them."""

from __future__ import annotations

import errno
import os
import stat
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from rig.errors import RigError
from rig.files import atomic_path, check_not_input, child, made_folder, own_folder, scratch_folder, write_text

HOLD = """
import sys, time
from rig.files import atomic_path, scratch_folder
with atomic_path(sys.argv[1]) as temporary, scratch_folder("rig-held") as folder:
    temporary.write_text("half")
    (folder / "picture").write_text("half")
    print(folder, flush=True)
    time.sleep(600)
"""


def test_a_folder_that_stays_empty_goes_again(tmp_path: Path) -> None:
    inside = tmp_path / "a" / "b"

    def fail(folder: Path, change: Callable[[Path], None] = lambda file: None) -> None:
        with made_folder(folder):
            change(inside / "kept")
            raise KeyError

    with pytest.raises(KeyError):
        fail(inside)
    assert not list(tmp_path.iterdir())
    with pytest.raises(KeyError):
        fail(inside, Path.touch)
    assert (inside / "kept").exists()
    with pytest.raises(KeyError):  # it was there before
        fail(inside, Path.unlink)
    assert inside.exists()
    (tmp_path / "link").symlink_to(inside)
    with pytest.raises(RigError, match="is a link"), made_folder(tmp_path / "link", linked=False):
        pass


def fail(path: Path, error: BaseException) -> None:
    """Write half of a file."""
    with atomic_path(path) as temporary:
        temporary.write_text("half")
        raise error


def test_a_file_that_is_replaced_keeps_its_mode(tmp_path: Path) -> None:
    path = tmp_path / "cal.json"
    write_text(path, "new")
    umask = os.umask(0)
    os.umask(umask)
    assert stat.S_IMODE(path.stat().st_mode) == 0o666 & ~umask
    for mode in (0o600, 0o644, 0o755):
        path.chmod(mode)
        write_text(path, "again")
        assert stat.S_IMODE(path.stat().st_mode) == mode
    write_text(path, "secret", mode=0o600)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_what_fails_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("old")
    for error in (ValueError("no"), KeyboardInterrupt()):
        with pytest.raises(type(error)):
            fail(path, error)
        assert path.read_text() == "old"
        assert os.listdir(tmp_path) == ["run.csv"]


def test_a_full_disk_is_said_with_file_and_size(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    with pytest.raises(RigError, match=r"run.csv: cannot be written: No space left on device after 4 bytes"):
        fail(path, OSError(errno.ENOSPC, "No space left on device"))
    assert os.listdir(tmp_path) == []


def test_what_is_no_ordinary_file_is_not_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(RigError, match="no ordinary file"):
        write_text(tmp_path / "pipe.csv", "text")
    with pytest.raises(RigError, match="is a folder"):
        write_text(tmp_path, "text")
    with pytest.raises(RigError, match="does not exist"):
        write_text(tmp_path / "none" / "a.csv", "text")
    with pytest.raises(RigError, match="cannot be written"):
        write_text(tmp_path / ("a" * 5000), "text")


def test_a_link_is_replaced_and_not_followed(tmp_path: Path) -> None:
    (tmp_path / "other").write_text("kept")
    (tmp_path / "link.csv").symlink_to(tmp_path / "other")
    write_text(tmp_path / "link.csv", "new")
    assert (tmp_path / "other").read_text() == "kept"
    assert not (tmp_path / "link.csv").is_symlink()


def test_what_a_killed_process_left_is_removed_by_the_next(tmp_path: Path) -> None:
    """And what a living one holds is not."""
    path = tmp_path / "cal.json"
    scratch = tmp_path / "tmp"
    scratch.mkdir()
    environment = {**os.environ, "TMPDIR": str(scratch)}
    held = []
    for _ in range(2):
        process = subprocess.Popen(
            [sys.executable, "-c", HOLD, str(path)], stdout=subprocess.PIPE, text=True, env=environment
        )
        assert process.stdout is not None
        held.append((process, Path(process.stdout.readline().strip())))
    dead, alive = held
    try:
        assert len(list(tmp_path.glob(".cal.rig-*"))) == 2
        dead[0].kill()
        dead[0].wait()
        program = (
            "import sys; from rig.files import *\nwith scratch_folder('rig-held'): write_text(sys.argv[1], 'whole')"
        )
        subprocess.run([sys.executable, "-c", program, str(path)], env=environment, check=True)
        assert path.read_text() == "whole"
        assert len(list(tmp_path.glob(".cal.rig-*"))) == 1
        assert list(scratch.iterdir()) == [alive[1]]
    finally:
        for process, _ in held:
            process.kill()
            process.communicate()


def test_a_writer_inside_another_leaves_its_file_locked(tmp_path: Path) -> None:
    """Else another command, which cleans up the folder, would take it for a dead process's."""
    with atomic_path(tmp_path / "cal.json") as temporary:
        write_text(temporary, "whole")
        program = "import sys; from rig.files import *; write_text(sys.argv[1], 'another')"
        subprocess.run([sys.executable, "-c", program, str(tmp_path / "other.json")], check=True)
        assert temporary.read_text() == "whole"
    found = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert found == {"cal.json": "whole", "other.json": "another"}


def test_a_full_disk_is_told_by_the_file_that_did_not_fit(tmp_path: Path) -> None:
    """Also inside a writer of several files, of which none gets its name then."""
    program = (
        "import resource, signal, sys; from rig.files import *\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))\n"
        "with atomic_path(sys.argv[1]) as one, atomic_path(sys.argv[2]) as two:\n"
        "    write_text(two, 'small')\n"
        "    write_text(one, 'x' * 1000)\n"
    )
    paths = [str(tmp_path / "large.txt"), str(tmp_path / "small.txt")]
    done = subprocess.run([sys.executable, "-c", program, *paths], capture_output=True, text=True, check=False)
    assert "large.txt: cannot be written: File too large after 100 bytes; nothing was changed" in done.stderr
    assert not list(tmp_path.iterdir())


def test_an_empty_scratch_folder_without_a_lock_is_removed_when_it_is_old(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    for name, age_s in (("rig-x.rig-old", 3600.0), ("rig-x.rig-new", 0.0)):
        (tmp_path / name).mkdir()
        os.utime(tmp_path / name, (time.time() - age_s,) * 2)
    with scratch_folder("rig-x") as folder:
        assert {path.name for path in tmp_path.iterdir()} == {"rig-x.rig-new", folder.name}
    assert [path.name for path in tmp_path.iterdir()] == ["rig-x.rig-new"]


def test_an_input_is_not_written_over(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    path.write_text("volts")
    (tmp_path / "link.parquet").symlink_to(path)
    os.link(path, tmp_path / "hard.parquet")
    for name in ("run.parquet", "link.parquet", "hard.parquet", "../" + tmp_path.name + "/run.parquet"):
        with pytest.raises(RigError, match="that is read"):
            check_not_input(tmp_path / name, None, path)
    check_not_input(tmp_path / "other.parquet", None, path)


@pytest.mark.parametrize(
    "name",
    ["", ".", "..", "../x", "/etc/passwd", "a/b", "a\\b", "C:x", "a\0b", "a\nb", "x" * 300, None, 3, ["a"], {}],
    ids=repr,
)
def test_a_name_from_a_file_stays_in_its_folder(tmp_path: Path, name: object) -> None:
    with pytest.raises(RigError, match=r"^m.json: name: found .*expected the plain name"):
        child(tmp_path, name, "m.json: name")


def test_links_do_not_lead_out_of_a_folder(tmp_path: Path) -> None:
    (tmp_path / "inside").mkdir()
    (tmp_path / "inside" / "case").symlink_to(tmp_path)
    assert child(tmp_path / "inside", "plain.json", "m.json") == tmp_path / "inside" / "plain.json"
    with pytest.raises(RigError, match="is a link"):
        child(tmp_path / "inside", "case", "m.json")
    with pytest.raises(RigError, match="is a link"):
        own_folder(tmp_path / "inside" / "case")
