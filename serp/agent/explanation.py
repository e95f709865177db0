"""The one account of a decision, in the words of the file.

`explain` makes it of what a planner predicts in a state, whoever decided: `serp plan` and
`serp why` print it, and whatever else shows a decision renders it, too. What of the file is behind
an action is traced when it is asked for: of thousands of actions a few are shown.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Final, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from serp._util.text import percent
from serp.agent.causes import Cause, causes_of
from serp.agent.refusals import unsafe_ahead, what_fails, what_flags
from serp.model.flags import APPLICABLE, RISKY, TERMINAL, UNSAFE, risk_of
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.edges import Bound
from serp.planning.forecast import SAFE
from serp.planning.preference import path_score, rank_of

if TYPE_CHECKING:
    from serp.planning.preference import PathScore


class Predicted(Protocol):
    """What a planner predicts for each of some actions, `[A]` or `[E]`; see `Forecast`."""

    @property
    def value(self) -> NDArray[np.float64]:
        """Discounted sum of rewards of the best path."""

    @property
    def path_risk(self) -> NDArray[np.float64]:
        """Probability of an unsafe step on that path."""

    @property
    def safe_steps(self) -> NDArray[np.int64]:
        """Control periods on that path before the first risk."""

    @property
    def reward(self) -> NDArray[np.float64]:
        """Reward of one control period."""

    @property
    def flags(self) -> NDArray[np.int64]:
        """Flags of one control period."""

    @property
    def bound(self) -> Bound:
        """What ended the planner's sight."""


By = Literal["rank", "risk", "safe steps", "value", "delay", "order"]
_BY: Final[tuple[By, ...]] = ("rank", "risk", "safe steps", "value")
"""What decides, in this order: see `serp.planning.preference`."""
_ALIKE: Final = 1e-12
"""Share of two values up to which they are alike: what is put off is worth the same at discount 1,
and a planner that sees this tells the two apart by the least number that there is."""


@dataclass(frozen=True)
class RunnerUp:
    """The best action beside the one taken, by the order in which a planner prefers actions.

    Attributes:
        action: Its position.
        name: Its name.
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


def runner_up_of(predicted: Predicted, names: Sequence[str], chosen: int | None) -> RunnerUp | None:
    """Return the best action beside the one taken; None where no other is applicable."""
    if chosen is None:
        return None
    scores = {
        k: _score(predicted, k)
        for k, flags in enumerate(predicted.flags.tolist())
        if flags & APPLICABLE and k != chosen
    }
    if not scores:
        return None
    return compared(predicted, names, chosen, max(scores, key=lambda k: (scores[k], -k)))


def compared(predicted: Predicted, names: Sequence[str], chosen: int, other: int) -> RunnerUp:
    """Return another action beside the one taken, as if it were the best other one."""
    own, others = _score(predicted, chosen), _score(predicted, other)
    if not int(predicted.flags[chosen]) & APPLICABLE:
        own = path_score(3, 1.0, -1, -np.inf)
    by: By = next((by for by, a, b in zip(_BY, own, others, strict=True) if a != b), "order")
    value, worse = float(predicted.value[chosen]), float(predicted.value[other])
    gap = 0.0 if value == worse else value - worse  # both may be infinite
    if by == "value" and abs(gap) <= _ALIKE * abs(value) < np.inf:
        by = "delay"
    risks = float(predicted.path_risk[chosen]), float(predicted.path_risk[other])
    return RunnerUp(other, names[other], (own, -chosen) > (others, -other), by, gap, risks)


def _score(of: Predicted, k: int) -> PathScore:
    rank, steps = rank_of(int(of.flags[k])), int(of.safe_steps[k])
    return path_score(rank, float(of.path_risk[k]), steps, float(of.value[k]))


_NOISE: Final = 1e-9
"""Share of a reward that is a difference by rounding."""
_NOTICEABLE: Final = 1e-3
"""Share of a best return beyond what is listed that is told."""


@dataclass(frozen=True)
class Behind:
    """What of the file is behind the prediction for an action.

    Attributes:
        remark: What is special, in one line that quotes the file; may be empty.
        causes: What is behind one control period. The amounts of its rewards add up to `reward`.
        next_state: Fluent → value predicted after one control period; None where not applicable.
        ahead: What follows on the best path, as far as it is known, in its order.
        beyond: Best return less the discounted sum of the rewards in `causes` and `ahead`: what
            later steps bring, and other outcomes. 0 where that is hardly anything or the path is
            not known.
    """

    remark: str
    causes: tuple[Cause, ...]
    next_state: dict[str, float | bool] | None
    ahead: tuple[Cause, ...] = ()
    beyond: float = 0.0


@dataclass(frozen=True)
class Alternative:
    """What is predicted for one action, and what is behind that, see `Behind`.

    Attributes:
        action: Its position.
        name: Its name.
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
        trace: Called once, when it is asked what is behind the prediction.
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
    trace: Callable[[], Behind] = field(repr=False, compare=False)

    @functools.cached_property
    def behind(self) -> Behind:
        """What of the file is behind it."""
        return self.trace()

    @property
    def remark(self) -> str:
        """See `Behind`."""
        return self.behind.remark

    @property
    def causes(self) -> tuple[Cause, ...]:
        """See `Behind`."""
        return self.behind.causes

    @property
    def next_state(self) -> dict[str, float | bool] | None:
        """See `Behind`."""
        return self.behind.next_state

    @property
    def ahead(self) -> tuple[Cause, ...]:
        """See `Behind`."""
        return self.behind.ahead

    @property
    def beyond(self) -> float:
        """See `Behind`."""
        return self.behind.beyond

    def as_dict(self) -> dict[str, Any]:
        """Return JSON values (infinities among them)."""
        told = {each.name: getattr(self, each.name) for each in fields(self)[:-1]}
        return {**told, **asdict(self.behind)}


@dataclass(frozen=True)
class Explanation:
    """The account of a decision in one state.

    Attributes:
        state: Fluent → value.
        alternatives: All actions, in their order.
        chosen: Position of the action that was taken; None for none.
        runner_up: The best other action, and what is between the two; None where there is none.
        partial: Whether the best returns are those of the steps in sight alone.
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
    predicted: Predicted,
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
            period; None: what is ahead is not told.
        discount: Weight of a reward one control period later, in the best returns.
    """
    if ground is None:
        ground = range(len(model.actions))
    if names is None:
        names = [action.name for action in model.actions]
    alternatives = tuple(
        _alternative(
            model, state, predicted, k, names[k], g, None if paths is None else paths[k], discount
        )
        for k, g in enumerate(ground)
    )
    values = model.values(state)
    other = runner_up_of(predicted, names, chosen)
    return Explanation(values, alternatives, chosen, other, predicted.bound.partial)


def _alternative(
    model: TransitionModel,
    state: Vector,
    predicted: Predicted,
    k: int,
    name: str,
    ground: int,
    path: Sequence[int] | None,
    discount: float,
) -> Alternative:
    flags, steps = int(predicted.flags[k]), int(predicted.safe_steps[k])
    reward = float(predicted.reward[k]) if flags & APPLICABLE else None
    best, risk = float(predicted.value[k]), float(predicted.path_risk[k])

    def trace() -> Behind:
        causes, after = tuple[Cause, ...](), None
        if ground >= 0:
            causes = tuple(step_causes(model, state, ground, flags, reward))
            if flags & APPLICABLE:
                after = model.values(model.step(state, ground).state)
        ahead = tuple(causes_ahead(model, state, path or ()))
        beyond = 0.0
        if path is not None and flags & APPLICABLE:
            beyond = _beyond(best, (*causes, *ahead), discount)
        return Behind(_remark(causes, ground, flags, steps, risk), causes, after, ahead, beyond)

    return Alternative(
        action=k,
        name=name,
        applicable=bool(flags & APPLICABLE),
        unsafe=bool(flags & UNSAFE),
        risk=risk_of(flags),
        terminal=bool(flags & TERMINAL),
        reward=reward,
        best_return=best,
        path_risk=risk,
        safe_steps=None if steps == SAFE else steps,
        trace=trace,
    )


def _beyond(best: float, causes: Sequence[Cause], discount: float) -> float:
    """Return what the rewards that are listed of an action leave of its best return."""
    listed = 0.0
    for cause in causes:
        if cause.what == "reward":
            listed += discount**cause.after * (cause.amount or 0.0)
    noise = _NOTICEABLE * max(abs(best), abs(listed))
    return best - listed if abs(best - listed) > noise else 0.0


def step_causes(
    model: TransitionModel, state: Vector, ground: int, flags: int, reward: float | None
) -> list[Cause]:
    """Return what is behind one control period as predicted: in the file, and what was learned.

    Args:
        model: The model that predicted.
        state: `[F]`.
        ground: Position of the ground action.
        flags: The predicted flags.
        reward: The predicted reward, to which the amounts of rewards add up; None for none.
    """
    found, ends = causes_of(model.written, state, ground), bool(flags & TERMINAL)
    if flags & APPLICABLE and not ends:
        found = [cause for cause in found if cause.what != "end"]
    elif ends and all(cause.what != "end" for cause in found):
        found.append(Cause("end", None, "learned", "", ""))
    if reward is not None:
        rest = reward - sum(cause.amount or 0.0 for cause in found if cause.what == "reward")
        if abs(rest) > _NOISE * max(1.0, abs(reward)):
            found.append(Cause("reward", rest, "learned", "", ""))
    if risk_of(flags) > 0.0 and not flags & UNSAFE:
        unsafe = [each for each in causes_of(model, state, ground) if each.what == "unsafe"]
        cause = unsafe[0] if unsafe else Cause("risk", None, "learned", "", "")
        found.append(replace(cause, what="risk", amount=risk_of(flags)))
    return found


def causes_ahead(model: TransitionModel, state: Vector, path: Sequence[int]) -> list[Cause]:
    """Return what follows the first control period of a path, until the task ends.

    An action that is not applicable any more, in the middle of its repetitions, is left out.
    """
    found: list[Cause] = []
    after = 0
    for action in path:
        out, flags = model.transition(state.tolist(), action)
        if not flags & APPLICABLE:
            continue
        if after:
            causes = step_causes(model, state, action, flags, out[-1])
            found += [replace(cause, after=after) for cause in causes]
        if flags & TERMINAL:
            break
        state, after = np.array(out[:-1]), after + 1
    return found


def _remark(causes: Sequence[Cause], ground: int, flags: int, steps: int, path_risk: float) -> str:
    """Return what is special about an action, in one line that quotes the file."""
    if ground < 0:
        return "the domain does not mention it"
    if not flags & APPLICABLE:
        failing = [each for each in causes if each.what in ("failed", "conflict", "undefined")]
        return f"not applicable: {what_fails(failing[0]) if failing else 'it has no result'}"
    remarks = []
    if flags & UNSAFE:
        flagging = [each for each in causes if each.what == "unsafe"]
        remarks.append(f"unsafe: {what_flags(flagging[0])}" if flagging else "unsafe")
    elif flags & RISKY:
        cause = next(each for each in causes if each.what == "risk")
        of = "by what was learned" if cause.place is None else f"risk of {what_flags(cause)}"
        remarks.append(f"too risky: {percent(risk_of(flags))} {of}")
    else:
        if risk_of(flags):
            remarks.append(f"risk {percent(risk_of(flags))}, accepted")
        if steps != SAFE:
            remarks.append(unsafe_ahead(steps))
    if not flags & UNSAFE and risk_of(flags) < path_risk < 1.0:
        remarks.append(f"risk of its path {percent(path_risk)}")
    if flags & TERMINAL:
        remarks.append("ends the task")
    return "; ".join(remarks)
