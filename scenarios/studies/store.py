"""A study on disk: settings, trials as they come, and the table that they make.

    STUDY/study.json        what is studied, of which version
    STUDY/trials/00007.parquet   one file a trial while it runs, written whole or not at all
    STUDY/table.parquet     all of them, in the order of their numbers, once they are all there

A study that was ended in the middle goes on where it was: only trials without a file are made. As a trial depends on
the settings and its number alone, the table is the same to the byte.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from rig.errors import RigError, shown
from rig.files import atomic_path, write_text
from scenarios.studies.executor import Settings, Trial, Workers, package_version

FORMAT: Final = "rig-study/1"
DOCUMENT: Final = "study.json"
TABLE: Final = "table.parquet"
SUMMARY: Final = "summary.parquet"
_TRIALS: Final = "trials"


@dataclass(frozen=True)
class StudyFolder:
    """A folder that holds one study.

    Attributes:
        path: of the folder.
        kind: "consistency", "subsets".
        settings: as plain values.
    """

    path: Path
    kind: str
    settings: Mapping[str, Any]

    @classmethod
    def begin(cls, path: Path, kind: str, settings: Any, any_version: bool = False) -> StudyFolder:
        """A new study, or the one that is there if it is of the same kind, settings and version.

        Args:
            path: of the folder, which is made.
            kind: of the study.
            settings: a dataclass of plain values.
            any_version: take a study by another version of the package too: its results are wanted, not more of them.

        Raises:
            RigError: something else is there, or the folder cannot be written.
        """
        plain = json.loads(json.dumps(asdict(settings)))
        study = cls(path, kind, plain)
        if path.exists():
            if not (path / DOCUMENT).is_file() and not _empty(path):
                raise RigError(f"{path}: found something that is no study, expected a new or empty folder")
            if (path / DOCUMENT).is_file():
                study._check_same(any_version)
                return study
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RigError(f"{path}: cannot be made: {error.strerror}") from error
        document = {"format": FORMAT, "kind": kind, "version": package_version(), "settings": plain}
        write_text(path / DOCUMENT, json.dumps(document, indent=1) + "\n")
        return study

    @classmethod
    def read(cls, path: Path) -> StudyFolder:
        """The study in a folder.

        Raises:
            RigError: there is none.
        """
        document = _document(path)
        return cls(path, document["kind"], document["settings"])

    @property
    def done(self) -> bool:
        """Whether the table is there."""
        return (self.path / TABLE).is_file()

    def finished(self) -> set[int]:
        """The trials whose files are there and whole."""
        found = set()
        for file in (self.path / _TRIALS).glob("[0-9]*.parquet"):
            # Renamed into place after it was written; but a machine that lost its power may leave an empty file.
            with suppress(pa.ArrowInvalid, OSError):
                pq.read_metadata(file)
                found.add(int(file.stem))
        return found

    def fill(
        self,
        trial: Trial[Settings, pa.Table],
        settings: Settings,
        count: int,
        workers: Workers,
        progress: Callable[[float], None] | None = None,
    ) -> pa.Table:
        """Make the trials that are missing, and the table of all.

        Args:
            trial: gives a table with the same columns for every number.
            settings: of the study.
            count: trials are 0 to count - 1.
            workers: where they are made.
            progress: called with the share done, 0 to 1.

        Raises:
            RigError: another process fills it, or as of ``Workers.completed``; where no trial was made before, the
                study is taken back.
        """
        with self._alone(), self._withdrawn_if_empty():
            if not self.done:
                finished = self.finished()
                done = len(finished)
                if progress is not None:
                    progress(done / count)
                (self.path / _TRIALS).mkdir(exist_ok=True)
                for number, table in workers.completed(trial, settings, sorted({*range(count)} - finished)):
                    with atomic_path(self._trial(number)) as temporary:
                        pq.write_table(table, temporary, compression="zstd")
                    done += 1
                    if progress is not None:
                        progress(done / count)
                self._merge(count)
            shutil.rmtree(self.path / _TRIALS, ignore_errors=True)
        return pq.read_table(self.path / TABLE)

    def write(self, name: str, table: pa.Table) -> None:
        """Keep a table beside the study's own, whole or not at all."""
        with atomic_path(self.path / name) as temporary:
            pq.write_table(table, temporary, compression="zstd")

    def _trial(self, number: int) -> Path:
        return self.path / _TRIALS / f"{number:05d}.parquet"

    def _merge(self, count: int) -> None:
        """One file out of many, trial by trial: the memory is that of one."""
        schema = pq.read_schema(self._trial(0))
        with (
            atomic_path(self.path / TABLE) as temporary,
            pq.ParquetWriter(temporary, schema, compression="zstd") as writer,
        ):
            for number in range(count):
                writer.write_table(pq.read_table(self._trial(number)))

    def _check_same(self, any_version: bool) -> None:
        document = _document(self.path)
        if document["kind"] != self.kind:
            raise RigError(f"{self.path}: found a {document['kind']} study, expected {self.kind} or a new folder")
        for name, value in self.settings.items():
            if (other := document["settings"].get(name)) != value:
                raise RigError(
                    f"{self.path}: found a study with {name} {shown(other)}, expected {shown(value)} as asked for, or"
                    " a new folder"
                )
        if not any_version and document["version"] != package_version():
            raise RigError(
                f"{self.path}: found a study by version {document['version']}, expected {package_version()} to go on"
                " with it, or a new folder"
            )

    @contextmanager
    def _withdrawn_if_empty(self) -> Iterator[None]:
        """A study that ends before its first trial leaves nothing: no other would be let into the folder."""
        try:
            yield
        except BaseException:
            if {file.name for file in self.path.iterdir()} <= {DOCUMENT, _TRIALS} and not self.finished():
                shutil.rmtree(self.path)
            raise

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """No second process fills the same study; the lock goes with its process, however that ends."""
        try:
            import fcntl
        except ImportError:  # no such locks on this system
            yield
            return
        with open(self.path / DOCUMENT, "rb") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise RigError(f"{self.path}: another process is running this study") from error
            yield


def is_study(path: Path) -> bool:
    """Whether a folder holds a study."""
    return (path / DOCUMENT).is_file()


def _document(path: Path) -> dict[str, Any]:
    file = path / DOCUMENT
    if not file.is_file():
        raise RigError(f"{path}: holds no {DOCUMENT}, expected the folder of a study")
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:
        raise RigError(f"{file}: not JSON: {error}") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        found = content.get("format") if isinstance(content, dict) else content
        raise RigError(f"{file}: format: found {shown(found)}, expected {FORMAT!r}")
    return content


def _empty(path: Path) -> bool:
    return path.is_dir() and not any(path.iterdir())
