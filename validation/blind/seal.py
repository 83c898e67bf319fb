"""Sealing: a commitment in the open, the truth elsewhere.

The folder of cases holds, for every case, the SHA-256 of a secret 256-bit salt followed by the truth in canonical JSON.
The hash binds: the truth that is shown at scoring is the one that made the recordings. The salt hides: without it no
list of possible truths can be tried. Truth and salts lie in another folder, which solving never opens and the folder of
cases can be given away without.
"""

from __future__ import annotations

import hashlib
import json
import re
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from estimators._json import Reader
from rig.documents import read_json
from rig.errors import RigError, shown
from rig.files import child, file_hash, write_text

SET_FORMAT: Final = "rig-blind/1"
TRUTH_FORMAT: Final = "rig-blind-truth/1"
MANIFEST: Final = "manifest.json"
TRUTH: Final = "truth.json"
CHANGES: Final = "changes"
_FILES: Final = ("name", "recording")
#: Not in every case: a recording at rest, and the model of another arm. Empty where there is none.
_FURTHER: Final = ("locked", "arm")
_HASH: Final = re.compile("[0-9a-f]{64}")
_LARGEST: Final = 64 << 20  # of either half: some thousand cases [bytes]


def new_salt() -> str:
    """256 random bits from the operating system, in hexadecimal."""
    return secrets.token_hex(32)


def commitment(salt: str, truth: Mapping[str, Any]) -> str:
    """SHA-256 of the salt and the truth, in hexadecimal."""
    text = json.dumps(truth, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(f"{salt}\n{text}".encode()).hexdigest()


def sealed_folder(folder: Path) -> Path:
    """Where the truth of a folder of cases lies, unless it is put elsewhere."""
    return folder.with_name(f"{folder.name}.sealed")


def write_manifest(folder: Path, cases: list[dict[str, str]]) -> None:
    """The open half, once all cases are there."""
    document = {"format": SET_FORMAT, "cases": cases}
    write_text(folder / MANIFEST, json.dumps(document, indent=1) + "\n")


def write_truth(folder: Path, document: Mapping[str, Any]) -> None:
    """The sealed half, readable by its owner alone."""
    write_text(folder / TRUTH, json.dumps(document, indent=1, allow_nan=False) + "\n", mode=0o600)


def read_manifest(folder: Path) -> list[dict[str, str]]:
    """The cases: ``name``, ``recording``, ``locked``, ``arm``, the hashes of the files, ``commitment``.

    ``locked`` and ``arm`` are empty where there is no recording at rest, and where the arm is the rig's own.

    Raises:
        RigError: no such set, a name that is no plain name of a file in the folder, or no hash.
    """
    path = folder / MANIFEST
    content = Reader(_read(path, SET_FORMAT, "a folder that rig blind make has written"), str(path))
    cases = []
    for item in content.items("cases"):
        case = {key: item.text(key) for key in _FILES}
        case |= {key: item.text(key) if item.content.get(key, "") != "" else "" for key in _FURTHER}
        for key in _FURTHER:
            if not case[key] and item.content.get(f"{key}_sha256", "") != "":
                raise RigError(f"{item.where}.{key}: found no name beside a hash, expected that of a file")
        files = [key for key in (*_FILES, *_FURTHER) if case[key] or key in _FILES]
        for key in files:
            child(folder, case[key], f"{item.where}.{key}")
        hashes = [*(f"{key}_sha256" for key in files if key != "name"), "commitment"]
        case |= {key: item.text(key) for key in hashes}
        for key in hashes:
            if not _HASH.fullmatch(case[key]):
                raise RigError(f"{item.where}.{key}: found {shown(case[key])}, expected 64 hexadecimal digits")
        cases.append(case)
    names = [case["name"] for case in cases]
    if not names or len(set(names)) < len(names):
        raise RigError(f"{path}: expected at least one case, and each name once")
    return cases


def read_truth(folder: Path, cases: list[dict[str, str]]) -> dict[str, dict[str, Any]]:
    """The truths by case, each checked against its commitment.

    Raises:
        RigError: no truth there, or another one than was committed to.
    """
    path = folder / TRUTH
    inside = Reader(_read(path, TRUTH_FORMAT, "the sealed folder of the set"), str(path)).within("cases")
    found = {}
    for case in cases:
        name = case["name"]
        if name not in inside.content:
            raise RigError(f"{path}: has no {name}, expected the truth of this very set")
        entry = inside.within(name)
        truth = entry.within("truth").content
        if commitment(entry.text("salt"), truth) != case["commitment"] or truth.get("case") != name:
            raise RigError(f"{path}: {name} is not what the set was sealed with")
        found[name] = truth
    return found


def read_order(folder: Path) -> dict[str, Any]:
    """What a set was made by: seed, numbers, scenario.

    Raises:
        RigError: no truth there.
    """
    path = folder / TRUTH
    order = Reader(_read(path, TRUTH_FORMAT, "the sealed folder of the set"), str(path)).within("order")
    for key in ("seed", "cases", "mechanics", "samples"):
        order.whole(key)
    order.text("scenario")
    return order.content


def check_recording(folder: Path, case: Mapping[str, str]) -> None:
    """Refuse a recording that is not the one that was sealed.

    Raises:
        RigError: a file is missing or has changed.
    """
    for key in ("recording", *(key for key in _FURTHER if case.get(key))):
        path = child(folder, case[key], str(folder / MANIFEST))
        if not path.is_file():
            raise RigError(f"{path}: no such file, expected a recording of the set")
        if file_hash(path) != case[f"{key}_sha256"]:
            raise RigError(f"{path}: has changed since it was sealed")


def _read(path: Path, form: str, expected: str) -> dict[str, Any]:
    document = read_json(path, expected, _LARGEST)
    if not isinstance(document, dict) or document.get("format") != form:
        raise RigError(f"{path}: expected the format {form!r}: {expected}")
    return document
