"""The shape of the house: layers, lengths, what is never imported, what is declared."""

from __future__ import annotations

import ast
import importlib.metadata
import re
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# A later one may import an earlier one, never the reverse.
LAYERS = ("rig", "estimators", "scenarios", "documenting", "validation")
# Likewise, of estimators.gap.
ROOMS_OF_A_DIAGNOSIS = ("floor", "data", "hypotheses", "evidence", "search", "report")
CONSUMERS_OF_RESULTS = {"matplotlib", "rerun"}  # visualisation: scenarios only
UNSAFE_LOADERS = {"cloudpickle", "dill", "joblib", "marshal", "pickle", "shelve"}
MOST_LINES = 400


def sources(*folders: str) -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


@cache
def imports(path: Path) -> tuple[tuple[int, str], ...]:
    """Line and absolute dotted name of everything that the file imports, wherever in it the statement stands."""
    package = path.relative_to(ROOT).parent.parts
    found: list[tuple[int, str]] = []
    for node in statements(parsed(path)):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            anchor = package[: len(package) - node.level + 1] if node.level else ()
            found.append((node.lineno, ".".join((*anchor, *filter(None, [node.module])))))
    return tuple(found)


def statements(tree: ast.AST, typed: bool = True) -> Iterator[ast.AST]:
    """All statements, in function bodies too, where an import may hide a cycle; not ``typed``: but those under ``if
    TYPE_CHECKING``."""
    left = [tree]
    while left:
        for node in ast.iter_child_nodes(left.pop()):
            checking = isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
            if not isinstance(node, ast.expr) and (typed or not checking):
                yield node
                left.append(node)


def modules() -> dict[str, Path]:
    """Every module of ours by its dotted name."""
    dotted = {path: path.relative_to(ROOT).with_suffix("").parts for path in sources(*LAYERS)}
    return {".".join(parts[:-1] if parts[-1] == "__init__" else parts): path for path, parts in dotted.items()}


def test_no_module_imports_itself_in_a_circle() -> None:
    """``from package import name`` counts for the module of that name, or else for the package."""
    known = modules()
    imported: dict[str, set[str]] = {}
    for name, path in known.items():
        found: set[str] = set()
        for node in statements(parsed(path), typed=False):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                inner = {f"{node.module}.{alias.name}" for alias in node.names}
                found |= inner & known.keys() or {node.module}
        imported[name] = found & known.keys() - {name}
    try:
        tuple(TopologicalSorter(imported).static_order())
    except CycleError as error:
        pytest.fail(" -> ".join(reversed(error.args[1])))


def place(path: Path, line: int) -> str:
    return f"{path.relative_to(ROOT)}:{line}"


@pytest.mark.parametrize("layer", LAYERS)
def test_a_layer_imports_nothing_above_it(layer: str) -> None:
    above = {*LAYERS[LAYERS.index(layer) + 1 :], "benchmarks", "tests"}
    found = [
        f"{place(path, line)} imports {name}"
        for path in sources(layer)
        for line, name in imports(path)
        if name.split(".")[0] in above
    ]
    assert sources(layer), f"no source in {layer}: the test looks in the wrong place"
    assert not found, found


@pytest.mark.parametrize("room", ROOMS_OF_A_DIAGNOSIS)
def test_a_diagnosis_goes_one_way(room: str) -> None:
    later = {f"estimators.gap.{name}" for name in ROOMS_OF_A_DIAGNOSIS[ROOMS_OF_A_DIAGNOSIS.index(room) + 1 :]}
    own = sources(f"estimators/gap/{room}")
    found = [
        f"{place(path, line)} imports {name}"
        for path in own
        for line, name in imports(path)
        if ".".join(name.split(".")[:3]) in later | {"estimators.gap.diagnose"}
    ]
    assert len(own) > 1, f"no source in {room}: the test looks in the wrong place"
    assert not found, found


def test_models_hold_no_code() -> None:
    assert (ROOT / "models" / "a465" / "a465.xml").is_file()
    assert not sources("models")


def test_visualisation_is_the_scenarios_business() -> None:
    found = [
        f"{place(path, line)} imports {name}"
        for path in sources("rig", "estimators")
        for line, name in imports(path)
        if name.split(".")[0] in CONSUMERS_OF_RESULTS
    ]
    assert not found, found


def test_nothing_is_unpickled() -> None:
    found = []
    for path in sources(*LAYERS):
        found += [place(path, line) for line, name in imports(path) if name.split(".")[0] in UNSAFE_LOADERS]
        for node in ast.walk(parsed(path)):
            # The bare presence is enough: allow_pickle=False is the default of numpy.load.
            if isinstance(node, ast.keyword) and node.arg == "allow_pickle":
                found.append(place(path, node.value.lineno))
            if isinstance(node, ast.Attribute) and node.attr in {"read_pickle", "to_pickle"}:
                found.append(place(path, node.lineno))
    assert not found, found


def test_no_file_is_too_long_for_one_concept() -> None:
    lengths = {
        str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").splitlines())
        for path in sources(*LAYERS, "tests", "benchmarks", "examples")
    }
    assert not {name: lines for name, lines in lengths.items() if lines > MOST_LINES}


def normalised(name: str) -> str:
    """The form in which two spellings of one distribution's name are equal (PEP 503), without extras and versions."""
    stem = re.match(r"[A-Za-z0-9._-]+", name)
    assert stem, name
    return re.sub(r"[-_.]+", "-", stem.group()).lower()


def test_every_imported_distribution_is_declared() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    optional = [entry for extra in project["project"]["optional-dependencies"].values() for entry in extra]
    declared = {normalised(entry) for entry in project["project"]["dependencies"] + optional}
    declared |= {normalised(name) for entry in optional for name in re.findall(r"\[(.*?)]", entry)}  # dask[distributed]
    of_the_checkout = declared | {normalised(entry) for entry in project["dependency-groups"]["dev"]}
    distributions = importlib.metadata.packages_distributions()
    found = []
    for path in sources(*LAYERS):
        known = of_the_checkout if path.is_relative_to(ROOT / "documenting") else declared
        for line, name in imports(path):
            top = name.split(".")[0]
            if top in sys.stdlib_module_names or top in LAYERS:
                continue
            if not known & {normalised(owner) for owner in distributions.get(top, [top])}:
                found.append(f"{place(path, line)} imports {top}")
    assert not found, found
