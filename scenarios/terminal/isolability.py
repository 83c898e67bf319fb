"""What a maneuver can show of the catalogue's effects, as tables for the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Final

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from estimators.design.isolability import SEEN, Isolability, Key
from scenarios.isolability import EffectsBound
from scenarios.terminal.tables import table

#: Effects that leave each other less than this are one line.
_SAME: Final = 1.0
#: So many pairs are listed, the most alike first.
_PAIRS: Final = 12


def isolability_report(found: EffectsBound) -> Group:
    """Effects that are seen, by classes that cannot be told apart, and what changes if every joint moves."""
    return Group(*_parts(found))


def classes(found: Isolability) -> list[list[int]]:
    """Seen effects in groups of which each leaves the first less than one standard deviation, the best seen first."""
    order = [int(place) for place in np.argsort(-found.seen) if found.visible[place]]
    groups: list[list[int]] = []
    for place in order:
        own = next((group for group in groups if found.pairs[group[0], place] < _SAME), None)
        if own is None:
            groups.append([place])
        else:
            own.append(place)
    return groups


def _parts(found: EffectsBound) -> Iterable[RenderableType]:
    here = found.here
    called = partial(names, own=found.names)
    groups = classes(here)
    yield Text(f"Of {len(here.effects)} effects of typical size {here.visible.sum()} are seen ({SEEN:g} σ or more)\n")
    rows = table("effect", "seen [σ]", "best explained by", "left [σ]", numbers=("seen [σ]", "left [σ]"))
    for group in groups:
        others = np.where(here.visible, here.apart[group[0]], np.inf)
        others[group] = np.inf
        nearest = int(np.argmin(others))
        told = bool(np.isfinite(others[nearest]))
        rows.add_row(
            called([here.effects[place] for place in group]),
            f"{here.seen[group[0]]:.3g}",
            called([here.effects[nearest]]) if told else "–",
            Text(f"{others[nearest]:.3g}", style="" if others[nearest] >= SEEN else "yellow") if told else "–",
        )
    yield rows
    hidden = [key for key, visible in zip(here.effects, here.visible, strict=True) if not visible]
    yield Text(f"\nEffects in one line cannot be told apart. Not seen: {called(hidden) or 'none'}.")
    for name, why in here.left_out.items():
        yield Text(f"Left out: {name.replace('_', ' ')}: {why}.")
    yield Text(f"{len(here.alike)} pairs of seen effects are not told apart ({SEEN:g} σ).")
    if found.moving is None:
        return
    locked = ", ".join(found.names.get(f"joint{number}", str(number)) for number in found.locked)
    yield Text(
        f"\nIf joints {locked} moved too (stops at random poses of all joints, in the same time):"
        f" {found.moving.visible.sum()} effects would be seen, {len(found.moving.alike)} pairs not told apart.",
        style="bold",
    )
    yield Text(f"Newly seen: {called(found.gained) or 'none'}.")
    parted = found.parted
    lines = [f"{called([one])} from {called([other])} ({sigmas:.3g} σ)" for one, other, sigmas in parted[:_PAIRS]]
    more = f"; and {len(parted) - _PAIRS} more" if len(parted) > _PAIRS else ""
    yield Text(f"Newly told apart: {'; '.join(lines) or 'none'}{more}.")


def names(keys: Sequence[Key], own: Mapping[str, str]) -> str:
    """Effects with their places, joints by the arm's ``own`` names: ``joint offset joint2, wrist_2; base rocking``."""
    places: dict[str, list[str]] = {}
    for effect, where in keys:
        places.setdefault(effect, []).append(own.get(where, where))
    return "; ".join(
        effect.replace("_", " ") + ("" if where in (["base"], ["supply"], ["mount"]) else f" {', '.join(where)}")
        for effect, where in places.items()
    )
