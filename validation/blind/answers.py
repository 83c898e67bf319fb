"""The answers to a sealed set in a folder, one JSON file a case, with what made them and the hash of each."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rig.documents import read_json
from rig.errors import RigError
from rig.files import child, file_hash, made_folder, write_text
from scenarios.version import sources_hash

_SOLVER: Final = "solver.json"
_FORMAT: Final = "rig-blind-answers/1"


@dataclass(frozen=True)
class Answers:
    """A folder of answers.

    Attributes:
        folder: where they are.
        ending: of their names, after the case's.
    """

    folder: Path
    ending: str = ".diagnosis.json"

    def path(self, name: str) -> Path:
        """Where the answer to a case is.

        Raises:
            RigError: the case's name would lead out of the folder, or the file is a link.
        """
        return child(self.folder, f"{name}{self.ending}", str(self.folder))

    def begin(self) -> None:
        """Make the folder, and note which version of the diagnosis answers; refuse to mix two.

        Raises:
            RigError: the folder cannot be made or is a link, or holds answers of another version.
        """
        with made_folder(self.folder, linked=False):
            if not (self.folder / _SOLVER).exists():
                self._write({})
            elif self.solver() != sources_hash():
                raise RigError(
                    f"{self.folder}: holds answers of another version of the diagnosis: remove that folder to start"
                    " anew"
                )

    def missing(self, names: Iterable[str]) -> list[str]:
        """The cases without an answer, or with one that is not what was noted."""
        hashes = self._hashes()
        return [name for name in names if not self._is_sound(name, hashes)]

    def note(self, name: str) -> None:
        """The answer to a case is there now; for one process at a time."""
        self._write({**self._hashes(), name: file_hash(self.path(name))})

    def read(self, name: str) -> dict[str, Any]:
        """The answer to a case.

        Raises:
            RigError: it is missing, or not what was noted.
        """
        path = self.path(name)
        if not self._is_sound(name, self._hashes()):
            found = "is damaged or was changed" if path.exists() else "is missing"
            raise RigError(f"{path}: {found}: run rig blind solve again to make it")
        document = read_json(path, "an answer")
        if not isinstance(document, dict):
            raise RigError(f"{path}: found no JSON object, expected an answer")
        return document

    def solver(self) -> str:
        """SHA-256 of the sources that the answers were made by."""
        return str(self._document()["sources_sha256"])

    def _document(self) -> dict[str, Any]:
        path = self.folder / _SOLVER
        document = read_json(path, "the answers of rig blind solve")
        texts = isinstance(document, dict) and document.get("format") == _FORMAT
        if not texts or not isinstance(document.get("sources_sha256"), str):
            raise RigError(f"{path}: expected the format {_FORMAT!r}: remove the folder to start anew")
        return dict(document)

    def _hashes(self) -> dict[str, Any]:
        hashes = self._document().get("answers")
        return hashes if isinstance(hashes, dict) else {}

    def _is_sound(self, name: str, hashes: dict[str, Any]) -> bool:
        path = self.path(name)
        return path.is_file() and hashes.get(name) == file_hash(path)

    def _write(self, hashes: dict[str, Any]) -> None:
        document = {"format": _FORMAT, "sources_sha256": sources_hash(), "answers": hashes}
        write_text(self.folder / _SOLVER, json.dumps(document, indent=1) + "\n")
