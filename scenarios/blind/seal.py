"""Sealing: a commitment in the open, the truth elsewhere.

The folder of cases holds, for every case, the SHA-256 of a secret 256-bit salt followed by the truth in canonical JSON.
The hash binds: the truth that is shown at scoring is the one that made the recordings. The salt hides: without it no
list of possible truths can be tried. Truth and salts lie in another folder, which solving never opens and the folder of
cases can be given away without.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from rig.errors import RigError
from rig.files import atomic_path, write_text

SET_FORMAT: Final = "rig-blind/1"
TRUTH_FORMAT: Final = "rig-blind-truth/1"
MANIFEST: Final = "manifest.json"
TRUTH: Final = "truth.json"


def new_salt() -> str:
    """256 random bits from the operating system, in hexadecimal."""
    return secrets.token_hex(32)


def commitment(salt: str, truth: Mapping[str, Any]) -> str:
    """SHA-256 of the salt and the truth, in hexadecimal."""
    text = json.dumps(truth, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(f"{salt}\n{text}".encode()).hexdigest()


def file_hash(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def sealed_folder(folder: Path) -> Path:
    """Where the truth of a folder of cases lies, unless it is put elsewhere."""
    return folder.with_name(f"{folder.name}.sealed")


def write_manifest(folder: Path, cases: list[dict[str, str]]) -> None:
    """The open half, once all cases are there."""
    document = {"format": SET_FORMAT, "cases": cases}
    write_text(folder / MANIFEST, json.dumps(document, indent=1) + "\n")


def write_truth(folder: Path, document: Mapping[str, Any]) -> None:
    """The sealed half, readable by its owner alone."""
    with atomic_path(folder / TRUTH) as temporary:
        temporary.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    os.chmod(folder / TRUTH, 0o600)


def read_manifest(folder: Path) -> list[dict[str, str]]:
    """The cases: ``name``, ``recording``, ``locked``, the hashes of both files, ``commitment``.

    Raises:
        RigError: no such set.
    """
    document = _read(folder / MANIFEST, SET_FORMAT, "a folder that rig blind make has written")
    cases: list[dict[str, str]] = document["cases"]
    return cases


def read_truth(folder: Path, cases: list[dict[str, str]]) -> dict[str, dict[str, Any]]:
    """The truths by case, each checked against its commitment.

    Raises:
        RigError: no truth there, or another one than was committed to.
    """
    document = _read(folder / TRUTH, TRUTH_FORMAT, "the sealed folder of the set")
    found = {}
    for case in cases:
        name = case["name"]
        if name not in document["cases"]:
            raise RigError(f"{folder / TRUTH}: has no {name}, expected the truth of this very set")
        entry = document["cases"][name]
        if commitment(entry["salt"], entry["truth"]) != case["commitment"]:
            raise RigError(f"{folder / TRUTH}: {name} is not what the set was sealed with")
        found[name] = entry["truth"]
    return found


def check_recording(folder: Path, case: Mapping[str, str]) -> None:
    """Refuse a recording that is not the one that was sealed.

    Raises:
        RigError: a file is missing or has changed.
    """
    for key in ("recording", "locked"):
        path = folder / case[key]
        if not path.is_file():
            raise RigError(f"{path}: no such file, expected a recording of the set")
        if file_hash(path) != case[f"{key}_sha256"]:
            raise RigError(f"{path}: has changed since it was sealed")


def _read(path: Path, form: str, expected: str) -> dict[str, Any]:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RigError(f"{path}: cannot be read ({error.strerror}), expected {expected}") from error
    except ValueError as error:
        raise RigError(f"{path}: not JSON, expected {expected}") from error
    if not isinstance(document, dict) or document.get("format") != form:
        raise RigError(f"{path}: expected the format {form!r}: {expected}")
    return document
