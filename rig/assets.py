"""Where the models lie: inside the installed package, or in a checkout."""

from __future__ import annotations

from pathlib import Path

from rig.errors import RigError

_INSTALLED = Path(__file__).parent / "_models"
_CHECKOUT = Path(__file__).parents[1] / "models"


def models_root() -> Path:
    """The folder of the models: the installed copy first, then the checkout's.

    Raises:
        RigError: neither is there.
    """
    for folder in (_INSTALLED, _CHECKOUT):
        if (folder / "a465" / "a465.xml").is_file():
            return folder
    raise RigError(f"the models are missing: looked in {_INSTALLED} and {_CHECKOUT}; install the package again")


def model_path(name: str) -> Path:
    """The path of a model file, such as ``"a465/scene.xml"``.

    Raises:
        RigError: there is no such file.
    """
    path = models_root() / name
    if not path.is_file():
        raise RigError(f"{path}: no such model file")
    return path
