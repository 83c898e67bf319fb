"""The scenarios that come with the package: TOML files beside this module."""

from __future__ import annotations

import tomllib
from pathlib import Path

_FOLDER = Path(__file__).parent


def names() -> tuple[str, ...]:
    """The names of the scenarios, sorted."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.toml")))


def built_in(name: str) -> Path:
    """The file of a scenario that comes with the package."""
    return _FOLDER / f"{name}.toml"


def titles() -> dict[str, str]:
    """The scenarios' one-line titles by name, without building a rig."""
    return {name: tomllib.loads(built_in(name).read_text(encoding="utf-8")).get("title", "") for name in names()}
