"""The numbers in the diagnosis' source: module-level constants with the comment that gives their reason."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Final

#: The rooms of the diagnosis, in the order in which a recording goes through them.
ROOMS: Final = ("data", "floor", "hypotheses", "evidence", "search", "report")
_PACKAGE: Final = "estimators.gap"
_REASON: Final = "#:"


@dataclass(frozen=True)
class Number:
    """A constant.

    Attributes:
        module: dotted. name: of the constant. values: one, or those of a tuple. reason: of the comment above it.
    """

    module: str
    name: str
    values: tuple[float, ...]
    reason: str

    @property
    def room(self) -> str:
        """The room that it is of."""
        return self.module.split(".")[2]

    @property
    def text(self) -> str:
        """Its value or values."""
        return ", ".join(f"{value:g}" for value in self.values)

    def moved(self, factor: float) -> tuple[float, ...]:
        """The values times a factor: counts stay counts; of a share the odds are multiplied, so that it stays one."""
        return tuple(_moved(value, factor) for value in self.values)


def _moved(value: float, factor: float) -> float:
    if isinstance(value, int):
        return max(round(value * factor), 1) if value > 0 else round(value * factor)
    if 0.0 < value < 1.0:
        odds = factor * value / (1.0 - value)
        return odds / (1.0 + odds)
    return value * factor


def numbers() -> tuple[Number, ...]:
    """All of them, room by room; those that are made of others move with these, and are not listed."""
    return tuple(
        each for room in ROOMS for path in _files(room) for each in _of(path, f"{_PACKAGE}.{room}.{path.stem}")
    )


def _files(room: str) -> list[Path]:
    spec = find_spec(f"{_PACKAGE}.{room}")
    assert spec is not None
    assert spec.origin is not None
    return sorted(path for path in Path(spec.origin).parent.glob("*.py") if path.stem != "__init__")


def _of(path: Path, module: str) -> Iterator[Number]:
    source = path.read_text(encoding="utf-8")
    lines = source.splitlines()
    reason = ""
    for name, value, node in assigned(ast.parse(source)):
        above = _comment(lines, node.lineno - 1)
        reason = above or (reason if lines[node.lineno - 2].strip() else "")  # one comment may be of several
        if (values := literal(value)) is not None:
            yield Number(module, name, values, reason)


def assigned(tree: ast.Module) -> Iterator[tuple[str, ast.expr, ast.stmt]]:
    """The name, the value and the statement of each constant at the top of a module, one by one."""
    for node in tree.body:
        if isinstance(node, ast.AnnAssign) and node.value is not None:
            targets: list[ast.expr] = [node.target]
        elif isinstance(node, ast.Assign):
            targets = node.targets
        else:
            continue
        value = node.value
        assert value is not None
        for target in targets:
            if isinstance(target, ast.Name) and target.id.isupper():
                yield target.id, value, node
            elif isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
                pairs = zip(target.elts, value.elts, strict=True)
                yield from ((one.id, each, node) for one, each in pairs if isinstance(one, ast.Name))


def literal(value: ast.expr) -> tuple[float, ...] | None:
    """The numbers that an expression writes down; None where it is anything else."""
    try:
        found = ast.literal_eval(value)
    except ValueError:
        return None
    every = found if isinstance(found, tuple) else (found,)
    plain = every and all(isinstance(each, int | float) and not isinstance(each, bool) for each in every)
    return every if plain else None


def _comment(lines: list[str], first: int) -> str:
    """The comment above a line."""
    start = first
    while start > 0 and lines[start - 1].startswith(_REASON):
        start -= 1
    return " ".join(line.removeprefix(_REASON).strip() for line in lines[start:first])
