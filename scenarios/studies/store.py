"""A study on disk: settings, trials as they come, and the table that they make.

    STUDY/study.json        what is studied, of which version
    STUDY/trials/00007-9f2c...parquet   one file a trial while it runs, with its hash in its name
    STUDY/table.parquet     all of them, in the order of their numbers, once they are all there
    STUDY/tables.json       the hashes of that and all other tables

All are written whole or not at all. What is damaged later is found when it is read, and made again by the same command.
A study that was ended in the middle goes on where it was: only trials without a file are made. As a trial depends on
the settings and its number alone, the table is the same to the byte.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

from rig.documents import read_json
from rig.errors import RigError, nearest, shown
from rig.files import atomic_path, file_hash, made_folder, own_folder, sync_folder, write_text
from rig.progress import Progress, unheard
from scenarios.studies.table_files import opened_table, read_table, write_table
from scenarios.version import package_version
from scenarios.workers import Workers

Settings = TypeVar("Settings")
#: What one trial of a study gives, by its settings and its number.
Trial = Callable[[Settings, int], pa.Table]

FORMAT: Final = "rig-study/1"
DOCUMENT: Final = "study.json"
TABLE: Final = "table.parquet"
SUMMARY: Final = "summary.parquet"
HASHES: Final = "tables.json"
_TRIALS: Final = "trials"
_DIGITS: Final = 32  # of a trial's hash
_KEYS: Final = {"format": str, "kind": str, "version": str, "settings": dict, "sha256": str}


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
            if is_study(path):
                study._check_same(any_version)
                return study
            if not path.is_dir() or any(path.iterdir()):
                raise RigError(f"{path}: found something that is no study, expected a new or empty folder")
        document = {"format": FORMAT, "kind": kind, "version": package_version(), "settings": plain}
        document["sha256"] = _digest(document)
        with made_folder(path):
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
        """Whether the table is there, as it was written."""
        return self.holds(TABLE)

    def holds(self, *names: str) -> bool:
        """Whether some tables are there, as they were written."""
        hashes = self._hashes()
        files = [(self.path / name, hashes.get(name)) for name in names]
        return all(file.is_file() and file_hash(file) == digest for file, digest in files)

    def table(self, name: str) -> pa.Table:
        """A table of the study.

        Raises:
            RigError: it is missing, or is not what was written.
        """
        return read_table(self.path / name, self._hashes().get(name, ""))

    def finished(self) -> dict[int, Path]:
        """The trials whose files are there and whole, by their numbers."""
        found = {}
        for file in (self.path / _TRIALS).glob("[0-9]*-*.parquet"):
            number, _, digest = file.stem.partition("-")
            if number.isdecimal() and not file.is_symlink() and file_hash(file).startswith(digest):
                found[int(number)] = file
        return found

    def fill(
        self,
        trial: Trial[Settings],
        settings: Settings,
        count: int,
        workers: Workers,
        progress: Progress = unheard,
    ) -> pa.Table:
        """Make the trials that are missing or damaged, and the table of all.

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

        def made() -> str:
            """The hash of the table: what is missing is made, and all are merged."""
            own_folder(self.path / _TRIALS)
            finished = self.finished()
            progress(len(finished) / count)
            missing = sorted({*range(count)} - set(finished))
            for place, table in workers.completed(partial(trial, settings), missing):
                finished[missing[place]] = self._keep(missing[place], table)
                progress(len(finished) / count)
            return self._merge([finished[number] for number in range(count)])

        with self._alone(), self._withdrawn_if_empty():
            if not self.done:
                before = self._hashes().get(TABLE)
                self._rescue(count)
                if made() != before and before is not None:  # the damage was in what was rescued
                    shutil.rmtree(self.path / _TRIALS)
                    made()
            if not (self.path / _TRIALS).is_symlink():
                shutil.rmtree(self.path / _TRIALS, ignore_errors=True)
        return self.table(TABLE)

    def write(self, name: str, table: pa.Table) -> None:
        """Keep a table beside the study's own, whole or not at all."""
        self._note(name, write_table(self.path / name, table))

    def _keep(self, number: int, table: pa.Table) -> Path:
        """Write a trial; its file's name says what must be in it."""
        fresh = self.path / _TRIALS / f"{number:05d}.parquet"
        kept = fresh.with_name(f"{number:05d}-{write_table(fresh, table)[:_DIGITS]}.parquet")
        fresh.replace(kept)
        sync_folder(kept.parent)
        return kept

    def _merge(self, files: list[Path]) -> str:
        """One file out of many, trial by trial: the memory is that of one."""
        schema = pq.read_schema(pa.BufferReader(files[0].read_bytes()))
        with atomic_path(self.path / TABLE) as temporary:
            with (
                temporary.open("wb") as sink,
                pq.ParquetWriter(sink, schema, compression="zstd", write_page_checksum=True) as writer,
            ):
                for file in files:
                    writer.write_table(read_table(file))
            digest = file_hash(temporary)
        self._note(TABLE, digest)
        return digest

    def _rescue(self, count: int) -> None:
        """Keep those trials of a damaged table that are sound: each is a row group, whose pages have checksums.

        What a damaged end of the file makes of them is found out by the hash of the whole, once it is made again.
        """
        table = self.path / TABLE
        if not table.is_file():
            return
        own_folder(self.path / _TRIALS)
        with suppress(RigError), opened_table(table) as file:
            if file.num_row_groups == count:
                for number in range(count):
                    with suppress(pa.ArrowException, OSError, ValueError):
                        self._keep(number, file.read_row_group(number))
        table.unlink()

    def _hashes(self) -> dict[str, str]:
        """File -> SHA-256 of what was written; none where that is missing or damaged."""
        try:
            content = read_json(self.path / HASHES, "the hashes of a study's tables")
        except RigError:
            return {}
        return content if isinstance(content, dict) else {}

    def _note(self, name: str, digest: str) -> None:
        hashes = {**self._hashes(), name: digest}
        write_text(self.path / HASHES, json.dumps(hashes, indent=1, sort_keys=True) + "\n")

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
            if {file.name for file in self.path.iterdir()} <= {DOCUMENT, _TRIALS, HASHES} and not self.finished():
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
    if not is_study(path):
        raise RigError(f"{path}: holds no {DOCUMENT}, expected the folder of a study")
    content = read_json(file, "a study")
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        found = content.get("format") if isinstance(content, dict) else content
        raise RigError(f"{file}: format: found {shown(found)}, expected {FORMAT!r}")
    for key, value in content.items():
        if key not in _KEYS:
            raise RigError(f"{file}: unknown key {shown(key)}, expected {', '.join(_KEYS)}{nearest(key, _KEYS)}")
        if not isinstance(value, _KEYS[key]):
            raise RigError(f"{file}: {key}: found {shown(value)}, expected a {_KEYS[key].__name__}")
    for key in ("kind", "version", "settings"):
        if key not in content:
            raise RigError(f"{file}: {key} is missing, expected the document of a study")
    stated = content.pop("sha256", None)
    if stated is not None and stated != _digest(content):
        raise RigError(f"{file}: is damaged or was changed (another SHA-256): expected a study as it was begun")
    return content


def _digest(document: Mapping[str, Any]) -> str:
    """SHA-256 of a document's canonical JSON."""
    return hashlib.sha256(json.dumps(document, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
