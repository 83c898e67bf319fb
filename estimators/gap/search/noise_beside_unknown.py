"""Noise where something without a name leads: what was learned without that had to be as large as both."""

from __future__ import annotations

from estimators.gap.evidence.discrepancy import left_beside
from estimators.gap.evidence.laplace import Linear
from estimators.gap.evidence.states import NoiseState
from estimators.gap.search.hypothesis import Hypothesis
from estimators.gap.search.noises import Given
from estimators.gap.search.weighing import FAR, HARDLY, NEAR, Weighing


def weigh_noise_beside_unknown(work: Weighing) -> None:
    """The unknown under the noise that is likeliest without it, then under noise that is learned beside it.

    Where it is likelier there, causes are looked for under that noise.
    """
    for state, log_mass in _without_unknown(work):
        if (leading := _unknown(work, plain=True)) and _likely(work, state, log_mass, leading):
            _moved(work, [state], leading)
    leading = _unknown(work, plain=True) or _unknown(work, plain=False)
    while leading is not None:
        before, moved = leading, _moved(work, _learned(work, leading), leading)
        leading = _unknown(work, plain=False)
        if not moved and (leading is before or before.state.steps):
            break


def _unknown(work: Weighing, plain: bool) -> Hypothesis | None:
    """The likeliest hypothesis with an unknown, where that is likelier than none under its noise; else noise that was
    learned without it is right."""
    leading = next(iter(work.nameless(plain)), None)
    if leading is None:
        return None
    without = [one.log_mass for one in work.hypotheses.values() if one.state is leading.state and not one.terms]
    return leading if leading.log_mass > max(without, default=float("-inf")) else None


def _likely(work: Weighing, state: NoiseState, log_mass: float, leading: Hypothesis) -> bool:
    """Whether noise that was learned without an unknown may be there beside it: not where the unknown is what it was
    learned from. That is far likelier than the noise then, and leaves nothing for it.

    Args:
        log_mass: without one.
    """
    if log_mass > leading.log_mass - FAR:
        return True
    given, less = _left(work, leading)
    gained = work.noises.worth(state, given, leading.explanation, less) - _before(leading, less)
    return leading.log_mass + gained > work.best - FAR


def _left(work: Weighing, leading: Hypothesis) -> tuple[Given, Linear]:
    """What a hypothesis with a discrepancy leaves, under its state."""
    given = leading.state, work.scanner.stepped(leading.state.steps)
    return given, left_beside(leading.explanation.linear, leading.terms[0], work.discrepancies_under(*given))


def _before(leading: Hypothesis, less: Linear) -> float:
    """Log mass of its set, of what it leaves."""
    return less.averaged[0] + leading.explanation.log_prior + leading.state.log_weight


def _without_unknown(work: Weighing) -> list[tuple[NoiseState, float]]:
    """States of the noise without a named part under which no unknown was weighed, with their log mass without one."""
    plain, found = float("-inf"), dict[str, Hypothesis]()
    unknown = {each.state.name for each in work.hypotheses.values() if each.terms and not each.state.labels}
    for each in work.hypotheses.values():
        if each.terms or each.state.labels:
            continue
        if not each.state.steps:
            plain = max(plain, each.log_mass)
        elif each.state.name not in unknown:
            found[each.state.name] = max(each, found.get(each.state.name, each), key=lambda one: one.log_mass)
    likelier = [each for each in found.values() if each.log_mass > plain + HARDLY]
    return [(each.state, each.log_mass) for each in sorted(likelier, key=lambda one: -one.log_mass)]


def _learned(work: Weighing, leading: Hypothesis) -> list[NoiseState]:
    """The likeliest states of each kind beyond that of a hypothesis with a discrepancy, learned beside that."""
    given, less = _left(work, leading)
    before = _before(leading, less)
    promises = sorted(work.noises.beside(given, leading.explanation, less), key=lambda one: one.log_mass)
    least = before + max(HARDLY, work.best - NEAR - leading.log_mass)
    likely = {one.state.name: one for one in promises if one.log_mass > max(least, promises[-1].log_mass - FAR)}
    return [one.state for one in sorted(likely.values(), key=lambda one: -one.log_mass)]


def _moved(work: Weighing, states: list[NoiseState], leading: Hypothesis) -> bool:
    """Whether the sets beside the unknown lead under one of some states; what else is there then is looked for."""
    reached = work.best
    beside = [*work.nameless(plain=not leading.state.steps), *work.nameless()]
    near = [one for one in beside if one.log_mass > leading.log_mass - NEAR]
    for state in states:
        work.moved(near, state)
    there = [one for one in work.nameless() if any(one.state is state for state in states)]
    if work.best < reached + HARDLY or not there:
        return False
    state = there[0].state
    work.weigh(state, work.scanner.stepped(state.steps), there[0].explanation.seeds, deep=False)
    return True
