"""Files and folders as others can rely on them: written whole or not at all, and only where they were asked for."""

from __future__ import annotations

import errno
import hashlib
import os
import re
import shutil
import stat
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, Final

from rig.errors import RigError, shown

try:
    import fcntl
except ImportError:  # no such locks on this system: what a killed process leaves stays
    fcntl = None  # type: ignore[assignment]

#: In the names of temporary files and folders, between the target's name and random letters.
_MARK: Final = ".rig-"
_LOCK: Final = "lock"
_FULL: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_YOUNG_S: Final = 60.0
_swept: set[tuple[int, Path]] = set()
#: The temporary files that are being written here, and the names that they are to have.
_own: dict[Path, Path] = {}


def _umask() -> int:
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


_UMASK: Final = _umask()  # it can only be read by setting it, which is no business of a thread


@contextmanager
def atomic_path(path: str | os.PathLike[str], mode: int | None = None) -> Iterator[Path]:
    """A temporary path in the folder of ``path``; it takes that name when the block ends well, and is removed
    otherwise.

    The suffix is kept, so that writers which look at it do the same as for ``path`` itself. The file is on the disk
    before it gets its name, and the name before the block is left. What an earlier process, killed, has left of its own
    in that folder is removed. A writer that is given such a temporary path writes to it as it is.

    Args:
        path: of the file.
        mode: its permissions; those of the file that it replaces, or the user's usual ones, where none are given.

    Raises:
        RigError: the folder does not exist or cannot be written to, ``path`` is a folder or no ordinary file, or the
            disk is full.
    """
    target = Path(path)
    if target in _own:  # its name is not yet given, and another file in its place would not be locked
        with _fullness_told(target, _own[target]):
            yield target
        return
    check_writable(target)
    with ExitStack() as opened:
        temporary = opened.enter_context(_temporary(target))
        _own[temporary] = target
        opened.callback(_own.pop, temporary, None)
        with _fullness_told(temporary, target):
            yield temporary
            os.chmod(temporary, _mode(target) if mode is None else mode)
            with temporary.open("rb") as file:
                os.fsync(file.fileno())
            temporary.replace(target)
            sync_folder(target.parent)


@contextmanager
def _fullness_told(temporary: Path, target: Path) -> Iterator[None]:
    """A full disk is said with the file's name and size."""
    try:
        yield
    except OSError as error:
        if error.errno not in _FULL:
            raise
        size = temporary.stat().st_size if temporary.exists() else 0
        raise RigError(
            f"{target}: cannot be written: {os.strerror(error.errno)} after {size} bytes; nothing was changed"
        ) from error


def check_writable(target: Path) -> None:
    """Refuse, before any work, a file that could not be written.

    Raises:
        RigError: a folder, something else than an ordinary file, or a folder that is missing or not writable.
    """
    try:
        if target.is_dir():
            raise RigError(f"{target}: is a folder, expected the name of a file to write")
        if not target.parent.is_dir():
            found = "is a file" if target.parent.exists() else "does not exist"
            raise RigError(f"{target}: folder {target.parent} {found}")
        if target.exists() and not target.is_file():
            raise RigError(f"{target}: is no ordinary file, expected the name of a file to write")
    except (OSError, ValueError) as error:  # a name too long, or one with a zero in it
        raise RigError(f"{target}: cannot be written: {getattr(error, 'strerror', None) or error}") from error
    _check_access(target, target.parent)


def _check_access(target: Path, folder: Path) -> None:
    if not os.access(folder, os.W_OK):
        raise RigError(f"{target}: folder {folder} cannot be written to")


def write_text(path: str | os.PathLike[str], text: str, mode: int | None = None) -> None:
    """Write a UTF-8 text file whole or not at all; arguments and errors as of ``atomic_path``."""
    with atomic_path(path, mode) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")


def write_together(*files: tuple[Path | None, Callable[[Path], object]]) -> None:
    """Write several files, all of them or none.

    Args:
        files: each with what writes it to a path; one of None is not asked for.

    Raises:
        RigError: as of ``atomic_path``.
    """
    with ExitStack() as opened:
        for path, write in files:
            if path is not None:
                write(opened.enter_context(atomic_path(path)))


def file_hash(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def check_not_input(output: Path, *inputs: Path | None) -> None:
    """Refuse to write over what is read.

    Raises:
        RigError: ``output`` is one of the files ``inputs``, by whatever name.
    """
    for given in inputs:
        with suppress(OSError, ValueError):
            if given is not None and os.path.samefile(given, output):
                raise RigError(f"{output}: is the file {given} that is read, expected another name for the output")


def check_different(paths: Iterable[Path]) -> None:
    """Refuse to count what is read twice.

    Raises:
        RigError: one of ``paths`` is the file or folder of an earlier one, by whatever name.
    """
    found: dict[str, Path] = {}
    for path in paths:
        real = os.path.realpath(path)
        if real in found:
            again = "is given twice" if path == found[real] else f"is the same as {found[real]}"
            raise RigError(f"{path}: {again}, expected each once")
        found[real] = path


def child(folder: Path, name: Any, where: str) -> Path:
    """A file of a folder by a name that comes from a file: it cannot lead out of the folder.

    Args:
        folder: where it must lie.
        name: what was found.
        where: the file and the key that hold it, for messages.

    Raises:
        RigError: no text, no plain file name, or a link that leads elsewhere.
    """
    plain = isinstance(name, str) and name not in ("", ".", "..") and len(name) <= 200 and name.isprintable()
    if not plain or any(letter in name for letter in "/\\:"):
        raise RigError(f"{where}: found {shown(name)}, expected the plain name of a file in {folder}")
    path = folder / str(name)
    if path.is_symlink():
        raise RigError(f"{path}: is a link, expected a file of the folder itself")
    return path


def own_folder(path: Path, linked: bool = False) -> Path:
    """A folder inside another, made where it is missing, that is no link to elsewhere, unless it may be ``linked``.

    Raises:
        RigError: it is a link or a file, or cannot be made.
    """
    if path.is_symlink() and not linked:
        raise RigError(f"{path}: is a link, expected a folder of its own")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RigError(f"{path}: the folder cannot be made: {error.strerror}") from error
    return path


@contextmanager
def made_folder(path: Path, linked: bool = True) -> Iterator[Path]:
    """A folder as of ``own_folder`` that can be written to; what was made for it and is still empty when the block
    fails is removed."""
    missing = [folder for folder in (path, *path.parents) if not folder.exists()]
    try:
        _check_access(path, own_folder(path, linked))
        yield path
    except BaseException:
        for folder in missing:
            with suppress(OSError):  # not empty, or never made
                folder.rmdir()
        raise


@contextmanager
def scratch_folder(prefix: str) -> Iterator[Path]:
    """A folder for temporary files, removed at the end of the block; if the process is killed, by the next to ask for
    one with the same prefix."""
    root = Path(tempfile.gettempdir())
    _sweep(root, f"{prefix}{_MARK}")
    with tempfile.TemporaryDirectory(prefix=f"{prefix}{_MARK}", dir=root, ignore_cleanup_errors=True) as name:
        handle = os.open(Path(name) / _LOCK, os.O_CREAT | os.O_RDWR, 0o600)
        try:
            _lock(handle)
            yield Path(name)
        finally:
            os.close(handle)


def in_utf8(name: str) -> str:
    """A file's name as text that every library can take, bytes that are no UTF-8 as ``\\xff``."""
    return os.fsencode(name).decode("utf-8", "backslashreplace")


def sync_folder(folder: Path) -> None:
    """Have a folder's names on the disk, where the system can."""
    if os.name != "posix":
        return
    with suppress(OSError):  # some network folders cannot
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextmanager
def _temporary(target: Path) -> Iterator[Path]:
    """An empty file beside ``target``, locked while this process lives."""
    _sweep(target.parent)
    stem = re.sub(r"[^A-Za-z0-9.-]", "_", target.stem[:40])  # a name that every library can open
    temporary = None
    handle = -1
    try:
        while handle < 0:
            try:
                handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{stem}{_MARK}", suffix=target.suffix)
            except OSError as error:
                raise RigError(f"{target}: cannot be written: {error.strerror}") from error
            temporary = Path(name)
            _lock(handle)
            if not os.fstat(handle).st_nlink:  # another process found it before it was locked
                os.close(handle)
                handle = -1
        assert temporary is not None
        yield temporary
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
        if handle >= 0:
            os.close(handle)


def _mode(target: Path) -> int:
    """Of the file that is replaced, or of a new one."""
    with suppress(OSError):
        found = os.lstat(target).st_mode
        if stat.S_ISREG(found):
            return stat.S_IMODE(found)
    return 0o666 & ~_UMASK


def _lock(handle: int) -> None:
    if fcntl is not None:
        with suppress(OSError):  # a file system without locks
            fcntl.flock(handle, fcntl.LOCK_EX)


def _sweep(folder: Path, prefix: str = ".") -> None:
    """Remove what processes have left that were killed: their locks went with them. Once a process and folder."""
    if fcntl is None or (os.getpid(), folder / prefix) in _swept:
        return
    _swept.add((os.getpid(), folder / prefix))
    with suppress(OSError):
        for entry in os.scandir(folder):
            if not entry.name.startswith(prefix) or _MARK not in entry.name or entry.is_symlink():
                continue
            with suppress(OSError):
                _remove_if_left(Path(entry.path))


def _remove_if_left(path: Path) -> None:
    if path.stat().st_uid != os.getuid():
        return
    locked = path / _LOCK if path.is_dir() else path
    if not locked.is_file():  # killed before its lock was made, or about to make it
        if path.is_dir() and time.time() - path.stat().st_mtime > _YOUNG_S:
            path.rmdir()
        return
    handle = os.open(locked, os.O_RDWR | os.O_NOFOLLOW)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
    finally:
        os.close(handle)
