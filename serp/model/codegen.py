"""Generating the transition function of a ground model as Python text.

The generated functions are straight-line code over flat sequences of floats. The whole step is

    step(s, a, theta, dt, out) -> flags

CPython runs it in three parts, so that a domain of thousands of actions compiles only those that
are executed:

    action(s, theta, dt, out) -> flags               the effects of one action
    drift(s, flags, theta, dt, out) -> flags         processes
    settle(s, flags, theta, dt, out) -> flags        events, goal, metric

`flow(s, a, theta, dt, out)` contains the effects of all actions and the processes. An adapted model
uses it to change the prediction before the events are evaluated.

`s` is the state, `a` the position of the action, `theta` the parameters, `dt` the control period.
The caller passes `out` as a copy of `s` with one more entry, 0. On return it holds the next state
and, in the last entry, the reward. Flags are a sum of APPLICABLE, UNSAFE and TERMINAL. Without
APPLICABLE there is no next state: the precondition fails (0), or the result is UNDEFINED (with
UNSAFE where that is certain). Two more functions compute reward and flags of an observed
transition:

    judged_action(s, theta, dt, out) -> flags
    judged_aftermath(s, n, flags, theta, dt, out) -> flags

`n` is the observed next state; the caller passes `out` as a copy of it. And one tells by TERMINAL
whether a state is one of the goal:

    goal(s, theta, dt, out) -> flags

Every identifier is generated here and every number is read from `theta`, so nothing of a domain
file becomes program text. Two domains that differ only in numbers share one compiled `step`. numba
compiles it with pointer arguments.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, NamedTuple

from serp.model import ground_model as g
from serp.model.emit import EffectEmitter, Site, block, conjunction, joined
from serp.model.flags import APPLICABLE, TERMINAL, UNSAFE

Part = Literal[
    "step", "flow", "action", "drift", "settle", "judged_action", "judged_aftermath", "goal"
]
_ARGUMENTS: dict[Part, str] = {
    "step": "s a theta dt out",
    "flow": "s a theta dt out",
    "action": "s theta dt out",
    "drift": "s flags theta dt out",
    "settle": "s flags theta dt out",
    "judged_action": "s theta dt out",
    "judged_aftermath": "s n flags theta dt out",
    "goal": "s theta dt out",
}
MATH: Mapping[str, Callable[..., float]] = {
    "sqrt": math.sqrt, "sin": math.sin, "cos": math.cos, "atan2": math.atan2,
}  # fmt: skip
"""Functions that the text calls. Machine code calls the same ones of the C library."""
_BITS = (("unsafe", UNSAFE), ("terminal", TERMINAL))


class Generated(NamedTuple):
    """Name and text of a generated function, and the site of each position that `trace` gets."""

    name: str
    text: str
    sites: tuple[Site, ...]


def generate_code(
    model: g.GroundModel, part: Part = "step", action: int = -1, *, traced: bool = False
) -> Generated:
    """Generate one of the functions above.

    Traced, it has one more argument, a list that gets the position of each site passed, the reward
    so far, and a copy of `out`.
    """
    generator = _Generator(model, traced=traced)
    generator.write(part, action)
    arguments = ", ".join([*_ARGUMENTS[part].split(), *(["trace"] if traced else [])])
    text = "\n".join(block(f"def {part}({arguments}):", generator.body))
    return Generated(part, text, tuple(generator.sites))


def statements_of(model: g.GroundModel, action: int) -> list[str]:
    """Return the statements of an action; for -1, those that follow any action in a step.

    Both refer to the variables `reward`, `unsafe` and `terminal`, which begin as 0 and False.
    """
    generator = _Generator(model, traced=False)
    if action >= 0:
        generator.act(model.actions[action])
    else:
        generator.finish()
    return generator.body


class _Generator(EffectEmitter):
    def __init__(self, model: g.GroundModel, *, traced: bool) -> None:
        super().__init__(traced=traced)
        self.model = model
        self.reward_slot = len(model.fluents)

    def write(self, part: Part, action: int) -> None:
        """Emit the body of a function."""
        model = self.model
        if part in ("drift", "settle", "judged_aftermath"):
            self._resume()
        else:
            self._begin()
        match part:
            case "step" | "flow" if model.actions:
                self.body += self._search(0, len(model.actions))
            case "action":
                self.act(model.actions[action])
            case "judged_action":
                self._judged_effects(model.actions[action])
            case "goal" if model.goal is not None:
                with self.under(self.truth(model.goal, "s", None)):
                    self.body.append("terminal = True")
        if part in ("flow", "drift"):
            self.rates(model.processes, "out", rewards=False)
        elif part == "judged_aftermath":
            self.rates(model.processes, "n", rewards=True)
        if part in ("settle", "judged_aftermath"):
            self._events()
            self._goal_and_metric("n" if part == "judged_aftermath" else "out")
        if part == "step":
            self.finish()
        else:
            self._end()

    def finish(self) -> None:
        """Emit what follows any action in a step: processes, events, goal and metric."""
        self.rates(self.model.processes, "out", rewards=False)
        self._events()
        self._goal_and_metric("out")
        self._end()

    def _begin(self) -> None:
        self.body += ["reward = 0.0", "unsafe = False", "terminal = False"]

    def _resume(self) -> None:
        """Emit the start of a function that continues one that ended with `_end`."""
        self.body.append(f"reward = out[{self.reward_slot}]")
        self.body += [f"{name} = (flags & {bit}) != 0" for name, bit in _BITS]

    def _end(self) -> None:
        """Emit: store the reward in its entry, and return the flags."""
        bits = [f"({bit} if {name} else 0)" for name, bit in _BITS]
        self.body.append(f"out[{self.reward_slot}] = reward")
        self.body.append(f"return {' | '.join([str(APPLICABLE), *bits])}")

    def _goal_and_metric(self, result: str) -> None:
        """Emit metric and goal, which read the next state from the array named `result`."""
        model = self.model
        if model.metric is not None:
            self.body.append(f"reward = {self._metric_gain(model.metric, result, 'dt')}")
        if model.goal is not None:
            with self.under(self.truth(model.goal, result, None)):
                self.body.append("terminal = True")
                if model.goal_rewarded:
                    worth = model.goal_parameter
                    gained = "1.0" if worth is None else f"reward + theta[{worth}]"
                    self.body.append(f"reward = {gained}")
        self.require_finite("reward", Site("undefined", None, None))

    def _metric_gain(self, metric: g.GroundMetric, result: str, elapsed: str) -> str:
        after = self.value(metric.value, result, elapsed)
        before = self.value(metric.value, "s", elapsed="0.0")
        gain = (after, before) if metric.maximize else (before, after)
        return f"{gain[0]} - {gain[1]}"

    def gained(self) -> str:
        """Return the expression of the reward of the step so far, but for the time that passed."""
        metric = self.model.metric
        return "reward" if metric is None else self._metric_gain(metric, "out", "0.0")

    # Actions -----------------------------------------------------------------------------------

    def _search(self, start: int, end: int) -> list[str]:
        """Return a binary search over the position of the action."""
        with self.collected() as branch:
            if end - start == 1:
                self.act(self.model.actions[start])
            else:
                middle = (start + end) // 2
                self.body += block(f"if a < {middle}:", self._search(start, middle))
                self.body += block("else:", self._search(middle, end))
        return branch

    def act(self, action: g.GroundSchema) -> None:
        """Emit the preconditions and effects of an action."""
        doubts = []
        for test in action.preconditions:
            certain, doubt = self.decide(test, "s")
            if doubt is not None:
                doubt = self.temporary(doubt)
                doubts.append((doubt, test))
                certain = joined("or", [certain, doubt])
            self.refuse(f"not {certain}", Site("failed", action, test))
        for doubt, test in doubts:
            self.refuse(doubt, Site("undefined", action, test))
        self.effects(action, action.effects, "s")

    def _judged_effects(self, action: g.GroundSchema) -> None:
        """Emit what an action does to reward and flags; nothing where it is inapplicable."""
        effects = [effect for effect in action.effects if effect.target < 0]
        if effects:
            tests = [self.decide(test, "s")[0] for test in action.preconditions]
            with self.under(joined("and", tests) if tests else None):
                self.effects(action, effects, "s")

    # Events ------------------------------------------------------------------------------------

    def _events(self) -> None:
        events = self.model.events
        if not _need_sweeps(events):
            for event in events:
                self._event(event, None)
            return
        self.body += [f"fired{k} = False" for k in range(len(events))]
        self.body.append("again = True")
        with self.collected() as sweep:
            self.body.append("again = False")
            for k, event in enumerate(events):
                self._event(event, f"fired{k}")
        self.body += block("while again:", sweep)

    def _event(self, event: g.GroundSchema, fired: str | None) -> None:
        """Emit an event; with `fired`, the name of a variable, it fires at most once."""
        test = conjunction(event)
        tests = [] if fired is None else [f"not {fired}"]
        if test is not None:
            tests.append(self.truth(test, "out", event, unless=fired))
        with self.under(joined("and", tests) if tests else None):
            if fired is not None:
                self.body += [f"{fired} = True", "again = True"]
            self.effects(event, event.effects, "out")


def _need_sweeps(events: Sequence[g.GroundSchema]) -> bool:
    """Whether an event can enable one before it, so that one pass in file order is not enough."""
    read_before: set[int] = set()
    for event in events:
        if g.writes(event) & read_before:
            return True
        for test in event.preconditions:
            read_before.update(g.fluents_of(test))
    return False


def load_function(generated: Generated, filename: str = "") -> Callable[..., int]:
    """Turn generated text into a Python function; of builtins it reaches MATH alone."""
    # numba finds the environment of a cached function through the module's name.
    namespace: dict[str, Any] = {"__builtins__": {}, "__name__": __name__, **MATH}
    exec(compile(generated.text, filename or f"<serp {generated.name}>", "exec"), namespace)
    function: Callable[..., int] = namespace[generated.name]
    return function
