"""The account of a decision, in the words of the file; every view of it renders this record.

`explain` makes it of what a planner predicts in a state, whoever decided. What of the file is
behind an action is traced when it is read: of thousands of actions a few are shown.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from serp._util.text import percent, plural
from serp.agent.causes import Cause, Origin, causes_of, why_not_applicable
from serp.model.flags import APPLICABLE, RISKY, TERMINAL, UNSAFE, going_on, risk_of
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.forecast import SAFE, Forecast, score_of
from serp.planning.preference import path_score
from serp.tasks.action_map import ActionForecast

By = Literal["rank", "risk", "safe steps", "value", "delay", "order"]


@dataclass(frozen=True)
class RunnerUp:
    """The best action beside the one taken, by the order in which a planner prefers actions.

    Attributes:
        action, name: Its position and its name.
        ahead: Whether the planner prefers the action taken to it; False where somebody else than
            the planner had the choice.
        by: What decides between the two: `rank` (safe before risky before unsafe), the `risk` of
            the path, its `safe steps`, its `value`, the `delay` (both are worth the same, but one
            only puts it off), or the `order` in the file.
        gap: Best return of the action taken less that of this one, in units of the reward.
        path_risks: Probability of an unsafe step on the path of the action taken, and on its own.
    """

    action: int
    name: str
    ahead: bool
    by: By
    gap: float
    path_risks: tuple[float, float]


def compared(
    predicted: Forecast | ActionForecast, names: Sequence[str], chosen: int, other: int
) -> RunnerUp:
    """Return another action beside the one taken, as if it were the best other one."""
    own, others = score_of(predicted, chosen), score_of(predicted, other)
    if not int(predicted.flags[chosen]) & APPLICABLE:
        own = path_score(3, 1.0, -1, -np.inf)
    of_score: tuple[By, ...] = ("rank", "risk", "safe steps", "value")  # see `PathScore`
    by: By = next((by for by, a, b in zip(of_score, own, others, strict=True) if a != b), "order")
    value, worse = float(predicted.value[chosen]), float(predicted.value[other])
    gap = 0.0 if value == worse else value - worse  # both may be infinite
    # A planner that puts off the same tells the two apart by the least number that there is.
    if by == "value" and abs(gap) <= 1e-12 * abs(value) < np.inf:
        by = "delay"
    risks = float(predicted.path_risk[chosen]), float(predicted.path_risk[other])
    return RunnerUp(other, names[other], (own, -chosen) > (others, -other), by, gap, risks)


class _Traced(NamedTuple):
    """What the causes of an alternative are traced in."""

    model: TransitionModel
    state: Vector
    ground: int
    flags: int
    path: Sequence[int] | None
    discount: float


@dataclass(frozen=True)
class Alternative:
    """What is predicted for one action; what is behind that is traced when it is read.

    Attributes:
        action, name: Its position and its name.
        applicable: Whether its precondition holds and the step has a result; False, too, where the
            model does not know the action.
        unsafe: Whether the file flags it.
        risk: Probability, in [0, 1], that it is unsafe one control period ahead.
        terminal: Whether it is predicted to end the task.
        reward: Reward of one control period; None where not applicable.
        best_return: Discounted sum of rewards of the best path that begins with it; -inf where not
            applicable.
        path_risk: Probability of an unsafe step on that path.
        safe_steps: Control periods on that path before the first risk; None where there is none.
    """

    action: int
    name: str
    applicable: bool
    unsafe: bool
    risk: float
    terminal: bool
    reward: float | None
    best_return: float
    path_risk: float
    safe_steps: int | None
    _traced: _Traced = field(repr=False, compare=False)

    @functools.cached_property
    def causes(self) -> tuple[Cause, ...]:
        """What is behind one control period. The amounts of its rewards add up to `reward`."""
        model, state, ground, flags, *_ = self._traced
        return tuple(step_causes(model, state, ground, flags, self.reward)) if ground >= 0 else ()

    @functools.cached_property
    def next_state(self) -> dict[str, float | bool] | None:
        """Fluent → value predicted after one control period; None where not applicable."""
        model, state, ground, *_ = self._traced
        return model.values(model.step(state, ground).state) if self.applicable else None

    @functools.cached_property
    def ahead(self) -> tuple[Cause, ...]:
        """What follows on the best path, as far as it is known, in its order."""
        return tuple(causes_ahead(self._traced.model, self._traced.state, self._traced.path or ()))

    @functools.cached_property
    def beyond(self) -> float:
        """Best return less the discounted rewards in `causes` and `ahead`.

        It is what later steps bring, and other outcomes. 0 where that is hardly anything or the
        path is not known.
        """
        if self._traced.path is None or not self.applicable:
            return 0.0
        listed = 0.0
        for cause in (*self.causes, *self.ahead):
            if cause.what == "reward":
                listed += self._traced.discount**cause.after * (cause.amount or 0.0)
        beyond = self.best_return - listed
        least = 1e-3 * max(abs(self.best_return), abs(listed))
        return beyond if abs(beyond) > least else 0.0

    @functools.cached_property
    def remark(self) -> str:
        """What is special about it, in one line that quotes the file; may be empty."""
        return _remark(self, self._traced.ground, self._traced.flags)

    def as_dict(self) -> dict[str, Any]:
        """Return JSON values (infinities among them), with all that is traced."""
        values = {each.name: getattr(self, each.name) for each in fields(self)[:-1]}
        causes = {name: [asdict(c) for c in getattr(self, name)] for name in ("causes", "ahead")}
        traced = {name: getattr(self, name) for name in ("remark", "next_state", "beyond")}
        return {**values, **causes, **traced}


@dataclass(frozen=True)
class Explanation:
    """The account of a decision in one state.

    Attributes:
        state: Fluent → value.
        alternatives: All actions, in their order.
        chosen: Position of the action that was taken; None for none.
        runner_up: The best other action, and what is between the two; None where there is none.
        partial: Whether the best returns omit what comes after the last step that was planned.
    """

    state: dict[str, float | bool]
    alternatives: tuple[Alternative, ...]
    chosen: int | None
    runner_up: RunnerUp | None
    partial: bool

    @property
    def taken(self) -> Alternative | None:
        """The action that was taken."""
        return None if self.chosen is None else self.alternatives[self.chosen]

    def as_dict(self) -> dict[str, Any]:
        """Return JSON values (infinities among them)."""
        other = self.runner_up
        return {
            "state": dict(self.state),
            "alternatives": [each.as_dict() for each in self.alternatives],
            "chosen": self.chosen,
            "runner_up": None if other is None else asdict(other),
            "partial": self.partial,
        }


def explain(
    model: TransitionModel,
    state: Vector,
    predicted: Forecast | ActionForecast,
    chosen: int | None,
    *,
    names: Sequence[str] | None = None,
    ground: Sequence[int] | None = None,
    paths: Sequence[Sequence[int]] | None = None,
    discount: float = 1.0,
) -> Explanation:
    """Return the account of a decision.

    Args:
        model: The model that predicted; rewards are traced in the file as written, and what differs
            by what was learned is a cause of its own.
        state: `[F]`.
        predicted: What was predicted for each action.
        chosen: The action that was taken; None for none.
        names: Names of the actions; None: those of the ground actions.
        ground: The ground action of each, -1 where the model does not know it; None: the same.
        paths: Ground actions of the best path that begins with each action, each for one control
            period; None: what is ahead is not known.
        discount: Weight of a reward one control period later, in the best returns.
    """
    ground = range(len(model.actions)) if ground is None else ground
    names = [action.name for action in model.actions] if names is None else names
    alternatives = []
    for k, g in enumerate(ground):
        flags, steps = int(predicted.flags[k]), int(predicted.safe_steps[k])
        path = None if paths is None else paths[k]
        alternatives.append(
            Alternative(
                action=k,
                name=names[k],
                applicable=bool(flags & APPLICABLE),
                unsafe=bool(flags & UNSAFE),
                risk=risk_of(flags),
                terminal=bool(flags & TERMINAL),
                reward=float(predicted.reward[k]) if flags & APPLICABLE else None,
                best_return=float(predicted.value[k]),
                path_risk=float(predicted.path_risk[k]),
                safe_steps=None if steps == SAFE else steps,
                _traced=_Traced(model, state, g, flags, path, discount),
            )
        )
    others = [each.action for each in alternatives if each.applicable and each.action != chosen]
    other = None
    if chosen is not None and others:
        best = max(others, key=lambda k: (score_of(predicted, k), -k))
        other = compared(predicted, names, chosen, best)
    partial = predicted.bound.partial
    return Explanation(model.values(state), tuple(alternatives), chosen, other, partial)


def step_causes(
    model: TransitionModel, state: Vector, ground: int, flags: int, reward: float | None
) -> list[Cause]:
    """Return what is behind one control period as predicted: in the file, and what was learned.

    The amounts of rewards add up to the predicted `reward`, if any.
    """
    causes, ends = causes_of(model.written, state, ground), bool(flags & TERMINAL)
    other: Origin = "chance" if ground >= 0 and model.actions[ground].outcomes else "learned"
    if not flags & UNSAFE:  # what is unsafe by chance is a risk
        causes = [cause for cause in causes if cause.what != "unsafe"]
    if flags & APPLICABLE and not ends:
        causes = [cause for cause in causes if cause.what != "end"]
    elif ends and all(cause.what != "end" for cause in causes):
        causes.append(Cause("end", None, "learned", "", ""))
    if reward is not None:
        rest = reward - sum(cause.amount or 0.0 for cause in causes if cause.what == "reward")
        if abs(rest) > 1e-9 * max(1.0, abs(reward)):  # less is rounding
            causes.append(Cause("reward", rest, other, "", ""))
    if risk_of(flags) > 0.0 and not flags & UNSAFE:
        found = causes_of(model, state, ground, unsafe=True)
        unsafe = [cause for cause in found if cause.what == "unsafe"]
        cause = unsafe[0] if unsafe else Cause("risk", None, "learned", "", "")
        causes.append(replace(cause, what="risk", amount=risk_of(flags)))
    return causes


def causes_ahead(model: TransitionModel, state: Vector, path: Sequence[int]) -> list[Cause]:
    """Return what follows the first control period of a path, until the task ends.

    Where that is uncertain, rewards are those expected: times the probability that it goes on.
    An action that is not applicable any more, in the middle of its repetitions, is left out.
    """
    causes: list[Cause] = []
    after, reached = 0, 1.0
    for action in path:
        out, flags = model.transition(state.tolist(), action)
        if not flags & APPLICABLE:
            continue
        if after:
            own = step_causes(model, state, action, flags, out[-1])
            for cause in own:
                amount = cause.amount
                if cause.what == "reward" and amount is not None:
                    amount *= reached
                causes.append(replace(cause, after=after, amount=amount))
        if flags & TERMINAL:
            break
        state, after, reached = np.array(out[:-1]), after + 1, reached * going_on(flags)
    return causes


def _remark(of: Alternative, ground: int, flags: int) -> str:
    if ground < 0:
        return "the domain does not mention it"
    if not flags & APPLICABLE:
        return f"not applicable: {why_not_applicable(of.causes)}"
    cause = next((c for c in of.causes if c.what in ("unsafe", "risk")), None)
    remarks = []
    if flags & UNSAFE:
        remarks.append("unsafe" if cause is None else f"unsafe: {cause.quoted}")
    elif flags & RISKY:
        known = cause is not None and cause.place is not None
        source = f"risk of {cause.quoted}" if cause and known else "by the learned model"
        remarks.append(f"too risky: {percent(of.risk)} {source}" if of.risk else "too risky ahead")
    else:
        if of.risk:
            remarks.append(f"risk {percent(of.risk)}, accepted")
        if of.safe_steps is not None:
            remarks.append(unsafe_ahead(of.safe_steps))
    if not flags & UNSAFE and of.risk < of.path_risk < 1.0:
        remarks.append(f"path risk {percent(of.path_risk)}")
    if flags & TERMINAL:
        remarks.append("ends the task")
    elif (chance := 1.0 - going_on(flags)) >= 0.01:
        remarks.append(f"ends the task with probability {percent(chance)} (learned)")
    return "; ".join(remarks)


def unsafe_ahead(safe_steps: int) -> str:
    """Say that something unsafe, or too risky, follows a first step that is safe."""
    periods = plural(safe_steps, "control period")
    return f"safe for {periods}, then no action is predicted safe"
