"""The page of each effect, with its picture, and their index, made from the registry when the site is built."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.util.display import status_iterator

from rig.effects import EFFECTS, Effect
from rig.errors import RigError
from scenarios.terminal.tables import effect_record

FOLDER = Path(__file__).parent / "reference" / "effects"


def page(effect: type[Effect], missing: str | None) -> str:
    """One effect: its docstring, its parameters, what it does to a sweep, or why that is not drawn."""
    record = effect_record(effect)
    lines = [
        f"# {record['name']}",
        "",
        # A letter that Markdown would take for a mark stands in formulas for itself.
        re.sub(r"([*_<>\[\]|])", r"\\\1", record["description"].replace("``", "`")),
        "",
        f"Acts on: {record['stage']}. Kind: {record['kind']}. Places: {', '.join(record['places'])}.",
        "",
        "| parameter | unit | numbers | typical | lowest | highest |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for parameter in record["parameters"]:
        cells = (parameter[key] for key in ("name", "unit", "size", "typical", "lower", "upper"))
        lines.append(f"| {' | '.join('' if cell is None else str(cell) for cell in cells)} |")
    picture = f"![What {record['name']} of typical size does to a sweep]({record['name']}.png)"
    return "\n".join([*lines, "", missing or picture, ""])


def write(app: Sphinx) -> None:
    """Write what is missing or older than the sources that it is made from."""
    from scenarios.plots import save
    from scenarios.plots.effects import effect_change, effect_figure

    FOLDER.mkdir(parents=True, exist_ok=True)
    newest = max(path.stat().st_mtime for path in Path(inspect.getfile(Effect)).parent.glob("*.py"))
    for name in status_iterator(EFFECTS, "drawing effects... ", length=len(EFFECTS), verbosity=app.verbosity):
        picture, missing = FOLDER / f"{name}.png", None
        if not picture.exists() or picture.stat().st_mtime < newest:
            try:
                if app.config.nb_execution_mode == "off":
                    raise RigError("the site was built without running anything")
                save(effect_figure(effect_change(EFFECTS[name], None)), picture)
            except RigError as error:  # a sweep with joint angles does not show every effect
                missing = f"No picture: {error}."
        _write(FOLDER / f"{name}.md", page(EFFECTS[name], missing))


def _write(path: Path, text: str) -> None:
    """Write a text only where it is new, so that Sphinx reads again only what has changed."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("builder-inited", write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
