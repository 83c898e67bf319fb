"""Both papers beside the rig: everything that the page is made of, and what comes out of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from rig.channels import SENSORS
from validation.paper import camps, camps_text, renk, renk_checks, renk_text
from validation.paper.dip import DipArgument, dip_argument, dip_words
from validation.paper.early_stop import EarlyStop, early_stops
from validation.paper.figures_text import OneDraw, one_draws
from validation.paper.published import spread_table
from validation.paper.renk_text import PublishedMisfit, field_chi_square, misfits
from validation.paper.rows import Basis, Row, Statement


@dataclass(frozen=True)
class Comparison:
    """Both papers, row by row.

    Attributes:
        rows: of the tables. statements: of the texts. misfits: the published fit errors taken apart.
        one_draws: what the text reads off Figures 3 and 4.
        dip: what the dip of Table 10 says. early_stops: whether fits that end early scatter as Table 7.
    """

    rows: tuple[Row, ...]
    statements: tuple[Statement, ...]
    misfits: tuple[PublishedMisfit, ...]
    one_draws: tuple[OneDraw, ...]
    dip: DipArgument
    early_stops: tuple[EarlyStop, ...]

    def table(self, paper: str, number: str) -> tuple[Row, ...]:
        """The rows of one table."""
        return tuple(row for row in self.rows if row.paper == paper and row.table == number)

    def tables(self, paper: str) -> tuple[str, ...]:
        """The numbers of a paper's tables, in their order."""
        return tuple(dict.fromkeys(row.table for row in self.rows if row.paper == paper))


#: What verdicts rest on, in the order of the page.
BASES: Final[tuple[Basis, ...]] = ("tested", "by construction", "arithmetic")


def compare() -> Comparison:
    """Make the comparison: a few seconds, and the same every time."""
    return Comparison(
        (*renk.rows(), *camps.rows()),
        (*renk_text.statements(), *renk_checks.statements(), *camps_text.statements()),
        tuple(row for sensor in SENSORS for row in misfits(sensor)),
        one_draws(),
        dip_argument(),
        early_stops(),
    )


def findings(comparison: Comparison) -> tuple[str, ...]:
    """What comes out, each as a sentence with the numbers that say so."""
    return tuple(_findings(comparison))


def _findings(comparison: Comparison) -> Iterator[str]:
    judged = [row for row in comparison.rows if row.word in ("agrees", "differs")]
    agreeing = [row for row in judged if row.word == "agrees"]
    counts = {basis: sum(row.basis == basis for row in agreeing) for basis in BASES}
    yield (
        f"Of {len(judged)} published rows that can be judged, {len(agreeing)} agree with the rig; the other"
        f" {len(judged) - len(agreeing)} differ for a reason that is stated. Of those that agree, {counts['tested']}"
        f" were tested: they could have come out otherwise; {counts['by construction']} are consistent by"
        " construction, for they went into the rig as its truth or its noise; and"
        f" {counts['arithmetic']} are arithmetic between published numbers."
    )
    yield dip_words(comparison.dip)
    for sensor in SENSORS:
        own = [row for row in comparison.misfits if row.sensor == sensor]
        errors = ", ".join(f"{1e3 * row.fit_error:.0f}" for row in own)
        noise = ", ".join(f"{1e3 * row.noise:.1f}" for row in own)
        shares = ", ".join(f"{row.share:.0%}" if row.share >= 0.01 else f"{row.share:.1%}" for row in own)
        times = sum(row.fit_error for row in own) / sum(row.noise for row in own)
        systematic = all(row.share < 0.5 for row in own)
        kind = "systematic" if systematic else "for the most part noise that was not there with the arm locked"
        yield (
            f"The {sensor}s' fit errors ({errors} mV) are {times:.1f} times their noise ({noise} mV). From the scatter"
            f" of the 25 subsets, {shares} of their squares are noise-like: the gap is {kind}."
        )
    for sensor in SENSORS:
        levels = [row.noise_like for row in comparison.misfits if row.sensor == sensor]
        chi_square = field_chi_square(sensor, levels)
        yield (
            f"The three separate {sensor} fits do not agree on one field direction: chi-square {chi_square:.0f} for 4"
            " degrees of freedom, at the noise that the subsets' scatter shows: the model misses something"
            " systematic, and the tables do not tell what."
        )
    yield early_stop_words(comparison.early_stops)
    slips = [row for row in comparison.rows if "radians" in row.why]
    if slips:
        names = " and ".join(row.quantity for row in slips)
        yield (
            f"Table {slips[0].table}'s standard deviations of {names} are given in degrees but lie far below what any"
            " estimator can reach; read as radians they fit: most likely a slip of the unit."
        )
    for statement in comparison.statements:
        if statement.finds.startswith("the root sum of squares") and not statement.holds:
            sensor = statement.about.partition(",")[0]
            yield f"The {sensor}s' simultaneous fit error, which looks smaller, is no gain: {statement.finds}."
    elsewhere = [row for row in comparison.rows if "does follow from" in row.why]
    lost = [row for row in comparison.rows if row.quantity == "angle between" and row.word == "differs"]
    if lost:
        other = elsewhere[0].why.rpartition("from ")[2] if elsewhere else ""
        yield (
            f"Table {lost[0].table}'s angles do not follow from its own fit's beta and gamma"
            + (f"; {len(elsewhere)} of {len(lost)} are those of {other}." if other else ".")
        )
    for statement in comparison.statements:
        if "one standard deviation" in statement.says and not statement.holds:
            yield f"Not all within one standard deviation ({statement.about}): {statement.finds}."
    for row in comparison.rows:
        if "holds test 1's column" in row.why:
            yield f"Camps et al., Table {row.table}, {row.item}: {row.why}."
    for statement in comparison.statements:
        if statement.paper == "camps" and not statement.holds and statement.about in _TOLD:
            yield f"Camps et al., {statement.about}: {statement.finds}."


#: Of what the text of Camps et al. says, what a reader of the tables should know at once.
_TOLD: Final = (
    "(5)",
    "(5) in their code",
    "section 4",
    "3.1, magnitude of the field",
    "3.1 and Figure 3, accelerometer",
)


def early_stop_words(found: tuple[EarlyStop, ...]) -> str:
    """Whether ending the search early explains Tables 3 and 7."""
    like = [one for one in found if one.like_table_7 or one.like_table_3]
    phi = f"{min(one.phi_deg for one in found):.2f} to {max(one.phi_deg for one in found):.2f}"
    beta = f"{min(one.beta2_deg for one in found):.2f} to {max(one.beta2_deg for one in found):.2f}"
    published = spread_table("7").std
    there = f"{published['phi_deg'].text}° and {published['beta2_deg'].text}°"
    text = (
        f"An optimiser that stops early {'may explain' if like else 'does not explain'} the accelerometers' odd"
        f" figures: in {len(found)} ways of ending quasi-Newton fits phi scatters by {phi}° and beta2 by {beta}°"
        f" (Table 7: {there}), separate fields lie up to {max(one.apart_deg for one in found):.2f}° apart (Table 3:"
        " 0.35°)"
    )
    return text + ("." if like else "; no way gives both of Table 7, none Table 3.")
