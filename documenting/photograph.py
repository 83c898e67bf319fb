"""A picture of what a view looks like when it opens, taken without a window.

As a command: ``python -m documenting.photograph FILE.rrd PICTURE.png [SECONDS]``.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rerun.experimental import ViewerClient, ViewerState

from rig.errors import RigError
from rig.files import atomic_path, scratch_folder
from scenarios.view.viewer import ADDRESS, free_port, viewer_environment, viewer_program

_POLL_S: Final = 0.3
_NO_GRAPHICS: Final = ("No graphics adapter", "Failed to get render context")  # what it says before it aborts


@dataclass(frozen=True)
class Photograph:
    """What was seen.

    Attributes:
        views: the names of the views shown.
        complaints: what the views could not draw, one line each; empty when all is well.
        timeline: the active timeline; start_s, end_s: its range [s].
    """

    views: tuple[str, ...]
    complaints: tuple[str, ...]
    timeline: str
    start_s: float
    end_s: float


def photograph(
    path: str | os.PathLike[str],
    picture: str | os.PathLike[str],
    at_s: float | None = None,
    size: tuple[int, int] = (1920, 1080),
    timeout_s: float = 60.0,
    settle_s: float = 7.0,
) -> Photograph:
    """Open an .rrd file in a viewer without a window and save what it shows as a PNG.

    Args:
        at_s: where to put the time cursor [s]; None: where the viewer puts it.
        size: of the picture [pixels].
        timeout_s: until the viewer, which is then stopped, must have drawn everything.
        settle_s: how long to wait once all is loaded: the layout takes some frames, the viewer's greeting some seconds.

    Raises:
        RigError: the file is missing, no graphics driver (a software one will do: Mesa's lavapipe, Debian package
            mesa-vulkan-drivers), or nothing drawn within the time.
    """
    file = Path(path).absolute()
    if not file.is_file():
        raise RigError(f"{path}: no such file, expected an .rrd file")
    deadline = time.monotonic() + timeout_s
    with atomic_path(picture) as temporary, _headless_viewer(file, size) as viewer:
        client = _connect(viewer, deadline)
        if at_s is not None:
            client.set_time(duration=at_s, play_state="paused")
        _wait(viewer, settle_s, deadline)
        client.save_screenshot(str(temporary.absolute()))
        return _seen(client.get_state())


@dataclass(frozen=True)
class _Viewer:
    process: subprocess.Popen[bytes]
    url: str
    log: Path
    file: Path

    def complaint(self) -> str:
        """Why it stopped, in one line."""
        text = self.log.read_text(errors="replace")
        if any(message in text for message in _NO_GRAPHICS):
            return "no graphics driver for the viewer: a software one will do (Debian: apt install mesa-vulkan-drivers)"
        lines = [line for line in text.splitlines() if line.strip()] or ["nothing"]
        said = next((line for line in lines if "panicked at" in line or "rror" in line), lines[-1])
        return f"the viewer stopped with status {self.process.returncode} and said: {said}"


@contextmanager
def _headless_viewer(file: Path, size: tuple[int, int]) -> Iterator[_Viewer]:
    with scratch_folder("rig-photograph") as folder:
        port = free_port()
        log = folder / "viewer.log"
        environment = {"XDG_RUNTIME_DIR": str(folder), **viewer_environment()}
        command = [str(viewer_program()), "--headless", "--bind", ADDRESS, "--port", str(port)]
        command += ["--window-size", f"{size[0]}x{size[1]}", str(file)]
        with log.open("wb") as output:
            process = subprocess.Popen(command, env=environment, stdin=subprocess.DEVNULL, stdout=output, stderr=output)
        try:
            yield _Viewer(process, f"rerun+http://{ADDRESS}:{port}/proxy", log, file)
        finally:
            process.terminate()
            try:
                process.wait(timeout=5.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _connect(viewer: _Viewer, deadline: float) -> ViewerClient:
    """A client of the viewer once everything is loaded."""
    client: ViewerClient | None = None
    while True:
        _wait(viewer, _POLL_S, deadline)
        try:
            client = client or ViewerClient.connect(viewer.url)
            state = client.get_state()
        except Exception:  # not listening yet; the client has no error class of its own
            continue
        if not state.loading and any(recording.timelines for recording in state.recordings):
            return client


def _wait(viewer: _Viewer, seconds: float, deadline: float) -> None:
    time.sleep(seconds)
    if viewer.process.poll() is not None:
        raise RigError(f"{viewer.file}: {viewer.complaint()}")
    if time.monotonic() > deadline:
        raise RigError(f"{viewer.file}: the viewer did not draw it in time")


def _seen(state: ViewerState) -> Photograph:
    recording = next(item for item in state.recordings if item.store_id == state.active_recording)
    name = recording.current_timeline or ""
    line = next((item for item in recording.timelines if item.name == name), None)
    start, end = (line.start or 0, line.end or 0) if line else (0, 0)
    complaints = [
        f"{view.name}: {report.severity}: {report.summary} {report.details or ''}".strip()
        for view in state.views
        for report in view.reports
    ]
    return Photograph(tuple(view.name for view in state.views), tuple(complaints), name, start * 1e-9, end * 1e-9)


def main(arguments: Sequence[str]) -> int:
    """The command; returns its exit status."""
    if len(arguments) not in (2, 3):
        print("usage: python -m documenting.photograph FILE.rrd PICTURE.png [SECONDS]", file=sys.stderr)
        return 2
    try:
        seen = photograph(arguments[0], arguments[1], float(arguments[2]) if len(arguments) == 3 else None)
    except (RigError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"{arguments[1]}: {len(seen.views)} views of {seen.start_s:g} to {seen.end_s:g} s")
    for complaint in seen.complaints:
        print(complaint)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
