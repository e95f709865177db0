"""The generated functions of one ground model, each made when first used."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from serp.model.codegen import (
    Generated,
    generate_action,
    generate_drift,
    generate_flow,
    generate_judged_action,
    generate_judged_aftermath,
    generate_settle,
    generate_step,
)
from serp.model.emit import Site
from serp.model.flags import APPLICABLE
from serp.model.ground import GroundModel, SetNumber, Test, Value, fluents_of
from serp.model.interpreted import load_function

MAX_NATIVE_SIZE = 400
# numba recurses over the branches of one expression: long ones overflow its stack.
MAX_NATIVE_TEST = 200

_Function = Callable[..., int]
_Traced = tuple[_Function, tuple[Site, ...]]
Amendment = Callable[[list[float], int, list[float]], None]


class Program:
    """What a ground model does, in CPython and as machine code.

    States and the literals are lists of floats; `out` is a copy of the state (for `judge`, of the
    next state) with one more entry, 0. It receives the next state and the reward.

    Args:
        ground: The model.
    """

    def __init__(self, ground: GroundModel) -> None:
        self.ground = ground
        self._actions: dict[int, _Function] = {}
        self._judged: dict[int, _Function] = {}
        self._traced: dict[tuple[Callable[..., Generated], int], _Traced] = {}

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
            theta: Literals, `[P]`.
            dt: Control period, seconds.
            out: A copy of the state and the reward 0 behind it; becomes what follows.
        """
        function = self._actions.get(action)
        if function is None:
            generated = generate_action(self.ground, self.ground.actions[action])
            function = self._actions[action] = _load(generated)
        flags = function(state, theta, dt, out)
        if flags & APPLICABLE:
            flags = self._drift(state, flags, theta, dt, out)
        if not flags & APPLICABLE:
            return flags
        return self._settle(state, flags, theta, dt, out)

    def judge(
        self,
        state: list[float],
        action: int,
        next_state: list[float],
        theta: list[float],
        dt: float,
        out: list[float],
    ) -> int:
        """Read reward and flags off an observed transition; action -1: none of the model."""
        flags = APPLICABLE
        if action >= 0:
            function = self._judged.get(action)
            if function is None:
                generated = generate_judged_action(self.ground, self.ground.actions[action])
                function = self._judged[action] = _load(generated)
            flags = function(state, theta, dt, out)
        if not flags & APPLICABLE:
            return flags
        return self._judged_aftermath(state, next_state, flags, theta, dt, out)

    def trace(
        self,
        state: list[float],
        action: int,
        theta: list[float],
        dt: float,
        amend: Amendment | None = None,
    ) -> tuple[list[Site], int]:
        """Carry out an action as `step` does; return the sites passed, in order, and the flags."""
        out, sites = [*state, 0.0], _Trace()
        flags = sites.run(*self._traced_action(generate_action, action), state, theta, dt, out)
        if flags & APPLICABLE:
            flags = sites.run(*self._traced_drift, state, flags, theta, dt, out)
        if flags & APPLICABLE:
            if amend is not None:
                amend(state, action, out)
            flags = sites.run(*self._traced_settle, state, flags, theta, dt, out)
        return sites.passed, flags

    def trace_judged(
        self,
        state: list[float],
        action: int,
        next_state: list[float],
        theta: list[float],
        dt: float,
    ) -> list[Site]:
        """Judge an observed transition; return the sites passed, in order."""
        out, sites, flags = [*next_state, 0.0], _Trace(), APPLICABLE
        if action >= 0:
            traced = self._traced_action(generate_judged_action, action)
            flags = sites.run(*traced, state, theta, dt, out)
        if flags & APPLICABLE:
            after = (state, next_state, flags, theta, dt, out)
            sites.run(*self._traced_judged_aftermath, *after)
        return sites.passed

    def _traced_action(self, generate: Callable[..., Generated], action: int) -> _Traced:
        key = generate, action
        if key not in self._traced:
            generated = generate(self.ground, self.ground.actions[action], traced=True)
            self._traced[key] = _load_traced(generated)
        return self._traced[key]

    @functools.cached_property
    def _drift(self) -> _Function:
        return _load(generate_drift(self.ground))

    @functools.cached_property
    def _settle(self) -> _Function:
        return _load(generate_settle(self.ground))

    @functools.cached_property
    def _judged_aftermath(self) -> _Function:
        return _load(generate_judged_aftermath(self.ground))

    @functools.cached_property
    def _traced_drift(self) -> _Traced:
        return _load_traced(generate_drift(self.ground, traced=True))

    @functools.cached_property
    def _traced_settle(self) -> _Traced:
        return _load_traced(generate_settle(self.ground, traced=True))

    @functools.cached_property
    def _traced_judged_aftermath(self) -> _Traced:
        return _load_traced(generate_judged_aftermath(self.ground, traced=True))

    @functools.cached_property
    def native(self) -> Any:
        """The compiled C callback of the whole step."""
        from serp.model.native import compile_native

        return compile_native(generate_step(self.ground))

    @property
    def compiled(self) -> bool:
        """Whether `native` has been made already."""
        return "native" in vars(self)

    @functools.cached_property
    def native_flow(self) -> Any:
        """The compiled C callback of effects and processes, without events."""
        from serp.model.native import compile_native

        return compile_native(generate_flow(self.ground))

    @functools.cached_property
    def native_settle(self) -> Any:
        """The compiled C callback of events, goal and metric; it takes flags for the action."""
        from serp.model.native import compile_native

        return compile_native(generate_settle(self.ground))

    @property
    def compiles(self) -> bool:
        """Whether the model is small enough to be compiled to machine code in reasonable time."""
        return self._size <= MAX_NATIVE_SIZE

    @functools.cached_property
    def _size(self) -> int:
        """How often fluents are read and written in all: what compile time grows with."""
        ground = self.ground
        expressions: dict[int, Test | Value] = {}
        writes = 0
        for schema in (*ground.actions, *ground.processes, *ground.events):
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
        if max(reads, default=0) > MAX_NATIVE_TEST:
            return MAX_NATIVE_SIZE + 1
        return writes + sum(reads)


class _Trace:
    """The sites that traced functions pass, one function after the other."""

    def __init__(self) -> None:
        self.passed: list[Site] = []

    def run(self, function: _Function, sites: tuple[Site, ...], *arguments: Any) -> int:
        """Run a traced function; return its result."""
        passed: list[int] = []
        result = function(*arguments, passed)
        self.passed += [sites[k] for k in passed]
        return result


def _load_traced(generated: Generated) -> _Traced:
    return _load(generated), generated.sites


def _load(generated: Generated) -> _Function:
    return load_function(generated, f"<serp {generated.name}>")
