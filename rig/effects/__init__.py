"""The catalogue of unmodelled effects: one class each, registered by name.

Adding an effect is adding one class to the module of its theme; simulator, diagnosis, command line and documentation
read the registry.
"""

# Imported in this order to register: from the encoder to the converter.
from rig.effects import transmission  # noqa: F401, I001
from rig.effects import geometry, timing, log, motion  # noqa: F401
from rig.effects import field, sensor, drift, electronic, converter, noise  # noqa: F401
from rig.effects.base import EFFECTS, Effect, Kind, Stage, apply_stage, make_effect, register, without_nulls
from rig.effects.parameters import Parameter
from rig.effects.readings import ErrorsShown, Finding, Readings

__all__ = [
    "EFFECTS",
    "Effect",
    "ErrorsShown",
    "Finding",
    "Kind",
    "Parameter",
    "Readings",
    "Stage",
    "apply_stage",
    "make_effect",
    "register",
    "without_nulls",
]
