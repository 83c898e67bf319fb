"""Which version of the package this is, and of what sources: what was made by another is not mixed with its own."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from rig.files import file_hash


def package_version() -> str:
    """The version of this package; "unknown" where it runs from its sources without being installed."""
    try:
        return version("torusrig")
    except PackageNotFoundError:
        return "unknown"


@cache
def sources_hash() -> str:
    """SHA-256 of all that a diagnosis is made of: the sources of ``rig`` and ``estimators``."""
    import estimators
    import rig

    digest = hashlib.sha256()
    for package in (rig, estimators):
        root = Path(str(package.__file__)).parent
        for path in sorted(root.rglob("*.py")):
            digest.update(f"{package.__name__}/{path.relative_to(root).as_posix()}\n".encode())
            digest.update(bytes.fromhex(file_hash(path)))
    return digest.hexdigest()
