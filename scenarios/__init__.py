"""What a user runs: named scenarios, the command line, reports and pictures.

- ``names()``: the scenarios that come with the rig.
- ``load(name or file)``: a ``Scenario``; its ``simulate(seed)`` is a ``rig.Recording``, its ``truth`` (a ``Truth``)
  what made it.
- ``compare(truth, calibration)``: how far every parameter is off, in its own standard deviations.

The console command ``rig`` is ``scenarios.cli``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scenarios.comparison import compare
    from scenarios.loader import load, names
    from scenarios.scenario import Scenario, Truth

__all__ = ["Scenario", "Truth", "compare", "load", "names"]

_MODULES = {"compare": "comparison", "load": "loader", "names": "loader", "Scenario": "scenario", "Truth": "scenario"}


def __getattr__(name: str) -> Any:
    """Import on first use: MuJoCo and SciPy take a second that ``rig --help`` should not."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return list(__all__)
