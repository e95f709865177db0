"""What is left to do: how many conditions of the goal do not hold in a state.

The goal is the problem's; a domain without one is done where an action or event ends the task and
increases the reward. Of several ways to be done, the one counts that lacks the fewest conditions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from serp.model import ground as g
from serp.model.bytecode.virtual_machine import Machine
from serp.model.emit import Emitter
from serp.pddl.syntax import Change

_ENOUGH = 1_000
"""Most ways to be done that are counted."""

Ways = list[tuple[g.Test, ...]]


def ways_to_be_done(ground: g.GroundModel, theta: Sequence[float]) -> Ways:
    """Return the conditions of each way to reach the goal; none where there is no goal."""
    if ground.goal is not None:
        ways = list(_alternatives(ground.goal))
    else:
        schemas = (*ground.events, *ground.actions)
        ways = [s.preconditions for s in schemas if _succeeds(s, theta)]
    return list(dict.fromkeys(tuple(filter(_of_fluents, tests)) for tests in ways))[:_ENOUGH]


def goal_counter(ground: g.GroundModel, theta: Sequence[float]) -> Machine | None:
    """Return bytecode that counts the conditions left, in place of the reward; None without any.

    It is run as action 0 of a model would be.
    """
    ways = ways_to_be_done(ground, theta)
    if not ways:
        return None
    emitter = Emitter(traced=False)
    emitter.body.append(f"reward = {float(max(map(len, ways)))}")
    for tests in ways:
        left = emitter.temporary("0.0")
        for test in tests:
            certain, _ = emitter.decide(test, "s")
            with emitter.under(f"not {certain}"):
                emitter.body.append(f"{left} = {left} + 1.0")
        with emitter.under(f"{left} < reward"):
            emitter.body.append(f"reward = {left}")
    emitter.body += [f"out[{len(ground.fluents)}] = reward", "return 1"]
    return Machine(ground, emitter.body, [[]])


def _alternatives(goal: g.Test) -> Iterator[tuple[g.Test, ...]]:
    for way in goal.operands if isinstance(goal, g.AnyOf) else (goal,):
        yield way.operands if isinstance(way, g.All) else (way,)


def _succeeds(schema: g.GroundSchema, theta: Sequence[float]) -> bool:
    """Whether a schema always ends the task and increases the reward by a number of the file."""
    certain = [e for e in schema.effects if e.condition == g.Constant(True)]
    ends = any(isinstance(e, g.SetBoolean) and e.target == g.TERMINAL_TARGET for e in certain)
    return ends and any(
        isinstance(effect, g.SetNumber)
        and effect.target == g.REWARD_TARGET
        and isinstance(effect.value, g.ParameterRef)
        and (theta[effect.value.parameter] > 0.0) == (effect.change is Change.INCREASE)
        for effect in certain
    )


def _of_fluents(test: g.Test) -> bool:
    return all(fluent >= 0 for fluent in g.fluents_of(test))
