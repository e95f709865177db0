"""The generated functions of one ground model, each created on first use."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

from serp.model.codegen import Part, generate_code, load_function
from serp.model.emit import Site
from serp.model.flags import APPLICABLE
from serp.model.ground import GroundModel, SetNumber, Test, Value, fluents_of

MAX_NATIVE_SIZE = 400
# numba recurses over the branches of one expression: long ones overflow its stack.
MAX_NATIVE_TEST = 200

_Function = Callable[..., int]
Amendment = Callable[[list[float], int, list[float]], None]


class Program:
    """The transition function of a ground model, in CPython and as machine code.

    States and parameters are lists of floats. `out` is a copy of the state (for `judge`, of the
    next state) with one more entry, 0; it receives the next state and the reward.

    Args:
        ground: The model.
    """

    def __init__(self, ground: GroundModel) -> None:
        self.ground = ground
        self._actions: dict[int, _Function] = {}
        self._judged: dict[int, _Function] = {}
        self._traced: dict[tuple[Part, int], tuple[_Function, tuple[Site, ...]]] = {}

    def _load(self, part: Part, action: int = -1) -> _Function:
        return load_function(generate_code(self.ground, part, action))

    @functools.cached_property
    def _drift(self) -> _Function:
        return self._load("drift")

    @functools.cached_property
    def _settle(self) -> _Function:
        return self._load("settle")

    @functools.cached_property
    def _judged_aftermath(self) -> _Function:
        return self._load("judged_aftermath")

    # In CPython --------------------------------------------------------------------------------

    def step(
        self,
        state: list[float],
        action: int,
        theta: list[float],
        dt: float,
        out: list[float],
    ) -> int:
        """Carry out an action; return the flags.

        Args:
            state: `[F]`, not changed.
            action: Position of the ground action.
            theta: Parameters, `[P]`.
            dt: Control period, seconds.
            out: A copy of the state and the reward 0; receives the next state and the reward.
        """
        function = self._actions.get(action)
        if function is None:
            function = self._actions[action] = self._load("action", action)
        flags = function(state, theta, dt, out)
        if flags & APPLICABLE:
            flags = self._drift(state, flags, theta, dt, out)
        if flags & APPLICABLE:
            flags = self._settle(state, flags, theta, dt, out)
        return flags

    def judge(
        self,
        state: list[float],
        action: int,
        next_state: list[float],
        theta: list[float],
        dt: float,
        out: list[float],
    ) -> int:
        """Return the flags of an observed transition; action -1 is not one of the model's."""
        flags = APPLICABLE
        if action >= 0:
            function = self._judged.get(action)
            if function is None:
                function = self._judged[action] = self._load("judged_action", action)
            flags = function(state, theta, dt, out)
        if flags & APPLICABLE:
            flags = self._judged_aftermath(state, next_state, flags, theta, dt, out)
        return flags

    def trace(
        self,
        state: list[float],
        action: int,
        theta: list[float],
        dt: float,
        amend: Amendment | None = None,
    ) -> tuple[list[Site], int]:
        """Carry out an action as `step` does; return the sites passed, in order, and the flags.

        Args:
            state: `[F]`.
            action: Position of the ground action.
            theta: Parameters, `[P]`.
            dt: Control period, seconds.
            amend: Changes the result of effects and processes before the events are evaluated; it
                takes the state, the action and `out`.
        """
        out: list[float] = [*state, 0.0]
        sites: list[Site] = []
        flags = self._pass(sites, "action", action, state, theta, dt, out)
        if flags & APPLICABLE:
            flags = self._pass(sites, "drift", -1, state, flags, theta, dt, out)
        if flags & APPLICABLE:
            if amend is not None:
                amend(state, action, out)
            flags = self._pass(sites, "settle", -1, state, flags, theta, dt, out)
        return sites, flags

    def trace_judged(
        self,
        state: list[float],
        action: int,
        next_state: list[float],
        theta: list[float],
        dt: float,
    ) -> list[Site]:
        """Judge an observed transition; return the sites passed, in order."""
        out: list[float] = [*next_state, 0.0]
        sites: list[Site] = []
        flags = APPLICABLE
        if action >= 0:
            flags = self._pass(sites, "judged_action", action, state, theta, dt, out)
        if flags & APPLICABLE:
            after = (state, next_state, flags, theta, dt, out)
            self._pass(sites, "judged_aftermath", -1, *after)
        return sites

    def _pass(self, sites: list[Site], part: Part, action: int, *arguments: Any) -> int:
        """Run a traced function and add the sites that it passes; return its flags."""
        key = part, action
        if key not in self._traced:
            generated = generate_code(self.ground, part, action, traced=True)
            self._traced[key] = load_function(generated), generated.sites
        function, known = self._traced[key]
        passed: list[int] = []
        flags = function(*arguments, passed)
        sites += [known[k] for k in passed]
        return flags

    # As machine code ---------------------------------------------------------------------------

    @functools.cached_property
    def native(self) -> Any:
        """The compiled C callback of the whole step."""
        return self._compiled("step")

    @functools.cached_property
    def native_flow(self) -> Any:
        """The compiled C callback of effects and processes, without events."""
        return self._compiled("flow")

    @functools.cached_property
    def native_settle(self) -> Any:
        """The compiled C callback of events, goal and metric; it takes flags for the action."""
        return self._compiled("settle")

    def _compiled(self, part: Part) -> Any:
        from serp.model.native import compile_native

        return compile_native(generate_code(self.ground, part))

    @property
    def compiled(self) -> bool:
        """Whether `native` is compiled already."""
        return "native" in vars(self)

    @property
    def compiles(self) -> bool:
        """Whether the model is small enough to be compiled to machine code in reasonable time."""
        return self._size <= MAX_NATIVE_SIZE

    @functools.cached_property
    def _size(self) -> float:
        """The number of reads and writes of fluents; compile time grows with it."""
        ground = self.ground
        expressions: dict[int, Test | Value] = {}
        writes = 0
        for schema in ground.schemas:
            expressions.update((id(test), test) for test in schema.preconditions)
            for effect in schema.effects:
                writes += 1
                expressions[id(effect.condition)] = effect.condition  # shared ones count once
                if isinstance(effect, SetNumber):
                    expressions[id(effect.value)] = effect.value
        if ground.goal is not None:
            expressions[id(ground.goal)] = ground.goal
        if ground.metric is not None:
            expressions[id(ground.metric.value)] = ground.metric.value
        reads = [sum(1 for _ in fluents_of(expression)) for expression in expressions.values()]
        return math.inf if max(reads, default=0) > MAX_NATIVE_TEST else writes + sum(reads)
