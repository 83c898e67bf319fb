"""Joint angles in, volts out: the arm, its maneuvers, the fields, the sensors and the recording of what they read.

- ``read_recording(path)``: a ``Recording``, in memory; its ``Metadata`` state gravity, field and rate.
- ``Arm``: ``Arm.a465()``, or ``Arm.from_file(path)`` of a URDF or MJCF, for ``estimators.calibrate(run, arm=..)``.
- ``EFFECTS``: what a model leaves out, one class each, by name.
- ``RigError``: what every refusal is, one line.

``rig.maneuver``, ``rig.environment``, ``rig.sensor`` and ``rig.acquisition`` are what a scenario is made of;
``rig.simulate`` makes a recording of them. Named scenarios are loaded by ``scenarios.load``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rig.arm import Arm
    from rig.effects import EFFECTS
    from rig.errors import RigError
    from rig.recording import Metadata, Recording, read_recording

__all__ = ["EFFECTS", "Arm", "Metadata", "Recording", "RigError", "read_recording"]

_MODULES = {
    "Arm": "arm",
    "EFFECTS": "effects",
    "Metadata": "recording",
    "Recording": "recording",
    "RigError": "errors",
    "read_recording": "recording",
}


def __getattr__(name: str) -> Any:
    """Import on first use: MuJoCo and SciPy take a second that ``rig --help`` should not."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return list(__all__)
