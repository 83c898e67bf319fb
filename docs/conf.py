"""Configuration of the documentation site: ``make docs``. Nothing here reaches the network."""

from __future__ import annotations

import importlib.metadata
import os
import re
import sys
from pathlib import Path
from typing import Any

import click
from sphinx.application import Sphinx

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS))

# The tutorials run `rig` of this environment, in a kernel whose `!command` fails where the command does.
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
os.environ["IPYTHONDIR"] = str(DOCS / "_ipython")
os.environ["CHECKOUT"] = str(DOCS.parent)
os.environ["COLUMNS"] = "96"  # of what the commands print
os.environ["CI"] = "1"  # rerun reports no usage to its makers where CI is set
os.environ["PYDEVD_DISABLE_FILE_VALIDATION"] = "1"  # else the kernel's debugger warns of frozen modules

project = "torusrig"
author = "The torusrig authors"
copyright = author
release = importlib.metadata.version("torusrig")

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_click",
    "sphinx_copybutton",
    "sphinx_design",
    "_effects",
]
suppress_warnings = ["ref.python"]  # two packages have an Options each
exclude_patterns = ["_build", "_ipython"]

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
nb_execution_mode = "cache"
nb_execution_in_temp = True
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
viewcode_line_numbers = True

html_theme = "pydata_sphinx_theme"
html_title = "torusrig"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_context = {"default_mode": "auto"}
highlight_language = "text"
html_theme_options = {
    "navigation_with_keys": False,
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": ["sphinx-version"],
    "pygments_light_style": "tango",
}


def literal_examples(app: Sphinx, context: click.Context, lines: list[str]) -> None:
    """The example at a command's end is text as it stands, not markup; and tcp:PORT is no address of a page."""
    start = lines.index("| Example:") if "| Example:" in lines else len(lines)
    lines[:start] = [re.sub(r"\b([a-z]+):(?=[A-Z])", r"\1\\:", line) for line in lines[:start]]
    if start < len(lines):
        end = lines.index("", start)
        lines[start:end] = ["Example::", "", *(line.removeprefix("|") for line in lines[start + 1 : end])]


def plain_letters(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Docstrings are plain text: |h| is a magnitude and bool_ a name, neither is markup."""
    for number, line in enumerate(lines):
        if "``" not in line:
            lines[number] = re.sub(r"\||(?<=\w)_(?!\w)", r"\\\g<0>", line)


def links_back(app: Sphinx, page: str, template: str, context: dict[str, Any], doctree: object) -> None:
    """The links from the sources: viewcode takes one package for all names of a module, of which two may show some."""
    if not page.startswith("_modules/"):
        return
    known = {name for name, found in app.env.domains["py"].objects.items() if found.objtype != "module"}
    module = page.split("/")[1:]

    def right(found: re.Match[str]) -> str:
        *_, name = found[2].split(".")
        shown = [found[2], *(".".join([*module[:depth], name]) for depth in range(1, len(module)))]
        return f"{found[1]}{next((each for each in shown if each in known), found[2])}"

    context["body"] = re.sub(r'(class="viewcode-back" href="[^"#]*#)([\w.]+)', right, context.get("body", ""))


def setup(app: Sphinx) -> None:
    """Register with Sphinx."""
    app.connect("autodoc-process-docstring", plain_letters)
    app.connect("sphinx-click-process-description", literal_examples)
    app.connect("html-page-context", links_back)
