"""Explanations that quote the domain file: why an action is not applicable, or unsafe."""

from __future__ import annotations

import numpy as np

from serp._util.number_format import percent
from serp.model import ground as g
from serp.model.emit import FLAG_NAMES, Site
from serp.model.flags import UNSAFE, risk_of
from serp.model.transition_model import TransitionModel, Vector


def why_not_applicable(model: TransitionModel, state: Vector, action: int) -> str:
    """Return why a ground action is not applicable.

    The reason is a failed precondition, with the values that it reads; effects that contradict each
    other or have no finite result; or a condition without a value, such as a division by zero.
    """
    passed, _ = model.trace(state, action)
    name = model.actions[action].name
    for site in passed:
        if site.what == "failed" and isinstance(site.item, g.Test):
            return f"{name}: {_quote(site)} does not hold{_values(model, state, site.item)}"
        if site.what == "conflict":
            return f"{name}: {_quote(site)} contradicts another effect"
        if site.what == "undefined" and isinstance(site.item, g.Test):
            through = "" if site.schema is model.actions[action] else f" of {_of(site.schema)}"
            return f"{name}: {_quote(site)}{through} is neither true nor false, it has no value"
        if site.what == "undefined":
            what = site.schema.name if site.schema else "the reward"
            return f"{name}: {what} gives no finite number"
    return f"{name} is applicable"


def why_unsafe(model: TransitionModel, state: Vector, action: int) -> str:
    """Return which effect makes `(unsafe)` true one step ahead, and its probability.

    No probability is given where the file as written flags the action. Where several outcomes are
    unsafe, the effect of the likeliest one is named.
    """
    name = model.actions[action].name
    _, flags = model.transition(np.asarray(state, dtype=np.float64).tolist(), action)
    likely = "" if flags & UNSAFE else f"{percent(risk_of(flags))} risk of "
    passed, _ = model.trace(state, action)
    for site in passed:
        if isinstance(site.item, g.SetBoolean) and site.item.target == g.UNSAFE_TARGET:
            through = "" if site.schema is model.actions[action] else f" through {_of(site.schema)}"
            return f"{name}: {likely}{_quote(site)}{through}"
    return f"{name} is not predicted unsafe"


def unsafe_ahead(safe_steps: int) -> str:
    """Say that something unsafe, or too risky, follows a first step that is safe."""
    periods = f"{safe_steps} control period{'' if safe_steps == 1 else 's'}"
    return f"safe for {periods}, then nothing is left that is predicted safe"


def _of(schema: g.GroundSchema | None) -> str:
    return f"{schema.kind.value} {schema.name}" if schema is not None else "the goal"


def _quote(site: Site) -> str:
    place = site.item.place if isinstance(site.item, _PLACED) else None
    if place is None:
        assert site.schema is not None
        place = site.schema.place
    return f"`{place.text}` (line {place.line})"


def _values(model: TransitionModel, state: Vector, test: g.Test) -> str:
    """Return the values that a test reads, in parentheses; empty where it reads none."""
    parts = []
    for index in dict.fromkeys(g.fluents_of(test)):
        if index < 0:
            parts.append(FLAG_NAMES[index])
            continue
        fluent = model.fluents[index]
        value = float(state[index])
        shown = f"{value:.4g}" if fluent.numeric else ("true" if value else "false")
        parts.append(f"{fluent.name} = {shown}")
    return f" ({', '.join(parts)})" if parts else ""


_PLACED = (g.Holds, g.Compare, g.Not, g.All, g.AnyOf, g.SetBoolean, g.SetNumber)
