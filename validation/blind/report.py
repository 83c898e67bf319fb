"""The page on a scored set: protocol, tables, picture, and every failure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from rig.files import write_text
from validation.blind.picture import draw
from validation.blind.power import Power
from validation.blind.proper_tables import (
    effect_table,
    intervals_table,
    laboratory_table,
    missed_table,
    proper_table,
    quiet_floor_table,
    reliability_table,
    time_table,
)
from validation.blind.scoring import CaseScore, is_right
from validation.blind.strata import MECHANICS
from validation.blind.tables import (
    baseline_table,
    closure_table,
    contents_table,
    floor_name,
    floor_table,
    mechanics_table,
    quiet_table,
    said,
    strata_table,
    strength_table,
    withheld_table,
)
from validation.markdown import Table, list_of, page_of

_INTRODUCTION: Final = """\
# The blind check

How often `rig diagnose` is right, on recordings whose truth it cannot see. This page is made by `rig blind score`;
nothing on it is typed by hand.

## Protocol

1. `rig blind make` draws every case from a seed: calibration, base tilt, field, sweep, noise floor, and what is to be
   found. A recording and its locked-arm recording go into one folder, in random order under numbers that tell
   nothing. The truth goes into another folder with a secret salt; the folder of recordings holds only the SHA-256 of
   both, and of the recordings. The hash binds the maker, the salt keeps the solver from trying out truths. The seed
   is sealed too.
2. `rig blind solve` opens the folder of recordings alone, and notes the SHA-256 of all sources it is made of.
3. `rig blind score` checks all hashes, opens the seal, and judges. Which effect is withheld from a recording is the
   answer itself, so the solver cannot be told: the scorer runs the same diagnosis a second time on every recording
   with one cause, that cause's name taken out of the catalogue.

Maker and scorer share with the diagnosis only the rig: strengths, equivalents and the true gap are computed from
the true calibration and the true noise by other code. Recordings are simulated at five times the rate that is
kept, so that corners and delays between samples are there. A name is right if it is the truth's, or if it leaves
of the true change less than one standard deviation of the noise (a twin; nobody can tell it). It is confidently
wrong where the verdict is named or ambiguous and a cause is listed whose whole set holds no true name, no twin, no
effect that leaves less than 2.5 standard deviations, none that contains the truth (a random walk for a warm-up),
and none for what a mechanism does on the side (outliers, for readings that fall into the knock of a lash),
or where a cause is given .95 or more that holds none of these, whatever the verdict.

Four scores count probabilities. On the truth: the posterior probability of the hypotheses that are the truth, up to
declared equivalents and causes too weak to ask for (its mean is the fraction of the posterior on the truth, FIA);
where something is in no catalogue, or its name was withheld, that of "other", with the known causes beside it listed;
of another form of an effect its family and "other" are both right. Log score: minus the logarithm of that, which
counts as .005 at least, the probability below which no hypothesis is listed. Brier: the square of what is missing to
one. Calibration error: the mean distance between the probability of what was said (nothing, other, each cause) and
how often it was so, over ten bins. Means stand with their standard errors.

Intervals of proportions are Wilson's, 95 %. Signal-to-noise is ||M Z phi||/sigma: Z phi is what effects with the
parameters phi change in the readings, division by sigma is whitening by the floor, and M projects out what the
calibration takes up. Noise has no such change: its signal-to-noise is the square root of twice the Kullback-Leibler
divergence between the noise with it and without."""


def write_report(
    path: Path,
    scores: Sequence[CaseScore],
    order: Mapping[str, Any],
    solver: str,
    power: Power | None = None,
) -> None:
    """Write the page, and its picture beside it.

    Args:
        path: of the page, ``.md``; the picture has the same name with ``.png``.
        order: what the set was made by, from the sealed folder.
        solver: SHA-256 of the sources that answered.
    """
    picture = path.with_suffix(".png")
    draw(scores, picture)
    write_text(path, page(scores, order, solver, picture.name, power))


def page(
    scores: Sequence[CaseScore], order: Mapping[str, Any], solver: str, picture: str, power: Power | None = None
) -> str:
    """The page in Markdown."""
    command = (
        f"rig blind make DIR --seed {order['seed']} --cases {order['cases']} --mechanics {order['mechanics']} "
        f"--samples {order['samples']} --scenario {order['scenario']}"
    )
    tables = [
        proper_table(scores),
        reliability_table(scores),
        laboratory_table(scores),
        quiet_floor_table(scores),
        quiet_table(scores),
        strata_table(scores),
        strength_table(scores, "one"),
        strength_table(scores, "outside"),
        floor_table(scores, "one"),
        withheld_table(scores),
        mechanics_table(scores),
        closure_table(scores),
        intervals_table(scores),
        baseline_table(scores),
        effect_table(scores),
        missed_table(scores),
        time_table(scores),
    ]
    return page_of(
        (
            _INTRODUCTION,
            "## The set",
            f"Made by `{command}`; the diagnosis' sources have SHA-256 `{solver[:16]}`.",
            *contents_table(scores).blocks,
            "## Results",
            f"![Right and wrong by stratum and signal-to-noise]({picture})",
            *(block for table in tables if table.rows for block in table.blocks),
            *(() if power is None else _power(power)),
            *_failures(scores),
        )
    )


def _power(power: Power) -> Iterator[str]:
    study = power.study
    rows = tuple(
        (f"{strength:g}", str(found), f"{100 * ideal:.0f} %")
        for strength, found, ideal in zip(study.strengths, power.found, power.ideal, strict=True)
    )
    heading = f"Detection power: {study.effect} at {study.where}, white floor"
    yield from Table(heading, ("signal-to-noise", "diagnosis", "ideal test"), rows).blocks
    yield (
        f"The ideal test knows the effect's family (chi-square, {power.rank} degrees of freedom) and has a "
        f"false-alarm rate of {study.false_alarm:.1e} a candidate. To find half, the diagnosis needs "
        f"{power.loss_dB:+.1f} dB of signal-to-noise beside it."
    )


def _failures(scores: Sequence[CaseScore]) -> Iterator[str]:
    wrong = [score for score in scores if not is_right(score)]
    yield "## Failures"
    yield f"{len(wrong)} of {len(scores)} cases are not what their stratum asks for:"
    yield list_of(_line(score) for score in wrong)
    astray = [score for score in scores if score.withheld is not None and score.withheld[1].confidently_wrong]
    if astray:
        yield "With the truth's name withheld, confidently wrong:"
        yield list_of(_line(score, score.withheld[0]) for score in astray if score.withheld is not None)


def _line(score: CaseScore, answer: Mapping[str, Any] | None = None) -> str:
    truth = score.truth
    causes = [
        f"{cause.name} at {cause.where} ({cause.beyond:.0f})" + _meant(cause.name, cause.effect)
        for cause in truth.causes
        if cause.visible or len(truth.causes) == 1
    ]
    what = " and ".join(causes) or "nothing"
    stratum = "mechanics" if truth.stratum == MECHANICS else truth.stratum
    return f"{truth.case}, {stratum}, {floor_name(score)} floor: {what} -> {said(answer or score.answer)}"


def _meant(name: str, effect: str) -> str:
    return f", that is {effect}" if effect and effect != name else ""
