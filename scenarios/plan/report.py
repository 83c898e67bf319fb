"""A plan as a table for the terminal and as a picture."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from rich.console import RenderableType, group
from rich.text import Text

from estimators.design.exchange import OPEN
from estimators.design.isolability import Isolability
from estimators.stillness.at_rest import SETTLE_S
from scenarios.colours import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY_BLUE, VERMILLION
from scenarios.parameter_names import shown_name
from scenarios.plan.plan import REFERENCE, Plan
from scenarios.plan.sweeps import SweepPlan
from scenarios.plots.style import new_figure, style
from scenarios.terminal.bound import names
from scenarios.terminal.tables import table

#: More causes than these are summed up.
_FEW: Final = 6
_COLOURS: Final = (BLUE, VERMILLION, GREEN, ORANGE, PURPLE, SKY_BLUE, BLACK)


@group()
def plan_report(plan: Plan) -> Iterable[RenderableType]:
    """What a plan is and what it promises."""
    found, maneuver = plan.found, plan.maneuver
    sweeps = isinstance(found, SweepPlan)
    readings = f"{found.samples_s * maneuver.rate_Hz:,.0f} readings"
    if isinstance(found, SweepPlan):
        rms, peak = found.acceleration
        yield Text(
            f"A sweep of {maneuver.duration_s:.1f} s, {found.values.shape[1] // 2} harmonics of every joint;"
            f" {readings}; the sensor accelerates by {rms:.3f} m/s² (rms; at most {peak:.3f})\n"
        )
    else:
        yield Text(
            f"{len(found.q)} poses of {found.hold_s:.2f} s, {found.move_s:.2f} s apart: {maneuver.duration_s:.1f} s;"
            f" {readings} at rest ({SETTLE_S:g} s beside each move left out)\n"
        )
    if plan.told is not None:
        yield from _told(plan.told, {} if plan.scenario.rig.arm is None else plan.scenario.rig.arm.place_names)
    moved = ("moved by acceleration",) if sweeps else ()
    columns = ("std", *moved, "over the reference's", f"most of it from {'tenth' if sweeps else 'pose'}")
    rows: list[tuple[str, ...]] = []
    for each in plan.parameters:
        for place, name in enumerate(each.names):
            told, ratio = each.std[place] < OPEN, each.ratio[place]
            rows.append(
                (
                    each.sensor,
                    shown_name(name),
                    _size(name, float(each.std[place])) if told else "cannot be told",
                    *([_size(name, float(each.moved[place])).split(" of ")[0] if told else "–"] if sweeps else []),
                    f"{ratio:.3f}" if np.isfinite(ratio) and told else "–",
                    f"{int(each.share[:, place].argmax()) + 1} ({each.share[:, place].max():.0%})" if told else "–",
                )
            )
    yield table("sensor", "parameter", *columns, numbers=columns, rows=rows)
    yield Text(f"\nThe reference is {REFERENCE}; the worst is {found.worst:.3f} of it.")
    if sweeps:
        yield Text(
            "An accelerometer feels its own acceleration along a sweep, and a calibration takes it for gravity: that"
            " error is counted beside the standard deviation. Poses with holds have none."
        )
    curve = ", ".join(f"{time:.0f} s: {value:.2f}" for time, value in plan.curve)
    same = "" if plan.told is None else f" with the same {'sweep' if sweeps else 'poses'}"
    yield Text(f"In other times{same} the worst would be: {curve}.")
    if plan.assumed:
        yield Text(f"Assumed, as the arm's file does not state them: {plan.assumed}.", style="yellow")
    if plan.slender:
        yield Text(
            "The arm's file has no geometry: contacts were looked for between capsules along the links.", style="yellow"
        )


def _told(found: Isolability, own: Mapping[str, str]) -> Iterable[RenderableType]:
    """How far apart the causes are."""
    if len(found.effects) > _FEW:
        yield Text(
            f"{found.visible.sum()} of {len(found.effects)} effects are seen, {len(found.alike)} pairs of them not told"
            " apart.\n"
        )
        return
    called = [names([key], own) for key in found.effects]
    rows = []
    for key, seen, row in zip(found.effects, found.seen, found.apart, strict=True):
        left = ["–" if key == other else f"{value:.3g}" for other, value in zip(found.effects, row, strict=True)]
        rows.append((names([key], own), f"{seen:.3g}", *left))
    yield table("cause", "seen [σ]", *called, numbers=("seen [σ]",), rows=rows)
    yield Text("What is left of each beside another [σ].\n")


def _size(name: str, std: float) -> str:
    if name.startswith("sensitivity"):
        return f"{100.0 * std:.4f} %"
    if name.startswith("offset"):
        return f"{100.0 * std:.4f} % of the full reading"
    return f"{np.degrees(std):.4f} deg"


def plan_figure(plan: Plan) -> Figure:
    """The joints against time, each parameter over the reference, and what a shorter time loses."""
    arm = plan.scenario.rig.arm
    assert arm is not None
    motion = plan.maneuver.trajectory()
    with style():
        figure = new_figure(12.6, 4.6)
        left, middle, right = figure.subplots(1, 3, width_ratios=[1.3, 1.1, 0.9])
        shown = arm.in_degrees(motion.q)
        for joint, name in enumerate(arm.joint_names):
            colour, line = _COLOURS[joint % len(_COLOURS)], "-" if joint < len(_COLOURS) else "--"
            left.plot(motion.t, shown[:, joint], line, linewidth=1.1, label=name, color=colour)
        left.set_xlabel("time [s]")
        left.set_ylabel("joint [deg]" if not any(arm.slides) else "joint [deg, m]")
        left.set_title("The maneuver")
        left.legend(fontsize=6.5, ncols=4, loc="upper center", bbox_to_anchor=(0.5, -0.14))
        labels = []
        for number, each in enumerate(plan.parameters):
            places = np.arange(len(each.names)) + 0.36 * (number - 0.5 * (len(plan.parameters) - 1))
            colour = (BLUE, VERMILLION)[number % 2]
            middle.plot(each.ratio, -places, "os"[number % 2], color=colour, markersize=4.5, label=each.sensor)
            labels = [shown_name(name) for name in each.names]
        middle.axvline(1.0, color=BLACK, linewidth=0.8)
        middle.set_yticks(-np.arange(len(labels)), labels)
        middle.set_xlim(0.0, 1.05 * max(1.0, *(float(np.nanmax(each.ratio)) for each in plan.parameters)))
        middle.set_xlabel("error over the paper's sweep's")
        middle.set_title("What it promises")
        middle.legend(fontsize=7, loc="lower left")
        right.plot(plan.curve[:, 0], plan.curve[:, 1], "o-", color=BLUE, markersize=4)
        right.axhline(1.0, color=GREY, linewidth=0.8)
        right.axvline(plan.maneuver.duration_s, color=GREY, linewidth=0.8, linestyle=":")
        right.set_ylim(bottom=0.0)
        right.set_xlabel("time of the whole maneuver [s]")
        right.set_ylabel("worst, over the paper's sweep")
        right.set_title("What shortening loses")
    return figure
