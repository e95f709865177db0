"""The generated functions of one ground model, each created on first use."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from serp.model.codegen import Part, generate_code, load_function
from serp.model.emit import Passage, Site
from serp.model.flags import APPLICABLE, TERMINAL
from serp.model.ground_model import GroundModel, SetNumber, Test, Value, fluents_of

if TYPE_CHECKING:
    from serp.model.bytecode import Machine


MAX_NATIVE_SIZE = 400
"""Largest size of a model that has machine code of its own; larger ones run as bytecode."""
# numba recurses over the branches of one expression: long ones overflow its stack.
MAX_NATIVE_TEST = 200

_Function = Callable[..., int]
Amendment = Callable[[list[float], int, list[float]], None]
"""Changes the result of effects and processes; takes the state, the action and `out`."""


class Program:
    """The transition function of a ground model, in CPython and as machine code.

    States and parameters are lists of floats. `out` is a copy of the state (for `judge`, of the
    next state) with one more entry, 0; it receives the next state and the reward.

    Args:
        ground: The model.
        own_code: Whether a small model gets machine code of its own.
    """

    def __init__(self, ground: GroundModel, own_code: bool = True) -> None:
        self.ground = ground
        self._own_code = own_code
        self._load = functools.cache(self._generate)
        self._callbacks: dict[Part, Any] = {}

    def _generate(
        self, part: Part, action: int, traced: bool
    ) -> tuple[_Function, tuple[Site, ...]]:
        generated = generate_code(self.ground, part, action, traced=traced)
        return load_function(generated), generated.sites

    def _run(self, passages: list[Passage] | None, part: Part, action: int, *arguments: Any) -> int:
        """Run a function; add what it passes to a list, in order. Action -1 is of none."""
        function, sites = self._load(part, action, passages is not None)
        if passages is None:
            return function(*arguments)
        passed: list[tuple[int, float, list[float]]] = []
        flags = function(*arguments, passed)
        passages.extend(Passage(sites[k], gained, values) for k, gained, values in passed)
        return flags

    # In CPython --------------------------------------------------------------------------------

    def step(
        self,
        state: list[float],
        action: int,
        theta: list[float],
        dt: float,
        out: list[float],
        *,
        passages: list[Passage] | None = None,
        amend: Amendment | None = None,
    ) -> int:
        """Carry out an action, -1 for none while the world goes on; return the flags.

        `passages` receive what is passed; `amend` is called before the events are evaluated.
        """
        flags = APPLICABLE
        if action >= 0:
            flags = self._run(passages, "action", action, state, theta, dt, out)
        if flags & APPLICABLE:
            flags = self._run(passages, "drift", -1, state, flags, theta, dt, out)
        if flags & APPLICABLE:
            if amend is not None:
                amend(state, action, out)
            flags = self._run(passages, "settle", -1, state, flags, theta, dt, out)
        return flags

    def judge(
        self,
        state: list[float],
        action: int,
        next_state: list[float],
        theta: list[float],
        dt: float,
        out: list[float],
        *,
        passages: list[Passage] | None = None,
    ) -> int:
        """Return the flags of an observed transition; action -1 is not one of the model's."""
        flags = APPLICABLE
        if action >= 0:
            flags = self._run(passages, "judged_action", action, state, theta, dt, out)
        if flags & APPLICABLE:
            arguments = state, next_state, flags, theta, dt, out
            flags = self._run(passages, "judged_aftermath", -1, *arguments)
        return flags

    def at_goal(self, state: list[float], theta: list[float], dt: float) -> bool:
        """Return whether the goal holds in a state; False where there is none."""
        return self._run(None, "goal", -1, state, theta, dt, [*state, 0.0]) & TERMINAL != 0

    # As machine code ---------------------------------------------------------------------------

    def native(self, part: Part = "step") -> Any:
        """Return the compiled C callback of a part, or of the virtual machine for the whole step.

        Only a model with code of its own has `flow` and `settle`.
        """
        if not self.has_own_code:
            from serp.model.bytecode import virtual_step

            assert part == "step"
            return virtual_step()
        if part not in self._callbacks:
            from serp.model.native import compile_native

            self._callbacks[part] = compile_native(generate_code(self.ground, part))
        return self._callbacks[part]

    @property
    def machine(self) -> Machine | None:
        """The bytecode of a model that runs as such; None for one with code of its own."""
        return None if self.has_own_code else self._machine

    @functools.cached_property
    def _machine(self) -> Machine:
        from serp.model.bytecode import Machine

        return Machine(self.ground)

    @property
    def compiled(self) -> bool:
        """Whether the whole step is compiled already."""
        return "step" in self._callbacks if self.has_own_code else "_machine" in vars(self)

    @property
    def has_own_code(self) -> bool:
        """Whether the model is small enough to be compiled to machine code in reasonable time.

        Larger ones run as bytecode, with the same results.
        """
        size, most = self._sizes
        return self._own_code and size <= MAX_NATIVE_SIZE and most <= MAX_NATIVE_TEST

    @functools.cached_property
    def _sizes(self) -> tuple[int, int]:
        """The number of reads and writes of fluents, and the most reads of one expression.

        Compile time grows with them.
        """
        ground = self.ground
        effects = [effect for schema in ground.schemas for effect in schema.effects]
        nodes: list[Test | Value | None] = [ground.goal]
        nodes += [test for schema in ground.schemas for test in schema.preconditions]
        nodes += [effect.condition for effect in effects]
        nodes += [effect.value for effect in effects if isinstance(effect, SetNumber)]
        if ground.metric is not None:
            nodes.append(ground.metric.value)
        expressions = {id(node): node for node in nodes if node is not None}  # shared ones once
        reads = [sum(1 for _ in fluents_of(expression)) for expression in expressions.values()]
        return len(effects) + sum(reads), max(reads, default=0)
