"""Where lines come from: a pipe, a growing file, a TCP port of this machine, a serial port.

Each is read only as fast as its samples are used: what comes too fast waits with the sender, and memory does not grow.
"""

from __future__ import annotations

import os
import re
import select
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, Protocol

from rig.errors import RigError, nearest

try:
    import fcntl
except ImportError:  # not on this system
    fcntl = None  # type: ignore[assignment]

#: Read at once [bytes].
CHUNK: Final = 1 << 20
#: Ports are opened on this machine only.
ADDRESS: Final = "127.0.0.1"
_BAUD: Final = 115200
#: A file or port that went away is looked for this often [s].
_RETRY_S: Final = 0.5


class Source(Protocol):
    """A source of bytes."""

    name: str

    def read(self, timeout_s: float) -> bytes | None:
        """What has come: nothing after ``timeout_s`` without any; None at its end."""
        ...

    def words(self) -> list[str]:
        """What there is to say since the last call; a source that began anew says so with ``ANEW``."""
        ...

    def close(self) -> None:
        """Give it back."""
        ...


#: Said by a source whose lines begin anew.
ANEW: Final = "begins anew"


class _Spoken:
    def __init__(self) -> None:
        self._words: list[str] = []

    def words(self) -> list[str]:
        """What there is to say since the last call."""
        said, self._words = self._words, []
        return said


def _waits(source: Any, timeout_s: float) -> bool:
    """Whether anything comes from a descriptor or socket within a time."""
    return bool(select.select([source], [], [], timeout_s)[0])


class PipeSource(_Spoken):
    """Standard input, or any open descriptor."""

    name = "standard input"

    def __init__(self, descriptor: int) -> None:
        """Args: descriptor to read from."""
        super().__init__()
        self._descriptor = descriptor
        if fcntl is not None and hasattr(fcntl, "F_SETPIPE_SZ"):
            with suppress(OSError):  # not a pipe; else as much waits in it as is read at once
                fcntl.fcntl(descriptor, fcntl.F_SETPIPE_SZ, CHUNK)

    def read(self, timeout_s: float) -> bytes | None:
        """What waits in the pipe, ``CHUNK`` bytes at most; None once its writers have closed it."""
        if not _waits(self._descriptor, timeout_s):
            return b""
        return os.read(self._descriptor, CHUNK) or None

    def close(self) -> None:
        """Standard input is not ours to close."""


class FileSource(_Spoken):
    """A file that may still grow; one that is cut or replaced begins anew."""

    def __init__(self, path: Path) -> None:
        """Raises: RigError: no such file."""
        super().__init__()
        self.name = str(path)
        self._path = path
        try:
            self._file = path.open("rb", buffering=0)
        except OSError as error:
            absent = isinstance(error, FileNotFoundError) and path.parent.is_dir()
            beside = os.listdir(path.parent) if absent else []
            raise RigError(f"{path}: cannot be read: {error.strerror}{nearest(path.name, beside)}") from error
        self._inode = os.fstat(self._file.fileno()).st_ino

    def read(self, timeout_s: float) -> bytes | None:
        """What was written behind what has been read; never None, as the file may grow."""
        if data := self._file.read(CHUNK):
            return data
        time.sleep(min(timeout_s, 0.02))
        try:
            status = self._path.stat()
        except OSError:
            return b""  # taken away; it may come back
        if status.st_ino != self._inode or status.st_size < self._file.tell():
            self._file.close()
            self._file = self._path.open("rb", buffering=0)
            self._inode = status.st_ino
            self._words.append(f"{self.name}: {ANEW}: it was cut or replaced")
        return b""

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class PortSource(_Spoken):
    """A TCP port of this machine that a sender connects to; after one sender the next."""

    def __init__(self, port: int) -> None:
        """Raises: RigError: the port is taken."""
        super().__init__()
        self._server = socket.socket()
        self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._server.bind((ADDRESS, port))
        except OSError as error:
            self._server.close()
            raise RigError(f"tcp:{port}: cannot be opened: {error.strerror}, expected a port nobody has") from error
        self._server.listen(1)
        self.port = int(self._server.getsockname()[1])
        self.name = f"tcp:{self.port}"
        self._sender: socket.socket | None = None

    def read(self, timeout_s: float) -> bytes | None:
        """What the sender sent; never None, as another one may connect."""
        if self._sender is None:
            if not _waits(self._server, timeout_s):
                return b""
            self._sender, _ = self._server.accept()
            self._words.append(f"{self.name}: {ANEW}: a sender has connected")
        if not _waits(self._sender, timeout_s):
            return b""
        try:
            data = self._sender.recv(CHUNK)
        except OSError:
            data = b""
        if not data:
            self._sender.close()
            self._sender = None
            self._words.append(f"{self.name}: the sender has gone: waiting for another one")
        return data

    def close(self) -> None:
        """Hang up on the sender and give the port back."""
        for one in (self._sender, self._server):
            if one is not None:
                one.close()


class DialledSource(_Spoken):
    """A device behind something that can vanish, which is opened again until it answers."""

    def __init__(self, name: str, dial: Callable[[], Any], receive: Callable[[Any, float], bytes | None]) -> None:
        """Args:
        dial: opens it; raises OSError while it is not there.
        receive: what has come within a time; None where it has gone.

        Raises:
            RigError: it is not there now.
        """
        super().__init__()
        self.name = name
        self._dial, self._receive = dial, receive
        self._device: Any = None
        self._tried = 0.0
        try:
            self._device = dial()
        except OSError as error:
            raise RigError(f"{name}: cannot be opened: {error.strerror or error}") from error

    def read(self, timeout_s: float) -> bytes | None:
        """What the device sent; never None, as it may come back."""
        if self._device is None:
            time.sleep(min(timeout_s, 0.05))
            if time.monotonic() - self._tried < _RETRY_S:
                return b""
            self._tried = time.monotonic()
            try:
                self._device = self._dial()
            except OSError:
                return b""
            self._words.append(f"{self.name}: {ANEW}: it is back")
        try:
            data = self._receive(self._device, timeout_s)
        except OSError:
            data = None
        if data is None:
            self.close()
            self._words.append(f"{self.name}: has gone: looking for it")
            return b""
        return data

    def close(self) -> None:
        """Close the device, whether or not it is still there."""
        if self._device is not None:
            with suppress(OSError):
                self._device.close()
            self._device = None


def _serial(name: str, device: str, baud: int) -> DialledSource:
    import serial

    def dial() -> Any:
        return serial.Serial(device, baud, timeout=0)

    def receive(port: Any, timeout_s: float) -> bytes | None:
        if not _waits(port.fileno(), timeout_s):
            return b""
        try:
            return os.read(port.fileno(), CHUNK) or None
        except BlockingIOError:
            return b""

    return DialledSource(name, dial, receive)


def _dialled_port(name: str, port: int) -> DialledSource:
    def dial() -> socket.socket:
        return socket.create_connection((ADDRESS, port), timeout=1.0)

    def receive(sender: socket.socket, timeout_s: float) -> bytes | None:
        return (sender.recv(CHUNK) or None) if _waits(sender, timeout_s) else b""

    return DialledSource(name, dial, receive)


def open_source(text: str) -> Source:
    """The source that a word on the command line names.

    Args:
        text: ``-`` (standard input), ``tcp:PORT`` (wait for a sender), ``connect:PORT`` (of this machine),
            ``serial:DEVICE`` or ``serial:DEVICE@BAUD``, else the path of a file, which may still grow.

    Raises:
        RigError: it cannot be opened.
    """
    if text == "-":
        return PipeSource(sys.stdin.fileno())
    if found := re.fullmatch(r"(tcp|connect):(.*)", text):
        kind, number = found.groups()
        if not number.isdecimal() or not 0 <= int(number) < 65536 or (kind == "connect" and int(number) == 0):
            raise RigError(f"{text}: found port {number!r}, expected a number up to 65535, as in {kind}:5555")
        return PortSource(int(number)) if kind == "tcp" else _dialled_port(text, int(number))
    if text.startswith("serial:"):
        device, _, baud = text.removeprefix("serial:").partition("@")
        if not device or (baud and not baud.isdecimal()):
            raise RigError(f"{text}: expected serial:DEVICE or serial:DEVICE@BAUD, as in serial:/dev/ttyUSB0@115200")
        return _serial(text, device, int(baud or _BAUD))
    return FileSource(Path(text))
