"""How to turn a sensor by hand: procedures as steps, what each can tell, and which turn it lacks.

Camps et al., Figure 3: one turn about each of three axes. Begun from level, the third of them turns gravity about
itself: an accelerometer sees two great circles only, on which the angle between two axes cannot be told.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from estimators.coverage.attitude_free_information import AttitudeFreeInformation, Parameters
from estimators.coverage.direction_names import direction_name
from rig.arrays import Array
from rig.errors import check_name

_AXES: Final = np.eye(3)
#: Directions that a turn is taken as.
_ON_A_TURN: Final = 24
#: A direction of a step is done when one was seen within this angle [deg]; a step is, when this share of it is.
NEAR_DEG: Final = 25.0
DONE: Final = 0.85


@dataclass(frozen=True, eq=False)
class Step:
    """One thing to do.

    Attributes:
        words: what to do.
        directions: (m, 3) which way up is in the sensor's frame while it is done.
    """

    words: str
    directions: Array

    def progress(self, seen: Array) -> float:
        """The share of the step's directions that are near one of (n, 3) seen ones."""
        if not len(seen):
            return 0.0
        nearest = (self.directions @ seen.T).max(axis=1)
        return float((nearest > np.cos(np.radians(NEAR_DEG))).mean())


@dataclass(frozen=True, eq=False)
class Procedure:
    """Steps one after another.

    Attributes:
        name, title: of it. steps: in order.
    """

    name: str
    title: str
    steps: tuple[Step, ...]

    def undetermined(self, parameters: Parameters = 9) -> tuple[str, ...]:
        """The parameters, of 6 or 9, that its directions of gravity leave open, however long it is done."""
        directions = np.concatenate([step.directions for step in self.steps])
        return AttitudeFreeInformation.of(directions, 1e-3, None, parameters).undetermined

    def lacking(self, parameters: Parameters = 9) -> str | None:
        """What of gravity's nine parameters cannot be told, and the turn that would tell; None where all can."""
        open_ones = self.undetermined(parameters)
        if not open_ones:
            return None
        words = f"{self.name} cannot tell {', '.join(open_ones)} of an accelerometer"
        for axis, up in product("zyx", "xyz"):
            if axis != up:
                turn = _turn(axis, up)
                if not Procedure(self.name, "", (*self.steps, turn)).undetermined(parameters):
                    return f"{words}: add {turn.words}"
        return f"{words}: add the steps of another procedure"


def _turn(axis: str, up: str) -> Step:
    """A full turn about an axis that begins with another one, or the same, up."""
    about, start = _AXES["xyz".index(axis)], _AXES["xyz".index(up)]
    angle = 2.0 * np.pi * np.arange(_ON_A_TURN) / _ON_A_TURN
    along = float(about @ start) * about
    across = start - along
    directions = along + np.outer(np.cos(angle), across) + np.outer(np.sin(angle), np.cross(about, across))
    begun = "" if up == "z" else f", beginning with {up} up"
    return Step(f"one slow turn about {axis}{begun}", directions)


def _hold(direction: Array) -> Step:
    return Step(f"hold it with {direction_name(direction)} up", direction[None])


def _neighbours(*counts: int) -> list[Array]:
    """Directions of a cube with so many axes in them: 1 faces, 2 edges, 3 corners."""
    found = [np.array(v, dtype=float) for v in product((1, 0, -1), repeat=3) if sum(map(abs, v)) in counts]
    found.sort(key=lambda v: (-v[2], v[0], v[1]))
    return [v / np.sqrt(v @ v) for v in found]


_LEVEL: Final = tuple(_turn(axis, "z") for axis in "xyz")

PROCEDURES: Final[dict[str, Procedure]] = {
    each.name: each
    for each in (
        Procedure("three-turns", "one turn about each axis from level (Camps et al., Figure 3)", _LEVEL),
        Procedure("four-turns", "the three turns, and one about z with x up", (*_LEVEL, _turn("z", "x"))),
        Procedure("faces", "each of the six faces up", tuple(map(_hold, _neighbours(1)))),
        Procedure("faces-and-edges", "the six faces and the twelve edges up", tuple(map(_hold, _neighbours(1, 2)))),
        Procedure("sphere", "faces, edges and corners up: 26 poses", tuple(map(_hold, _neighbours(1, 2, 3)))),
    )
}


def procedure(name: str) -> Procedure:
    """A procedure by its name.

    Raises:
        RigError: there is none of this name.
    """
    check_name("procedure", name, PROCEDURES)
    return PROCEDURES[name]


class Guide:
    """A procedure being done.

    Attributes:
        procedure: it. number: of the step at hand, from 0 on; as many as steps when all are done.
    """

    def __init__(self, chosen: Procedure) -> None:
        """Args: chosen: the procedure."""
        self.procedure = chosen
        self.number = 0

    def see(self, ups: Array) -> None:
        """All directions (n, 3) that were up so far, in the sensor's frame."""
        steps = self.procedure.steps
        while self.number < len(steps) and steps[self.number].progress(ups) >= DONE:
            self.number += 1

    def words(self, ups: Array) -> str:
        """What to do now."""
        steps = self.procedure.steps
        if self.number >= len(steps):
            return f"{self.procedure.name} is done"
        step = steps[self.number]
        share = f", {100.0 * step.progress(ups):.0f} % seen" if len(step.directions) > 1 else ""
        return f"step {self.number + 1} of {len(steps)}: {step.words}{share}"
