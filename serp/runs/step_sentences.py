"""Sentences about a recorded step, in the words of the file."""

from __future__ import annotations

import math
from collections.abc import Iterable

from serp._util.text import percent, plural, readable
from serp.agent.causes import Cause
from serp.agent.decision import Actor, Reason
from serp.agent.explanation import unsafe_ahead
from serp.agent.sentences import (
    PARTIAL,
    TO_THE_UNKNOWN,
    line_of_cause,
    lines_of_causes,
    lines_of_changes,
)
from serp.planning.edges import Bound
from serp.runs.step_account import PredictedFluent, StepAccount

_MINOR = 0.05
"""Error, in usual changes, up to which a fluent is as predicted."""
_SAME_REWARD = 0.01
"""Difference of two rewards, as a share, up to which they are the same."""
_WHO = {
    Actor.PLANNER: "The planner",
    Actor.LEARNER: "The learner",
    Actor.EXPLORATION: "Exploration, at random,",
    Actor.FALLBACK: "The fallback",
}
_REFUSED = {
    Reason.NOT_APPLICABLE: "It was refused as not applicable",
    Reason.UNDEFINED: "It was refused because it has no defined result",
    Reason.UNSAFE: "It was refused as unsafe",
    Reason.TOO_RISKY: "It was refused as too risky",
    Reason.UNSAFE_AHEAD: "It was refused because something unsafe would become unavoidable",
    Reason.LOW_REWARD: "It was refused because its predicted reward is below R_min",
    Reason.UNMODELLED: "It was refused because the domain does not mention it",
    Reason.NO_SAFE_ACTION: "Every action was predicted unsafe",
    Reason.LEAST_RISK: "Every action was predicted too risky",
    Reason.NO_APPLICABLE_ACTION: "No action of the domain was applicable",
}
_OF_ALL = (Reason.NO_SAFE_ACTION, Reason.LEAST_RISK, Reason.NO_APPLICABLE_ACTION)


def heading(step: StepAccount) -> str:
    """Return which step it is: `step 1,204, that is step 37 of episode 12, at 0:14.4`."""
    of = step.step
    return f"step {of.step:,}, that is step {of.number:,} of episode {of.episode:,}, at {step.time}"


def who_acted(step: StepAccount) -> list[str]:
    """Say who acted and why."""
    decision, why = step.step.decision, ""
    if decision.proposed >= 0:
        of = step.account.alternatives[decision.proposed]
        why = why_refused(decision.reason, of.causes, of.reward, of.safe_steps)
    return who_decided(
        decision.reason,
        (step.proposed, decision.proposed_by),
        (step.name(decision.action), decision.executed_by),
        rho=decision.rho,
        indifferent=decision.indifferent,
        bound=decision.forecast.bound,
        why=why,
    )


def who_decided(
    reason: Reason,
    proposed: tuple[str, Actor],
    executed: tuple[str, Actor],
    *,
    rho: float,
    indifferent: bool,
    bound: Bound,
    why: str,
) -> list[str]:
    """Say who decided and why, and what the planner's values leave out, or take of the unknown.

    Args:
        reason: Why the executed action was executed.
        proposed: The proposed action, empty for none, and who proposed it.
        executed: The executed action, and whose it is.
        rho: ρ; NaN if it need not be told.
        indifferent: Whether all plans were worth the same to the planner.
        bound: What ended the planner's sight.
        why: What is behind a refusal, see `why_refused`.
    """
    (proposal, proposer), (action, actor) = proposed, executed
    if reason in (Reason.PLANNER_TURN, Reason.LITTLE_TRIED):
        rarely = ", for it was rarely tried" if reason is Reason.LITTLE_TRIED else ""
        lines = [f"It was the planner's turn: {action} was executed{rarely}."]
    elif reason is Reason.ACCEPTED:
        lead = "" if math.isnan(rho) else f" (ρ = {readable(rho)})"
        if indifferent:
            lead = ", for all plans were worth the same to the planner"
        lines = [f"{_WHO[proposer]} chose {action}{lead}. Nothing refused it."]
    else:
        lines = [f"{_WHO[proposer]} proposed {proposal}."] if proposal else []
        if reason in _OF_ALL and why and proposal:  # what is behind it is its alone
            why = f"; {proposal}{why}"
        lines.append(f"{_REFUSED[reason]}{why}.")
        whose = {Actor.PLANNER: "the planner's choice", Actor.FALLBACK: "the least bad"}
        lines.append(
            f"{action} was executed instead, {whose.get(actor, 'as proposed')}."
            if action != proposal
            else f"{action} was executed all the same: nothing better was left."
        )
    if bound is Bound.UNKNOWN:
        lines.append(TO_THE_UNKNOWN)
    return [*lines, PARTIAL] if bound.partial else lines


def why_refused(
    reason: Reason, causes: Iterable[Cause], reward: float | None, safe_steps: int | None
) -> str:
    """Return what of the file is behind a refusal, to follow the sentence about its reason.

    Args:
        reason: Why the proposal was refused.
        causes: What is behind the proposed action, one control period ahead.
        reward: Its predicted reward; None where it is not applicable.
        safe_steps: Control periods on its path before the first risk; None where there is none.
    """
    wanted = ("unsafe", "risk", "failed", "conflict", "undefined")
    for cause in causes:
        if cause.what in wanted:
            text = line_of_cause(cause).rstrip(".")
            shorter = text
            for known in ("unsafe", "not applicable", "no defined result"):
                shorter = shorter.removeprefix(known)
            return shorter if shorter != text else f": {text}"
    if reason is Reason.LOW_REWARD:
        return f": it is {readable(reward)}"
    return "" if safe_steps is None else f": {unsafe_ahead(safe_steps)}"


def what_would_differ(step: StepAccount) -> list[str]:
    """Say what would have had to differ for another outcome, and what was searched."""
    lines = []
    if step.other_vetoes is not None:
        lines += lines_of_changes(step.other_vetoes, f"{step.proposed} would not have been refused")
    if step.other_choices is not None:
        lines += lines_of_changes(step.other_choices)
    if step.step.decision.vetoed and step.other_vetoes is None and step.other_choices is not None:
        lines.append(f"Planned again, {step.proposed} is not refused: the model was another then.")
    searched = step.other_choices or step.other_vetoes
    if searched is not None:
        lines.append(f"{searched.searched} Planned again with {step.ahead_by}.")
    return lines


def prediction_line(each: PredictedFluent) -> str:
    """Return an error of a prediction as a line."""
    line = f"{each.fluent}: {_shown(each.predicted)} predicted, {_shown(each.observed)} observed"
    if isinstance(each.observed, bool):
        pass
    elif math.isinf(each.error):
        line += "; it never changed before"
    else:
        line += f", error: {percent(abs(each.error))} of a typical change"
    if each.learned is not None:
        line += f"; {_shown(each.learned)} by what the run has learned"
    return line + f" (before: {_shown(each.before)})"


def what_came(step: StepAccount) -> list[str]:
    """Compare what was predicted with what was observed, the largest errors first."""
    if not step.predictions:
        return ["What it led to was not recorded: the recording stopped there."]
    wrong = [each for each in step.predictions if abs(each.error) > _MINOR]
    if step.predictions[0].predicted is None:
        lines = ["The file predicts nothing for this action."]
    elif wrong:
        right = len(step.predictions) - len(wrong)
        rest = f"; {plural(right, 'other')} as predicted" if right else ""
        lines = [f"Not as the file predicts{rest}:", *(f"  {prediction_line(w)}" for w in wrong)]
    else:
        lines = ["Every fluent came as the file predicts."]
    reward, decision = step.step.env_reward, step.step.decision
    came = f"The environment gave {readable(reward)}"
    if step.step.terminated or step.step.truncated:
        came += " and the episode ended" + ("" if step.step.terminated else ", cut off")
    lines.append(came + ".")
    if step.domain_reward is not None:
        expected = step.account.alternatives[decision.action].reward
        predicted = "" if expected is None else f", and {readable(expected)} was predicted"
        end = ":" if step.observed else "."
        worth = f"By the file what came is worth {readable(step.domain_reward)}{predicted}"
        lines += [worth + end, *(f"  {line}" for line in lines_of_causes(step.observed))]
        gap = reward - step.domain_reward
        if not math.isclose(reward, step.domain_reward, rel_tol=_SAME_REWARD):
            more = "more" if gap > 0 else "less"
            lines.append(f"The environment gave {readable(abs(gap))} {more} than the file says.")
    return lines


def _shown(value: float | bool | None) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return readable(value)
