"""Why an action is refused, in one line that quotes the file; for logs, films and tables."""

from __future__ import annotations

import numpy as np

from serp._util.text import percent
from serp.agent.causes import Cause, causes_of
from serp.model.flags import UNSAFE, risk_of
from serp.model.transition_model import TransitionModel, Vector


def why_not_applicable(model: TransitionModel, state: Vector, action: int) -> str:
    """Return why a ground action is not applicable.

    The reason is a failed precondition, with the values that it reads; effects that contradict each
    other or have no finite result; or a condition without a value, such as a division by zero.
    """
    name = model.actions[action].name
    for cause in causes_of(model, state, action):
        if cause.what in ("failed", "conflict", "undefined"):
            return f"{name}: {what_fails(cause)}"
    return f"{name} is applicable"


def what_fails(cause: Cause, *, located: bool = True) -> str:
    """Say what keeps a step from having a result; its cause is that of an action not applicable.

    With its line, unless not `located`.
    """
    quote = quoted(cause) if located else f"`{cause.text}`"
    if cause.what == "failed":
        return f"{quote} does not hold{values_of(cause)}"
    if cause.what == "conflict":
        return f"{quote} contradicts another effect"
    if not cause.text:
        return f"{cause.name or 'the reward'} gives no finite number"
    through = "" if cause.origin == "action" else f" of {schema_of(cause)}"
    return f"{quote}{through} is neither true nor false, it has no value"


def why_unsafe(model: TransitionModel, state: Vector, action: int) -> str:
    """Return which effect makes `(unsafe)` true one step ahead, and its probability.

    No probability is given where the file as written flags the action. Where several outcomes are
    unsafe, the effect of the likeliest one is named.
    """
    name = model.actions[action].name
    _, flags = model.transition(np.asarray(state, dtype=np.float64).tolist(), action)
    likely = "" if flags & UNSAFE else f"{percent(risk_of(flags))} risk of "
    for cause in causes_of(model, state, action):
        if cause.what == "unsafe":
            return f"{name}: {likely}{what_flags(cause)}"
    return f"{name} is not predicted unsafe"


def what_flags(cause: Cause) -> str:
    """Quote the effect that makes `(unsafe)` true."""
    through = "" if cause.origin == "action" else f" through {schema_of(cause)}"
    return f"{quoted(cause)}{through}"


def unsafe_ahead(safe_steps: int) -> str:
    """Say that something unsafe, or too risky, follows a first step that is safe."""
    periods = f"{safe_steps} control period{'' if safe_steps == 1 else 's'}"
    return f"safe for {periods}, then nothing is left that is predicted safe"


def schema_of(cause: Cause) -> str:
    """Return what a cause belongs to: `event push-wins left`, `the goal`."""
    return f"{cause.origin} {cause.name}" if cause.name else f"the {cause.origin}"


def quoted(cause: Cause) -> str:
    """Quote the text of a cause with its line."""
    line = "" if cause.place is None else f" (line {cause.place.line})"
    return f"`{cause.text}`{line}"


def values_of(cause: Cause) -> str:
    """Return the values that a cause reads, in parentheses; empty where it reads none."""
    shown = [
        f"{name} = {str(value).lower() if isinstance(value, bool) else f'{value:.4g}'}"
        for name, value in cause.reads.items()
    ]
    return f" ({', '.join(shown)})" if shown else ""
