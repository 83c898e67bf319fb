"""Which effects a maneuver can show, and which it can tell apart, before it is run.

To first order an effect changes the readings by its columns, at typical sizes. What a calibration takes up is lost;
what is left, in standard deviations of the noise, is how well the effect is seen. What is left of it beside another
effect, which explains as much of it as it can, is how well the two are told apart: the square root of the
noncentrality of the chi-square test between them. A pair that leaves nothing is not isolable (S. X. Ding, "Model-based
fault diagnosis techniques", 2008).
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from estimators.known_angle.model import SensorParameters
from rig.arrays import Array, Mask
from rig.channels import CHANNELS_OF, COLUMNS_OF
from rig.documents import plain
from rig.effects import EFFECTS, Effect, Kind
from rig.effects.parameters import Value
from rig.pipeline import Pipeline
from rig.progress import Progress
from rig.signals import Signals
from rig.threads import one_blas_thread

Key = tuple[str, str]

#: An effect that leaves so many standard deviations is seen, and two that differ by so many are told apart.
SEEN: Final = 5.0
#: Shapes that are searched, such as places of a magnet: so many are tried, evenly among them.
_SHAPES: Final = 4
#: Squared share of a column's length below which it depends on others: Gram matrices resolve no smaller ones.
_RANK: Final = 1e-10


@dataclass(frozen=True, eq=False)
class Isolability:
    """What a maneuver can show.

    Attributes:
        effects: (m,) effect and place.
        seen: (m,) standard deviations that an effect of typical size leaves beside the calibration.
        apart: (m, m) the same beside another effect as well: the truth in rows, the other in columns. The smaller of
            both ways is what tells a pair apart.
        left_out: effect -> why it is not among them.
    """

    effects: tuple[Key, ...]
    seen: Array
    apart: Array
    left_out: Mapping[str, str]

    @property
    def pairs(self) -> Array:
        """(m, m) symmetric: how far apart two effects are, the smaller of both ways; infinite on the diagonal."""
        both = np.minimum(self.apart, self.apart.T)
        np.fill_diagonal(both, np.inf)
        return np.asarray(both)

    @property
    def visible(self) -> Mask:
        """(m,) whether an effect is seen."""
        return self.seen >= SEEN

    @property
    def alike(self) -> list[tuple[Key, Key, float]]:
        """Pairs of effects that are both seen and not told apart, the most alike first."""
        found = [
            (self.effects[i], self.effects[j], float(self.pairs[i, j]))
            for i, j in itertools.combinations(np.flatnonzero(self.visible).tolist(), 2)
            if self.pairs[i, j] < SEEN
        ]
        return sorted(found, key=lambda pair: pair[2])

    def to_json(self) -> dict[str, Any]:
        """A JSON object; a whole column of the matrix is an effect that explains."""
        return {
            "effects": [
                {"effect": name, "where": where, "sigmas": plain(seen), "visible": bool(seen >= SEEN)}
                for (name, where), seen in zip(self.effects, self.seen, strict=True)
            ],
            "separation_sigmas": [[round(float(value), 3) for value in row] for row in self.apart],
            "alike": [{"pair": [list(one), list(other)], "sigmas": sigmas} for one, other, sigmas in self.alike],
            "seen_from": SEEN,
            "left_out": dict(self.left_out),
        }


def isolability(
    signals: Signals,
    pipeline: Pipeline,
    noise: Array,
    samples: float = 1.0,
    only: Sequence[Key] | None = None,
    progress: Progress | None = None,
) -> Isolability:
    """What a maneuver can show of the catalogue's effects on the mean.

    Args:
        signals: encoder angles of some of its samples. pipeline: the calibrated rig, without effects.
        noise: (6,) standard deviation of a reading [V]. samples: how many readings each of these stands for.
        only: effect and place of those that are wanted; None: all. progress: called with the share done.
    """
    base = pipeline.expected(signals, np.random.default_rng(0))
    if base.q_encoder is not None:
        base = base.knowing_links()
    weight = np.sqrt(samples) / noise[pipeline.columns]
    keys: list[Key] = []
    blocks: list[tuple[Array, int]] = []
    left_out: dict[str, str] = {}
    wanted = list(_contenders(base, pipeline, left_out))
    if only is not None:
        wanted = [(key, shapes) for key, shapes in wanted if key in set(only)]
    for place, (key, shapes) in enumerate(wanted):
        changes = [
            [_change(effect, base, pipeline)[:, pipeline.columns] * weight for effect in shape] for shape in shapes
        ]
        found = np.stack([np.ravel(change) for shape in changes for change in shape], axis=1)
        if np.isfinite(found).all():
            keys.append(key)
            blocks.append((found, len(shapes)))
        else:
            left_out[key[0]] = "it needs what the recording will not have"
        if progress is not None:
            progress((place + 1) / len(wanted))
    with one_blas_thread():
        seen, apart = _separated(_absorbed(base, pipeline, weight), blocks)
    return Isolability(tuple(keys), seen, apart, left_out)


def _contenders(base: Signals, pipeline: Pipeline, left_out: dict[str, str]) -> list[tuple[Key, list[list[Effect]]]]:
    """Effect and place, and for each of its shapes the effects with one strength at its typical size each."""
    found = []
    for name, effect in EFFECTS.items():
        if effect.kind is not Kind.MEAN:
            continue
        if effect.tone:
            left_out[name] = "a tone: its spectrum tells it, on any maneuver"
            continue
        if effect.of_log or effect.lacking(base):
            left_out[name] = f"it needs {effect.lacking(base) or 'logged poses'}"
            continue
        choices = effect.choices()
        for where in effect.places_on(base):
            names = _names(choices, where)
            if names is None or not _present(where, names, pipeline):
                continue
            shapes = [
                _at_typical(effect, {"where": where, **names, **span, **searched})
                for searched in _some(effect.searched(base))
                for span in effect.spanning()
            ]
            if shapes[0]:
                found.append(((name, where), shapes))
    return found


def _names(choices: Mapping[str, Sequence[str]], where: str) -> dict[str, str] | None:
    """The first name of each choice that is not the place itself."""
    named = {key: next((each for each in names if each != where), None) for key, names in choices.items()}
    return None if None in named.values() else {key: str(name) for key, name in named.items()}


def _present(where: str, names: Mapping[str, str], pipeline: Pipeline) -> bool:
    """Whether the channels of a place, and those that are named, are there."""
    sensors = set(pipeline.sensors)
    known = {channel: sensor for sensor, channels in CHANNELS_OF.items() for channel in channels}
    return all(
        known.get(each, each) in sensors for each in (where, *names.values()) if each in known or each in COLUMNS_OF
    )


def _some(shapes: Sequence[Mapping[str, Value]]) -> list[Mapping[str, Value]]:
    places = np.unique(np.linspace(0, len(shapes) - 1, min(len(shapes), _SHAPES)).round().astype(int))
    return [shapes[place] for place in places]


def _at_typical(effect: type[Effect], values: Mapping[str, object]) -> list[Effect]:
    """One effect for each number of its strengths, that one at its typical size and the others neutral."""
    strengths = [item for item in effect.parameters() if item.strength and not item.scatter]
    neutral: dict[str, object] = {
        item.name: item.neutral if item.size == 1 else (item.neutral,) * item.size
        for item in effect.parameters()
        if item.strength
    }
    found = []
    for item in strengths:
        for place in range(item.size):
            size = float(np.clip(item.neutral + item.typical, item.lower, item.upper))
            number = size if item.size == 1 else tuple(size if k == place else item.neutral for k in range(item.size))
            found.append(effect.from_mapping({**values, **neutral, item.name: number}))
    return found


def _change(effect: Effect, base: Signals, pipeline: Pipeline) -> Array:
    """(n, 6) what an effect changes [V]."""
    volts = replace(pipeline, effects=(effect,)).carried(base, np.random.default_rng(0)).volts
    return np.asarray(volts - base.volts)


def _absorbed(base: Signals, pipeline: Pipeline, weight: Array) -> Array:
    """(c n, p) whitened derivatives of the readings by the calibration's parameters."""
    x = np.hstack([base.R_base_tool.reshape(-1, 9), np.ones((len(base), 1))])
    parts = []
    place = 0
    for name, sensor in pipeline.sensors.items():
        field = pipeline.environment.field(name)
        jacobian = SensorParameters.of(sensor, field).jacobian("simultaneous")  # (3, 10, 14)
        part = np.zeros((len(base), len(weight), jacobian.shape[2]))
        for k in range(3):
            part[:, place + k] = weight[place + k] * (x @ jacobian[k])
        place += 3
        parts.append(part.reshape(-1, part.shape[2]))
    return np.hstack(parts)


def _separated(absorbed: Array, blocks: Sequence[tuple[Array, int]]) -> tuple[Array, Array]:
    """Standard deviations that each block leaves: alone, and beside each other one."""
    length = np.linalg.norm(absorbed, axis=0)
    basis, _ = np.linalg.qr(absorbed[:, length > 0.0] / length[length > 0.0])
    raw = np.hstack([block for block, _ in blocks])
    columns = raw - basis @ (basis.T @ raw)
    # What is but rounding of what was projected out is nothing.
    columns[:, np.linalg.norm(columns, axis=0) < 1e-7 * np.linalg.norm(raw, axis=0)] = 0.0
    gram = columns.T @ columns
    ends = np.cumsum([0] + [block.shape[1] for block, _ in blocks])
    places = [slice(first, last) for first, last in itertools.pairwise(ends.tolist())]
    shapes = np.array([count for _, count in blocks], dtype=float)

    def sigmas(diagonal: Array) -> Array:
        sums = np.array([diagonal[place].sum() for place in places])
        return np.asarray(np.sqrt(np.maximum(sums, 0.0) / shapes))

    seen = sigmas(gram.diagonal())
    apart = np.zeros((len(blocks), len(blocks)))
    for other, place in enumerate(places):
        size = np.sqrt(np.maximum(gram[place, place].diagonal(), 1e-300))
        values, vectors = np.linalg.eigh(gram[place, place] / np.outer(size, size))
        kept = values > _RANK
        along = (vectors[:, kept] / np.sqrt(values[kept])).T @ (gram[place] / size[:, None])
        apart[:, other] = sigmas(gram.diagonal() - np.square(along).sum(axis=0))
    return seen, apart
