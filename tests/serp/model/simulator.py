"""unified-planning's reader and simulator as a second opinion."""

from __future__ import annotations

import warnings
from fractions import Fraction

from unified_planning.engines.sequential_simulator import UPSequentialSimulator
from unified_planning.io import PDDLReader
from unified_planning.model import FNode, Problem, UPState

from serp.model.transition_model import TransitionModel, Vector
from tests.generated import Texts

Key = tuple[str, ...]


def read(texts: Texts) -> Problem:
    """Read a domain and its problem."""
    with warnings.catch_warnings():  # it uses old names of pyparsing
        warnings.simplefilter("ignore", DeprecationWarning)
        return PDDLReader().parse_problem_string(texts.domain, texts.problem)


class Simulator:
    """Steps a problem with `UPSequentialSimulator`, over plain dictionaries."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        with warnings.catch_warnings():  # it says that it does not know processes and events
            warnings.simplefilter("ignore", UserWarning)
            self.simulator = UPSequentialSimulator(problem, error_on_failed_checks=False)
        self.terms: dict[Key, FNode] = {
            (node.fluent().name, *(str(argument) for argument in node.args)): node
            for node in problem.initial_values
        }

    def initial(self) -> dict[Key, bool | Fraction]:
        """The problem's initial state."""
        return self.spelled(self.simulator.get_initial_state())

    def spelled(self, state: UPState) -> dict[Key, bool | Fraction]:
        values = {key: state.get_value(node) for key, node in self.terms.items()}
        return {key: value.constant_value() for key, value in values.items()}

    def state(self, values: dict[Key, bool | Fraction]) -> UPState:
        constants = self.problem.environment.expression_manager.auto_promote(
            [values[key] for key in self.terms]
        )
        return UPState(dict(zip(self.terms.values(), constants, strict=True)), self.problem)

    def step(self, values: dict[Key, bool | Fraction], action: str) -> dict | None:
        """Return the next state, or None where the action, such as `move a b`, has none."""
        name, *arguments = action.split()
        schema = self.problem.action(name)
        objects = tuple(
            self.problem.environment.expression_manager.ObjectExp(self.problem.object(argument))
            for argument in arguments
        )
        state = self.state(values)
        if not self.simulator.is_applicable(state, schema, objects):
            return None
        after = self.simulator.apply(state, schema, objects)
        return None if after is None else self.spelled(after)

    def goal_reached(self, values: dict[Key, bool | Fraction]) -> bool:
        """Whether the problem's goal holds."""
        return self.simulator.is_goal(self.state(values))


def in_fractions(model: TransitionModel, state: Vector) -> dict[Key, bool | Fraction]:
    """A state of the model, exactly, as the simulator has it (static values left out)."""
    return {
        (f.symbol, *f.arguments): Fraction(value) if f.numeric else bool(value)
        for f, value in zip(model.fluents, state.tolist(), strict=True)
    }
