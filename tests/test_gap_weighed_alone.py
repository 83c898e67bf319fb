"""The set that is likeliest by itself is weighed beside what leads, once."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest

from estimators.gap.search.likeliest_alone import weigh_likeliest_alone

EARLY, LATER = (), ("steps",)


def hypothesis(key: str, log_mass: float, unknown: bool = False, steps: tuple[str, ...] = EARLY) -> SimpleNamespace:
    """Of a set, as far as it is looked at."""
    state = SimpleNamespace(steps=steps, name="noise", fitted=())
    terms = ("something",) if unknown else ()
    return SimpleNamespace(explanation=SimpleNamespace(key=key), state=state, terms=terms, log_mass=log_mass)


@dataclass
class Work:
    """What was weighed, where an unknown gains ten beside every set."""

    every: list[SimpleNamespace]
    moves: list[tuple[str, tuple[str, ...]]] = field(default_factory=list)

    @property
    def hypotheses(self) -> dict[int, SimpleNamespace]:
        return dict(enumerate(self.every))

    @property
    def leading(self) -> SimpleNamespace:
        return max(self.every, key=lambda one: one.log_mass)

    def moved(self, some: list[SimpleNamespace], state: SimpleNamespace) -> None:
        self.moves.append((some[0].explanation.key, state.steps))
        self.every.append(hypothesis(some[0].explanation.key, some[0].log_mass + 10.0, unknown=True, steps=state.steps))


@pytest.mark.parametrize(
    ("alone", "moves"),
    [
        ([("few", 0.0, EARLY), ("more", 5.0, LATER)], [("more", LATER)]),  # learned late, and likelier by itself
        ([("few", 0.0, EARLY), ("more", -5.0, LATER)], []),  # not likelier
        ([("few", 0.0, EARLY), ("few", 0.5, LATER)], []),  # hardly likelier than the set that leads
        ([("few", 0.0, EARLY), ("more", 5.0, LATER), ("most", 7.0, LATER)], [("most", LATER)]),
    ],
)
def test_what_is_likelier_by_itself_is_weighed_beside_what_leads(alone: list[Any], moves: list[Any]) -> None:
    work = Work([hypothesis(key, mass, steps=steps) for key, mass, steps in alone])
    work.every.append(hypothesis("few", 10.0, unknown=True))
    weigh_likeliest_alone(work)  # type: ignore[arg-type]
    assert work.moves == moves


def test_nothing_is_weighed_where_no_unknown_leads() -> None:
    work = Work([hypothesis("few", 0.0), hypothesis("more", 5.0, steps=LATER)])
    weigh_likeliest_alone(work)  # type: ignore[arg-type]
    assert work.moves == []
