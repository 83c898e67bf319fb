"""The rerun viewer as a program: where it lies, and how it is started without reaching out to anybody."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from rig.errors import RigError

#: It listens to this machine only; its own default is every address of the machine.
ADDRESS: Final = "127.0.0.1"
_ANSWERS_S: Final = 15.0


def viewer_program() -> Path:
    """The viewer itself: the ``rerun`` command is a wrapper, and stopping the wrapper leaves the viewer running.

    Raises:
        RigError: the rerun package was installed without it.
    """
    if override := os.environ.get("RERUN_CLI_PATH"):  # as the wrapper does
        return Path(override)
    package = find_spec("rerun_cli")
    folder = Path(package.origin if package and package.origin else "rerun_cli").parent
    bundled = folder / "Rerun.app" / "Contents" / "MacOS" / "Rerun"
    program = folder / ("rerun.exe" if sys.platform == "win32" else "rerun")
    for candidate in (bundled, program):
        if candidate.is_file():
            return candidate
    raise RigError(f"{program}: the rerun viewer is missing: install rerun-sdk again")


def viewer_environment() -> Mapping[str, str]:
    """This process's environment, with the viewer's reports to its makers turned off for the one run.

    The viewer sends none where CI is set; the user's own settings are neither read nor changed.
    """
    return {**os.environ, "CI": "1"}


def open_view(path: str | os.PathLike[str]) -> subprocess.Popen[bytes]:
    """Open an .rrd file in a new viewer window, which outlives this process; nothing but this machine can reach it.

    Raises:
        RigError: the file is missing, or the viewer cannot be started.
    """
    return _started("--port", "auto", str(_existing(path)), outlives=True)


def serve_view(path: str | os.PathLike[str]) -> tuple[subprocess.Popen[bytes], str]:
    """Serve an .rrd file and a viewer for browsers, on this machine only: the process, and the page's address.

    Raises:
        RigError: the file is missing, or the viewer does not start or answer within some seconds.
    """
    file = _existing(path)
    data, page = free_port(), free_port()
    server = _started("--serve-web", "--port", str(data), "--web-viewer-port", str(page), str(file), outlives=False)
    if not _answers(server, page):
        server.terminate()
        raise RigError(f"{file}: the viewer for browsers did not answer within {_ANSWERS_S:g} s")
    source = f"rerun%2Bhttp%3A%2F%2F{ADDRESS}%3A{data}%2Fproxy"
    return server, f"http://{ADDRESS}:{page}/?url={source}"


def start_viewer() -> str:
    """Start a viewer window that waits for a live stream, and outlives this process; its address, on this machine only.

    Raises:
        RigError: it cannot be started, or does not answer within some seconds.
    """
    port = free_port()
    viewer = _started("--port", str(port), "--memory-limit", "1GB", outlives=True)
    if _answers(viewer, port):
        return f"rerun+http://{ADDRESS}:{port}/proxy"
    if viewer.returncode is not None:
        raise RigError(
            f"the viewer ended at once with status {viewer.returncode}: no screen? Expected --view-file F.rrd"
        )
    viewer.terminate()
    raise RigError(f"the viewer did not answer within {_ANSWERS_S:g} s")


def _existing(path: str | os.PathLike[str]) -> Path:
    file = Path(path)
    if not file.is_file():
        raise RigError(f"{file}: no such file, expected an .rrd file")
    return file


def _started(*options: str, outlives: bool) -> subprocess.Popen[bytes]:
    """The viewer with its options, heard and seen by nobody but itself; whether it ``outlives`` this process."""
    command = [str(viewer_program()), "--bind", ADDRESS, *options]
    quiet = subprocess.DEVNULL
    try:
        return subprocess.Popen(
            command, env=viewer_environment(), stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=outlives
        )
    except OSError as error:
        raise RigError(f"{command[0]}: the viewer cannot be started: {error.strerror}") from error


def _answers(viewer: subprocess.Popen[bytes], port: int) -> bool:
    """Whether somebody answers at a port within some seconds, and before the viewer ends."""
    deadline = time.monotonic() + _ANSWERS_S
    while time.monotonic() < deadline and viewer.poll() is None:
        with socket.socket() as probe:
            if probe.connect_ex((ADDRESS, port)) == 0:
                return True
        time.sleep(0.1)
    return False


def free_port() -> int:
    """A port of this machine that nobody has."""
    with socket.socket() as probe:
        probe.bind((ADDRESS, 0))
        return int(probe.getsockname()[1])
