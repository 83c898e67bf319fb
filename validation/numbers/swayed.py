"""The diagnosis with one of its numbers moved: its modules are loaded once more, that number written otherwise."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from types import CodeType, ModuleType
from typing import Any, Final

from validation.numbers.listed import Number, assigned

_PACKAGE: Final = "estimators"


@contextmanager
def with_number(number: Number, values: Sequence[float]) -> Iterator[ModuleType]:
    """``estimators.gap`` with a number of these values; after it everything is as it was."""
    before = _taken_out()
    finder = _Finder(number, tuple(values))
    sys.meta_path.insert(0, finder)
    try:
        yield import_module(f"{_PACKAGE}.gap")
    finally:
        sys.meta_path.remove(finder)
        _taken_out()
        sys.modules.update(before)


def _taken_out() -> dict[str, ModuleType]:
    """The package's modules, which are no longer loaded then."""
    names = [name for name in sys.modules if name == _PACKAGE or name.startswith(f"{_PACKAGE}.")]
    return {name: sys.modules.pop(name) for name in names}


class _Finder(MetaPathFinder):
    """Finds the module of a number, to be loaded with other values."""

    def __init__(self, number: Number, values: tuple[float, ...]) -> None:
        self.number, self.values = number, values

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> ModuleSpec | None:
        """The module's own spec, with a loader that writes the number otherwise."""
        if fullname != self.number.module:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.origin is not None:
            spec.loader = _Loader(fullname, spec.origin, self.number.name, self.values)
        return spec


class _Loader(SourceFileLoader):
    """Loads a module from its source, never from what was compiled before."""

    def __init__(self, fullname: str, path: str, name: str, values: tuple[float, ...]) -> None:
        super().__init__(fullname, path)
        self.constant, self.values = name, values

    def get_code(self, fullname: str) -> CodeType:
        """The module's code with the number's values."""
        tree = ast.parse(self.get_data(self.path))
        for name, value, _ in assigned(tree):
            if name == self.constant:
                _write(value, self.values)
        return compile(ast.fix_missing_locations(tree), self.path, "exec")


def _write(value: ast.expr, values: tuple[float, ...]) -> None:
    """Numbers into an expression that writes as many down."""
    places = value.elts if isinstance(value, ast.Tuple) else [value]
    for place, number in zip(places, values, strict=True):
        if isinstance(place, ast.UnaryOp):  # a sign is an operation
            place.op, place.operand = ast.UAdd(), ast.Constant(number)
        else:
            assert isinstance(place, ast.Constant)
            place.value = number
