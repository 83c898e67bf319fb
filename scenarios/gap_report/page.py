"""The page of a diagnosis: one HTML file that needs nothing else, neither scripts nor the network."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from estimators.gap.diagnosis import Diagnosis
from estimators.gap.readable_units import two_digits
from estimators.gap.share_words import chance
from scenarios.gap_report import html, sections
from scenarios.gap_report.cause_section import which
from scenarios.gap_report.gap_residuals import GapResiduals
from scenarios.gap_report.own_names import in_own_names
from scenarios.gap_report.words import VERDICTS, consequences, headline, noise_words, share_words
from scenarios.version import package_version


def page(diagnosis: Diagnosis, residuals: GapResiduals | Sequence[GapResiduals], without: Sequence[str] = ()) -> str:
    """The page of a diagnosis.

    Args:
        residuals: of the same recording, from ``gap_residuals``; or of each of several.
        without: effects that were left out of the catalogue.
    """
    diagnosis = in_own_names(diagnosis)
    every = [residuals] if isinstance(residuals, GapResiduals) else list(residuals)
    title = f"{diagnosis.recording}: {VERDICTS[diagnosis.verdict].lower()}"
    parts = [
        _head(diagnosis, every, without),
        sections.fitted_rig(diagnosis, every[0]),
        sections.explanations(diagnosis),
        sections.next_step(diagnosis),
        sections.recordings(diagnosis),
        *(sections.where(diagnosis, each) for each in every),
        which(diagnosis),
        sections.how_far(diagnosis, every),
        sections.calibration(diagnosis, every[0].recording),
        sections.remainder(diagnosis),
        sections.untold(diagnosis),
        _foot(diagnosis),
    ]
    return html.document(title, parts)


def _head(diagnosis: Diagnosis, residuals: Sequence[GapResiduals], without: Sequence[str]) -> str:
    runs = [each.recording for each in residuals]
    facts = [
        f"{diagnosis.samples:,} samples",
        *(f"{run.duration_s:,.0f} s at {run.rate_Hz:.4g} Hz" for run in runs if len(runs) == 1),
        *([] if len(runs) == 1 else [f"{len(runs)} recordings"]),
        " and ".join(dict.fromkeys(sensor for run in runs for sensor in run.sensors)),
        f"noise floor: {diagnosis.floor}",
    ]
    if without:
        facts.append(f"without {', '.join(without)} in the catalogue")
    notes = "".join(f'<p class="warning">{escape(warning)}</p>' for warning in diagnosis.warnings)
    return (
        f'<p class="kicker">Sim-to-real gap of {escape(_what(diagnosis))}</p>\n'
        f'<h1>{escape(headline(diagnosis))}</h1>\n<p class="lead">{escape(consequences(diagnosis))}</p>\n'
        f'<p class="soft">{html.badge(diagnosis.verdict)}'
        f"{escape(' · '.join(facts))}</p>\n{notes}{_tiles(diagnosis)}"
    )


def _what(diagnosis: Diagnosis) -> str:
    several = "s" * (len(diagnosis.recordings) > 1)
    beside = "" if diagnosis.rig is None else f" beside the fitted rig {diagnosis.rig['name']}"
    return f"recording{several} {diagnosis.recording}{beside}"


def _tiles(diagnosis: Diagnosis) -> str:
    rows = {name: row for name, row in diagnosis.channels.items() if row.noise_floor > 0}
    tiles: list[tuple[str, str, str]] = []
    if rows and diagnosis.verdict == "no-gap":
        ratios = sorted(row.rms_before / row.noise_floor for row in rows.values())
        tiles.append(("Residual over floor", f"{ratios[0]:.2f} – {ratios[-1]:.2f}", "RMS of each channel"))
    elif rows:
        worst = max(rows, key=lambda name: rows[name].gap_before / rows[name].noise_floor)
        tiles.append(
            ("Largest gap", f"{two_digits(rows[worst].gap_before / rows[worst].noise_floor)} × floor", f"in {worst}")
        )
    tiles.append(_probability(diagnosis))
    if diagnosis.closed.value is not None:
        share, _, interval = share_words(diagnosis.closed).partition(" (")
        note = f"95 % interval: {interval.removesuffix(')')}" if interval else "by the likeliest explanation"
        tiles.append(("Squared gap closed", share, note))
    if diagnosis.remainder.verdict == "noise":
        left, _, condition = noise_words(diagnosis).partition(", ")
        tiles.append(("Left over", left, condition or "nothing seen above the floor"))
    else:
        tiles.append(("Left over", diagnosis.remainder.verdict, "more than noise"))
    return html.tiles(tiles)


def _probability(diagnosis: Diagnosis) -> tuple[str, str, str]:
    """The probability that the verdict rests on."""
    posterior = diagnosis.posterior
    if diagnosis.verdict == "no-gap":
        return "Probability of no gap", chance(posterior["nothing"]), "nothing beyond the floor"
    if diagnosis.verdict == "named":
        return "Probability", chance(diagnosis.hypotheses[0].probability), "of this explanation"
    if diagnosis.verdict == "ambiguous":
        sets = diagnosis.alternatives
        return "Probability", chance(sum(one.probability for one in sets)), f"of these {len(sets)} together"
    if diagnosis.verdict == "partly":
        least = min(cause.probability for cause in diagnosis.established)
        return "Probability", chance(least), "of what is established"
    if posterior["other"] >= 0.5:
        return "Probability", chance(posterior["other"]), "of something outside the catalogue"
    best = max((one.probability for one in diagnosis.hypotheses), default=0.0)
    return "Probability", chance(best), "of the likeliest explanation"


def _foot(diagnosis: Diagnosis) -> str:
    lines: Iterable[str] = (
        "<b>Floor</b>: the RMS of a channel's noise, as it is at rest, over a recording as long as this. "
        "<b>Gap</b>: the RMS of what the ideal rig with its best calibration misses, which the causes take or which is "
        "left beyond the floor. <b>Before</b>: that rig. <b>After</b>: the same rig with the causes in the "
        "simulator and the calibration refitted. <b>Closed</b>: 1 − (gap after / gap before)². <b>Probability</b>: "
        "after this recording, from 0 to 1, of all explanations that were weighed.",
        f"Diagnosed by torusrig {escape(package_version())} in {diagnosis.seconds:.1f} s. All numbers: "
        f"<code>{escape(diagnosis.name)}.diagnosis.json</code>."
        + (
            " To simulate a rig with the causes of the likeliest explanation: <code>rig sweep SCENARIO --with "
            f"{escape(diagnosis.name)}.diagnosis.json -o RUN.parquet</code>"
            if diagnosis.leading and diagnosis.verdict != "unknown"
            else ""
        ),
    )
    return "<footer>" + "".join(f"<p>{line}</p>" for line in lines) + "</footer>"
