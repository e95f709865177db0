"""Check that the trials of a comparison can be compared: domain files, and versions."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np

from serp.comparison.prepared import PreparedComparison
from serp.comparison.trial_records import Record
from serp.control.arbiter import Arbiter
from serp.model.transition_model import StateError, TransitionModel, Vector
from serp.planning.lookahead import Lookahead
from serp.settings import Settings, resolve
from serp.tasks.bound_task import BoundTask
from serp.tasks.reward import reward_source

_STEPS: Final = 500
_SEED: Final = 0


def judges_alike(prepared: PreparedComparison, bound: BoundTask) -> list[str]:
    """Return a warning for each domain file that judges random steps differently from the base.

    If rewards of the domain file are learned from, learners with it are trained on another reward.
    """
    base, *others = prepared.plan.variants
    if not others:
        return []
    settings = resolve("default", bound.task.settings, prepared.plan.changes)
    with contextlib.ExitStack() as stack:
        files = {name: stack.enter_context(prepared.tasks[name].bind()) for name in others}
        return [
            f"The domain file `{name}` {what} other steps than `{base}` does: results "
            "on it cannot be compared."
            for name, what in _different(bound, files, settings).items()
        ]


def made_alike(records: Iterable[Record]) -> list[str]:
    """Return a warning if trials were made with different versions of a package."""
    found: dict[str, set[str]] = {}
    for record in records:
        for name, version in (record.metadata.get("versions") or {}).items():
            found.setdefault(name, set()).add(version or "not installed")
    differ = [
        f"{name} ({', '.join(sorted(several))})"
        for name, several in found.items()
        if len(several) > 1
    ]
    if not differ:
        return []
    return [
        f"The trials were made with different versions of {', '.join(differ)}: equal seeds need "
        "not give equal numbers."
    ]


def _different(
    bound: BoundTask, files: Mapping[str, BoundTask], settings: Settings
) -> dict[str, str]:
    """Return the files that differ from that of `bound`, with a word for the difference."""
    different: dict[str, str] = {}
    by_file = reward_source(bound.rewarded_by, settings) != "environment"
    random = np.random.default_rng(_SEED)
    arbiter = Arbiter(Lookahead(bound.model, settings.planner), bound.actions)
    everyone = {"": bound, **files}

    def grounded(
        raw: Any, info: Mapping[str, Any]
    ) -> dict[str, Vector]:  # the order of fluents may differ
        return {name: file.ground(raw, info, bound.env) for name, file in everyone.items()}

    states = grounded(*bound.reset(seed=_SEED))
    for step in range(_STEPS):
        action = int(random.integers(bound.actions.size))
        ground = int(arbiter.forecast(states[""]).ground[action])
        named = bound.model.actions[ground].name if ground >= 0 else None
        raw, _, terminated, truncated, info = bound.step(action)
        before, states = states, grounded(raw, info)
        expected = _judged(bound.model, before[""], named, states[""])
        for name in files:
            if expected is None:
                break
            found = _judged(files[name].model, before[name], named, states[name])
            if by_file and (found is None or found[0] != expected[0]):
                different.setdefault(name, "rewards")
            elif found is None or found[1] != expected[1]:
                different.setdefault(name, "flags unsafe")
        if terminated or truncated:
            states = grounded(*bound.reset(seed=_SEED + 1 + step))
    return different


def _judged(
    model: TransitionModel, before: Vector, action: str | None, after: Vector
) -> tuple[float, bool] | None:
    """Return reward and unsafety of a step by a domain file; None if it lacks the action."""
    try:
        judged = model.judge(before, -1 if action is None else model.action_index(action), after)
    except StateError:
        return None
    return judged.reward, judged.unsafe
