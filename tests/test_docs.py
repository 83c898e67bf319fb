"""The documentation's commands and addresses exist, the examples run; `make docs` runs tutorials and checks links."""

from __future__ import annotations

import importlib
import re
import runpy
import shlex
from pathlib import Path

import click
import pytest

from scenarios.cli._app import cli

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    page for page in (*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")) if not {"_build", "effects"} & set(page.parts)
)
#: A command of ours at the start of a line of a code block, or behind a pipe, up to the next one.
CALL = re.compile(r"(?:^[$!]? ?|[|&] )(rig [a-z][^|&>\n]*)", re.MULTILINE)


def calls() -> list[tuple[str, str]]:
    """Page and command line, each once."""
    found = []
    for page in PAGES:
        for block in re.findall(r"^```[^\n]*\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL):
            lines = [line.partition("#")[0].rstrip() for line in block.splitlines()]
            commands = "\n".join(line for line in lines if "  " not in line.strip())  # others are summaries
            found += [(page.name, call.strip()) for call in CALL.findall(commands)]
    return list(dict.fromkeys(found))


def parse(command: click.Command, arguments: list[str], parent: click.Context | None, name: str) -> None:
    """Read the options as click would, all the way down to the command, and run nothing."""
    context = command.make_context(name, arguments, parent)
    if isinstance(context.command, click.Group):
        rest = [*context._protected_args, *context.args]
        inner = context.command.get_command(context, rest[0])
        assert inner is not None, rest[0]
        parse(inner, rest[1:], context, rest[0])


def test_the_pages_name_commands() -> None:
    assert len(calls()) > 50


@pytest.mark.parametrize(("page", "call"), [pytest.param(*call, id=" ".join(call)) for call in calls()])
def test_a_command_of_a_page_is_understood(page: str, call: str) -> None:
    parse(cli, shlex.split(call)[1:], None, "rig")


def test_what_the_python_pages_show_is_there() -> None:
    for page in (ROOT / "docs" / "reference").glob("api-*.md"):
        for name in re.findall(r"automodule:: (\S+)", page.read_text(encoding="utf-8")):
            importlib.import_module(name)


@pytest.mark.parametrize("package", ["rig", "estimators", "scenarios"])
def test_help_says_what_each_name_of_a_package_is(package: str) -> None:
    module = importlib.import_module(package)
    assert sorted(dir(module)) == sorted(module.__all__)
    for name in module.__all__:
        assert getattr(module, name) is not None
        assert re.search(rf"\b{name}\b", module.__doc__ or ""), f"{package}.{name} is not in the package's docstring"


def test_what_the_contributing_page_changes_is_there() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    changed = []
    for block in re.findall(r"^```diff\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        for part in re.split(r"^--- ", block, flags=re.MULTILINE)[1:]:
            name, _, rest = part.partition("\n")
            kept = [line[1:] for line in rest.splitlines() if line[:1] in (" ", "-")]
            if name != "/dev/null":
                there = (ROOT / name.removeprefix("a/")).read_text(encoding="utf-8").splitlines()
                assert [line for line in kept if line not in there] == [], name
                changed.append(name)
    assert len(changed) >= 4


EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("[0-9]_*.py"))


def test_the_examples_are_numbered() -> None:
    assert [int(path.name[0]) for path in EXAMPLES] == list(range(1, len(EXAMPLES) + 1))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(path))
    assert capsys.readouterr().out.strip()
