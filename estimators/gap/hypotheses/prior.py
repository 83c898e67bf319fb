"""What is likely before the data: the one place where the prior probabilities of a diagnosis stand, with reasons.

All of it is proper, so that masses of explanations of any size can be compared. A laboratory that knows what its arm
is prone to changes the weights of effects with a file (``read_prior``).
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import factorial, log
from pathlib import Path
from typing import Final

import numpy as np

from rig.arrays import Array
from rig.documents import parse_toml, read_toml
from rig.effects import EFFECTS
from rig.errors import RigError, unknown_name

#: Probability that nothing beyond the floor is there; a recording is diagnosed because something may be.
NOTHING: Final = 0.35
#: The factor for each further cause: a fault is as a rule alone, and one in five has another beside it. One cause has
#: what these leave.
FURTHER: Final = 0.2
#: The same of things without a name, which are rarely alone: what nobody has thought of is told by one source along one
#: course, and acts through several.
FURTHER_UNKNOWN: Final = 0.35
#: Probability, whatever else there is, of something that the catalogue does not have. Factors of two hardly matter.
OTHER: Final = 0.1
#: Of that, the share that noise of single channels is, instead of an error of a joint, a field, a mount or a clock.
OTHER_NOISE: Final = 0.3
#: Of what else there is beside causes, the share that is another form of one of them than the catalogue's: as likely as
#: an error of something that none of them touches.
OTHER_FORM: Final = 0.5
#: A real joint, spring, magnet or filter is not quite of its catalogue's form: what that leaves, as a share of what it
#: does, is normal with this standard deviation, as far as it stays below what is visible. A tenth: an error of a first
#: harmonic has a second one, a spring stiffens, a field that is called uniform falls off.
FORM: Final = 0.1
#: Where no recording at rest was given, anything that looks like noise is the floor itself, with this probability.
FLOOR_UNSEEN: Final = 0.6
#: The floor is raised, then, by a factor whose logarithm has this standard deviation.
FLOOR_RAISED: Final = 1.0
#: With one, the probability that the floor is not quite what the poses at rest showed best.
FLOOR_MOVED: Final = 0.5
#: Of that, the share that a coloured floor goes on, slower than these can show.
FLOOR_SLOWER: Final = 0.5
#: The same for a floor that they show to be white. As likely as a bias that wanders, or coloured noise, as a cause.
FLOOR_WALKS: Final = 0.1
#: A joint that stands still has little to bend under: a tenth.
STILL: Final = 0.1
#: Strengths are normal about zero with a scale between the one that this recording just shows, a signal-to-noise of
#: this, and so many times the typical size; all scales of a geometric grid are alike. Beyond, each is as much less
#: likely as it is larger: typical sizes are guesses, and a normal number's tail would be certain that they hold.
VISIBLE: Final = 5.0
LARGEST: Final = 30.0
GRID: Final = 3.0
#: Of an effect with a strength for each axis of a sensor, the probability that one axis alone has it: the chip's warmth
#: is of all three, a bond or a part beside one of them is not.
ONE_AXIS: Final = 0.5
#: Of an effect with a waveform over the recording, the probability that this is a process of one memory, as its cosines
#: have it; else it is any slow course in time that a discrepancy may follow: a sine, a sag, a few jumps.
PROCESS: Final = 0.5
#: Signal-to-noise of a discrepancy before the data: these times two to the power 0..7.
DISCREPANCY_SNR: Final = 5.0
DISCREPANCY_STEPS: Final = 8
#: Lengths, as shares of the recording, of a discrepancy's course in time, and of a supply's that was not recorded.
LENGTHS: Final = (0.5, 0.15, 0.05, 0.015)


#: An effect, and the labels (effect and place) of the places at which it does the same.
Drawn = tuple[str, tuple[str, ...]]


@dataclass(frozen=True)
class Prior:
    """Probabilities of sets of catalogue effects.

    Attributes:
        places: for each effect the weight of each of its places (and names, as in a candidate's label) in this
            recording.
        weights: relative probability of each effect; one by default.
    """

    places: Mapping[str, Mapping[str, float]]
    weights: Mapping[str, float] = field(default_factory=dict)

    def weight(self, effect: str, label: str) -> float:
        """Of one place of an effect, beside its other places."""
        return self.places.get(effect, {}).get(label, 1.0)

    def log_single(self, drawn: Drawn) -> float:
        """log probability that a cause is this effect at one of these places."""
        effect, labels = drawn
        total = sum(self.weights.get(name, 1.0) for name in self.places)
        own = self.places[effect]
        weight = self.weights.get(effect, 1.0) / total * sum(own[label] for label in labels) / sum(own.values())
        return log(weight) if weight > 0.0 else -np.inf

    def log_set(self, members: Sequence[Drawn]) -> float:
        """log probability of a set; repeats at one place are drawn twice."""
        size = len(members)
        if size == 0:
            return log(NOTHING)
        remaining = (1.0 - NOTHING) * (1.0 - FURTHER) * FURTHER ** (size - 1)
        arrangements = log(factorial(size)) - sum(log(factorial(many)) for many in Counter(members).values())
        return log(remaining) + arrangements + sum(self.log_single(drawn) for drawn in members)


def scales(length: float, found: float = 0.0) -> tuple[Array, Array]:
    """(k,) scales of an effect's strengths, in typical sizes, and their log probabilities: up to the strength that was
    found, as those beyond have none of it.

    Args:
        length: whitened signal-to-noise that the effect has at its typical size, with the calibration projected out.
        found: the largest of its strengths, in typical sizes.
    """
    least = VISIBLE / max(length, 1e-12)
    expected = max(int(np.floor(log(LARGEST / least) / log(GRID))) + 1, 1)
    count = max(expected, int(np.ceil(log(max(found / least, 1.0)) / log(GRID))) + 1)
    beyond = np.maximum(np.arange(count) - expected + 1, 0)
    return np.asarray(least * GRID ** np.arange(count)), -beyond * log(GRID) - log(expected + 1.0 / (GRID - 1.0))


def read_prior(path: str | os.PathLike[str]) -> dict[str, float]:
    """The weights of a prior file: TOML with a table ``[effects]`` of relative weights, zero to leave one out.

    Raises:
        RigError: the file cannot be read, an effect is unknown, or a weight is not a number of zero or more.
    """
    where = Path(path)
    table = parse_toml(read_toml(where, "a prior"), str(where))
    if set(table) != {"effects"} or not isinstance(table["effects"], dict):
        raise RigError(f"{where}: found {', '.join(list(table)[:4]) or 'nothing'}, expected one table [effects]")
    weights: dict[str, float] = {}
    for name, value in table["effects"].items():
        if name not in EFFECTS:
            raise unknown_name(f"effect in {where}", name, EFFECTS)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < np.inf:
            raise RigError(f"{where}: effects.{name}: found {value!r:.40}, expected a weight of zero or more")
        weights[name] = float(value)
    if weights and not any(weights.get(name, 1.0) > 0.0 for name in EFFECTS):
        raise RigError(f"{where}: all weights are zero, expected at least one above it")
    return weights
