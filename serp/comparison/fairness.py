"""Check that all domain files of a comparison judge observed steps alike."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from serp.comparison.plan import ComparisonPlan
from serp.control.arbiter import Arbiter
from serp.control.registry import make_planner
from serp.model.transition_model import StateError, TransitionModel, Vector
from serp.settings import Settings, resolve
from serp.tasks.bound_task import BoundTask
from serp.tasks.reward import reward_source

_STEPS: Final = 500
_SEED: Final = 0


def judges_alike(plan: ComparisonPlan, bound: BoundTask) -> list[str]:
    """Return a warning for each domain file that judges random steps differently from the base.

    If rewards of the domain file are learned from, learners with it are trained on another reward.

    Args:
        plan: The comparison.
        bound: The task with the base file, in a separate environment.
    """
    settings = resolve("default", bound.task.settings, plan.changes)
    with contextlib.ExitStack() as stack:
        variants = {
            name: stack.enter_context(task.bind())
            for name, task in plan.variants.items()
            if name != plan.base
        }
        return [
            f"The domain file `{name}` {what} other steps than `{plan.base}` does: results "
            "on it cannot be compared."
            for name, what in _different(variants, bound, settings).items()
        ]


def _different(
    variants: Mapping[str, BoundTask], bound: BoundTask, settings: Settings
) -> dict[str, str]:
    """Return the variants that differ from the base, with a word for the difference."""
    different: dict[str, str] = {}
    if not variants:
        return different
    by_file = reward_source(bound.rewarded_by, settings) != "environment"
    random = np.random.default_rng(_SEED)
    arbiter = Arbiter(make_planner(bound.model, settings.planner), bound.actions)
    files = {"": bound, **variants}
    states = _grounded(files, bound.reset(seed=_SEED)[0])
    for step in range(_STEPS):
        action = int(random.integers(bound.actions.size))
        ground = int(arbiter.forecast(states[""]).ground[action])
        name_of_action = bound.model.actions[ground].name if ground >= 0 else None
        raw, _, terminated, truncated, _ = bound.step(action)
        before, states = states, _grounded(files, raw)
        found = {
            name: _judged(task.model, before[name], name_of_action, states[name])
            for name, task in files.items()
        }
        expected = found.pop("")
        for name, judged in found.items():
            if name in different or expected is None or judged == expected:
                continue
            if by_file and (judged is None or judged[0] != expected[0]):
                different[name] = "rewards"
            elif judged is None or judged[1] != expected[1]:
                different[name] = "flags unsafe"
        if terminated or truncated:
            states = _grounded(files, bound.reset(seed=_SEED + 1 + step)[0])
    return different


def _grounded(files: Mapping[str, BoundTask], raw: Any) -> dict[str, Vector]:
    """Return the state for each domain file, because the order of fluents may differ."""
    return {name: task.ground(raw) for name, task in files.items()}


def _judged(
    model: TransitionModel, before: Vector, action: str | None, after: Vector
) -> tuple[float, bool] | None:
    """Return reward and unsafety of a step by a domain file; None if it lacks the action."""
    try:
        judged = model.judge(before, -1 if action is None else model.action_index(action), after)
    except StateError:
        return None
    return judged.reward, judged.unsafe
