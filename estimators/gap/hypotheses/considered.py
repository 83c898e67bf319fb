"""What is considered on a recording: the effects that it can show, their places, and how likely they are beforehand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from estimators.gap.data.whitened import WhitenedData
from estimators.gap.hypotheses.candidates import Candidate, all_candidates, still
from estimators.gap.hypotheses.prior import STILL, Prior
from estimators.gap.hypotheses.scan import Scanner
from estimators.gap.hypotheses.score import ABSORBED, Explained
from rig.channels import CHANNELS
from rig.effects import EFFECTS, Kind


def set_prior(
    candidates: Sequence[Candidate], more: dict[str, tuple[str, ...]], data: WhitenedData, weights: Mapping[str, float]
) -> Prior:
    """The prior over what a recording can show: each effect, then its places.

    Args:
        more: places of the effects that are noise or defects.
        weights: relative weights of effects.
    """
    places: dict[str, dict[str, float]] = {}
    for candidate in candidates:
        places.setdefault(candidate.effect.name, {})[candidate.label] = STILL if still(candidate, data) else 1.0
    for name, own in more.items():
        places[name] = {f"{name}@{where}": 1.0 for where in own}
    return Prior(places, weights)


def unseen_places(data: WhitenedData, without: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Places, on this recording, of the effects that are noise or defects."""
    there = {CHANNELS[column] for column in data.columns} | set(data.pipeline.sensors) | {"acquisition"}
    found = {}
    for effect in EFFECTS.values():
        own = tuple(where for where in effect.places if where in there)
        if own and effect.kind is not Kind.MEAN and effect.name not in without and not data.lacking(effect):
            found[effect.name] = own
    return found


def visible(data: WhitenedData, scanner: Scanner, without: Sequence[str]) -> tuple[list[Candidate], list[Candidate]]:
    """The candidates that this recording can show, and those that the calibration absorbs."""
    base = Explained(scanner.rough.data.absorbed, scanner.rough.data.whitened)
    shown: list[Candidate] = []
    absorbed: list[Candidate] = []
    for candidate in all_candidates(data, without):
        told = (
            candidate.effect.tone
            or candidate.effect.searched(data.base) != [{}]
            or scanner.visible(candidate, base) > ABSORBED
        )
        (shown if told else absorbed).append(candidate)
    return shown, absorbed
